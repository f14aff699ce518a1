//! Dry friction that falls as sliding gets faster.

use crate::rig::{knowing, simulate, Excitation};
use residual::{Form, Param};
use residual_effects::*;

/// In one direction the sliding part takes an offset along, and the sum would drive the motion.
#[test]
fn friction_has_one_sign_at_all_speeds() {
    let rows = 300;
    let velocity: Vec<f64> = (0..rows).map(|i| 2.0 + (0.1 * i as f64).sin()).collect();
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                velocity = { column = \"v\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
    let columns = [("target", velocity.clone()), ("velocity", velocity)];
    knowing(spec, &columns, rows, |ctx| {
        let why = |sliding: f64, extra: f64| {
            let named = [
                ("stribeck_velocity", 1.0),
                ("sliding_friction", sliding),
                ("extra_at_low_speed", extra),
            ];
            let params = named.map(|(name, value)| Param::new(name, value, ""));
            let estimate = Estimate {
                form: Form::Other,
                label: "gaussian",
                params: &params,
                intervals: &Default::default(),
            };
            effect(EffectKind::Stribeck).impossible(&estimate, ctx)
        };
        assert_eq!(why(0.2, 0.3), None);
        assert_eq!(why(-0.2, -0.3), None);
        // Within what is uncertain.
        assert_eq!(why(-0.02, 0.345), None);
        assert!(why(-0.05, 0.345).is_some_and(|w| w.contains("changes its sign")));
        // And nothing is offered: any curve over the speed would fit.
        assert!(effect(EffectKind::Stribeck).variants(ctx).is_empty());
    });
}

/// A motor that holds its load by friction: one friction at rest and in motion, and no second name.
#[test]
fn friction_that_holds_at_rest_is_named() {
    let mut last = 0.0;
    let stops = Excitation {
        stops: true,
        ..Excitation::default()
    };
    let report = simulate(&stops, 1.0, &mut |s| {
        if s.first {
            last = 0.0;
        }
        if s.velocity != 0.0 {
            last = s.velocity.signum();
        }
        -last * (0.2 + 0.5 * (-(s.velocity / 0.3).powi(2)).exp())
    });
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["stribeck"], "{}", report.summary());
    assert_eq!(report.effects[0].form, "gaussian, stays at rest");
    let sliding = report.effects[0].params["sliding_friction"];
    assert!((sliding + 0.2).abs() < 0.03, "{sliding}");
}

/// A wide hump of the other sign bends like viscous friction, and takes Coulomb friction along.
#[test]
fn friction_that_grows_with_speed_is_not_stribeck() {
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        -s.velocity.signum() * (0.6 - 0.4 * (-(s.velocity / 0.5).powi(2)).exp())
    });
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert!(!names.contains(&"stribeck"), "{}", report.markdown());
    assert!(names.contains(&"coulomb"), "{}", report.markdown());
}

#[test]
fn is_named() {
    crate::rig::names("stribeck", |s| {
        -s.velocity.signum() * (0.2 + 0.5 * (-(s.velocity / 0.3).powi(2)).exp())
    });
}
