//! Gain and axis of one load cell from tensions that are known independently of it.

use super::{check, extent_mm, Prior, Sample, SelfCalibrationError};
use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen, Vector3};

/// A load cell's gain and axis from a run.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisEstimate {
    /// Axis, unit vector from the unit to the workspace, base frame.
    pub axis: Vector3<f64>,
    /// Its covariance, rad^2.
    pub covariance: Matrix3<f64>,
    /// Cell reading over the force along the axis: 1 where the gain is right.
    pub gain: f64,
    /// Standard deviation of the gain.
    pub gain_sd: f64,
    /// Standard deviation of the axis in its worst direction, rad.
    pub worst_sd_rad: f64,
    /// Whether that is below the limit given.
    pub observed: bool,
    /// Singular values of the whitened Jacobian, largest first.
    pub singular_values: [f64; 3],
}

/// Gain and axis of a load cell from its readings (`cell_n`, N, zero taken off), tensions known
/// independently of the cell and the exit point (m).
///
/// `sd_n` is the standard deviation of one cell reading less the projected tension, N, errors of
/// the tension included; `observable_sd_rad` the limit for [`AxisEstimate::observed`]. The error of
/// the exit point is not in the covariance: 1 mm at 0.4 m of cable turns the axis by 0.14 degrees.
///
/// # Errors
/// [`SelfCalibrationError`]; a tip that sees the unit from one direction only gives
/// [`SelfCalibrationError::NotObservable`].
pub fn axis(
    samples: &[Sample],
    cell_n: &[f64],
    exit_m: &Vector3<f64>,
    sd_n: f64,
    observable_sd_rad: f64,
) -> Result<AxisEstimate, SelfCalibrationError> {
    check(samples, &Prior::default())?;
    for (name, value) in [("sd_n", sd_n), ("observable_sd_rad", observable_sd_rad)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(SelfCalibrationError::BadPrior {
                name,
                value,
                zero: false,
            });
        }
    }
    if cell_n.len() != samples.len() {
        return Err(SelfCalibrationError::Mismatch {
            samples: samples.len(),
            readings: cell_n.len(),
        });
    }
    if let Some(sample) = cell_n.iter().position(|f| !f.is_finite()) {
        return Err(SelfCalibrationError::NotFinite {
            sample,
            what: "the cell's force",
        });
    }
    let mean = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / samples.len() as f64;
    let not_observable = || SelfCalibrationError::NotObservable {
        extent_mm: extent_mm(samples, &mean),
    };
    let mut jacobian = DMatrix::zeros(samples.len(), 3);
    for (k, s) in samples.iter().enumerate() {
        let direction = (exit_m - s.tip_m)
            .try_normalize(1e-6)
            .ok_or_else(not_observable)?;
        for i in 0..3 {
            jacobian[(k, i)] = -s.tension_n * direction[i] / sd_n;
        }
    }
    let measured = DVector::from_iterator(cell_n.len(), cell_n.iter().map(|f| f / sd_n));
    let svd = jacobian.clone().svd(true, true);
    let largest = svd.singular_values.max();
    let told = svd.singular_values.min() > 1e-9 * largest;
    if !told {
        return Err(not_observable());
    }
    let solution = svd.solve(&measured, 0.0).map_err(|_| not_observable())?;
    let scaled = Vector3::new(solution[0], solution[1], solution[2]);
    let gain = scaled.norm();
    let axis = scaled.try_normalize(1e-12).ok_or_else(not_observable)?;
    let normal = jacobian.transpose() * jacobian;
    let covariance: Matrix3<f64> = normal
        .fixed_view::<3, 3>(0, 0)
        .into_owned()
        .try_inverse()
        .ok_or_else(not_observable)?;
    let across = (Matrix3::identity() - axis * axis.transpose()) / gain;
    let axis_covariance = across * covariance * across.transpose();
    let worst_sd_rad = SymmetricEigen::new(axis_covariance)
        .eigenvalues
        .max()
        .max(0.0)
        .sqrt();
    let mut singular_values: [f64; 3] = [0, 1, 2].map(|i| svd.singular_values[i]);
    singular_values.sort_by(|a, b| b.total_cmp(a));
    Ok(AxisEstimate {
        axis,
        covariance: axis_covariance,
        gain,
        gain_sd: (axis.transpose() * covariance * axis)[0].sqrt(),
        worst_sd_rad,
        observed: worst_sd_rad <= observable_sd_rad,
        singular_values,
    })
}
