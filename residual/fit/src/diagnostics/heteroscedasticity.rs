//! Heteroscedasticity: whether a residual is louder on rows of one sort than on others with the
//! same load and velocity.

use super::correlation::{autocorrelation, correlation_time, variance_of_mean};
use super::envelope::{self, level, Along, CUT};
use super::imitations::SURE;
use residual_columns::frame::Frame;
use residual_columns::stats;
use std::ops::Range;

/// Rows of one sort, as at rest or just started, and those that they are compared with.
#[derive(Debug, Clone)]
pub struct Sort {
    /// Whether each row is of the sort.
    pub rows: Vec<bool>,
    /// Whether each row is one to compare with.
    pub others: Vec<bool>,
}

/// Parts of the logs in which rows of the sort are compared with others.
const PARTS: usize = 40;

/// Fewest parts with both, and fewest rows of each there.
const FEWEST_PARTS: usize = 8;
const FEWEST_IN_PART: usize = 10;

/// Student's t of the parts from which they agree.
/// Raised from 3 when each sort came to be judged about its own mean.
const AGREE: f64 = 3.5;

/// Fewest rows of the sort.
const FEWEST: usize = 100;

/// Share of the energy of `u` by which rows of a sort are louder than the others; 0 where it is not
/// sure that they are.
///
/// The size of noise may depend on `columns`. How it does is taken from the other rows: a size that
/// is fitted to rows at rest as well would make them as loud as is expected. Rows of the sort with
/// larger values of a column than the others have are left out: how loud noise is there is not
/// known.
pub(super) fn excess_on(u: &[f64], frame: &Frame, sort: &Sort, columns: &[Along]) -> f64 {
    // Of the same speed in both directions: what is nearest to rest counts.
    let sizes: Vec<Along> = columns.iter().map(Along::size).collect();
    let mut own = sort.rows.clone();
    for column in &sizes {
        let mut there = picked(&column.values, &sort.others);
        there.sort_unstable_by(f64::total_cmp);
        let most = stats::quantile_sorted(&there, 0.98);
        for (own, x) in own.iter_mut().zip(&column.values) {
            *own &= *x <= most;
        }
    }
    let count = |mask: &[bool]| mask.iter().filter(|m| **m).count();
    if count(&own) < FEWEST || count(&sort.others) < FEWEST {
        return 0.0;
    }
    let u = level(u, &sizes, |i| sort.others[i]);
    let cut = (CUT * envelope::usual(&u)).powi(2);
    let energy: Vec<f64> = u.iter().map(|u| u.powi(2).min(cut)).collect();
    let (louder, quiet) = (picked(&energy, &own), picked(&energy, &sort.others));
    let (loud, usual) = (stats::mean(&louder), stats::mean(&quiet));
    let more = loud - usual;
    // About the mean of each sort: else a rest that is louder would itself be a correlation as long
    // as it lasts.
    let about: Vec<f64> = energy
        .iter()
        .zip(&own)
        .map(|(e, own)| e - if *own { loud } else { usual })
        .collect();
    let reach = (u.len() / 50).clamp(20, 400).min(u.len() / 4);
    let clump = correlation_time(&autocorrelation(&about, frame, reach));
    let variance = variance_of_mean(&louder, clump) + variance_of_mean(&quiet, clump);
    if more <= SURE * variance.sqrt() {
        return 0.0;
    }
    // A size that changes slowly for a reason of its own may meet these rows in one place, but not
    // everywhere.
    let part = u.len().div_ceil(PARTS);
    let excess: Vec<(f64, f64)> = (0..u.len())
        .step_by(part)
        .filter_map(|start| {
            let end = (start + part).min(u.len());
            let of = |rows: Range<usize>, mask: &[bool]| picked(&energy[rows.clone()], &mask[rows]);
            let (own, mut others) = (of(start..end, &own), of(start..end, &sort.others));
            if others.len() < FEWEST_IN_PART {
                // Those around it are nearly as near in time.
                let around = start.saturating_sub(part)..(end + part).min(u.len());
                others = of(around, &sort.others);
            }
            let both = own.len().min(others.len()) >= FEWEST_IN_PART;
            let rows = own.len() as f64;
            both.then(|| ((stats::mean(&own) - stats::mean(&others)) * rows, rows))
        })
        .collect();
    let (excess, rows): (Vec<f64>, Vec<f64>) = excess.into_iter().unzip();
    let spread = stats::deviation(&excess) * (excess.len() as f64).sqrt();
    let all: f64 = excess.iter().sum();
    if excess.len() < FEWEST_PARTS || all <= AGREE * spread {
        return 0.0;
    }
    let within = all / rows.iter().sum::<f64>();
    more.min(within) * louder.len() as f64 / energy.iter().sum::<f64>()
}

/// Values on the rows of a mask.
fn picked(values: &[f64], mask: &[bool]) -> Vec<f64> {
    let rows = values.iter().zip(mask).filter(|(_, m)| **m);
    rows.map(|(x, _)| *x).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    const ROWS: usize = 8000;

    fn frame() -> Frame {
        let time = (0..ROWS).map(|i| i as f64 * 0.01).collect();
        Frame::new(vec![], time, vec![0..ROWS / 2, ROWS / 2..ROWS])
    }

    /// Rest in every fourth second.
    fn rest(i: usize) -> bool {
        (i / 100).is_multiple_of(4)
    }

    fn velocity() -> Along {
        let values = (0..ROWS).map(|i| {
            if rest(i) {
                0.0
            } else {
                (i as f64 * 0.011).sin()
            }
        });
        Along {
            name: "velocity".into(),
            values: values.collect(),
        }
    }

    /// Rows at rest beside the others.
    fn resting() -> Sort {
        Sort {
            rows: (0..ROWS).map(rest).collect(),
            others: (0..ROWS).map(|i| !rest(i)).collect(),
        }
    }

    fn share(size: impl Fn(usize, f64) -> f64, seed: u64) -> f64 {
        share_of(&resting(), &[velocity()], size, seed)
    }

    /// What a sort is louder with noise of a size that depends on the row and the last column.
    fn share_of(
        sort: &Sort,
        columns: &[Along],
        size: impl Fn(usize, f64) -> f64,
        seed: u64,
    ) -> f64 {
        let mut rng = Rng::new(seed);
        let last = |i: usize| columns.last().map_or(0.0, |c| c.values[i]);
        let mut keep = 0.0;
        let u: Vec<f64> = (0..ROWS)
            .map(|i| {
                keep = 0.6 * keep + rng.normal();
                keep * size(i, last(i))
            })
            .collect();
        excess_on(&u, &frame(), sort, columns)
    }

    #[test]
    fn noise_that_depends_on_the_velocity_is_not_louder_at_rest() {
        for seed in 0..20 {
            assert_eq!(share(|_, _| 1.0, seed), 0.0);
            assert_eq!(share(|_, v| 0.3 + v.abs(), seed), 0.0);
            assert_eq!(share(|_, v| 1.0 - 0.3 * v.abs(), seed), 0.0);
            // Loud in one part of the log, which has more rest than others.
            assert_eq!(share(|i, _| if i < 250 { 4.0 } else { 1.0 }, seed), 0.0);
        }
    }

    /// Few long rests with bursts in them: how long a rest lasts is no memory of the noise.
    #[test]
    fn bursts_in_long_rests_are_louder() {
        let rests = |i: usize| i % 800 < 160 || i % 400 < 30;
        let sort = Sort {
            rows: (0..ROWS).map(rests).collect(),
            others: (0..ROWS).map(|i| !rests(i)).collect(),
        };
        for seed in 0..20 {
            let bursts = |i: usize, _| if rests(i) && i % 23 < 9 { 4.0 } else { 1.0 };
            let share = share_of(&sort, &[], bursts, seed);
            assert!(share > 0.2, "{share}");
        }
    }

    /// Vibration that begins with the motion, and is the same at all speeds.
    #[test]
    fn a_slow_start_is_compared_with_motion_only() {
        let starts = |i: usize| !rest(i) && (i / 100) % 4 == 1;
        let sort = Sort {
            rows: (0..ROWS).map(starts).collect(),
            others: (0..ROWS).map(|i| !rest(i) && !starts(i)).collect(),
        };
        for seed in 0..20 {
            let share = |size: fn(usize, f64) -> f64| share_of(&sort, &[velocity()], size, seed);
            assert_eq!(share(|i, _| if rest(i) { 1.0 } else { 2.0 }), 0.0);
            let loud = share(|i, _| if (i / 100) % 4 == 1 { 1.5 } else { 1.0 });
            assert!(loud > 0.1, "{loud}");
        }
    }

    /// A larger load is held at rest than is ever moved, and the noise grows with the load.
    #[test]
    fn a_load_that_others_do_not_have_says_nothing() {
        let values = (0..ROWS).map(|i| match rest(i) {
            true => 100.0,
            false => 25.0 + 25.0 * (i as f64 * 0.013).sin(),
        });
        let load = Along {
            name: "load".into(),
            values: values.collect(),
        };
        let columns = [velocity(), load];
        for seed in 0..20 {
            let share = share_of(&resting(), &columns, |_, load| 0.1 * load, seed);
            assert_eq!(share, 0.0);
        }
    }

    /// One half of the logs is noisier, and has nearly all of the rest.
    #[test]
    fn noisy_logs_with_more_rest_say_nothing() {
        let rests = |i: usize| match i < ROWS / 2 {
            true => !(i / 100).is_multiple_of(4),
            false => (i / 25).is_multiple_of(16),
        };
        let sort = Sort {
            rows: (0..ROWS).map(rests).collect(),
            others: (0..ROWS).map(|i| !rests(i)).collect(),
        };
        for seed in 0..20 {
            let noisy = |i: usize, _| if i < ROWS / 2 { 2.0 } else { 1.0 };
            assert_eq!(share_of(&sort, &[], noisy, seed), 0.0);
        }
    }

    #[test]
    fn the_share_is_that_of_the_energy() {
        let mut shares: Vec<f64> = (0..20)
            .map(|seed| share(|i, _| if rest(i) { 1.4 } else { 1.0 }, seed))
            .collect();
        // A quarter of the rows has 0.96 more.
        let expected = 0.25 * 0.96 / (1.0 + 0.25 * 0.96);
        let middle = stats::median(&mut shares).unwrap();
        assert!((middle - expected).abs() < 0.02, "{shares:?}");
        assert!(shares.iter().all(|s| *s > 0.1), "{shares:?}");
    }
}
