//! Calibrated intervals: how wide around an estimate, so that a stated share of unseen trials' rows lies within.
//!
//! The width follows a predicted scale, which is larger in the dead zone: it is fitted to the absolute errors of held-out trials,
//! from what the motion tells (speeds, how far each contact is bent back). The factor on the scale is conformal by trial: the
//! quantile of |error| / scale over the rows of held-out trials, each estimated by a model that has not seen it, separately for six
//! classes of the scale. Rows of a trial are not independent; trials are. So the coverage of one new trial scatters around the
//! stated one by as much as the trials differ.

use crate::geometry::Base;
use crate::model::ModelError;
use crate::motion::{Moment, Motion, LEVELS};
use crate::physics::settle_rows;
use crate::ridge::{Ridge, Sums};
use crate::sequence::Sequence;
use serde::{Deserialize, Serialize};

/// Added to absolute errors before the logarithm, N: the noise of the label.
const FLOOR_N: f64 = 0.02;
/// Classes of the predicted scale, each with its own factor.
const CLASSES: usize = 6;
/// Share that is covered.
pub const COVERAGE: f64 = 0.90;

/// Predicted scale and conformal factors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    scale: Ridge,
    /// Upper ends of the classes of scale but the last, N.
    edges: Vec<f64>,
    /// Half width per scale, by class.
    factors: Vec<f64>,
    base: Base,
    axes: Vec<usize>,
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

/// Errors of a held-out trial.
#[derive(Debug, Clone)]
pub struct HeldOut<'a> {
    /// Rows.
    pub sequence: &'a Sequence,
    /// Estimates of a model that has not seen this trial: `rows * axes` values.
    pub predicted: Vec<f32>,
}

impl HeldOut<'_> {
    fn error(&self, k: usize, axes: &[usize]) -> f64 {
        let square = |(a, axis): (usize, &usize)| {
            let error = f64::from(self.predicted[k * axes.len() + a])
                - f64::from(self.sequence.target_row(k)[*axis]);
            error * error
        };
        axes.iter().enumerate().map(square).sum::<f64>().sqrt()
    }
}

impl Interval {
    /// Fits scale and factors to held-out trials.
    ///
    /// # Errors
    /// Fewer than two trials.
    pub fn fit(held_out: &[HeldOut<'_>], base: Base, axes: &[usize]) -> Result<Self, ModelError> {
        let mut trials: Vec<usize> = held_out.iter().map(|h| h.sequence.trial).collect();
        trials.dedup();
        if trials.len() < 2 {
            return Err(ModelError::Data(
                "intervals need at least two training trials: one is held out at a time".to_owned(),
            ));
        }
        let mut sums = Sums::new(FEATURES, 1);
        let mut row = Vec::new();
        for held in held_out {
            walk(held, |k, moment| {
                features(moment, &base, &mut row);
                sums.push(&row, &[(held.error(k, axes) + FLOOR_N).ln()]);
            });
        }
        let scale = sums
            .solve()
            .ok_or_else(|| ModelError::Data("too few held-out rows for intervals".to_owned()))?;
        let mut interval = Self {
            scale,
            edges: Vec::new(),
            factors: Vec::new(),
            base,
            axes: axes.to_vec(),
        };
        let mut scored: Vec<(usize, f64, f64)> = Vec::new();
        for held in held_out {
            walk(held, |k, moment| {
                let scale = interval.scale_n(moment, &mut row);
                scored.push((held.sequence.trial, scale, held.error(k, axes) / scale));
            });
        }
        let mut scales: Vec<f64> = scored.iter().map(|(_, scale, _)| *scale).collect();
        scales.sort_by(f64::total_cmp);
        interval.edges = (1..CLASSES)
            .map(|c| scales[scales.len() * c / CLASSES])
            .collect();
        interval.factors = (0..CLASSES)
            .map(|c| factor(&scored, |scale| interval.class(scale) == c))
            .collect();
        Ok(interval)
    }

    fn scale_n(&self, moment: &Moment, row: &mut Vec<f64>) -> f64 {
        features(moment, &self.base, row);
        self.scale.value(0, row).clamp(-6.0, 4.0).exp()
    }

    fn class(&self, scale: f64) -> usize {
        self.edges.partition_point(|edge| *edge <= scale)
    }

    /// Half widths of every row of a sequence, N.
    #[must_use]
    pub fn widths(&self, sequence: &Sequence) -> Vec<f64> {
        let mut live = self.live(sequence.step_s);
        (0..sequence.rows())
            .map(|k| live.step(sequence.input_row(k)))
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
    /// Half width for the next row, N.
    pub fn step(&mut self, input: &[f32]) -> f64 {
        let moment = self.motion.step(input);
        let scale = self.interval.scale_n(moment, &mut self.row);
        scale * self.interval.factors[self.interval.class(scale)]
    }
}

fn walk(held: &HeldOut<'_>, mut visit: impl FnMut(usize, &Moment)) {
    let mut motion = Motion::new(held.sequence.step_s);
    let settle = settle_rows(held.sequence.step_s);
    for k in 0..held.sequence.rows() {
        let moment = motion.step(held.sequence.input_row(k));
        if k >= settle {
            visit(k, moment);
        }
    }
}

/// Factor that covers [`COVERAGE`] of the rows of held-out trials.
fn factor(scored: &[(usize, f64, f64)], within: impl Fn(f64) -> bool) -> f64 {
    let mut scores: Vec<f64> = scored
        .iter()
        .filter(|(_, scale, _)| within(*scale))
        .map(|(_, _, score)| *score)
        .collect();
    if scores.is_empty() {
        return 3.0;
    }
    scores.sort_by(f64::total_cmp);
    let at = (COVERAGE * scores.len() as f64) as usize;
    scores[at.min(scores.len() - 1)]
}
