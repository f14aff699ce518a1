//! How the moves of each kind of trajectory are drawn.

use super::{Kind, Move, Trajectory, TrajectoryConfig};
use crate::random::Random;
use std::f64::consts::PI;

/// Least length of a move, as a part of the joint's range: shorter ones never leave the dead zone
/// of friction.
const SHORTEST: f64 = 0.15;
/// Length of the moves of [`Kind::ReversalRich`], parts of the range.
const BACK_AND_FORTH: (f64, f64) = (0.01, 0.08);
/// Holds of [`Kind::StopAndGo`], s.
const HOLDS_S: (f64, f64) = (0.3, 4.0);
/// Length of the moves of [`Kind::StopAndGo`], parts of the range.
const STEPS: (f64, f64) = (0.05, 0.4);
/// Part of the stops at which all joints stand at once.
const STOPS_OF_ALL: f64 = 0.5;
/// Speeds of [`Kind::LowSpeed`] as parts of the others.
const LOW_SPEED: (f64, f64) = (1.0 / 30.0, 1.0 / 3.0);

/// What moves one joint.
struct Joint {
    random: Random,
    range: (f64, f64),
    speed: (f64, f64),
    moves: Vec<Move>,
    at: f64,
    t_s: f64,
}

impl Joint {
    fn new(config: &TrajectoryConfig, seed: u64, index: usize) -> Self {
        let mut random = Random::stream(seed, "trajectory", index as u64);
        let range = (config.lower[index], config.upper[index]);
        Self {
            at: random.uniform(range.0, range.1),
            random,
            range,
            speed: (config.slowest[index], config.fastest[index]),
            moves: Vec::new(),
            t_s: 0.0,
        }
    }

    fn width(&self) -> f64 {
        self.range.1 - self.range.0
    }

    /// A turning point anywhere in the range, at least `SHORTEST` away.
    fn far_target(&mut self) -> f64 {
        let least = SHORTEST * self.width();
        loop {
            let target = self.random.uniform(self.range.0, self.range.1);
            if (target - self.at).abs() >= least {
                return target;
            }
        }
    }

    /// Time of a half cosine wave with a peak speed drawn from the joint's speeds times `factor`.
    fn move_time_s(&mut self, to: f64, factor: f64) -> f64 {
        let peak = self.random.uniform(self.speed.0, self.speed.1) * factor;
        0.5 * PI * (to - self.at).abs() / peak
    }

    fn go(&mut self, to: f64, duration_s: f64) {
        self.moves.push(Move {
            start_s: self.t_s,
            duration_s,
            from: self.at,
            to,
        });
        self.at = to;
        self.t_s += duration_s;
    }

    fn hold(&mut self, duration_s: f64) {
        if duration_s > 0.0 {
            self.go(self.at, duration_s);
        }
    }
}

pub(super) fn draw(config: &TrajectoryConfig, seed: u64) -> Trajectory {
    let mut joints: [Joint; 3] = core::array::from_fn(|i| Joint::new(config, seed, i));
    let end_s = config.duration_s;
    match config.kind {
        Kind::Sinusoids => each(&mut joints, end_s, |joint| {
            let to = joint.far_target();
            let time_s = joint.move_time_s(to, 1.0);
            joint.go(to, time_s);
        }),
        Kind::LowSpeed => each(&mut joints, end_s, |joint| {
            let factor = joint.random.log_uniform(LOW_SPEED.0, LOW_SPEED.1);
            // Short ways, so that slow moves still end and turn.
            let way = joint.random.uniform(0.02, 0.2) * joint.width();
            let to = within(joint, way);
            let time_s = joint.move_time_s(to, factor);
            joint.go(to, time_s);
        }),
        Kind::StopAndGo => stop_and_go(&mut joints, end_s, seed),
        Kind::ReversalRich => each(&mut joints, end_s, back_and_forth),
    }
    Trajectory {
        joints: joints.map(|joint| cut(joint.moves, end_s)),
        duration_s: end_s,
    }
}

fn each(joints: &mut [Joint; 3], end_s: f64, mut next: impl FnMut(&mut Joint)) {
    for joint in joints {
        while joint.t_s < end_s {
            next(joint);
        }
    }
}

/// A target `way` to one side or, where that is out of the range, to the other.
fn within(joint: &mut Joint, way: f64) -> f64 {
    let up = joint.random.unit() < 0.5;
    let to = joint.at + if up { way } else { -way };
    if to < joint.range.0 || to > joint.range.1 {
        2.0 * joint.at - to
    } else {
        to
    }
}

/// Two to eight small moves in alternating directions, then one to another place.
fn back_and_forth(joint: &mut Joint) {
    let turns = 2 + (joint.random.unit() * 7.0) as u32;
    let way = joint.random.uniform(BACK_AND_FORTH.0, BACK_AND_FORTH.1) * joint.width();
    let (here, there) = (joint.at, within(joint, way));
    for turn in 0..turns {
        let to = if turn % 2 == 0 { there } else { here };
        let time_s = joint.move_time_s(to, 1.0);
        joint.go(to, time_s);
    }
    let to = joint.far_target();
    let time_s = joint.move_time_s(to, 1.0);
    joint.go(to, time_s);
}

/// Moves and holds; at half of the stops the joints wait for each other.
fn stop_and_go(joints: &mut [Joint; 3], end_s: f64, seed: u64) {
    let mut random = Random::stream(seed, "stops", 0);
    while joints.iter().any(|joint| joint.t_s < end_s) {
        for joint in joints.iter_mut() {
            let way = joint.random.uniform(STEPS.0, STEPS.1) * joint.width();
            let to = within(joint, way);
            let time_s = joint.move_time_s(to, 1.0);
            joint.go(to, time_s);
        }
        let hold_s = random.uniform(HOLDS_S.0, HOLDS_S.1);
        if random.unit() < STOPS_OF_ALL {
            let all = joints.iter().map(|joint| joint.t_s).fold(0.0, f64::max);
            for joint in joints.iter_mut() {
                joint.hold(all + hold_s - joint.t_s);
            }
        } else {
            let one = (random.unit() * 3.0) as usize;
            joints[one.min(2)].hold(hold_s);
        }
    }
}

/// Parts of a move below this would be a jerk; the joint holds instead.
const SHORTEST_PART: f64 = 0.2;

/// The moves up to the end. The last one is shortened in way and time alike, so its peak speed
/// stays and it ends at rest.
fn cut(moves: Vec<Move>, end_s: f64) -> Vec<Move> {
    let mut kept = Vec::with_capacity(moves.len());
    for m in moves {
        let left_s = end_s - m.start_s;
        if left_s <= 0.0 {
            break;
        }
        let part = (left_s / m.duration_s).min(1.0);
        kept.push(Move {
            duration_s: m.duration_s * part,
            to: if part < SHORTEST_PART {
                m.from
            } else {
                m.from + (m.to - m.from) * part
            },
            ..m
        });
    }
    kept
}
