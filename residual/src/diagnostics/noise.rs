//! Whether a residual looks like the noise of a sensor: it does not follow itself from row to row, and it is as large at one
//! time as at another.

use super::correlation::autocorrelation;
use crate::frame::Frame;
use crate::stats;

/// Correlation from row to row from which a residual is no noise of a sensor. First-order filters of sensors and slow drifts
/// stay below it at any row rate that resolves the motion.
const FOLLOWS_ITSELF: f64 = 0.97;

/// Rows of the windows whose energies are compared.
const WINDOWS: [usize; 4] = [8, 16, 32, 64];

/// Standard errors by which the energies of windows must vary more than those of noise of the same colour.
const SURE: f64 = 6.0;

/// Share of the windows of which the burst ones are counted.
const BURST_FACTOR: f64 = 2.5;

/// What is unlike noise in a residual.
#[derive(Debug, Clone, PartialEq)]
pub struct UnlikeNoise {
    /// Correlation from row to row.
    pub lag_one: f64,
    /// Share of the energy that comes in bursts; 0 without bursts.
    pub burst_share: f64,
    /// Share of the bursts that falls on the rows of a mask, and share of all rows that these are; of the masks that were
    /// given, in their order.
    pub within: Vec<(f64, f64)>,
}

impl UnlikeNoise {
    /// Whether it follows itself from row to row.
    pub fn follows_itself(&self) -> bool {
        self.lag_one > FOLLOWS_ITSELF
    }
}

/// One window length: excess of the variation of the energies in standard errors, and the burst windows.
struct Bursts {
    z: f64,
    share: f64,
    windows: Vec<std::ops::Range<usize>>,
}

/// Looks at a residual on the rows of a frame. `masks` say for each row whether it is of some sort (at rest, just started).
pub fn unlike_noise(r: &[f64], frame: &Frame, masks: &[Vec<bool>]) -> UnlikeNoise {
    let rho = autocorrelation(r, frame, 128.min(r.len() / 4).max(1));
    let mut best: Option<Bursts> = None;
    for width in WINDOWS {
        if let Some(b) = bursts(r, frame, &rho, width) {
            if b.z > SURE && best.as_ref().is_none_or(|c| b.share > c.share) {
                best = Some(b);
            }
        }
    }
    let count = |windows: &[std::ops::Range<usize>], mask: &[bool]| {
        let rows: usize = windows.iter().map(std::ops::Range::len).sum();
        let hits: usize = windows
            .iter()
            .map(|w| mask[w.clone()].iter().filter(|m| **m).count())
            .sum();
        hits as f64 / rows.max(1) as f64
    };
    let within = masks
        .iter()
        .map(|mask| {
            let all = mask.iter().filter(|m| **m).count() as f64 / mask.len().max(1) as f64;
            (best.as_ref().map_or(0.0, |b| count(&b.windows, mask)), all)
        })
        .collect();
    UnlikeNoise {
        lag_one: rho.get(1).copied().unwrap_or(0.0),
        burst_share: best.map_or(0.0, |b| b.share),
        within,
    }
}

/// Mean squares over windows against what noise of the same colour and the same distribution gives.
fn bursts(r: &[f64], frame: &Frame, rho: &[f64], width: usize) -> Option<Bursts> {
    let mean = stats::mean(r);
    let mut windows = Vec::new();
    let mut energies = Vec::new();
    for range in frame.sequences() {
        for start in (range.start..range.end).step_by(width) {
            let end = start + width;
            if end <= range.end {
                // Slow drift of the mean is no burst.
                let s = &r[start..end];
                energies.push(s.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / width as f64);
                windows.push(start..end);
            }
        }
    }
    let n = energies.len() as f64;
    if n < 60.0 {
        return None;
    }
    let variance = stats::mean(&energies);
    if variance <= 0.0 {
        return None;
    }
    // Squares of correlated normal values are correlated by the square of their correlation.
    let clump = |lags: usize, weight: &dyn Fn(usize) -> f64| {
        1.0 + 2.0
            * (1..lags.min(rho.len()))
                .map(|k| weight(k) * rho[k].powi(2))
                .sum::<f64>()
    };
    let rows = clump(width, &|k| 1.0 - k as f64 / width as f64);
    // Values of a distribution with heavy tails vary more, one by one.
    let fourth = r.iter().map(|x| (x - mean).powi(4)).sum::<f64>() / r.len() as f64;
    let tails = (fourth / variance.powi(2) - 3.0).max(0.0);
    let normal = 2.0 * rows / width as f64;
    let expected = normal + tails.min(3.0) / width as f64;
    let found = (stats::deviation(&energies) / variance).powi(2);
    // The variance of a chi-square-like variable is uncertain by this much.
    let dof = 2.0 / normal;
    let between = 1.0
        + 2.0
            * (1..rho.len() / width)
                .map(|j| rho[j * width].powi(4))
                .sum::<f64>();
    let error = expected * ((2.0 + 12.0 / dof.max(1.0) * 2.0) * between / n).sqrt();
    let mut sorted = energies.clone();
    sorted.sort_by(f64::total_cmp);
    let quiet = stats::quantile_sorted(&sorted, 0.5);
    let limit = (1.0 + 4.0 * normal.sqrt()).max(BURST_FACTOR) * quiet;
    let mut out = Bursts {
        z: (found - expected) / error,
        share: 0.0,
        windows: vec![],
    };
    for (window, energy) in windows.into_iter().zip(&energies) {
        if *energy > limit {
            out.share += (energy - quiet) / (n * variance);
            out.windows.push(window);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::coloured;
    use crate::stats::Rng;

    fn frame(n: usize) -> Frame {
        let time = (0..n).map(|i| i as f64 * 0.01).collect();
        Frame::new(vec![], time, vec![0..n / 2, n / 2..n])
    }

    #[test]
    fn coloured_noise_has_no_bursts() {
        for seed in 0..20 {
            let n = 8000;
            let mut rng = Rng::new(seed);
            let white: Vec<f64> = coloured(seed, n)
                .iter()
                .map(|x| x + 2.0 * rng.normal())
                .collect();
            for r in [coloured(seed, n), white] {
                let found = unlike_noise(&r, &frame(n), &[]);
                assert!(found.burst_share < 0.04, "{seed}: {found:?}");
                assert!(!found.follows_itself());
            }
        }
    }

    #[test]
    fn bursts_and_where_they_are_found() {
        let n = 8000;
        let mut rng = Rng::new(3);
        let rest: Vec<bool> = (0..n).map(|i| (i / 400) % 4 == 0).collect();
        let r: Vec<f64> = (0..n)
            .map(|i| {
                let burst = rest[i] && (i / 50) % 3 == 0;
                rng.normal() * if burst { 3.0 } else { 1.0 }
            })
            .collect();
        let found = unlike_noise(&r, &frame(n), std::slice::from_ref(&rest));
        assert!(found.burst_share > 0.2, "{found:?}");
        assert!(
            found.within[0].0 > 0.9 && found.within[0].1 < 0.3,
            "{found:?}"
        );
    }
}
