//! A mass that the model does not know: its weight and its inertia belong together.

use crate::rig::{knowing, names_with, Excitation};
use residual_effects::Form;
use residual_effects::*;

/// Standard gravity in m/s^2.
const G: f64 = 9.80665;

/// A motion of `size` about zero, with the target in `unit`.
fn moved(unit: &str, velocity: &str, size: f64, look: impl FnOnce(&Context)) {
    let of =
        |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..1200).map(|i| f(0.02 * i as f64)).collect() };
    let columns = [
        ("target", of(&|t| (0.7 * t).sin())),
        ("command", of(&|t| (0.7 * t).cos())),
        ("angle", of(&|t| size * (3.0 * t).sin())),
        ("velocity", of(&|t| size * 3.0 * (3.0 * t).cos())),
    ];
    let spec = format!(
        "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"{unit}\" }}\n\
         command = {{ column = \"c\", unit = \"{unit}\" }}\nvelocity = {{ column = \"v\", unit = \"{velocity}\" }}\n\
         angle = {{ column = \"a\", unit = \"rad\" }}\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n"
    );
    knowing(&spec, &columns, 600, look);
}

#[test]
fn a_mass_in_kg_needs_a_force() {
    let first = |unit: &str| {
        let mut out = None;
        moved(unit, "m/s", 1.0, |ctx| {
            let forms = effect(EffectKind::Payload).variants(ctx);
            let own = forms.iter().find(|f| f.label == "hanging mass").unwrap();
            out = own.params(2.0, &[1.0]).pop();
        });
        let own = out.unwrap();
        (own.name, own.unit)
    };
    assert_eq!(first("N"), ("mass".into(), "kg".into()));
    assert_eq!(first("A"), ("inertia".into(), "A/(m/s/s)".into()));
}

#[test]
fn a_mass_on_a_short_arc_is_like_any_parabola() {
    let impossible = |size: f64| {
        let mut out = None;
        moved("N", "rad/s", size, |ctx| {
            let estimate = Estimate {
                form: Form::Other,
                label: "mass on angle",
                params: &[],
                intervals: &Default::default(),
            };
            out = effect(EffectKind::Payload).impossible(&estimate, ctx);
        });
        out.is_some()
    };
    assert!(impossible(0.33) && !impossible(1.0));
}

/// A mass at the end of an arm of two links, beside a model whose coefficients are those of the arm
/// without it. Each part of it looks like a larger gain.
#[test]
fn is_named_at_the_end_of_an_arm() {
    let report = carried(0.3);
    let first = report.effects.first().expect("an effect");
    let own = (first.name.as_str(), first.form.as_str());
    let expected = ("payload", "mass on angle and angle + q2");
    assert_eq!(own, expected, "{}", report.markdown());
    assert_eq!(report.effects.len(), 1, "{}", report.markdown());
    let near = |name: &str, value: f64| {
        let found = first.params[name];
        assert!((found - value).abs() < 0.1 * value, "{name} {found}");
    };
    near("weight_sine", 0.3 * G * 0.4);
    near("outer_weight_sine", 0.3 * G * 0.3);
}

/// An arm with links of 0.4 and 0.3 m that carries this mass in kg.
fn carried(mass: f64) -> residual::Report {
    use residual::{analyse, spec::Spec, Data};
    use residual_columns::stats::Rng;
    let (runs, rows, dt) = (4, 2000, 0.01);
    let mut rng = Rng::new(9);
    // A sum of sines with its first two derivatives.
    let motion = |parts: [(f64, f64, f64); 2], t: f64| {
        parts.iter().fold([0.0; 3], |[x, v, a], (size, w, phase)| {
            let (s, c) = (w * t + phase).sin_cos();
            [x + size * s, v + size * w * c, a - size * w * w * s]
        })
    };
    let mut columns: Vec<(&str, Vec<f64>)> = ["target", "angle", "velocity", "q2", "a1", "a12"]
        .map(|n| (n, vec![]))
        .into();
    for i in 0..runs * rows {
        let (run, t) = ((i / rows) as f64, (i % rows) as f64 * dt);
        let [q1, v1, a1] = motion([(0.8, 0.5, run), (0.4, 1.3, 2.0 * run)], t);
        let [q2, _, a2] = motion([(0.7, 0.8, 2.0 * run), (0.3, 1.9, run + 1.6)], t);
        let (w1, w12, a12) = (q1.sin(), (q1 + q2).sin(), a1 + a2);
        let arm = 4.0 * w1 + 1.5 * w12 + 0.6 * a1 + 0.2 * a12;
        let load = G * (0.4 * w1 + 0.3 * w12) + 0.16 * a1 + 0.09 * a12;
        let target = arm + mass * load + 0.05 * rng.normal();
        let row = [target, q1, v1, q2, a1, a12];
        columns
            .iter_mut()
            .zip(row)
            .for_each(|((_, c), x)| c.push(x));
    }
    let data = Data::from_columns(
        (0..runs * rows).map(|i| (i % rows) as f64 * dt).collect(),
        columns,
    )
    .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
    .build()
    .unwrap();
    let term = |expr: &str, fixed: f64| {
        format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\nfixed = {fixed}\n")
    };
    let model = format!(
        "roles.time = {{ column = \"t\", unit = \"s\" }}\n\
         roles.target = {{ column = \"y\", unit = \"N·m\" }}\n\
         roles.velocity = {{ column = \"v\", unit = \"rad/s\", deadband = 0.01 }}\n\
         roles.angle = {{ column = \"a\", unit = \"rad\" }}\n\
         roles.pose.q2 = {{ column = \"q2\", unit = \"rad\" }}\n{}{}{}{}",
        term("sin(angle)", 4.0),
        term("sin(angle + q2)", 1.5),
        term("a1", 0.6),
        term("a12", 0.2),
    );
    analyse(&Spec::parse(&model).unwrap(), data, &mut ()).unwrap()
}

#[test]
fn is_named() {
    names_with(
        "payload",
        Excitation {
            metres: true,
            ..Excitation::default()
        },
        |s| 0.06 * (9.80665 + s.acceleration),
    );
}

/// A ripple of another order beside an inertia has the shape of a payload over a part of a turn.
#[test]
fn a_ripple_over_a_part_of_a_turn_may_stand_for_it() {
    let only = ["payload", "periodic_angle"];
    let names = |order: f64| {
        super::gravity_angle::others(EffectKind::Payload, &only, "expr = \"1\"", |s| {
            (order * s.angle + 0.6).sin() + 0.5 * s.acceleration
        })
    };
    assert!(names(1.0).is_empty());
    for order in [1.4, 1.6] {
        assert!(names(order).contains(&EffectKind::PeriodicAngle), "{order}");
    }
}
