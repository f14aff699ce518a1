//! Units as they stand in model files and heads of columns: their dimension and their scale.

/// Base dimensions: angle, length, time, force.
pub type Powers = [i32; 4];

/// Powers of an angle.
pub const ANGLE: Powers = [1, 0, 0, 0];

/// Share by which two scales of one dimension differ at least.
pub const UNLIKE: f64 = 1e-3;

/// A unit: powers of the base dimensions, and how many of rad, m, s and N it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Powers of angle, length, time and force.
    pub powers: Powers,
    /// How many of rad, m, s and N it is.
    pub scale: f64,
}

impl Unit {
    /// A number without unit.
    pub const ONE: Self = Self {
        powers: [0; 4],
        scale: 1.0,
    };

    /// The unit of a product with a power of another unit.
    #[must_use]
    pub fn times(self, other: Self, power: i32) -> Self {
        let mut powers = self.powers;
        for (own, theirs) in powers.iter_mut().zip(other.powers) {
            *own += power * theirs;
        }
        Self {
            powers,
            scale: self.scale * other.scale.powi(power),
        }
    }

    /// Whether both measure the same in unlike scales.
    #[must_use]
    pub fn is_unlike(self, other: Self) -> bool {
        self.powers == other.powers && (self.scale / other.scale - 1.0).abs() > UNLIKE
    }

    /// A unit as text; `None` where a part of it is not known.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim().replace("Nm", "N·m").replace("N mm", "N·mm");
        let (mut unit, mut sign) = (Self::ONE, 1);
        if text.is_empty() {
            return None;
        }
        for (i, part) in text.split('/').enumerate() {
            if i == 1 {
                sign = -1;
            }
            for factor in part.split(['·', '*']) {
                let (name, power) = power(factor.trim())?;
                unit = unit.times(Self::base(name)?, sign * power);
            }
        }
        Some(unit)
    }

    fn base(name: &str) -> Option<Self> {
        let of = |powers, scale| Some(Self { powers, scale });
        if let Some(scale) = radians(name) {
            return of(ANGLE, scale);
        }
        match name {
            "1" => return Some(Self::ONE),
            "um" | "µm" => return of([0, 1, 0, 0], 1e-6),
            "mm" => return of([0, 1, 0, 0], 1e-3),
            "cm" => return of([0, 1, 0, 0], 1e-2),
            "m" => return of([0, 1, 0, 0], 1.0),
            "mN" => return of([0, 0, 0, 1], 1e-3),
            "N" => return of([0, 0, 0, 1], 1.0),
            "kN" => return of([0, 0, 0, 1], 1e3),
            "rpm" => return of([1, 0, -1, 0], std::f64::consts::TAU / 60.0),
            _ => {}
        }
        // `d` and `h` alone may be anything.
        match name {
            "d" | "h" => None,
            _ => of([0, 0, 1, 0], seconds(name)?),
        }
    }
}

/// A factor of a unit and its power: `s^2`, `s²`.
fn power(factor: &str) -> Option<(&str, i32)> {
    if let Some((name, power)) = factor.split_once('^') {
        return Some((name, power.parse().ok()?));
    }
    let name = factor.trim_end_matches(['²', '³']);
    let power = match &factor[name.len()..] {
        "" => 1,
        "²" => 2,
        "³" => 3,
        _ => return None,
    };
    Some((name, power))
}

/// Factor from values in a unit to values in another: 0.001 from `mm` to `m`.
///
/// # Errors
/// A unit that is not known, or one of another quantity, in words that follow its name.
pub fn factor(from: &str, to: &str) -> Result<f64, &'static str> {
    let known = |text: &str| Unit::parse(text).ok_or("is not a unit that is known");
    let (from, to) = (known(from)?, known(to)?);
    if from.powers != to.powers {
        return Err("is a unit of another quantity");
    }
    Ok(from.scale / to.scale)
}

/// Names of units of time, in s.
const TIMES: &[(&[&str], f64)] = &[
    (
        &[
            "s", "sec", "secs", "second", "seconds", "sekunde", "sekunden",
        ],
        1.0,
    ),
    (
        &[
            "ms",
            "msec",
            "msecs",
            "millis",
            "millisec",
            "millisecs",
            "millisecond",
            "milliseconds",
            "millisekunden",
        ],
        1e-3,
    ),
    (
        &[
            "us",
            "µs",
            "μs",
            "usec",
            "usecs",
            "µsec",
            "μsec",
            "micros",
            "microsec",
            "microsecs",
            "microsecond",
            "microseconds",
            "mikrosekunden",
        ],
        1e-6,
    ),
    (
        &[
            "ns",
            "nsec",
            "nsecs",
            "nanos",
            "nanosec",
            "nanosecs",
            "nanosecond",
            "nanoseconds",
            "nanosekunden",
        ],
        1e-9,
    ),
    (&["min", "mins", "minute", "minutes", "minuten"], 60.0),
    (
        &["h", "hr", "hrs", "hour", "hours", "stunde", "stunden"],
        3600.0,
    ),
    (&["d", "day", "days", "tag", "tage"], 86_400.0),
];

/// How many seconds a unit of time is; `None` where the text is no such unit that is known.
pub fn seconds(unit: &str) -> Option<f64> {
    let plain = unit
        .trim()
        .trim_matches(['[', ']', '(', ')'])
        .trim()
        .to_lowercase();
    let of = |(names, _): &&(&[&str], f64)| names.contains(&plain.as_str());
    TIMES.iter().find(of).map(|(_, scale)| *scale)
}

/// Radians per unit, if `unit` is an angle.
pub fn radians(unit: &str) -> Option<f64> {
    match unit.trim() {
        "rad" | "radian" | "radians" => Some(1.0),
        "deg" | "degree" | "degrees" | "°" => Some(std::f64::consts::PI / 180.0),
        "rev" | "turn" | "turns" => Some(std::f64::consts::TAU),
        "mrad" => Some(1e-3),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_they_are_written() {
        for (text, powers, scale) in [
            ("deg/s", [1, 0, -1, 0], 0.017453292519943295),
            ("rad/s^2", [1, 0, -2, 0], 1.0),
            ("mm/s²", [0, 1, -2, 0], 1e-3),
            ("N·mm", [0, 1, 0, 1], 1e-3),
            ("Nm", [0, 1, 0, 1], 1.0),
            ("rpm", [1, 0, -1, 0], 0.10471975511965977),
            ("m/s/s", [0, 1, -2, 0], 1.0),
        ] {
            let unit = Unit::parse(text).unwrap_or_else(|| panic!("{text}"));
            assert_eq!(unit.powers, powers, "{text}");
            assert!((unit.scale / scale - 1.0).abs() < 1e-12, "{text} {unit:?}");
        }
        for text in ["", "V", "A/s", "count", "d", "K", "s^x"] {
            assert_eq!(Unit::parse(text), None, "{text}");
        }
    }

    #[test]
    fn a_factor_is_of_one_quantity() {
        for (from, to, value) in [
            ("mm", "m", 1e-3),
            ("deg", "rad", 0.017453292519943295),
            ("deg/s", "rad/s", 0.017453292519943295),
            ("N mm", "N·m", 1e-3),
            ("ms", "s", 1e-3),
        ] {
            let found = factor(from, to).unwrap();
            assert!((found / value - 1.0).abs() < 1e-12, "{from}: {found}");
        }
        assert_eq!(factor("A", "N·m"), Err("is not a unit that is known"));
        assert_eq!(factor("N", "N·m"), Err("is a unit of another quantity"));
        assert_eq!(factor("deg", "m"), Err("is a unit of another quantity"));
    }
}
