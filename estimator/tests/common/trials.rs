//! Trials of a virtual arm that changes, and models of it. Whoever includes this file includes
//! `rows.rs` beside it.

use super::rows::rows;
use estimator::estimator::{Estimator, Kind, NetworkLimits, Training};
use estimator::geometry::Base;
use estimator::motion::INPUTS;
use estimator::sequence::Sequence;
use estimator::trees::TreesConfig;
use robot::arm::{ArmConfig, ChangeConfig, VirtualArm};
use robot::trajectory::{Trajectory, TrajectoryConfig};

/// Rows of an arm, the first `free_s` without a force.
pub fn trial(
    seed: u64,
    session: u64,
    change: ChangeConfig,
    free_s: f64,
    loaded_s: f64,
) -> [Sequence; 2] {
    let path = TrajectoryConfig {
        duration_s: free_s + loaded_s + 10.0,
        ..TrajectoryConfig::default()
    };
    let path = Trajectory::new(&path, 1_000 * seed + session).expect("a path");
    let config = ArmConfig {
        start: path.at(0.0).position,
        change,
        session,
        ..ArmConfig::default()
    };
    let mut arm = VirtualArm::new(&config, seed).expect("an arm");
    arm.follow(path);
    let phase = session as f64;
    // Rates of 0.1 to 0.3 N/s, as in the thesis.
    let force = |t: f64| 2.5 * (0.083 * t + phase).sin() + 1.8 * (0.051 * t + 2.0 * phase).sin();
    let all = rows(&mut arm, session as usize, free_s + loaded_s, |t| {
        let y = if t < free_s { 0.0 } else { force(t) };
        [0.02 * y, y, 0.01 * y]
    });
    let targets = all.target.chunks_exact(3);
    let free = if free_s > 0.0 {
        targets.take_while(|force| force[1] == 0.0).count()
    } else {
        0
    };
    let part = |start_s: f64, rows: std::ops::Range<usize>| Sequence {
        start_s,
        input: all.input[rows.start * INPUTS..rows.end * INPUTS].to_vec(),
        target: all.target[rows.start * 3..rows.end * 3].to_vec(),
        ..all.clone()
    };
    [part(0.0, 0..free), part(free_s, free..all.rows())]
}

pub fn train(kind: Kind, seed: u64, rows: &[&Sequence]) -> Estimator {
    let training = Training {
        kind,
        axes: vec![1],
        base: Base::default(),
        robot: format!("virtual seed {seed}"),
        trees: TreesConfig::default(),
        networks: NetworkLimits::default(),
        intervals: true,
        absent: Vec::new(),
    };
    Estimator::train(&training, rows, &mut |_| {}).expect("trained")
}
