//! Creep of a cell from the time course of a series: weights that are put on, left for a while, and taken off.
//!
//! A cell that creeps reads `F + s` under a load `F`, with `ds/dt = (share F - s) / tau`. For a series of loads that is
//! `s = share G(tau)`, where `G` follows from the loads and their times alone: linear in the share, so that only the time
//! constant has to be searched. Hysteresis looks alike where each load is read once; a load that is read while it stays
//! tells them apart, so creep is looked for only in a series with such a hold.

use super::{design, force_n, Model, Options, Reading, Term};
use nalgebra::{DMatrix, DVector};

/// Readings of one load in a row that make a hold.
const HOLD: usize = 5;
/// Time constants looked at, from the shortest to the longest.
const STEPS: usize = 30;
/// Shortest time constant, s: below it, a cell has crept before it is read.
const SHORTEST_S: f64 = 0.5;
/// Chance levels by which the search over time constants multiplies a p-value: about the number of different shapes in it.
pub(super) const SEARCHED: f64 = 8.0;

/// How a cell creeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CreepTerm {
    /// Share of a lasting load by which the reading grows.
    pub share: f64,
    /// Its standard error.
    pub share_se: f64,
    /// Time constant, s.
    pub time_s: f64,
    /// 95 % interval of it, s.
    pub time_95_s: (f64, f64),
}

/// Whether these readings can tell creep: times, and a load that was read while it stayed.
pub(super) fn can_tell(used: &[Reading]) -> bool {
    let timed = used
        .windows(2)
        .all(|pair| match (pair[0].time_s, pair[1].time_s) {
            (Some(a), Some(b)) => b > a,
            _ => false,
        });
    let held = used
        .windows(HOLD)
        .any(|run| run[0].weight_g > 0.0 && run.iter().all(|r| r.weight_g == run[0].weight_g));
    timed && held
}

/// `G(tau)` of each reading, N: the creep of a cell whose share is 1. The cell starts relaxed at the first reading.
pub(super) fn course(used: &[Reading], options: &Options, tau_s: f64) -> Vec<f64> {
    let mut crept = 0.0;
    let mut at = used.first().and_then(|r| r.time_s).unwrap_or(0.0);
    let mut load = used.first().map_or(0.0, |r| force_n(r.weight_g, options));
    let mut out = Vec::with_capacity(used.len());
    for reading in used {
        let time = reading.time_s.unwrap_or(at);
        let next = force_n(reading.weight_g, options);
        if next != load {
            // Where nothing else is known, the weight was changed half way between two readings.
            let change = reading.since_s.unwrap_or(0.5 * (at + time));
            let change = change.clamp(at, time.max(at));
            crept = passed(crept, load, (change - at) / tau_s);
            (at, load) = (change, next);
        }
        crept = passed(crept, load, (time - at).max(0.0) / tau_s);
        at = at.max(time);
        out.push(crept);
    }
    out
}

/// What has crept after so many time constants under a load, N.
fn passed(crept: f64, load: f64, time_constants: f64) -> f64 {
    crept - (load - crept) * (-time_constants).exp_m1()
}

/// Derivative of [`course`] by the logarithm of the time constant, N.
pub(super) fn course_by_log_tau(used: &[Reading], options: &Options, tau_s: f64) -> Vec<f64> {
    const STEP: f64 = 1e-3;
    let above = course(used, options, tau_s * STEP.exp());
    let below = course(used, options, tau_s * (-STEP).exp());
    let pairs = above.iter().zip(&below);
    pairs.map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
}

/// The time constant, s, with which a model with creep leaves least.
///
/// `inverse` is the inverse covariance of the codes. `None` where no time constant gives a fit.
pub(super) fn search(
    used: &[Reading],
    options: &Options,
    model: &Model,
    inverse: &DMatrix<f64>,
) -> Option<f64> {
    let first = used.first()?.time_s?;
    let span = used.last()?.time_s? - first;
    let y = DVector::from_iterator(used.len(), used.iter().map(|r| r.code));
    let longest = (2.0 * span).max(2.0 * SHORTEST_S);
    let at = |i: f64| SHORTEST_S * (longest / SHORTEST_S).powf(i / (STEPS - 1) as f64);
    let cost = |i: f64| {
        let model = Model {
            tau_s: at(i),
            ..model.clone()
        };
        let x = design(used, options, &model);
        left(&x, &y, inverse).unwrap_or(f64::INFINITY)
    };
    let costs: Vec<f64> = (0..STEPS).map(|i| cost(i as f64)).collect();
    let best = (0..STEPS).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
    if !costs[best].is_finite() {
        return None;
    }
    // Golden section between the neighbours.
    let mut low = best.saturating_sub(1) as f64;
    let mut high = (best + 1).min(STEPS - 1) as f64;
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..16 {
        let (c, d) = (high - ratio * (high - low), low + ratio * (high - low));
        if cost(c) < cost(d) {
            high = d;
        } else {
            low = c;
        }
    }
    Some(at(0.5 * (low + high)))
}

/// The share of the creep with the model's time constant. A curve bends what has crept as well, so that its column depends on
/// the share: each round takes the error of it down by the bend of the cell.
pub(super) fn share(
    used: &[Reading],
    options: &Options,
    model: &Model,
    inverse: &DMatrix<f64>,
) -> Option<f64> {
    const ROUNDS: usize = 12;
    let at = 2 + model.terms.iter().position(|t| *t == Term::Creep)?;
    let y = DVector::from_iterator(used.len(), used.iter().map(|r| r.code));
    let mut model = model.clone();
    for _ in 0..ROUNDS {
        let beta = coefficients(&design(used, options, &model), &y, inverse)?;
        model.share = beta[at] / beta[1];
        if !model.has(Term::Quadratic) {
            break;
        }
    }
    Some(model.share)
}

fn coefficients(
    x: &DMatrix<f64>,
    y: &DVector<f64>,
    inverse: &DMatrix<f64>,
) -> Option<DVector<f64>> {
    let xtw = x.transpose() * inverse;
    Some((&xtw * x).cholesky()?.solve(&(&xtw * y)))
}

/// Sum of squares that a fit leaves, in units of the codes' covariance.
fn left(x: &DMatrix<f64>, y: &DVector<f64>, inverse: &DMatrix<f64>) -> Option<f64> {
    let residuals = y - x * coefficients(x, y, inverse)?;
    Some((residuals.transpose() * inverse * &residuals)[0])
}
