//! Terms with a coefficient for each sequence: they stay in the table, and nothing that they
//! explain is found again.

use crate::noise::Noise;
use residual::{analyse, spec::Spec, Data, Verdict};

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
velocity = { column = "v", unit = "m/s" }

[selection]
only = ["offset", "gain", "quadratic", "coulomb", "viscous", "drift_time", "creep"]

[[terms]]
name = "force"
expr = "command"
fixed = 1.0

[[terms]]
name = "zero of the run"
expr = "1"
unit = "N"
per = "sequence"
"#;

/// Eight runs, each with a zero of its own, and an offset that all of them have; coloured noise of
/// 0.1 N.
fn data(seed: u64, offset: f64) -> Data {
    let mut noise = Noise(seed.wrapping_mul(77) + 5);
    let (mut time, mut command, mut velocity, mut target) = (vec![], vec![], vec![], vec![]);
    for run in 0..8 {
        let zero = 0.5 * noise.next();
        let (phase, mut colour) = (noise.next(), 0.0);
        for i in 0..300 {
            let t = 0.02 * f64::from(i);
            colour = 0.8 * colour + 0.6 * noise.next();
            let c = 4.0 + (1.1 * t + phase).sin() + 0.5 * (3.3 * t + f64::from(run)).cos();
            time.push(t);
            command.push(c);
            velocity.push((0.9 * t - phase).sin());
            target.push(c + zero + offset + 0.1 * colour);
        }
    }
    Data::from_columns(
        time,
        [
            ("command", command),
            ("velocity", velocity),
            ("target", target),
        ],
    )
    .sequences((0..8).map(|run| 300 * run..300 * (run + 1)))
    .build()
    .expect("the columns fit")
}

/// The runs' zeros contain every offset.
#[test]
fn forty_empty_sets_have_no_offset() {
    let model = Spec::parse(MODEL).expect("the model is read");
    for seed in 0..40 {
        let offset = if seed % 2 == 0 { 0.0 } else { 0.7 };
        let report = analyse(&model, data(seed, offset), &mut ()).expect("can be analysed");
        assert_eq!(
            report.verdict,
            Verdict::None,
            "seed {seed}: {}",
            report.summary()
        );
        assert!(
            report.improves.is_empty(),
            "seed {seed}: {}",
            report.summary()
        );
        assert!(
            report.declared.iter().any(|t| t.name == "zero of the run"),
            "the term is in the table"
        );
    }
}
