//! A constant that the model lacks.

#[test]
fn is_named() {
    crate::rig::names("offset", |_| 0.3);
}
