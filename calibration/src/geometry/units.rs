//! Exit point and load-cell axis of each unit from its four points, with covariances.
//!
//! The axis is the normal of three points on the face of the load cell (thesis 3.5.2),
//! `(b - a) x (c - a)` of unit length. To first order it moves with its points as
//! [`normal_jacobian`] states, and across itself only, so its covariance has rank two.

use super::points::Label;
use super::GeometryError;
use nalgebra::{DMatrix, Matrix3, SMatrix, SymmetricEigen, Vector3};

/// Standard deviation of an axis above which its linear covariance, and so the axis, means nothing,
/// rad.
const LARGEST_AXIS_SD_RAD: f64 = 0.1;

/// Where a unit is and how its load cell looks.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitGeometry {
    /// Unit, from 1.
    pub unit: u8,
    /// Exit point, base frame, m.
    pub exit_m: Vector3<f64>,
    /// Measuring axis, unit vector from the unit to the workspace, base frame.
    pub axis: Vector3<f64>,
    /// Covariance of `[exit_m, axis]`: m^2, m and rad^2.
    pub covariance: SMatrix<f64, 6, 6>,
}

impl UnitGeometry {
    /// Covariance of the exit point, m^2.
    #[must_use]
    pub fn exit_covariance_m2(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Covariance of the axis, rad^2; of rank two, 0 along the axis.
    #[must_use]
    pub fn axis_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(3, 3).into_owned()
    }

    /// Root of the sum of the exit point's variances, m.
    #[must_use]
    pub fn exit_sd_m(&self) -> f64 {
        self.exit_covariance_m2().trace().sqrt()
    }

    /// Standard deviation of the axis in its worst direction, rad.
    #[must_use]
    pub fn axis_sd_rad(&self) -> f64 {
        let values = SymmetricEigen::new(self.axis_covariance()).eigenvalues;
        values.max().max(0.0).sqrt()
    }
}

/// The unit normal of three points by the right-hand rule, and the length of `(b - a) x (c - a)`,
/// m^2. `None` where the points lie on a line.
pub(super) fn normal(
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    c: &Vector3<f64>,
) -> Option<(Vector3<f64>, f64)> {
    let cross = (b - a).cross(&(c - a));
    let length = cross.norm();
    let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
    // Below a millionth of the longest side the direction is rounding.
    (length > 1e-6 * longest * longest && length.is_finite()).then(|| (cross / length, length))
}

/// Derivative of the unit normal to the points a, b, c, side by side (3 x 9), 1/m.
pub(super) fn normal_jacobian(
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    c: &Vector3<f64>,
) -> Option<SMatrix<f64, 3, 9>> {
    let (n, length) = normal(a, b, c)?;
    let across = (Matrix3::identity() - n * n.transpose()) / length;
    let skew = crate::se3::skew;
    // d((b - a) x (c - a)): a sees the side from c to b, b that from a to c, c that from b to a.
    let mut out = SMatrix::<f64, 3, 9>::zeros();
    for (k, side) in [b - c, c - a, a - b].iter().enumerate() {
        out.fixed_view_mut::<3, 3>(0, 3 * k)
            .copy_from(&(across * -skew(side)));
    }
    Some(out)
}

/// Units whose four points are there, with the covariance of all of them together (six rows a unit,
/// in order).
///
/// `position` gives a point in the base frame, `covariance` that of two points. A unit that has
/// some of its points only is an error, and so is one whose cell points lie so close to a line that
/// they give no axis.
pub(super) fn assemble(
    labels: &[Label],
    position: impl Fn(&Label) -> Option<Vector3<f64>>,
    covariance: impl Fn(&Label, &Label) -> Matrix3<f64>,
    center_m: Option<Vector3<f64>>,
) -> Result<(Vec<UnitGeometry>, DMatrix<f64>), GeometryError> {
    let mut numbers: Vec<u8> = labels
        .iter()
        .filter_map(|l| match l {
            Label::Exit { unit } | Label::Cell { unit, .. } => Some(*unit),
            _ => None,
        })
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    let mut units = Vec::new();
    let mut jacobians: Vec<SMatrix<f64, 6, 12>> = Vec::new();
    for &unit in &numbers {
        let names = points_of(unit);
        let mut at = [Vector3::zeros(); 4];
        for (slot, label) in at.iter_mut().zip(&names) {
            *slot = position(label).ok_or_else(|| GeometryError::MissingPoint {
                unit,
                label: label.to_string(),
            })?;
        }
        let [exit_m, a, b, c] = at;
        let (mut axis, _) = normal(&a, &b, &c).ok_or(GeometryError::CellOnALine { unit })?;
        let to_points = normal_jacobian(&a, &b, &c).ok_or(GeometryError::CellOnALine { unit })?;
        let mut sign = 1.0;
        if let Some(center) = center_m {
            if axis.dot(&(center - exit_m)) < 0.0 {
                sign = -1.0;
            }
        }
        axis *= sign;
        let mut jacobian = SMatrix::<f64, 6, 12>::zeros();
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&Matrix3::identity());
        jacobian
            .fixed_view_mut::<3, 9>(3, 3)
            .copy_from(&(to_points * sign));
        jacobians.push(jacobian);
        units.push(UnitGeometry {
            unit,
            exit_m,
            axis,
            covariance: SMatrix::zeros(),
        });
    }
    let n = units.len();
    let mut all = DMatrix::zeros(6 * n, 6 * n);
    for i in 0..n {
        for j in 0..n {
            let mut points = SMatrix::<f64, 12, 12>::zeros();
            for (r, left) in points_of(numbers[i]).iter().enumerate() {
                for (c, right) in points_of(numbers[j]).iter().enumerate() {
                    points
                        .fixed_view_mut::<3, 3>(3 * r, 3 * c)
                        .copy_from(&covariance(left, right));
                }
            }
            let block = jacobians[i] * points * jacobians[j].transpose();
            all.fixed_view_mut::<6, 6>(6 * i, 6 * j).copy_from(&block);
            if i == j {
                units[i].covariance = block;
            }
        }
    }
    for unit in &units {
        let sd_rad = unit.axis_sd_rad();
        if sd_rad.is_nan() || sd_rad > LARGEST_AXIS_SD_RAD {
            return Err(GeometryError::VagueAxis {
                unit: unit.unit,
                labels: points_of(unit.unit)[1..]
                    .iter()
                    .map(Label::to_string)
                    .collect::<Vec<_>>()
                    .join(", "),
                sd_deg: sd_rad.to_degrees(),
            });
        }
    }
    Ok((units, all))
}

fn points_of(unit: u8) -> [Label; 4] {
    [
        Label::Exit { unit },
        Label::Cell { unit, point: 1 },
        Label::Cell { unit, point: 2 },
        Label::Cell { unit, point: 3 },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_normals_derivative_matches_finite_differences(
            raw in prop::collection::vec(prop::array::uniform3(-0.1..0.1f64), 3),
        ) {
            let p: Vec<Vector3<f64>> = raw.into_iter().map(Vector3::from).collect();
            let area = (p[1] - p[0]).cross(&(p[2] - p[0])).norm();
            prop_assume!(area > 1e-3);
            let jacobian = normal_jacobian(&p[0], &p[1], &p[2]).unwrap();
            let h = 1e-7;
            for k in 0..9 {
                let at = |sign: f64| {
                    let mut q = p.clone();
                    q[k / 3][k % 3] += sign * h;
                    normal(&q[0], &q[1], &q[2]).unwrap().0
                };
                let slope = (at(1.0) - at(-1.0)) / (2.0 * h);
                prop_assert!((slope - jacobian.column(k)).norm() < 1e-5 * (1.0 + slope.norm()));
            }
        }
    }

    #[test]
    fn points_on_a_line_have_no_normal() {
        let p = |x: f64| Vector3::new(x, 2.0 * x, -x);
        assert!(normal(&p(0.0), &p(0.1), &p(0.3)).is_none());
        assert!(normal(&p(0.1), &p(0.1), &p(0.1)).is_none());
        assert!(normal(&p(f64::NAN), &p(0.1), &p(0.3)).is_none());
    }
}
