//! A characteristic of two straight lines: a second path of the load, a stop, a loose joint that
//! closes.

use crate::rig::{acts_on_all_force, names_with, Excitation};

#[test]
fn is_named() {
    crate::rig::names("kink", |s| -0.25 * (s.command - 3.1).max(0.0));
}

/// A second path of the load may be stiffer than the first.
#[test]
fn is_named_where_the_slope_more_than_doubles() {
    crate::rig::names("kink", |s| 1.3 * (s.command - 3.1).max(0.0));
}

#[test]
fn takes_its_share_of_friction() {
    acts_on_all_force("kink", |force, _| 0.4 * (force - 3.1).max(0.0));
}

/// A limit of the prediction has the same curve, with a share lost that would be negative.
#[test]
fn is_named_where_the_slope_rises() {
    for seed in 1..4 {
        let excitation = Excitation {
            seed,
            declare_coulomb: true,
            ..Excitation::default()
        };
        names_with("kink", excitation, |s| 0.25 * (s.command - 3.1).max(0.0));
    }
}
