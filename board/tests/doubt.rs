//! Load cells, DACs and tips that cannot be believed: what the machine does.

mod common;
use common::Bench;

use control::let_go::{LET_GO_US, TRIAL_MS};
use control::plausible::{FROZEN_SAMPLES, LIMIT_SAMPLES, NEGATIVE_SAMPLES};
use control::{Config, EncoderCounts, Fault, SystemState, UnitIndex};
use wire::message::{CommandError, Response};
use wire::Command;

/// Armed, with every cable at this tension.
fn held(tension_un: i32) -> Bench {
    let mut bench = Bench::armed();
    hold(&mut bench, tension_un, 400);
    assert_eq!(bench.machine.system(), SystemState::Running);
    assert!(
        (0..6).all(|unit| fault(&bench, unit) == 0),
        "{:?}",
        bench.status()
    );
    bench
}

fn hold(bench: &mut Bench, tension_un: i32, ms: u32) {
    for _ in 0..ms / 10 {
        bench.setpoints(tension_un);
        bench.run(10);
    }
}

fn fault(bench: &Bench, unit: usize) -> u16 {
    bench.status().units[unit].fault
}

/// The largest command of unit 2 until it faults, in newton, and the time that took in
/// milliseconds.
fn until_fault(bench: &mut Bench, tension_un: i32) -> (f64, u32) {
    let mut largest = 0.0f64;
    for ms in 1..2_000 {
        if ms % 10 == 1 {
            bench.setpoints(tension_un);
        }
        bench.run(1);
        if fault(bench, 1) != 0 {
            assert_eq!(bench.last[1].steps(), 0, "faulted and driven");
            assert_eq!(
                bench.machine.system(),
                SystemState::Running,
                "the others continue"
            );
            return (largest, ms);
        }
        largest = largest.max(f64::from(bench.last[1].steps()) / 282.22);
    }
    panic!("no fault in 2 s; command {largest:.1} N");
}

#[test]
fn an_open_bridge_is_noticed_before_its_motor_pulls_hard() {
    let mut bench = held(6_000_000);
    bench.cell_n[1] = Some(0.0);
    let (largest_n, ms) = until_fault(&mut bench, 6_000_000);
    assert!(largest_n < 12.0, "{largest_n:.1} N");
    assert!(ms < 100, "{ms} ms");
    assert_eq!(fault(&bench, 1), Fault::Implausible.code());
}

#[test]
fn a_frozen_code_is_noticed_whatever_it_reads() {
    let mut bench = held(6_000_000);
    bench.cell_n[1] = Some(6.0);
    bench.noise = false;
    bench.run(3 * u32::from(FROZEN_SAMPLES) + 3);
    assert_eq!(fault(&bench, 1), Fault::SensorFrozen.code());
}

#[test]
fn a_wrong_sign_is_a_negative_tension() {
    let mut bench = held(2_000_000);
    bench.cell_n[1] = Some(-2.0);
    let (_, ms) = until_fault(&mut bench, 2_000_000);
    assert!(ms <= 3 * u32::from(NEGATIVE_SAMPLES) + 30, "{ms} ms");
    assert_eq!(fault(&bench, 1), Fault::TensionNegative.code());
}

/// A cell that reads 2 N too little stays within the band's permitted deviation: the command's
/// limit is what is left.
#[test]
fn a_command_at_its_limit_is_a_fault_and_the_limit_follows_the_setpoint() {
    let mut bench = held(4_000_000);
    bench.cell_n[1] = Some(3.4);
    let (largest_n, ms) = until_fault(&mut bench, 4_000_000);
    let nominal = Config::nominal();
    let gain = f64::from(nominal.friction_gain_q16 - nominal.coulomb_load_q16) / 65_536.0;
    let limit_n = (4.0 - 0.155 + 0.909) / gain + f64::from(nominal.authority_un) * 1e-6;
    assert!(
        largest_n < limit_n + 0.01,
        "{largest_n:.2} N, limit {limit_n:.2} N"
    );
    assert!(ms > 3 * u32::from(LIMIT_SAMPLES), "{ms} ms");
    let expected = [Fault::CommandAtLimit.code(), Fault::Implausible.code()];
    assert!(expected.contains(&fault(&bench, 1)), "{}", fault(&bench, 1));
}

#[test]
fn a_reading_too_high_is_noticed() {
    let mut bench = held(4_000_000);
    bench.cell_n[1] = Some(9.0);
    let (_, ms) = until_fault(&mut bench, 4_000_000);
    assert!(ms < 200, "{ms} ms");
    assert_eq!(fault(&bench, 1), Fault::Implausible.code());
}

#[test]
fn a_zero_with_15_n_of_preload_is_refused() {
    let mut bench = Bench::ready();
    bench.load_n = Some(15.0);
    bench.done(Command::Zero { units: 0b11_1111 });
    bench.run(1_000);
    for unit in 0..6 {
        assert_eq!(fault(&bench, unit), Fault::ZeroRefused.code());
    }
    // Against a stored zero, half a newton is too much where the configuration says so.
    let mut bench = Bench::ready();
    let config = wire::message::UnitConfig {
        stored_zero_code: 700_000,
        zero_deviation_un: 400_000,
        ..Config::nominal()
    };
    bench.done(Command::StageConfig { unit: 2, config });
    bench.done(Command::CommitConfig);
    bench.run(u32::from(TRIAL_MS));
    bench.load_n = Some(4.795 + 0.3);
    bench.done(Command::Zero { units: 0b100 });
    bench.run(1_000);
    assert_eq!(fault(&bench, 2), 0);
    bench.load_n = Some(4.795 + 0.5);
    bench.done(Command::Zero { units: 0b100 });
    bench.run(1_000);
    assert_eq!(fault(&bench, 2), Fault::ZeroRefused.code());
}

#[test]
fn a_motor_that_does_not_let_go_loses_its_power() {
    for code in [Fault::HostStop, Fault::EStop] {
        let mut bench = held(6_000_000);
        bench.cell_n[3] = Some(6.0);
        if code == Fault::EStop {
            bench.estop_closed = false;
            bench.run(3);
        } else {
            bench.done(Command::Stop);
        }
        bench.run(LET_GO_US / 1_000 - 20);
        assert!(!bench.machine.withholds_alive(), "too early");
        bench.run(40);
        assert!(bench.machine.withholds_alive(), "{code:?}");
        assert!(bench.status().alive_withheld);
        bench.estop_closed = true;
        bench.run(3);
        // Cleared while the cable is still held: it comes back.
        let _ = bench.ask(0, Command::ClearFaults);
        bench.run(5);
        assert!(bench.machine.withholds_alive());
        assert_eq!(bench.status().fault, Fault::OutputStuck.code());
        assert!(matches!(
            bench.ask(0, Command::Arm),
            Some(Response::Rejected(CommandError::Faulted(_)))
        ));
        bench.cell_n[3] = Some(1.0);
        bench.run(20);
        let _ = bench.ask(0, Command::ClearFaults);
        bench.run(20);
        assert!(!bench.machine.withholds_alive());
    }
}

/// A reel with much friction holds a cable at 0 V: what is declared of it is no output that is
/// stuck, neither after a stop nor where the amplifiers' power waits for rest. More than that is.
#[test]
fn what_the_declared_friction_holds_at_0_v_is_not_an_output_that_is_stuck() {
    for unit in 0..6 {
        for (coulomb_un, left_n, stuck) in [
            (909_000, 3.5, true),
            (2_409_000, 3.5, false),
            (2_409_000, 4.5, true),
        ] {
            let config = wire::message::UnitConfig {
                coulomb_un,
                // This bench's drives have no friction to make up for.
                friction_feedforward: false,
                ..Config::nominal()
            };
            let mut bench = Bench::ready_with(config);
            bench.done(Command::Arm);
            hold(&mut bench, 6_000_000, 400);
            assert_eq!(bench.machine.system(), SystemState::Running);
            bench.cell_n[unit] = Some(left_n);
            bench.done(Command::Stop);
            bench.run(LET_GO_US / 1_000 + 20);
            let case = format!("unit {unit}, {coulomb_un} uN declared, {left_n} N left");
            assert_eq!(bench.machine.withholds_alive(), stuck, "{case}");
            let cleared = bench.ask(0, Command::ClearFaults);
            bench.run(20);
            assert_eq!(
                bench.machine.withholds_alive(),
                stuck,
                "{case}: {cleared:?}"
            );
            let armed = bench.ask(0, Command::Arm);
            assert_eq!(armed == Some(Response::Done), !stuck, "{case}: {armed:?}");
        }
    }
}

/// Words that reach the wrong DAC pull a cable that has let go already.
#[test]
fn a_faulted_unit_that_is_pulled_again_loses_its_power() {
    for (later_n, stuck) in [(4.0, true), (1.5, false)] {
        let mut bench = held(6_000_000);
        let run = |bench: &mut Bench, ms: u32| {
            for _ in 0..ms / 5 {
                bench.setpoints(6_000_000);
                bench.run(5);
            }
        };
        bench.cell_n[3] = Some(-3.0);
        run(&mut bench, 60);
        assert_ne!(fault(&bench, 3), 0);
        bench.cell_n[3] = Some(0.5);
        run(&mut bench, 200);
        assert!(!bench.machine.withholds_alive());
        bench.cell_n[3] = Some(later_n);
        run(&mut bench, 40);
        assert!(!bench.machine.withholds_alive(), "too early");
        run(&mut bench, 100);
        assert_eq!(bench.machine.withholds_alive(), stuck, "{later_n} N");
    }
}

/// The same, seen by the encoder alone: a reel at 0 V that speeds up is driven.
#[test]
fn a_reel_that_speeds_up_at_0_v_loses_the_power_at_once() {
    // Counts of the first sample, and how many more each sample has: 3 ms of 8 N are 35. Paid out
    // are 15 a sample, 21 mm/s.
    for (first, more, driven) in [(0, 35, true), (-15, 0, false)] {
        let mut bench = held(6_000_000);
        bench.cell_n[3] = Some(-3.0);
        hold(&mut bench, 6_000_000, 60);
        assert_ne!(fault(&bench, 3), 0);
        bench.cell_n[3] = Some(0.5);
        hold(&mut bench, 6_000_000, 100);
        for sample in 0..10 {
            bench.wound[3] += first + more * sample;
            bench.setpoints(6_000_000);
            bench.run(3);
            if driven && sample >= 3 {
                assert!(bench.machine.withholds_alive(), "{sample}");
                assert!(bench.all_at_zero());
            }
        }
        assert_eq!(bench.machine.withholds_alive(), driven, "{first} {more}");
    }
}

/// A reel that winds in when its unit faults goes on for a moment, and gets slower.
#[test]
fn a_reel_that_coasts_is_no_fault() {
    let mut bench = held(6_000_000);
    bench.cell_n[3] = Some(-3.0);
    let mut speed = 60;
    for _ in 0..30 {
        bench.wound[3] += speed;
        bench.setpoints(6_000_000);
        bench.run(3);
        if fault(&bench, 3) != 0 {
            bench.cell_n[3] = Some(0.5);
            speed = (speed - 5).max(0);
        }
    }
    assert_eq!(speed, 0);
    assert!(!bench.machine.withholds_alive());
}

/// The output is stuck, and nobody repaired it: with the clear the power comes back, and the motor
/// pulls again.
#[test]
fn an_output_that_is_still_stuck_after_a_clear_loses_its_power_again() {
    // At once with the power, and long after it.
    for later_ms in [0, u32::from(TRIAL_MS)] {
        let mut bench = held(6_000_000);
        bench.cell_n[3] = Some(6.0);
        bench.done(Command::Stop);
        bench.run(200);
        assert!(bench.machine.withholds_alive() && bench.machine.holds_dacs());
        // The PLC took the power: the cable goes slack.
        bench.cell_n[3] = Some(0.5);
        bench.wound[3] -= 800;
        bench.run(50);
        bench.done(Command::ClearFaults);
        bench.run(20 + later_ms);
        assert!(!bench.machine.withholds_alive() && !bench.machine.holds_dacs());
        // The reel winds in, and the load cell's filters show it later.
        for _ in 0..5 {
            bench.wound[3] += 160;
            bench.run(3);
        }
        assert_eq!(bench.machine.withholds_alive(), later_ms == 0);
        bench.run(9);
        bench.cell_n[3] = Some(6.0);
        bench.run(LET_GO_US / 1_000 + 20);
        assert!(bench.machine.withholds_alive() && bench.machine.holds_dacs());
        assert_eq!(bench.status().fault, Fault::OutputStuck.code());
    }
    // Other electronics drive the motors of a board that only measures.
    let mut bench = Bench::ready();
    bench.run(u32::from(TRIAL_MS));
    for _ in 0..5 {
        bench.wound[3] += 160;
        bench.run(3);
    }
    bench.cell_n[3] = Some(6.0);
    bench.run(200);
    assert!(!bench.machine.withholds_alive());
    // A weight that is hung on a cable, or a robot that moves away, makes the reel pay out: no
    // fault.
    let mut bench = held(6_000_000);
    bench.done(Command::Stop);
    bench.run(500);
    bench.cell_n[3] = Some(6.0);
    for _ in 0..100 {
        bench.wound[3] -= 20;
        bench.run(3);
    }
    assert!(!bench.machine.withholds_alive());
}

/// The load cell reads too little and the output is stuck: only the encoder can tell that the cable
/// is still held.
#[test]
fn a_stuck_output_behind_a_load_cell_that_reads_low_loses_its_power() {
    // Counts a millisecond that the robot makes the reel wind in.
    for wound in [0, 1] {
        let mut bench = held(6_000_000);
        bench.stuck[3] = true;
        bench.cell_n[3] = Some(0.0);
        hold(&mut bench, 6_000_000, 100);
        assert_ne!(fault(&bench, 3), 0);
        for _ in 0..30 {
            bench.setpoints(6_000_000);
            for _ in 0..5 {
                bench.wound[3] += wound;
                bench.run(1);
            }
        }
        assert!(bench.machine.withholds_alive(), "{wound}");
    }
    // The output follows: the others continue.
    let mut bench = held(6_000_000);
    bench.cell_n[3] = Some(0.0);
    hold(&mut bench, 6_000_000, 300);
    assert_ne!(fault(&bench, 3), 0);
    assert!(!bench.machine.withholds_alive());
    assert_eq!(bench.machine.system(), SystemState::Running);
}

/// With every motor at 0 V a reel may be turned by hand.
#[test]
fn a_reel_turned_by_hand_is_no_fault() {
    let mut bench = held(6_000_000);
    bench.done(Command::Stop);
    bench.run(500);
    for sample in 0..20 {
        bench.wound[3] += 35 * sample;
        bench.run(3);
    }
    assert!(!bench.machine.withholds_alive());
}

#[test]
fn a_reel_without_a_load_cell_that_speeds_up_loses_the_power() {
    let mut bench = held(6_000_000);
    bench.streaming[2] = false;
    hold(&mut bench, 6_000_000, 40);
    assert_eq!(fault(&bench, 2), Fault::SensorSilent.code());
    let mut counts = bench.encoder[2] - 40;
    let mut speed = 0;
    for ms in 0..75 {
        if ms % 5 == 0 {
            bench.setpoints(6_000_000);
        }
        bench.run(1);
        if bench.machine.withholds_alive() {
            break;
        }
        assert!(
            bench.machine.wants_encoders().contains(UnitIndex::Unit3),
            "{ms}"
        );
        bench
            .machine
            .encoder(UnitIndex::Unit3, EncoderCounts(counts));
        if ms >= 60 {
            // 4 N: 8 mm/s more each millisecond.
            speed += 2;
            counts += speed;
        }
        assert!(ms < 74, "still powered");
    }
    assert!(counts > bench.encoder[2] - 40, "it rested");
}

#[test]
fn a_cable_that_lets_go_is_no_fault() {
    let mut bench = held(6_000_000);
    bench.done(Command::Stop);
    bench.run(500);
    assert!(!bench.machine.withholds_alive());
    assert_eq!(bench.status().fault, Fault::HostStop.code());
}

/// Without its load cell, the encoder shows whether the cable let go.
#[test]
fn a_motor_without_a_load_cell_is_watched_by_its_encoder() {
    for (paid_out, stuck) in [(0, true), (20, false)] {
        let mut bench = held(6_000_000);
        let counts = bench.encoder[2] - paid_out;
        bench.streaming[2] = false;
        for _ in 0..40 {
            bench.setpoints(6_000_000);
            bench.run(5);
            if bench.machine.wants_encoders().contains(UnitIndex::Unit3) {
                bench
                    .machine
                    .encoder(UnitIndex::Unit3, EncoderCounts(counts));
            }
        }
        assert_eq!(fault(&bench, 2), Fault::SensorSilent.code());
        assert_eq!(bench.machine.withholds_alive(), stuck, "{counts} counts");
    }
}

#[test]
fn a_lost_dac_link_withholds_the_alive_line() {
    let mut bench = held(3_000_000);
    bench.dac_error = Some(0x1002);
    bench.run(2);
    assert_eq!(bench.status().fault, Fault::DacLink.code());
    assert!(bench.machine.withholds_alive());
}

#[test]
fn the_board_guards_the_tip_whatever_the_host_believes() {
    // All six cables pull the same way, as a wrong rig file has them: 6 x 3 N.
    let mut bench = held(3_000_000);
    let [x, y, z] = bench.status().tip_force_un;
    assert!(x.abs() < 100_000 && y.abs() < 100_000 && z.abs() < 100_000);
    bench.directions = [[0, wire::message::DIRECTION_ONE, 0]; 6];
    hold(&mut bench, 3_000_000, 100);
    assert_eq!(bench.machine.system(), SystemState::Running, "18 N of 20");
    let [_, y, _] = bench.status().tip_force_un;
    assert!((17_000_000..19_000_000).contains(&y), "{y}");
    hold(&mut bench, 4_000_000, 200);
    assert_eq!(bench.status().fault, Fault::TipForce.code());
    assert!(bench.all_at_zero());
}

#[test]
fn the_limit_at_the_tip_is_configured_and_checked() {
    let mut bench = Bench::ready();
    let stage = |tip_force_limit_un| Command::StageBoard {
        config: wire::message::BoardConfig {
            tip_force_limit_un,
            ..Default::default()
        },
    };
    let refused = bench.ask(0, stage(999_999));
    assert!(matches!(
        refused,
        Some(Response::Rejected(CommandError::Range {
            unit: 255,
            field: 1
        }))
    ));
    bench.done(stage(5_000_000));
    bench.done(Command::CommitConfig);
    bench.done(Command::Arm);
    bench.directions = [[0, wire::message::DIRECTION_ONE, 0]; 6];
    hold(&mut bench, 1_500_000, 300);
    assert_eq!(bench.status().fault, Fault::TipForce.code());
}
