//! Round numbers along an axis.

/// A step of 1, 2 or 5 times a power of ten that divides a span into some five parts.
#[must_use]
pub fn tick(span: f64) -> f64 {
    let raw = (span / 5.0).max(1e-9);
    let power = 10f64.powf(raw.log10().floor());
    let factor = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|f| f * power >= raw)
        .unwrap_or(10.0);
    factor * power
}

/// The multiples of [`tick`] in a range.
#[must_use]
pub fn ticks(low: f64, high: f64) -> Vec<f64> {
    let step = tick(high - low);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|n| n as f64 * step).collect()
}

/// A value on an axis of this step, with the decimals that the step needs.
#[must_use]
pub fn label(value: f64, step: f64) -> String {
    let digits = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            ticks(0.0, 1.0),
            [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]
        );
        assert_eq!(label(0.6000000000000001, 0.2), "0.6");
        assert_eq!(label(-2.0, 1.0), "-2");
        for (low, high) in [(-2.5, 5.0), (0.0, 0.21), (1e-3, 2e3)] {
            let all = ticks(low, high);
            assert!((3..=11).contains(&all.len()), "{all:?}");
            assert!(all.iter().all(|t| (low..=high).contains(t)));
        }
    }
}
