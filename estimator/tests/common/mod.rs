//! Trials of the virtual arm with a known force on its tip, for tests of models.

mod rows;

use estimator::sequence::Sequence;
use robot::arm::{ArmConfig, ChangeConfig, VirtualArm};
use robot::trajectory::{Trajectory, TrajectoryConfig};
use rows::rows;

/// A trial: `seconds` of states at 50 Hz of the arm `robot`, on a path and under a force along y of
/// their own.
pub fn trial(robot: u64, trial: usize, seconds: f64) -> Sequence {
    changed(robot, trial, seconds, ChangeConfig::default(), 1.0)
}

/// The same of an arm that has changed, under so much of the force.
pub fn changed(
    robot: u64,
    trial: usize,
    seconds: f64,
    change: ChangeConfig,
    loaded: f64,
) -> Sequence {
    paced(robot, trial, seconds, change, loaded, 1.0)
}

/// The same at another pace.
pub fn paced(
    robot: u64,
    trial: usize,
    seconds: f64,
    change: ChangeConfig,
    loaded: f64,
    pace: f64,
) -> Sequence {
    let phase = trial as f64;
    let force = |t: f64| {
        loaded * (2.5 * libm::sin(0.21 * t + phase) + 1.5 * libm::sin(0.083 * t + 2.0 * phase))
    };
    under(robot, trial, seconds, change, pace, |t| {
        [0.1 * force(t), force(t), 0.0]
    })
}

/// The same under a force of one's own.
pub fn under(
    robot: u64,
    trial: usize,
    seconds: f64,
    change: ChangeConfig,
    pace: f64,
    force_n: impl Fn(f64) -> [f64; 3],
) -> Sequence {
    let config = TrajectoryConfig {
        duration_s: seconds + 5.0,
        // Faster than in the lab: a minute holds some reversals of each joint.
        slowest: [0.06, 0.08, 0.008].map(|v| v * pace),
        fastest: [0.12, 0.16, 0.016].map(|v| v * pace),
        ..TrajectoryConfig::default()
    };
    let path = Trajectory::new(&config, 1_000 + trial as u64).unwrap();
    let start = path.at(0.0).position;
    let mut arm = VirtualArm::new(
        &ArmConfig {
            start,
            change,
            session: trial as u64,
            ..ArmConfig::default()
        },
        robot,
    )
    .unwrap();
    arm.follow(path);
    rows(&mut arm, trial, seconds, force_n)
}
