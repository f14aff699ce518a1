//! Generalised least squares of a cell's model: columns, covariances, coefficients.

use super::reading::different_weights;
use super::{creep, Coefficient, GainError, Options, Reading, Term};
use crate::stats;
use nalgebra::{DMatrix, DVector};

/// The terms of a fit beside zero and slope, and what they depend on that is not linear.
#[derive(Debug, Clone, Default)]
pub(super) struct Model {
    pub(super) terms: Vec<Term>,
    /// Time constant of the creep, s.
    pub(super) tau_s: f64,
    /// Whether the fit has a column for an error of that, so that the covariances allow for it.
    pub(super) tau_free: bool,
    /// Share of the creep, as far as it is known: the curve bends what has crept as well.
    pub(super) share: f64,
}

impl Model {
    /// Zero and slope, and those of further mountings.
    pub(super) fn of(used: &[Reading]) -> Self {
        let further = [1, 2].into_iter();
        let there = further.filter(|k| used.iter().any(|r| r.mounting() == *k));
        Self {
            terms: there
                .flat_map(|k| [Term::MountingZero(k), Term::MountingSlope(k)])
                .collect(),
            ..Self::default()
        }
    }

    pub(super) fn has(&self, term: Term) -> bool {
        self.terms.contains(&term)
    }

    /// Coefficients of the fit.
    pub(super) fn columns(&self) -> usize {
        2 + self.terms.len() + usize::from(self.tau_free)
    }
}

/// One generalised least-squares fit. Columns: zero, slope, then the terms.
pub(super) struct Solution {
    pub(super) beta: DVector<f64>,
    pub(super) covariance: DMatrix<f64>,
    /// Part of `covariance` that comes from the readings, not from the weights.
    pub(super) from_readings: DMatrix<f64>,
    /// Standard deviation of each coefficient by an error that all weights share, with its sign:
    /// each weight is off by one standard uncertainty of its own.
    pub(super) from_shared_weights: DVector<f64>,
    pub(super) residuals: DVector<f64>,
    pub(super) repeatability: f64,
    pub(super) chi_square: f64,
    pub(super) dof: usize,
}

impl Solution {
    /// Degrees of freedom of coefficient `i`: infinite as far as it comes from the weights, whose
    /// tolerance is given (Welch and Satterthwaite, GUM G.4).
    pub(super) fn effective_dof(&self, i: usize) -> f64 {
        let (all, own) = (self.covariance[(i, i)], self.from_readings[(i, i)]);
        self.dof as f64 * (all / own).powi(2)
    }

    pub(super) fn coefficient(&self, i: usize) -> Coefficient {
        let standard_error = self.covariance[(i, i)].sqrt();
        Coefficient {
            value: self.beta[i],
            standard_error,
            p: stats::student_two_sided(self.beta[i] / standard_error, self.effective_dof(i)),
        }
    }
}

pub(super) fn mean_temperature(used: &[Reading]) -> Option<f64> {
    let values: Option<Vec<f64>> = used.iter().map(|r| r.temperature_c).collect();
    values.map(|v| v.iter().sum::<f64>() / v.len() as f64)
}

pub(super) fn design(used: &[Reading], options: &Options, model: &Model) -> DMatrix<f64> {
    let reference = mean_temperature(used).unwrap_or(0.0);
    let start = used.first().and_then(|r| r.time_s).unwrap_or(0.0);
    let crept = if model.has(Term::Creep) {
        creep::course(used, options, model.tau_s)
    } else {
        vec![0.0; used.len()]
    };
    let by_log_tau = if model.tau_free {
        creep::course_by_log_tau(used, options, model.tau_s)
    } else {
        Vec::new()
    };
    DMatrix::from_fn(used.len(), model.columns(), |row, column| {
        if column == 2 + model.terms.len() {
            return by_log_tau[row];
        }
        let r = &used[row];
        let force = options.force_n(r.weight_g);
        let warmer = r.temperature_c.map_or(0.0, |t| t - reference);
        match column {
            0 => 1.0,
            1 => force,
            _ => match model.terms[column - 2] {
                Term::Quadratic => (force + model.share * crept[row]).powi(2),
                Term::ZeroTemperature => warmer,
                Term::SlopeTemperature => warmer * force,
                Term::ZeroTime => r.time_s.unwrap_or(start) - start,
                Term::Creep => crept[row],
                Term::MountingZero(k) => f64::from(u8::from(r.mounting() == k)),
                Term::MountingSlope(k) if r.mounting() == k => force,
                // The slope is the mean of all mountings.
                Term::MountingSlope(_) if r.mounting() == 0 => -force,
                Term::MountingSlope(_) => 0.0,
            },
        }
    })
}

pub(super) fn solve(
    used: &[Reading],
    options: &Options,
    model: &Model,
) -> Result<Solution, GainError> {
    let n = used.len();
    let x = design(used, options, model);
    let too_few = || GainError::TooFew {
        readings: n,
        weights: different_weights(used),
    };
    if n <= x.ncols() {
        return Err(too_few());
    }
    let y = DVector::from_iterator(n, used.iter().map(|r| r.code));
    // The weights' errors in codes need the slope; a slope without them is right to far better than
    // needed.
    let mut slope = {
        let weights =
            DVector::from_iterator(n, used.iter().map(|r| r.standard_error_codes.powi(-2)));
        let xtw = x.transpose() * DMatrix::from_diagonal(&weights);
        let beta = (&xtw * &x)
            .cholesky()
            .ok_or_else(too_few)?
            .solve(&(&xtw * &y));
        beta[1]
    };
    let dof = n - x.ncols();
    let mut last = None;
    for _ in 0..2 {
        let from_weights = weight_covariance(used, options, slope);
        let without = own_covariance(used, options, model, slope, 0.0);
        let at = |repeatability: f64| gls(&x, &y, &without, &from_weights, repeatability);
        let own = at(0.0).ok_or_else(too_few)?;
        let chi_square = own.chi_square;
        let mut solution = own;
        if chi_square > dof as f64 {
            // Paule and Mandel: the repeatability at which chi-square is what it should be.
            let too_small = |repeatability: f64| {
                chi_square_of(&x, &y, &without, &from_weights, repeatability)
                    .is_some_and(|found| found > dof as f64)
            };
            let (mut low, mut high) = (0.0, 1.0);
            while too_small(high) && high < 1e9 {
                (low, high) = (high, 4.0 * high);
            }
            while high - low > REPEATABILITY_STEP * high {
                let middle = 0.5 * (low + high);
                if too_small(middle) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            solution = at(high).ok_or_else(too_few)?;
        }
        solution.chi_square = chi_square;
        slope = solution.beta[1];
        last = Some(solution);
    }
    last.ok_or_else(too_few)
}

/// Covariance of the codes from the errors of the weights, codes^2.
pub(super) fn weight_covariance(
    used: &[Reading],
    options: &Options,
    codes_per_n: f64,
) -> DMatrix<f64> {
    DMatrix::from_fn(used.len(), used.len(), |i, j| {
        if used[i].weight_g == used[j].weight_g {
            (codes_per_n * options.weight_sd_n(used[i].weight_g)).powi(2)
        } else {
            0.0
        }
    })
}

/// Covariance of the codes from the readings' own errors, those of their times included, codes^2.
pub(super) fn own_covariance(
    used: &[Reading],
    options: &Options,
    model: &Model,
    codes_per_n: f64,
    repeatability: f64,
) -> DMatrix<f64> {
    let variances = used
        .iter()
        .map(|r| r.standard_error_codes.powi(2) + repeatability * repeatability);
    let own = DMatrix::from_diagonal(&DVector::from_iterator(used.len(), variances));
    if model.has(Term::Creep) {
        own + creep::time_covariance(used, options, (model.share, model.tau_s), codes_per_n)
    } else {
        own
    }
}

/// How well the repeatability is found, relative: far below its own uncertainty.
const REPEATABILITY_STEP: f64 = 1e-6;

/// Chi-square of a fit with a repeatability, without the rest of the solution.
fn chi_square_of(
    x: &DMatrix<f64>,
    y: &DVector<f64>,
    own: &DMatrix<f64>,
    from_weights: &DMatrix<f64>,
    repeatability: f64,
) -> Option<f64> {
    let mut covariance = own + from_weights;
    for i in 0..y.len() {
        covariance[(i, i)] += repeatability * repeatability;
    }
    let root = covariance.cholesky()?.unpack();
    let (x, y) = (
        root.solve_lower_triangular(x)?,
        root.solve_lower_triangular(y)?,
    );
    let beta = (x.tr_mul(&x)).cholesky()?.solve(&x.tr_mul(&y));
    Some((y - x * beta).norm_squared())
}

fn gls(
    x: &DMatrix<f64>,
    y: &DVector<f64>,
    own: &DMatrix<f64>,
    from_weights: &DMatrix<f64>,
    repeatability: f64,
) -> Option<Solution> {
    let n = y.len();
    let own = own + DMatrix::from_diagonal_element(n, n, repeatability * repeatability);
    let inverse = (&own + from_weights).cholesky()?.inverse();
    let xtw = x.transpose() * &inverse;
    let covariance = (&xtw * x).cholesky()?.inverse();
    let estimator = &covariance * &xtw;
    let beta = &estimator * y;
    let residuals = y - x * &beta;
    let chi_square = (residuals.transpose() * &inverse * &residuals)[0];
    Some(Solution {
        beta,
        from_readings: &estimator * own * estimator.transpose(),
        from_shared_weights: &estimator * from_weights.diagonal().map(f64::sqrt),
        covariance,
        residuals,
        repeatability,
        chi_square,
        dof: n - x.ncols(),
    })
}
