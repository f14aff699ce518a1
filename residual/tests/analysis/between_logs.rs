//! Effects that differ from log to log: a log is one observation of them, however long it is.

use crate::noise::Noise;
use residual::{analyse, spec::Spec, Data, Report, Verdict};

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
velocity = { column = "v", unit = "m/s" }
temperature = { column = "degrees", unit = "degC" }

[holdout]
block_s = 1.0

[selection]
only = ["offset", "gain", "quadratic", "quantisation", "coulomb", "drift_temperature"]

[[terms]]
name = "force"
expr = "command"
fixed = 1.0
"#;

/// How logs are made.
#[derive(Clone, Copy)]
struct Logs {
    /// Rows of each.
    rows: &'static [u32],
    /// Newtons per kelvin.
    drift: f64,
    /// Kelvins by which the temperature rises within a log.
    rise: f64,
    /// Scatter of the zero from log to log, in newtons.
    zeros: f64,
    /// Whether the model has an offset and a gain of its own.
    declared: bool,
    /// Whether the load is the same on all rows of a log.
    constant: bool,
}

const LOGS: Logs = Logs {
    rows: &[400; 5],
    drift: 0.0,
    rise: 0.1,
    zeros: 0.06,
    declared: false,
    constant: false,
};

/// The analysis of logs with noise of 0.1 N whose temperatures lie between 15 and 35 degrees.
fn report(logs: Logs, seed: u64) -> Report {
    let mut noise = Noise(seed.wrapping_mul(77) + 5);
    let mut columns = [const { Vec::new() }; 5];
    let mut sequences = vec![];
    for (log, rows) in (0u32..).zip(logs.rows) {
        let (zero, phase) = (logs.zeros * noise.next(), noise.next());
        let degrees = 25.0 + 5.0 * noise.next().clamp(-2.0, 2.0);
        let level = 4.0 + 1.5 * noise.next();
        let start = columns[0].len();
        for i in 0..*rows {
            let t = 0.05 * f64::from(i);
            let moving = 4.0 + (1.1 * t + phase).sin() + 0.5 * (3.3 * t + f64::from(log)).cos();
            let c = if logs.constant { level } else { moving };
            let now = degrees + logs.rise * f64::from(i) / f64::from(*rows);
            let y = c + zero + logs.drift * (now - 25.0) + 0.1 * noise.next();
            let row = [t, y, c, (0.9 * t - phase).sin(), now];
            columns.iter_mut().zip(row).for_each(|(c, v)| c.push(v));
        }
        sequences.push(start..columns[0].len());
    }
    let [time, target, command, velocity, temperature] = columns;
    let named = [
        ("target", target),
        ("command", command),
        ("velocity", velocity),
        ("temperature", temperature),
    ];
    let data = Data::from_columns(time, named).sequences(sequences).build();
    let mut model = MODEL.to_owned();
    if logs.declared {
        model = model.replace("fixed = 1.0\n", "");
        model += "[[terms]]\nname = \"zero\"\nexpr = \"1\"\nunit = \"N\"\n";
    }
    analyse(&Spec::parse(&model).unwrap(), data.unwrap(), &mut ()).unwrap()
}

/// Names found in the logs of twenty seeds.
fn found(logs: Logs) -> Vec<String> {
    (0..20)
        .flat_map(|seed| report(logs, seed).effects)
        .map(|e| e.name.to_string())
        .collect()
}

#[test]
fn zeros_that_differ_by_chance_are_no_drift() {
    let names = found(LOGS);
    assert!(names.len() <= 1, "{names:?}");
}

#[test]
fn parameters_of_the_declared_model_count() {
    for constant in [false, true] {
        let logs = Logs {
            rows: &[400; 4],
            declared: true,
            constant,
            ..LOGS
        };
        let names = found(logs);
        assert!(names.len() <= 1, "{constant}: {names:?}");
    }
}

#[test]
fn short_logs_beside_a_long_one_are_no_proof() {
    let logs = Logs {
        rows: &[4000, 400, 400, 400, 400],
        ..LOGS
    };
    let names = found(logs);
    assert!(names.len() <= 1, "{names:?}");
}

#[test]
fn a_drift_that_many_logs_show_is_found() {
    let logs = Logs {
        rows: &[400; 8],
        drift: 0.03,
        zeros: 0.01,
        ..LOGS
    };
    for seed in 0..4 {
        let report = report(logs, seed);
        assert_eq!(report.verdict, Verdict::Effect, "{seed}");
        assert_eq!(report.effects[0].name, "drift_temperature", "{seed}");
    }
}

#[test]
fn a_drift_that_each_of_three_logs_shows_is_found() {
    let logs = Logs {
        rows: &[800; 3],
        drift: 0.03,
        rise: 6.0,
        zeros: 0.01,
        ..LOGS
    };
    for seed in 0..4 {
        let report = report(logs, seed);
        assert!(
            report.effects.iter().any(|e| e.name == "drift_temperature"),
            "{seed}: {:?}",
            report.verdict
        );
    }
}

#[test]
fn what_three_logs_cannot_tell_is_said() {
    let logs = Logs {
        rows: &[400; 3],
        drift: 0.03,
        zeros: 0.02,
        ..LOGS
    };
    let mut said = 0;
    for seed in 0..10 {
        let report = report(logs, seed);
        let words = report.structure.iter().map(|s| s.depends_on.as_str());
        let refused = words.clone().any(|w| w.contains("too few sequences"));
        assert!(report.verdict != Verdict::None || !refused || report.structure[0].gain < 0.1);
        said += usize::from(refused && report.verdict == Verdict::Unknown);
    }
    assert!(said >= 5, "{said} of 10");
}
