//! Elasticity in series: the cable stretches before it pulls.

use crate::noise::Noise;
use crate::rig::{knowing, simulate, Excitation};
use residual::spec::Spec;
use residual::{analyse, Data};
use residual_effects::*;

/// Spring in a model of a motion with this amplitude in rad, the speed counted along the angle or
/// against it: the term, and why it cannot be.
fn spring(amplitude: f64, along: f64) -> (String, Option<String>) {
    let of =
        |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..1200).map(|i| f(0.02 * i as f64)).collect() };
    let columns = [
        ("target", of(&|t| (0.7 * t).sin())),
        (
            "velocity",
            of(&|t| along * amplitude * 0.7 * (0.7 * t).cos()),
        ),
        ("angle", of(&|t| amplitude * (0.7 * t).sin())),
    ];
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                velocity = { column = \"v\", unit = \"rad/s\" }\nangle = { column = \"a\", unit = \"rad\" }\n\
                [[terms]]\nname = \"a\"\nexpr = \"1\"\n";
    let mut out = (String::new(), None);
    knowing(spec, &columns, 600, |ctx| {
        let form = &effect(EffectKind::CableStretch).variants(ctx)[0];
        let Build::Add(pieces) = (form.build)(0.0) else {
            panic!("a spring adds a term");
        };
        let estimate = Estimate {
            form: Form::Other,
            label: &form.label,
            params: &form.params(0.0, &[1.0]),
            intervals: &Default::default(),
        };
        out = (
            pieces[0].text.clone(),
            effect(EffectKind::CableStretch).impossible(&estimate, ctx),
        );
    });
    out
}

#[test]
fn a_spring_is_not_wound_over_many_turns() {
    assert_eq!(spring(3.0, 1.0), ("angle".into(), None));
    let why = spring(100.0, 1.0).1.unwrap();
    assert!(why.contains("turns"), "{why}");
}

#[test]
fn a_stiffness_has_the_direction_of_the_velocity() {
    assert_eq!(spring(3.0, -1.0).0, "-1 * angle");
}

#[test]
fn is_named() {
    let mut y = 0.0;
    crate::rig::names("cable_stretch", move |s| {
        if s.first {
            y = s.command;
        }
        y += (s.command - y) * (1.0 - (-s.dt / 0.15f64).exp());
        y - s.command
    });
}

/// In a closed loop the command is set anew with each row, and held until the next.
#[test]
fn of_a_held_command_is_named() {
    let (tau, x) = (
        0.05,
        Excitation {
            closed: true,
            ..Excitation::default()
        },
    );
    let mut y = 0.0;
    let report = simulate(&x, 1.0, &mut |s| {
        let correction = s.command - s.command_at(s.elapsed);
        if s.first {
            y = s.command;
        }
        let steps = 20;
        for k in (0..steps).rev() {
            let ago = s.dt * f64::from(k) / f64::from(steps);
            let command = s.command_at(s.elapsed - ago) + correction;
            y += (command - y) * (1.0 - (-s.dt / f64::from(steps) / tau).exp());
        }
        y - s.command
    });
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["cable_stretch"], "{}", report.markdown());
    let own = &report.effects[0];
    assert!(own.form.contains("held"), "{}", report.markdown());
    assert!(report.others(own.name).is_empty(), "{}", report.markdown());
    assert!(
        (own.params["time_constant"] - tau).abs() < 0.003,
        "{:?}",
        own.params
    );
}

/// Rows may be close beside the motion: a lag of hundreds of rows is looked for then, and no creep
/// takes its place.
#[test]
fn the_longest_lag_goes_with_the_motion() {
    let longest = |w: f64| {
        let command: Vec<f64> = (0..12_000).map(|i| (w * 0.02 * i as f64).sin()).collect();
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    command = { column = \"c\" }\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n";
        let columns = [("target", command.clone()), ("command", command)];
        let mut out = 0.0;
        knowing(spec, &columns, 6000, |ctx| {
            let forms = effect(EffectKind::CableStretch).variants(ctx);
            out = forms[0]
                .psi
                .as_ref()
                .unwrap()
                .grid
                .iter()
                .copied()
                .fold(0.0, f64::max);
        });
        out
    };
    assert!((longest(20.0) - 1.2).abs() < 1e-9, "{}", longest(20.0));
    assert!((longest(1.0) - 10.0).abs() < 0.1, "{}", longest(1.0));
    assert!((longest(0.1) - 30.0).abs() < 0.1, "{}", longest(0.1));
}

#[test]
fn over_a_short_arc_a_spring_may_be_a_weight() {
    for (label, twin) in [
        ("spring", None),
        ("spring over a short arc", Some(EffectKind::GravityAngle)),
        ("lag of the command", None),
    ] {
        assert_eq!(effect(EffectKind::CableStretch).twin(label), twin);
    }
    let label = |amplitude: f64| {
        let angle: Vec<f64> = (0..1200)
            .map(|i| amplitude * (0.014 * i as f64).sin())
            .collect();
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    angle = { column = \"a\", unit = \"rad\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let columns = [("target", angle.clone()), ("angle", angle)];
        let mut out = String::new();
        knowing(spec, &columns, 600, |ctx| {
            out.clone_from(&effect(EffectKind::CableStretch).variants(ctx)[0].label);
        });
        out
    };
    assert_eq!(
        (label(0.3), label(2.0)),
        ("spring over a short arc".into(), "spring".into())
    );
}

/// A declared weight depends on the same angle, and is no reason not to look for a spring.
#[test]
fn a_spring_is_found_beside_a_declared_weight() {
    let model = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N m" }
command = { column = "c", unit = "N m" }
angle = { column = "q", unit = "rad" }

[[terms]]
name = "torque"
expr = "command"

[[terms]]
name = "weight"
expr = "sin(angle)"
"#;
    const ROWS: usize = 1500;
    let mut noise = Noise(5);
    let (mut time, mut command, mut angle, mut target) = (vec![], vec![], vec![], vec![]);
    for log in 0..4 {
        for i in 0..ROWS {
            let (t, p) = (0.02 * i as f64, f64::from(log));
            let c = 2.0 + (0.7 * t + p).sin() + (1.9 * t + 2.0 * p).sin();
            let q = 1.1 * (0.45 * t + 2.0 * p).sin() + 0.7 * (1.3 * t + p).sin();
            time.push(t);
            command.push(c);
            angle.push(q);
            target.push(c - 1.5 * q.sin() - 0.4 * q + 0.1 * noise.next());
        }
    }
    let columns = [("command", command), ("angle", angle), ("target", target)];
    let data = Data::from_columns(time, columns)
        .sequences((0..4).map(|k| k * ROWS..(k + 1) * ROWS))
        .build()
        .expect("data");
    let spec = Spec::parse(model).expect("model");
    let report = analyse(&spec, data, &mut ()).expect("analysis");
    let [found] = report.effects.as_slice() else {
        panic!("{}", report.summary());
    };
    assert_eq!(found.name, "cable_stretch", "{}", report.summary());
    let stiffness = found.params["stiffness"];
    assert!((stiffness + 0.4).abs() < 0.02, "{stiffness}");
}
