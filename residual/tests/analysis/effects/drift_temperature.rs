//! Drift with temperature, of zero or of gain.

#[test]
fn is_named() {
    crate::rig::names("drift_temperature", |s| 0.15 * (s.temperature - 25.0));
}

#[test]
fn of_gain_changes_friction_too() {
    crate::rig::acts_on_all_force("drift_temperature", |force, s| {
        0.1 * (s.temperature - 25.0) * force
    });
}
