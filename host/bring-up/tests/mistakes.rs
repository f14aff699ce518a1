//! Single mistakes of wiring: is each named, and how hard did a cable pull? The example `mistakes`
//! runs all of them with every slack on many rigs.

mod common;

use bring_up::figures::Figures;
use bring_up::mistake::Mistake;
use bring_up::pulse::{configs, BLIND_N, PULSE_MS};
use bring_up::steps::{Bench, Plan, Test};
use bring_up::BringUpError;
use common::*;
use core_sim::Options;
use emulator_link::Injection;
use rig::Rig;
use session::link::RigLink;
use session::{Session, SessionError};
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use wire::message::UnitSetpoint;
use wire::{Command, UNITS};

/// Largest true tension of any cable, N.
const BOUND_N: f64 = 2.0;

/// Every mistake once, with another slack and seed each: the right name comes first.
#[test]
fn single_mistakes_are_named_and_no_cable_is_pulled_hard() {
    each_is_named(&cases(), 40, is_named);
}

/// Of two mistakes one is named at least, within the same bounds.
#[test]
fn of_two_mistakes_one_is_named_and_no_cable_is_pulled_hard() {
    each_is_named(&pairs(), 80, one_is_named);
}

fn each_is_named(cases: &[Case], first_seed: u64, is_right: fn(&Case, &Run) -> bool) {
    for (n, case) in cases.iter().enumerate() {
        let slack_mm = SLACK_MM[n % 4];
        let run = run(60.0, case, slack_mm, first_seed + n as u64);
        assert!(
            is_right(case, &run),
            "{} ({slack_mm} mm of slack):{}",
            case.what,
            told(&run)
        );
        check_bounds(case.what, &run);
    }
}

/// What the chips and the cables have seen of the bounds of `bring_up::pulse`.
fn check_bounds(what: &str, run: &Run) {
    assert!(run.most_n < BOUND_N, "{what}: {} N", run.most_n);
    // 12 ms. The board looks once a millisecond, and the word is on its way for less than one.
    assert!(run.longest_ms <= 14, "{what}: {} ms", run.longest_ms);
    // Emulated time, hands included.
    let unit_s = run.seconds.iter().sum::<f64>() / UNITS as f64;
    assert!(unit_s < 60.0, "{what}: {unit_s} s a unit");
    // Half a code.
    assert!(run.command_n <= 2.302, "{what}: {} N", run.command_n);
}

/// With this seed the two rates differ so much that one of the units is at fault for its own.
#[test]
fn exchanged_drdy_lines_are_named_where_a_rate_is_at_fault_too() {
    let run = run(
        60.0,
        &Case::of("DRDY lines", &[Injection::ExchangeDrdy(1, 5)]),
        5.0,
        2,
    );
    let exchanged = Mistake::DrdyExchanged { units: vec![1, 5] };
    assert!(
        run.found.iter().any(|named| named.mistake == exchanged),
        "{}",
        told(&run)
    );
    check_bounds("DRDY lines", &run);
}

#[test]
fn a_motor_that_nothing_answers_gets_no_more_than_the_blind_pulses() {
    let dead: Vec<_> = (1..=UNITS as u8)
        .flat_map(|unit| {
            [
                Injection::AmplifierOff(unit, true),
                Injection::FreezeEncoder(unit, true),
            ]
        })
        .collect();
    let run = run(60.0, &Case::of("nothing answers", &dead), 5.0, 3);
    check_bounds("nothing answers", &run);
    assert!(
        (1.298..=1.302).contains(&run.command_n),
        "{} N",
        run.command_n
    );
}

/// `forcectl stop` from another terminal, or a stop at the board's other port.
#[test]
fn a_stop_from_elsewhere_ends_the_tests_and_is_not_cleared() {
    let rig = Rig::built_in().unwrap();
    let stop = AtomicBool::new(false);
    let plan = Plan {
        units: vec![0, 1],
        pull_mm: 60.0,
        weight_n: Some(WEIGHT_N),
        stop: &stop,
    };
    for (test, stops_at_ms) in [(Test::Power, 4), (Test::Motors, 4), (Test::Tension, 200)] {
        let mut link = Watched::new(Options::default());
        let mut figures = Figures::default();
        for before in Test::ALL.into_iter().take_while(|before| *before != test) {
            let mut session = Session::connect(&mut link).unwrap();
            let mut hands = Emulated;
            let mut bench = Bench::new(&mut session, &rig, &plan, &mut hands).unwrap();
            bench.run(before, &mut figures).unwrap();
        }
        link.stops_at_ms = Some(stops_at_ms);
        link.longest_ms = 0;
        // The second time it is stopped already.
        for driven in [true, false] {
            link.command_n = 0.0;
            let mut session = Session::connect(&mut link).unwrap();
            let ended = Bench::new(&mut session, &rig, &plan, &mut Emulated)
                .and_then(|mut bench| bench.run(test, &mut figures));
            let Err(BringUpError::Session(SessionError::Fault(fault))) = ended else {
                panic!("{test}: {ended:?}");
            };
            assert_eq!(fault.code, control::Fault::HostStop.code(), "{test}");
            let status = session.get_status().unwrap();
            assert_eq!(status.fault, control::Fault::HostStop.code(), "{test}");
            drop(session);
            assert_eq!(link.command_n > 0.1, driven, "{test}: {} N", link.command_n);
        }
    }
}

/// Nobody tells the board to end a pulse: a host that dies with it leaves 0 V.
#[test]
fn the_board_ends_a_pulse_by_itself() {
    let rig = Rig::built_in().unwrap();
    let mut link = Watched::new(Options::default());
    let mut session = Session::connect(&mut link).unwrap();
    let mut configs = configs(&rig, [true; UNITS], [0; UNITS], 1, BLIND_N);
    // Without a zero its limit of 3 N would be a fault.
    let of_file = rig.units.map(|unit| unit.to_wire());
    session.configure(&of_file).unwrap();
    session.command(&Command::Stream { decimation: 1 }).unwrap();
    let end_ns = session.now_ns() + 3_000_000_000;
    while session.now_ns() < end_ns {
        session.exchange(session::PERIOD).unwrap();
    }
    for timed in &session.drain().samples {
        configs[usize::from(timed.sample.unit)].zero_code = timed.sample.adc_code;
    }
    session.configure(&configs).unwrap();
    session.exchange(Duration::from_millis(100)).unwrap();
    session.command(&Command::Arm).unwrap();
    let at = |tension_un| -> [UnitSetpoint; UNITS] {
        std::array::from_fn(|i| UnitSetpoint {
            tension_un: if i == 1 { tension_un } else { 0 },
            inv_cos_q16: 1 << 16,
            direction_q14: [0; 3],
            reel_um_per_s: None,
        })
    };
    session
        .pulse(at(1_000), 60, Duration::from_millis(10))
        .unwrap();
    session
        .pulse(at(1_200_000), PULSE_MS, Duration::from_millis(1))
        .unwrap();
    // The host is gone.
    for _ in 0..30 {
        link.exchange(&[], Duration::from_millis(10)).unwrap();
    }
    assert!(
        (1.15..=1.25).contains(&link.command_n),
        "{} N",
        link.command_n
    );
    assert!(
        link.longest_ms >= 5 && link.longest_ms <= 14,
        "{} ms",
        link.longest_ms
    );
    assert_eq!(link.pulse_ms, [0; UNITS]);
}

#[test]
fn a_rig_that_is_wired_right_passes() {
    for seed in 1..=4 {
        let run = run(60.0, &Case::of("wired right", &[]), 5.0, seed);
        assert!(run.found.is_empty(), "seed {seed}:{}", told(&run));
        check_bounds("wired right", &run);
        assert!(run.figures.motors.iter().all(Option::is_some));
        assert!(run.figures.tension.iter().all(Option::is_some));
    }
}

/// Noise on one cell is neither an answer to pulses that nothing powers nor a reason for stronger
/// ones.
#[test]
fn a_noisy_load_cell_answers_no_pulse() {
    let run = run(
        60.0,
        &Case::of("noise", &[Injection::CellNoise(4, 2.7e-6)]),
        5.0,
        7,
    );
    let others = run
        .found
        .iter()
        .filter(|named| !matches!(named.mistake, Mistake::Noise { unit: 4, .. }));
    assert_eq!(others.count(), 0, "{}", told(&run));
    assert!(run.figures.motors.iter().all(Option::is_some));
    check_bounds("noise", &run);
}

/// The amplifier of any one unit past the relay, with twice the gain on top: it is named, and pulls
/// no harder than the bound.
#[test]
fn an_amplifier_past_the_relay_is_named_at_every_unit() {
    for unit in 1..=UNITS as u8 {
        let wrong = [
            Injection::BypassRelay(unit, true),
            Injection::AmplifierShare(unit, 2.0),
        ];
        let slack_mm = SLACK_MM[usize::from(unit) % 4];
        let run = run(60.0, &Case::of("", &wrong), slack_mm, 10 + u64::from(unit));
        let what = format!("unit {unit}");
        let bypassed = Mistake::RelayBypassed { units: vec![unit] };
        assert!(
            run.found.iter().any(|named| named.mistake == bypassed),
            "{what}:{}",
            told(&run)
        );
        // The power can't be cut: `motors` is not run.
        assert!(run.figures.motors.iter().all(Option::is_none), "{what}");
        check_bounds(&what, &run);
    }
}
