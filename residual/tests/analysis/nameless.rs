//! Structure without a name.

use crate::rig::{simulate, Excitation};
use residual::Report;
use residual::Verdict;

fn is_unknown(report: &Report, depends_on: &str) {
    assert!(report.effects.is_empty(), "{}", report.markdown());
    assert_eq!(report.verdict, Verdict::Unknown, "{}", report.markdown());
    let first = &report.structure[0].depends_on;
    assert!(first.contains(depends_on), "{first}");
}

/// No column says why, so there is no name; but something is missing.
#[test]
fn what_differs_from_log_to_log_is_not_nothing() {
    let side = |group: u32| if group.is_multiple_of(2) { 1.0 } else { -1.0 };
    let offset = simulate(&Excitation::default(), 0.2, &mut |s| side(s.group));
    is_unknown(&offset, "offset is its own");
    let damping = simulate(&Excitation::default(), 0.4, &mut |s| {
        side(s.group) * s.velocity
    });
    is_unknown(&damping, "damping is its own");
}

#[test]
fn the_speed_of_another_joint_is_not_nothing() {
    let mut last = 0.0;
    let report = simulate(&Excitation::default(), 1.5, &mut |s| {
        let speed = if s.first { 0.0 } else { (s.pose - last) / s.dt };
        last = s.pose;
        speed
    });
    is_unknown(&report, "speed of pose_a");
}
