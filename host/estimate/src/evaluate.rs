//! Figures of a model on trials that it has not seen.

use estimator::estimator::Estimator;
use estimator::metrics::{
    self, by_bin, compare, speed_bin, speed_edges, Figures, Rows, StepTime, SPEED_BINS,
};
use estimator::model::ModelError;
use estimator::sequence::Sequence;
use serde::{Deserialize, Serialize};

/// Rows of one trial on which the time of a step is measured.
const TIMED_ROWS: usize = 20_000;

/// One bin of speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpeedBin {
    /// Speeds of the tip below this, m/s; the last bin is open.
    pub below_m_per_s: f64,
    /// Mean absolute error, N.
    pub mae_n: f64,
    /// Rows.
    pub rows: usize,
    /// Share of the rows within the interval, where there is one.
    pub covered: Option<f64>,
    /// Mean half width of the interval, N.
    pub half_width_n: Option<f64>,
}

/// Figures of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Trials.
    pub trials: Vec<usize>,
    /// Errors.
    pub figures: Figures,
    /// By speed of the tip.
    pub by_speed: Vec<SpeedBin>,
    /// Mean absolute error while a motor turns round, N.
    pub mae_reversing_n: f64,
    /// Mean absolute error otherwise, N.
    pub mae_sliding_n: f64,
    /// Share of the rows within the interval, where there is one.
    pub covered: Option<f64>,
    /// The same for each trial.
    pub covered_by_trial: Vec<f64>,
    /// Time of a step on the machine that wrote this.
    pub step: StepTime,
}

/// Evaluates on sequences. The first 10 s of each are left out.
///
/// # Errors
/// [`ModelError::Data`]: no sequence is longer than that.
pub fn evaluate(
    estimator: &Estimator,
    sequences: &[&Sequence],
) -> Result<(Evaluation, Vec<Rows>), ModelError> {
    let trials = compare(
        estimator.model(),
        &estimator.base,
        &estimator.axes,
        sequences,
    );
    let (Some(longest), false) = (sequences.iter().max_by_key(|s| s.rows()), trials.is_empty())
    else {
        return Err(ModelError::Data(format!(
            "no row is left to test on: the first {} s of each unbroken stretch are left out, because no model with a memory knows its state there; give longer stretches",
            estimator::physics::SETTLE_S
        )));
    };
    let widths = estimator
        .interval
        .as_ref()
        .map(|interval| widths(interval, sequences));
    let edges = speed_edges(&trials);
    let bin = |rows: &Rows, k: usize| speed_bin(&edges, rows.speed[k]);
    let errors = by_bin(&trials, SPEED_BINS, bin);
    let within = |t: usize, k: usize| {
        widths
            .as_ref()
            .is_some_and(|w| trials[t].error[k].abs() <= w[t][k])
    };
    let mut inside = [(0_usize, 0.0_f64); SPEED_BINS];
    let mut covered_by_trial = Vec::new();
    for (t, rows) in trials.iter().enumerate() {
        let mut covered = 0_usize;
        for k in 0..rows.error.len() {
            let (count, width) = &mut inside[bin(rows, k)];
            if within(t, k) {
                *count += 1;
                covered += 1;
            }
            *width += widths.as_ref().map_or(0.0, |w| w[t][k]);
        }
        covered_by_trial.push(covered as f64 / rows.error.len().max(1) as f64);
    }
    let figures = metrics::figures(&trials);
    let by_speed =
        errors
            .iter()
            .zip(edges)
            .zip(inside)
            .map(|(((mae_n, rows), edge), (covered, width))| SpeedBin {
                below_m_per_s: edge,
                mae_n: *mae_n,
                rows: *rows,
                covered: widths
                    .as_ref()
                    .map(|_| covered as f64 / (*rows).max(1) as f64),
                half_width_n: widths.as_ref().map(|_| width / (*rows).max(1) as f64),
            });
    let reversal = by_bin(&trials, 2, |rows, k| usize::from(rows.reversing[k]));
    let step = metrics::step_time(estimator.model(), longest, estimator.axes.len(), TIMED_ROWS);
    let evaluation = Evaluation {
        trials: trials.iter().map(|t| t.trial).collect(),
        by_speed: by_speed.collect(),
        mae_reversing_n: reversal[1].0,
        mae_sliding_n: reversal[0].0,
        covered: widths.as_ref().map(|_| {
            inside.iter().map(|(n, _)| n).sum::<usize>() as f64 / figures.rows.max(1) as f64
        }),
        covered_by_trial: if widths.is_some() {
            covered_by_trial
        } else {
            Vec::new()
        },
        figures,
        step,
    };
    Ok((evaluation, trials))
}

/// Half widths of the rows that [`compare`] keeps, by trial.
fn widths(interval: &estimator::interval::Interval, sequences: &[&Sequence]) -> Vec<Vec<f64>> {
    let mut out: Vec<(usize, Vec<f64>)> = Vec::new();
    for sequence in sequences {
        let settle = estimator::physics::settle_rows(sequence.step_s).min(sequence.rows());
        let kept = interval.widths(sequence).split_off(settle);
        match out.last_mut() {
            Some((trial, all)) if *trial == sequence.trial => all.extend(kept),
            _ => out.push((sequence.trial, kept)),
        }
    }
    out.into_iter()
        .map(|(_, widths)| widths)
        .filter(|widths| !widths.is_empty())
        .collect()
}
