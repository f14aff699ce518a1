//! Rows of the virtual arm with a known force on its tip.

use estimator::motion::INPUTS;
use estimator::sequence::Sequence;
use robot::arm::VirtualArm;

/// Steps of the plant per second.
const STEPS_HZ: f64 = 20_000.0;

/// `seconds` of states at 50 Hz of an arm on its path, under a force at a time, N.
pub fn rows(
    arm: &mut VirtualArm,
    trial: usize,
    seconds: f64,
    force_n: impl Fn(f64) -> [f64; 3],
) -> Sequence {
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
        let on_tool = force_n(t);
        arm.step(1.0 / STEPS_HZ, true, on_tool);
        // The set points run in during the first second.
        if t > 2.0 && step % (STEPS_HZ as usize / 50) == 0 {
            let state = arm.state();
            let joints = state.joints.expect("the arm publishes joints");
            let effort = joints.effort.expect("the arm publishes efforts").value;
            let velocity = joints.velocity.expect("the arm publishes velocities");
            for from in [&joints.position, &velocity, &effort] {
                sequence.input.extend(from[..3].iter().map(|v| *v as f32));
            }
            sequence.target.extend(on_tool.map(|v| v as f32));
        }
    }
    sequence
}
