//! The creep's time constant and share: the model of [`super::creep`] with the least left over in a
//! fit.

use super::least_squares::{design, Model, Solution};
use super::{Options, Reading, Term};
use nalgebra::{DMatrix, DVector};

/// Time constants looked at, from the shortest to the longest.
const STEPS: usize = 30;
/// Shortest time constant, s: below it, a cell has crept before it is read.
const SHORTEST_S: f64 = 0.5;
/// Chance levels by which the search over time constants multiplies a p-value: about the number of
/// different shapes in it.
pub(super) const SEARCHED: f64 = 8.0;

/// Chance level at which creep stays once its time constant is free: the usual one, as it was found
/// at a stricter one before.
const STAYS: f64 = 0.05;

/// Whether the share of the creep differs from 0 in a fit with a free time constant.
pub(super) fn is_significant(model: &Model, solution: &Solution) -> bool {
    let at = model.terms.iter().position(|term| *term == Term::Creep);
    at.is_some_and(|at| solution.coefficient(2 + at).p < STAYS)
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

/// The share of the creep with the model's time constant. A curve bends what has crept as well, so
/// that its column depends on the share: each round takes the error of it down by the bend of the
/// cell.
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
