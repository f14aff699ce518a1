//! Rigs in which nothing is broken arm without a fault. `cargo xtask faults --healthy N` arms more.

use faults::campaign::CURRENT_LIMIT_A;
use faults::case::{run, Bases};
use faults::healthy;
use faults::injection::{Injection, Phase, Plan};
use wire::UNITS;

/// Of 3,000 rigs these had false alarms: a resting reel whose tension rose with the command while
/// the robot moved away (42), a reel that wound in after its closing cable had thrown it back (45),
/// and a command that had risen before the tension of a closing cable was seen (42).
#[test]
fn a_moving_robot_and_a_closing_cable_are_no_fault() {
    for (seed, rig) in [(1, 35), (1, 87), (3, 83), (3, 1_048), (2, 391), (2, 1_079)] {
        let found = healthy::run(seed, rig..rig + 1, CURRENT_LIMIT_A, 1);
        assert_eq!(found.armings, u64::from(healthy::ARMINGS), "{seed}/{rig}");
        assert_eq!(found.alarms, [], "{seed}/{rig}");
    }
}

/// Slack is being taken up at some 40 mm/s when the encoder stops: without a speed there is no
/// brake, and the cable closed with up to 30 N.
#[test]
fn an_encoder_that_stops_while_slack_is_taken_up_throws_no_reel() {
    let bases = Bases::new(901, CURRENT_LIMIT_A);
    for unit in 0..UNITS {
        for (base, ms) in [(3, 60), (3, 100), (7, 150)] {
            let plan = Plan {
                base,
                phase: (Phase::FirstSecond, ms),
                ..Plan::holding(base, Injection::EncoderFrozen(unit), None)
            };
            let outcome = run(&bases, 0, plan);
            assert!(outcome.hazards.is_empty(), "{outcome:?}");
            assert_ne!(outcome.fault, 0, "{outcome:?}");
        }
    }
}
