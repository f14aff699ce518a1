//! How well the force at the tip is known: from gains, zeros, cell axes, exit points, the tip and
//! the held tensions to the covariance of the applied force.
//!
//! # Model
//!
//! With `c` a cell's force, `a` its axis, `d` the direction from tip to exit point at distance `L`
//! (thesis 3.7):
//!
//! ```text
//! F = sum T_i d_i,   T_i = c_i / cos_i,   cos_i = -a_i . d_i
//! dF_i = d dc / cos + c [ dd / cos + d (a . dd) / cos^2 ] + c d (d . da) / cos^2,   dd = (I - d d^T)(dx - dp) / L
//! ```
//!
//! The error of a cell's force is its relative gain error times the force, its zero, and the
//! tension loop's own error. Everything is taken to first order; errors of different kinds are
//! independent, except exit points and axes, whose joint covariance over all units can be given as
//! the survey has it ([`Geometry::covariance`]).

use nalgebra::{DMatrix, Matrix3, Matrix3x6, SymmetricEigen, Vector3};

/// One unit as calibrated, and its state.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitInput {
    /// Exit point, base frame, m.
    pub exit_m: Vector3<f64>,
    /// Measuring axis, unit vector from the unit to the workspace.
    pub axis: Vector3<f64>,
    /// Cable tension, N.
    pub tension_n: f64,
    /// Relative standard uncertainty of the gain, its part that is the unit's own.
    pub gain_relative_sd: f64,
    /// Standard uncertainty of the zero, N of cell force.
    pub zero_sd_n: f64,
    /// Standard deviation with which the cell force is held, N: the loop's error and noise. 0 where
    /// the cell's reading itself is used.
    pub held_sd_n: f64,
}

/// Covariances of the geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Covariance of all exit points and axes, six rows a unit (`exit_m` in m, `axis`), in the
    /// order of the units.
    pub covariance: DMatrix<f64>,
    /// Covariance of the tip, m^2.
    pub tip_covariance_m2: Matrix3<f64>,
}

/// The applied force and how well it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct TipForce {
    /// Force at the tip, base frame, N.
    pub force_n: Vector3<f64>,
    /// Its covariance, N^2.
    pub covariance_n2: Matrix3<f64>,
    /// Parts of it by source; they add up to it.
    pub parts: Parts,
}

/// Covariance of the force by source, N^2.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// Gains, each unit's own.
    pub gains: Matrix3<f64>,
    /// The gain error that all units share: local gravity, one set of weights.
    pub common_gain: Matrix3<f64>,
    /// Zeros.
    pub zeros: Matrix3<f64>,
    /// How the tensions are held.
    pub held: Matrix3<f64>,
    /// Exit points and axes.
    pub geometry: Matrix3<f64>,
    /// The tip's position.
    pub tip: Matrix3<f64>,
}

/// Why no uncertainty can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UncertaintyError {
    /// The geometry's covariance has the wrong size.
    #[error("the covariance of the geometry has {rows} x {columns} numbers for {units} units; it has to have six rows and columns a unit")]
    Size {
        /// Rows given.
        rows: usize,
        /// Columns given.
        columns: usize,
        /// Units given.
        units: usize,
    },
    /// A number that can't be used.
    #[error("unit {unit}: {what}")]
    BadUnit {
        /// Position in the list, from 1.
        unit: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// A number that belongs to no unit.
    #[error("{0} is not finite, or negative")]
    Bad(&'static str),
}

/// Force at the tip and its covariance. `tip_m` in m; `common_gain_relative_sd` is the relative
/// standard uncertainty of the gain that all units share.
///
/// # Errors
/// [`UncertaintyError`]: numbers that are not finite, a tip within 1 mm of an exit point, a cable
/// 75.5 degrees or more off its cell's axis (cosine below 0.25, the limit of the firmware).
pub fn tip_force(
    units: &[UnitInput],
    tip_m: &Vector3<f64>,
    geometry: &Geometry,
    common_gain_relative_sd: f64,
) -> Result<TipForce, UncertaintyError> {
    let size = 6 * units.len();
    let cov = &geometry.covariance;
    if cov.nrows() != size || cov.ncols() != size {
        return Err(UncertaintyError::Size {
            rows: cov.nrows(),
            columns: cov.ncols(),
            units: units.len(),
        });
    }
    if !cov.iter().all(|v| v.is_finite()) {
        return Err(UncertaintyError::Bad("the covariance of the geometry"));
    }
    if !geometry.tip_covariance_m2.iter().all(|v| v.is_finite()) {
        return Err(UncertaintyError::Bad("the covariance of the tip"));
    }
    if !(common_gain_relative_sd >= 0.0 && common_gain_relative_sd.is_finite()) {
        return Err(UncertaintyError::Bad("the common gain's uncertainty"));
    }
    let mut force = Vector3::zeros();
    let zero = Matrix3::zeros();
    let (mut gains, mut zeros, mut held) = (zero, zero, zero);
    let mut to_tip = Matrix3::zeros();
    let mut to_geometry: Vec<Matrix3x6<f64>> = Vec::new();
    for (i, unit) in units.iter().enumerate() {
        let partial = derivatives(unit, tip_m)
            .map_err(|what| UncertaintyError::BadUnit { unit: i + 1, what })?;
        force += partial.force_n;
        let to_cell = partial.to_cell;
        let along = to_cell * to_cell.transpose();
        gains += along * (unit.gain_relative_sd * partial.cell_n).powi(2);
        zeros += along * unit.zero_sd_n.powi(2);
        held += along * unit.held_sd_n.powi(2);
        to_tip += partial.to_tip;
        to_geometry.push(partial.to_geometry);
    }
    let mut joint = Matrix3::zeros();
    for (i, left) in to_geometry.iter().enumerate() {
        for (j, right) in to_geometry.iter().enumerate() {
            joint += left * cov.fixed_view::<6, 6>(6 * i, 6 * j) * right.transpose();
        }
    }
    let parts = Parts {
        gains,
        // A gain error that all share scales the force as a whole.
        common_gain: force * force.transpose() * common_gain_relative_sd.powi(2),
        zeros,
        held,
        geometry: joint,
        tip: to_tip * geometry.tip_covariance_m2 * to_tip.transpose(),
    };
    Ok(TipForce {
        force_n: force,
        covariance_n2: parts.gains
            + parts.common_gain
            + parts.zeros
            + parts.held
            + parts.geometry
            + parts.tip,
        parts,
    })
}

struct Partial {
    force_n: Vector3<f64>,
    cell_n: f64,
    /// N per N of cell force.
    to_cell: Vector3<f64>,
    /// N per m of exit point, N per unit of axis.
    to_geometry: Matrix3x6<f64>,
    /// N per m.
    to_tip: Matrix3<f64>,
}

fn derivatives(unit: &UnitInput, tip_m: &Vector3<f64>) -> Result<Partial, &'static str> {
    let finite = unit
        .exit_m
        .iter()
        .chain(&unit.axis)
        .chain(tip_m)
        .all(|v| v.is_finite());
    if !finite || !unit.tension_n.is_finite() {
        return Err("exit point, axis, tip or tension is not finite");
    }
    let sds = [unit.gain_relative_sd, unit.zero_sd_n, unit.held_sd_n];
    if !sds.iter().all(|s| *s >= 0.0 && s.is_finite()) {
        return Err("a standard uncertainty is negative or not finite");
    }
    if (unit.axis.norm() - 1.0).abs() > 1e-3 {
        return Err("its axis is not of unit length");
    }
    let span = unit.exit_m - tip_m;
    let length = span.norm();
    if length < 1e-3 {
        return Err("the tip is within 1 mm of its exit point");
    }
    let d = span / length;
    let cos = -unit.axis.dot(&d);
    if cos < 0.25 {
        return Err(
            "its cable stands 75.5 degrees or more off the cell's axis, which hardly sees it",
        );
    }
    let cell_n = unit.tension_n * cos;
    let across = (Matrix3::identity() - d * d.transpose()) / length;
    let to_direction =
        (Matrix3::identity() / cos + d * unit.axis.transpose() / (cos * cos)) * cell_n;
    let to_exit = to_direction * across;
    let mut to_geometry = Matrix3x6::zeros();
    to_geometry.fixed_view_mut::<3, 3>(0, 0).copy_from(&to_exit);
    to_geometry
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(d * d.transpose() * (cell_n / (cos * cos))));
    Ok(Partial {
        force_n: d * unit.tension_n,
        cell_n,
        to_cell: d / cos,
        to_geometry,
        to_tip: -to_exit,
    })
}

impl TipForce {
    /// Standard deviation of the force's size, N. For no force, that of its largest component.
    #[must_use]
    pub fn size_sd_n(&self) -> f64 {
        match self.force_n.try_normalize(1e-9) {
            Some(u) => (u.transpose() * self.covariance_n2 * u)[0].max(0.0).sqrt(),
            None => self.worst_sd_n(),
        }
    }

    /// Standard deviation in the worst direction, N.
    #[must_use]
    pub fn worst_sd_n(&self) -> f64 {
        SymmetricEigen::new(self.covariance_n2)
            .eigenvalues
            .max()
            .max(0.0)
            .sqrt()
    }

    /// Root mean square angle between the true and the stated direction, rad, to first order.
    /// `None` for no force.
    #[must_use]
    pub fn direction_sd_rad(&self) -> Option<f64> {
        let u = self.force_n.try_normalize(1e-9)?;
        let across = Matrix3::identity() - u * u.transpose();
        let variance = (across * self.covariance_n2 * across).trace();
        Some(variance.max(0.0).sqrt() / self.force_n.norm())
    }

    /// Radius of the ball about the stated force that holds the true one with 95 %, N.
    #[must_use]
    pub fn radius_95_n(&self) -> f64 {
        ball_radius_95(&self.covariance_n2)
    }
}

/// Radius of the ball that holds a normal error of this covariance with 95 %, in its unit; 0 for
/// none.
///
/// The square of the error's length is a sum of chi-squares with the eigenvalues as weights. Its
/// quantile is that of the chi-square with the same first three moments (Hall, Buckley and
/// Eagleson; Bodenham and Adams, *Statistics and Computing* 26 (2016) 917), within 1 % of the
/// radius for three weights at 95 %.
#[must_use]
pub fn ball_radius_95(covariance: &Matrix3<f64>) -> f64 {
    let weights = SymmetricEigen::new(*covariance)
        .eigenvalues
        .map(|v| v.max(0.0));
    let largest = weights.max();
    if largest <= 0.0 || !largest.is_finite() {
        return 0.0;
    }
    let sum = |power: i32| weights.map(|v| (v / largest).powi(power)).sum();
    let (c1, c2, c3) = (sum(1), sum(2), sum(3));
    // 1 for one direction alone to 3 for all alike.
    let dof = c2.powi(3) / (c3 * c3);
    let square = c1 + (crate::stats::chi_square_quantile_of(0.95, dof) - dof) * (c2 / dof).sqrt();
    (largest * square).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing::{normal, normal3, CENTER_M, UNITS};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn rig(tension: impl Fn(usize) -> f64) -> Vec<UnitInput> {
        UNITS
            .iter()
            .enumerate()
            .map(|(i, (exit, axis))| UnitInput {
                exit_m: Vector3::from(*exit),
                axis: Vector3::from(*axis).normalize(),
                tension_n: tension(i),
                gain_relative_sd: 5e-4,
                zero_sd_n: 0.002,
                held_sd_n: 0.01,
            })
            .collect()
    }

    fn geometry(correlated: bool) -> Geometry {
        let mut covariance = DMatrix::zeros(36, 36);
        for (i, (_, axis)) in UNITS.iter().enumerate() {
            let axis = Vector3::from(*axis).normalize();
            let across = Matrix3::identity() - axis * axis.transpose();
            covariance
                .fixed_view_mut::<3, 3>(6 * i + 3, 6 * i + 3)
                .copy_from(&(across * 0.004f64.powi(2)));
            for j in 0..6 {
                let same = if i == j {
                    1.0
                } else if correlated {
                    0.7
                } else {
                    0.0
                };
                covariance
                    .fixed_view_mut::<3, 3>(6 * i, 6 * j)
                    .copy_from(&(Matrix3::identity() * (same * 3e-4f64.powi(2))));
            }
        }
        Geometry {
            covariance,
            tip_covariance_m2: Matrix3::identity() * 2e-4f64.powi(2),
        }
    }

    fn force(units: &[UnitInput], cells: &[f64], tip: &Vector3<f64>) -> Vector3<f64> {
        units
            .iter()
            .zip(cells)
            .map(|(u, c)| {
                let d = (u.exit_m - tip).normalize();
                d * (c / -u.axis.dot(&d))
            })
            .sum()
    }

    #[test]
    fn the_ball_holds_95_percent_whatever_its_shape() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for sd in [
            [1.0, 1.0, 1.0],
            [1.0, 0.5, 0.2],
            [1.0, 1.0, 0.0],
            [1.0, 0.1, 0.1],
            [3.0, 0.0, 0.0],
        ] {
            let sd = Vector3::from(sd);
            let radius = ball_radius_95(&Matrix3::from_diagonal(&sd.component_mul(&sd)));
            let draws = 40_000;
            let held = (0..draws)
                .filter(|_| normal3(&mut rng).component_mul(&sd).norm() < radius)
                .count();
            let part = held as f64 / f64::from(draws);
            // Standard error 0.1 %.
            assert!((part - 0.95).abs() < 0.005, "{sd}: {part}");
        }
        assert_eq!(ball_radius_95(&Matrix3::zeros()), 0.0);
    }

    /// The analytic covariance against 20,000 draws of everything, through the nonlinear model.
    #[test]
    fn covariance_matches_monte_carlo() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let tip = Vector3::from(CENTER_M) + Vector3::new(0.03, -0.04, 0.02);
        for correlated in [false, true] {
            let units = rig(|i| 2.0 + 1.7 * i as f64);
            let geometry = geometry(correlated);
            let common = 3e-4;
            let found = tip_force(&units, &tip, &geometry, common).unwrap();
            let factor = geometry.covariance.clone() + DMatrix::identity(36, 36) * 1e-18;
            let root = factor.cholesky().unwrap().l();
            let cells: Vec<f64> = units
                .iter()
                .map(|u| u.tension_n * -u.axis.dot(&(u.exit_m - tip).normalize()))
                .collect();
            let nominal = force(&units, &cells, &tip);
            assert!((nominal - found.force_n).norm() < 1e-12);
            let draws = 20_000;
            let mut sum = Matrix3::zeros();
            for _ in 0..draws {
                let z = nalgebra::DVector::from_fn(36, |_, _| normal(&mut rng));
                let error = &root * z;
                let shared = common * normal(&mut rng);
                let (mut moved, mut read) = (units.clone(), cells.clone());
                for (i, u) in moved.iter_mut().enumerate() {
                    u.exit_m += error.fixed_rows::<3>(6 * i);
                    u.axis += error.fixed_rows::<3>(6 * i + 3);
                    read[i] += cells[i] * (u.gain_relative_sd * normal(&mut rng) + shared)
                        + u.zero_sd_n * normal(&mut rng)
                        + u.held_sd_n * normal(&mut rng);
                }
                let at = tip + normal3(&mut rng) * 2e-4;
                let e = force(&moved, &read, &at) - nominal;
                sum += e * e.transpose();
            }
            let sampled = sum / f64::from(draws);
            let scale = found.covariance_n2.trace() / 3.0;
            // Standard error of a sampled variance: sqrt(2 / 20000) = 1 %.
            assert!(
                (sampled - found.covariance_n2).amax() < 0.05 * scale,
                "{sampled} {}",
                found.covariance_n2
            );
        }
    }

    #[test]
    fn derivatives_match_finite_differences() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        for _ in 0..50 {
            let unit = &rig(|_| 5.0)[rng.random_range(0..6)];
            let tip = Vector3::from(CENTER_M) + normal3(&mut rng) * 0.03;
            let partial = derivatives(unit, &tip).unwrap();
            let h = 1e-6;
            let slope = |change: &dyn Fn(&mut UnitInput, &mut Vector3<f64>, f64)| {
                let at = |sign: f64| {
                    let (mut u, mut p) = (unit.clone(), tip);
                    change(&mut u, &mut p, sign * h);
                    force(&[u], &[partial.cell_n], &p)
                };
                (at(1.0) - at(-1.0)) / (2.0 * h)
            };
            for k in 0..3 {
                let exit = slope(&|u, _, s| u.exit_m[k] += s);
                let axis = slope(&|u, _, s| u.axis[k] += s);
                let moved = slope(&|_, p, s| p[k] += s);
                assert!((exit - partial.to_geometry.column(k)).norm() < 1e-6);
                assert!((axis - partial.to_geometry.column(3 + k)).norm() < 1e-6);
                assert!((moved - partial.to_tip.column(k)).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn parts_add_up_and_figures_are_consistent() {
        let tip = Vector3::from(CENTER_M);
        let found = tip_force(
            &rig(|i| if i == 0 { 9.0 } else { 2.0 }),
            &tip,
            &geometry(true),
            1e-3,
        )
        .unwrap();
        let p = &found.parts;
        let sum = p.gains + p.common_gain + p.zeros + p.held + p.geometry + p.tip;
        assert!((sum - found.covariance_n2).norm() < 1e-15);
        assert!(found.size_sd_n() <= found.worst_sd_n() + 1e-12);
        assert!(found.direction_sd_rad().unwrap() > 0.0);
        assert!(found.radius_95_n() > 2.0 * found.worst_sd_n());
    }

    #[test]
    fn bad_input_is_an_error() {
        let tip = Vector3::from(CENTER_M);
        let good = rig(|_| 3.0);
        let g = geometry(false);
        let small = Geometry {
            covariance: DMatrix::zeros(6, 6),
            ..g.clone()
        };
        assert!(matches!(
            tip_force(&good, &tip, &small, 0.0),
            Err(UncertaintyError::Size { .. })
        ));
        for change in [
            (|u: &mut UnitInput| u.tension_n = f64::NAN) as fn(&mut UnitInput),
            |u| u.axis = Vector3::new(0.0, 1.0, 0.0),
            |u| u.axis *= 2.0,
            |u| u.exit_m = Vector3::from(CENTER_M),
            |u| u.zero_sd_n = -1.0,
        ] {
            let mut bad = good.clone();
            change(&mut bad[0]);
            assert!(matches!(
                tip_force(&bad, &tip, &g, 0.0),
                Err(UncertaintyError::BadUnit { unit: 1, .. })
            ));
        }
        assert!(tip_force(&good, &tip, &g, f64::NAN).is_err());
    }
}
