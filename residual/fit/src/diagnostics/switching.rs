//! Switching of a residual between levels.

use super::correlation::autocorrelation;
use residual_columns::frame::Frame;
use residual_columns::stats::{mean, rms};

/// Switching of a residual between levels, which no coloured noise shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Switching {
    /// Share of the variance that is in the slow part that switches.
    pub share: f64,
    /// Excess kurtosis of the slow part: -2 for two levels, 0 for noise.
    pub kurtosis: f64,
    /// The kurtosis in standard errors.
    pub z: f64,
}

/// Looks for a slow part that switches between levels: means over short stretches keep the levels
/// and lose the fast noise. Means of coloured noise, however slow, stay normal, with a kurtosis of
/// 0 and a standard error of sqrt(24 / n), where correlated means count as n / (1 + 2 sum rho^4).
/// The stretch with the largest |z| of those of 4 to 64 rows counts.
pub fn switching(r: &[f64], frame: &Frame) -> Switching {
    let total = rms(r).powi(2);
    let mut best = Switching {
        share: 0.0,
        kurtosis: 0.0,
        z: 0.0,
    };
    for width in [4usize, 8, 16, 32, 64] {
        let mut means = Vec::new();
        let (mut within, mut sequences) = (0.0, Vec::new());
        for range in frame.sequences() {
            let start = means.len();
            for s in r[range.clone()].chunks_exact(width) {
                let m = mean(s);
                within += s.iter().map(|x| (x - m).powi(2)).sum::<f64>();
                means.push(m);
            }
            sequences.push(start..means.len());
        }
        let n = means.len() as f64;
        if n < 100.0 {
            break;
        }
        let m = mean(&means);
        let moment = |k: i32| means.iter().map(|x| (x - m).powi(k)).sum::<f64>() / n;
        let variance = moment(2);
        if variance <= 0.0 {
            continue;
        }
        let short = Frame::new(
            vec![],
            (0..means.len()).map(|i| i as f64).collect(),
            sequences,
        );
        let lags = (means.len() / 8).clamp(4, 200);
        let rho = autocorrelation(&means, &short, lags);
        let clump = 1.0 + 2.0 * rho.iter().skip(1).map(|r| r.powi(4)).sum::<f64>();
        let kurtosis = moment(4) / (variance * variance) - 3.0;
        let z = kurtosis / (24.0 * clump / n).sqrt();
        // What white noise of the size found within the stretches would leave in their means.
        let white = within / (n * (width - 1) as f64) / width as f64;
        if z < best.z {
            best = Switching {
                share: ((variance - white) / total.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
                kurtosis,
                z,
            };
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::coloured;
    use residual_columns::stats::Rng;

    #[test]
    fn switching_is_told_from_slow_noise() {
        let n = 6000;
        let t: Vec<f64> = (0..n).map(f64::from).collect();
        let whole = std::iter::once(0..n as usize).collect();
        let frame = Frame::new(vec![], t, whole);
        let mut rng = Rng::new(9);
        let mut level = 1.0;
        let levels: Vec<f64> = (0..n)
            .map(|_| {
                if rng.uniform() < 0.02 {
                    level = -level;
                }
                level + rng.normal()
            })
            .collect();
        let s = switching(&levels, &frame);
        assert!(s.z < -6.0 && s.kurtosis < -0.7, "{s:?}");
        assert!((s.share - 0.5).abs() < 0.15, "{s:?}");
        for seed in 0..20 {
            let s = switching(&coloured(seed, n as usize), &frame);
            assert!(s.z > -4.0, "{seed}: {s:?}");
        }
    }
}
