//! Zeros that wander: over a few logs a wander can look like a creep or a warming.

use crate::noise::Noise;
use residual::{analyse, spec::Spec, Data, Report};

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
temperature = { column = "degrees", unit = "degC" }

[selection]
only = ["creep", "drift_time", "drift_temperature"]

[[terms]]
name = "force"
expr = "command"
unit = "-"

[[terms]]
name = "zero"
expr = "1"
unit = "N"
"#;

/// Memories of the parts of the wander in rows, a factor of four apart: together a noise of 1/f.
const MEMORIES: [f64; 6] = [4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0];

/// The load of a log over time.
type Load = fn(u32, f64) -> f64;

/// One step in every second log.
fn few_steps(log: u32, t: f64) -> f64 {
    if log.is_multiple_of(2) && t > 20.0 {
        1.0
    } else {
        4.0
    }
}

/// Steps up and down, every 15 s.
fn steps(log: u32, t: f64) -> f64 {
    if (t / 15.0 + 0.4 * f64::from(log)) % 2.0 < 1.0 {
        1.0
    } else {
        4.0
    }
}

/// The analysis of four logs with a warming of their own and a zero that wanders by `wander`; a
/// share of `creep` of the load is slow, with a time constant of 10 s.
fn report(load: Load, wander: f64, creep: f64, seed: u64) -> Report {
    let mut noise = Noise(seed.wrapping_mul(77) + 5);
    let mut columns = [const { Vec::new() }; 4];
    let mut sequences = vec![];
    for log in 0..4 {
        let mut parts: [f64; 6] = std::array::from_fn(|_| noise.next());
        let start = columns[0].len();
        let mut slow = None;
        for i in 0..1200 {
            let t = 0.05 * f64::from(i);
            let c = load(log, t);
            let before = slow.unwrap_or(c);
            slow = Some(before + (c - before) * 0.05 / 10.0);
            for (part, memory) in parts.iter_mut().zip(MEMORIES) {
                let keep = (-1.0 / memory).exp();
                *part = keep * *part + (1.0 - keep * keep).sqrt() * noise.next();
            }
            let zero = wander * parts.iter().sum::<f64>() / 6f64.sqrt();
            let y = c + zero + creep * (before - c) + 0.1 * noise.next();
            let degrees = 25.0 + f64::from(log) * (1.0 - (-t / 20.0).exp());
            columns
                .iter_mut()
                .zip([t, y, c, degrees])
                .for_each(|(c, v)| c.push(v));
        }
        sequences.push(start..columns[0].len());
    }
    let [time, target, command, temperature] = columns;
    let named = [
        ("target", target),
        ("command", command),
        ("temperature", temperature),
    ];
    let data = Data::from_columns(time, named).sequences(sequences).build();
    analyse(&Spec::parse(MODEL).unwrap(), data.unwrap(), &mut ()).unwrap()
}

#[test]
fn a_wander_is_given_no_name_and_is_said() {
    let (mut named, mut said) = (0, 0);
    for seed in 0..40 {
        let report = report(few_steps, 0.1, 0.0, seed);
        named += report.effects.len() + report.improves.len();
        let mut words = report.structure.iter().map(|s| s.depends_on.as_str());
        said += usize::from(words.any(|w| w.contains("a slow wander")));
    }
    assert!(named <= 2, "{named} in 40");
    assert!(said >= 2, "{said} of 40");
}

#[test]
fn a_creep_above_the_wander_is_found() {
    for seed in 0..10 {
        let report = report(steps, 0.05, 0.15, seed);
        let names: Vec<String> = report.effects.iter().map(|e| e.name.to_string()).collect();
        assert_eq!(names, ["creep"], "{seed}: {:?}", report.verdict);
    }
}
