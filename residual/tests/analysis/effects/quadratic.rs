//! Curvature of the characteristic.

#[test]
fn is_named() {
    crate::rig::names("quadratic", |s| 0.05 * s.command * s.command);
}

#[test]
fn bends_friction_too() {
    crate::rig::acts_on_all_force("quadratic", |force, _| 0.05 * force * force);
}
