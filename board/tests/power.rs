//! The amplifiers' power: when the alive line may run, what takes it, and when a fault may be
//! cleared. Each rule for each unit.

mod common;
use common::Bench;

use board::bus;
use board::machine::{Health, MAX_FAILED_READS};
use control::let_go::{LET_GO_US, TRIAL_MS};
use control::{Config, Fault, MotorState, SystemState, UnitIndex, UNITS};
use wire::message::{CommandError, CrashRecord, Response, UnitConfig};
use wire::Command;

/// Until a unit that comes up has a sample, and has been at rest for 10 ms. The times here are
/// those of docs/safety.md, as numbers.
const LATER_MS: u32 = 20;

fn record(fault: Fault) -> Option<CrashRecord> {
    Some(CrashRecord {
        code: fault.code(),
        detail: 1,
        pc: 0,
        text: Default::default(),
    })
}

fn configure(bench: &mut Bench, of: impl Fn(usize) -> UnitConfig) {
    for unit in 0..UNITS {
        let config = of(unit);
        bench.done(Command::StageConfig {
            unit: unit as u8,
            config,
        });
    }
    bench.done(Command::CommitConfig);
}

fn all_but(off: usize) -> impl Fn(usize) -> UnitConfig {
    move |unit| UnitConfig {
        enabled: unit != off,
        ..Config::nominal()
    }
}

fn rejected(fault: Fault) -> Option<Response> {
    Some(Response::Rejected(CommandError::Faulted(fault.code())))
}

/// Armed with 6 N on every cable.
fn held() -> Bench {
    let mut bench = Bench::armed();
    hold(&mut bench, 400);
    assert_eq!(bench.machine.system(), SystemState::Running);
    bench
}

fn hold(bench: &mut Bench, ms: u32) {
    for _ in 0..ms / 10 {
        bench.setpoints(6_000_000);
        bench.run(10);
    }
}

#[test]
fn a_commit_of_nothing_starts_no_alive_line() {
    let mut bench = Bench::new(None);
    bench.run(5);
    bench.hello(0);
    bench.done(Command::CommitConfig);
    bench.run(200);
    assert!(bench.machine.withholds_alive());
    // Nor does one in which no unit is used.
    configure(&mut bench, |_| *Config::default().wire());
    bench.run(200);
    assert!(bench.machine.withholds_alive());
}

#[test]
fn the_alive_line_waits_for_every_enabled_unit() {
    for late in 0..UNITS {
        let mut bench = Bench::new(None);
        bench.run(5);
        bench.hello(0);
        configure(&mut bench, |_| Config::nominal());
        bench.held_back[late] = true;
        bench.run(700);
        assert!(bench.machine.withholds_alive(), "unit {late}");
        bench.held_back[late] = false;
        bench.run(LATER_MS);
        assert!(!bench.machine.withholds_alive(), "unit {late}");
        // A unit that is left out is not waited for.
        let mut bench = Bench::new(None);
        bench.run(5);
        bench.hello(0);
        configure(&mut bench, all_but(late));
        bench.run(LATER_MS + 5);
        assert!(!bench.streaming[late]);
        assert!(!bench.machine.withholds_alive(), "without unit {late}");
    }
}

#[test]
fn a_unit_must_rest_for_10_ms() {
    let mut bench = Bench::new(None);
    bench.run(5);
    bench.hello(0);
    configure(&mut bench, |_| Config::nominal());
    let up = |bench: &Bench| bench.status().units[0].state == MotorState::Ready as u8;
    while !up(&bench) {
        bench.run(1);
    }
    bench.run(8);
    assert!(bench.machine.withholds_alive());
    bench.run(3);
    assert!(!bench.machine.withholds_alive());
}

/// The converter is started anew: until it measures again and shows a cable at rest, a motor that
/// pulls would not be seen.
#[test]
fn a_clear_of_a_units_fault_withholds_the_alive_line_until_it_measures_and_rests() {
    for unit in 0..UNITS {
        let mut bench = held();
        bench.cell_n[unit] = Some(-3.0);
        hold(&mut bench, 60);
        assert_ne!(bench.status().units[unit].fault, 0);
        bench.cell_n[unit] = Some(0.5);
        hold(&mut bench, 100);
        bench.done(Command::Disarm);
        bench.run(600);
        assert!(
            !bench.machine.withholds_alive(),
            "the others have their power"
        );
        bench.done(Command::ClearFaults);
        bench.held_back[unit] = true;
        for _ in 0..700 {
            bench.run(1);
            assert!(bench.machine.withholds_alive(), "unit {unit}");
        }
        let brought_up = CommandError::State(SystemState::BringUp as u8);
        assert_eq!(
            bench.ask(0, Command::Arm),
            Some(Response::Rejected(brought_up))
        );
        bench.held_back[unit] = false;
        bench.run(LATER_MS);
        assert!(!bench.machine.withholds_alive(), "unit {unit}");
        bench.done(Command::Arm);
    }
}

/// A sample that was under way when the converter was started anew is none of the new bring-up:
/// with it the unit would be up, and silent a moment later.
#[test]
fn a_sample_from_before_a_clear_does_not_bring_a_unit_up() {
    for unit in 0..UNITS {
        let mut bench = held();
        bench.cell_n[unit] = Some(-3.0);
        hold(&mut bench, 60);
        bench.cell_n[unit] = Some(0.0);
        bench.done(Command::Stop);
        bench.run(200);
        bench.done(Command::ClearFaults);
        bench.board.started.clear();
        let samples = bench.status().units[unit].samples;
        bench.sample(unit);
        let status = bench.status().units[unit];
        assert_eq!(status.state, MotorState::BringUp as u8);
        assert_eq!(status.samples, samples);
        bench.streaming[unit] = false;
        bench.run(100);
        assert_eq!(bench.status().units[unit].fault, 0, "unit {unit}");
    }
}

/// With the power off a cable is slack. A load cell that shows something else is wrong, or the
/// cable is held: no power, and a fault.
#[test]
fn a_unit_that_does_not_rest_gets_no_power_and_faults() {
    for unit in 0..UNITS {
        for (cell_n, high) in [(4.0, true), (-1.5, false)] {
            let mut bench = Bench::ready();
            bench.load_n = Some(0.0);
            bench.done(Command::Zero { units: 0b11_1111 });
            bench.run(1_000);
            assert_eq!(bench.machine.system(), SystemState::Ready);
            bench.done(Command::Stop);
            bench
                .machine
                .fault_board(Fault::DacLink, 0, bench.now, &mut bench.board);
            bench.cell_n[unit] = Some(cell_n);
            bench.run(50);
            let _ = bench.ask(0, Command::ClearFaults);
            bench.run(500 - 20);
            assert!(bench.machine.withholds_alive());
            let waits = CommandError::UnitNotReady {
                unit: unit as u8,
                state: MotorState::Ready as u8,
            };
            assert_eq!(bench.ask(0, Command::Arm), Some(Response::Rejected(waits)));
            bench.run(40);
            let status = bench.status();
            assert!(status.alive_withheld, "unit {unit}, {cell_n} N");
            assert_eq!(status.units[unit].fault, Fault::Implausible.code());
            assert_eq!(status.units[unit].fault_detail >> 31 == 1, high);
            assert!((0..UNITS).all(|other| other == unit || status.units[other].fault == 0));
        }
        // Before a zero was measured, what a zero may be: 8 N from the stored one.
        for (cell_n, fault) in [(7.5, 0), (8.5, Fault::ZeroRefused.code())] {
            let mut bench = Bench::new(None);
            bench.run(5);
            bench.hello(0);
            configure(&mut bench, |_| Config::nominal());
            bench.cell_n[unit] = Some(cell_n);
            bench.run(500 + 50);
            assert_eq!(
                bench.status().units[unit].fault,
                fault,
                "unit {unit}, {cell_n} N"
            );
            assert_eq!(bench.machine.withholds_alive(), fault != 0);
        }
    }
}

/// An output that stands at some voltage after power-up winds its reel in as soon as the amplifiers
/// have power.
#[test]
fn a_reel_that_winds_in_with_the_power_loses_it_again() {
    for unit in 0..UNITS {
        // Used; left out, and measured all the same as it was up before; left out from the start.
        for left_out in [false, true] {
            let mut bench = Bench::new(None);
            bench.run(5);
            bench.hello(0);
            configure(&mut bench, all_but(if left_out { unit } else { UNITS }));
            while bench.machine.withholds_alive() {
                bench.run(1);
            }
            bench.run(20);
            assert!(!bench.machine.withholds_alive());
            // 0.2 mm; encoders of units that do not stream are the test's.
            for _ in 0..10 {
                bench.wound[unit] += 5;
                let index = UnitIndex::ALL[unit];
                if !bench.streaming[unit] && bench.machine.wants_encoders().contains(index) {
                    bench
                        .machine
                        .encoder(index, control::EncoderCounts(bench.wound[unit]));
                }
                bench.run(1);
            }
            assert!(
                bench.machine.withholds_alive() && bench.machine.holds_dacs(),
                "unit {unit}, {left_out}"
            );
            let status = bench.status();
            assert_eq!(status.fault, Fault::OutputStuck.code());
            assert_eq!(status.fault_detail >> 24, unit as u32 + 1);
        }
        // Paid out as far, and by a hand long after: no fault.
        let mut bench = Bench::ready();
        bench.wound[unit] -= 50;
        bench.run(u32::from(TRIAL_MS) + 10);
        bench.wound[unit] += 50;
        bench.run(20);
        assert!(!bench.machine.withholds_alive());
        // The emergency stop gives it back as well.
        bench.estop_closed = false;
        bench.run(10);
        bench.estop_closed = true;
        bench.run(5);
        bench.wound[unit] += 50;
        bench.run(5);
        assert!(bench.machine.withholds_alive(), "unit {unit}");
    }
}

/// Without its encoder the tension shows it.
#[test]
fn a_cable_that_tightens_with_the_power_loses_it_again() {
    for unit in 0..UNITS {
        let mut bench = Bench::ready();
        bench.run(20);
        bench.cell_n[unit] = Some(3.0);
        bench.run(60);
        assert!(bench.machine.withholds_alive(), "unit {unit}");
        assert_eq!(bench.status().fault, Fault::OutputStuck.code());
    }
}

/// Over-tension with the motor at 0 V: before the first arming, and on a unit that was left out.
#[test]
fn over_tension_at_0_v_takes_the_power() {
    for unit in 0..UNITS {
        for left_out in [false, true] {
            let mut bench = Bench::ready();
            bench.run(u32::from(TRIAL_MS) + 10);
            if left_out {
                configure(&mut bench, all_but(unit));
                bench.run(50);
            }
            assert!(!bench.machine.withholds_alive());
            bench.cell_n[unit] = Some(22.0);
            bench.run(LET_GO_US / 1_000 + 30);
            let status = bench.status();
            assert_eq!(
                status.units[unit].fault,
                Fault::OverTension.code(),
                "unit {unit}"
            );
            assert!(status.alive_withheld, "unit {unit}, {left_out}");
        }
    }
}

/// What stands behind another fault counts as much.
#[test]
fn a_fault_behind_another_takes_the_power_and_outlives_its_clear() {
    // A DAC link that fails behind a stop.
    let mut bench = held();
    bench.done(Command::Stop);
    bench.run(300);
    assert!(!bench.machine.withholds_alive());
    bench.dac_error = Some(0x1002);
    bench.run(2);
    assert!(bench.machine.withholds_alive() && bench.machine.holds_dacs());
    assert_eq!(
        bench.status().fault,
        Fault::HostStop.code(),
        "the first is shown"
    );
    let reported = bench.board.reports.last().expect("a report");
    assert_eq!(reported.code, Fault::DacLink.code());
    let _ = bench.ask(0, Command::ClearFaults);
    bench.run(30);
    assert_eq!(bench.status().fault, Fault::DacLink.code());
    assert_eq!(bench.status().fault_detail, 0x1002);
    assert!(bench.machine.withholds_alive());
    // An emergency stop behind a stop.
    let mut bench = held();
    bench.done(Command::Stop);
    bench.estop_closed = false;
    bench.run(5);
    assert_eq!(bench.ask(0, Command::ClearFaults), rejected(Fault::EStop));
    // A dead counter behind the record of a crash.
    let mut bench = Bench::new(record(Fault::WatchdogReset));
    bench
        .machine
        .fault_board(Fault::CounterBus, 2, bench.now, &mut bench.board);
    bench.run(5);
    bench.hello(0);
    assert_eq!(bench.status().fault, Fault::WatchdogReset.code());
    configure(&mut bench, |_| Config::nominal());
    bench.run(50);
    assert_eq!(
        bench.ask(0, Command::ClearFaults),
        rejected(Fault::CounterBus)
    );
    bench.run(50);
    assert!(bench.machine.withholds_alive());
    assert_eq!(bench.status().fault_detail, 2);
}

/// When a fault may be cleared: every fault, with its cause there and gone.
#[test]
fn every_fault_is_cleared_once_its_cause_is_gone_and_not_before() {
    for fault in Fault::ALL.iter().copied() {
        for unit in 0..UNITS {
            let mut bench = held();
            bench.done(Command::Disarm);
            bench.run(600);
            let index = UnitIndex::ALL[unit];
            let tight = |bench: &mut Bench, n: f64| {
                bench.cell_n[unit] = Some(n);
                bench.run(30);
            };
            // `Some`: the clear is refused while the cause is there, and what removes the cause; a
            // cause that stays: nothing does.
            let mut lasting = false;
            let mut never = false;
            match fault {
                Fault::EStop => {
                    bench.estop_closed = false;
                    lasting = true;
                }
                Fault::CounterBus => never = true,
                Fault::OutputStuck => {
                    bench.done(Command::ClearFaults);
                    bench.run(20);
                    bench.done(Command::Arm);
                    hold(&mut bench, 300);
                    bench.cell_n[unit] = Some(6.0);
                    bench.done(Command::Stop);
                    bench.run(LET_GO_US / 1_000 + 20);
                    lasting = true;
                }
                Fault::OverTension => {
                    tight(&mut bench, 22.0);
                    lasting = true;
                }
                Fault::RegisterChanged => {
                    let health = Health {
                        estop_closed: true,
                        register_changed: Some(4),
                        ..Health::default()
                    };
                    bench.machine.tick(bench.now, health, &mut bench.board);
                    assert_eq!(bench.ask(0, Command::ClearFaults), rejected(fault));
                    bench.run(1);
                }
                _ => {}
            }
            let reads = bus::Event::ReadFailed {
                unit: index,
                in_a_row: MAX_FAILED_READS,
            };
            match (fault, fault.scope()) {
                (
                    Fault::EStop | Fault::OutputStuck | Fault::OverTension | Fault::RegisterChanged,
                    _,
                ) => bench.run(5),
                (Fault::SensorReads, _) => {
                    bench.machine.bus_event(reads, bench.now, &mut bench.board)
                }
                (_, control::faults::Scope::Board) => {
                    bench
                        .machine
                        .fault_board(fault, 1, bench.now, &mut bench.board);
                }
                // The other faults of a unit end in the same function, and all begin anew with the
                // converter.
                (_, control::faults::Scope::Unit) => continue,
            }
            let shown = |bench: &Bench| {
                let status = bench.status();
                status.fault == fault.code() || status.units[unit].fault == fault.code()
            };
            // A stuck output stands behind the stop that showed it.
            let behind = fault == Fault::OutputStuck;
            assert!(behind || shown(&bench), "{fault:?}, unit {unit}");
            if lasting || never {
                assert_eq!(
                    bench.ask(0, Command::ClearFaults),
                    rejected(fault),
                    "unit {unit}"
                );
                assert!(shown(&bench), "{fault:?}, unit {unit}");
            }
            bench.estop_closed = true;
            bench.cell_n[unit] = Some(0.5);
            bench.run(60);
            if never {
                assert_eq!(bench.ask(0, Command::ClearFaults), rejected(fault));
                continue;
            }
            // Over-tension at 0 V for so long is a stuck output as well: both go.
            assert_eq!(
                bench.ask(0, Command::ClearFaults),
                Some(Response::Done),
                "{fault:?}, unit {unit}"
            );
            assert!(!shown(&bench), "{fault:?}");
            assert_ne!(
                bench.machine.system(),
                SystemState::Running,
                "a clear arms nothing"
            );
            assert!(bench.all_at_zero());
        }
    }
}

/// A zero that another program ends would leave the old one to the program that asked.
#[test]
fn a_zeroing_ends_by_itself_only() {
    for link in [0, 1] {
        let mut bench = Bench::ready();
        bench.hello(1);
        bench.load_n = Some(1.5);
        bench.run(30);
        bench.done(Command::Zero { units: 0b11_1111 });
        bench.run(300);
        let refused = if link == 0 {
            CommandError::State(SystemState::Zeroing as u8)
        } else {
            CommandError::NotConnected
        };
        assert_eq!(
            bench.ask(link, Command::Disarm),
            Some(Response::Rejected(refused))
        );
        bench.run(600);
        assert_eq!(bench.machine.system(), SystemState::Ready);
        for unit in bench.status().units {
            assert!(unit.tension_un.abs() < 5_000, "the zero was taken");
        }
        // A stop ends it, and shows.
        bench.done(Command::Zero { units: 1 });
        assert_eq!(bench.ask(1, Command::Stop), Some(Response::Done));
        assert_eq!(bench.status().fault, Fault::HostStop.code());
    }
}

/// Samples of a reel that gains this speed with each, in counts a sample; whether 0 V has no
/// effect.
fn spins(bench: &mut Bench, unit: usize, gain: i64, samples: i64) -> bool {
    while !(bench.now.0 / 1_000).is_multiple_of(3) {
        bench.run(1);
    }
    for sample in 1..=samples {
        bench.wound[unit] += gain * sample;
        bench.run(3);
    }
    let status = bench.status();
    let stuck = status.fault == Fault::OutputStuck.code();
    assert_eq!(stuck, bench.machine.holds_dacs());
    assert!(!stuck || status.fault_detail >> 24 == unit as u32 + 1 && status.alive_withheld);
    stuck
}

/// A motor that gives its reel more speed than its whole command could: its word does not reach it.
/// 18 counts a sample are what 4 N give; a cable that breaks gives no more.
#[test]
fn a_reel_that_gains_more_than_its_command_gives_takes_the_power() {
    for unit in 0..UNITS {
        for (gain, stuck) in [(45, true), (16, false)] {
            let mut bench = Bench::armed();
            for _ in 0..30 {
                bench.setpoints(4_000_000);
                bench.run(10);
            }
            bench.cell_n[unit] = Some(f64::from(bench.status().units[unit].tension_un) * 1e-6);
            bench.setpoints(4_000_000);
            assert_eq!(
                spins(&mut bench, unit, gain, 3),
                stuck,
                "unit {unit}, {gain}"
            );
        }
        // One jump is no speed.
        // The bench's reels have no friction, and swing where the feedforward acts against one.
        let mut bench = Bench::ready();
        configure(&mut bench, |_| UnitConfig {
            friction_feedforward: false,
            ..Config::nominal()
        });
        bench.run(50);
        bench.done(Command::Arm);
        for _ in 0..30 {
            bench.setpoints(4_000_000);
            bench.run(10);
        }
        bench.wound[unit] += 150;
        bench.run(9);
        assert_ne!(
            bench.status().fault,
            Fault::OutputStuck.code(),
            "unit {unit}"
        );
    }
}

/// A reel at 0 V that gains 25 m/s^2 is driven; 16 m/s^2 may be a hand. Where nothing was driven,
/// it is watched while a zero is measured: other electronics may drive the motors of a board that
/// only measures.
#[test]
fn a_reel_that_no_hand_throws_so_takes_the_power() {
    for unit in 0..UNITS {
        let stopped = || {
            let mut bench = held();
            bench.done(Command::Disarm);
            bench.run(600);
            bench.cell_n[unit] = Some(0.2);
            bench.run(300);
            bench
        };
        let zeroing = || {
            let mut bench = Bench::ready();
            bench.run(310);
            bench.done(Command::Zero { units: 0b11_1111 });
            bench.run(30);
            bench
        };
        let idle = || {
            let mut bench = Bench::ready();
            bench.run(310);
            bench
        };
        assert!(spins(&mut stopped(), unit, 58, 4), "unit {unit}");
        assert!(!spins(&mut stopped(), unit, 35, 8), "unit {unit}, by hand");
        assert!(spins(&mut zeroing(), unit, 58, 4), "unit {unit}, zeroing");
        assert!(
            !spins(&mut idle(), unit, 58, 4),
            "unit {unit}, only measured"
        );
        // A jump, and the same again.
        let mut bench = stopped();
        for _ in 0..2 {
            bench.wound[unit] += 150;
            bench.run(6);
        }
        assert_eq!(bench.status().fault, 0, "unit {unit}");
    }
}

/// The end of a ramp is 0 V as well: an output that holds on then has no effect of it either.
#[test]
fn an_output_that_holds_on_after_a_disarm_loses_its_power() {
    for unit in 0..UNITS {
        let mut bench = Bench::armed();
        for _ in 0..30 {
            bench.setpoints(6_000_000);
            bench.run(10);
        }
        bench.stuck[unit] = true;
        bench.cell_n[unit] = Some(6.0);
        bench.done(Command::Disarm);
        bench.run(400);
        let status = bench.status();
        assert_eq!(status.fault, Fault::OutputStuck.code(), "unit {unit}");
        assert!(status.alive_withheld);
    }
}
