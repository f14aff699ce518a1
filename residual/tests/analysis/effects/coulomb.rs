//! Dry friction of constant size.

#[test]
fn is_named() {
    crate::rig::names("coulomb", |s| -0.4 * s.velocity.signum());
}
