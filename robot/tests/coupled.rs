//! The virtual arm in the plant: cables move its tip, its tip moves the cables.
#![cfg(feature = "arm")]

use plant::{Plant, PlantConfig};
use robot::arm::{ArmConfig, VirtualArm};
use robot::trajectory::Trajectory;
use std::any::Any;

fn plant(seed: u64) -> Plant {
    let mut config = PlantConfig::default();
    config.cable.initial_slack_m = 5e-3;
    let arm = VirtualArm::new(&ArmConfig::default(), seed).unwrap();
    let mut plant = Plant::with_robot(config, seed, Box::new(arm)).unwrap();
    plant.set_amplifier_power(true);
    plant
}

fn arm(plant: &mut Plant) -> &mut VirtualArm {
    let robot: &mut dyn Any = plant.robot_mut().unwrap();
    robot.downcast_mut().unwrap()
}

#[test]
fn a_cable_that_pulls_moves_the_tip_towards_it() {
    for seed in [1, 2] {
        let tip_after = |volts: f64| {
            let mut plant = plant(seed);
            // Unit 3 pulls along +y: some 8 N.
            plant.set_amplifier_volts(2, volts).unwrap();
            plant.advance_to(2_000_000_000);
            (plant.tip_position_m(), plant.tension_n(2), plant)
        };
        let (free, slack, _) = tip_after(0.0);
        let (pulled, tension, mut plant) = tip_after(0.7);
        assert_eq!(slack, 0.0);
        assert!(tension > 4.0, "{tension}");
        // Less than stiff, more than nothing: friction holds a part of it, the drives the rest.
        let way = pulled[1] - free[1];
        assert!(way > 5e-6 && way < 5e-3, "seed {seed}: {way}");
        let truth = arm(&mut plant).truth();
        assert!(truth.force_on_tip_n[1] > 0.9 * tension, "{truth:?}");
        assert_eq!(truth.tip_m, plant.tip_position_m());
    }
}

#[test]
fn a_tip_that_moves_lengthens_the_cables() {
    let mut plant = plant(3);
    let start = arm(&mut plant).target().position;
    let to = [start[0] + 0.2, start[1] + 0.1, start[2] - 0.02];
    arm(&mut plant).follow(Trajectory::between(start, to, 4.0));
    plant.advance_to(500_000_000);
    let before = plant.truth();
    plant.set_robot_moving(true);
    plant.advance_to(7_000_000_000);
    let after = plant.truth();
    let way: f64 = (0..3)
        .map(|i| (after.tip_position_m[i] - before.tip_position_m[i]).powi(2))
        .sum::<f64>()
        .sqrt();
    assert!(way > 0.015, "{way}");
    for (a, b) in after.units.iter().zip(&before.units) {
        let change = a.cable_length_m - b.cable_length_m;
        // By the way along the cable, within the turn of its direction.
        let along: f64 = (0..3)
            .map(|i| (before.tip_position_m[i] - after.tip_position_m[i]) * b.cable_direction[i])
            .sum();
        assert!((change - along).abs() < 2e-3, "{change} {along}");
    }
}

#[test]
fn a_copy_of_the_plant_has_an_arm_of_its_own() {
    let mut plant = plant(4);
    plant.advance_to(100_000_000);
    let mut copy = plant.clone();
    copy.set_amplifier_volts(2, 0.7).unwrap();
    copy.advance_to(1_000_000_000);
    assert!(arm(&mut plant).truth().time_s < 0.11);
    assert!(arm(&mut copy).truth().time_s > 0.99);
}
