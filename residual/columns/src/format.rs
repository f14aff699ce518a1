//! Numbers as text in reports: a fixed number of significant digits, values with their interval,
//! percentages and p values. Depends on nothing else, so that every module can use it.

/// A number with four significant digits; in powers of ten below 1e-6 and from 1e7.
///
/// ```
/// assert_eq!(residual_columns::format::num(0.123_456), "0.1235");
/// assert_eq!(residual_columns::format::num(-1234.56), "-1235");
/// assert_eq!(residual_columns::format::num(1.5e-9), "1.500e-9");
/// ```
pub fn num(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    // Rounded first, as 0.009999999 is 0.01000.
    let exponent = exponent(x, 3);
    if !(-6..7).contains(&exponent) {
        format!("{x:.3e}")
    } else {
        format!("{x:.*}", (3 - exponent).max(0) as usize)
    }
}

/// Exponent of a number rounded to `decimals` places of its mantissa.
fn exponent(x: f64, decimals: usize) -> i32 {
    format!("{x:.decimals$e}")
        .rsplit_once('e')
        .and_then(|(_, e)| e.parse().ok())
        .unwrap_or(0)
}

/// A value and the ends `[lo, hi]` of its interval, each rounded to two digits of half the
/// interval's width. Further digits would carry no information. Ends that are equal are no
/// interval: `-`.
pub fn with_interval(x: f64, [lo, hi]: [f64; 2]) -> (String, String) {
    let half = 0.5 * (hi - lo);
    let reach = [x, lo, hi].into_iter().map(f64::abs).fold(0.0, f64::max);
    if half == 0.0 {
        return (num(x), "-".into());
    }
    if !(half > 0.0 && half.is_finite() && reach.is_finite()) {
        return (num(x), format!("{} to {}", num(lo), num(hi)));
    }
    let last = exponent(half, 1) - 1;
    let show = |x: f64| {
        let text = if (1e-3..1e6).contains(&reach) {
            format!("{x:.*}", (-last).max(0) as usize)
        } else {
            let places = (exponent(reach, 3) - last).max(1);
            let shift = exponent(reach, 3) - exponent(x, 3);
            format!("{x:.*e}", (places - shift).max(0) as usize)
        };
        positive_zero(text)
    };
    (show(x), format!("{} to {}", show(lo), show(hi)))
}

/// The text without its minus sign if it is a zero, such as `-0.00`.
pub fn positive_zero(text: String) -> String {
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.into(),
        _ => text,
    }
}

/// A fraction as a percentage: two decimals below 10 %, one from there on.
pub fn percent(x: f64) -> String {
    let decimals = if x.abs() < 0.1 { 2 } else { 1 };
    format!("{} %", positive_zero(format!("{:.decimals$}", 100.0 * x)))
}

/// A p value: `-` for NaN, one digit below 1e-3, where only the order of magnitude is known, and
/// `< 1e-12` below that.
pub fn p_value(p: f64) -> String {
    if p.is_nan() {
        "-".into()
    } else if p < 1e-12 {
        "< 1e-12".into()
    } else if p < 1e-3 {
        format!("{p:.0e}")
    } else if p < 0.1 {
        format!("{p:.3}")
    } else {
        format!("{p:.2}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        assert_eq!(num(0.009_999_999), "0.01000");
        assert_eq!(num(-1234.56), "-1235");
        assert_eq!(num(99_999.7), "100000");
        let texts = |x, ci| {
            let (value, interval) = with_interval(x, ci);
            format!("{value} ({interval})")
        };
        assert_eq!(
            texts(0.211_61, [0.204_7, 0.216_6]),
            "0.2116 (0.2047 to 0.2166)"
        );
        assert_eq!(texts(0.687, [0.6302, 0.7456]), "0.687 (0.630 to 0.746)");
        assert_eq!(texts(-153.4, [-170.0, 2.0]), "-153 (-170 to 2)");
        assert_eq!(
            texts(-2.703e-5, [-3.08e-5, -0.228e-5]),
            "-2.7e-5 (-3.1e-5 to -2e-6)"
        );
        assert_eq!(texts(0.5, [0.5, 0.5]), "0.5000 (-)");
        assert_eq!(percent(-1e-6), "0.00 %");
        assert_eq!(p_value(0.0), "< 1e-12");
        assert_eq!(p_value(1.04e-5), "1e-5");
        assert_eq!(p_value(0.29), "0.29");
    }
}
