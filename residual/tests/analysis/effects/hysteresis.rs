//! A loop with memory of the path, over a good part of the range.

use crate::rig::{knowing, simulate, Excitation};
use residual::{Form, Param};
use residual_effects::*;

/// Loads far apart from run to run: within a run no loop can turn over the distance between them.
#[test]
fn a_loop_turns_within_a_run() {
    let (runs, rows) = (4, 300);
    let of = |f: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
        (0..runs * rows)
            .map(|i| f(i / rows, 0.02 * (i % rows) as f64))
            .collect()
    };
    let command = of(&|run, t| 100.0 * run as f64 + 5.0 * (3.0 * t).sin());
    let target = of(&|run, t| 101.0 * run as f64 + 5.0 * (3.0 * t).sin());
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                command = { column = \"c\", unit = \"N\" }\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n";
    knowing(
        spec,
        &[("target", target), ("command", command)],
        rows,
        |ctx| {
            let forms = effect(EffectKind::Hysteresis).variants(ctx);
            let widths = &forms[0].psi.as_ref().unwrap().grid;
            assert!(widths.iter().all(|w| *w < 8.1), "{widths:?}");
            let holds = forms[0].possible.as_ref().unwrap();
            assert!(holds(7.0, &[1.0]) && !holds(95.0, &[1.0]));
            let width = |value| {
                let params = &[Param::new("turning_width", value, "")];
                let (label, intervals) = ("loop of load", &Default::default());
                let form = Form::Other;
                effect(EffectKind::Hysteresis).impossible(
                    &Estimate {
                        form,
                        label,
                        params,
                        intervals,
                    },
                    ctx,
                )
            };
            assert_eq!(width(7.0), None);
            assert!(width(95.0).is_some());
        },
    );
}

/// State of a loop, -1 to 1, that turns over a distance, from the values of its driver; the first
/// of a run starts it.
fn gradual_loop(distance: f64) -> impl FnMut(bool, f64) -> f64 {
    let (mut z, mut last) = (0.0, 0.0);
    move |first, x| {
        if first {
            (z, last) = (0.0, x);
        }
        let dx: f64 = x - last;
        last = x;
        let sign = if dx >= 0.0 { 1.0 } else { -1.0 };
        z = sign + (z - sign) * (-dx.abs() / distance).exp();
        z
    }
}

/// A loop against the friction gives the motion energy.
#[test]
fn a_loop_against_the_friction_is_none() {
    let excitation = Excitation {
        declare_coulomb: true,
        ..Excitation::default()
    };
    let mut turned = gradual_loop(1.5);
    let report = simulate(&excitation, 1.0, &mut move |s| {
        let z = turned(s.first, s.angle);
        0.15 * s.command * z
    });
    let loops = |name: &str, form: &str| name == "hysteresis" && form.contains("position");
    assert!(
        !report
            .effects
            .iter()
            .any(|e| loops(e.name.as_str(), &e.form))
            && !report
                .improves
                .iter()
                .any(|e| loops(e.name.as_str(), &e.form)),
        "{}",
        report.markdown()
    );
}

/// As the larger one it is chosen first, when there is no friction that it could act against.
#[test]
fn a_loop_and_friction_against_it_are_not_both_found() {
    let mut turned = gradual_loop(1.5);
    let report = simulate(&Excitation::default(), 1.0, &mut move |s| {
        let z = turned(s.first, s.angle);
        1.5 * z - 0.5 * s.velocity.signum()
    });
    let coefficient = |names: &[&str]| {
        let all = report.effects.iter().flat_map(|e| &e.params);
        let own = all.filter(|(name, _)| names.contains(&name.as_str()));
        own.map(|(_, value)| *value).next()
    };
    let pair = (
        coefficient(&["half_height"]),
        coefficient(&["friction", "held_friction"]),
    );
    let against = matches!(pair, (Some(a), Some(b)) if a * b < 0.0);
    assert!(!against, "{}", report.markdown());
    assert!(
        report
            .improves
            .iter()
            .any(|e| e.unsupported.contains("acts with the motion")),
        "{}",
        report.markdown()
    );
}

#[test]
fn is_named() {
    let mut turned = gradual_loop(0.8);
    crate::rig::names("hysteresis", move |s| {
        let z = turned(s.first, s.command);
        0.4 * z
    });
}

/// Only the changes of the position count, and the velocity tells them.
#[test]
fn a_loop_of_the_position_needs_no_column_of_it() {
    let rows = 2000;
    let velocity: Vec<f64> = (0..rows).map(|i| (0.01 * i as f64).sin()).collect();
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                velocity = { column = \"v\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
    let columns = [("target", velocity.clone()), ("velocity", velocity)];
    crate::rig::knowing(spec, &columns, rows, |ctx| {
        let forms =
            residual_effects::effect(residual_effects::EffectKind::Hysteresis).variants(ctx);
        assert!(forms.iter().any(|f| f.label == "loop of position"));
    });
}
