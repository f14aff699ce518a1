//! An error that depends on the pose.

#[test]
fn is_named() {
    crate::rig::names("geometry", |s| 0.1 * s.command * s.pose);
}
