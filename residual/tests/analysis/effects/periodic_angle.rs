//! A ripple locked to an angle: reel run-out, gear mesh, cogging.

#[test]
fn is_named() {
    crate::rig::names("periodic_angle", |s| 0.3 * (3.0 * s.angle + 0.4).sin());
}
