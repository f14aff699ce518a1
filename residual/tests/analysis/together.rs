//! Effects that are there together.

use crate::rig::{simulate, Excitation};
use residual_report::{Effect, Report};
use std::collections::VecDeque;

fn names(report: &Report) -> Vec<&str> {
    let mut names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    names.sort_unstable();
    names
}

fn param(report: &Report, effect: &str, name: &str) -> f64 {
    let of = |e: &&Effect| e.name == effect;
    let found = report
        .effects
        .iter()
        .find(of)
        .and_then(|e| e.params.get(name));
    *found.unwrap_or_else(|| panic!("no {effect}.{name}\n{}", report.markdown()))
}

fn near(value: f64, truth: f64) {
    assert!((value / truth - 1.0).abs() < 0.1, "{value} for {truth}");
}

/// Whatever is found after a delay of the target is as late as what was found before.
#[test]
fn friction_in_a_late_log_is_one_friction() {
    let mut line = VecDeque::new();
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        if s.first {
            line.clear();
        }
        line.push_back(s.command - (0.5 + 0.15 * s.command) * s.velocity.signum());
        if line.len() > 4 {
            line.pop_front();
        }
        line[0] - s.command
    });
    assert_eq!(names(&report), ["delay", "load_dependent_coulomb"]);
    near(param(&report, "delay", "delay"), 0.06);
    let friction = |name| param(&report, "load_dependent_coulomb", name);
    near(friction("friction_at_zero_load"), -0.5);
    near(friction("friction_per_load"), -0.15);
    let terms = &report.extended.terms;
    assert!(
        terms
            .iter()
            .skip(1)
            .all(|t| t.expr.contains("delay(velocity")),
        "{terms:?}"
    );
}

/// Friction that grows with load in motion, and another one at rest: neither takes the other's
/// place.
#[test]
fn friction_at_rest_and_in_motion_have_coefficients_of_their_own() {
    let excitation = Excitation {
        stops: true,
        ..Excitation::default()
    };
    let mut last = 0.0;
    let report = simulate(&excitation, 1.0, &mut |s| {
        if s.first {
            last = 0.0;
        }
        if s.velocity != 0.0 {
            last = s.velocity.signum();
            -(0.3 + 0.15 * s.command) * last
        } else {
            -1.2 * last
        }
    });
    assert_eq!(names(&report), ["load_dependent_coulomb", "presliding"]);
    let moving = |name| param(&report, "load_dependent_coulomb", name);
    near(moving("friction_at_zero_load"), -0.3);
    near(moving("friction_per_load"), -0.15);
    near(param(&report, "presliding", "held_friction"), -1.2);
}
