//! A sensor that sees only the component along its own axis.

#[test]
fn is_named() {
    crate::rig::names("cosine_misalignment", |s| s.command * (s.pose.cos() - 1.0));
}

/// A ripple in proportion to the load has its shape over a part of a turn.
#[test]
fn a_ripple_over_a_part_of_a_turn_may_stand_for_it() {
    use residual_effects::EffectKind;
    let only = ["cosine_misalignment", "periodic_angle"];
    let names = |order: f64| {
        let term = "expr = \"command\"\nfixed = 1.0";
        super::gravity_angle::others(EffectKind::CosineMisalignment, &only, term, |s| {
            s.command * (1.0 + 0.2 * ((order * s.angle).cos() - 1.0))
        })
    };
    assert!(names(1.0).is_empty());
    for order in [1.4, 1.6] {
        assert!(names(order).contains(&EffectKind::PeriodicAngle), "{order}");
    }
}
