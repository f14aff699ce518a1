//! The rigid motion between two sets of points: Kabsch's algorithm (thesis 3.5.2).
//!
//! Kabsch, *Acta Cryst.* A32 (1976) 922. Noise can make the best orthogonal matrix a reflection,
//! determinant -1; then the direction of the smallest singular value is turned round, which gives
//! the best rotation (Umeyama, IEEE PAMI 13 (1991) 376).

use crate::se3::Pose;
use nalgebra::{Matrix3, Vector3};

/// What [`align`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// Motion that takes the points `from` to the points `to`.
    pub pose: Pose,
    /// Weighted sum of the squared distances that are left, m^2.
    pub residual_m2: f64,
    /// Whether a reflection fits better than any rotation: the points of one side may be mirrored.
    pub reflected: bool,
    /// Root of the weighted sum of squares of `from` along its three principal directions, m,
    /// largest first. The second is 0 for points on a line; then the rotation about that line is
    /// not determined.
    pub spread_m: [f64; 3],
}

/// Motion that takes the points `from` nearest to the points `to`, both in m, in the sense of the
/// weighted sum of squares. `None` for fewer than three points, slices of different lengths, a
/// weight that is not positive, or numbers that are not finite.
#[must_use]
pub fn align(from: &[Vector3<f64>], to: &[Vector3<f64>], weights: &[f64]) -> Option<Alignment> {
    if from.len() < 3 || from.len() != to.len() || from.len() != weights.len() {
        return None;
    }
    let finite = |points: &[Vector3<f64>]| points.iter().flatten().all(|v| v.is_finite());
    if !finite(from) || !finite(to) || !weights.iter().all(|w| *w > 0.0 && w.is_finite()) {
        return None;
    }
    let total: f64 = weights.iter().sum();
    let center = |points: &[Vector3<f64>]| {
        points
            .iter()
            .zip(weights)
            .fold(Vector3::zeros(), |sum, (p, w)| sum + p * *w)
            / total
    };
    let (from_center, to_center) = (center(from), center(to));
    let mut cross = Matrix3::zeros();
    let mut scatter = Matrix3::zeros();
    for ((p, q), w) in from.iter().zip(to).zip(weights) {
        let (p, q) = (p - from_center, q - to_center);
        cross += q * p.transpose() * *w;
        scatter += p * p.transpose() * *w;
    }
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    let least = svd.singular_values.imin();
    let mut fix = Vector3::repeat(1.0);
    fix[least] = sign;
    let rotation = u * Matrix3::from_diagonal(&fix) * v_t;
    let pose = Pose {
        rotation,
        translation_m: to_center - rotation * from_center,
    };
    let residual_m2 = from
        .iter()
        .zip(to)
        .zip(weights)
        .map(|((p, q), w)| w * (q - pose.apply(p)).norm_squared())
        .sum();
    let mut spread_m: [f64; 3] = scatter
        .symmetric_eigenvalues()
        .map(|v| v.max(0.0).sqrt())
        .into();
    spread_m.sort_by(|a, b| b.total_cmp(a));
    Some(Alignment {
        pose,
        residual_m2,
        reflected: sign < 0.0,
        spread_m,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::se3;
    use nalgebra::{Matrix4, Vector6};
    use proptest::prelude::*;

    /// Second implementation as an oracle: Horn's unit quaternion (J. Opt. Soc. Am. A 4 (1987)
    /// 629), which takes no SVD and can give no reflection.
    fn horn(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Pose {
        let n = from.len() as f64;
        let (cf, ct) = (
            from.iter().sum::<Vector3<f64>>() / n,
            to.iter().sum::<Vector3<f64>>() / n,
        );
        let mut s = Matrix3::<f64>::zeros();
        for (p, q) in from.iter().zip(to) {
            s += (p - cf) * (q - ct).transpose();
        }
        #[rustfmt::skip]
        let m = Matrix4::new(
            s.trace(), s[(1, 2)] - s[(2, 1)], s[(2, 0)] - s[(0, 2)], s[(0, 1)] - s[(1, 0)],
            s[(1, 2)] - s[(2, 1)], s[(0, 0)] - s[(1, 1)] - s[(2, 2)], s[(0, 1)] + s[(1, 0)], s[(2, 0)] + s[(0, 2)],
            s[(2, 0)] - s[(0, 2)], s[(0, 1)] + s[(1, 0)], s[(1, 1)] - s[(0, 0)] - s[(2, 2)], s[(1, 2)] + s[(2, 1)],
            s[(0, 1)] - s[(1, 0)], s[(2, 0)] + s[(0, 2)], s[(1, 2)] + s[(2, 1)], s[(2, 2)] - s[(0, 0)] - s[(1, 1)],
        );
        let eigen = m.symmetric_eigen();
        let q = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imax())
            .into_owned();
        let rotation = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
            q[0], q[1], q[2], q[3],
        ))
        .to_rotation_matrix()
        .into_inner();
        Pose {
            rotation,
            translation_m: ct - rotation * cf,
        }
    }

    fn points(raw: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        raw.iter().map(|p| Vector3::from(*p)).collect()
    }

    proptest! {
        #[test]
        fn kabsch_agrees_with_horn(
            raw in prop::collection::vec(prop::array::uniform3(-0.3..0.3f64), 4..10),
            noise in prop::collection::vec(prop::array::uniform3(-0.001..0.001f64), 10),
            step in prop::array::uniform6(-1.5..1.5f64),
        ) {
            let from = points(&raw);
            let truth = se3::exp(&Vector6::from(step));
            let to: Vec<_> = from.iter().zip(points(&noise)).map(|(p, n)| truth.apply(p) + n).collect();
            let found = align(&from, &to, &vec![1.0; from.len()]).unwrap();
            // Near-collinear sets leave a rotation open; both are right then.
            prop_assume!(found.spread_m[1] > 0.05);
            let other = horn(&from, &to);
            prop_assert!((found.pose.rotation - other.rotation).norm() < 1e-8);
            prop_assert!((found.pose.translation_m - other.translation_m).norm() < 1e-8);
        }

        #[test]
        fn a_mirrored_set_still_gives_a_rotation(
            raw in prop::collection::vec(prop::array::uniform3(-0.3..0.3f64), 4..10),
        ) {
            let from = points(&raw);
            let to: Vec<_> = from.iter().map(|p| Vector3::new(p.x, -p.y, p.z)).collect();
            let found = align(&from, &to, &vec![1.0; from.len()]).unwrap();
            prop_assume!(found.spread_m[2] > 0.02);
            prop_assert!(found.reflected);
            prop_assert!((found.pose.rotation.determinant() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn bad_input_gives_none() {
        let p = points(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert!(align(&p[..2], &p[..2], &[1.0; 2]).is_none());
        assert!(align(&p, &p, &[1.0, 1.0, 0.0]).is_none());
        let nan = vec![Vector3::repeat(f64::NAN); 3];
        assert!(align(&p, &nan, &[1.0; 3]).is_none());
        let line = points(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        let found = align(&line, &line, &[1.0; 3]).unwrap();
        assert!(found.spread_m[1] < 1e-9);
    }
}
