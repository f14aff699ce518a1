//! Whether a residual looks like the noise of a sensor: it does not follow itself from row to row
//! or over the whole log, it has no narrow band, and it is as large at one time as at another.

use super::colour::Colour;
use super::correlation::autocorrelation;
use super::envelope::{growth, level, usual, Along, Growth, CUT};
use super::heteroscedasticity::{excess_on, Sort};
use super::imitations::{Imitations, SURE};
use super::narrow::{narrow, Narrow};
use super::random_walk::{random_walk, RandomWalk};
use residual_columns::frame::Frame;
use residual_columns::stats::{self, Rng};

/// Correlation from row to row from which a residual is no noise of a sensor. First-order filters
/// of sensors and slow drifts stay below it at any row rate that resolves the motion.
const FOLLOWS_ITSELF: f64 = 0.97;

/// Rows of the windows whose energies are compared.
const WINDOWS: [usize; 4] = [8, 16, 32, 64];

/// Energy of a burst window over that of the usual one.
const BURST_FACTOR: f64 = 2.5;

/// What is unlike noise in a residual.
#[derive(Debug, Clone, PartialEq)]
pub struct UnlikeNoise {
    /// Correlation from row to row.
    pub lag_one: f64,
    /// Share of the energy that comes in bursts; 0 without bursts.
    pub burst_share: f64,
    /// Share of the energy by which rows of each sort are louder than others like them, in the
    /// order in which the sorts were given; 0 where they are not.
    pub excess: Vec<f64>,
    /// Share of the bursts that falls on rows of each sort, and share of all rows that these are,
    /// in the same order.
    pub within: Vec<(f64, f64)>,
    /// A slow part that is as slow as the log is long.
    pub random_walk: Option<RandomWalk>,
    /// A narrow band.
    pub narrow: Option<Narrow>,
    /// Columns with which the noise grows. It is noise all the same.
    pub growth: Vec<Growth>,
}

impl UnlikeNoise {
    /// Whether it follows itself from row to row.
    pub fn follows_itself(&self) -> bool {
        self.lag_one > FOLLOWS_ITSELF
    }
}

/// Looks at a residual on the rows of a frame, with `sorts` of rows in which something of its own
/// may act. The size of noise may depend on `columns`.
pub fn unlike_noise(r: &[f64], frame: &Frame, sorts: &[Sort], columns: &[Along]) -> UnlikeNoise {
    let rho = autocorrelation(r, frame, 1);
    let mut u = r.to_vec();
    for range in frame.sequences() {
        let mean = stats::mean(&u[range.clone()]);
        u[range.clone()].iter_mut().for_each(|u| *u -= mean);
    }
    let growth = growth(&u, frame, columns);
    let random_walk = random_walk(&u, frame);
    let excess = sorts
        .iter()
        .map(|sort| excess_on(&u, frame, sort, columns))
        .collect();
    let u = level(&u, columns, |_| true);
    let mut colour = Colour::new(&u, frame);
    let mut rng = Rng::new(u.len() as u64);
    let imitations = Imitations::new(frame);
    let band = narrow(&mut colour, frame, &mut rng, &imitations);
    let bursts = bursts(&u, frame, &mut colour, &mut rng, &imitations);
    let count = |windows: &[std::ops::Range<usize>], mask: &[bool]| {
        let rows: usize = windows.iter().map(std::ops::Range::len).sum();
        let hits: usize = windows
            .iter()
            .map(|w| mask[w.clone()].iter().filter(|m| **m).count())
            .sum();
        hits as f64 / rows.max(1) as f64
    };
    let within = sorts
        .iter()
        .map(|Sort { rows, .. }| {
            let all = rows.iter().filter(|m| **m).count() as f64 / rows.len().max(1) as f64;
            let of = |b: &Bursts| count(&b.windows, rows);
            (bursts.as_ref().map_or(0.0, of), all)
        })
        .collect();
    UnlikeNoise {
        lag_one: rho.get(1).copied().unwrap_or(0.0),
        burst_share: bursts.map_or(0.0, |b| b.share),
        excess,
        within,
        random_walk,
        narrow: Some(band).filter(|b| b.z > SURE),
        growth,
    }
}

/// Share of the energy in burst windows, and where they are.
struct Bursts {
    share: f64,
    windows: Vec<std::ops::Range<usize>>,
}

/// Energies of windows, and how they vary.
struct Energies {
    windows: Vec<std::ops::Range<usize>>,
    energies: Vec<f64>,
    /// Their variance over the square of their mean.
    spread: f64,
}

impl Energies {
    fn new(u: &[f64], frame: &Frame, width: usize, cut: f64) -> Option<Energies> {
        let (mut windows, mut energies) = (Vec::new(), Vec::new());
        for range in frame.sequences() {
            for start in (range.start..range.end).step_by(width) {
                let window = start..start + width;
                if window.end <= range.end {
                    let sum: f64 = u[window.clone()].iter().map(|x| x.powi(2).min(cut)).sum();
                    energies.push(sum / width as f64);
                    windows.push(window);
                }
            }
        }
        let mean = stats::mean(&energies);
        (energies.len() >= 60 && mean > 0.0).then(|| Energies {
            spread: (stats::deviation(&energies) / mean).powi(2),
            windows,
            energies,
        })
    }

    /// Excess of the windows above a multiple of the usual energy, as a share of all, and which
    /// these are.
    fn bursts(self, normal: f64) -> Bursts {
        let mut sorted = self.energies.clone();
        sorted.sort_by(f64::total_cmp);
        let quiet = stats::quantile_sorted(&sorted, 0.5);
        let limit = (1.0 + 4.0 * normal.sqrt()).max(BURST_FACTOR) * quiet;
        let all: f64 = self.energies.iter().sum();
        let mut out = Bursts {
            share: 0.0,
            windows: vec![],
        };
        for (window, energy) in self.windows.into_iter().zip(&self.energies) {
            if *energy > limit {
                out.share += (energy - quiet) / all;
                out.windows.push(window);
            }
        }
        out
    }
}

/// Bursts: energies of windows vary more than those of noise that has the same colour and the same
/// values in another order. Heavy tails and single outliers are in that noise too.
fn bursts(
    u: &[f64],
    frame: &Frame,
    colour: &mut Colour,
    rng: &mut Rng,
    imitations: &Imitations,
) -> Option<Bursts> {
    let cut = (CUT * usual(u)).powi(2);
    let rho = autocorrelation(u, frame, 64.min(u.len() / 4).max(1));
    // Squares of correlated normal values are correlated by the square of their correlation.
    let normal = WINDOWS.map(|width| {
        let clump = (1..width.min(rho.len()))
            .map(|k| (1.0 - k as f64 / width as f64) * rho[k].powi(2))
            .sum::<f64>();
        2.0 * (1.0 + 2.0 * clump) / width as f64
    });
    let mut spreads = [const { Vec::new() }; WINDOWS.len()];
    let mut shares = [const { Vec::new() }; WINDOWS.len()];
    for _ in 0..imitations.count {
        let noise = colour.noise(rng, &imitations.frame);
        for (k, width) in WINDOWS.into_iter().enumerate() {
            if let Some(e) = Energies::new(&noise, &imitations.frame, width, cut) {
                spreads[k].push(e.spread);
                shares[k].push(e.bursts(normal[k]).share);
            }
        }
    }
    let mut best: Option<Bursts> = None;
    for (k, width) in WINDOWS.into_iter().enumerate() {
        let Some(found) = Energies::new(u, frame, width, cut) else {
            break;
        };
        // Few sequences may be long enough for such windows.
        if spreads[k].len() < imitations.count {
            continue;
        }
        let error = imitations.error(&spreads[k]).max(1e-9);
        let z = (found.spread - stats::mean(&spreads[k])) / error;
        let mut found = found.bursts(normal[k]);
        found.share -= stats::mean(&shares[k]);
        if z > SURE && found.share > best.as_ref().map_or(0.0, |b| b.share) {
            best = Some(found);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::imitations::NOISE_ROWS;
    use super::*;
    use crate::diagnostics::coloured;

    fn frame(n: usize) -> Frame {
        let time = (0..n).map(|i| i as f64 * 0.01).collect();
        Frame::new(vec![], time, vec![0..n / 2, n / 2..n])
    }

    fn plain(r: &[f64]) -> UnlikeNoise {
        unlike_noise(r, &frame(r.len()), &[], &[])
    }

    /// An autoregression of order one on values of a distribution.
    fn filtered(keep: f64, n: usize, mut draw: impl FnMut() -> f64) -> Vec<f64> {
        let mut x = 0.0;
        (0..n)
            .map(|_| {
                x = keep * x + draw();
                x
            })
            .collect()
    }

    /// Student's t with three degrees of freedom.
    fn student(rng: &mut Rng) -> f64 {
        let chi: f64 = (0..3).map(|_| rng.normal().powi(2)).sum();
        rng.normal() / (chi / 3.0).sqrt()
    }

    #[test]
    fn coloured_noise_is_noise() {
        for seed in 0..20 {
            let n = 8000;
            let mut rng = Rng::new(seed);
            let white: Vec<f64> = coloured(seed, n)
                .iter()
                .map(|x| x + 2.0 * rng.normal())
                .collect();
            let short = filtered(0.9, n, || rng.normal());
            for r in [coloured(seed, n), white, short] {
                let found = plain(&r);
                assert!(found.burst_share < 0.04, "{seed}: {found:?}");
                assert!(!found.follows_itself());
                assert!(found.random_walk.is_none(), "{seed}: {found:?}");
                assert!(found.narrow.is_none(), "{seed}: {found:?}");
            }
        }
    }

    /// The noises are shorter than such a residual. It is judged as a shorter one is: from its
    /// colour, its tails and its bursts.
    #[test]
    fn a_long_residual_is_judged_from_shorter_noises() {
        let n = 3 * NOISE_ROWS;
        let mut rng = Rng::new(8);
        for keep in [0.0, 0.9] {
            let tails = filtered(keep, n, || student(&mut rng));
            let found = plain(&tails);
            assert!(found.burst_share < 0.04, "{found:?}");
            assert!(found.narrow.is_none(), "{found:?}");
            // Bursts in a part of the log that no noise has.
            let burst = |i: usize| i > n / 2 && (i / 30).is_multiple_of(10);
            let late: Vec<f64> = (0..n)
                .map(|i| tails[i] * if burst(i) { 4.0 } else { 1.0 })
                .collect();
            let found = plain(&late);
            assert!(found.burst_share > 0.1, "{found:?}");
        }
    }

    #[test]
    fn heavy_tails_and_outliers_are_no_bursts() {
        for seed in 0..10 {
            let n = 8000;
            let mut rng = Rng::new(seed);
            let tails = filtered(0.0, n, || student(&mut rng));
            let slow_tails = filtered(0.6, n, || student(&mut rng));
            let outliers = filtered(0.0, n, || {
                rng.normal() + if rng.uniform() < 0.002 { 12.0 } else { 0.0 }
            });
            for r in [tails, slow_tails, outliers] {
                let found = plain(&r);
                assert!(found.burst_share < 0.04, "{seed}: {found:?}");
                assert!(found.narrow.is_none(), "{seed}: {found:?}");
            }
        }
    }

    #[test]
    fn noise_that_grows_with_a_column_is_noted_and_is_no_burst() {
        let n = 8000;
        let mut rng = Rng::new(4);
        let load: Vec<f64> = (0..n).map(|i| (i as f64 * 0.01).sin() * 5.0).collect();
        let r: Vec<f64> = load
            .iter()
            .map(|l| rng.normal() * (0.3 + l.abs()))
            .collect();
        let found = plain(&r);
        assert!(found.burst_share > 0.1, "{found:?}");
        let along = Along {
            name: "load".into(),
            values: load,
        };
        let found = unlike_noise(&r, &frame(n), &[], &[along]);
        assert!(found.burst_share < 0.04, "{found:?}");
        let growth = &found.growth[0];
        assert!(growth.sizes.1 > 3.0 * growth.sizes.0, "{growth:?}");
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
        let speed = Along {
            name: "velocity".into(),
            values: (0..n)
                .map(|i| {
                    if rest[i] {
                        0.0
                    } else {
                        (i as f64 * 0.02).sin()
                    }
                })
                .collect(),
        };
        let sort = Sort {
            others: rest.iter().map(|rest| !rest).collect(),
            rows: rest,
        };
        let found = unlike_noise(&r, &frame(n), &[sort], &[speed]);
        assert!(found.burst_share > 0.1, "{found:?}");
        assert!(
            found.within[0].0 > 0.9 && found.within[0].1 < 0.3,
            "{found:?}"
        );
    }

    #[test]
    fn a_random_walk_is_no_noise_of_a_sensor() {
        for seed in 0..10 {
            let n = 4800;
            let mut rng = Rng::new(seed);
            let walk = filtered(1.0, n, || rng.normal());
            let mut r = walk.clone();
            for half in [0..n / 2, n / 2..n] {
                let mean = stats::mean(&walk[half.clone()]);
                r[half].iter_mut().for_each(|r| *r -= mean);
            }
            let size = stats::rms(&r);
            r.iter_mut().for_each(|r| *r += size / 3.0 * rng.normal());
            let found = plain(&r);
            assert!(!found.follows_itself());
            assert!(
                found.random_walk.is_some_and(|w| w.share > 0.7),
                "{seed}: {found:?}"
            );
        }
    }

    #[test]
    fn a_tone_of_rising_frequency_is_a_narrow_band() {
        for strength in [1.0, 3.0] {
            let n = 4000;
            let mut rng = Rng::new(7);
            let r: Vec<f64> = (0..n)
                .map(|i| {
                    let t = (i % (n / 2)) as f64;
                    let turns = 0.08 * t + 0.1 * t * t / (n / 2) as f64;
                    strength * 1.41 * (std::f64::consts::TAU * turns).sin() + rng.normal()
                })
                .collect();
            let found = plain(&r).narrow;
            assert!(
                found.is_some_and(|b| b.share > 0.1),
                "{strength}: {found:?}"
            );
        }
    }
}
