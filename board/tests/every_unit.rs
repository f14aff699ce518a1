//! What stops a motor, for each of the six units, and after which time. The times are those of
//! docs/safety.md, as numbers: a test that took them from the constants could not notice that one
//! changed.

mod common;
use common::Bench;

use board::bus;
use control::{
    AdcCode, DacCode, EncoderCounts, Fault, Micros, MotorState, SystemState, UnitIndex, UNITS,
};
use drivers::nau7802::{Action, Bringup, Config as AdcConfig, Event as AdcEvent};
use wire::message::{CommandError, Response, UnitSetpoint};
use wire::Command;

fn held() -> Bench {
    let mut bench = Bench::armed();
    hold(&mut bench, 4_000_000, 300);
    assert!(bench.last.iter().all(|dac| dac.steps() > 100));
    bench.board.zeroed.clear();
    bench.board.stopped.clear();
    bench
}

fn hold(bench: &mut Bench, tension_un: i32, ms: u32) {
    for _ in 0..ms / 10 {
        bench.setpoints(tension_un);
        bench.run(10);
    }
}

/// The unit is faulted and was put to 0 V at once, its converter was stopped or not, and the others
/// go on.
fn only(bench: &mut Bench, unit: usize, fault: Fault, stopped: bool) {
    let index = UnitIndex::ALL[unit];
    let status = bench.status();
    assert_eq!(
        Fault::from_code(status.units[unit].fault),
        Some(fault),
        "unit {unit}"
    );
    assert_eq!(status.units[unit].state, MotorState::Faulted as u8);
    assert!(
        bench.board.zeroed.contains(&index),
        "{fault:?}, unit {unit}: no 0 V"
    );
    assert_eq!(
        bench.board.stopped.contains(&index),
        stopped,
        "{fault:?}, unit {unit}"
    );
    for other in (0..UNITS).filter(|other| *other != unit) {
        assert_eq!(
            status.units[other].fault, 0,
            "{fault:?}, unit {unit} and {other}"
        );
        assert!(!bench.board.zeroed.contains(&UnitIndex::ALL[other]));
    }
    assert_eq!(
        (status.fault, status.state),
        (0, SystemState::Running as u8)
    );
    let report = bench.board.reports.last().expect("a report");
    assert_eq!((report.unit, report.code), (unit as u8, fault.code()));
}

#[test]
fn a_silent_converter_stops_its_unit_after_12_5_ms() {
    for unit in 0..UNITS {
        let mut bench = held();
        while !(bench.now.0 / 1_000).is_multiple_of(3) {
            bench.run(1);
        }
        bench.streaming[unit] = false;
        bench.setpoints(4_000_000);
        bench.run(12);
        assert_eq!(
            bench.status().units[unit].fault,
            0,
            "12 ms after its last sample"
        );
        bench.run(1);
        only(&mut bench, unit, Fault::SensorSilent, true);
        // Microseconds without a sample.
        assert_eq!(bench.status().units[unit].fault_detail, 13_000);
        assert_eq!(bench.board.reports.last().expect("a report").detail, 13_000);
    }
}

/// Samples of one unit with this period; the others stream as ever.
fn with_period(bench: &mut Bench, unit: usize, period_us: u32, samples: u32) {
    bench.streaming[unit] = false;
    let mut at = bench.now;
    for n in 0..samples {
        at = at.plus(period_us);
        while at.until(bench.now) < 0 {
            if n % 4 == 0 {
                bench.setpoints(4_000_000);
            }
            bench.run(1);
        }
        let code = AdcCode::new(580_000 + (n as i32 % 5) * 20);
        let counts = EncoderCounts(bench.encoder[unit]);
        let (_, mut pending) =
            (bench.machine).sample(UnitIndex::ALL[unit], code, counts, at, 0, &mut bench.board);
        bench.machine.check(&mut pending, &mut bench.board);
        if bench.status().units[unit].fault != 0 {
            return;
        }
    }
    bench.run(1);
}

#[test]
fn a_rate_outside_297_to_344_a_second_stops_its_unit() {
    for unit in 0..UNITS {
        for (period_us, fault) in [
            (2_880, Some(Fault::SensorFast)),
            (2_920, None),
            (3_350, None),
            (3_390, Some(Fault::SensorSlow)),
        ] {
            let mut bench = Bench::armed();
            hold(&mut bench, 4_000_000, 300);
            bench.board.zeroed.clear();
            with_period(&mut bench, unit, period_us, 150);
            let found = Fault::from_code(bench.status().units[unit].fault);
            // The load of this test is not the command's: only what the rate makes counts.
            let of_rate =
                found.filter(|fault| matches!(fault, Fault::SensorFast | Fault::SensorSlow));
            assert_eq!(of_rate, fault, "unit {unit}, {period_us} us: {found:?}");
            assert_eq!(
                bench.board.zeroed.contains(&UnitIndex::ALL[unit]),
                found.is_some()
            );
        }
    }
}

#[test]
fn the_fourth_failed_read_in_a_row_stops_its_unit_and_its_converter() {
    for unit in UnitIndex::ALL {
        let mut bench = held();
        let failed = |bench: &mut Bench, in_a_row| {
            let event = bus::Event::ReadFailed { unit, in_a_row };
            bench.machine.bus_event(event, bench.now, &mut bench.board);
        };
        failed(&mut bench, 3);
        assert_eq!(bench.status().units[unit as usize].fault, 0);
        failed(&mut bench, 4);
        only(&mut bench, unit as usize, Fault::SensorReads, true);
    }
}

#[test]
fn a_failed_bring_up_faults_its_unit_and_stops_its_converter() {
    for unit in UnitIndex::ALL {
        let mut bench = Bench::ready();
        let mut machine = Bringup::new(AdcConfig::FORCE_UNIT);
        let mut action = machine.next(AdcEvent::Start);
        let error = loop {
            match action {
                Action::Failed(error) => break error,
                _ => action = machine.next(AdcEvent::BusFault),
            }
        };
        let event = bus::Event::BringUpFailed { unit, error };
        bench.machine.bus_event(event, bench.now, &mut bench.board);
        let status = bench.status().units[unit as usize];
        assert_eq!(status.fault, Fault::BringUpFailed.code());
        assert!(bench.board.stopped.contains(&unit) && bench.board.zeroed.contains(&unit));
        assert!(matches!(
            bench.ask(0, Command::Arm),
            Some(Response::Rejected(CommandError::Faulted(_)))
        ));
    }
}

#[test]
fn a_bring_up_without_a_sample_for_100_ms_has_failed() {
    for unit in UnitIndex::ALL {
        let mut bench = Bench::ready();
        let event = bus::Event::ReadFailed { unit, in_a_row: 4 };
        bench.machine.bus_event(event, bench.now, &mut bench.board);
        bench.done(Command::ClearFaults);
        bench.held_back[unit as usize] = true;
        bench.board.started.clear();
        bench.streaming[unit as usize] = false;
        bench
            .machine
            .bus_event(bus::Event::Up { unit }, bench.now, &mut bench.board);
        bench.run(100);
        assert_eq!(bench.status().units[unit as usize].fault, 0);
        bench.run(1);
        let status = bench.status().units[unit as usize];
        assert_eq!(
            (status.fault, status.fault_detail >> 8),
            (Fault::BringUpFailed.code(), 7)
        );
    }
}

#[test]
fn five_noise_events_within_a_second_stop_their_unit() {
    for unit in UnitIndex::ALL {
        let mut bench = held();
        let noise = |bench: &mut Bench, events: u32, gap_us: u32| {
            let mut at = bench.now;
            for _ in 0..events {
                at = at.plus(gap_us);
                bench
                    .machine
                    .encoder_noise(unit, 0x10, at, &mut bench.board);
            }
            bench.now = at;
        };
        noise(&mut bench, 8, 300_000);
        assert_eq!(bench.status().units[unit as usize].fault, 0);
        let mut bench = held();
        noise(&mut bench, 4, 240_000);
        assert_eq!(bench.status().units[unit as usize].fault, 0);
        noise(&mut bench, 1, 30_000);
        only(&mut bench, unit as usize, Fault::EncoderError, false);
    }
}

/// A unit that follows setpoints has 13 N as its limit, one at 0 V the 20 N of the rig file: it may
/// have no zero.
#[test]
fn over_tension_is_13_n_while_a_unit_is_driven() {
    for unit in 0..UNITS {
        for (driven, cell_n, expected) in [
            (true, 13.3, Some(Fault::OverTension)),
            (true, 12.7, None),
            (false, 13.3, None),
        ] {
            let mut bench = if driven { held() } else { Bench::ready() };
            bench.cell_n[unit] = Some(cell_n);
            bench.run(13);
            let fault = Fault::from_code(bench.status().units[unit].fault);
            assert_eq!(fault, expected, "unit {unit}, {cell_n} N, driven {driven}");
        }
    }
}

/// One that was driven waits until the cable is below 13 N, one at 0 V until it is below 20 N.
#[test]
fn over_tension_is_cleared_below_the_limit_that_it_passed() {
    for unit in 0..UNITS {
        for (driven, tripped_n, too_tight_n, loose_n) in
            [(true, 13.5, 13.3, 12.7), (false, 20.5, 20.3, 19.7)]
        {
            let mut bench = if driven { held() } else { Bench::ready() };
            if !driven {
                // The power's trial of the outputs is over.
                bench.run(310);
            }
            bench.cell_n[unit] = Some(tripped_n);
            bench.run(13);
            let code = Fault::OverTension.code();
            assert_eq!(bench.status().units[unit].fault, code, "unit {unit}");
            if driven {
                // The cable lets go, and the robot pulls it afterwards.
                bench.cell_n[unit] = Some(1.0);
                bench.run(100);
            }
            for (cell_n, left) in [(too_tight_n, code), (loose_n, 0)] {
                bench.cell_n[unit] = Some(cell_n);
                bench.run(24);
                bench.ask(0, Command::ClearFaults);
                let fault = bench.status().units[unit].fault;
                assert_eq!(fault, left, "unit {unit}, {cell_n} N, driven {driven}");
            }
        }
    }
}

/// A clear compares what trips, before the filter, and the filtered tension too: neither a pull
/// that the filter does not show yet nor one that it still shows is cleared.
#[test]
fn over_tension_is_cleared_by_the_tension_before_and_behind_the_filter() {
    for unit in 0..UNITS {
        for (driven, limit_n) in [(true, 13.0), (false, 20.0)] {
            // Of the sample before, and of the newest; whether it is cleared.
            for (before_n, newest_n, cleared) in [
                (-0.5, 0.06, false),
                (0.5, -0.01, false),
                (-0.5, -0.06, true),
            ] {
                let mut bench = if driven { held() } else { Bench::ready() };
                if !driven {
                    // The power's trial of the outputs is over.
                    bench.run(310);
                }
                let pull = |bench: &mut Bench, above_n: f64, samples: u32| {
                    bench.cell_n[unit] = Some(limit_n + above_n);
                    for _ in 0..samples {
                        bench.run(1);
                        while !(bench.now.0 / 1_000).is_multiple_of(3) {
                            bench.run(1);
                        }
                    }
                };
                if driven {
                    hold(&mut bench, 4_000_000, 10);
                }
                pull(&mut bench, 0.5, 5);
                let code = Fault::OverTension.code();
                assert_eq!(bench.status().units[unit].fault, code, "unit {unit}");
                pull(&mut bench, before_n, 8);
                pull(&mut bench, newest_n, 1);
                bench.ask(0, Command::ClearFaults);
                let left = bench.status().units[unit].fault;
                let wanted = if cleared { 0 } else { code };
                assert_eq!(
                    left, wanted,
                    "unit {unit}, {before_n}, then {newest_n} N above {limit_n} N"
                );
            }
        }
    }
}

/// A pull past 20 N behind a trip at 13 N does not raise the limit of its clear. A converter that
/// has stopped since then holds no clear up: it begins anew, and the power waits for its unit at
/// rest.
#[test]
fn over_tension_is_cleared_by_the_limit_of_the_first_trip_as_long_as_it_is_measured() {
    for unit in 0..UNITS {
        let code = Fault::OverTension.code();
        let mut bench = held();
        for n in [13.5, 20.5, 14.0] {
            bench.cell_n[unit] = Some(n);
            bench.run(18);
        }
        assert_eq!(bench.status().fault, 0, "of the unit alone");
        bench.ask(0, Command::ClearFaults);
        assert_eq!(bench.status().units[unit].fault, code, "unit {unit}");
        let silent = bus::Event::ReadFailed {
            unit: UnitIndex::ALL[unit],
            in_a_row: 4,
        };
        let mut bench = held();
        bench.cell_n[unit] = Some(13.5);
        bench.run(13);
        bench.machine.bus_event(silent, bench.now, &mut bench.board);
        bench.streaming[unit] = false;
        bench.ask(0, Command::ClearFaults);
        assert_eq!(bench.status().units[unit].fault, 0, "unit {unit}");
        assert!(bench.machine.withholds_alive() || bench.machine.system().drives());
    }
}

/// An arming of a board that runs renews no setpoints.
#[test]
fn an_arming_while_running_does_not_prolong_setpoints() {
    let mut bench = held();
    bench.now.0 += 150_000;
    bench.ask(0, Command::Arm);
    bench.run(1);
    assert_eq!(bench.status().fault, Fault::SetpointsExpired.code());
}

/// What one sample, or a few, of a unit show.
#[test]
fn what_a_load_cell_shows_stops_its_unit_only() {
    for unit in 0..UNITS {
        // Over-tension: two samples behind the one that the spike gate holds back.
        let mut bench = held();
        while !(bench.now.0 / 1_000).is_multiple_of(3) {
            bench.run(1);
        }
        bench.setpoints(4_000_000);
        bench.cell_n[unit] = Some(25.0);
        bench.run(6);
        assert_eq!(
            bench.status().units[unit].fault,
            0,
            "one may be a read error"
        );
        bench.run(6);
        only(&mut bench, unit, Fault::OverTension, false);
        // The same code eight times.
        let mut bench = held();
        bench.noise = false;
        let load_n = bench.status().units[unit].tension_un;
        bench.cell_n[unit] = Some(f64::from(load_n) * 1e-6);
        let mut samples = 0;
        for _ in 0..40 {
            bench.setpoints(4_000_000);
            bench.run(1);
            samples += u32::from((bench.now.0 / 1_000).is_multiple_of(3));
            if bench.status().units[unit].fault != 0 {
                break;
            }
        }
        assert_eq!(bench.status().units[unit].fault, Fault::SensorFrozen.code());
        assert!((7..=8).contains(&samples), "{samples}");
        assert!(bench.board.stopped.contains(&UnitIndex::ALL[unit]));
        // The end of the converter's range.
        let mut bench = held();
        for _ in 0..2 {
            let (_, mut pending) = bench.machine.sample(
                UnitIndex::ALL[unit],
                AdcCode::MAX,
                EncoderCounts(0),
                bench.now,
                0,
                &mut bench.board,
            );
            bench.machine.check(&mut pending, &mut bench.board);
        }
        assert_ne!(bench.status().units[unit].fault, 0);
        assert!(bench.board.zeroed.contains(&UnitIndex::ALL[unit]));
    }
}

#[test]
fn every_fault_of_the_board_puts_all_six_to_0_v_at_once_and_keeps_them_there() {
    for fault in Fault::ALL.iter().copied().filter(|fault| fault.code() < 32) {
        let mut bench = held();
        bench
            .machine
            .fault_board(fault, 3, bench.now, &mut bench.board);
        for unit in UnitIndex::ALL {
            assert!(bench.board.zeroed.contains(&unit), "{fault:?}, {unit:?}");
        }
        assert_eq!(bench.machine.system(), SystemState::Fault);
        bench.run(6);
        assert!(bench.all_at_zero(), "{fault:?}");
        bench.setpoints(4_000_000);
        bench.run(30);
        assert!(bench.all_at_zero(), "{fault:?}");
        assert_eq!(bench.status().fault, fault.code());
        // With nothing driven too: a word may have changed on its way.
        let mut bench = Bench::ready();
        bench.board.zeroed.clear();
        bench
            .machine
            .fault_board(fault, 3, bench.now, &mut bench.board);
        for unit in UnitIndex::ALL {
            assert!(bench.board.zeroed.contains(&unit), "{fault:?}, {unit:?}");
        }
    }
}

/// Setpoints in a row on a link, and what becomes of them.
fn setpoints_on(
    bench: &mut Bench,
    link: usize,
    valid_ms: u16,
    tension_un: i32,
) -> Option<Response> {
    let units = core::array::from_fn(|unit| UnitSetpoint {
        tension_un,
        inv_cos_q16: 65_536,
        direction_q14: bench.directions[unit],
        reel_um_per_s: None,
    });
    bench.ask(link, Command::Setpoints { valid_ms, units })
}

#[test]
fn setpoints_expire_after_the_time_that_the_frame_names_on_both_links() {
    for link in [0, 1] {
        for valid_ms in [1, 50, 100, 1_000] {
            let mut bench = Bench::ready();
            bench.hello(link);
            bench.run(20);
            assert_eq!(bench.ask(link, Command::Arm), Some(Response::Done));
            assert_eq!(setpoints_on(&mut bench, link, valid_ms, 3_000_000), None);
            bench.run(u32::from(valid_ms));
            assert_eq!(
                bench.machine.system(),
                SystemState::Running,
                "{valid_ms} ms"
            );
            bench.run(1);
            assert_eq!(
                bench.status().fault,
                Fault::SetpointsExpired.code(),
                "link {link}, {valid_ms} ms"
            );
        }
        for valid_ms in [0, 1_001] {
            let mut bench = Bench::armed();
            let refused = setpoints_on(&mut bench, 0, valid_ms, 3_000_000);
            assert!(matches!(
                refused,
                Some(Response::Rejected(CommandError::Range {
                    unit: 255,
                    field: 0
                }))
            ));
        }
    }
}

#[test]
fn the_first_setpoints_are_awaited_for_a_second() {
    let mut bench = Bench::ready();
    bench.run(20);
    bench.done(Command::Arm);
    bench.run(1_000);
    assert_eq!(bench.machine.system(), SystemState::Running);
    bench.run(1);
    assert_eq!(bench.status().fault, Fault::SetpointsExpired.code());
}

/// Setpoints from before a stop, a disarming or a fault are forgotten: neither they nor their time
/// count in the next run.
#[test]
fn nothing_of_a_run_is_left_for_the_next() {
    for end in [Command::Stop, Command::Disarm] {
        let mut bench = Bench::armed();
        for _ in 0..30 {
            setpoints_on(&mut bench, 0, 1_000, 6_000_000);
            bench.run(10);
        }
        assert!(bench.status().setpoint_age_ms < 20);
        bench.done(end.clone());
        bench.run(500);
        assert_eq!(bench.status().setpoint_age_ms, u16::MAX, "{end:?}");
        let _ = bench.ask(0, Command::ClearFaults);
        bench.run(2);
        bench.done(Command::Arm);
        bench.run(950);
        assert_eq!(
            bench.machine.system(),
            SystemState::Running,
            "{end:?}: a whole second for the first"
        );
        assert!(
            bench.all_at_zero(),
            "{end:?}: without setpoints nothing pulls"
        );
    }
}

#[test]
fn a_setpoint_above_the_permitted_tension_is_refused_for_each_unit() {
    for unit in 0..UNITS {
        for (tension_un, taken) in [
            (12_000_000, true),
            (12_000_001, false),
            (16_000_000, false),
            (-1, false),
        ] {
            let mut bench = Bench::armed();
            let mut units = [UnitSetpoint {
                tension_un: 3_000_000,
                inv_cos_q16: 65_536,
                direction_q14: [0; 3],
                reel_um_per_s: None,
            }; UNITS];
            units[unit].tension_un = tension_un;
            let answer = bench.ask(
                0,
                Command::Setpoints {
                    valid_ms: 100,
                    units,
                },
            );
            let refused = CommandError::Range {
                unit: unit as u8,
                field: 0,
            };
            assert_eq!(
                answer,
                (!taken).then_some(Response::Rejected(refused)),
                "{tension_un}"
            );
        }
    }
}

#[test]
fn a_commander_that_is_silent_for_200_ms_is_replaced() {
    let mut bench = Bench::ready();
    bench.hello(1);
    bench.run(20);
    bench.done(Command::Arm);
    bench.run(200);
    let refused = Some(Response::Rejected(CommandError::NotConnected));
    assert_eq!(bench.ask(1, Command::Disarm), refused);
    bench.run(1);
    assert_eq!(bench.ask(1, Command::Disarm), Some(Response::Done));
}

#[test]
fn an_e_stop_that_bounces_for_a_millisecond_is_none() {
    let mut bench = held();
    bench.setpoints(4_000_000);
    bench.estop_closed = false;
    bench.run(1);
    bench.estop_closed = true;
    bench.run(1);
    assert_eq!(bench.status().fault, 0);
    bench.estop_closed = false;
    bench.run(2);
    assert_eq!(bench.status().fault, Fault::EStop.code());
}

#[test]
fn a_pass_of_1_5_ms_is_the_longest() {
    for (longest_pass_us, fault) in [(1_500, 0), (1_501, Fault::LoopOverrun.code())] {
        let mut bench = held();
        let health = board::machine::Health {
            estop_closed: true,
            longest_pass_us,
            ..Default::default()
        };
        bench.machine.tick(bench.now, health, &mut bench.board);
        assert_eq!(bench.status().fault, fault);
    }
}

/// Nothing is connected to it.
#[test]
fn a_unit_that_is_switched_off_is_left_alone() {
    for unit in UnitIndex::ALL {
        let mut bench = Bench::new(None);
        bench.run(3);
        for _ in 0..10 {
            bench
                .machine
                .encoder_noise(unit, 0x10, bench.now, &mut bench.board);
        }
        assert_eq!(bench.status().units[unit as usize].fault, 0);
        let (word, _) = (bench.machine).sample(
            unit,
            AdcCode::new(9),
            EncoderCounts(0),
            Micros(5),
            0,
            &mut bench.board,
        );
        assert_eq!(word, DacCode::ZERO_VOLT);
    }
}

/// 1 mm in a sample is more than a reel can speed up by; the encoder has jumped.
#[test]
fn an_encoder_that_jumps_stops_its_unit_with_that_sample() {
    for unit in 0..UNITS {
        for (counts, fault) in [
            (300, Fault::EncoderError.code()),
            (-300, Fault::EncoderError.code()),
            (200, 0),
        ] {
            let mut bench = held();
            bench.wound[unit] += counts;
            bench.run(3);
            // Less is a surge of the reel, or nothing.
            let found = bench.status().units[unit].fault;
            let jumped = found == Fault::EncoderError.code();
            assert_eq!(jumped, fault != 0, "unit {unit}, {counts} counts: {found}");
            if jumped {
                only(&mut bench, unit, Fault::EncoderError, false);
                let um = bench.status().units[unit].fault_detail;
                assert!(
                    (1_150..1_400).contains(&(um & 0x7FFF_FFFF)) && um >> 31 == 1,
                    "{um:#x}"
                );
            }
        }
        // At 0 V somebody may turn it: no fault, and nothing is driven.
        let mut bench = Bench::ready();
        bench.run(400);
        bench.wound[unit] += 3_000;
        bench.run(6);
        assert_eq!(bench.status().units[unit].fault, 0);
    }
}

/// One cable alone pulls at the tip with its tension.
#[test]
fn each_cable_counts_at_the_tip() {
    for unit in 0..UNITS {
        for (tension_un, exceeded) in [(2_700_000, false), (4_000_000, true)] {
            let mut bench = Bench::ready();
            let config = wire::message::BoardConfig {
                tip_force_limit_un: 3_000_000,
                ..Default::default()
            };
            bench.done(Command::StageBoard { config });
            bench.done(Command::CommitConfig);
            bench.run(50);
            bench.done(Command::Arm);
            let units = core::array::from_fn(|other| UnitSetpoint {
                tension_un: if other == unit { tension_un } else { 0 },
                inv_cos_q16: 65_536,
                direction_q14: bench.directions[other],
                reel_um_per_s: None,
            });
            let mut above_ms = 0;
            for ms in 0..300 {
                if ms % 10 == 0 {
                    let setpoints = Command::Setpoints {
                        valid_ms: 100,
                        units,
                    };
                    let _ = bench.ask(0, setpoints);
                }
                bench.run(1);
                let status = bench.status();
                if status.fault != 0 {
                    break;
                }
                let largest_un = status.tip_force_un.iter().map(|un| un.abs()).max();
                above_ms = if largest_un > Some(3_000_000) {
                    above_ms + 1
                } else {
                    0
                };
                assert!(above_ms <= 12, "unit {unit}, {tension_un} uN");
            }
            let fault = Fault::from_code(bench.status().fault);
            assert_eq!(
                fault,
                exceeded.then_some(Fault::TipForce),
                "unit {unit}, {tension_un} uN"
            );
            bench.run(3);
            assert_eq!(bench.all_at_zero(), exceeded);
        }
    }
}

/// A slack cable that somebody winds in, and a weight that is hung on it later, are no output that
/// pulls.
#[test]
fn cable_that_was_wound_in_without_tension_is_forgotten() {
    for unit in 0..UNITS {
        let mut bench = held();
        bench.done(Command::Stop);
        bench.run(500);
        for _ in 0..100 {
            bench.wound[unit] += 30;
            bench.run(3);
        }
        bench.run(1_000);
        bench.cell_n[unit] = Some(3.0);
        bench.run(300);
        assert!(!bench.machine.withholds_alive(), "unit {unit}");
        assert_eq!(bench.status().fault, Fault::HostStop.code());
    }
}

/// A reel that turns while its zero is measured has a tight cable, and the robot moves: however
/// steady the load cell is.
#[test]
fn a_zero_is_refused_while_the_reel_turns() {
    for unit in 0..UNITS {
        // 4,229 nm a count: 23 are 97 um.
        for (counts, refused) in [(30, true), (-30, true), (22, false), (-22, false)] {
            let mut bench = Bench::ready();
            bench.cell_n[unit] = Some(0.9);
            bench.run(400);
            bench.done(Command::Zero { units: 0b11_1111 });
            bench.run(100);
            bench.wound[unit] += counts;
            bench.run(850);
            let status = bench.status();
            let fault = Fault::from_code(status.units[unit].fault);
            assert_eq!(fault, refused.then_some(Fault::ZeroRefused), "{counts}");
            if refused {
                // Micrometres.
                assert_eq!(status.units[unit].fault_detail, 126 | 1 << 30);
            }
            for other in (0..UNITS).filter(|other| *other != unit) {
                assert_eq!(status.units[other].fault, 0);
            }
        }
    }
}

/// Nothing shows how fast a slack cable is taken up where the encoder stands still: the command
/// rises, and the reel rests.
#[test]
fn a_slack_cable_whose_encoder_stands_still_stops_its_unit() {
    for unit in 0..UNITS {
        let mut bench = Bench::ready();
        bench.cell_n[unit] = Some(0.0);
        bench.run(400);
        bench.done(Command::Arm);
        bench.board.zeroed.clear();
        let (mut above_ms, mut most_n) = (0, 0.0f64);
        for ms in 0..200 {
            if ms % 5 == 0 {
                bench.setpoints(8_000_000);
            }
            // As `Bench` turns a reel by its command.
            let steps = f64::from(bench.last[unit].steps());
            bench.wound[unit] = -((steps / 282.22 * 1.018 * 9.85) as i64);
            bench.run(1);
            if bench.status().units[unit].fault != 0 {
                break;
            }
            let command_n = steps / 282.22;
            most_n = most_n.max(command_n);
            above_ms += u32::from(command_n > 1.2);
        }
        only(&mut bench, unit, Fault::Implausible, false);
        // Friction is 0.9 N and more: from here on a reel that is free moves.
        assert!(above_ms <= 50, "unit {unit}: {above_ms} ms");
        assert!(most_n < 5.0, "unit {unit}: {most_n} N");
    }
}
