//! Single mistakes of wiring on the rig without an emulated controller: is each named, and how hard did a cable pull?
//!
//! `cargo test -p bring-up --test mistakes -- --ignored --nocapture` runs all mistakes with every slack and seed, and prints a
//! table.

use bring_up::figures::Figures;
use bring_up::hands::{emulated, Action, Answer, Hands};
use bring_up::judge::judge;
use bring_up::mistake::{Mistake, Named};
use bring_up::pulse::{configs, BLIND_N, PULSE_MS};
use bring_up::steps::{Bench, Plan, Test};
use bring_up::BringUpError;
use core_sim::Options;
use emulator_link::Injection;
use plant::PlantConfig;
use rig::Rig;
use session::link::fast::FastRig;
use session::link::{Exchange, LinkError, RigControls, RigLink};
use session::Session;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use wire::message::UnitSetpoint;
use wire::{Command, UNITS};

/// Slack of the cables while the motors are tested, mm.
const SLACK_MM: [f64; 4] = [0.0, 1.0, 5.0, 20.0];
/// Largest true tension of any cable, N.
const BOUND_N: f64 = 2.0;
/// A known weight: 500 g.
const WEIGHT_N: f64 = 4.9;

/// Volts of a DAC per newton of command: 10 V are 32,768 codes, and the example rig has 282.2 codes per newton.
const V_PER_N: f64 = 282.2 * 10.0 / 32_768.0;
/// Output that counts as a pulse, V: a tenth of a newton.
const PULSE_V: f64 = 0.1 * V_PER_N;

/// A fast rig that notes how hard its cables pull, and what its DACs give.
struct Watched {
    rig: FastRig,
    most_n: f64,
    /// Strongest command at any DAC, N.
    command_n: f64,
    /// Milliseconds in a row in which each gives a pulse, and the most of them.
    pulse_ms: [u32; UNITS],
    longest_ms: u32,
}

impl RigLink for Watched {
    fn name(&self) -> String {
        self.rig.name()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let exchange = self.rig.exchange(to_board, duration)?;
        for truth in &exchange.truth {
            self.most_n = truth
                .tension_n
                .iter()
                .fold(self.most_n, |most, n| most.max(*n));
            for (volts, ms) in truth.dac_v.iter().zip(&mut self.pulse_ms) {
                self.command_n = self.command_n.max(volts / V_PER_N);
                *ms = if volts.abs() > PULSE_V { *ms + 1 } else { 0 };
                self.longest_ms = self.longest_ms.max(*ms);
            }
        }
        Ok(exchange)
    }

    fn booted_here(&self) -> bool {
        true
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        self.rig.controls()
    }
}

struct Emulated;

impl Hands for Emulated {
    fn act(&mut self, action: &Action, session: &mut Session<'_>) -> Result<Answer, BringUpError> {
        emulated(action, session)
    }

    fn say(&mut self, _: &str) {}
}

/// What was found, and the largest true tension while the motors were tested.
struct Run {
    found: Vec<Named>,
    figures: Figures,
    most_n: f64,
    /// Strongest command, N, and longest pulse, ms.
    command_n: f64,
    longest_ms: u32,
}

fn run(pull_mm: f64, injections: &[Injection], slack_mm: f64, seed: u64) -> Run {
    let mut plant = PlantConfig::default();
    plant.cable.initial_slack_m = 1e-3 * slack_mm;
    let options = Options {
        seed,
        plant,
        ..Options::default()
    };
    let mut link = Watched {
        rig: FastRig::with(options).unwrap(),
        most_n: 0.0,
        command_n: 0.0,
        pulse_ms: [0; UNITS],
        longest_ms: 0,
    };
    for injection in injections {
        link.rig.controls().unwrap().inject(*injection).unwrap();
    }
    let rig = Rig::built_in().unwrap();
    let stop = AtomicBool::new(false);
    let plan = Plan {
        units: (0..UNITS).collect(),
        pull_mm,
        weight_n: Some(WEIGHT_N),
        stop: &stop,
    };
    let mut figures = Figures::default();
    let mut most_n = 0.0;
    for test in Test::ALL {
        link.most_n = 0.0;
        let mut session = Session::connect(&mut link).unwrap();
        let mut hands = Emulated;
        let mut bench = Bench::new(&mut session, &rig, &plan, &mut hands).unwrap();
        bench.run(test, &mut figures).unwrap();
        if test == Test::Motors {
            most_n = link.most_n;
        }
    }
    let found = judge(&rig, &figures);
    Run {
        found,
        figures,
        most_n,
        command_n: link.command_n,
        longest_ms: link.longest_ms,
    }
}

/// A mistake as injections, and whether a name is the right one.
struct Case {
    what: &'static str,
    injections: Vec<Injection>,
    is_right: fn(&Mistake) -> bool,
}

macro_rules! case {
    ($what:literal, [$($injection:expr),*], $($right:pat_param)|+ $(if $guard:expr)?) => {
        Case { what: $what, injections: vec![$($injection),*], is_right: |m| matches!(m, $($right)|+ $(if $guard)?) }
    };
}

fn cases() -> Vec<Case> {
    use Injection as I;
    use Mistake as M;
    vec![
        case!("encoders 2 and 5 exchanged", [I::ExchangeEncoders(2, 5)], M::EncodersExchanged { units } if *units == [2, 5]),
        case!("encoders 3 and 4 exchanged", [I::ExchangeEncoders(3, 4)], M::EncodersExchanged { units } if *units == [3, 4]),
        case!(
            "encoder 1 dead",
            [I::FreezeEncoder(1, true)],
            M::EncoderDead { unit: 1 }
        ),
        case!(
            "encoder 6 dead",
            [I::FreezeEncoder(6, true)],
            M::EncoderDead { unit: 6 }
        ),
        case!(
            "encoder 4 reversed",
            [I::ReverseEncoder(4, true)],
            M::EncoderSign { unit: 4 }
        ),
        case!(
            "encoder 2 with 1,024 lines",
            [I::EncoderLines(2, 1_024)],
            M::EncoderLines {
                unit: 2,
                lines: 1_024
            }
        ),
        case!(
            "encoder 5 with 500 lines",
            [I::EncoderLines(5, 500)],
            M::EncoderLines {
                unit: 5,
                lines: 500
            }
        ),
        case!("motors 1 and 4 exchanged", [I::ExchangeMotors(1, 4)], M::MotorsExchanged { units } if *units == [1, 4]),
        case!("motors 5 and 6 exchanged", [I::ExchangeMotors(5, 6)], M::MotorsExchanged { units } if *units == [5, 6]),
        case!(
            "motor 3 reversed",
            [I::AmplifierShare(3, -1.0)],
            M::MotorSign { unit: 3 }
        ),
        case!(
            "amplifier 2 off",
            [I::AmplifierOff(2, true)],
            M::MotorDead { unit: 2 }
        ),
        case!("amplifier 5 with twice the gain", [I::AmplifierShare(5, 2.0)], M::AmplifierGain { unit: 5, ratio } if *ratio > 1.0),
        case!("amplifier 1 with twice the gain", [I::AmplifierShare(1, 2.0)], M::AmplifierGain { unit: 1, ratio } if *ratio > 1.0),
        case!("amplifier 3 with half the gain", [I::AmplifierShare(3, 0.5)], M::AmplifierGain { unit: 3, ratio } if *ratio < 1.0),
        case!("amplifier 6 with half the gain", [I::AmplifierShare(6, 0.5)], M::AmplifierGain { unit: 6, ratio } if *ratio < 1.0),
        case!(
            "all amplifiers off",
            [
                I::AmplifierOff(1, true),
                I::AmplifierOff(2, true),
                I::AmplifierOff(3, true),
                I::AmplifierOff(4, true),
                I::AmplifierOff(5, true),
                I::AmplifierOff(6, true)
            ],
            M::AllMotorsDead
        ),
        case!("load cells 1 and 2 exchanged", [I::ExchangeCells(1, 2)], M::CellsExchanged { units } if *units == [1, 2]),
        case!("load cells 3 and 6 exchanged", [I::ExchangeCells(3, 6)], M::CellsExchanged { units } if *units == [3, 6]),
        case!(
            "load cell 4 reversed",
            [I::WrongSign(4, true)],
            M::CellSign { unit: 4 }
        ),
        case!(
            "bridge 5 open",
            [I::OpenBridge(5, true)],
            M::CellDead { unit: 5 }
        ),
        case!(
            "converter 2 unplugged",
            [I::UnplugSensor(2)],
            M::ConverterSilent { unit: 2, .. } | M::DrdyDead { unit: 2 }
        ),
        case!(
            "converter 6 mute",
            [I::Nack(6)],
            M::ConverterSilent { unit: 6, .. }
        ),
        case!("DRDY lines 1 and 5 exchanged", [I::ExchangeDrdy(1, 5)], M::DrdyExchanged { units } if *units == [1, 5]),
        case!("DRDY lines 3 and 4 exchanged", [I::ExchangeDrdy(3, 4)], M::DrdyExchanged { units } if *units == [3, 4]),
        case!(
            "E-stop open",
            [I::EStop(true)],
            M::EStopOpen | M::BoardFault { fault: 1 }
        ),
    ]
}

/// The right name is the first one, and nothing else is called certain beside it.
fn is_named(case: &Case, run: &Run) -> bool {
    run.found
        .first()
        .is_some_and(|named| (case.is_right)(&named.mistake))
}

fn told(run: &Run) -> String {
    run.found
        .iter()
        .map(|named| {
            format!(
                "\n    {:?}: {} ({})",
                named.sure, named.mistake, named.evidence
            )
        })
        .collect()
}

/// Every mistake once, with another slack and seed each.
#[test]
fn single_mistakes_are_named_and_no_cable_is_pulled_hard() {
    for (n, case) in cases().iter().enumerate() {
        let slack_mm = SLACK_MM[1 + n % 3];
        let run = run(60.0, &case.injections, slack_mm, 40 + n as u64);
        assert!(
            is_named(case, &run),
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
    // Half a code.
    assert!(run.command_n <= 2.302, "{what}: {} N", run.command_n);
}

/// With this seed the two rates differ so much that one of the units is at fault for its own.
#[test]
fn exchanged_drdy_lines_are_named_where_a_rate_is_at_fault_too() {
    let run = run(60.0, &[Injection::ExchangeDrdy(1, 5)], 5.0, 2);
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
    let run = run(60.0, &dead, 5.0, 3);
    check_bounds("nothing answers", &run);
    assert!(
        (1.298..=1.302).contains(&run.command_n),
        "{} N",
        run.command_n
    );
}

/// Nobody tells the board to end a pulse: a host that dies with it leaves 0 V.
#[test]
fn the_board_ends_a_pulse_by_itself() {
    let rig = Rig::built_in().unwrap();
    let mut link = Watched {
        rig: FastRig::with(Options::default()).unwrap(),
        most_n: 0.0,
        command_n: 0.0,
        pulse_ms: [0; UNITS],
        longest_ms: 0,
    };
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
        let run = run(60.0, &[], 5.0, seed);
        assert!(run.found.is_empty(), "seed {seed}:{}", told(&run));
        check_bounds("wired right", &run);
        assert!(run.figures.motors.iter().all(Option::is_some));
    }
}

/// All of them with every slack and `BRING_UP_SEEDS` seeds (5), and the right rig as often; those with `BRING_UP_ONLY` in
/// their words. Prints the table.
#[test]
#[ignore = "a minute and more; prints the figures"]
fn table() {
    let seeds = std::env::var("BRING_UP_SEEDS")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(5);
    let mut all = (0, 0, 0.0_f64);
    println!("| mistake | named | largest true tension, N |\n| --- | --- | --- |");
    let right = Case {
        what: "none",
        injections: vec![],
        is_right: |_| false,
    };
    let only = std::env::var("BRING_UP_ONLY").unwrap_or_default();
    let all_cases = cases();
    let chosen = all_cases.iter().chain([&right]);
    for case in chosen.filter(|case| case.what.contains(&only)) {
        let (mut named, mut of, mut most_n) = (0, 0, 0.0_f64);
        for slack_mm in SLACK_MM {
            for seed in 1..=seeds {
                let run = run(200.0, &case.injections, slack_mm, seed);
                let good = if case.what == "none" {
                    run.found.is_empty()
                } else {
                    is_named(case, &run)
                };
                if !good {
                    eprintln!("{} ({slack_mm} mm, seed {seed}):{}", case.what, told(&run));
                }
                (named, of) = (named + usize::from(good), of + 1);
                most_n = most_n.max(run.most_n);
            }
        }
        println!("| {} | {named} of {of} | {most_n:.2} |", case.what);
        all = (all.0 + named, all.1 + of, all.2.max(most_n));
    }
    println!("| all | {} of {} | {:.2} |", all.0, all.1, all.2);
}
