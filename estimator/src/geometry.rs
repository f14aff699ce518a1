//! How a force at the tip acts on the motors, and in which frame it is counted.
//!
//! The robot's kinematics are known; how its base stands in the frame of the force is not written
//! in a log. It is found from rows: the rotation that carries the tip of the kinematics to the tip
//! that the robot reports (Kabsch).

use crate::motion::torques_at_motors;
use nalgebra::{DMatrix, Matrix3, Vector3};
use robot::kinematics::{forward, position_jacobian};
use serde::{Deserialize, Serialize};

/// Largest distance between reported tip and kinematics after the fit, RMS, m. More is another
/// robot, or another unit.
const LARGEST_MISFIT_M: f64 = 2e-3;

/// Rotation from frame 0 of the robot to the frame of the force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Base {
    /// Row-major.
    rotation: [[f64; 3]; 3],
}

impl Default for Base {
    /// The CRTK frame: x = -y0, y = -z0, z = x0.
    fn default() -> Self {
        Self {
            rotation: [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]],
        }
    }
}

/// Why reported tips do not fit the kinematics.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BaseError {
    /// The tips do not move in two directions.
    #[error("the tip hardly moves in these rows: the direction of the robot's base cannot be found; give rows with more motion")]
    Still,
    /// Another robot, or other units.
    #[error("the reported tip is {misfit_mm:.1} mm (RMS) from where the joints put it: this is no Raven-II arm, or positions are not in rad, rad, m")]
    Misfit {
        /// RMS distance, mm.
        misfit_mm: f64,
    },
}

impl Base {
    /// From pairs of joints (rad, rad, m) and reported tips (m).
    ///
    /// # Errors
    /// [`BaseError`].
    pub fn fit(pairs: &[([f64; 3], [f64; 3])]) -> Result<Self, BaseError> {
        let n = pairs.len().max(1) as f64;
        let tips: Vec<Vector3<f64>> = pairs.iter().map(|(q, _)| tip_in_0(*q)).collect();
        let reported: Vec<Vector3<f64>> =
            pairs.iter().map(|(_, tip)| Vector3::from(*tip)).collect();
        let middle = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / n;
        let (from, to) = (middle(&tips), middle(&reported));
        let products: Matrix3<f64> = tips
            .iter()
            .zip(&reported)
            .map(|(a, b)| (b - to) * (a - from).transpose())
            .sum();
        // As a matrix of any size: nalgebra's own way for 3 x 3 matrices loses a direction of some.
        let svd = DMatrix::from_fn(3, 3, |i, j| products[(i, j)]).svd(true, true);
        let (Some(u), Some(vt)) = (svd.u, svd.v_t) else {
            return Err(BaseError::Still);
        };
        // Two directions are needed; 1 mm of RMS motion in the second.
        if svd.singular_values[1] < n * 1e-6 {
            return Err(BaseError::Still);
        }
        let (u, vt) = (
            Matrix3::from_fn(|i, j| u[(i, j)]),
            Matrix3::from_fn(|i, j| vt[(i, j)]),
        );
        let sign = (u * vt).determinant().signum();
        let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * vt;
        let square: f64 = tips
            .iter()
            .zip(&reported)
            .map(|(a, b)| (rotation * (a - from) - (b - to)).norm_squared())
            .sum();
        let misfit_m = (square / n).sqrt();
        if misfit_m > LARGEST_MISFIT_M {
            return Err(BaseError::Misfit {
                misfit_mm: misfit_m * 1e3,
            });
        }
        Ok(Self {
            rotation: core::array::from_fn(|i| core::array::from_fn(|j| rotation[(i, j)])),
        })
    }

    /// Largest difference of an entry of the rotation.
    #[must_use]
    pub fn distance(&self, other: &Self) -> f64 {
        let entries = |base: &Self| base.rotation.concat();
        let pairs = entries(self).into_iter().zip(entries(other));
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    fn matrix(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.rotation[i][j])
    }

    /// Velocity of the tip per joint velocity, in the frame of the force.
    #[must_use]
    pub fn jacobian(&self, q: [f64; 3]) -> Matrix3<f64> {
        self.matrix() * position_jacobian(&[q[0], q[1], q[2], 0.0, 0.0, 0.0])
    }

    /// What of a force on the tip is across the tool's shaft, N.
    #[must_use]
    pub fn across(&self, q: [f64; 3], force: &Vector3<f64>) -> Vector3<f64> {
        // The insertion moves the tip along the shaft, by as much.
        let shaft = self.jacobian(q).column(2).into_owned();
        force - shaft * shaft.dot(force)
    }

    /// Torque at the motors (joints' units) per force on the tip: row i is motor i.
    #[must_use]
    pub fn at_motors(&self, q: [f64; 3]) -> Matrix3<f64> {
        let jacobian = self.jacobian(q);
        let mut levers = Matrix3::zeros();
        for axis in 0..3 {
            let joint = [
                jacobian[(axis, 0)],
                jacobian[(axis, 1)],
                jacobian[(axis, 2)],
            ];
            levers.set_column(axis, &Vector3::from(torques_at_motors(joint)));
        }
        levers
    }
}

/// Tip in frame 0, m, with a straight tool.
#[must_use]
pub fn tip_in_0(q: [f64; 3]) -> Vector3<f64> {
    forward(&[q[0], q[1], q[2], 0.0, 0.0, 0.0]).position_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot::kinematics::to_crtk;

    fn pairs(scale: f64) -> Vec<([f64; 3], [f64; 3])> {
        (0..200)
            .map(|n| {
                let t = f64::from(n) * 0.1;
                let q = [
                    0.7 + 0.3 * t.sin(),
                    1.4 + 0.3 * (0.7 * t).cos(),
                    0.38 + 0.03 * (1.3 * t).sin(),
                ];
                let tip =
                    to_crtk(tip_in_0([q[0] * scale, q[1], q[2]])) + Vector3::new(0.1, -0.2, 0.3);
                (q, tip.into())
            })
            .collect()
    }

    #[test]
    fn the_base_is_found_from_reported_tips() {
        let base = Base::fit(&pairs(1.0)).unwrap();
        assert!((base.matrix() - Base::default().matrix()).norm() < 1e-9);
    }

    #[test]
    fn the_base_is_found_from_any_path() {
        for seed in 0..300_u32 {
            let phase = |k: u32| f64::from(seed * 7 + k * 13) * 0.61;
            let pairs: Vec<_> = (0..400)
                .map(|n| {
                    let t = f64::from(n) * 0.05;
                    let q = [
                        0.7 + 0.3 * (t + phase(0)).sin(),
                        1.4 + 0.3 * (0.73 * t + phase(1)).cos(),
                        0.38 + 0.03 * (1.31 * t + phase(2)).sin(),
                    ];
                    (q, to_crtk(tip_in_0(q)).into())
                })
                .collect();
            let base = Base::fit(&pairs).unwrap();
            let error = (base.matrix() - Base::default().matrix()).norm();
            assert!(error < 1e-9, "seed {seed}: {error}");
        }
    }

    #[test]
    fn other_units_are_refused_by_name() {
        let error = Base::fit(&pairs(57.3)).unwrap_err();
        assert!(error.to_string().contains("rad, rad, m"), "{error}");
        let still = vec![([0.7, 1.4, 0.38], [0.0, 0.0, 0.0]); 50];
        assert_eq!(Base::fit(&still), Err(BaseError::Still));
    }

    #[test]
    fn work_at_the_tip_is_work_at_the_motors() {
        // F'J v = (levers F)' C v.
        let (q, v) = ([0.7, 1.5, 0.37], [0.2, -0.3, 0.01]);
        let force = Vector3::new(0.4, -2.0, 1.0);
        let base = Base::default();
        let at_tip = force.dot(&(base.jacobian(q) * Vector3::from(v)));
        let at_motors =
            (base.at_motors(q) * force).dot(&Vector3::from(crate::motion::at_motors(v)));
        assert!((at_tip - at_motors).abs() < 1e-12);
    }
}
