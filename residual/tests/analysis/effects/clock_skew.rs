//! Clocks of command and target that run at different rates.

use crate::rig::{knowing, simulate, Excitation, Row};
use residual_effects::*;

/// A target that is ahead of its cause all along the run, or behind it, is no matter of rates.
#[test]
fn a_constant_lag_is_no_skew() {
    for (lag, seed) in [(0.1, 1), (0.34, 2), (1.07, 3), (-0.9, 4)] {
        let excitation = Excitation {
            seed,
            ..Excitation::default()
        };
        let ahead = |s: &Row| s.command_at(s.elapsed + lag) - s.command;
        let report = simulate(&excitation, 1.0, &mut { ahead });
        let skew = |e: &residual::Effect| e.name.as_str() == "clock_skew";
        assert!(!report.effects.iter().any(skew), "{}", report.markdown());
    }
}

/// Effects that were found use further inputs, which have the same clock.
#[test]
fn the_clock_of_the_inputs_is_that_of_all_of_them() {
    let of =
        |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..1200).map(|i| f(0.02 * i as f64)).collect() };
    let columns = [
        ("target", of(&|t| (0.7 * t).sin())),
        ("command", of(&|t| (0.7 * t).cos())),
        ("velocity", of(&|t| (0.9 * t).cos())),
        ("angle", of(&|t| (0.9 * t).sin())),
    ];
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                command = { column = \"c\", unit = \"N\" }\nvelocity = { column = \"v\", unit = \"rad/s\" }\n\
                angle = { column = \"a\", unit = \"rad\" }\n\
                [[terms]]\nname = \"a\"\nexpr = \"command\"\n[[terms]]\nname = \"b\"\nexpr = \"velocity\"\n";
    knowing(spec, &columns, 600, |ctx| {
        let forms = effect(EffectKind::ClockSkew).variants(ctx);
        let all = forms
            .iter()
            .find(|f| f.label == "rate of the inputs' clock");
        let Build::SwapAll(pairs) = (all.unwrap().build)(0.001) else {
            panic!("it acts on what is found later as well");
        };
        let names: Vec<&str> = pairs.iter().map(|(n, _)| n.as_str()).collect();
        assert_eq!(names, ["angle", "command", "velocity"]);
    });
}

#[test]
fn is_named() {
    crate::rig::names("clock_skew", |s| {
        s.command_at(s.elapsed * 1.004) - s.command
    });
}

/// The motion, and the friction with it, has the clock of the target.
#[test]
fn is_named_where_the_command_alone_has_another_clock() {
    let excitation = Excitation {
        declare_coulomb: true,
        ..Excitation::default()
    };
    let skewed = |s: &Row| s.command_at(s.elapsed * 1.004) - s.command;
    let report = simulate(&excitation, 1.0, &mut { skewed });
    let first = report
        .effects
        .first()
        .map(|e| (e.name.as_str(), e.form.as_str()));
    assert_eq!(
        first,
        Some(("clock_skew", "rate of the command's clock")),
        "{}",
        report.markdown()
    );
    let [low, high] = report.effects[0].ci["skew"];
    assert!(low < 0.004 && 0.004 < high, "{low} {high}");
}
