//! Joint trajectories: where the first three joints shall be at each time. Seeded, within limits,
//! at rest at both ends.
//!
//! A trajectory is made of *moves* for each joint: half a cosine wave from one turning point to the
//! next, and *holds* in between. Position and velocity are continuous; every move begins and ends
//! at rest. The kinds differ in how moves are drawn ([`TrajectoryConfig`]).

mod draw;

use crate::kinematics::LIMITS;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Set points of the first three joints at one time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointTarget {
    /// rad, rad, m.
    pub position: [f64; 3],
    /// rad/s, rad/s, m/s.
    pub velocity: [f64; 3],
}

/// Which kind of trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Sinusoids with random amplitudes and periods (thesis 4.1).
    Sinusoids,
    /// The same at a thirtieth to a third of the peak speed: the speeds at which the thesis's
    /// estimators are worst (4.3).
    LowSpeed,
    /// Moves with holds of random length between them, often of all joints at once.
    StopAndGo,
    /// Small alternating moves about a centre that wanders: many reversals.
    ReversalRich,
}

/// What a trajectory is drawn from. Joints: shoulder rad, elbow rad, insertion m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrajectoryConfig {
    /// Which kind.
    pub kind: Kind,
    /// Lower ends of the joints' ranges.
    pub lower: [f64; 3],
    /// Upper ends.
    pub upper: [f64; 3],
    /// Smallest peak speed of a move, rad/s, rad/s, m/s.
    pub slowest: [f64; 3],
    /// Largest peak speed of a move.
    pub fastest: [f64; 3],
    /// Length, s.
    pub duration_s: f64,
}

const DEG: f64 = PI / 180.0;

impl Default for TrajectoryConfig {
    /// What a lab records on a Raven-II (force_control's random movements): shoulder 20 to 60
    /// degrees at 1.1 to 3 degrees/s, elbow 55 to 110 at 1.5 to 4, insertion 0.33 to 0.42 m at 2.5
    /// to 7 mm/s, for 20 min (thesis 4.1).
    fn default() -> Self {
        Self {
            kind: Kind::Sinusoids,
            lower: [20.0 * DEG, 55.0 * DEG, 0.33],
            upper: [60.0 * DEG, 110.0 * DEG, 0.42],
            slowest: [1.1 * DEG, 1.5 * DEG, 2.5e-3],
            fastest: [3.0 * DEG, 4.0 * DEG, 7.0e-3],
            duration_s: 1_200.0,
        }
    }
}

/// Why a trajectory can't be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// A range is empty or past the joint's limits.
    #[error("trajectory, joint {joint}: the range {lower} to {upper} (rad or m) must be within {min:.4} to {max:.4} and not empty")]
    Range {
        /// Joint from 1.
        joint: usize,
        /// Given.
        lower: f64,
        /// Given.
        upper: f64,
        /// Lower limit of the joint.
        min: f64,
        /// Upper limit.
        max: f64,
    },
    /// Speeds that are none.
    #[error("trajectory, joint {joint}: the peak speeds {slowest} to {fastest} (rad/s or m/s) must be positive and in order")]
    Speed {
        /// Joint from 1.
        joint: usize,
        /// Given.
        slowest: f64,
        /// Given.
        fastest: f64,
    },
    /// A length that is none.
    #[error("trajectory: duration_s = {0}: allowed are 1 to 86,400")]
    Duration(f64),
}

/// A move from `from` to `to` as half a cosine wave; a hold where both are equal.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Move {
    start_s: f64,
    duration_s: f64,
    from: f64,
    to: f64,
}

/// See the module's page.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    joints: [Vec<Move>; 3],
    duration_s: f64,
}

impl Trajectory {
    /// Draws a trajectory. The same configuration and seed give the same trajectory on every
    /// machine.
    ///
    /// # Errors
    /// [`TrajectoryError`] names what can't be.
    pub fn new(config: &TrajectoryConfig, seed: u64) -> Result<Self, TrajectoryError> {
        check(config)?;
        Ok(draw::draw(config, seed))
    }

    /// Stands at `position` (rad, rad, m).
    #[must_use]
    pub fn standing(position: [f64; 3]) -> Self {
        Self {
            joints: position.map(|at| {
                vec![Move {
                    start_s: 0.0,
                    duration_s: 1.0,
                    from: at,
                    to: at,
                }]
            }),
            duration_s: 1.0,
        }
    }

    /// One move of all joints from `from` to `to` (rad, rad, m) in `duration_s` (at least 1 ms), at
    /// rest at both ends: to reach another trajectory's start.
    #[must_use]
    pub fn between(from: [f64; 3], to: [f64; 3], duration_s: f64) -> Self {
        let duration_s = duration_s.max(1e-3);
        Self {
            joints: core::array::from_fn(|i| {
                vec![Move {
                    start_s: 0.0,
                    duration_s,
                    from: from[i],
                    to: to[i],
                }]
            }),
            duration_s,
        }
    }

    /// Length, s.
    #[must_use]
    pub const fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The set points at `t_s`. Before the start: the first position, after the end: the last one,
    /// at rest.
    #[must_use]
    pub fn at(&self, t_s: f64) -> JointTarget {
        let mut target = JointTarget::default();
        for (i, moves) in self.joints.iter().enumerate() {
            let index = moves.partition_point(|m| m.start_s <= t_s).max(1) - 1;
            let m = &moves[index];
            let part = ((t_s - m.start_s) / m.duration_s).clamp(0.0, 1.0);
            let (sin, cos) = libm::sincos(PI * part);
            target.position[i] = m.from + (m.to - m.from) * 0.5 * (1.0 - cos);
            if part > 0.0 && part < 1.0 {
                target.velocity[i] = (m.to - m.from) * 0.5 * PI * sin / m.duration_s;
            }
        }
        target
    }

    /// Times at which joint `joint` (from 0) turns round, s: a move ends and the next one goes the
    /// other way.
    ///
    /// # Panics
    /// No such joint.
    #[must_use]
    pub fn reversals_s(&self, joint: usize) -> Vec<f64> {
        let moving: Vec<&Move> = self.joints[joint]
            .iter()
            .filter(|m| m.from != m.to)
            .collect();
        moving
            .windows(2)
            .filter(|pair| (pair[0].to - pair[0].from) * (pair[1].to - pair[1].from) < 0.0)
            .map(|pair| pair[1].start_s)
            .collect()
    }
}

fn check(config: &TrajectoryConfig) -> Result<(), TrajectoryError> {
    for (joint, (min, max)) in LIMITS.into_iter().take(3).enumerate() {
        let (lower, upper) = (config.lower[joint], config.upper[joint]);
        if !(lower >= min && upper <= max && lower < upper) {
            return Err(TrajectoryError::Range {
                joint: joint + 1,
                lower,
                upper,
                min,
                max,
            });
        }
        let (slowest, fastest) = (config.slowest[joint], config.fastest[joint]);
        if !(slowest > 0.0 && slowest <= fastest && fastest.is_finite()) {
            return Err(TrajectoryError::Speed {
                joint: joint + 1,
                slowest,
                fastest,
            });
        }
    }
    if !(1.0..=86_400.0).contains(&config.duration_s) {
        return Err(TrajectoryError::Duration(config.duration_s));
    }
    Ok(())
}
