//! Single mistakes of wiring on the rig without an emulated controller, for the tests and for the example `mistakes`.

use bring_up::figures::Figures;
use bring_up::hands::{emulated, Action, Answer, Hands};
use bring_up::judge::judge;
use bring_up::mistake::{Mistake, Named};
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
use wire::UNITS;

/// Slack of the cables while the motors are tested, mm.
pub const SLACK_MM: [f64; 4] = [0.0, 1.0, 5.0, 20.0];
/// A known weight: 500 g.
pub const WEIGHT_N: f64 = 4.9;

/// Volts of a DAC per newton of command: 10 V are 32,768 codes, and the example rig has 282.2 codes per newton.
pub const V_PER_N: f64 = 282.2 * 10.0 / 32_768.0;
/// Output that counts as a pulse, V: a tenth of a newton.
pub const PULSE_V: f64 = 0.1 * V_PER_N;

/// A fast rig that notes how hard its cables pull, and what its DACs give.
pub struct Watched {
    pub rig: FastRig,
    pub most_n: f64,
    /// Strongest command at any DAC, N.
    pub command_n: f64,
    /// Milliseconds in a row in which each gives a pulse, and the most of them.
    pub pulse_ms: [u32; UNITS],
    pub longest_ms: u32,
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

pub struct Emulated;

impl Hands for Emulated {
    fn act(&mut self, action: &Action, session: &mut Session<'_>) -> Result<Answer, BringUpError> {
        emulated(action, session)
    }

    fn say(&mut self, _: &str) {}
}

/// What was found, and the largest true tension while the motors were tested.
pub struct Run {
    pub found: Vec<Named>,
    pub figures: Figures,
    pub most_n: f64,
    /// Strongest command, N, and longest pulse, ms.
    pub command_n: f64,
    pub longest_ms: u32,
}

pub fn run(pull_mm: f64, injections: &[Injection], slack_mm: f64, seed: u64) -> Run {
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
pub struct Case {
    pub what: &'static str,
    pub injections: Vec<Injection>,
    pub is_right: fn(&Mistake) -> bool,
}

macro_rules! case {
    ($what:literal, [$($injection:expr),*], $($right:pat_param)|+ $(if $guard:expr)?) => {
        Case { what: $what, injections: vec![$($injection),*], is_right: |m| matches!(m, $($right)|+ $(if $guard)?) }
    };
}

pub fn cases() -> Vec<Case> {
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
pub fn is_named(case: &Case, run: &Run) -> bool {
    run.found
        .first()
        .is_some_and(|named| (case.is_right)(&named.mistake))
}

pub fn told(run: &Run) -> String {
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
