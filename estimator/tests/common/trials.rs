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

/// Rows of an arm, the first `free_s` without a force, then with one along y.
pub fn trial(
    seed: u64,
    session: u64,
    change: ChangeConfig,
    free_s: f64,
    loaded_s: f64,
) -> [Sequence; 2] {
    let path = TrajectoryConfig::default();
    trial_on(&path, seed, session, change, [free_s, loaded_s], along_y)
}

/// Force along y and the little that pulling cables give across it, from a time and the number of
/// the trial, N.
pub fn along_y(t: f64, phase: f64) -> [f64; 3] {
    let y = wave(t, phase);
    [0.02 * y, y, 0.01 * y]
}

/// Rates of 0.1 to 0.3 N/s, as in the thesis.
pub fn wave(t: f64, phase: f64) -> f64 {
    2.5 * libm::sin(0.083 * t + phase) + 1.8 * libm::sin(0.051 * t + 2.0 * phase)
}

/// The same with a force and speeds of one's own. `times_s`: without and with the force.
pub fn trial_on(
    path: &TrajectoryConfig,
    seed: u64,
    session: u64,
    change: ChangeConfig,
    [free_s, loaded_s]: [f64; 2],
    force_n: impl Fn(f64, f64) -> [f64; 3],
) -> [Sequence; 2] {
    let path = TrajectoryConfig {
        duration_s: free_s + loaded_s + 10.0,
        ..*path
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
    let all = rows(&mut arm, session as usize, free_s + loaded_s, |t| {
        if t < free_s {
            [0.0; 3]
        } else {
            force_n(t, phase)
        }
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

/// A model of the force along y.
pub fn train(kind: Kind, seed: u64, rows: &[&Sequence]) -> Estimator {
    train_axes(kind, seed, vec![1], rows)
}

pub fn train_axes(kind: Kind, seed: u64, axes: Vec<usize>, rows: &[&Sequence]) -> Estimator {
    let training = Training {
        kind,
        axes,
        base: Base::default(),
        robot: format!("virtual seed {seed}"),
        trees: TreesConfig::default(),
        networks: NetworkLimits::default(),
        intervals: true,
        absent: Vec::new(),
    };
    Estimator::train(&training, rows, &mut |_| {}).expect("trained")
}
