//! Verdicts on what is left where no effect is named.

use crate::noise::Noise;
use crate::rig::{simulate, Excitation};
use residual::{analyse, spec::Spec, Data, Report, Verdict};

const ROWS: usize = 1500;
const LOGS: usize = 4;

/// The analysis of four logs of 30 s with a command between 1 and 5 N. `left` gets the row in the
/// log, the command and the noise.
fn report(selection: &str, mut left: impl FnMut(usize, f64, &mut Noise) -> f64) -> Report {
    let model = format!(
        r#"
[roles]
time = {{ column = "t", unit = "s" }}
target = {{ column = "y", unit = "N" }}
command = {{ column = "c", unit = "N" }}

[selection]
{selection}

[[terms]]
name = "force"
expr = "command"

[[terms]]
name = "zero"
expr = "1"
"#
    );
    let mut noise = Noise(71);
    let (mut time, mut command, mut target) = (vec![], vec![], vec![]);
    for log in 0..LOGS {
        for i in 0..ROWS {
            let t = 0.02 * i as f64;
            let p = log as f64;
            let c = 3.0 + (0.7 * t + p).sin() + (1.9 * t + 2.0 * p).sin();
            time.push(t);
            command.push(c);
            target.push(c + left(i, c, &mut noise));
        }
    }
    let data = Data::from_columns(time, [("command", command), ("target", target)])
        .sequences((0..LOGS).map(|k| k * ROWS..(k + 1) * ROWS))
        .build()
        .expect("data");
    let model = Spec::parse(&model).expect("model");
    analyse(&model, data, &mut ()).expect("analysis")
}

/// A square of the load that the search was not allowed to name is not nothing.
#[test]
fn a_limited_search_does_not_say_that_nothing_is_missing() {
    let report = report("max_effects = 0", |_, c, noise| {
        0.05 * c * c + 0.05 * noise.next()
    });
    assert!(report.limited.is_some());
    assert_eq!(report.verdict, Verdict::Unknown);
    let summary = report.summary();
    assert!(
        summary.contains("not allowed to look further (max_effects = 0)"),
        "{summary}"
    );
    assert!(!summary.contains("Nothing material"), "{summary}");
    assert!(report.baseline.heldout_rmse > 0.0);
}

/// What arithmetic leaves behind a model that fits exactly is nothing, and has no structure.
#[test]
fn a_log_without_noise_lacks_nothing() {
    type Left = fn(usize, f64) -> f64;
    let exact: [Left; 4] = [
        |_, _| 0.0,
        |_, _| 0.2,
        |_, c| 0.37 * c - 1.3,
        |_, c| f64::from((1.7 * c) as f32) - c,
    ];
    for (k, left) in exact.into_iter().enumerate() {
        let report = report("", |i, c, _| left(i, c));
        assert_eq!(report.verdict, Verdict::None, "{k}: {}", report.summary());
    }
}

/// Six periods over the range of the load: no effect of the catalogue, and too fine for a curve
/// with few knots.
#[test]
fn fine_structure_in_the_load_is_unknown() {
    let report = report("", |_, c, noise| {
        0.14 * (std::f64::consts::TAU * 1.5 * c).sin() + 0.1 * noise.next()
    });
    assert!(report.effects.is_empty(), "{}", report.markdown());
    assert_eq!(report.verdict, Verdict::Unknown, "{}", report.markdown());
}

/// Coloured noise is noise; that it is not white is said. Noise that grows with the load is noted.
#[test]
fn noise_is_none_and_its_colour_and_growth_are_told() {
    let mut x = 0.0;
    let coloured = report("", |_, _, noise| {
        x = 0.8 * x + 0.1 * noise.next();
        x
    });
    assert_eq!(coloured.verdict, Verdict::None, "{}", coloured.markdown());
    assert!(coloured.summary().contains("not white"));
    let growing = report("", |_, c, noise| 0.05 * (c - 0.8) * noise.next());
    assert_eq!(growing.verdict, Verdict::None, "{}", growing.markdown());
    assert!(!growing.summary().contains("not white"));
    let note = growing.hygiene.iter().find(|f| f.check == "noise");
    assert!(note.is_some_and(|f| f.what.contains("grows with the load")));
}

/// Friction that falls after each start is in no catalogue. Beside it a share of the load is better
/// than plain friction by less than what is left: these data do not tell the two.
#[test]
fn a_name_that_is_better_by_less_than_what_is_left_is_not_told_from_a_simpler_one() {
    let after_start = |size: f64| {
        let stops = Excitation {
            stops: true,
            ..Excitation::default()
        };
        let (mut since, mut moving) = (0.0, false);
        let report = simulate(&stops, 1.0, &mut |s| {
            if s.first || (s.velocity != 0.0) != moving {
                (since, moving) = (0.0, s.velocity != 0.0);
            }
            since += s.dt;
            let friction = 0.5 + 0.07 * s.command + size * f64::exp(-since / 0.3);
            if moving {
                -s.velocity.signum() * friction
            } else {
                0.0
            }
        });
        let name = report.effects[0].name.as_str();
        assert_eq!(name, "load_dependent_coulomb", "{}", report.summary());
        report
    };
    let report = after_start(1.0);
    let groups: Vec<Vec<&str>> = (report.not_identifiable.iter())
        .map(|group| group.effects.iter().map(|e| e.as_str()).collect())
        .collect();
    let behind = report.effects[0].rival.as_ref().unwrap().behind;
    assert!(behind < report.structure[0].gain, "{}", report.summary());
    assert_eq!(groups, [["load_dependent_coulomb", "coulomb"]]);
    // Without it nothing is left, and the share is certain.
    let report = after_start(0.0);
    assert!(report.not_identifiable.is_empty(), "{}", report.summary());
}
