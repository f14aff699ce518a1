//! Rigid motions: rotation and translation with the exponential map of SE(3).
//!
//! A small motion is six numbers `[v, w]`, translation in m first, then rotation in rad; it acts
//! from the left: `T <- exp([v, w]) T`. To first order a point `q = T p` then moves by `v + w x q`
//! (Barfoot, *State Estimation for Robotics*, 7.1).

use nalgebra::{Matrix3, Vector3, Vector6};

/// A rigid motion `p -> rotation p + translation_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation matrix, determinant +1.
    pub rotation: Matrix3<f64>,
    /// Translation, m.
    pub translation_m: Vector3<f64>,
}

impl Pose {
    /// No motion.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation_m: Vector3::zeros(),
        }
    }

    /// The moved point, m.
    #[must_use]
    pub fn apply(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point_m + self.translation_m
    }

    /// First `other`, then this one.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            translation_m: self.rotation * other.translation_m + self.translation_m,
        }
    }

    /// The motion back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation_m: -(rotation * self.translation_m),
        }
    }

    /// `exp(step) self`; the rotation is brought back to an exact one.
    #[must_use]
    pub fn moved(&self, step: &Vector6<f64>) -> Self {
        let mut pose = exp(step).compose(self);
        pose.rotation = orthonormal(&pose.rotation);
        pose
    }
}

/// The cross-product matrix: `skew(a) b = a x b`.
#[must_use]
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Exponential map of SE(3) for `[v in m, w in rad]`.
#[must_use]
pub fn exp(step: &Vector6<f64>) -> Pose {
    let v = Vector3::new(step[0], step[1], step[2]);
    let w = Vector3::new(step[3], step[4], step[5]);
    let angle = w.norm();
    let k = skew(&w);
    let k2 = k * k;
    // sin(x)/x, (1 - cos x)/x^2 and (x - sin x)/x^3; by series where the quotients lose digits.
    let (a, b, c) = if angle < 1e-4 {
        let s = angle * angle;
        (1.0 - s / 6.0, 0.5 - s / 24.0, 1.0 / 6.0 - s / 120.0)
    } else {
        let s = angle * angle;
        (
            angle.sin() / angle,
            (1.0 - angle.cos()) / s,
            (angle - angle.sin()) / (s * angle),
        )
    };
    Pose {
        rotation: Matrix3::identity() + k * a + k2 * b,
        translation_m: (Matrix3::identity() + k * b + k2 * c) * v,
    }
}

/// Logarithm of SE(3): the `[v in m, w in rad]` whose [`exp`] is `pose`, rotation below pi.
#[must_use]
pub fn log(pose: &Pose) -> Vector6<f64> {
    let w = rotation_vector(&pose.rotation);
    let angle = w.norm();
    let k = skew(&w);
    let d = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        (1.0 - 0.5 * angle * (0.5 * angle).cos() / (0.5 * angle).sin()) / (angle * angle)
    };
    let v = (Matrix3::identity() - k * 0.5 + k * k * d) * pose.translation_m;
    Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

/// Axis times angle of a rotation, rad, 0 to pi.
#[must_use]
pub fn rotation_vector(r: &Matrix3<f64>) -> Vector3<f64> {
    let double = Vector3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    let sine = 0.5 * double.norm();
    let cosine = 0.5 * (r.trace() - 1.0);
    let angle = sine.atan2(cosine);
    if sine > 1e-9 {
        double * (0.5 * angle / sine)
    } else if cosine > 0.0 {
        double * 0.5
    } else {
        // Half a turn: R = 2 u u^T - I, so the largest column of R + I is along the axis.
        let sum = r + Matrix3::identity();
        let column = (0..3)
            .max_by(|&i, &j| sum.column(i).norm().total_cmp(&sum.column(j).norm()))
            .unwrap_or(0);
        sum.column(column).normalize() * std::f64::consts::PI
    }
}

/// The rotation nearest to a matrix that is almost one (one step of Gram and Schmidt).
fn orthonormal(r: &Matrix3<f64>) -> Matrix3<f64> {
    let x = r.column(0).normalize();
    let y = (r.column(1) - x * x.dot(&r.column(1))).normalize();
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exp_is_a_rotation_and_log_inverts_it(
            v in prop::array::uniform3(-1.0..1.0f64),
            w in prop::array::uniform3(-1.7..1.7f64),
            scale in prop::sample::select(vec![1.0, 1e-3, 1e-7]),
        ) {
            let step = Vector6::new(v[0], v[1], v[2], w[0] * scale, w[1] * scale, w[2] * scale);
            let pose = exp(&step);
            prop_assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12);
            prop_assert!((pose.rotation * pose.rotation.transpose() - Matrix3::identity()).norm() < 1e-12);
            prop_assert!((log(&pose) - step).norm() < 1e-7);
            let back = pose.compose(&pose.inverse());
            prop_assert!(back.translation_m.norm() < 1e-12);
        }

        #[test]
        fn a_small_motion_acts_as_stated(
            p in prop::array::uniform3(-1.0..1.0f64),
            s in prop::array::uniform6(-1e-6..1e-6f64),
        ) {
            let (p, s) = (Vector3::from(p), Vector6::from(s));
            let pose = exp(&Vector6::new(0.1, 0.2, -0.3, 0.5, -0.4, 0.9));
            let q = pose.apply(&p);
            let v = Vector3::new(s[0], s[1], s[2]);
            let w = Vector3::new(s[3], s[4], s[5]);
            let moved = pose.moved(&s).apply(&p);
            prop_assert!((moved - q - v - w.cross(&q)).norm() < 1e-10);
        }
    }

    #[test]
    fn half_a_turn_has_an_axis() {
        let r = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
        let w = rotation_vector(&r);
        assert!((w.norm() - std::f64::consts::PI).abs() < 1e-9);
        assert!(w.x.abs() < 1e-9 && w.y.abs() < 1e-9);
    }
}
