//! Rows of the virtual arm with a known force on its tip, for tests of models.

use estimator::motion::INPUTS;
use estimator::sequence::Sequence;
use robot::arm::{ArmConfig, ChangeConfig, VirtualArm};
use robot::trajectory::{Trajectory, TrajectoryConfig};

/// Steps of the plant per second.
const STEPS_HZ: f64 = 20_000.0;

/// A trial: `seconds` of states at 50 Hz of the arm `robot`, on a path and under a force along y of their own.
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
    let config = TrajectoryConfig {
        duration_s: seconds + 5.0,
        // Faster than in the lab: a minute holds some reversals of each joint.
        slowest: [0.06, 0.08, 0.008],
        fastest: [0.12, 0.16, 0.016],
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
    let phase = trial as f64;
    let force =
        |t: f64| loaded * (2.5 * (0.21 * t + phase).sin() + 1.5 * (0.083 * t + 2.0 * phase).sin());
    let mut sequence = Sequence {
        trial,
        start_s: 0.0,
        step_s: 0.02,
        input: Vec::new(),
        inputs: INPUTS,
        target: Vec::new(),
        targets: 3,
    };
    let steps = (seconds * STEPS_HZ) as usize;
    for step in 0..steps {
        let t = step as f64 / STEPS_HZ;
        arm.step(1.0 / STEPS_HZ, true, [0.1 * force(t), force(t), 0.0]);
        // The set points run in during the first second.
        if t > 2.0 && step % (STEPS_HZ as usize / 50) == 0 {
            let state = arm.state();
            let joints = state.joints.expect("the arm publishes joints");
            let effort = joints.effort.expect("the arm publishes efforts").value;
            let velocity = joints.velocity.expect("the arm publishes velocities");
            for from in [&joints.position, &velocity, &effort] {
                sequence.input.extend(from[..3].iter().map(|v| *v as f32));
            }
            sequence
                .target
                .extend([0.1 * force(t), force(t), 0.0].map(|v| v as f32));
        }
    }
    sequence
}
