//! Steps: a command or a reading in whole units.

use crate::rig::{simulate, Excitation};

#[test]
fn is_named() {
    crate::rig::names("quantisation", |s| {
        (s.command / 0.6).round() * 0.6 - s.command
    });
}

/// Eight bits over the whole range, and a command that never comes near zero.
#[test]
fn fine_steps_are_found() {
    let excitation = Excitation {
        noise: 0.003,
        ..Excitation::default()
    };
    for (size, name) in [(0.031, "rounded"), (0.0173, "cut off")] {
        let report = simulate(&excitation, 1.0, &mut |s| {
            let u = s.command / size;
            let whole = if name == "rounded" {
                u.round()
            } else {
                u.floor()
            };
            whole * size - s.command
        });
        let first = report
            .effects
            .first()
            .map(|e| (e.name.as_str(), e.form.as_str()));
        let form = format!("of the command, {name}");
        assert_eq!(
            first,
            Some(("quantisation", form.as_str())),
            "{}",
            report.markdown()
        );
        let found = report.effects[0].params["step"];
        assert!((found / size - 1.0).abs() < 1e-3, "{found}");
        let [low, high] = report.effects[0].ci["step"];
        assert!(low < high && high - low < 1e-3 * size, "{low} {high}");
    }
}
