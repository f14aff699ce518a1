//! The mistakes that have a name, in words, with what to do. Units count from 1 here: what a person
//! reads.

use crate::steps::Test;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A mistake of wiring or setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[allow(missing_docs)] // the words of `Display` say what each is
pub enum Mistake {
    NoClock,
    BrownOutLevel { level: u8 },
    DacResetPull { up: bool },
    BoardFault { fault: u16 },
    ConverterSilent { unit: u8, fault: u16, detail: u32 },
    DrdyDead { unit: u8 },
    DrdyExchanged { units: Vec<u8> },
    ChannelsExchanged { units: Vec<u8> },
    SamplesMissed { unit: u8, missed: u32 },
    Rate { unit: u8, sps: f64 },
    Noise { unit: u8, noise_n: f64 },
    Tone { unit: u8, hz: f64, amplitude_n: f64 },
    FailedReads { unit: u8, failed: u16 },
    BusRecoveries { recoveries: u16 },
    EStopNotRead,
    EStopInverted,
    EStopOpen,
    EStopNotAtPlc,
    RelayBridged,
    RelayInverted,
    RelayBypassed { units: Vec<u8> },
    NoPower,
    EncoderDead { unit: u8 },
    CounterDead { chip: u8 },
    EncodersExchanged { units: Vec<u8> },
    EncoderSign { unit: u8 },
    EncoderLines { unit: u8, lines: u32 },
    EncoderScale { unit: u8, ratio: f64 },
    CellDead { unit: u8 },
    CellsExchanged { units: Vec<u8> },
    CellSign { unit: u8 },
    CellScale { unit: u8, ratio: f64 },
    MotorDead { unit: u8 },
    AllMotorsDead,
    NoCommand,
    MotorsExchanged { units: Vec<u8> },
    MotorSign { unit: u8 },
    AmplifierGain { unit: u8, ratio: f64 },
    SelectsTied { motor: u8, units: Vec<u8> },
    NotDriven { unit: u8, why: String },
    NotLoaded { unit: u8, why: String },
    NotLoose { unit: u8 },
    NotTight { unit: u8, wound_mm: f64 },
    Friction { unit: u8, ratio: f64 },
    Delay { unit: u8, ms: f64 },
}

/// How sure a name is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sure {
    /// What was measured has no other explanation among these mistakes.
    Certain,
    /// Another one is possible, which is listed too.
    Likely,
    /// One of several.
    Possible,
}

/// A mistake with the evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// The mistake.
    pub mistake: Mistake,
    /// How sure it is.
    pub sure: Sure,
    /// What was seen.
    pub evidence: String,
}

fn list(units: &[u8]) -> String {
    let words: Vec<String> = units.iter().map(u8::to_string).collect();
    match words.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
        None => String::new(),
    }
}

impl Mistake {
    /// The test that shows it, and shows that it is gone.
    #[must_use]
    pub fn test(&self) -> Test {
        match self {
            Self::NoClock
            | Self::BrownOutLevel { .. }
            | Self::DacResetPull { .. }
            | Self::BoardFault { .. } => Test::Board,
            Self::ConverterSilent { .. }
            | Self::DrdyDead { .. }
            | Self::DrdyExchanged { .. }
            | Self::ChannelsExchanged { .. }
            | Self::SamplesMissed { .. }
            | Self::Rate { .. }
            | Self::Noise { .. }
            | Self::Tone { .. }
            | Self::FailedReads { .. }
            | Self::BusRecoveries { .. } => Test::Converters,
            Self::EStopNotRead | Self::EStopInverted | Self::EStopOpen => Test::Estop,
            Self::EStopNotAtPlc
            | Self::RelayBridged
            | Self::RelayInverted
            | Self::RelayBypassed { .. }
            | Self::NoPower => Test::Power,
            Self::EncoderDead { .. }
            | Self::CounterDead { .. }
            | Self::EncodersExchanged { .. }
            | Self::EncoderSign { .. }
            | Self::EncoderLines { .. }
            | Self::EncoderScale { .. }
            | Self::CellDead { .. }
            | Self::CellsExchanged { .. }
            | Self::CellSign { .. } => Test::Reels,
            Self::CellScale { .. } => Test::Weights,
            Self::MotorDead { .. }
            | Self::AllMotorsDead
            | Self::NoCommand
            | Self::MotorsExchanged { .. }
            | Self::MotorSign { .. }
            | Self::AmplifierGain { .. }
            | Self::SelectsTied { .. }
            | Self::NotDriven { .. } => Test::Motors,
            Self::NotLoaded { .. }
            | Self::NotLoose { .. }
            | Self::NotTight { .. }
            | Self::Friction { .. }
            | Self::Delay { .. } => Test::Tension,
        }
    }

    /// What to do about it.
    #[must_use]
    pub fn what_to_do(&self) -> String {
        match self {
            Self::NoClock => "check the ST-Link's clock output (solder bridges SB3 and SB4 of the Nucleo) and its supply".into(),
            Self::BrownOutLevel { .. } => "set BOR_LEV = 3 in the option bytes (docs/bring-up.md)".into(),
            Self::DacResetPull { .. } => {
                "fit 4.7 kOhm from DAC_RST (PF15) to ground (docs/wiring.md): without it a controller in reset leaves the motors where they were".into()
            }
            Self::BoardFault { fault } => format!("`forcectl explain {fault}` says what to do; then `forcectl clear`"),
            Self::ConverterSilent { unit, .. } => {
                format!("check the plug of converter {unit}: 3.3 V, ground, SDA and SCL of multiplexer channel {}", unit - 1)
            }
            Self::DrdyDead { unit } => format!("check the DRDY wire of unit {unit} (docs/wiring.md)"),
            Self::DrdyExchanged { .. } => "exchange their DRDY wires: each converter's DRDY goes to its own unit's pin".into(),
            Self::SamplesMissed { unit, .. } => format!("check SDA, SCL and DRDY of unit {unit} with an oscilloscope"),
            Self::Rate { unit, .. } => format!("check the supply of converter {unit}"),
            Self::Noise { unit, .. } => format!("check the shield of cell {unit} and keep its cable away from the motor's"),
            Self::Tone { unit, .. } => {
                format!("check the shield and the ground of cell {unit}: mains is at 50 or 60 Hz and 100 or 120 Hz; another frequency may be that of an amplifier or a fan")
            }
            Self::FailedReads { unit, .. } => format!("check the plug of converter {unit}, SDA and SCL at it, and the pull resistors (docs/wiring.md)"),
            Self::BusRecoveries { .. } => "check SDA and SCL from the controller to the multiplexer and behind it with an oscilloscope: pull resistors, rise time, length of the cables (docs/wiring.md)".into(),
            Self::EStopNotRead => "check that the E-stop's contact is in the loop to PG8 and not bridged".into(),
            Self::EStopInverted => "use the normally closed contact of the E-stop".into(),
            Self::EStopOpen => "release the E-stop and check its plug".into(),
            Self::EStopNotAtPlc => "check that the E-stop's second contact is in the PLC's loop and not bridged".into(),
            Self::RelayBridged => {
                "check the PLC's relay for a bridge or a welded contact, and that the PLC watches the alive line (docs/wiring.md)".into()
            }
            Self::RelayInverted => "use the PLC's normally open output: without edges of the alive line it has to be open".into(),
            Self::RelayBypassed { .. } => "feed these amplifiers from the PLC's relay as the others".into(),
            Self::NoPower => {
                "check the alive line from PC8 (SB14 and SB15, docs/wiring.md) to the PLC's input, its limits of 0.2 to 5 ms, and the amplifiers' supply".into()
            }
            Self::ChannelsExchanged { .. } => "exchange SDA and SCL of these converters at the multiplexer".into(),
            Self::CounterDead { chip } => format!("check 5 V, FCK, CS of LS7266R1 number {chip}, and RD and WR at it"),
            Self::NoCommand => {
                "check SCK, SDI, LDAC and RST of the DACs, their +-15 V, the wires to the amplifiers' inputs, and the amplifiers' enable".into()
            }
            Self::EncoderDead { unit } => format!("check plug, 5 V, A and B of encoder {unit}, and FCK of its counter"),
            Self::EncodersExchanged { .. } => "exchange the encoder plugs".into(),
            Self::EncoderSign { unit } => {
                format!("exchange A and B of encoder {unit}, or change the sign of travel_m_per_count in the rig file")
            }
            Self::EncoderLines { unit, lines } => {
                format!("set encoder {unit} to 1,000 lines, or multiply travel_m_per_count by 1000/{lines} in the rig file")
            }
            Self::EncoderScale { unit, ratio } => {
                format!("check reel and gear of unit {unit}; travel_m_per_count divided by {ratio:.3} would fit")
            }
            Self::CellDead { unit } => format!("check the four wires of cell {unit} at its converter"),
            Self::CellsExchanged { .. } => "exchange the load cells' cables".into(),
            Self::CellSign { unit } => {
                format!("exchange the signal wires of cell {unit}, or change the sign of scale_n_per_count in the rig file")
            }
            Self::CellScale { unit, .. } => format!("check the capacity of cell {unit}, then `forcectl calibrate gain`"),
            Self::MotorDead { unit } => format!("check amplifier {unit}: supply, enable, its input from the DAC, the motor's cable; CS, LDAC and RST of the DAC"),
            Self::AllMotorsDead => "check the amplifiers' supply, the PLC's relay, the alive line (PC8) and LDAC".into(),
            Self::MotorsExchanged { .. } => "exchange the motors' cables, or their wires at the DACs".into(),
            Self::MotorSign { unit } => format!("exchange the two wires of motor {unit}"),
            Self::AmplifierGain { unit, .. } => {
                format!("check the gain of amplifier {unit} (A/V), its input range, and dac_codes_per_n in the rig file")
            }
            Self::SelectsTied { .. } => "check the DACs' CS and LDAC wires for a bridge".into(),
            Self::NotDriven { .. } | Self::NotLoaded { .. } => "remove that cause and run the test again".into(),
            Self::NotLoose { unit } => format!("lay cable {unit} loose and run the test again"),
            Self::NotTight { unit, .. } => format!("check that cable {unit} is on its reel and held at its end, then lay it loose and run the test again"),
            Self::Friction { unit, ratio } if *ratio > 1.0 => {
                format!("check that cable {unit}, its reel and its gear run freely; else correct coulomb_n in the rig file (`forcectl identify` measures it)")
            }
            Self::Friction { unit, .. } => {
                format!("check that reel {unit} is fast on its shaft; else correct coulomb_n in the rig file (`forcectl identify` measures it)")
            }
            Self::Delay { unit, .. } => {
                format!("check amplifier {unit} for a filter or a slow mode; of all units: the converters latch their result when the pointer is written (docs/bring-up.md, step 8)")
            }
        }
    }
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoClock => write!(
                f,
                "the board has no external clock and runs on its internal one"
            ),
            Self::BrownOutLevel { level } => {
                write!(f, "the brown-out level is {level} and has to be 3")
            }
            Self::DacResetPull { up: false } => {
                write!(f, "nothing holds DAC_RST low while the controller is in reset: its pull-down is missing")
            }
            Self::DacResetPull { up: true } => {
                write!(f, "DAC_RST is pulled up, not down: it is high while the controller is in reset")
            }
            Self::BoardFault { fault } => write!(f, "fault {fault} of the board is latched"),
            Self::ConverterSilent {
                unit,
                fault,
                detail,
            } => {
                write!(
                    f,
                    "unit {unit}: the converter does not work ({})",
                    session::explain_fault(*fault, *detail)
                )
            }
            Self::DrdyDead { unit } => write!(
                f,
                "unit {unit}: the converter works and its DRDY line is silent"
            ),
            Self::DrdyExchanged { units } => {
                write!(f, "units {}: their DRDY lines are exchanged", list(units))
            }
            Self::SamplesMissed { unit, missed } => {
                write!(f, "unit {unit}: {missed} conversions were not read in time")
            }
            Self::Rate { unit, sps } => write!(
                f,
                "unit {unit}: the converter gives {sps:.0} samples a second in place of 320"
            ),
            Self::Noise { unit, noise_n } => write!(
                f,
                "unit {unit}: the load cell's noise is {:.1} mN",
                1e3 * noise_n
            ),
            Self::Tone {
                unit,
                hz,
                amplitude_n,
            } => write!(
                f,
                "unit {unit}: a tone of {hz:.1} Hz and {:.1} mN is in the load cell's signal",
                1e3 * amplitude_n
            ),
            Self::FailedReads { unit, failed } => write!(
                f,
                "unit {unit}: {failed} reads of the converter failed on the bus and were repeated"
            ),
            Self::BusRecoveries { recoveries } => write!(
                f,
                "the sensor bus was held {recoveries} times and had to be cleared"
            ),
            Self::EStopNotRead => write!(
                f,
                "the E-stop is not read: its contact is bridged or not wired"
            ),
            Self::EStopInverted => {
                write!(f, "the E-stop's contact is inverted: closed when pressed")
            }
            Self::EStopOpen => write!(f, "the E-stop loop is open though the button is released"),
            Self::EStopNotAtPlc => write!(
                f,
                "the amplifiers keep their power while the E-stop is pressed: the PLC does not see it"
            ),
            Self::RelayBridged => write!(
                f,
                "the amplifiers have power without the alive line: the PLC's relay is bridged"
            ),
            Self::RelayInverted => write!(
                f,
                "the amplifiers have power without the alive line and none with it: the PLC's output is inverted"
            ),
            Self::RelayBypassed { units } => write!(
                f,
                "units {}: their amplifiers have power without the alive line: they are fed past the PLC's relay",
                list(units)
            ),
            Self::NoPower => write!(
                f,
                "the amplifiers get no power: the alive line is open, or the PLC gives none"
            ),
            Self::ChannelsExchanged { units } => write!(
                f,
                "units {}: their converters' cables are exchanged at the multiplexer",
                list(units)
            ),
            Self::CounterDead { chip } => write!(
                f,
                "units {} and {}: counter {chip} does not count",
                2 * chip - 1,
                2 * chip
            ),
            Self::NoCommand => write!(
                f,
                "no motor gives any force although the amplifiers have power: they get no command, or are not enabled"
            ),
            Self::EncoderDead { unit } => write!(f, "unit {unit}: the encoder does not count"),
            Self::EncodersExchanged { units } => {
                write!(f, "units {}: their encoders are exchanged", list(units))
            }
            Self::EncoderSign { unit } => {
                write!(f, "unit {unit}: the encoder counts the wrong way")
            }
            Self::EncoderLines { unit, lines } => write!(
                f,
                "unit {unit}: the encoder has {lines} lines in place of 1000"
            ),
            Self::EncoderScale { unit, ratio } => {
                write!(
                    f,
                    "unit {unit}: the encoder shows {ratio:.3} times the cable's travel"
                )
            }
            Self::CellDead { unit } => write!(
                f,
                "unit {unit}: the load cell does not answer (a bridge wire is open)"
            ),
            Self::CellsExchanged { units } => {
                write!(f, "units {}: their load cells are exchanged", list(units))
            }
            Self::CellSign { unit } => {
                write!(f, "unit {unit}: the load cell reads a pull as a push")
            }
            Self::CellScale { unit, ratio } => write!(
                f,
                "unit {unit}: the load cell reads {ratio:.2} times the weight"
            ),
            Self::MotorDead { unit } => write!(f, "unit {unit}: the motor gives no force"),
            Self::AllMotorsDead => write!(
                f,
                "no motor gives any force: the amplifiers have no power or no signal"
            ),
            Self::MotorsExchanged { units } => {
                write!(f, "units {}: their motors are exchanged", list(units))
            }
            Self::MotorSign { unit } => {
                write!(f, "unit {unit}: the motor turns the wrong way, it pays out")
            }
            Self::AmplifierGain { unit, ratio } => write!(
                f,
                "unit {unit}: the amplifier's gain is about {ratio:.1} times the right one"
            ),
            Self::SelectsTied { motor, units } => {
                write!(
                    f,
                    "the command of unit {motor} moves units {}: select or LDAC wires are tied",
                    list(units)
                )
            }
            Self::NotDriven { unit, why } => {
                write!(f, "unit {unit}: the board did not drive the motor: {why}")
            }
            Self::NotLoaded { unit, why } => {
                write!(f, "unit {unit}: the cable was not loaded to the end: {why}")
            }
            Self::NotLoose { unit } => write!(f, "unit {unit}: the cable was not loose"),
            Self::NotTight { unit, wound_mm } => write!(
                f,
                "unit {unit}: {wound_mm:.0} mm of cable were wound in, and it did not get tight"
            ),
            Self::Friction { unit, ratio } => write!(
                f,
                "unit {unit}: the friction is about {ratio:.1} times the rig file's"
            ),
            Self::Delay { unit, ms } => write!(
                f,
                "unit {unit}: the tension follows the command {ms:.0} ms later than a rig in order"
            ),
        }
    }
}
