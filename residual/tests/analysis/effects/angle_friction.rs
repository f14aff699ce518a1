//! Dry friction that depends on the angle: a rubbing spot, a bent shaft.

use std::f64::consts::TAU;

/// The middle of a sector about zero may be below zero, and its interval is not cut off there.
#[test]
fn the_middle_of_a_sector_about_zero_has_an_interval() {
    let report = crate::rig::simulate(&Default::default(), 1.0, &mut |s| {
        let inside = (s.angle + 0.66).rem_euclid(TAU) < 1.2;
        if inside {
            -0.5 * s.velocity.signum()
        } else {
            0.0
        }
    });
    let first = &report.effects[0];
    assert_eq!(
        first.name.as_str(),
        "angle_friction",
        "{}",
        report.markdown()
    );
    let [low, high] = first.ci["middle"];
    let middle = first.params["middle"];
    assert!(low < middle && middle < high, "{low} {middle} {high}");
}

/// The order is looked for, and not only among the first.
#[test]
fn a_ripple_of_any_order_is_named() {
    for order in [6.0, 11.3] {
        let report = crate::rig::simulate(&Default::default(), 1.0, &mut |s| {
            -(0.5 + 0.3 * (order * s.angle + 1.0).sin()) * s.velocity.signum()
        });
        let ripple = report
            .effects
            .iter()
            .find(|e| e.name.as_str() == "angle_friction");
        let ripple = ripple.unwrap_or_else(|| panic!("{}", report.markdown()));
        assert_eq!(ripple.form, "with a ripple");
        let found = ripple.params["order"];
        assert!((found - order).abs() < 0.02, "{found}");
    }
}

/// A damping that swells and falls with the angle is no dry friction.
#[test]
fn a_damping_with_a_ripple_is_not_called_friction() {
    let report = crate::rig::simulate(&Default::default(), 1.0, &mut |s| {
        -0.4 * s.velocity * (1.0 + (3.0 * s.angle).cos())
    });
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert!(!names.contains(&"angle_friction"), "{}", report.summary());
}

#[test]
fn is_named() {
    crate::rig::names("angle_friction", |s| {
        let inside = (s.angle - 1.0).rem_euclid(TAU) < 1.2;
        if inside {
            -0.5 * s.velocity.signum()
        } else {
            0.0
        }
    });
}
