//! What friction does at rest and just after a reversal: the direction it holds.

use crate::rig::{names_with, Excitation};

#[test]
fn is_named() {
    let mut last = 0.0;
    names_with(
        "presliding",
        Excitation {
            declare_coulomb: true,
            stops: true,
            ..Excitation::default()
        },
        move |s| {
            if s.first {
                last = 0.0;
            }
            if s.velocity != 0.0 {
                last = s.velocity.signum();
                0.0
            } else {
                -0.6 * last
            }
        },
    );
}
