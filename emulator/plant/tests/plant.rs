//! The rig as its surroundings see it: time, determinism, sensors, slack, forces at the tip.

mod common;
use common::{gauge, volts_for_pull};
use plant::config::{PathConfig, RandomPath, SweepPath};
use plant::{InputError, Plant, PlantConfig};

/// A session with inputs at odd times; `slice_ns` is how often the caller advances in between.
fn session(seed: u64, slice_ns: u64) -> String {
    let mut plant = Plant::new(PlantConfig::default(), seed).unwrap();
    let mut now = 0;
    let mut go = |plant: &mut Plant, to: u64| {
        while now < to {
            now = (now + slice_ns).min(to);
            plant.advance_to(now);
        }
    };
    go(&mut plant, 1_234);
    plant.set_amplifier_power(true);
    for unit in 0..6 {
        go(&mut plant, 3_000_017 + 61_003 * unit as u64);
        plant
            .set_amplifier_volts(unit, 0.3 + 0.1 * unit as f64)
            .unwrap();
    }
    go(&mut plant, 120_000_001);
    plant.set_robot_moving(true);
    // Two inputs between the same two grid points and two in neighbouring ones.
    for at in [400_010_000, 400_020_000, 400_060_000, 400_130_000] {
        go(&mut plant, at);
        plant
            .set_amplifier_volts(2, (at % 7_000) as f64 * 1e-4)
            .unwrap();
    }
    go(&mut plant, 1_500_000_000);
    plant.set_amplifier_power(false);
    go(&mut plant, 1_600_049_999);
    // Debug of f64 prints the shortest text that reads back as the same bits.
    format!("{:?}", plant.truth())
}

#[test]
fn slicing_of_advance_to_changes_no_bit() {
    let whole = session(4, u64::MAX / 4);
    for slice in [1_000_000, 50_000, 49_999, 3_125_007, 17_003] {
        assert_eq!(whole, session(4, slice), "slices of {slice} ns");
    }
}

#[test]
fn seeds_repeat_and_differ() {
    assert_eq!(session(9, 1_000_000), session(9, 1_000_000));
    assert_ne!(session(9, 1_000_000), session(10, 1_000_000));
}

#[test]
fn an_input_takes_effect_at_the_next_grid_point() {
    let mut plant = Plant::new(gauge(0.01, 0.005), 1).unwrap();
    plant.set_amplifier_power(true);
    plant.advance_to(120_000);
    plant.set_amplifier_volts(0, 1.0).unwrap();
    plant.advance_to(150_000);
    assert_eq!(plant.current_a(0), 0.0);
    plant.advance_to(199_999);
    assert_eq!(plant.current_a(0), 0.0);
    plant.advance_to(200_000);
    assert!(plant.current_a(0) > 0.1);
    // A value that was due keeps its place when the next one follows before its step has run.
    plant.set_amplifier_volts(0, 0.0).unwrap();
    plant.advance_to(300_000);
    plant.advance_to(1_000_060_000);
    plant.set_amplifier_volts(0, 0.1).unwrap();
    plant.advance_to(1_000_130_000);
    plant.set_amplifier_volts(0, 0.0).unwrap();
    plant.advance_to(1_000_150_000);
    assert!(plant.current_a(0) > 0.01);
    plant.advance_to(1_000_200_000);
    // The past stays as it is.
    let truth = plant.truth();
    plant.advance_to(5);
    assert_eq!(plant.truth(), truth);
    assert_eq!(plant.time_ns(), 1_000_200_000);
}

#[test]
fn amplifier_follows_its_gain_bandwidth_and_limits() {
    let mut plant = Plant::new(gauge(0.01, 0.005), 1).unwrap();
    plant.set_amplifier_volts(0, 0.5).unwrap();
    plant.advance_to(10_000_000);
    assert_eq!(plant.current_a(0), 0.0, "no current without power");
    plant.set_amplifier_power(true);
    plant.advance_to(10_100_000);
    // One time constant of 1500 Hz is 106 us.
    let part = 1.0 - libm::exp(-std::f64::consts::TAU * 1500.0 * 100e-6);
    assert!((plant.current_a(0) - 0.3 * part).abs() < 1e-9);
    plant.advance_to(20_000_000);
    assert!((plant.current_a(0) - 0.3).abs() < 1e-6);
    plant.set_amplifier_volts(0, -1e9).unwrap();
    plant.advance_to(21_000_000);
    assert!((plant.current_a(0) + 6.0).abs() < 0.01);
    assert_eq!(
        plant.set_amplifier_volts(0, f64::NAN),
        Err(InputError::NotAVoltage { unit: 0 })
    );
    plant.advance_to(30_000_000);
    assert!(plant.current_a(0).abs() < 1e-6, "NaN means 0 V");
    assert_eq!(
        plant.set_amplifier_volts(1, 0.0),
        Err(InputError::NoSuchUnit { unit: 1, units: 1 })
    );
}

#[test]
fn a_slack_cable_pulls_nothing_and_its_reel_reaches_a_bounded_speed() {
    let mut config = gauge(0.05, 0.2);
    config.cable.initial_slack_m = 0.5;
    let mut plant = Plant::new(config, 2).unwrap();
    plant.set_amplifier_power(true);
    plant.set_robot_moving(true);
    plant.advance_to(1_000_000_000);
    assert_eq!(plant.tension_n(0), 0.0);
    assert_eq!(plant.reel_rad(0), 0.0, "stands while nothing pulls");
    plant.set_amplifier_volts(0, 10.0).unwrap();
    let (mut fastest, mut caught) = (0.0_f64, false);
    for ms in 1_000..1_500_u64 {
        plant.advance_to(ms * 1_000_000);
        fastest = fastest.max(plant.reel_rad_per_s(0));
        caught |= plant.tension_n(0) > 0.0;
    }
    // 48 V over 0.0521 V.s/rad and 26:7.
    assert!(
        fastest > 50.0 && fastest < 48.0 / 0.0521 * 7.0 / 26.0,
        "{fastest}"
    );
    assert!(caught, "wound up at last");
}

#[test]
fn tension_is_never_negative_however_the_tip_jerks() {
    let mut config = PlantConfig::default();
    config.robot.path = PathConfig::Random(RandomPath {
        rms_speed_m_per_s: 1.0,
        ..RandomPath::default()
    });
    let mut plant = Plant::new(config, 6).unwrap();
    plant.set_amplifier_power(true);
    plant.set_robot_moving(true);
    let mut slack = 0;
    for step in 1..60_000_u64 {
        if step.is_multiple_of(2_000) {
            for unit in 0..6 {
                let volts = if (step / 2_000 + unit as u64).is_multiple_of(3) {
                    0.6
                } else {
                    -0.1
                };
                plant.set_amplifier_volts(unit, volts).unwrap();
            }
        }
        plant.advance_to(step * 50_000);
        for unit in 0..6 {
            let tension = plant.tension_n(unit);
            assert!(tension >= 0.0 && tension.is_finite());
            slack += usize::from(tension == 0.0);
        }
    }
    assert!(slack > 1_000, "the test must see slack cables: {slack}");
}

#[test]
fn encoder_counts_are_the_motor_angle() {
    for inverted in [false, true] {
        let mut config = gauge(0.02, 0.02);
        config.drive.encoder_inverted = inverted;
        let volts = volts_for_pull(&config, 4.0);
        let mut plant = Plant::new(config, 3).unwrap();
        plant.set_amplifier_power(true);
        plant.set_amplifier_volts(0, volts).unwrap();
        plant.set_robot_moving(true);
        let sign = if inverted { -1.0 } else { 1.0 };
        let mut lines = plant.encoder_lines(0);
        let mut counts = plant.encoder_counts(0);
        let mut span = (counts, counts);
        for step in 1..80_000_u64 {
            plant.advance_to(step * 50_000);
            let motor_turns = plant.reel_rad(0) * 26.0 / 7.0 / std::f64::consts::TAU;
            let phase = plant.parameters(0).encoder_phase_counts;
            let expected = sign * 4000.0 * motor_turns + phase;
            assert!((plant.encoder_counts(0) as f64 - expected.floor()).abs() <= 1e-6);
            let now = plant.encoder_lines(0);
            let flips = usize::from(now.0 != lines.0) + usize::from(now.1 != lines.1);
            let moved = (plant.encoder_counts(0) - counts).unsigned_abs() as usize;
            if moved <= 1 {
                assert_eq!(flips, moved, "one line changes per count");
            }
            lines = now;
            counts = plant.encoder_counts(0);
            span = (span.0.min(counts), span.1.max(counts));
        }
        assert!(span.1 - span.0 > 5_000, "{span:?}");
    }
}

#[test]
fn bridge_shows_cable_force_gain_zero_and_weight() {
    let mut config = PlantConfig::default();
    config.robot.path = PathConfig::Fixed(Default::default());
    let mut plant = Plant::new(config, 8).unwrap();
    let zero: Vec<f64> = (0..6).map(|u| plant.bridge_v_per_v(u)).collect();
    plant.set_amplifier_power(true);
    for unit in 0..6 {
        plant.set_amplifier_volts(unit, 0.5).unwrap();
    }
    plant.advance_to(5_000_000_000);
    let nominal = 0.002 / (3.0 * 9.80665);
    for (unit, zero) in zero.into_iter().enumerate() {
        let p = plant.parameters(unit);
        let idle = p.bridge_zero_v_per_v + p.bridge_per_n * p.assembly_weight_n;
        assert!((zero - idle).abs() < 1e-15, "starts at its zero");
        let force = (plant.bridge_v_per_v(unit) - zero) / p.bridge_per_n;
        assert!(
            (force - plant.cell_force_n(unit)).abs() < 1e-4,
            "unit {unit}: {force}"
        );
        assert!(plant.cell_force_n(unit) > 3.0 && plant.cell_force_n(unit) < plant.tension_n(unit));
        assert!((p.bridge_per_n / nominal - 1.0).abs() < 0.11);
        assert_eq!(plant.temperature_c(unit), 25.0);
    }
    // Unit 4 stands above the centre and looks down, unit 5 the other way.
    assert!(plant.parameters(4).assembly_weight_n > 4.5);
    assert!(plant.parameters(5).assembly_weight_n < -4.5);
}

#[test]
fn tip_force_is_the_sum_of_tensions_along_the_cables() {
    let mut plant = Plant::new(PlantConfig::default(), 12).unwrap();
    plant.set_amplifier_power(true);
    plant.set_robot_moving(true);
    for unit in 0..6 {
        plant
            .set_amplifier_volts(unit, 0.2 + 0.05 * unit as f64)
            .unwrap();
    }
    plant.advance_to(3_000_000_000);
    let truth = plant.truth();
    let mut sum = [0.0; 3];
    for (unit, u) in truth.units.iter().enumerate() {
        let exit = plant.parameters(unit).position_m;
        let away: Vec<f64> = (0..3).map(|k| exit[k] - truth.tip_position_m[k]).collect();
        let length = away.iter().map(|a| a * a).sum::<f64>().sqrt();
        assert!((length - u.cable_length_m).abs() < 1e-12);
        for (total, component) in sum.iter_mut().zip(&away) {
            *total += u.tension_n * component / length;
        }
    }
    for (found, due) in sum.iter().zip(truth.tip_force_n) {
        assert!((found - due).abs() < 1e-12);
    }
    assert!(truth.tip_velocity_m_per_s.iter().any(|v| v.abs() > 1e-4));
}

#[test]
fn a_compliant_tip_gives_way_by_force_times_compliance() {
    let mut config = PlantConfig::default();
    config.robot.path = PathConfig::Fixed(Default::default());
    config.robot.tip_compliance_m_per_n = 2.0e-4;
    let center = config.robot.workspace_center_m;
    let mut plant = Plant::new(config, 1).unwrap();
    plant.set_amplifier_power(true);
    plant.set_amplifier_volts(1, 0.5).unwrap();
    plant.advance_to(3_000_000_000);
    let truth = plant.truth();
    assert!(truth.tip_force_n[0] < -3.0);
    for (k, center) in center.into_iter().enumerate() {
        let give = truth.tip_position_m[k] - center;
        let due = 2.0e-4 * truth.tip_force_n[k];
        assert!((give - due).abs() < 1e-7, "axis {k}: {give} m, {due} m due");
    }
}

#[test]
fn halving_the_step_hardly_changes_the_result() {
    let run = |step_ns, compliance_m_per_n| {
        let mut config = PlantConfig {
            step_ns,
            ..PlantConfig::default()
        };
        config.robot.path = PathConfig::Sweep(SweepPath {
            direction: [1.0, 0.3, 0.2],
            ..SweepPath::default()
        });
        config.robot.tip_compliance_m_per_n = compliance_m_per_n;
        let mut plant = Plant::new(config, 3).unwrap();
        plant.set_amplifier_power(true);
        for unit in 0..6 {
            plant.set_amplifier_volts(unit, 0.35).unwrap();
        }
        plant.set_robot_moving(true);
        let mut tensions = Vec::new();
        for tick in 1..400_u64 {
            plant.advance_to(tick * 10_000_000);
            tensions.extend((0..6).map(|u| plant.tension_n(u)));
        }
        tensions
    };
    // Up to the largest give, which no explicit step of 50 us follows.
    for compliance in [0.0, 5e-4, 2e-3, 4e-3, 1e-2] {
        let (coarse, fine) = (run(50_000, compliance), run(12_500, compliance));
        let square: f64 = coarse.iter().zip(&fine).map(|(a, b)| (a - b).powi(2)).sum();
        let rms = (square / coarse.len() as f64).sqrt();
        println!("{compliance} m/N: {rms} N");
        assert!(
            rms < 0.01,
            "{compliance} m/N: {rms} N between 50 us and 12.5 us"
        );
    }
}

/// A repetition on one rig: the rig is the same, and the robot moves in another way.
#[test]
fn runs_of_one_rig_differ_in_the_path_and_not_in_the_rig() {
    let tip = |run: u64| {
        let mut plant = Plant::of_run(PlantConfig::default(), 1, run).unwrap();
        plant.set_robot_moving(true);
        plant.advance_to(3_000_000_000);
        let units: Vec<_> = (0..plant.units())
            .map(|unit| plant.parameters(unit).clone())
            .collect();
        (plant.tip_position_m(), units)
    };
    let (first, rig) = tip(0);
    let (again, _) = tip(0);
    let (other, same_rig) = tip(1);
    assert_eq!(first, again);
    assert_ne!(first, other);
    assert_eq!(rig, same_rig);
    let mut plain = Plant::new(PlantConfig::default(), 1).unwrap();
    plain.set_robot_moving(true);
    plain.advance_to(3_000_000_000);
    assert_eq!(plain.tip_position_m(), first);
}

#[test]
fn a_weight_on_a_free_tip_is_carried_by_the_cables_and_the_robot_does_not_see_it() {
    const WEIGHT_N: f64 = 2.0;
    let mut plant = Plant::new(PlantConfig::default(), 3).unwrap();
    plant.set_amplifier_power(true);
    for unit in 0..6 {
        plant.set_amplifier_volts(unit, 0.3).unwrap();
    }
    plant.advance_to(1_000_000_000);
    let (stands_m, _) = plant.robot_says();
    assert_eq!(stands_m, plant.tip_position_m());
    let pull = |plant: &Plant| {
        let truth = plant.truth();
        (0..6).fold([0.0; 3], |sum: [f64; 3], i| {
            let (d, t) = (truth.units[i].cable_direction, plant.tension_n(i));
            [sum[0] + t * d[0], sum[1] + t * d[1], sum[2] + t * d[2]]
        })
    };
    let before = pull(&plant);
    plant.hang_on_tip(WEIGHT_N).unwrap();
    plant.advance_to(11_000_000_000);
    let carried = pull(&plant);
    for (axis, expected) in [0.0, 0.0, WEIGHT_N].into_iter().enumerate() {
        assert!((carried[axis] - expected).abs() < 1e-3, "{carried:?}");
    }
    // The reels' friction holds most of the change.
    assert!((before[2] - carried[2]).abs() > 0.5, "{before:?}");
    assert_eq!(plant.robot_says(), (stands_m, [0.0; 3]));
    assert!(plant.tip_position_m()[2] < stands_m[2]);
    // Another weight takes the place of this one.
    plant.hang_on_tip(0.5).unwrap();
    plant.advance_to(21_000_000_000);
    assert!((pull(&plant)[2] - 0.5).abs() < 1e-3);
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        let told = plant.hang_on_tip(bad);
        assert!(matches!(told, Err(InputError::NotAWeight { .. })));
    }
}
