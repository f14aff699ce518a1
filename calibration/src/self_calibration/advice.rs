//! How much longer or further the robot has to move until a run tells an exit point well enough.
//!
//! Along the cable a run learns the exit point's distance only from the curvature of the length
//! over the tip's motion across the cable: `d^2 / 2 L` for a motion `d` at a distance `L`. The
//! standard deviation along it falls with the square of the motion and with the square root of the
//! time; across the cable it falls with the motion itself. Twice as far is worth sixteen times as
//! long.

use super::ExitEstimate;
use nalgebra::Vector3;

/// What a run lacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Needs {
    /// Times the length of this run, with the same motion; 1 where it is enough.
    pub longer: f64,
    /// Times the motion of this run across the cable, with the same length; 1 where it is enough.
    pub further: f64,
    /// Direction that is known worst, unit vector, base frame.
    pub direction: Vector3<f64>,
    /// Cosine of the angle between that direction and the cable.
    pub along_cable: f64,
}

impl ExitEstimate {
    /// What this run lacks until every direction is known with a standard deviation of `limit_m`.
    /// `tip_m`: the middle of the tip's motion.
    #[must_use]
    pub fn needs(&self, limit_m: f64, tip_m: &Vector3<f64>) -> Needs {
        let worst = self.directions[2];
        let ratio = (worst.sd_m / limit_m).max(1.0);
        let cable = (self.exit_m - tip_m).try_normalize(1e-9);
        let along_cable = cable.map_or(0.0, |cable| cable.dot(&worst.direction).abs());
        Needs {
            longer: ratio * ratio,
            // Where the worst direction lies across the cable, the motion counts once.
            further: if along_cable > 0.7 {
                ratio.sqrt()
            } else {
                ratio
            },
            direction: worst.direction,
            along_cable,
        }
    }
}
