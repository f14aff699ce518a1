//! The strongest tone in the noise of a load cell at rest.

use std::f64::consts::TAU;

/// Frequencies below this are drift and a cable that swings, Hz.
const LOWEST_HZ: f64 = 8.0;
/// Power of a tone over the median of all frequencies from which it is none of white noise: among
/// 320 frequencies noise alone gets there once in a million times.
const STANDS_OUT: f64 = 30.0;
/// Fewest samples that say something.
const FEWEST: usize = 64;

/// A tone: its frequency, Hz, and its amplitude in the unit of the values.
pub(crate) type Tone = (f64, f64);

/// The strongest one of evenly spaced values at this rate, Hz, that stands out of the noise. A tone
/// above half the rate shows at its image.
pub(crate) fn strongest(values: &[f64], rate_hz: f64) -> Option<Tone> {
    let n = values.len();
    if n < FEWEST || !rate_hz.is_finite() {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    // Hann's window: its side lobes hide no tone, and its sum is n/2.
    let windowed: Vec<f64> = (values.iter().enumerate())
        .map(|(k, value)| (value - mean) * (0.5 - 0.5 * (TAU * k as f64 / n as f64).cos()))
        .collect();
    let first = (LOWEST_HZ * n as f64 / rate_hz).ceil() as usize;
    let powers: Vec<f64> = (first..n / 2).map(|bin| power(&windowed, bin)).collect();
    let (at, most) = (powers.iter().copied().enumerate()).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let mut sorted = powers.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    // The window spreads a tone over three frequencies, 1 + 1/4 + 1/4 of its power.
    let near: f64 = powers.iter().skip(at.saturating_sub(1)).take(3).sum();
    let amplitude = 4.0 * (near / 1.5).sqrt() / n as f64;
    (most > STANDS_OUT * median).then(|| ((first + at) as f64 * rate_hz / n as f64, amplitude))
}

/// Power at one frequency, by Goertzel's recursion.
fn power(values: &[f64], bin: usize) -> f64 {
    let coefficient = 2.0 * (TAU * bin as f64 / values.len() as f64).cos();
    let (mut last, mut before) = (0.0, 0.0);
    for value in values {
        (last, before) = (value + coefficient * last - before, last);
    }
    last * last + before * before - coefficient * last * before
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal numbers, one standard deviation, from a generator of 64 bits (Knuth's constants).
    fn noise(seed: u64, n: usize) -> Vec<f64> {
        let mut state = seed;
        let mut uniform = move || {
            state = (state.wrapping_mul(6_364_136_223_846_793_005))
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..n)
            .map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0)
            .collect()
    }

    #[test]
    fn a_tone_is_found_with_its_frequency_and_size() {
        for (hz, amplitude) in [(50.0, 1.0), (60.3, 2.0), (12.0, 0.9), (150.2, 1.5)] {
            let mut values = noise(3, 640);
            for (k, value) in values.iter_mut().enumerate() {
                *value += 7e5 + amplitude * (TAU * hz * k as f64 / 319.0).sin();
            }
            let (found_hz, found) = strongest(&values, 319.0).expect("it stands out");
            assert!((found_hz - hz).abs() < 0.5, "{hz}: {found_hz}");
            assert!((found / amplitude - 1.0).abs() < 0.2, "{hz}: {found}");
        }
    }

    #[test]
    fn noise_drift_and_too_little_are_no_tone() {
        for seed in 0..200 {
            assert_eq!(strongest(&noise(seed, 640), 320.0), None, "seed {seed}");
        }
        let drift: Vec<f64> = (0..640).map(|k| 0.01 * f64::from(k)).collect();
        let drifting: Vec<f64> = drift
            .iter()
            .zip(noise(1, 640))
            .map(|(a, b)| a + b)
            .collect();
        assert_eq!(strongest(&drifting, 320.0), None);
        assert_eq!(strongest(&[1.0; 640], 320.0), None);
        assert_eq!(strongest(&noise(1, FEWEST - 1), 320.0), None);
        assert_eq!(strongest(&[], f64::NAN), None);
    }
}
