//! A delay: of the command, or of the target against all inputs.

use crate::rig::{simulate, Excitation};
use residual::{analyse, spec::Spec, Data};
use residual_columns::stats::Rng;
use residual_effects::{effect, EffectKind};
use std::collections::VecDeque;

/// The acceleration is no role: the terms use it by its name in the log.
#[test]
fn of_the_target_delays_columns_that_are_no_roles() {
    let (runs, rows, dt, late) = (5, 1500, 0.02, 0.04);
    let mut rng = Rng::new(7);
    let at = |i: usize, shift: f64| {
        (
            (i % rows) as f64 * dt - shift,
            1.0 + 0.1 * (i / rows) as f64,
        )
    };
    let velocity = |(t, w): (f64, f64)| (2.1 * w * t).sin() + 0.5 * (5.3 * w * t).cos();
    let acc = |(t, w): (f64, f64)| 2.1 * w * (2.1 * w * t).cos() - 2.65 * w * (5.3 * w * t).sin();
    let all = 0..runs * rows;
    let target: Vec<f64> = all
        .clone()
        .map(|i| 0.4 * acc(at(i, late)) + 0.3 * velocity(at(i, late)) + 0.02 * rng.normal())
        .collect();
    let columns = [
        ("target", target),
        (
            "velocity",
            all.clone().map(|i| velocity(at(i, 0.0))).collect(),
        ),
        ("acc", all.clone().map(|i| acc(at(i, 0.0))).collect()),
    ];
    let time = all.map(|i| at(i, 0.0).0).collect();
    let data = Data::from_columns(time, columns)
        .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
        .build()
        .expect("the columns are whole");
    let model = Spec::parse(
        r#"
        roles.time = { column = "t", unit = "s" }
        roles.target = { column = "y", unit = "N" }
        roles.velocity = { column = "v", unit = "rad/s" }
        [[terms]]
        name = "inertia"
        expr = "acc"
        [[terms]]
        name = "damping"
        expr = "velocity"
    "#,
    );
    let report = analyse(&model.expect("the model is right"), data, &mut ()).expect("it runs");
    let found: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(found.first(), Some(&"delay"), "{}", report.markdown());
    let [low, high] = report.effects[0].ci["delay"];
    assert!(low < late && late < high, "{low} {high}");
}

#[test]
fn is_named() {
    let mut line = VecDeque::new();
    crate::rig::names("delay", move |s| {
        if s.first {
            line.clear();
        }
        line.push_back(s.command);
        if line.len() > 5 {
            line.pop_front();
        }
        line[0] - s.command
    });
}

/// In a closed loop the command is set anew with each row, and held: a straight line between rows
/// is then wrong, and a lag is nearer than a delay along it.
#[test]
fn of_a_held_command_is_named() {
    let (late, x) = (
        0.05,
        Excitation {
            closed: true,
            ..Excitation::default()
        },
    );
    let mut corrections = VecDeque::new();
    let report = simulate(&x, 1.0, &mut |s| {
        if s.first {
            corrections.clear();
        }
        corrections.push_front(s.command - s.command_at(s.elapsed));
        corrections.truncate(3);
        let correction = corrections.back().unwrap_or(&0.0);
        s.command_at(s.elapsed - late) + correction - s.command
    });
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["delay"], "{}", report.markdown());
    let own = &report.effects[0];
    assert!(own.form.contains("held"), "{}", report.markdown());
    assert!(report.others(own.name).is_empty(), "{}", report.markdown());
    assert!(
        (own.params["delay"] - late).abs() < 0.002,
        "{:?}",
        own.params
    );
}

/// Last value of the grid for a command with this angular frequency, in rows 0.02 s apart.
fn longest(w: f64) -> f64 {
    let command: Vec<f64> = (0..4000).map(|i| (w * 0.02 * i as f64).sin()).collect();
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                command = { column = \"c\" }\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n";
    let columns = [("target", command.clone()), ("command", command)];
    let mut out = 0.0;
    crate::rig::knowing(spec, &columns, 2000, |ctx| {
        let grid = effect(EffectKind::Delay).variants(ctx)[0]
            .psi
            .as_ref()
            .unwrap()
            .grid
            .clone();
        assert!(grid.windows(2).all(|g| g[0] < g[1]));
        assert_eq!(grid[0], -grid[grid.len() - 1]);
        out = grid[grid.len() - 1];
    });
    out
}

/// Rows may be close beside the motion: a delay of many rows is looked for then, and no lag takes
/// its place.
#[test]
fn the_longest_delay_goes_with_the_motion() {
    assert!((longest(8.0) - 0.64).abs() < 1e-9, "{}", longest(8.0));
    assert!((longest(1.0) - 3.0).abs() < 0.05, "{}", longest(1.0));
    // An eighth of the run at most.
    assert!((longest(0.1) - 5.0).abs() < 0.05, "{}", longest(0.1));
}

/// The direction of a motion shows where the velocity leaves its deadband, later than it begins.
#[test]
fn a_target_ahead_of_a_velocity_with_a_deadband_is_no_delay() {
    let rows = 500;
    let velocity: Vec<f64> = (0..rows).map(|i| (0.05 * i as f64).sin()).collect();
    let columns = [("target", velocity.clone()), ("velocity", velocity)];
    let refused = |deadband: &str, rows_late: f64| {
        let spec = format!(
            "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\" }}\n\
             velocity = {{ column = \"v\"{deadband} }}\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n"
        );
        let mut why = None;
        crate::rig::knowing(&spec, &columns, rows, |ctx| {
            let params = [residual::Param::new("delay", rows_late * ctx.dt, "s")];
            let estimate = residual_effects::Estimate {
                form: residual::Form::Other,
                label: "of the target against everything",
                params: &params,
                intervals: &Default::default(),
            };
            why = effect(EffectKind::Delay).impossible(&estimate, ctx);
        });
        why.is_some()
    };
    let deadband = ", deadband = 0.1";
    assert!(refused(deadband, -0.4) && !refused("", -0.4));
    assert!(!refused(deadband, 0.4) && refused("", -1.5));
}
