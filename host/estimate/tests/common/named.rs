//! Changes of the virtual arm, each alone, and whether they get their right names.

use super::trials::{train, trial};
use estimate::explain::{explain, Motor, CANNOT_TELL};
use estimator::estimator::{Estimator, Kind};
use estimator::sequence::Sequence;
use rayon::prelude::*;
use robot::arm::{ArmConfig, ChangeConfig, VirtualArm};

/// Seconds of a trial that is explained.
const TRIAL_S: f64 = 120.0;

/// A change, and whether a motor's words name it. `gain` and `offset_a`: what was drawn for the
/// motor.
pub struct Change {
    pub name: &'static str,
    pub set: fn(&mut ChangeConfig),
    pub judge: fn(&Case<'_>) -> Answer,
}

/// A motor of a trial.
pub struct Case<'a> {
    pub joint: usize,
    pub motor: &'a Motor,
    /// Torque per current, per that of the arm without changes, less one.
    pub gain: f64,
}

/// The better ones first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Answer {
    Right,
    /// Of several names one is right, or the change has no name, or nothing is said.
    CannotTell,
    Wrong,
}

/// The worst of what a motor's words are. Of several names that the rows cannot tell apart one must
/// be of the `family`.
fn all(case: &Case<'_>, family: &str, right: impl Fn(&str) -> bool) -> Answer {
    judged(case, |text| {
        if text.contains(CANNOT_TELL) {
            match text.contains(family) {
                true => Answer::CannotTell,
                false => Answer::Wrong,
            }
        } else if right(text) {
            Answer::Right
        } else {
            Answer::Wrong
        }
    })
}

/// The worst answer of those of a motor's words; where it says nothing, or only that a change has
/// no name, it cannot tell.
fn judged(case: &Case<'_>, of: impl Fn(&str) -> Answer) -> Answer {
    let named = |text: &&String| !text.contains("no name here");
    let texts = case.motor.says.iter().filter(named);
    texts
        .map(|text| of(text))
        .max()
        .unwrap_or(Answer::CannotTell)
}

fn quiet(case: &Case<'_>) -> Answer {
    if case.motor.says.is_empty() {
        Answer::Right
    } else {
        Answer::Wrong
    }
}

/// Whether a text has this beginning, and a number of % in this range.
fn percent(text: &str, begins: &str, range: std::ops::Range<f64>) -> bool {
    let number = text.split(" %").next().and_then(|t| t.rsplit(' ').next());
    let number: Option<f64> = number.and_then(|n| n.parse().ok());
    text.contains(begins) && number.is_some_and(|n| range.contains(&n))
}

/// How the words of some families begin, or what they contain.
const FRICTION: &str = "friction of the";
const CONSTANT: &str = "a constant torque";
const CHANGES_IN_TIME: &str = "changes with time";

pub const CHANGES: [Change; 8] = [
    Change {
        name: "none",
        set: |_| {},
        judge: quiet,
    },
    Change {
        name: "friction fell by 6 %",
        set: |c| c.friction = -0.06,
        judge: |case| {
            all(case, FRICTION, |text| {
                text.starts_with("friction") && percent(text, "fell by", 3.0..9.0)
            })
        },
    },
    Change {
        name: "friction fell by 12 %",
        set: |c| c.friction = -0.12,
        judge: |case| {
            all(case, FRICTION, |text| {
                text.starts_with("friction") && percent(text, "fell by", 6.0..18.0)
            })
        },
    },
    Change {
        name: "gain 3 % (standard deviation)",
        set: |c| c.gain_sd = 0.03,
        judge: |case| {
            // What was drawn is at times next to nothing: then nothing may be said.
            let way = if case.gain < 0.0 {
                "fell by"
            } else {
                "rose by"
            };
            match all(case, "gain of the amplifier of the", |text| {
                text.starts_with("gain") && text.contains(way)
            }) {
                Answer::CannotTell if case.gain.abs() < 0.01 => Answer::Right,
                answer => answer,
            }
        },
    },
    Change {
        name: "zeros of amplifiers, 24 mA (standard deviation)",
        set: |c| c.offset_sd_a = 0.024,
        judge: |case| all(case, CONSTANT, |text| text.starts_with(CONSTANT)),
    },
    Change {
        name: "ripple, 20 % of Coulomb",
        set: |c| c.ripple = 0.2,
        judge: |case| {
            all(case, "that goes with the angle of its motor", |text| {
                text.starts_with("ripple")
            })
        },
    },
    Change {
        name: "asymmetry, 15 %",
        set: |c| c.asymmetry = 0.15,
        judge: |case| all(case, CONSTANT, |text| text.starts_with(CONSTANT)),
    },
    Change {
        name: "drag of a tool's cable, 0.2 N·m",
        set: |c| c.drag_n_m = 0.2,
        judge: |case| match case.joint {
            // It pulls at the elbow alone, and comes and goes in minutes: a constant torque is a
            // part of it at most.
            1 => judged(case, |text| {
                if text.contains(CANNOT_TELL) || text.starts_with(CONSTANT) {
                    let may_be = text.contains(CHANGES_IN_TIME) || text.contains(CONSTANT);
                    may_be.then_some(Answer::CannotTell)
                } else {
                    text.contains(CHANGES_IN_TIME).then_some(Answer::Right)
                }
                .unwrap_or(Answer::Wrong)
            }),
            _ => quiet(case),
        },
    },
];

/// A model of the robot `seed` without changes, of `trials` trials of three minutes.
pub fn trained(seed: u64, trials: u64) -> Estimator {
    let none = ChangeConfig::default();
    let training: Vec<Sequence> = (1..=trials)
        .into_par_iter()
        .map(|session| trial(seed, session, none, 0.0, 180.0))
        .map(|[_, loaded]| loaded)
        .collect();
    let rows: Vec<&Sequence> = training.iter().collect();
    train(Kind::Physics, seed, &rows)
}

/// The motors of a trial of a change, under a known force, with their answers.
pub fn answers(
    estimator: &Estimator,
    seed: u64,
    session: u64,
    change: &Change,
) -> Vec<(Motor, Answer)> {
    let mut config = ChangeConfig::default();
    (change.set)(&mut config);
    let [_, loaded] = trial(seed, session, config, 0.0, TRIAL_S);
    let gain = |change: ChangeConfig| {
        let config = ArmConfig {
            change,
            session,
            ..ArmConfig::default()
        };
        VirtualArm::new(&config, seed)
            .expect("an arm")
            .parameters()
            .torque_gain
    };
    let (with, without) = (gain(config), gain(ChangeConfig::default()));
    let explained = explain(estimator, &[&loaded]).expect("explained");
    explained
        .motors
        .into_iter()
        .enumerate()
        .map(|(joint, motor)| {
            let case = Case {
                joint,
                motor: &motor,
                gain: with[joint] / without[joint] - 1.0,
            };
            let answer = (change.judge)(&case);
            (motor, answer)
        })
        .collect()
}
