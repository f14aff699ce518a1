//! Calibrated intervals: how wide around an estimate, so that a stated share of unseen trials' rows
//! lies within.
//!
//! The width follows a predicted scale, which is larger in the dead zone: it is fitted to the
//! absolute errors of held-out trials, from what the motion tells (speeds, how far each contact is
//! bent back). The factor on the scale is conformal by trial: the quantile of |error| / scale over
//! the rows of held-out trials, each estimated by a model that has not seen it, separately for six
//! classes of the scale. Rows of a trial are not independent; trials are. So the coverage of one
//! new trial scatters around the stated one by as much as the trials differ.
//!
//! After a recalibration an interval has two parts, whose squares add: what the recalibration has
//! left unknown, and this. Then the factor is the quantile of what the first part does not explain
//! of |error|, over held-out trials on whose first minute the model was recalibrated: slow errors
//! of the balances are in both, and would count twice.
//!
//! Rows after a start or a gap have a scale and factors of their own, in which also stands how much
//! of the friction's state is unknown. They are fitted to replays of the held-out trials with many
//! starts and gaps. Such a row is valid once its interval is no wider than [`WIDEST`] of the others
//! are.

use crate::geometry::Base;
use crate::misfit::TIMES;
use crate::model::ModelError;
use crate::motion::{Moment, Motion, FILTER_S, LEVELS, PLACES};
use crate::physics::settle_rows;
use crate::ridge::{Ridge, Sums};
use crate::sequence::Sequence;
use crate::stream::{Sure, NORMAL_90};
use serde::{Deserialize, Serialize};

/// Added to absolute errors before the logarithm, N: the noise of the label.
const FLOOR_N: f64 = 0.02;
/// Classes of the predicted scale, each with its own factor.
const CLASSES: usize = 6;
/// Share that is covered.
pub const COVERAGE: f64 = 0.90;
/// Share of the rows without a break whose interval is at most as wide as that of a row that is
/// valid after one.
pub const WIDEST: f64 = 0.99;

/// Misfit above which a model no longer fits its robot, per the largest of held-out trials: see
/// [`Interval::fits`]. Chosen on the virtual arm's seeds 11 to 17 and 21 to 27; docs/estimation.md
/// has what it came to on others.
const FITS: f64 = 1.15;

/// Predicted scale and conformal factors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    // By name in the file: what stood there before starts had their own.
    #[serde(flatten)]
    settled: Scaled,
    base: Base,
    axes: Vec<usize>,
    /// Rows after a start or a gap. Models of before have none: such rows are invalid, and their
    /// width is that of the others.
    #[serde(default)]
    start: Option<AfterStart>,
    /// See [`Interval::fits`]. Its name in the file is that of these ways to tell a misfit.
    #[serde(default, rename = "fits_up_to")]
    fits_to: Option<[f64; TIMES]>,
}

/// A scale with the factors of its classes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Scaled {
    scale: Ridge,
    /// Upper ends of the classes of scale but the last, N.
    edges: Vec<f64>,
    /// Half width per scale, by class.
    factors: Vec<f64>,
}

/// Intervals after a start or a gap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct AfterStart {
    scaled: Scaled,
    /// Half width up to which a row is valid, N.
    widest_n: f64,
}

/// What the motion tells about the size of the error.
fn features(m: &Moment, base: &Base, row: &mut Vec<f64>) {
    row.clear();
    let tip = base.jacobian(m.joints) * nalgebra::Vector3::from(m.joint_rate);
    row.push((tip.norm() * 1e3 + 0.1).ln());
    for i in 0..3 {
        let unit = [1e-3, 1e-3, 1e-4][i];
        row.push((m.rate[i].abs() / unit + 1.0).ln());
        row.push((m.joint_rate[i].abs() / unit + 1.0).ln());
        for level in [1, 3, LEVELS - 1] {
            row.push(1.0 - m.motor_stop(i, level).abs());
        }
    }
    for stop in &m.stops[3 * LEVELS..5 * LEVELS] {
        row.push(1.0 - stop.abs());
    }
    row.extend(m.joints);
}

const FEATURES: usize = 1 + 3 * 5 + 2 * LEVELS + 3;

/// Age of a row below which it is never valid, s: three time constants of the filters.
const FIRST_S: f64 = 3.0 * FILTER_S - 1e-9;
/// Time constants with which what a start leaves fades, s: filters, the observer's memory, slow
/// averages.
const FADES_S: [f64; 3] = [0.05, 0.2, 1.0];

/// The same after a start or a gap.
fn start_features(m: &Moment, base: &Base, row: &mut Vec<f64>) {
    features(m, base, row);
    row.extend(m.unknown);
    let at: [f64; 3] = core::array::from_fn(|i| m.unknown_at(i));
    // The scale of the error grows with what is unknown, down to the noise of the estimate.
    row.extend(at.map(|share| (share + 0.01).ln()));
    row.extend([
        at[0] * at[1],
        at[1] * at[2],
        at[0] * at[2],
        at[0] * at[1] * at[2],
    ]);
    row.extend(FADES_S.map(|time_s| (-m.age_s / time_s).exp()));
}

const START_FEATURES: usize = FEATURES + PLACES + 3 + 4 + FADES_S.len();

/// Errors of a held-out trial.
#[derive(Debug, Clone)]
pub struct HeldOut<'a> {
    /// Rows.
    pub sequence: &'a Sequence,
    /// Estimates of a model that has not seen this trial: `rows * axes` values.
    pub predicted: Vec<f32>,
    /// Standard deviation of each estimate by what a recalibration has left unknown, N; empty:
    /// there was none.
    pub unsure_n: Vec<f64>,
    /// First row that the estimates do not know.
    pub from: usize,
    /// Largest misfit of the model in it, where it tells one.
    pub misfit: Option<[f64; TIMES]>,
}

/// What the motion tells at rows, one row of features after another, and their errors.
#[derive(Debug, Clone, Default)]
struct Scores {
    features: Vec<f64>,
    error_n: Vec<f64>,
    /// What of each error a recalibration does not explain, N.
    left_n: Vec<f64>,
}

impl Scores {
    fn push(&mut self, features: &[f64], error_n: f64, unsure_n: f64) {
        self.features.extend_from_slice(features);
        self.error_n.push(error_n);
        let square = error_n.powi(2) - (NORMAL_90 * unsure_n).powi(2);
        self.left_n.push(square.max(0.0).sqrt());
    }

    /// Features, error and what is left of it.
    fn rows(&self) -> impl Iterator<Item = (&[f64], f64, f64)> {
        let width = self.features.len() / self.error_n.len().max(1);
        let rows = self.features.chunks_exact(width.max(1));
        let errors = self.error_n.iter().zip(&self.left_n);
        rows.zip(errors)
            .map(|(row, (error_n, left_n))| (row, *error_n, *left_n))
    }
}

/// Rows after starts and gaps in replays of held-out trials.
#[derive(Debug, Clone, Default)]
pub struct Started(Scores);

impl Started {
    /// Adds a row, the length of its error, N, and its standard deviation by what a recalibration
    /// has left unknown, N.
    pub fn push(&mut self, moment: &Moment, base: &Base, error_n: f64, unsure_n: f64) {
        let mut row = Vec::with_capacity(START_FEATURES);
        start_features(moment, base, &mut row);
        self.0.push(&row, error_n, unsure_n);
    }
}

impl HeldOut<'_> {
    fn error(&self, k: usize, axes: &[usize]) -> f64 {
        let force = &self.predicted[k * axes.len()..(k + 1) * axes.len()];
        error_n(force, self.sequence.target_row(k), axes)
    }
}

/// Length of the error of a force, N. `label`: three components.
#[must_use]
pub fn error_n(force: &[f32], label: &[f32], axes: &[usize]) -> f64 {
    let square =
        |(force, axis): (&f32, &usize)| (f64::from(*force) - f64::from(label[*axis])).powi(2);
    force.iter().zip(axes).map(square).sum::<f64>().sqrt()
}

impl Interval {
    /// Fits scales and factors to held-out trials, and to what their replays with breaks have left.
    ///
    /// # Errors
    /// Fewer than two trials.
    pub fn fit(
        held_out: &[HeldOut<'_>],
        started: &Started,
        base: Base,
        axes: &[usize],
    ) -> Result<Self, ModelError> {
        let mut trials: Vec<usize> = held_out.iter().map(|h| h.sequence.trial).collect();
        trials.dedup();
        if trials.len() < 2 {
            return Err(ModelError::Data(
                "intervals need at least two training trials: one is held out at a time".to_owned(),
            ));
        }
        let mut row = Vec::new();
        let mut rows = Scores::default();
        for held in held_out {
            walk(held, |k, moment| {
                features(moment, &base, &mut row);
                let unsure_n = held.unsure_n.get(k).copied().unwrap_or(0.0);
                rows.push(&row, held.error(k, axes), unsure_n);
            });
        }
        let few = || ModelError::Data("too few held-out rows for intervals".to_owned());
        let settled = Scaled::fit(FEATURES, &rows).ok_or_else(few)?;
        let mut widths: Vec<f64> = rows.rows().map(|(row, ..)| settled.half_n(row)).collect();
        widths.sort_by(f64::total_cmp);
        let widest_n = quantile(&widths, WIDEST);
        let start =
            Scaled::fit(START_FEATURES, &started.0).map(|scaled| AfterStart { scaled, widest_n });
        Ok(Self {
            settled,
            base,
            axes: axes.to_vec(),
            start,
            fits_to: (held_out.iter().filter_map(|held| held.misfit))
                .reduce(|a, b| core::array::from_fn(|k| a[k].max(b[k])))
                .map(|largest| largest.map(|largest| FITS * largest)),
        })
    }

    /// Whether a model with this misfit fits its robot: up to `FITS` times the largest of trials
    /// that it had not seen, in the mean of the ways' fourth powers. Ways that all rise a little
    /// count as much as one that rises alone, which has to by half.
    #[must_use]
    pub fn fits(&self, misfit: &[f64; TIMES]) -> bool {
        (self.fits_to.as_ref()).is_none_or(|limits| within(misfit, limits))
    }

    /// Half widths of every row of a sequence, N.
    #[must_use]
    pub fn widths(&self, sequence: &Sequence) -> Vec<f64> {
        let mut live = self.live(sequence.step_s);
        (0..sequence.rows())
            .filter_map(|k| live.step(sequence.input_row(k)).half_n)
            .collect()
    }

    /// Half widths on a stream.
    #[must_use]
    pub fn live(&self, step_s: f64) -> Live<'_> {
        Live {
            interval: self,
            motion: Motion::new(step_s),
            row: Vec::new(),
        }
    }

    /// Components of the force that the interval is about.
    #[must_use]
    pub fn axes(&self) -> &[usize] {
        &self.axes
    }
}

/// Half widths on a stream.
#[derive(Debug, Clone)]
pub struct Live<'a> {
    interval: &'a Interval,
    motion: Motion,
    row: Vec<f64>,
}

impl Live<'_> {
    /// Half width for the next row, N, and whether the row is valid.
    pub fn step(&mut self, input: &[f32]) -> Sure {
        let moment = self.motion.step(input);
        let Interval { base, start, .. } = self.interval;
        let settled = moment.settled();
        let (half_n, valid) = match start {
            Some(start) if !settled => {
                start_features(moment, base, &mut self.row);
                let half_n = start.scaled.half_n(&self.row);
                let valid = half_n <= start.widest_n && moment.age_s >= FIRST_S;
                (half_n, valid)
            }
            _ => {
                features(moment, base, &mut self.row);
                (self.interval.settled.half_n(&self.row), settled)
            }
        };
        Sure {
            half_n: Some(half_n),
            valid,
            misfits: false,
        }
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.motion.reset();
    }

    /// The next row comes `elapsed_s` after the one before it.
    pub fn gap(&mut self, elapsed_s: f64) {
        self.motion.gap(elapsed_s);
    }
}

/// See [`Interval::fits`].
fn within(misfit: &[f64; TIMES], limits: &[f64; TIMES]) -> bool {
    let shares = misfit.iter().zip(limits);
    let powers = shares.map(|(m, limit)| (m / limit.max(f64::MIN_POSITIVE)).powi(4));
    powers.sum::<f64>() <= TIMES as f64
}

fn walk(held: &HeldOut<'_>, mut visit: impl FnMut(usize, &Moment)) {
    let mut motion = Motion::new(held.sequence.step_s);
    let settle = settle_rows(held.sequence.step_s).max(held.from);
    for k in 0..held.sequence.rows() {
        let moment = motion.step(held.sequence.input_row(k));
        if k >= settle {
            visit(k, moment);
        }
    }
}

impl Scaled {
    /// Fits a scale to rows of `features` values and their errors, N, and a factor to each class;
    /// `None` with too few rows.
    fn fit(features: usize, scores: &Scores) -> Option<Self> {
        let mut sums = Sums::new(features, 1);
        for (row, error_n, _) in scores.rows() {
            sums.push(row, &[(error_n + FLOOR_N).ln()]);
        }
        let mut scaled = Self {
            scale: sums.solve()?,
            edges: Vec::new(),
            factors: Vec::new(),
        };
        let scored: Vec<(f64, f64)> = scores
            .rows()
            .map(|(row, _, left_n)| {
                let scale = scaled.scale_n(row);
                (scale, left_n / scale)
            })
            .collect();
        let mut scales: Vec<f64> = scored.iter().map(|(scale, _)| *scale).collect();
        scales.sort_by(f64::total_cmp);
        scaled.edges = (1..CLASSES)
            .map(|c| scales[scales.len() * c / CLASSES])
            .collect();
        scaled.factors = (0..CLASSES)
            .map(|c| factor(&scored, |scale| scaled.class(scale) == c))
            .collect();
        Some(scaled)
    }

    fn scale_n(&self, row: &[f64]) -> f64 {
        self.scale.value(0, row).clamp(-6.0, 4.0).exp()
    }

    fn class(&self, scale: f64) -> usize {
        self.edges.partition_point(|edge| *edge <= scale)
    }

    /// Half width, N.
    fn half_n(&self, row: &[f64]) -> f64 {
        let scale = self.scale_n(row);
        scale * self.factors[self.class(scale)]
    }
}

/// Factor that covers [`COVERAGE`] of the rows of held-out trials: scale and error per scale.
fn factor(scored: &[(f64, f64)], within: impl Fn(f64) -> bool) -> f64 {
    let mut scores: Vec<f64> = scored
        .iter()
        .filter(|(scale, _)| within(*scale))
        .map(|(_, score)| *score)
        .collect();
    if scores.is_empty() {
        return 3.0;
    }
    scores.sort_by(f64::total_cmp);
    quantile(&scores, COVERAGE)
}

/// Value below which a share of sorted ones lies; there is one at least.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = (share * sorted.len() as f64) as usize;
    sorted[at.min(sorted.len() - 1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_way_alone_tells_a_misfit_and_so_do_all_together() {
        let limits = [0.5, 1.0, 2.0, 4.0];
        let fits = |shares: [f64; TIMES]| {
            within(&core::array::from_fn(|k| shares[k] * limits[k]), &limits)
        };
        assert!(fits([0.0; TIMES]) && fits([0.99; TIMES]) && !fits([1.01; TIMES]));
        for k in 0..TIMES {
            let alone = |share: f64| core::array::from_fn(|i| if i == k { share } else { 0.7 });
            assert!(fits(alone(1.3)) && !fits(alone(1.4)), "{k}");
            assert!(!fits(alone(f64::NAN)) && !fits(alone(f64::INFINITY)));
        }
        assert!(within(&[0.0; TIMES], &[0.0; TIMES]) && !within(&limits, &[0.0; TIMES]));
    }
}
