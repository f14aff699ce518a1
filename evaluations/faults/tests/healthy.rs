//! Rigs in which nothing is broken arm without a fault. `cargo xtask faults --healthy N` arms more.

use faults::campaign::CURRENT_LIMIT_A;
use faults::healthy;

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
