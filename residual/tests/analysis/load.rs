//! The load with the coefficients of the model that was found.

use crate::rig::{simulate, Excitation};
use residual::{analyse, spec::Spec, Data};
use residual_columns::stats::Rng;

/// A limit of the command makes the first gain too small, and a friction per load that is built on
/// it too large.
#[test]
fn friction_per_load_is_not_biased_by_a_limit() {
    let (runs, rows, dt) = (5, 1200, 0.02);
    let mut rng = Rng::new(11);
    let at = |i: usize| (i % rows) as f64 * dt + 7.3 * (i / rows) as f64;
    let of = |f: &dyn Fn(f64) -> f64| (0..runs * rows).map(|i| f(at(i))).collect::<Vec<f64>>();
    let command = of(&|t| 0.5 + 0.3 * (0.9 * t).sin() + 0.2 * (2.3 * t).cos());
    let velocity = of(&|t| (0.7 * t).cos() + 0.6 * (1.9 * t).sin());
    let target = command
        .iter()
        .zip(&velocity)
        .map(|(c, v)| 20.0 * c.min(0.6) - 0.15 * 20.0 * c * v.signum() + 0.3 * rng.normal())
        .collect();
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N\" }\n\
         roles.command = { column = \"u\", unit = \"A\" }\n\
         roles.velocity = { column = \"v\", unit = \"m/s\" }\n\
         [[terms]]\nname = \"force per current\"\nexpr = \"command\"\n";
    let data = Data::from_columns(
        (0..runs * rows).map(|i| (i % rows) as f64 * dt).collect(),
        [
            ("command", command),
            ("velocity", velocity),
            ("target", target),
        ],
    )
    .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
    .build()
    .unwrap();
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let friction = report
        .effects
        .iter()
        .find(|e| e.name == "load_dependent_coulomb")
        .unwrap_or_else(|| panic!("{}", report.markdown()));
    let share = friction.params["friction_per_load"];
    assert!((share + 0.15).abs() < 0.003, "{share}");
}

/// What a gain adds to a late command is as late: an interval of the delay that leaves that out
/// misses the truth. Where the delay is short both ways predict the same, and a delay beside a gain
/// of the load before it would be off by the error of gain.
#[test]
fn a_gain_beside_a_late_command_is_as_late() {
    for (late, gain) in [(0.2, 0.3), (0.04, 0.1)] {
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            (1.0 + gain) * s.command_at(s.elapsed - late) - s.command
        });
        let mut names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["delay", "gain"], "{}", report.markdown());
        for (effect, name, truth) in [("delay", "delay", late), ("gain", "gain_error", gain)] {
            let own = report.effects.iter().find(|e| e.name == effect).unwrap();
            let [low, high] = own.ci[name];
            assert!(low < truth && truth < high, "{name} {low} {high}");
        }
    }
}
