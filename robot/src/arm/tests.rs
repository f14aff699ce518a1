//! Energy, passivity, tracking, what the published signals carry, and the dead zone.

use super::*;
use crate::trajectory::{Kind, TrajectoryConfig};

const H: f64 = 50e-6;

fn arm(seed: u64) -> VirtualArm {
    VirtualArm::new(&ArmConfig::default(), seed).unwrap()
}

fn run(arm: &mut VirtualArm, seconds: f64, moving: bool, force_n: [f64; 3]) {
    for _ in 0..(seconds / H).round() as u64 {
        arm.step(H, moving, force_n);
    }
}

/// Mean of the commanded efforts over a time.
fn mean_effort(arm: &mut VirtualArm, seconds: f64, moving: bool, force_n: [f64; 3]) -> [f64; 3] {
    arm.keep_messages(true);
    run(arm, seconds, moving, force_n);
    let messages = arm.take_messages();
    arm.keep_messages(false);
    let mut sum = [0.0; 3];
    for message in &messages {
        for (sum, effort) in sum.iter_mut().zip(commanded_efforts(message)) {
            *sum += effort / messages.len() as f64;
        }
    }
    sum
}

#[test]
fn without_power_and_friction_the_energy_stays() {
    let mut arm = arm(1);
    let p = &mut arm.parameters;
    (p.link_coulomb, p.motor_coulomb) = ([1e-9; 3], [1e-9; 3]);
    (p.link_viscous, p.motor_viscous, p.cable_damping_ratio) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    (p.load_share, p.guide_friction) = ([0.0; 3], 0.0);
    let p = *p;
    let inertia = arm.body.inertia(&arm.geometry);
    let inertia = core::array::from_fn(|i| inertia[(i, i)]);
    arm.drives = Drives::new(&p, inertia, arm.q, [0.3, -0.2, 4.0]);
    arm.links = core::array::from_fn(|i| Contact::new(1e-9, 1.1, 1.0, 1.0, 0.0, inertia[i]));
    arm.cut_power();
    // Falls and swings: speeds far above what the joints ever do.
    let start = arm.energy_j();
    let (mut least, mut most) = (start, start);
    let mut kinetic = 0.0_f64;
    for _ in 0..20_000 {
        arm.step(H, false, [0.0; 3]);
        let energy = arm.energy_j();
        (least, most) = (least.min(energy), most.max(energy));
        kinetic = kinetic.max(arm.v.iter().map(|v| v * v).sum::<f64>());
    }
    assert!(kinetic > 0.05, "{kinetic}");
    assert!(most - least < 0.01, "{start}: {least} to {most} J");
}

#[test]
fn without_power_energy_only_falls() {
    for seed in 0..8 {
        let mut arm = arm(seed);
        run(&mut arm, 0.2, false, [0.0; 3]);
        arm.v = [0.8, -0.6, 0.05];
        arm.cut_power();
        let mut before = arm.energy_j();
        let start = before;
        for step in 0..20_000 {
            arm.step(H, false, [0.0; 3]);
            let energy = arm.energy_j();
            // A step of the integrator may be off by its own error, never by a gain.
            assert!(
                energy <= before + 2e-6 * start.abs().max(1.0),
                "seed {seed}, step {step}: {before} to {energy}"
            );
            before = energy;
        }
        assert!(before < start - 0.01);
    }
}

#[test]
fn the_arm_follows_its_trajectories_as_closely_as_a_raven() {
    for seed in 0..6 {
        let mut arm = arm(seed);
        run(&mut arm, 0.5, false, [0.0; 3]);
        let config = TrajectoryConfig {
            duration_s: 30.0,
            ..TrajectoryConfig::default()
        };
        let trajectory = Trajectory::new(&config, seed).unwrap();
        // Reach the start slowly.
        arm.follow(approach(arm.target().position, trajectory.at(0.0).position));
        run(&mut arm, 25.0, true, [0.0; 3]);
        arm.follow(trajectory);
        let mut worst = [0.0_f64; 3];
        for _ in 0..20 {
            run(&mut arm, 1.0, true, [0.0, 2.0, 0.0]);
            let target = arm.target().position;
            for i in 0..3 {
                worst[i] = worst[i].max((arm.q[i] - target[i]).abs());
            }
        }
        // A real one is off by some tenths of a degree to a degree, and by up to a millimetre.
        assert!(
            worst[0] < 0.03 && worst[1] < 0.03 && worst[2] < 2e-3,
            "seed {seed}: {worst:?}"
        );
        assert!(worst.iter().any(|w| *w > 1e-4), "too good: {worst:?}");
    }
}

fn approach(from: [f64; 3], to: [f64; 3]) -> Trajectory {
    Trajectory::between(from, to, 20.0)
}

#[test]
fn a_moving_arm_feels_the_force_and_a_standing_one_does_not() {
    // The dead zone: less than the friction of a joint that stands does not reach its motor.
    for seed in [1, 2, 3] {
        let mut still = arm(seed);
        run(&mut still, 1.0, false, [0.0; 3]);
        let free = mean_effort(&mut still, 0.3, false, [0.0; 3]);
        // A force that asks 60 % of the shoulder's breakaway.
        let lever = still.jacobian.column(0).norm();
        let direction = still.rig_to_0.transpose() * still.jacobian.column(0) / lever;
        let wanted = 0.6 * still.parameters.link_coulomb[0];
        let force: [f64; 3] = (direction * (wanted / lever)).into();
        run(&mut still, 1.0, false, force);
        let pushed = mean_effort(&mut still, 0.3, false, force);
        let answer = (pushed[0] - free[0]).abs();
        assert!(
            answer < 0.35 * wanted,
            "seed {seed}: standing, {answer} of {wanted}"
        );

        // The same force on the moving joint: at the same speed with and without it.
        let moving = |force: [f64; 3]| {
            let mut arm = arm(seed);
            run(&mut arm, 0.5, false, [0.0; 3]);
            let start = arm.target().position;
            let to = [start[0] + 0.3, start[1], start[2]];
            arm.follow(Trajectory::between(start, to, 12.0));
            run(&mut arm, 6.0, true, force);
            mean_effort(&mut arm, 1.0, true, force)[0]
        };
        let difference = moving([0.0; 3]) - moving(force);
        assert!(
            (difference / wanted - 1.0).abs() < 0.25,
            "seed {seed}: moving, {difference} of {wanted}"
        );
    }
}

#[test]
fn a_reversal_steps_the_torque_by_twice_the_friction() {
    for seed in [1, 4] {
        let mut arm = arm(seed);
        run(&mut arm, 0.5, false, [0.0; 3]);
        let start = arm.target().position;
        let there = [start[0] + 0.1, start[1], start[2]];
        arm.follow(Trajectory::between(start, there, 6.0));
        run(&mut arm, 3.5, true, [0.0; 3]);
        let up = mean_effort(&mut arm, 0.3, true, [0.0; 3])[0];
        let gravity_up = arm.gravity[0];
        run(&mut arm, 4.0, true, [0.0; 3]);
        arm.follow(Trajectory::between(there, start, 6.0));
        run(&mut arm, 2.5, true, [0.0; 3]);
        let down = mean_effort(&mut arm, 0.3, true, [0.0; 3])[0];
        let step = (up - gravity_up) - (down - arm.gravity[0]);
        let p = &arm.parameters;
        let friction = 2.0 * (p.motor_coulomb[0] + p.link_coulomb[0]);
        assert!(
            step > 0.8 * friction && step < 1.4 * friction,
            "seed {seed}: {step} for {friction}"
        );
    }
}

#[test]
fn what_is_published_is_whole_counts_and_codes_and_carries_no_truth() {
    let mut arm = arm(5);
    arm.keep_messages(true);
    run(&mut arm, 0.1, false, [0.0; 3]);
    let messages = arm.take_messages();
    assert_eq!(messages.len(), 100);
    for pair in messages.windows(2) {
        assert_eq!(pair[1].seq, pair[0].seq + 1);
        assert_eq!(
            u64::from(pair[1].stamp.1) - u64::from(pair[0].stamp.1),
            PERIOD_NS
        );
    }
    let state = arm.state();
    state.check().unwrap();
    assert!(state.force.is_none());
    assert_eq!(state.stamp.clock, Clock::Virtual);
    // The published joints are the encoders', with stretch and homing error; they are not the
    // links'.
    let joints = state.joints.unwrap();
    for i in 0..3 {
        assert!((joints.position[i] - arm.q[i]).abs() > 1e-7);
        assert!((joints.position[i] - arm.q[i]).abs() < 0.03);
    }
}

#[test]
fn seeds_repeat_and_differ_and_slices_do_not_matter() {
    let after = |seed| {
        let mut arm = arm(seed);
        arm.follow(
            Trajectory::new(
                &TrajectoryConfig {
                    kind: Kind::ReversalRich,
                    ..TrajectoryConfig::default()
                },
                1,
            )
            .unwrap(),
        );
        run(&mut arm, 0.5, true, [1.0, 0.0, 0.0]);
        arm.q
    };
    assert_eq!(after(3), after(3));
    assert_ne!(after(3), after(4));
}

#[test]
fn configurations_that_can_not_be_are_refused_by_name() {
    let bad = ArmConfig {
        scatter: 2.0,
        ..ArmConfig::default()
    };
    assert!(matches!(
        VirtualArm::new(&bad, 1),
        Err(ArmError::Range {
            name: "scatter",
            ..
        })
    ));
    let bad = ArmConfig {
        start: [0.0, 0.0, 0.4],
        ..ArmConfig::default()
    };
    assert!(matches!(VirtualArm::new(&bad, 1), Err(ArmError::Start(_))));
    let mut bad = ArmConfig::default();
    bad.mount.rotation_xyzw = [f64::NAN; 4];
    assert!(matches!(VirtualArm::new(&bad, 1), Err(ArmError::Mount(_))));
}

#[test]
fn the_tip_starts_at_the_example_rigs_centre() {
    let arm = arm(1);
    for (got, expected) in arm.tip_m.iter().zip([-0.080, 0.025, -0.140]) {
        assert!((got - expected).abs() < 1e-12);
    }
    // What it reports is off by homing and stretch, by millimetres at most.
    let mut arm = arm;
    run(&mut arm, 0.01, false, [0.0; 3]);
    for (got, expected) in arm.reported_tip_m().iter().zip([-0.080, 0.025, -0.140]) {
        assert!((got - expected).abs() < 3e-3);
    }
}

/// Mean efforts in free motion, N·m, N·m, N.
fn free(change: ChangeConfig, session: u64) -> [f64; 3] {
    let path = TrajectoryConfig {
        duration_s: 30.0,
        ..TrajectoryConfig::default()
    };
    let path = Trajectory::new(&path, 5).unwrap();
    let config = ArmConfig {
        start: path.at(0.0).position,
        change,
        session,
        ..ArmConfig::default()
    };
    let mut arm = VirtualArm::new(&config, 3).unwrap();
    arm.follow(path);
    run(&mut arm, 2.0, true, [0.0; 3]);
    mean_effort(&mut arm, 4.0, true, [0.0; 3])
}

#[test]
fn each_change_is_in_the_efforts_and_no_change_is_none() {
    let none = free(ChangeConfig::default(), 1);
    assert_eq!(none, free(ChangeConfig::default(), 2));
    let with = |set: fn(&mut ChangeConfig)| {
        let mut change = ChangeConfig::default();
        set(&mut change);
        change
    };
    let changes: [(&str, ChangeConfig); 8] = [
        ("warm_up", with(|c| c.warm_up = 0.07)),
        ("friction", with(|c| c.friction = -0.06)),
        ("friction_sd", with(|c| c.friction_sd = 0.06)),
        ("gain", with(|c| c.gain_sd = 0.03)),
        ("offset", with(|c| c.offset_sd_a = 0.012)),
        ("ripple", with(|c| c.ripple = 0.2)),
        ("asymmetry", with(|c| c.asymmetry = 0.15)),
        ("drag", with(|c| c.drag_n_m = 0.2)),
    ];
    for (name, change) in changes {
        let efforts = free(change, 1);
        let moved = efforts.iter().zip(none).map(|(a, b)| (a - b).abs());
        assert!(
            moved.fold(0.0, f64::max) > 2e-3,
            "{name}: {efforts:?} {none:?}"
        );
    }
    // Amplifiers and tensions are other ones in each trial, gears are not.
    let offset = with(|c| c.offset_sd_a = 0.012);
    assert_ne!(free(offset, 1), free(offset, 2));
    let level = with(|c| c.friction_sd = 0.06);
    assert_ne!(free(level, 1), free(level, 2));
    let ripple = with(|c| c.ripple = 0.2);
    assert_eq!(free(ripple, 1), free(ripple, 2));
    let wrong = ArmConfig {
        change: with(|c| c.ripple = 2.0),
        ..ArmConfig::default()
    };
    let error = VirtualArm::new(&wrong, 1).unwrap_err().to_string();
    assert!(error.contains("change.ripple = 2"), "{error}");
}

#[test]
fn each_trial_homes_anew_where_the_zeros_change() {
    let reported = |homing_sd, session| {
        let config = ArmConfig {
            change: ChangeConfig {
                homing_sd,
                ..ChangeConfig::default()
            },
            session,
            ..ArmConfig::default()
        };
        let mut arm = VirtualArm::new(&config, 3).unwrap();
        run(&mut arm, 0.01, false, [0.0; 3]);
        arm.state().joints.unwrap().position
    };
    assert_eq!(reported(0.0, 1), reported(0.0, 2));
    let (one, other) = (reported(1.0, 1), reported(1.0, 2));
    for i in 0..3 {
        let moved = (one[i] - other[i]).abs();
        // 2.5 standard deviations to each side, and a count of the encoder.
        let most = 5.0 * super::parameters::HOMING_SD[i] + 1e-3;
        assert!(moved > 1e-6 && moved < most, "{i}: {moved}");
    }
}
