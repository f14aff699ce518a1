//! The campaign's subset of `cargo xtask test`: the expected faults, and its first cases.
//! `cargo xtask faults` runs all.

use faults::campaign::{Campaign, CURRENT_LIMIT_A};
use faults::case::{run, Bases, EXPECTED_N};
use faults::expected;
use faults::injection::{Category, Injection, Phase, Plan};
use faults::rig::Rig;
use std::collections::BTreeSet;

#[test]
fn every_detection_answers_its_injection_and_no_case_is_a_hazard() {
    let bases = Bases::between(1, CURRENT_LIMIT_A, EXPECTED_N);
    expected::check(&bases).unwrap_or_else(|wrong| panic!("{wrong}"));
    // What an output at the end of its range does no sampling prevents: `faults --full-output`
    // shows it.
    let plans = (0..120).map(|number| (number, Plan::draw(1, number)));
    for (number, plan) in plans.filter(|(_, plan)| !plan.has_full_output()) {
        let outcome = run(&bases, number, plan);
        assert!(outcome.hazards.is_empty(), "{outcome:?}");
    }
}

/// Without the amplifiers' current limit a wrong DAC word pulls too hard: the campaign sees what it
/// is there to see.
#[test]
fn the_watch_sees_a_hazard() {
    let bases = Bases::new(1, 6.0);
    let plan = Plan::holding(0, Injection::DacBit(0, 14, u32::MAX), None);
    let outcome = run(&bases, 0, plan);
    assert!(!outcome.hazards.is_empty(), "{outcome:?}");
}

#[test]
fn shards_add_up_and_what_is_done_is_not_run_again() {
    let shard = |n| Campaign {
        seed: 1,
        cases: 100,
        shard: (n, 3),
        jobs: 1,
        current_limit_a: CURRENT_LIMIT_A,
    };
    let mut all: Vec<u64> = (0..3)
        .flat_map(|n| shard(n).open(&BTreeSet::new()))
        .collect();
    all.sort_unstable();
    assert_eq!(all, (0..100).collect::<Vec<u64>>());
    let done = BTreeSet::from([0, 3, 6]);
    assert_eq!(shard(0).open(&done).first(), Some(&9));
}

/// What is done counts for the same program and seed only.
#[test]
fn outcomes_of_another_program_or_seed_are_not_taken_over() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("seed-1.jsonl");
    let campaign = |seed, cases| Campaign {
        seed,
        cases,
        shard: (0, 1),
        jobs: 1,
        current_limit_a: CURRENT_LIMIT_A,
    };
    campaign(1, 2).run(&file).unwrap();
    let first = std::fs::read_to_string(&file).unwrap();
    assert_eq!(first.lines().count(), 3);
    // The same goes on, another seed is refused.
    campaign(1, 3).run(&file).unwrap();
    let more = std::fs::read_to_string(&file).unwrap();
    assert!(more.starts_with(&first) && more.lines().count() == 4);
    let told = campaign(2, 3).run(&file).unwrap_err().to_string();
    assert!(told.contains("seed 1"), "{told}");
    // Another build: its outcomes are put aside.
    let (line, rest) = more.split_once('\n').unwrap();
    let other = line.replacen("\"program\":\"", "\"program\":\"x", 1);
    std::fs::write(&file, format!("{other}\n{rest}")).unwrap();
    campaign(1, 1).run(&file).unwrap();
    assert_eq!(std::fs::read_to_string(&file).unwrap().lines().count(), 2);
    assert!(folder.path().join("seed-1.jsonl.old").exists());
}

#[test]
fn a_plan_is_the_same_in_every_run_and_all_categories_are_drawn() {
    let drawn: BTreeSet<Category> = (0..30).map(|n| Plan::draw(5, n).first.category()).collect();
    assert_eq!(drawn.len(), Category::ALL.len());
    let text = serde_json::to_string(&Plan::draw(5, 7)).unwrap();
    assert_eq!(
        serde_json::from_str::<Plan>(&text).unwrap(),
        Plan::draw(5, 7)
    );
    assert!((0..100).any(|n| Plan::draw(5, n).second.is_some()));
}

/// The watches on load cell and motor are sharp enough to be wrong: nothing that is in order may
/// trip them.
#[test]
fn a_moving_robot_is_no_fault() {
    let bases = Bases::new(1, CURRENT_LIMIT_A);
    for base in 0..8 {
        let plan = Plan::holding(base, Injection::RobotMoves, None);
        let mut rig = bases.rig(&plan);
        rig.inject(plan.first);
        rig.run_ms(3_000);
        assert!(!rig.is_faulted(), "base {base}: {:?}", rig.status());
    }
}

/// At the least tension the friction model's band says nothing: a cable that stays slack does.
#[test]
fn a_motor_without_force_is_noticed_at_the_least_tension() {
    let armed = Rig::armed(1, [2.6; 6], CURRENT_LIMIT_A);
    for unit in 0..6 {
        let mut rig = armed.clone();
        rig.inject(Injection::AmplifierOff(unit));
        let noticed = (0..250).find(|_| {
            rig.run_ms(1);
            rig.status().units[unit].fault != 0
        });
        assert!(
            noticed.is_some_and(|ms| ms < 200),
            "unit {unit}: {noticed:?}"
        );
    }
}

/// A robot that moves before the arming leaves cables slack: they must not tighten with a shock,
/// whatever they are to hold.
#[test]
fn a_slack_cable_tightens_gently_at_the_largest_tension() {
    let bases = Bases::new(1, CURRENT_LIMIT_A);
    for base in 0..8 {
        let plan = Plan {
            phase: (Phase::Boot, 10),
            ..Plan::holding(base, Injection::RobotMoves, None)
        };
        let outcome = run(&bases, 0, plan);
        assert!(outcome.hazards.is_empty(), "{outcome:?}");
    }
}

/// The injection does what it says: the table of `--full-output` is of a pull that only the current
/// limit bounds.
#[test]
fn an_output_at_the_end_of_its_range_pulls_with_the_current_limit() {
    let mut rig = Rig::armed(1, [4.0; 6], CURRENT_LIMIT_A);
    rig.inject(Injection::DacFull(2));
    rig.run_ms(5);
    assert!(rig.pull_n(2) > 15.0, "{} N", rig.pull_n(2));
    rig.run_ms(195);
    assert!(rig.pull_n(2) < 0.1 && !rig.power(), "{} N", rig.pull_n(2));
}
