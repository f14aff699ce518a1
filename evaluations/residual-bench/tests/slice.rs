//! A small part of the benchmark, on development seeds.

use residual_bench::arm;
use residual_bench::case::{Case, Group, Plan};
use residual_bench::evaluate::{evaluate, Outcome};
use residual_bench::judge::Class;
use synthetic_sets::arm::{Motion, Recipe};
use synthetic_sets::Kind;

/// The set of this group, effect and strength with seed 10000.
fn outcome(group: Group, kinds: &[Kind], strength: f64) -> Outcome {
    let plan = Plan {
        seeds: 10_000..=10_001,
        kind: None,
        quick: false,
    };
    let case: Case = plan
        .cases()
        .into_iter()
        .find(|case| case.group == group && case.kinds == kinds && case.strength == strength)
        .expect("the plan has such a set");
    evaluate(&case).expect("the analysis runs")
}

#[test]
fn effects_of_three_times_the_noise_are_named() {
    for kind in [
        Kind::LoadDependentCoulomb,
        Kind::PeriodicAngle,
        Kind::Crosstalk,
    ] {
        let o = outcome(Group::Known, &[kind], 3.0);
        assert_eq!(o.class, Class::Right, "{}: {:?}", kind.name(), o.named);
        assert!(
            o.over_oracle() < 1.05,
            "{}: {}",
            kind.name(),
            o.over_oracle()
        );
        for e in &o.estimates {
            assert!(e.error() < 0.1, "{}: {e:?}", kind.name());
        }
    }
}

#[test]
fn an_empty_set_stays_empty() {
    let o = outcome(Group::Empty, &[], 0.0);
    assert_eq!(o.verdict, "none", "{:?}", o.named);
}

#[test]
fn two_effects_are_both_named() {
    let o = outcome(Group::Two, &[Kind::LoadDependentCoulomb, Kind::Offset], 1.0);
    assert_eq!(
        (o.verdict.as_str(), o.hits, o.extra),
        ("several", 2, 0),
        "{:?}",
        o.named
    );
}

#[test]
fn an_effect_in_no_catalogue_is_unknown() {
    let o = outcome(Group::Uncatalogued, &[Kind::TravelLoad], 3.0);
    assert_eq!(o.verdict, "unknown", "{:?}", o.named);
}

#[test]
fn friction_is_named_in_a_closed_loop() {
    let o = outcome(Group::Closed, &[Kind::Coulomb], 1.0);
    assert_eq!(o.class, Class::Right, "{:?} {:?}", o.verdict, o.named);
}

/// The noise of the reading is in the command of a closed loop. The history of the load explains a
/// few hundredths more than a clock that gains does, and was taken for its law.
#[test]
fn a_clock_that_gains_is_named_in_a_closed_loop() {
    let o = outcome(Group::Closed, &[Kind::ClockSkew], 1.0);
    assert_eq!(o.class, Class::Right, "{:?} {:?}", o.verdict, o.named);
}

/// Over a short arc, with both joints together, a line over the pose took the place of the weight.
#[test]
fn a_joint_that_swings_over_a_short_arc_has_friction_and_a_weight() {
    let outcome = arm::evaluate(&Recipe {
        motion: Motion::Together,
        outer: true,
        scale_nm: 3.0,
        noise: 0.15,
        arc: 0.4,
        seed: 71_902,
    });
    let outcome = outcome.expect("the analysis runs");
    assert!(outcome.is_whole() && !outcome.is_wrong(), "{outcome:?}");
    assert!(outcome.over_noise < 1.1, "{outcome:?}");
}

/// So short an arc that a weight is no different from a line: its name is refused, and that of a
/// line over the pose says no more.
#[test]
fn a_line_over_the_pose_that_may_be_a_weight_is_not_found_alone() {
    let outcome = arm::evaluate(&Recipe {
        motion: Motion::Free,
        outer: true,
        scale_nm: 150.0,
        noise: 0.15,
        arc: 0.4,
        seed: 311_918,
    });
    let outcome = outcome.expect("the analysis runs");
    assert!(outcome.is_among() && !outcome.is_wrong(), "{outcome:?}");
}
