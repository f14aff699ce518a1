//! The force at the tip before and after the calibration.

use crate::cells::CellFigures;
use crate::scene::{self, normal3 as gauss3, CENTER_M};
use crate::surveys::GeometryFigures;
use crate::tally::Tally;
use calibration::stats;
use calibration::uncertainty::{self, Geometry, UnitInput};
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Error of the force at the tip, N, by what the rig is calibrated with.
#[derive(Debug, Clone, Default)]
pub struct ForceFigures {
    /// Nominal scale, geometry by tape measure (5 mm, 2 degrees), zeros taken.
    pub before: Tally,
    /// Calibrated; intervals are ellipsoids of 95 % about the stated force.
    pub after: Tally,
    /// The same; intervals are the stated balls.
    pub balls: Tally,
    /// Radius of each ball, N.
    pub radii_n: Vec<f64>,
}

/// Force at the tip believed from the cells' readings against the true one, at random poses and
/// tensions, with gains and zeros of `cells` and geometry of `surveys`. The robot reports its tip
/// with a standard deviation of `pose_sd_m` in each coordinate.
pub fn forces(
    draws: u64,
    cells: &CellFigures,
    surveys: &GeometryFigures,
    pose_sd_m: f64,
) -> ForceFigures {
    let mut out = ForceFigures::default();
    let limit = stats::chi_square_quantile(0.95, 3);
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0xF0_2CE + draw);
        let index = draw as usize;
        let Some((units, covariance)) = surveys.surveys[index].as_ref() else {
            continue;
        };
        let gains: Option<Vec<_>> = cells.gains[index].iter().cloned().collect();
        let zeros: Option<Vec<_>> = cells.zeros[index].iter().copied().collect();
        let (Some(gains), Some(zeros)) = (gains, zeros) else {
            continue;
        };
        out.before.new_draw();
        out.after.new_draw();
        out.balls.new_draw();
        let tip = Vector3::from(CENTER_M) + Vector3::from_fn(|_, _| rng.random_range(-0.04..0.04));
        let reported = tip + gauss3(&mut rng) * pose_sd_m;
        let (mut truth, mut nominal) = (Vector3::zeros(), Vector3::zeros());
        let mut inputs = Vec::new();
        let mut common = 0.0;
        for i in 0..6 {
            let exit = Vector3::from(scene::UNITS[i].0);
            let axis = Vector3::from(scene::UNITS[i].1).normalize();
            let d = (exit - tip).normalize();
            let tension = rng.random_range(2.0..12.0);
            truth += d * tension;
            let (found, true_gain) = &gains[i];
            let parts = found.relative_parts;
            // All units were calibrated with the same weights in the same place.
            common = parts.weights.hypot(parts.gravity);
            let code_above_zero = tension * -axis.dot(&d) / true_gain;
            // Before: tape and protractor.
            let tape = exit + gauss3(&mut rng) * 0.005;
            let rough = (axis + gauss3(&mut rng) * 0.035).normalize();
            let d_tape = (tape - reported).normalize();
            nominal += d_tape * (code_above_zero * 6.85e-6 / -rough.dot(&d_tape));
            // After: a zero that reads high by `error` takes it off each reading.
            let cell = found.force_n(code_above_zero) - zeros[i].0;
            let d_now = (units[i].exit_m - reported).normalize();
            inputs.push(UnitInput {
                exit_m: units[i].exit_m,
                axis: units[i].axis,
                tension_n: cell / -units[i].axis.dot(&d_now),
                gain_relative_sd: parts.readings.hypot(parts.beyond),
                zero_sd_n: zeros[i].1,
                held_sd_n: 0.0,
            });
        }
        let geometry = Geometry {
            covariance: covariance.clone(),
            tip_covariance_m2: Matrix3::identity() * pose_sd_m.powi(2),
        };
        let stated =
            uncertainty::tip_force(&inputs, &reported, &geometry, common).expect("sound units");
        let error = stated.force_n - truth;
        out.before.add((nominal - truth).norm());
        out.after.add(error.norm());
        out.balls.add(error.norm());
        out.balls.interval(error.norm() < stated.radius_95_n());
        out.radii_n.push(stated.radius_95_n());
        let inverse = stated.covariance_n2.try_inverse().expect("a covariance");
        out.after
            .interval((error.transpose() * inverse * error)[0] < limit);
    }
    out
}
