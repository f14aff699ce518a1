//! Friction in proportion to velocity.

#[test]
fn is_named() {
    crate::rig::names("viscous", |s| -0.3 * s.velocity);
}

#[test]
fn drag_with_the_square_of_the_velocity_is_named() {
    let report = crate::rig::simulate(&Default::default(), 1.0, &mut |s| {
        -0.3 * s.velocity * s.velocity.abs()
    });
    let found = report
        .effects
        .first()
        .map(|e| (e.name.as_str(), e.form.as_str()));
    let expected = Some(("viscous", "square of the velocity"));
    assert_eq!(found, expected, "{}", report.markdown());
    let drag = report.effects[0].params["drag"];
    assert!((drag + 0.3).abs() < 0.03, "{drag}");
}
