//! A lag of the reading: all that the target shows has gone through one filter.

use crate::rig::{simulate, Excitation, Row};
use residual::Report;

/// Time constant of the sensor, s.
const TAU: f64 = 0.06;

/// What a sensor shows of `force`, from row to row.
fn lagging(mut force: impl FnMut(&Row) -> f64) -> impl FnMut(&Row) -> f64 {
    // The force within a step, on which the sensor works.
    let (steps, mut before, mut y) = (20, 0.0, 0.0);
    move |s| {
        let now = force(s);
        if s.first {
            (before, y) = (now, now);
        }
        for k in 1..=steps {
            let share = f64::from(k) / f64::from(steps);
            let x = before + share * (now - before);
            y += (x - y) * (1.0 - (-s.dt / f64::from(steps) / TAU).exp());
        }
        before = now;
        y
    }
}

fn names(report: &Report) -> Vec<&str> {
    report.effects.iter().map(|e| e.name.as_str()).collect()
}

fn covers(report: &Report) {
    let own = report.effects.iter().find(|e| e.name == "sensor_lag");
    let [low, high] = own.expect("it was found").ci["time_constant"];
    assert!(low < TAU && TAU < high, "{low} {high}");
}

/// The declared friction is as late as the command.
#[test]
fn of_declared_friction_is_named() {
    let x = Excitation {
        declare_coulomb: true,
        ..Excitation::default()
    };
    let mut shown = lagging(|s| s.command - 0.6 * s.velocity.signum());
    let report = simulate(&x, 1.0, &mut |s| {
        shown(s) - (s.command - 0.6 * s.velocity.signum())
    });
    assert_eq!(names(&report), ["sensor_lag"], "{}", report.markdown());
    assert!(report.others(report.effects[0].name).is_empty());
    covers(&report);
    // The model that goes on from here has every term behind the filter.
    let terms = report.extended.terms.iter();
    let mut texts = terms.map(|t| t.expr.as_str());
    assert!(
        texts.all(|t| t.starts_with("lowpass(")),
        "{:?}",
        report.extended
    );
}

/// Friction that turns late is no friction with a distance of its own.
#[test]
fn of_friction_that_is_found_is_no_presliding() {
    let x = Excitation {
        stops: true,
        ..Excitation::default()
    };
    let sign = |v: f64| if v == 0.0 { 0.0 } else { v.signum() };
    let mut shown = lagging(move |s| s.command - 1.5 * sign(s.velocity));
    let report = simulate(&x, 1.0, &mut |s| shown(s) - s.command);
    let mut found = names(&report);
    found.sort_unstable();
    assert_eq!(found, ["coulomb", "sensor_lag"], "{}", report.markdown());
    covers(&report);
}
