//! Which fault an injection must cause: one line for each detection of the firmware. A detection
//! that is switched off shows here even where another one stops the motors in its place.

use crate::case::{run, Bases};
use crate::injection::{Injection as I, Plan};
use crate::outcome::TENSION_N;
use control::{Config, Fault as F};

/// What must come of an injection, or of two.
pub struct Expected {
    /// Start of the case: setpoints and the robot's motion.
    pub base: u64,
    /// The first.
    pub first: I,
    /// The second, and when, in milliseconds.
    pub second: Option<(I, u32)>,
    /// The fault that must be latched first; `None`: none may be, and the board stays armed.
    pub fault: Option<F>,
    /// Longest time to the fault, in milliseconds.
    pub within_ms: u32,
    /// Whether the amplifiers must have lost their power at the end.
    pub power_off: bool,
    /// Largest tension that any cable may reach, N; the campaign's own limit where nothing tighter
    /// is expected.
    pub at_most_n: f64,
}

const fn one(first: I, fault: F, within_ms: u32) -> Expected {
    Expected {
        base: 0,
        first,
        second: None,
        fault: Some(fault),
        within_ms,
        power_off: false,
        at_most_n: TENSION_N,
    }
}

impl Expected {
    /// A second one so many milliseconds later.
    const fn then(mut self, ms: u32, second: I) -> Self {
        self.second = Some((second, ms));
        self
    }

    const fn power_off(mut self) -> Self {
        self.power_off = true;
        self
    }

    const fn at_most_n(mut self, n: f64) -> Self {
        self.at_most_n = n;
        self
    }

    const fn at_base(mut self, base: u64) -> Self {
        self.base = base;
        self
    }
}

/// The list.
pub const EXPECTED: &[Expected] = &[
    one(I::Saturated(0, true), F::AdcSaturated, 40),
    one(I::Offset(1, 18.0), F::OverTension, 40),
    one(I::Silent(2), F::SensorSilent, 20),
    one(I::Extra(3), F::SensorFast, 150),
    one(I::Period(3, 1.15), F::SensorSlow, 150),
    one(I::Frozen(4), F::SensorFrozen, 40),
    one(I::Offset(0, -6.0), F::TensionNegative, 80),
    one(I::AmplifierOff(0), F::Implausible, 150),
    // The amplifier suddenly gives half as much again: the reel speeds up before the load cell's
    // filter has followed.
    one(I::AmplifierGain(4, 1.5), F::Implausible, 20),
    // The words to an output ask for an eighth of the range more from now on: without RST its 0 V
    // would be that. Over 16 phases of the sample the cable gets 8.6 to 14.0 N, in this one 12.0;
    // with half of the range 10.7 to 15.6 N.
    one(I::DacBitStuck(0, 12, true), F::OutputStuck, 10).at_most_n(13.0),
    one(I::Offset(0, 3.0), F::CommandAtLimit, 700),
    one(I::ReadsFail(1), F::SensorReads, 20),
    one(I::BusHeld, F::BusStuck, 12),
    one(I::MuxSilent, F::MuxSilent, 12),
    one(I::EncoderNoise(2, 20), F::EncoderError, 400),
    one(I::EncoderJump(2, -5_000), F::EncoderError, 4).at_most_n(9.0),
    one(I::HostStops, F::SetpointsExpired, 110),
    one(I::StopElsewhere, F::HostStop, 2),
    // The scale of the DAC, which the next sample needs; the slew rate, which nothing but the check
    // of each second sees.
    one(I::ConfigBit(2, 7 * 32 + 28), F::ConfigCrc, 5),
    one(I::ConfigBit(4, Config::SLEW_BIT + 40), F::ConfigCrc, 1_010),
    one(I::Overrun(2_000), F::LoopOverrun, 2),
    one(I::EventsLost, F::QueueOverflow, 2),
    one(I::RegisterChanged, F::RegisterChanged, 2),
    one(I::EStop, F::EStop, 3),
    one(I::Hang, F::WatchdogReset, 60),
    one(I::FrameBit(77, u32::MAX), F::SetpointsExpired, 110),
    one(I::SetpointRange(0, 30_000_000), F::SetpointsExpired, 110),
    one(I::WrongDirections, F::TipForce, 60),
    one(I::DacLink, F::DacLink, 2).power_off(),
    one(I::DacStuck(3), F::HostStop, 8)
        .then(5, I::StopElsewhere)
        .power_off(),
    // From 3 to 10 N, more than friction lets a resting reel swing.
    one(I::EncoderFrozen(0), F::EncoderStill, 800).then(100, I::SetpointRange(0, 10_000_000)),
    // The cell drifts to 2.4 N too much, which the whole band permits; the robot's motion makes the
    // reel slide.
    one(I::Drift(5, 3.4), F::Implausible, 800).then(250, I::RobotMoves),
    // The command rises, no reel can hold that: of the two that are broken the encoder shows. The
    // limit of the command bounds the pull until then.
    one(I::EncoderFrozen(0), F::EncoderStill, 100).then(5, I::AmplifierOff(0)),
    one(I::EncoderFrozen(2), F::EncoderStill, 100)
        .then(5, I::OpenBridge(2))
        .at_most_n(10.0),
    // Another unit's words pull a cable at 0 V whose load cell shows too little of it: the reel
    // speeds up.
    one(I::Sensitivity(1, 0.18), F::Implausible, 100)
        .then(194, I::DacSelect(3, 1))
        .power_off()
        .at_most_n(9.0),
    // The same with a load cell that can be believed: the cable that is pulled again shows it too,
    // but only after 75 ms.
    one(I::Extra(1), F::SensorFast, 150)
        .then(194, I::DacSelect(3, 1))
        .at_base(1)
        .power_off()
        .at_most_n(9.0),
    // A load cell that begins to read too little behind a stuck DAC says that the cable has let go.
    one(I::DacStuck(3), F::EncoderStill, 150)
        .then(5, I::OpenBridge(3))
        .power_off(),
    // Damage of the memory behind a stuck DAC: the tension cannot tell any more whether the cable
    // lets go.
    one(I::DacStuck(4), F::ConfigCrc, 200)
        .then(190, I::ConfigBit(4, 27))
        .power_off(),
    Expected {
        base: 0,
        first: I::StatusElsewhere,
        second: None,
        fault: None,
        within_ms: 0,
        power_off: false,
        at_most_n: TENSION_N,
    },
];

/// Compares the list with what happens.
///
/// # Errors
/// The first line that does not hold, in words.
pub fn check(bases: &Bases) -> Result<(), String> {
    for expected in EXPECTED {
        let plan = Plan::holding(expected.base, expected.first, expected.second);
        let outcome = run(bases, 0, plan);
        let wrong = |what: String| {
            Err(format!(
                "{:?}, {:?}: {what}; latched was {:?} after {:?} ms",
                expected.first,
                expected.second,
                F::from_code(outcome.fault),
                outcome.detected_ms
            ))
        };
        if outcome.fault != expected.fault.map_or(0, F::code) {
            return wrong(format!("{:?} was expected", expected.fault));
        }
        if outcome
            .detected_ms
            .is_some_and(|ms| ms > expected.within_ms)
        {
            return wrong(format!("{} ms were expected", expected.within_ms));
        }
        if outcome.tension_n > expected.at_most_n {
            return wrong(format!(
                "{} N at most were expected, not {} N",
                expected.at_most_n, outcome.tension_n
            ));
        }
        if expected.power_off && outcome.powered {
            return wrong("the amplifiers still have power".to_owned());
        }
        if expected.fault.is_none() && !outcome.armed {
            return wrong("the board is not armed any more".to_owned());
        }
        if !outcome.hazards.is_empty() {
            return wrong(format!("{:?}", outcome.hazards));
        }
    }
    Ok(())
}
