//! The machine: who may command, what is refused, what stops the motors.

use board::machine::{config_crc, Health, COMMANDER_SILENT_US, FIRST_SAMPLE_MS};
use board::telemetry::{Batcher, Outstanding, FLUSH_US};
use control::{
    AdcCode, Config, DacCode, EncoderCounts, Fault, Micros, MotorState, SystemState, UnitIndex,
};
use wire::message::{
    flags, CellCorrection, CommandError, CrashRecord, FilterChoice, Response, Ripple, Sample,
    UnitConfig, UnitSetpoint, BATCH, RIPPLES,
};
use wire::{Command, ABI_VERSION, SCHEMA_HASH, UNITS};

mod common;
use common::Bench;

#[test]
fn what_was_committed_is_read_back_at_once() {
    let mut bench = Bench::ready();
    let mut config = Config::nominal();
    config.coulomb_un = 1_234_567;
    config.ripples[1].amplitude_un = 400_000;
    bench.done(Command::StageConfig { unit: 4, config });
    // Staged is not in force.
    assert_ne!(
        bench.ask(0, Command::GetConfig { unit: 4 }),
        Some(Response::Config(config))
    );
    let crc = bench.status().config_crc;
    bench.done(Command::CommitConfig);
    assert_eq!(
        bench.ask(0, Command::GetConfig { unit: 4 }),
        Some(Response::Config(config))
    );
    assert_ne!(bench.status().config_crc, crc);
}

#[test]
fn nothing_is_driven_for_a_link_without_hello() {
    let mut bench = Bench::new(None);
    bench.run(2);
    for command in [
        Command::Arm,
        Command::CommitConfig,
        Command::Disarm,
        Command::ClearFaults,
        Command::Stream { decimation: 1 },
    ] {
        assert_eq!(
            bench.ask(0, command),
            Some(Response::Rejected(CommandError::NotConnected))
        );
    }
    assert_eq!(
        bench.ask(
            0,
            Command::Hello {
                abi: ABI_VERSION,
                schema: [9; 8]
            }
        ),
        Some(Response::Rejected(CommandError::Version {
            abi: ABI_VERSION,
            schema: SCHEMA_HASH
        }))
    );
    assert_eq!(
        bench.ask(0, Command::CommitConfig),
        Some(Response::Rejected(CommandError::NotConnected)),
        "a rejected Hello opens nothing"
    );
    assert!(matches!(bench.hello(0), Some(Response::Hello(_))));
    bench.done(Command::CommitConfig);
}

/// A look at the status on the other link must not stop a run, and a stop must work from anywhere.
#[test]
fn any_link_may_look_and_stop_and_none_takes_over_a_run() {
    let mut bench = Bench::armed();
    for _ in 0..30 {
        bench.setpoints(3_000_000);
        assert!(matches!(bench.hello(1), Some(Response::Hello(_))));
        for look in [
            Command::GetStatus,
            Command::GetConfig { unit: 0 },
            Command::GetBoard,
        ] {
            let answer = bench.ask(1, look);
            assert!(
                matches!(
                    answer,
                    Some(Response::Status(_) | Response::Config(_) | Response::Board(_))
                ),
                "{answer:?}"
            );
        }
        assert_eq!(
            bench.ask(1, Command::Disarm),
            Some(Response::Rejected(CommandError::NotConnected))
        );
        bench.run(10);
    }
    assert_eq!(bench.machine.system(), SystemState::Running);
    assert!(!bench.all_at_zero());
    // Without a Hello too.
    let mut bench = Bench::armed();
    assert_eq!(bench.ask(1, Command::Stop), Some(Response::Done));
    assert_eq!(bench.status().fault, Fault::HostStop.code());
    assert_eq!(bench.machine.system(), SystemState::Fault);
}

#[test]
fn a_silent_commander_is_replaced() {
    let mut bench = Bench::ready();
    bench.done(Command::Arm);
    bench.hello(1);
    bench.run(COMMANDER_SILENT_US / 1_000 - 5);
    let rejected = Some(Response::Rejected(CommandError::NotConnected));
    assert_eq!(bench.ask(1, Command::Disarm), rejected);
    bench.run(10);
    assert_eq!(bench.ask(1, Command::Disarm), Some(Response::Done));
    // While nothing is driven, the link that asks commands.
    let mut bench = Bench::ready();
    bench.hello(1);
    assert_eq!(bench.ask(1, Command::Arm), Some(Response::Done));
}

#[test]
fn units_are_off_until_configured_and_come_up_on_commit() {
    let mut bench = Bench::new(None);
    bench.run(100);
    assert!(bench.board.started.is_empty() && bench.streaming == [false; UNITS]);
    bench.hello(0);
    bench.done(Command::StageConfig {
        unit: 2,
        config: Config::nominal(),
    });
    bench.run(10);
    assert!(!bench.streaming[2], "staged is not in force");
    let before = bench.status().config_crc;
    bench.done(Command::CommitConfig);
    bench.run(20);
    assert!(bench.streaming[2]);
    assert_eq!(bench.status().units[2].state, MotorState::Ready as u8);
    assert_ne!(bench.status().config_crc, before);
    let mut configs = [*Config::default().wire(); UNITS];
    configs[2] = Config::nominal();
    assert_eq!(bench.status().config_crc, config_crc(&configs));
}

/// A configuration whose encoding is as long as it can be.
#[test]
fn the_checksum_covers_the_longest_configuration() {
    let n = i32::MIN;
    let ripple = Ripple {
        periods_per_count_q32: n,
        phase_q32: n,
        amplitude_un: n,
        amplitude_load_q16: n,
    };
    let longest = UnitConfig {
        enabled: true,
        scale_pn_per_count: n,
        zero_code: n,
        filter: FilterChoice::LowPass {
            corner_chz: u16::MAX,
        },
        spike_limit_un: n,
        kp_q16: n,
        ki_q16: n,
        kd_q16: n,
        damping_q16: n,
        friction_feedforward: true,
        friction_offset_un: n,
        friction_gain_q16: n,
        coulomb_un: n,
        coulomb_load_q16: n,
        reversal_nm: n,
        travel_nm_per_count: n,
        dac_counts_per_n_q16: n,
        force_limit_un: n,
        stored_zero_code: i32::MIN,
        zero_deviation_un: i32::MIN,
        authority_un: i32::MIN,
        plausible_un: i32::MIN,
        slew_un_per_s: n,
        over_tension_un: n,
        viscous_q16: n,
        ripples: [ripple; RIPPLES],
        cell: CellCorrection {
            curve_nn_per_n2: n,
            creep_q16: n,
            creep_ms: n,
        },
        tension_max_un: n,
        leaky_ki_q16: n,
    };
    let crc = config_crc(&[longest; UNITS]);
    assert_ne!(crc, 0, "the encoding did not fit");
    let mut other = [longest; UNITS];
    other[5].cell.creep_ms = i32::MAX;
    assert_ne!(config_crc(&other), crc);
}

#[test]
fn a_unit_that_is_not_ready_is_named_with_its_state() {
    let mut bench = Bench::ready();
    let stage = |enabled| Command::StageConfig {
        unit: 2,
        config: UnitConfig {
            enabled,
            ..Config::nominal()
        },
    };
    let not_ready = |state: MotorState| {
        Some(Response::Rejected(CommandError::UnitNotReady {
            unit: 2,
            state: state as u8,
        }))
    };
    bench.done(stage(false));
    bench.done(Command::CommitConfig);
    bench.run(5);
    assert_eq!(
        bench.ask(0, Command::Zero { units: 0b100 }),
        not_ready(MotorState::Offline)
    );
    // Enabled again, but the bring-up has only begun.
    bench.done(stage(true));
    bench.done(Command::CommitConfig);
    assert_eq!(bench.ask(0, Command::Arm), not_ready(MotorState::BringUp));
    bench.run(50);
    bench.done(Command::Arm);
}

#[test]
fn bad_values_are_named_by_unit_and_field_and_change_nothing() {
    let mut bench = Bench::ready();
    let mut config = Config::nominal();
    config.kp_q16 = -1;
    let refused = bench.ask(0, Command::StageConfig { unit: 3, config });
    assert_eq!(
        refused,
        Some(Response::Rejected(CommandError::Range {
            unit: 3,
            field: 7
        }))
    );
    let refused = bench.ask(
        0,
        Command::StageConfig {
            unit: 6,
            config: Config::nominal(),
        },
    );
    assert_eq!(
        refused,
        Some(Response::Rejected(CommandError::UnknownUnit(6)))
    );
    assert_eq!(
        bench.ask(0, Command::GetConfig { unit: 6 }),
        Some(Response::Rejected(CommandError::UnknownUnit(6)))
    );
    assert_eq!(
        bench.ask(0, Command::Zero { units: 0x40 }),
        Some(Response::Rejected(CommandError::UnknownUnit(6)))
    );
    let mut bench = Bench::armed();
    assert_eq!(
        bench.setpoints(i32::MAX),
        Some(Response::Rejected(CommandError::Range {
            unit: 0,
            field: 0
        }))
    );
    let unit = UnitSetpoint {
        tension_un: 3_000_000,
        inv_cos_q16: 0,
        direction_q14: [0; 3],
        reel_um_per_s: None,
    };
    let refused = bench.ask(
        0,
        Command::Setpoints {
            valid_ms: 100,
            units: [unit; UNITS],
        },
    );
    assert_eq!(
        refused,
        Some(Response::Rejected(CommandError::Range {
            unit: 0,
            field: 1
        }))
    );
    bench.run(30);
    assert!(bench.all_at_zero());
}

#[test]
fn armed_motors_pull_and_a_silent_host_stops_them_all() {
    let mut bench = Bench::armed();
    for _ in 0..20 {
        assert_eq!(bench.setpoints(4_000_000), None);
        bench.run(10);
    }
    assert!(
        bench.last.iter().all(|dac| dac.steps() > 100),
        "{:?}",
        bench.last
    );
    bench.board.zeroed.clear();
    bench.run(89); // 99 ms after the last ones, which hold for 100
    assert_eq!(bench.machine.system(), SystemState::Running);
    bench.run(3);
    assert_eq!(bench.machine.system(), SystemState::Fault);
    assert_eq!(bench.status().fault, Fault::SetpointsExpired.code());
    for unit in UnitIndex::ALL {
        assert!(
            bench.board.zeroed.contains(&unit),
            "0 V at once, not with the next sample"
        );
    }
    bench.run(4);
    assert!(bench.all_at_zero());
    // Latched: setpoints and arming do nothing until it is cleared, and clearing does not arm.
    assert_eq!(bench.setpoints(4_000_000), None);
    let code = Fault::SetpointsExpired.code();
    assert_eq!(
        bench.ask(0, Command::Arm),
        Some(Response::Rejected(CommandError::Faulted(code)))
    );
    bench.done(Command::ClearFaults);
    bench.run(5);
    assert_eq!(bench.machine.system(), SystemState::Ready);
    assert!(bench.all_at_zero());
}

#[test]
fn a_commit_is_refused_while_armed() {
    let mut bench = Bench::armed();
    let state = SystemState::Running as u8;
    assert_eq!(
        bench.ask(0, Command::CommitConfig),
        Some(Response::Rejected(CommandError::State(state)))
    );
    assert_eq!(
        bench.ask(0, Command::Zero { units: 1 }),
        Some(Response::Rejected(CommandError::State(state)))
    );
}

#[test]
fn disarm_ramps_down_instead_of_dropping() {
    let mut bench = Bench::armed();
    for _ in 0..20 {
        bench.setpoints(6_000_000);
        bench.run(10);
    }
    let before = bench.last[0].steps();
    bench.done(Command::Disarm);
    assert_eq!(bench.machine.system(), SystemState::Stopping);
    bench.run(3);
    let ramping = bench.last[0].steps();
    assert!(ramping > 0 && ramping < before, "{before} {ramping}");
    bench.run(1_000);
    assert_eq!(bench.machine.system(), SystemState::Ready);
    assert!(bench.all_at_zero());
}

#[test]
fn the_e_stop_stops_within_two_milliseconds_and_stays() {
    let mut bench = Bench::armed();
    for _ in 0..10 {
        bench.setpoints(4_000_000);
        bench.run(10);
    }
    bench.estop_closed = false;
    bench.run(2);
    assert_eq!(bench.status().fault, Fault::EStop.code());
    bench.run(3);
    assert!(bench.all_at_zero());
    let code = Fault::EStop.code();
    assert_eq!(
        bench.ask(0, Command::ClearFaults),
        Some(Response::Rejected(CommandError::Faulted(code))),
        "still open"
    );
    bench.estop_closed = true;
    bench.run(3);
    assert_eq!(
        bench.machine.system(),
        SystemState::Fault,
        "closing the loop is no permission"
    );
    bench.done(Command::ClearFaults);
}

#[test]
fn a_silent_sensor_takes_its_unit_out_and_leaves_the_others() {
    let mut bench = Bench::armed();
    for _ in 0..10 {
        bench.setpoints(4_000_000);
        bench.run(10);
    }
    bench.streaming[1] = false;
    for _ in 0..3 {
        bench.setpoints(4_000_000);
        bench.run(10);
    }
    let status = bench.status();
    assert_eq!(status.units[1].fault, Fault::SensorSilent.code());
    assert_eq!(status.units[1].state, MotorState::Faulted as u8);
    assert_eq!(
        (status.fault, status.state),
        (0, SystemState::Running as u8)
    );
    assert!(
        bench.board.zeroed.contains(&UnitIndex::Unit2)
            && bench.board.stopped.contains(&UnitIndex::Unit2)
    );
    assert!(bench.last[0].steps() > 100);
    bench.done(Command::Disarm);
    bench.run(1_000);
    bench.done(Command::ClearFaults);
    bench.run(20);
    assert!(bench.streaming[1], "clearing brings the converter up again");
}

#[test]
fn noise_at_an_encoder_is_a_fault_when_it_goes_on() {
    let mut bench = Bench::armed();
    let noisy = |bench: &mut Bench, gap_us: u32| {
        for _ in 0..5 {
            bench.now.0 = bench.now.0.wrapping_add(gap_us);
            bench
                .machine
                .encoder_noise(UnitIndex::Unit3, 0x10, bench.now, &mut bench.board);
        }
    };
    noisy(&mut bench, 300_000);
    assert_eq!(bench.status().units[2].fault, 0, "single events");
    noisy(&mut bench, 50_000);
    let unit = bench.status().units[2];
    assert_eq!(Fault::from_code(unit.fault), Some(Fault::EncoderError));
    assert_eq!(unit.fault_detail, 0x10);
    assert_eq!(bench.status().units[1].fault, 0);
    assert!(bench.board.zeroed.contains(&UnitIndex::Unit3));
}

#[test]
fn a_converter_without_samples_after_its_bring_up_is_a_failed_bring_up() {
    let mut bench = Bench::new(None);
    bench.hello(0);
    bench.done(Command::StageConfig {
        unit: 0,
        config: Config::nominal(),
    });
    bench.done(Command::CommitConfig);
    for _ in 0..FIRST_SAMPLE_MS + 5 {
        bench.run(1);
        bench.streaming[0] = false;
    }
    assert_eq!(bench.status().units[0].fault, Fault::BringUpFailed.code());
    assert_eq!(bench.status().units[0].fault_detail >> 8, 7);
}

#[test]
fn zeroing_takes_the_load_away_and_a_touched_cable_is_refused() {
    let mut bench = Bench::ready();
    bench.load_n = Some(1.5);
    bench.run(50);
    assert!((bench.status().units[0].tension_un - 1_500_000).abs() < 5_000);
    bench.done(Command::Zero { units: 0b11 });
    assert_eq!(bench.machine.system(), SystemState::Zeroing);
    bench.run(900);
    assert_eq!(bench.machine.system(), SystemState::Ready);
    let status = bench.status();
    assert!(status.units[0].tension_un.abs() < 5_000 && status.units[1].tension_un.abs() < 5_000);
    assert!(
        (status.units[2].tension_un - 1_500_000).abs() < 5_000,
        "not requested"
    );
    let Some(Response::Config(config)) = bench.ask(0, Command::GetConfig { unit: 0 }) else {
        panic!()
    };
    assert!(
        (config.zero_code - 219_000).abs() < 1_000,
        "{}",
        config.zero_code
    );

    bench.done(Command::Zero { units: 0b100 });
    bench.run(300);
    bench.load_n = Some(2.5);
    bench.run(700);
    assert_eq!(bench.status().units[2].fault, Fault::ZeroRefused.code());
}

#[test]
fn the_crash_record_of_the_last_run_is_latched_and_sent() {
    let record = CrashRecord {
        code: Fault::Panic.code(),
        detail: 42,
        pc: 0,
        text: "main.rs:42".try_into().unwrap(),
    };
    let mut bench = Bench::new(Some(record.clone()));
    bench.run(3);
    assert_eq!(
        (bench.status().fault, bench.status().fault_detail),
        (Fault::Panic.code(), 42)
    );
    let Some(Response::Hello(info)) = bench.hello(1) else {
        panic!()
    };
    assert_eq!(info.crash_record, Some(record));
}

#[test]
fn errors_of_the_board_itself_are_faults() {
    let cases = [
        (
            Health {
                longest_pass_us: 5_000,
                ..Health::default()
            },
            Fault::LoopOverrun,
        ),
        (
            Health {
                events_lost: 1,
                ..Health::default()
            },
            Fault::QueueOverflow,
        ),
        (
            Health {
                dac_error: Some(8),
                ..Health::default()
            },
            Fault::DacLink,
        ),
        (
            Health {
                register_changed: Some(0x4001_300C),
                ..Health::default()
            },
            Fault::RegisterChanged,
        ),
    ];
    for (health, fault) in cases {
        let mut bench = Bench::armed();
        let health = Health {
            estop_closed: true,
            ..health
        };
        bench.machine.tick(bench.now, health, &mut bench.board);
        assert_eq!(bench.status().fault, fault.code());
        bench.sample(0);
        assert_eq!(bench.last[0], DacCode::ZERO_VOLT);
    }
}

/// A register that cannot be put right keeps its fault.
#[test]
fn a_changed_register_is_cleared_only_once_it_has_its_value_again() {
    let mut bench = Bench::armed();
    let changed = Health {
        estop_closed: true,
        register_changed: Some(0x5802_4428),
        ..Health::default()
    };
    bench.machine.tick(bench.now, changed, &mut bench.board);
    let status = bench.status();
    assert_eq!(status.fault, Fault::RegisterChanged.code());
    assert_eq!(status.fault_detail, 0x5802_4428);
    let refused = Response::Rejected(CommandError::Faulted(Fault::RegisterChanged.code()));
    assert_eq!(bench.ask(0, Command::ClearFaults), Some(refused));
    let right = Health {
        register_changed: None,
        ..changed
    };
    bench.machine.tick(bench.now, right, &mut bench.board);
    assert_eq!(bench.status().fault, Fault::RegisterChanged.code());
    assert_eq!(bench.ask(0, Command::ClearFaults), Some(Response::Done));
    assert_eq!(bench.status().fault, 0);
}

#[test]
fn a_missed_conversion_is_counted_and_flagged() {
    let mut bench = Bench::ready();
    let (_, mut pending) = bench.machine.sample(
        UnitIndex::Unit1,
        AdcCode::new(0),
        EncoderCounts(0),
        Micros(bench.now.0 + 9_375),
        2,
        &mut bench.board,
    );
    bench.machine.check(&mut pending, &mut bench.board);
    assert_ne!(pending.describe().flags & flags::MISSED, 0);
    assert_eq!(bench.status().units[0].missed, 2);
}

#[test]
fn batches_fill_decimate_and_are_sent_in_time() {
    let mut batcher = Batcher::default();
    let at = Micros(0xFFFF_FFF0);
    for n in 0..BATCH as u32 - 1 {
        assert!(batcher
            .push(at.plus(n * 500), Sample::default(), 1)
            .is_none());
    }
    // The last one was taken before the first: times stay right.
    let batch = batcher
        .push(Micros(at.0 - 100), Sample::default(), 1)
        .expect("full");
    assert_eq!(batch.t_us, at.0 - 100);
    let times: Vec<_> = batch.samples.iter().map(|sample| sample.dt_us).collect();
    assert_eq!(times, [100, 600, 1_100, 0]);

    assert!(batcher.push(Micros(0), Sample::default(), 0).is_none());
    assert!(batcher.flush(Micros(1_000_000)).is_none(), "0 means none");
    let sent = (0..30)
        .filter(|n| {
            batcher
                .push(
                    Micros(n * 10),
                    Sample {
                        unit: 1,
                        ..Sample::default()
                    },
                    3,
                )
                .is_some()
        })
        .count();
    assert_eq!(sent, 2, "ten of thirty, four a batch");
    assert!(batcher.flush(Micros(300)).is_none());
    assert_eq!(
        batcher
            .flush(Micros(300).plus(FLUSH_US))
            .map(|batch| batch.samples.len()),
        Some(2)
    );
}

#[test]
fn latency_is_from_edge_to_word_and_a_word_that_was_never_sent_shows() {
    let mut outstanding = Outstanding::default();
    let (unit, sample) = (UnitIndex::Unit5, Sample::default());
    let mut insert = |at| outstanding.insert(unit, Micros(at), sample);
    assert!(insert(u32::MAX - 3_134).is_none());
    let (_, late) = insert(u32::MAX - 9).expect("the one before");
    assert_eq!(late.latency_us, u16::MAX);
    let (_, done) = outstanding
        .complete(unit, Micros(190))
        .expect("it was there");
    assert_eq!(done.latency_us, 200);
    assert!(outstanding.complete(unit, Micros(200)).is_none());
}
