//! What acts in one log only, or from some time on: no name that every log would share is found.

use crate::noise::Noise;
use residual::{analyse, spec::Spec, Data, EffectKind, Report, Verdict};

const LOGS: usize = 5;
const ROWS: usize = 2500;

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
velocity = { column = "v", unit = "m/s", deadband = 0.05 }

[holdout]
block_s = 10.0

[[terms]]
name = "force"
expr = "command"
fixed = 1.0
"#;

/// The analysis of five logs of 50 s with noise of 0.05 N. `left` gets the log, the row's share of
/// it, the command and the velocity.
fn report(seed: u64, left: impl Fn(usize, f64, f64, f64) -> f64) -> Report {
    let mut noise = Noise(seed);
    let (mut time, mut command, mut velocity, mut target) = (vec![], vec![], vec![], vec![]);
    let mut group = vec![];
    for log in 0..LOGS {
        let p = 1.7 * (log as u64 + seed) as f64;
        for i in 0..ROWS {
            let t = 0.02 * i as f64;
            let c = 4.0 + (0.5 * t + p).sin() + 0.6 * (1.3 * t + 2.0 * p).sin();
            let v = (0.9 * t + p).sin() + 0.5 * (2.3 * t + 3.0 * p).sin();
            time.push(t);
            command.push(c);
            velocity.push(v);
            target.push(c + left(log, i as f64 / ROWS as f64, c, v) + 0.05 * noise.next());
            group.push(5 * log + 5 * i / ROWS);
        }
    }
    let columns = [
        ("command", command),
        ("velocity", velocity),
        ("target", target),
    ];
    let data = Data::from_columns(time, columns)
        .sequences((0..LOGS).map(|k| k * ROWS..(k + 1) * ROWS))
        .groups(group)
        .folds(10)
        .build()
        .expect("data");
    analyse(&Spec::parse(MODEL).expect("model"), data, &mut ()).expect("analysis")
}

type Left = fn(usize, f64, f64, f64) -> f64;

#[test]
fn what_acts_in_one_log_is_said_to() {
    let all: [(&str, Left); 4] = [
        ("offset", |log, _, _, _| if log == 1 { 0.05 } else { 0.0 }),
        (
            "gain",
            |log, _, c, _| if log == 1 { 0.06 * (c - 4.0) } else { 0.0 },
        ),
        (
            "damping",
            |log, _, _, v| if log == 1 { 0.05 * v } else { 0.0 },
        ),
        ("dry friction", |log, _, _, v| {
            if log == 1 {
                0.05 * v.signum()
            } else {
                0.0
            }
        }),
    ];
    for (seed, (name, left)) in (3..).zip(all) {
        let report = report(seed, left);
        let text = report.markdown();
        let said = format!("sequence 2 of 5 alone has another {name} (");
        assert!(text.contains(&said), "{said}: {text}");
        assert_eq!(report.verdict, Verdict::Unknown, "{text}");
    }
}

/// The friction of one log, spread over all of them, is none of theirs.
#[test]
fn friction_of_one_log_is_not_found_in_all() {
    let report = report(
        40,
        |log, _, c, v| {
            if log == 1 {
                0.04 * c * v.signum()
            } else {
                0.0
            }
        },
    );
    let text = report.markdown();
    assert_eq!(report.verdict, Verdict::Unknown, "{text}");
    assert!(report.effects.is_empty(), "{text}");
    assert!(text.contains("alone: there it is"), "{text}");
    // In all logs it is one.
    let everywhere = self::report(40, |_, _, c, v| 0.04 * c * v.signum());
    assert_eq!(everywhere.effects[0].name, EffectKind::LoadDependentCoulomb);
}

/// Zeros that differ from log to log are usual.
#[test]
fn zeros_that_all_differ_are_not_those_of_one_log() {
    for seed in 0..4 {
        let mut noise = Noise(100 + seed);
        let zeros: Vec<f64> = (0..LOGS).map(|_| 0.01 * noise.next()).collect();
        let report = report(seed, |log, _, _, _| zeros[log]);
        assert_eq!(report.verdict, Verdict::None, "{}", report.markdown());
    }
}

/// An error of gain from the middle of each log on grows with time on the whole.
#[test]
fn what_begins_within_a_log_is_no_drift() {
    let all: [Left; 3] = [
        |_, share, c, _| if share > 0.5 { 0.02 * c } else { 0.0 },
        |_, share, _, _| if share > 0.62 { 0.1 } else { 0.0 },
        |_, share, c, _| if share > 0.3 { 0.03 * c } else { 0.0 },
    ];
    for (seed, left) in (20..).zip(all) {
        let report = report(seed, left);
        let text = report.markdown();
        assert_eq!(report.verdict, Verdict::Unknown, "{text}");
        let drift = |e: &residual::Effect| e.name == EffectKind::DriftTime;
        assert!(!report.effects.iter().any(drift), "{text}");
    }
    // A drift is one.
    let report = report(30, |_, share, _, _| 0.15 * share);
    assert_eq!(report.verdict, Verdict::Effect, "{}", report.markdown());
    assert_eq!(report.effects[0].name, EffectKind::DriftTime);
}
