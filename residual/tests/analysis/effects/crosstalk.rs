//! A neighbour's signal in this one.

#[test]
fn is_named() {
    crate::rig::names("crosstalk", |s| 0.2 * s.neighbour);
}
