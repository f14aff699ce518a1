//! What a model lacks of its robot, in words: the torque balance of each motor, handed to the
//! residual analysis.
//!
//! The physical model says which torque a motor needs, with the measured force. What is commanded
//! beside that is looked at by the crate `residual`: its effects get names by how well they tell
//! rows that were held out, and only where they explain more than the model's own error in
//! training. The names here are words for a robot: an effect `angle_friction` of order 1 is a
//! ripple of the motor.

use estimator::estimator::Estimator;
use estimator::physics::Balance;
use estimator::sequence::Sequence;
use residual::spec::Spec;
use residual::{Effect, EffectKind, Form, Report, Verdict};
use serde::Serialize;

/// The joints, with the units of their torques.
pub const JOINTS: [(&str, &str); 3] = [("shoulder", "N·m"), ("elbow", "N·m"), ("insertion", "N")];

/// Effects that a change of a robot has: of an amplifier, of gears and cables, of a thing that
/// pulls. Presliding, Stribeck's friction, that of the load and damping are in the physical model;
/// beside it they would name parts of a change of all friction.
const EFFECTS: &str =
    r#"["offset", "gain", "coulomb", "angle_friction", "periodic_angle", "drift_time"]"#;
/// Distance of the rows that are analysed, s. A motor turns at most about once a second; neighbours
/// closer than this tell the same.
const EVERY_S: f64 = 0.1;
/// Rows that are held out together, s: some times the 2 s in which errors of a balance are alike.
const BLOCK_S: f64 = 10.0;
/// Share of the Coulomb friction from which a motor counts as sliding. Below it contacts bend, and
/// the friction has no direction yet.
const SLIDES: f64 = 0.7;
/// How far from one to a turn the order of a ripple may be. A finding's order has an error of some
/// hundredths over a few turns.
const ONE_A_TURN: f64 = 0.1;

/// Correlation of a motor's torque with its friction from which friction and gain count as one: a
/// change of either is then nearly a change of the other, and of which form friction changes is not
/// known so exactly; nor is a smaller constant torque beside it told from it. On the robots 1, 2,
/// 11 and 12 all wrong names of the two were at 0.990 and above.
const ONE: f64 = 0.99;
/// Size of what is left, per the model's own error in training, from which it is told though it has
/// no name. On the robots 1, 2, 11 and 12 structure was found in 4 of 96 balances of arms without
/// changes. Estimate.
const LEFT: f64 = 2.0;

/// What was found of a motor.
#[derive(Debug, Clone, Serialize)]
pub struct Motor {
    /// Its joint.
    pub joint: &'static str,
    /// The answer of the analysis.
    pub verdict: Verdict,
    /// What has changed, in words; nothing where nothing was found.
    pub says: Vec<String>,
    /// Correlation of the expected torque with the part of it that is friction. Near 1 friction and
    /// gain look alike.
    pub friction_in_torque: f64,
    /// RMS of torque less expected torque, in the joint's unit.
    pub before: f64,
    /// The same with what was found, on rows that were held out.
    pub after: f64,
    /// Unit of the joint's torque.
    pub unit: &'static str,
    /// Courses of the search that predict as well and whose names were not judged.
    pub paths_not_judged: usize,
}

/// What was found of a robot.
#[derive(Debug, Clone, Serialize)]
pub struct Explained {
    /// Its motors.
    pub motors: Vec<Motor>,
    /// Rows that were looked at.
    pub rows: usize,
    /// Those of them without a measured force, which counts as none there.
    pub rows_without_force: usize,
}

/// Why nothing can be said.
#[derive(Debug, thiserror::Error)]
pub enum ExplainError {
    /// The model has no balance.
    #[error("{0}")]
    Model(#[from] estimator::model::ModelError),
    /// The analysis refused the rows.
    #[error("{joint}: the balance of the motor can't be analysed: {error}")]
    Analysis {
        /// Which motor.
        joint: &'static str,
        /// What the analysis says.
        error: residual::Error,
    },
}

/// Says what `estimator` lacks of the robot in these sequences. A force that was not measured
/// counts as none; how many rows have none is counted.
///
/// # Errors
/// The model has no torque balance, or there are too few rows.
pub fn explain(estimator: &Estimator, sequences: &[&Sequence]) -> Result<Explained, ExplainError> {
    let every = (EVERY_S / estimator.step_s).round().max(1.0) as usize;
    let mut stretches: Vec<Vec<[Balance; 3]>> = Vec::new();
    for sequence in sequences {
        let rows = estimator.balances(sequence)?;
        stretches.push(rows.into_iter().step_by(every).collect());
    }
    stretches.retain(|rows| !rows.is_empty());
    let motors = (0..3).map(|i| {
        let rows: Vec<Vec<Balance>> = (stretches.iter())
            .map(|rows| rows.iter().map(|row| row[i]).collect())
            .collect();
        let analysed = analyse(i, &rows);
        analysed.map_err(|error| ExplainError::Analysis {
            joint: JOINTS[i].0,
            error,
        })
    });
    let forces = sequences.iter().flat_map(|s| s.target.chunks(s.targets));
    let lacks = |force: &&[f32]| force.iter().any(|n| !n.is_finite());
    Ok(Explained {
        motors: motors.collect::<Result<_, _>>()?,
        rows: sequences.iter().map(|s| s.rows()).sum(),
        rows_without_force: forces.filter(lacks).count(),
    })
}

fn analyse(i: usize, stretches: &[Vec<Balance>]) -> Result<Motor, residual::Error> {
    let (joint, unit) = JOINTS[i];
    let all: Vec<&Balance> = stretches.iter().flatten().collect();
    let column = |of: fn(&Balance) -> f64| all.iter().map(|row| of(row)).collect::<Vec<f64>>();
    let mut ranges = Vec::new();
    let mut blocks = Vec::new();
    for (n, rows) in stretches.iter().enumerate() {
        ranges.push(blocks.len()..blocks.len() + rows.len());
        // No trial has a thousand hours of blocks.
        blocks.extend(
            rows.iter()
                .map(|row| n * 1_000_000 + (row.time_s / BLOCK_S) as usize),
        );
    }
    let data = residual::Data::from_columns(
        column(|row| row.time_s),
        [
            ("target", column(|row| row.torque)),
            ("command", column(|row| row.expected)),
            ("velocity", column(sliding)),
            ("angle", column(|row| row.angle)),
        ],
    )
    .sequences(ranges)
    .groups(blocks)
    .build()?;
    let floor = all.first().map_or(0.0, |row| row.deviation);
    let report = residual::analyse(&Spec::parse(&model(unit, floor))?, data, &mut ())?;
    let slides: Vec<f64> = (all.iter())
        .filter(|row| sliding(row) != 0.0)
        .map(|row| row.friction.abs())
        .collect();
    let of_torque = correlation(&all, |row| row.expected, |row| row.friction);
    let friction = Friction {
        mean: slides.iter().sum::<f64>() / slides.len().max(1) as f64,
        is_all: of_torque >= ONE,
    };
    Ok(Motor {
        joint,
        verdict: report.verdict,
        says: words(&report, joint, unit, &friction, floor),
        friction_in_torque: of_torque,
        before: report.baseline.heldout_rmse,
        after: report.last.heldout_rmse,
        unit,
        paths_not_judged: report.paths_not_judged,
    })
}

/// Friction of a motor.
struct Friction {
    /// Mean of its size while the motor slides, in the joint's unit.
    mean: f64,
    /// Whether it is nearly all of the torque.
    is_all: bool,
}

fn correlation(rows: &[&Balance], a: fn(&Balance) -> f64, b: fn(&Balance) -> f64) -> f64 {
    let mean = |of: &dyn Fn(&Balance) -> f64| {
        rows.iter().map(|row| of(row)).sum::<f64>() / rows.len().max(1) as f64
    };
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let both = mean(&|row| (a(row) - mean_a) * (b(row) - mean_b));
    let squares = mean(&|row| (a(row) - mean_a).powi(2)) * mean(&|row| (b(row) - mean_b).powi(2));
    both / squares.sqrt().max(f64::MIN_POSITIVE)
}

/// Velocity of a motor whose friction has its sliding direction, rad/s; else 0.
fn sliding(row: &Balance) -> f64 {
    if row.friction.abs() >= SLIDES * row.coulomb {
        row.turn_rate.abs().copysign(row.friction)
    } else {
        0.0
    }
}

/// The declared model: what is commanded is what the physical model expects. `floor`: its own error
/// in training.
fn model(unit: &str, floor: f64) -> String {
    format!(
        r#"title = "Torque of a motor"
[roles]
time = {{ column = "time", unit = "s" }}
target = {{ column = "torque", unit = "{unit}", noise_floor = {floor} }}
command = {{ column = "expected", unit = "{unit}" }}
velocity = {{ column = "rate", unit = "rad/s" }}
angle = {{ column = "angle", unit = "rad" }}
[selection]
only = {EFFECTS}
[[terms]]
name = "what the model expects"
expr = "command"
fixed = 1.0
"#
    )
}

/// Stands behind names of which one is right.
pub const CANNOT_TELL: &str = "these rows cannot tell them apart";

/// What a report says of a motor. `floor`: error of its balance in training.
fn words(report: &Report, joint: &str, unit: &str, friction: &Friction, floor: f64) -> Vec<String> {
    let known = |effect: &&Effect| report.verdict != Verdict::Unknown || report.holds(effect);
    // The most valuable effects come first. Several may have the same words: those that go with the
    // angle are one thing to a reader.
    let mut said: Vec<(String, Vec<Vec<EffectKind>>)> = Vec::new();
    let mut friction_changed = false;
    for effect in report.effects.iter().filter(known) {
        let text = word(effect, joint, unit, friction);
        let mut others = report.others(effect.name);
        let twin = match effect.name {
            EffectKind::Gain => Some(EffectKind::Coulomb),
            EffectKind::Coulomb => Some(EffectKind::Gain),
            // What friction loses more of one way than the other is a constant torque.
            EffectKind::Offset if friction_changed => Some(EffectKind::Coulomb),
            _ => None,
        };
        friction_changed |= matches!(effect.name, EffectKind::Gain | EffectKind::Coulomb);
        let twin = twin.map(|twin| vec![twin]).filter(|_| friction.is_all);
        others.extend(twin);
        let at = said.iter().position(|(known, _)| *known == text);
        let at = at.unwrap_or_else(|| {
            said.push((text, vec![]));
            said.len() - 1
        });
        for other in others {
            if !said[at].1.contains(&other) {
                said[at].1.push(other);
            }
        }
    }
    let together = |names: &Vec<EffectKind>| {
        let names: Vec<String> = names.iter().map(|name| family(*name, joint)).collect();
        names.join(" with ")
    };
    let mut out: Vec<String> = Vec::new();
    for (text, others) in said {
        let mut all: Vec<String> = Vec::new();
        for other in others.iter().map(together) {
            // What is said already is no other name of it.
            if other != text && !all.contains(&other) {
                all.push(other);
            }
        }
        out.push(match all.is_empty() {
            true => text,
            false => format!("{text}; or {}: {CANNOT_TELL}", all.join(" or ")),
        });
    }
    let left = if out.is_empty() {
        report.baseline.heldout_rmse
    } else {
        report.last.heldout_rmse
    };
    if report.verdict == Verdict::Unknown && left > LEFT * floor {
        let of = (report.structure.first()).map_or_else(String::new, |s| {
            format!("; it depends on: {}", s.depends_on)
        });
        out.push(format!(
            "the {joint} has {}that has no name here{of}",
            if out.is_empty() { "a change " } else { "more " }
        ));
    }
    out
}

/// An effect in words, with its size.
fn word(effect: &Effect, joint: &str, unit: &str, friction: &Friction) -> String {
    let value = |name: &str| effect.params.get(name).copied().unwrap_or(f64::NAN);
    match effect.name {
        EffectKind::Coulomb => format!(
            "friction of the {joint} {}",
            moved(value("friction") / friction.mean, "fell", "rose")
        ),
        // Of the torque per command: more gain needs less command.
        EffectKind::Gain => {
            let gain = 1.0 / (1.0 + value("gain_error")) - 1.0;
            format!(
                "gain of the amplifier of the {joint} {}",
                moved(gain, "fell", "rose")
            )
        }
        EffectKind::Offset => format!(
            "a constant torque of {:.3} {unit} at the {joint}: zero of its amplifier, or friction that is larger one way",
            // Not commanded: the command makes up for it.
            -value("offset")
        ),
        EffectKind::AngleFriction | EffectKind::PeriodicAngle
            if (value("order") - 1.0).abs() <= ONE_A_TURN =>
        {
            let amplitude = value("amplitude").abs();
            let (share, of) = match effect.form_kind {
                Form::ShareOfLoad => (amplitude, "torque"),
                _ => (amplitude / friction.mean, "friction"),
            };
            let ripple = format!("ripple of the {joint}'s motor");
            match share.is_finite() {
                true => format!("{ripple}: {:.0} % of the {of} over a turn", 100.0 * share),
                false => ripple,
            }
        }
        other => family(other, joint),
    }
}

/// Which way a share has moved, and by how much. Where a motor never slides, its friction has no
/// mean, and a share of it no size.
fn moved(share: f64, down: &str, up: &str) -> String {
    if share.is_nan() {
        return "changed".to_owned();
    }
    let way = if share < 0.0 { down } else { up };
    match share.is_finite() {
        true => format!("{way} by {:.1} %", 100.0 * share.abs()),
        false => way.to_owned(),
    }
}

/// An effect in words, without a size.
fn family(effect: EffectKind, joint: &str) -> String {
    match effect {
        EffectKind::Coulomb => format!("friction of the {joint}"),
        EffectKind::Gain => format!("gain of the amplifier of the {joint}"),
        EffectKind::Offset => format!("a constant torque at the {joint}"),
        EffectKind::AngleFriction | EffectKind::PeriodicAngle => {
            format!("friction or torque of the {joint} that goes with the angle of its motor")
        }
        EffectKind::DriftTime => format!("a torque at the {joint} that changes with time"),
        other => other.meaning().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of a motor with two equal trials, whose torque lacks `torque` at each row.
    fn said(torque: impl Fn(&Balance) -> f64) -> Vec<String> {
        let row = |k: usize| {
            let time_s = 0.1 * k as f64;
            // Two turns back and forth, and a little that repeats with neither.
            let (phase, other) = (0.21 * time_s, 0.577 * time_s);
            let angle = 12.0 * phase.sin() + other.sin();
            let turn_rate = 12.0 * 0.21 * phase.cos() + 0.577 * other.cos();
            let friction = 1.0_f64.copysign(turn_rate);
            // The noise of the balance: a number that looks drawn.
            let noise = ((k * k * 7 + k * 131) % 97) as f64 / 97.0 - 0.5;
            let mut row = Balance {
                time_s,
                torque: 0.0,
                expected: friction + 0.6 * (0.9 * time_s).sin(),
                friction,
                coulomb: 1.0,
                turn_rate,
                angle,
                deviation: 0.01,
            };
            row.torque = row.expected + torque(&row) + 0.02 * noise;
            row
        };
        let trial = |from: usize| (from..from + 1500).map(row).collect::<Vec<_>>();
        analyse(1, &[trial(0), trial(4000)]).expect("analysed").says
    }

    #[test]
    fn what_goes_with_the_angle_is_said_once() {
        let says = said(|row| 0.3 * (2.0 * row.angle).sin() + 0.2 * (3.0 * row.angle).cos());
        let texts = says
            .iter()
            .filter(|text| text.contains("goes with the angle"));
        assert_eq!(texts.count(), 1, "{says:?}");
        assert!(
            says[0].matches("goes with the angle").count() == 1,
            "{says:?}"
        );
    }

    #[test]
    fn a_share_of_nothing_has_no_size() {
        let says = |share| moved(share, "fell", "rose");
        assert_eq!(says(-0.061), "fell by 6.1 %");
        assert_eq!(says(0.03), "rose by 3.0 %");
        assert_eq!(says(-0.1 / 0.0), "fell");
        assert_eq!(says(0.1 / 0.0), "rose");
        assert_eq!(says(f64::NAN), "changed");
    }
}
