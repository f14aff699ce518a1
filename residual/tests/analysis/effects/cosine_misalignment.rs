//! A sensor that sees only the component along its own axis.

#[test]
fn is_named() {
    crate::rig::names("cosine_misalignment", |s| s.command * (s.pose.cos() - 1.0));
}
