//! Mistakes of wiring, single and in pairs, on the rig without an emulated controller, for the
//! tests and for the example `mistakes`.

use bring_up::figures::Figures;
use bring_up::hands::{emulated, Action, Answer, Hands};
use bring_up::mistake::{Mistake, Named};
use bring_up::record::{Identity, Record};
use bring_up::steps::{Bench, Plan, Test};
use bring_up::BringUpError;
use core_sim::Options;
use emulator_link::{DacResetPull, Injection};
use plant::effects::{CommandDelay, Coulomb, Effect};
use plant::PlantConfig;
use rig::Rig;
use session::link::fast::FastRig;
use session::link::{Exchange, LinkError, RigControls, RigLink};
use session::Session;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use wire::{Command, HostFrame, UNITS};

/// Slack of the cables while the motors are tested, mm.
pub const SLACK_MM: [f64; 4] = [0.0, 1.0, 5.0, 20.0];
/// A known weight: 500 g.
pub const WEIGHT_N: f64 = 4.9;

/// Volts of a DAC per newton of command: 10 V are 32,768 codes, and the example rig has 282.2 codes
/// per newton.
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
    /// Somebody stops the board from elsewhere once a pulse is so long, ms.
    pub stops_at_ms: Option<u32>,
}

impl Watched {
    pub fn new(options: Options) -> Self {
        Self {
            rig: FastRig::with(options).unwrap(),
            most_n: 0.0,
            command_n: 0.0,
            pulse_ms: [0; UNITS],
            longest_ms: 0,
            stops_at_ms: None,
        }
    }
}

impl RigLink for Watched {
    fn name(&self) -> String {
        self.rig.name()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let mut to_board = to_board.to_vec();
        if self.stops_at_ms.is_some_and(|ms| self.longest_ms >= ms) {
            self.stops_at_ms = None;
            let frame = HostFrame {
                seq: 0,
                command: Command::Stop,
            };
            let mut out = [0; wire::MAX_FRAME];
            let length = wire::encode(&frame, &mut out).unwrap();
            to_board.extend(&out[..length]);
        }
        let exchange = self.rig.exchange(&to_board, duration)?;
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
    /// Time of the rig that each test took, emulated hands included, s; 0: it was not run.
    pub seconds: [f64; Test::ALL.len()],
}

/// All tests of a rig with a case's mistake, as the command runs them.
pub fn run(pull_mm: f64, case: &Case, slack_mm: f64, seed: u64) -> Run {
    let mut plant = PlantConfig {
        effects: case.effects.clone(),
        ..PlantConfig::default()
    };
    plant.cable.initial_slack_m = 1e-3 * slack_mm;
    let options = Options {
        seed,
        plant,
        ..Options::default()
    };
    let mut link = Watched::new(options);
    for injection in &case.injections {
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
    let mut record = Record::new(&rig, Identity::default());
    let mut most_n = 0.0_f64;
    let mut seconds = [0.0; Test::ALL.len()];
    for (test, seconds) in Test::ALL.into_iter().zip(&mut seconds) {
        // As the command does.
        if test.drives() && record.may_drive(test).is_err() {
            continue;
        }
        link.most_n = 0.0;
        let longest_ms = link.longest_ms;
        let mut session = Session::connect(&mut link).unwrap();
        let mut hands = Emulated;
        let mut bench = Bench::new(&mut session, &rig, &plan, &mut hands).unwrap();
        let began_ns = bench.now_ns();
        bench.run(test, &mut record.figures).unwrap();
        *seconds = (bench.now_ns() - began_ns) as f64 * 1e-9;
        record.took(&rig, test, &plan.units, "2026-11-26");
        if test.drives() {
            most_n = most_n.max(link.most_n);
        }
        // No pulse, but seconds.
        if test == Test::Tension {
            link.longest_ms = longest_ms;
        }
    }
    Run {
        found: record.mistakes,
        figures: record.figures,
        most_n,
        command_n: link.command_n,
        longest_ms: link.longest_ms,
        seconds,
    }
}

/// A mistake as injections or as effects of the plant, and whether a name is the right one.
#[derive(Clone)]
pub struct Case {
    pub what: &'static str,
    pub injections: Vec<Injection>,
    pub effects: Vec<Effect>,
    pub is_right: fn(&Mistake) -> bool,
}

impl Case {
    /// Injections without a name to be found.
    pub fn of(what: &'static str, injections: &[Injection]) -> Self {
        Self {
            what,
            injections: injections.to_vec(),
            effects: Vec::new(),
            is_right: |_| false,
        }
    }

    /// The same with effects of the plant.
    fn with(self, effects: Vec<Effect>) -> Self {
        Self { effects, ..self }
    }
}

/// Friction beside that of the rig at a unit, from 1, N.
fn friction(unit: usize, constant_n: f64) -> Effect {
    Effect::Coulomb(Coulomb {
        units: vec![unit - 1],
        constant_n,
        per_load: 0.0,
    })
}

/// Dead time of a unit's drive, from 1, s.
fn delay(unit: usize, delay_s: f64) -> Effect {
    Effect::CommandDelay(CommandDelay {
        units: vec![unit - 1],
        delay_s,
    })
}

macro_rules! case {
    ($what:literal, [$($injection:expr),*], $($right:pat_param)|+ $(if $guard:expr)?) => {
        Case { what: $what, injections: vec![$($injection),*], effects: Vec::new(), is_right: |m| matches!(m, $($right)|+ $(if $guard)?) }
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
        case!(
            "E-stop's contact at the board bridged",
            [I::BridgeEStop(true)],
            M::EStopNotRead
        ),
        case!(
            "E-stop's input inverted",
            [I::InvertEStop(true)],
            M::EStopInverted
        ),
        case!(
            "E-stop's contact at the PLC bridged",
            [I::BridgeEStopAtPlc(true)],
            M::EStopNotAtPlc
        ),
        case!(
            "PLC's relay bridged",
            [I::BridgeRelay(true)],
            M::RelayBridged
        ),
        case!(
            "PLC's output inverted",
            [I::InvertRelay(true)],
            M::RelayInverted
        ),
        case!("alive line open", [I::OpenAlive(true)], M::NoPower),
        case!("amplifier 3 fed past the relay", [I::BypassRelay(3, true)], M::RelayBypassed { units } if *units == [3]),
        case!(
            "LDAC of unit 2 open",
            [I::OpenLdac(2, true)],
            M::MotorDead { unit: 2 }
        ),
        case!(
            "LDAC of all units open",
            [
                I::OpenLdac(1, true),
                I::OpenLdac(2, true),
                I::OpenLdac(3, true),
                I::OpenLdac(4, true),
                I::OpenLdac(5, true),
                I::OpenLdac(6, true)
            ],
            M::AllMotorsDead | M::NoCommand
        ),
        case!("selects of units 2 and 3 tied", [I::TieSelects(2, 3)], M::SelectsTied { units, .. } if *units == [2, 3]),
        case!("selects of units 1 and 6 tied", [I::TieSelects(1, 6)], M::SelectsTied { units, .. } if *units == [1, 6]),
        case!(
            "output of DAC 6 stuck at 0 V",
            [I::StuckDac(6, true)],
            M::MotorDead { unit: 6 }
        ),
        case!("converters 2 and 5 exchanged at the multiplexer", [I::ExchangeChannels(2, 5)], M::ChannelsExchanged { units } if *units == [2, 5]),
        case!("load cell 3 of 5 kg in place of 3", [I::CellShare(3, 0.6)], M::CellScale { unit: 3, ratio } if *ratio < 0.7),
        case!("load cell 6 of 2 kg in place of 3", [I::CellShare(6, 1.5)], M::CellScale { unit: 6, ratio } if *ratio > 1.4),
        // 40 mN.
        case!(
            "noise at load cell 4",
            [I::CellNoise(4, 2.7e-6)],
            M::Noise { unit: 4, .. }
        ),
        // 30 mN.
        case!(
            "mains at load cell 2",
            [I::CellTone(2, 2.0e-6, 50.0)],
            M::Tone { unit: 2, hz, .. } if (*hz - 50.0).abs() < 1.0
        ),
        case!(
            "DRDY wire 5 open",
            [I::CutDrdy(5, true)],
            M::DrdyDead { unit: 5 }
        ),
        case!(
            "code of converter 1 frozen",
            [I::FrozenCode(1, true)],
            M::ConverterSilent { unit: 1, .. }
        ),
        case!(
            "calibration of converter 3 fails",
            [I::CalibrationError(3, true)],
            M::ConverterSilent { unit: 3, .. }
        ),
        case!(
            "converter 4 of another kind",
            [I::WrongRevision(4, true)],
            M::ConverterSilent { unit: 4, .. }
        ),
        case!(
            "multiplexer mute",
            [I::MuteMux(true)],
            M::BoardFault { fault: 7 }
        ),
        case!(
            "SDA shorted",
            [I::HoldSda(true)],
            M::BoardFault { fault: 6 }
        ),
        case!(
            "no clock from the ST-Link",
            [I::LoseClock(true)],
            M::NoClock
        ),
        case!(
            "no pull-down at DAC_RST",
            [I::DacResetPull(DacResetPull::None)],
            M::DacResetPull { up: false }
        ),
        case!(
            "DAC_RST pulled to 3.3 V",
            [I::DacResetPull(DacResetPull::Up)],
            M::DacResetPull { up: true }
        ),
        case!(
            "brown-out level 0",
            [I::BrownOutLevel(0)],
            M::BrownOutLevel { level: 0 }
        ),
        case!(
            "counter 2 dead",
            [I::FreezeEncoder(3, true), I::FreezeEncoder(4, true)],
            M::CounterDead { chip: 2 }
        ),
        case!("friction of unit 2 0.45 N too high", [], M::Friction { unit: 2, ratio } if *ratio > 1.2)
            .with(vec![friction(2, 0.45)]),
        case!("friction of unit 5 0.5 N too low", [], M::Friction { unit: 5, ratio } if *ratio < 0.7)
            .with(vec![friction(5, -0.5)]),
        case!("drive 3 10 ms late", [], M::Delay { unit: 3, ms } if (*ms - 10.0).abs() < 3.0)
            .with(vec![delay(3, 0.010)]),
        case!("drive 6 5 ms late", [], M::Delay { unit: 6, ms } if (*ms - 5.0).abs() < 2.0)
            .with(vec![delay(6, 0.005)]),
        case!("reel 4 a tenth too large", [I::EncoderLines(4, 900)], M::EncoderScale { unit: 4, ratio } if *ratio < 0.95),
    ]
}

/// Two mistakes at once; one of the two names is enough.
pub fn pairs() -> Vec<Case> {
    use Injection as I;
    use Mistake as M;
    vec![
        case!(
            "motors 2 and 5 exchanged, encoder 3 dead",
            [I::ExchangeMotors(2, 5), I::FreezeEncoder(3, true)],
            M::MotorsExchanged { .. } | M::EncoderDead { unit: 3 }
        ),
        case!(
            "encoder and motor 4 reversed",
            [I::ReverseEncoder(4, true), I::AmplifierShare(4, -1.0)],
            M::EncoderSign { unit: 4 } | M::MotorSign { unit: 4 }
        ),
        case!(
            "load cells and encoders 1 and 2 exchanged",
            [I::ExchangeCells(1, 2), I::ExchangeEncoders(1, 2)],
            M::CellsExchanged { .. } | M::EncodersExchanged { .. }
        ),
        case!(
            "relay bridged, amplifier 5 with twice the gain",
            [I::BridgeRelay(true), I::AmplifierShare(5, 2.0)],
            M::RelayBridged | M::AmplifierGain { unit: 5, .. }
        ),
        case!(
            "alive line open, E-stop not read",
            [I::OpenAlive(true), I::BridgeEStop(true)],
            M::NoPower | M::EStopNotRead
        ),
        case!(
            "converter 2 unplugged, motors 1 and 4 exchanged",
            [I::UnplugSensor(2), I::ExchangeMotors(1, 4)],
            M::ConverterSilent { unit: 2, .. } | M::MotorsExchanged { .. }
        ),
        case!(
            "amplifier 1 with twice the gain, its encoder dead",
            [I::AmplifierShare(1, 2.0), I::FreezeEncoder(1, true)],
            M::AmplifierGain { unit: 1, .. } | M::EncoderDead { unit: 1 }
        ),
        case!(
            "selects of units 2 and 3 tied, load cell 4 reversed",
            [I::TieSelects(2, 3), I::WrongSign(4, true)],
            M::SelectsTied { .. } | M::CellSign { unit: 4 }
        ),
        case!(
            "DRDY lines 3 and 4 exchanged, bridge 6 open",
            [I::ExchangeDrdy(3, 4), I::OpenBridge(6, true)],
            M::DrdyExchanged { .. } | M::CellDead { unit: 6 }
        ),
        case!(
            "bridge 5 open, encoder 5 dead",
            [I::OpenBridge(5, true), I::FreezeEncoder(5, true)],
            M::CellDead { unit: 5 } | M::EncoderDead { unit: 5 }
        ),
    ]
}

/// One of the right names is among those that were found.
pub fn one_is_named(case: &Case, run: &Run) -> bool {
    run.found
        .iter()
        .any(|named| (case.is_right)(&named.mistake))
}

/// The right name is the first one.
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
