//! Exit point of one unit from the change of its cable's length.

use super::{check, extent_mm, Prior, Sample, SelfCalibrationError};
use crate::stats;
use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen, Vector3};

/// An exit point from a run.
#[derive(Debug, Clone, PartialEq)]
pub struct ExitEstimate {
    /// Exit point, base frame, m.
    pub exit_m: Vector3<f64>,
    /// Its covariance, m^2.
    pub covariance_m2: Matrix3<f64>,
    /// Cable length at zero travel, m.
    pub length_m: f64,
    /// Relative error of the travel's scale.
    pub scale: f64,
    /// Stretch, m/N.
    pub compliance_m_per_n: f64,
    /// Chi-square of the lengths.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Directions of the exit point, best known first.
    pub directions: [Direction; 3],
    /// Singular values of the Jacobian of all unknowns, whitened, priors left out, largest first. A
    /// value of 0 is a combination that the run alone says nothing about.
    pub singular_values: Vec<f64>,
}

impl ExitEstimate {
    /// Directions that the run does not tell well enough ([`Prior::observable_sd_m`]).
    #[must_use]
    pub fn unobserved(&self) -> Vec<Direction> {
        self.directions
            .iter()
            .copied()
            .filter(|d| !d.observed)
            .collect()
    }

    /// p-value of the lengths' chi-square.
    #[must_use]
    pub fn p(&self) -> f64 {
        stats::chi_square_survival(self.chi_square, self.degrees_of_freedom)
    }
}

/// A direction in space and how well the exit point is known along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Unit vector, base frame.
    pub direction: Vector3<f64>,
    /// Standard deviation along it, m.
    pub sd_m: f64,
    /// Whether that is good enough.
    pub observed: bool,
}

/// Unknowns: exit x, y, z, length, scale, compliance.
pub(super) const UNKNOWNS: usize = 6;

/// Exit point of one unit from a run. `start_m` is a rough position (m), as from a digitizer or a
/// tape measure; without one the lengths are solved linearly first.
///
/// # Errors
/// [`SelfCalibrationError`].
pub fn exit_point(
    samples: &[Sample],
    prior: &Prior,
    start_m: Option<Vector3<f64>>,
) -> Result<ExitEstimate, SelfCalibrationError> {
    check(samples, prior)?;
    let tip_mean = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / samples.len() as f64;
    let extent_mm = extent_mm(samples, &tip_mean);
    let not_observable = SelfCalibrationError::NotObservable { extent_mm };
    let start = start_m
        .or_else(|| linear_start(samples))
        .ok_or_else(|| not_observable.clone())?;
    let sd = (prior.travel_sd_m.powi(2) + prior.tip_sd_m.powi(2)).sqrt();
    let mut x = DVector::zeros(UNKNOWNS);
    x.fixed_rows_mut::<3>(0).copy_from(&start);
    x[5] = prior.compliance_m_per_n;
    x[3] = samples
        .iter()
        .map(|s| (start - s.tip_m).norm() - s.travel_m)
        .sum::<f64>()
        / samples.len() as f64;
    let model = Model { samples, prior, sd };
    let mut cost = model.cost(&x);
    let mut damping = 1e-9;
    let mut done = false;
    for _ in 0..200 {
        let (jacobian, residual) = model.linearise(&x);
        let normal = jacobian.transpose() * &jacobian;
        let gradient = jacobian.transpose() * residual;
        let mut damped = normal.clone();
        for i in 0..UNKNOWNS {
            damped[(i, i)] *= 1.0 + damping;
        }
        let Some(factor) = damped.cholesky() else {
            damping = f64::max(damping * 10.0, 1e-9);
            if damping > 1e12 {
                return Err(not_observable);
            }
            continue;
        };
        let step = -factor.solve(&gradient);
        let next = &x + &step;
        let next_cost = model.cost(&next);
        if next_cost <= cost {
            // A millionth of chi-square is far below what any statement rests on; a direction that
            // is not observed would creep on for ever.
            let small = step.rows(0, 4).amax() < 1e-9 || cost - next_cost < 1e-6;
            x = next;
            cost = next_cost;
            damping *= 0.1;
            if small {
                done = true;
                break;
            }
        } else {
            damping = f64::max(damping * 10.0, 1e-9);
            if damping > 1e12 {
                done = true;
                break;
            }
        }
    }
    if !x.iter().all(|v| v.is_finite()) {
        return Err(SelfCalibrationError::NoConvergence);
    }
    let (jacobian, _) = model.linearise(&x);
    let covariance = (jacobian.transpose() * &jacobian)
        .try_inverse()
        .ok_or_else(|| not_observable.clone())?;
    let covariance_m2: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
    if !covariance_m2.iter().all(|v| v.is_finite()) {
        return Err(not_observable);
    }
    if !done {
        // A fit that goes on and on: along a direction that the run says nothing about, or because
        // it is wrong.
        let worst = covariance_m2.symmetric_eigenvalues().max();
        return Err(if worst > prior.observable_sd_m.powi(2) {
            not_observable
        } else {
            SelfCalibrationError::NoConvergence
        });
    }
    let eigen = SymmetricEigen::new(covariance_m2);
    let mut directions = [0, 1, 2].map(|i| {
        let sd_m = eigen.eigenvalues[i].max(0.0).sqrt();
        Direction {
            direction: eigen.eigenvectors.column(i).into_owned(),
            sd_m,
            observed: sd_m <= prior.observable_sd_m,
        }
    });
    directions.sort_by(|a, b| a.sd_m.total_cmp(&b.sd_m));
    let data = jacobian.rows(0, samples.len()).into_owned();
    let mut singular_values: Vec<f64> = data.singular_values().iter().copied().collect();
    singular_values.sort_by(|a, b| b.total_cmp(a));
    Ok(ExitEstimate {
        exit_m: x.fixed_rows::<3>(0).into_owned(),
        covariance_m2,
        length_m: x[3],
        scale: x[4],
        compliance_m_per_n: x[5],
        chi_square: cost,
        // Scale and compliance take one each and their priors give one each.
        degrees_of_freedom: samples.len() - 4,
        directions,
        singular_values,
    })
}

/// Lengths and priors as a least-squares problem in [`UNKNOWNS`] unknowns.
pub(super) struct Model<'s> {
    pub samples: &'s [Sample],
    pub prior: &'s Prior,
    /// Standard deviation of a length, m.
    pub sd: f64,
}

impl Model<'_> {
    pub fn residual(&self, x: &DVector<f64>, s: &Sample) -> f64 {
        let exit = Vector3::new(x[0], x[1], x[2]);
        ((exit - s.tip_m).norm() - x[3] - (1.0 + x[4]) * s.travel_m - x[5] * s.tension_n) / self.sd
    }

    /// Scale and compliance against what is known of them, in standard deviations; a standard
    /// deviation of 0 holds them (1e-12 of one: far below what a run can tell).
    fn beliefs(&self, x: &DVector<f64>) -> [(f64, f64); 2] {
        let weight = |sd: f64, unit: f64| 1.0 / if sd > 0.0 { sd } else { 1e-9 * unit };
        let scale = weight(self.prior.scale_sd, 1.0);
        let compliance = weight(self.prior.compliance_sd_m_per_n, 1e-3);
        [
            (x[4] * scale, scale),
            (
                (x[5] - self.prior.compliance_m_per_n) * compliance,
                compliance,
            ),
        ]
    }

    fn cost(&self, x: &DVector<f64>) -> f64 {
        let data: f64 = self
            .samples
            .iter()
            .map(|s| self.residual(x, s).powi(2))
            .sum();
        data + self.beliefs(x).iter().map(|b| b.0 * b.0).sum::<f64>()
    }

    pub fn linearise(&self, x: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.samples.len();
        let mut jacobian = DMatrix::zeros(n + 2, UNKNOWNS);
        let mut residual = DVector::zeros(n + 2);
        let exit = Vector3::new(x[0], x[1], x[2]);
        for (k, s) in self.samples.iter().enumerate() {
            let span = exit - s.tip_m;
            // A tip in the exit point has no direction; any will do for one step.
            let direction = span.try_normalize(1e-9).unwrap_or_else(Vector3::x) / self.sd;
            for i in 0..3 {
                jacobian[(k, i)] = direction[i];
            }
            jacobian[(k, 3)] = -1.0 / self.sd;
            jacobian[(k, 4)] = -s.travel_m / self.sd;
            jacobian[(k, 5)] = -s.tension_n / self.sd;
            residual[k] = self.residual(x, s);
        }
        for (i, (value, weight)) in self.beliefs(x).into_iter().enumerate() {
            jacobian[(n + i, 4 + i)] = weight;
            residual[n + i] = value;
        }
        (jacobian, residual)
    }
}

/// Exit point by squaring the lengths: linear in `x`, `length_0` and `|x|^2 - length_0^2`.
fn linear_start(samples: &[Sample]) -> Option<Vector3<f64>> {
    let mean = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / samples.len() as f64;
    let travel = samples.iter().map(|s| s.travel_m).sum::<f64>() / samples.len() as f64;
    let rows = samples.len();
    let matrix = DMatrix::from_fn(rows, 5, |k, i| {
        let s = &samples[k];
        match i {
            0..=2 => 2.0 * (s.tip_m[i] - mean[i]),
            3 => 2.0 * (s.travel_m - travel),
            _ => -1.0,
        }
    });
    let right = DVector::from_fn(rows, |k, _| {
        let s = &samples[k];
        (s.tip_m - mean).norm_squared() - (s.travel_m - travel).powi(2)
    });
    let solution = matrix.svd(true, true).solve(&right, 1e-9).ok()?;
    let found = Vector3::new(solution[0], solution[1], solution[2]) + mean;
    found.iter().all(|v| v.is_finite()).then_some(found)
}
