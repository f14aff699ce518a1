//! Where the target visibly stops: a reading at the end of its range.

/// Rows in a run of equal values that chance does not make of a noisy reading.
const RUN: usize = 5;

/// Fewest rows in such runs at the end.
const FEWEST: usize = 20;

/// How many times as many rows the end has as one of the values next to it.
const PILE: usize = 3;

/// Values next to the end that are counted.
const NEXT: usize = 5;

/// How many times as many rows such runs hold at the end as at all other values together. A reading
/// in coarse steps, or at rest without noise, repeats itself everywhere.
const MORE: usize = 10;

/// The least and the greatest value of `y` where the target rests there as a limited reading does:
/// in runs of equal values, which it has nowhere else. `None` where it does not.
pub(super) fn stops(y: &[f64]) -> [Option<f64>; 2] {
    let least = y.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = y.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let [mut low, mut high, mut elsewhere] = [0; 3];
    for run in y.chunk_by(|a, b| a == b).filter(|run| run.len() >= RUN) {
        let rows = if run[0] == least {
            &mut low
        } else if run[0] == greatest {
            &mut high
        } else {
            &mut elsewhere
        };
        *rows += run.len();
    }
    let stop = |rows: usize, at: f64| {
        let visible = least < greatest && rows >= FEWEST && rows >= MORE * elsewhere;
        (visible && piles_up(y, at)).then_some(at)
    };
    [stop(low, least), stop(high, greatest)]
}

/// Whether many more rows have the value `at` than each of the values next to it.
fn piles_up(y: &[f64], at: f64) -> bool {
    let mut near: Vec<f64> = y.to_vec();
    near.sort_by(|a, b| (a - at).abs().total_cmp(&(b - at).abs()));
    let mut counts = near.chunk_by(|a, b| a == b).map(<[f64]>::len);
    let own = counts.next().unwrap_or(0);
    let next: Vec<usize> = counts.take(NEXT).collect();
    own * next.len() >= PILE * next.iter().sum::<usize>()
}

/// Half the distance from the stop `at` to the value next to it: how exactly the stop is known.
pub fn half_step(y: &[f64], at: f64) -> f64 {
    let other = y.iter().filter(|v| **v != at).map(|v| (v - at).abs());
    let step = other.fold(f64::INFINITY, f64::min);
    if step.is_finite() {
        0.5 * step
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    fn noisy(f: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut rng = Rng::new(7);
        (0..4000).map(|i| f(i) + 0.02 * rng.normal()).collect()
    }

    #[test]
    fn a_limited_reading_stops_and_a_wave_does_not() {
        let wave = |i: usize| 3.0 + (i as f64 * 0.01).sin();
        let free = noisy(wave);
        assert_eq!(stops(&free), [None, None]);
        let limited: Vec<f64> = free.iter().map(|y| y.min(3.9)).collect();
        assert_eq!(stops(&limited), [None, Some(3.9)]);
        let both: Vec<f64> = limited.iter().map(|y| y.max(2.1)).collect();
        assert_eq!(stops(&both), [Some(2.1), Some(3.9)]);
        // As a converter with steps of 2 mN gives it: the limit is known to half a step.
        let stepped: Vec<f64> = limited
            .iter()
            .map(|y| (y * 500.0).round() / 500.0)
            .collect();
        assert_eq!(stops(&stepped), [None, Some(3.9)]);
        assert!((half_step(&stepped, 3.9) - 0.001).abs() < 1e-9);
    }

    #[test]
    fn coarse_steps_and_rests_are_no_limit() {
        let wave = |i: usize| 3.0 + (i as f64 * 0.01).sin();
        let coarse: Vec<f64> = noisy(wave)
            .iter()
            .map(|y| (y * 5.0).round() / 5.0)
            .collect();
        assert_eq!(stops(&coarse), [None, None]);
        let rests: Vec<f64> = (0..4000).map(|i| f64::from(i / 500)).collect();
        assert_eq!(stops(&rests), [None, None]);
        assert_eq!(stops(&[2.0; 400]), [None, None]);
        assert_eq!(stops(&[]), [None, None]);
    }
}
