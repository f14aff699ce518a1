//! Errors of a linear model on runs that it has not seen, with intervals over what was left out.

use crate::split::{Apart, Fold, Label};
use crate::sums::{total, Sums};
use nalgebra::DVector;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Penalties to choose from, inside the training runs.
const PENALTIES: [f64; 4] = [1e-4, 3e-4, 1e-3, 3e-3];
/// Draws of the interval.
const DRAWS: usize = 4000;
/// Seed of the draws: the same figures on every run.
const SEED: u64 = 1;

/// Squared error of one run that was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Left {
    /// Number of the fold: runs of one fold are left out together, and drawn together.
    pub fold: usize,
    /// Step of its speed.
    pub speed: u8,
    /// Step of its load.
    pub level: u8,
    /// Sum of squared errors, (mN·m)².
    pub squared: f64,
    /// Rows.
    pub rows: f64,
}

/// A figure of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Root of the mean squared error over all rows, mN·m.
    pub rmse_mnm: f64,
    /// 95 % interval: what was left out is drawn anew.
    pub interval_mnm: (f64, f64),
    /// The runs that were left out.
    pub left: Vec<Left>,
}

impl Figure {
    /// Over what was left out.
    ///
    /// # Panics
    /// If nothing was.
    #[must_use]
    pub fn of(left: Vec<Left>) -> Self {
        let folds = left
            .iter()
            .map(|l| l.fold + 1)
            .max()
            .expect("a figure needs folds");
        let mut sums = vec![(0.0, 0.0); folds];
        for run in &left {
            sums[run.fold].0 += run.squared;
            sums[run.fold].1 += run.rows;
        }
        let rmse = |of: &mut dyn Iterator<Item = (f64, f64)>| {
            let (squared, rows) = of.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            (squared / rows).sqrt()
        };
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut draws: Vec<f64> = (0..DRAWS)
            .map(|_| rmse(&mut (0..folds).map(|_| sums[random.random_range(0..folds)])))
            .collect();
        draws.sort_by(f64::total_cmp);
        Self {
            rmse_mnm: rmse(&mut sums.iter().copied()),
            interval_mnm: (draws[DRAWS / 40], draws[DRAWS - 1 - DRAWS / 40]),
            left,
        }
    }

    /// Error of a part of what was left out; `None` where there is none.
    #[must_use]
    pub fn part(&self, mut which: impl FnMut(&Left) -> bool) -> Option<f64> {
        let (squared, rows) = self
            .left
            .iter()
            .filter(|l| which(l))
            .fold((0.0, 0.0), |(s, r), l| (s + l.squared, r + l.rows));
        (rows > 0.0).then(|| (squared / rows).sqrt())
    }
}

/// Weights fitted on some of the runs; the penalty is chosen among them by the same kind of split.
#[must_use]
pub fn fit(apart: Apart, labels: &[Label], sums: &[Sums], train: &[usize]) -> Option<DVector<f64>> {
    let all = |of: &[usize]| total(sums[0].width(), of.iter().map(|run| &sums[*run]));
    let inner: Vec<(Sums, Sums)> = apart
        .folds(labels, train)
        .iter()
        .map(|Fold { test, train }| (all(train), all(test)))
        .collect();
    let error = |penalty: f64| {
        inner
            .iter()
            .filter_map(|(train, test)| Some(test.squared_error(&train.ridge(penalty)?)))
            .sum::<f64>()
    };
    let best = PENALTIES
        .map(|penalty| (error(penalty), penalty))
        .into_iter()
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    all(train).ridge(best.1)
}

/// Fits and scores every fold.
#[must_use]
pub fn score(apart: Apart, labels: &[Label], sums: &[Sums]) -> Figure {
    let all: Vec<usize> = (0..sums.len()).collect();
    let folds = apart.folds(labels, &all);
    let left: Vec<Vec<Left>> = folds
        .par_iter()
        .enumerate()
        .map(|(number, fold)| {
            let weights = fit(apart, labels, sums, &fold.train);
            let errors = fold.test.iter().filter_map(|run| {
                let (speed, level) = labels[*run];
                Some(Left {
                    fold: number,
                    speed,
                    level,
                    squared: sums[*run].squared_error(weights.as_ref()?),
                    rows: sums[*run].rows,
                })
            });
            errors.collect()
        })
        .collect();
    Figure::of(left.concat())
}

/// Deals rows into parts at random.
pub struct Dealer {
    random: ChaCha8Rng,
    parts: usize,
}

impl Dealer {
    /// A dealer for so many parts; `stream` tells runs apart.
    #[must_use]
    pub fn new(parts: usize, stream: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        random.set_stream(stream);
        Self { random, parts }
    }

    /// Part of the next row.
    pub fn next_part(&mut self) -> usize {
        (self.random.next_u32() as usize) % self.parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten loads at two speeds: the truth is the load's number plus an offset that belongs to the
    /// run.
    fn runs(offset: impl Fn(u8, u8) -> f64) -> (Vec<Label>, Vec<Sums>) {
        let labels: Vec<Label> = (0..2).flat_map(|s| (0..10).map(move |l| (s, l))).collect();
        let sums = labels
            .iter()
            .map(|(s, l)| {
                let x: Vec<f64> = (0..50)
                    .flat_map(|n| [1.0, f64::from(*l) + 0.01 * f64::from(n % 3)])
                    .collect();
                let y: Vec<f64> = x.chunks(2).map(|row| row[1] + offset(*s, *l)).collect();
                Sums::of(2, &x, &y)
            })
            .collect();
        (labels, sums)
    }

    #[test]
    fn an_exact_model_has_no_error_and_an_offset_of_one_level_shows_there() {
        let (labels, sums) = runs(|_, _| 0.0);
        assert!(score(Apart::Level, &labels, &sums).rmse_mnm < 0.05);
        let (labels, sums) = runs(|_, level| if level == 5 { 1.0 } else { 0.0 });
        let figure = score(Apart::Level, &labels, &sums);
        assert!(figure.part(|l| l.level == 5).unwrap() > 0.9);
        assert!(figure.part(|l| l.level == 4).unwrap() < 0.3);
        assert!(figure.part(|l| l.level == 11).is_none());
        let (low, high) = figure.interval_mnm;
        assert!(
            low < figure.rmse_mnm && figure.rmse_mnm < high && high < 0.7,
            "{figure:?}"
        );
    }
}
