//! An error that depends on the pose.

#[test]
fn is_named() {
    crate::rig::names("geometry", |s| 0.1 * s.command * s.pose);
}

/// The lever of a drum grows with each layer that it winds up.
#[test]
fn a_lever_that_grows_with_the_angle_is_named() {
    crate::rig::names("geometry", |s| 0.02 * s.command * s.angle);
}
