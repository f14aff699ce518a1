//! Interface of the sequence: actions, events, stages, and the error with stage, register and
//! cause.

use crate::nau7802::regs::{Register, Revision};

/// What the owner of the bus does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Write these bytes to [`ADDRESS`](crate::nau7802::ADDRESS), then report [`Event::Written`].
    Write([u8; 2]),
    /// Write the register address, then read one byte after a repeated START; report
    /// [`Event::Read`].
    WriteRead([u8; 1]),
    /// Let at least this many microseconds pass, then report [`Event::Waited`].
    WaitUs(u32),
    /// Finished: the converter runs. Its first six conversions settle, and may come with DRDY:
    /// discard six results ([`Settling`](crate::nau7802::Settling)), and a result that was ready
    /// before.
    Done,
    /// Given up. The part may be in any state; start again with a new machine.
    Failed(SequenceError),
}

/// Result of the last [`Action`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// First call.
    Start,
    /// The write was acknowledged.
    Written,
    /// The byte that was read.
    Read(u8),
    /// The time has passed.
    Waited,
    /// NACK, lost arbitration, timeout: whatever kept the transaction from completing.
    BusFault,
}

numbered! {
    /// Steps of the sequence. The number goes into fault records: never renumber.
    Stage,
    /// What the stage does, for messages and documentation.
    description {
        /// RR=1.
        ResetAssert = 1, "assert the register reset";
        /// RR=0.
        ResetRelease = 2, "release the register reset";
        /// PUD=1 and the wait after it.
        PowerUpDigital = 3, "power up the digital part";
        /// Waiting for PUR.
        PowerUpReady = 4, "wait for power-up ready";
        /// Revision check.
        RevisionCheck = 5, "check the revision";
        /// Voltage, gain and DRDY polarity.
        WriteCtrl1 = 6, "set supply voltage, gain and DRDY polarity";
        /// Analog power; conversions stopped.
        PowerUpAnalog = 7, "power up the analog part";
        /// Wait for the analog supply.
        SupplySettle = 8, "let the analog supply settle";
        /// Channel and rate.
        WriteCtrl2 = 9, "set channel and rate";
        /// Bus options.
        WriteI2cCtrl = 10, "set the bus options";
        /// Amplifier options.
        WritePga = 11, "set the amplifier options";
        /// Amplifier capacitor.
        WritePower = 12, "set the amplifier capacitor";
        /// Chopper off.
        WriteAdc = 13, "turn the modulator chopper off";
        /// Read-back of PU_CTRL.
        VerifyPuCtrl = 14, "read the power control back";
        /// Read-back of CTRL1.
        VerifyCtrl1 = 15, "read supply voltage, gain and DRDY polarity back";
        /// Read-back of CTRL2.
        VerifyCtrl2 = 16, "read channel and rate back";
        /// Read-back of I2C_CTRL.
        VerifyI2cCtrl = 17, "read the bus options back";
        /// Read-back of PGA; also makes sure that the next read-back reads the ADC register.
        VerifyPga = 18, "read the amplifier options back";
        /// Read-back of POWER.
        VerifyPower = 19, "read the amplifier capacitor back";
        /// Read-back of ADC.
        VerifyAdc = 20, "read the modulator chopper back";
        /// CS=1: the filter fills while the supply settles, and a calibration needs the converter
        /// running.
        CycleStart = 21, "start the converter";
        /// CALS=1.
        CalibrationStart = 22, "start the calibration";
        /// Waiting for CALS=0, then checking CAL_ERR.
        CalibrationWait = 23, "wait for the calibration and check it";
        /// CS=0.
        CycleStop = 24, "stop the converter";
        /// CS=1 again, so that the first result comes from a whole cycle after the calibration.
        CycleRestart = 25, "start a fresh conversion cycle";
        /// Nothing left to do.
        Finished = 26, "finished";
    }
}

impl Stage {
    /// The stage of a fault record: the top byte of [`SequenceError::detail`].
    pub const fn from_number(number: u8) -> Option<Self> {
        if number >= 1 && number as usize <= Self::ALL.len() {
            Some(Self::ALL[number as usize - 1])
        } else {
            None
        }
    }
}

/// Why the sequence gave up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cause {
    /// The bus failed [`BUS_RESTARTS`](super::limits::BUS_RESTARTS) + 1 times: part unplugged, mux
    /// channel wrong, bus held.
    Bus,
    /// PUR never came.
    PowerUpTimeout,
    /// Another revision than 0xF; carries what was read.
    Revision(u8),
    /// A register didn't keep what was written (compared under the mask of its setting bits).
    ReadBack {
        /// What was written.
        expected: u8,
        /// What was read.
        found: u8,
    },
    /// CALS never cleared.
    CalibrationTimeout,
    /// CAL_ERR after [`CALIBRATION_TRIES`](super::limits::CALIBRATION_TRIES) calibrations: input
    /// out of the mode's range.
    CalibrationError,
    /// An [`Event`] that doesn't answer the last [`Action`]: a bug in the caller.
    UnexpectedEvent,
}

impl Cause {
    /// Number for fault records; never renumber.
    pub const fn code(self) -> u8 {
        match self {
            Self::Bus => 1,
            Self::PowerUpTimeout => 2,
            Self::Revision(_) => 3,
            Self::ReadBack { .. } => 4,
            Self::CalibrationTimeout => 5,
            Self::CalibrationError => 6,
            Self::UnexpectedEvent => 7,
        }
    }

    pub(super) const fn found(self) -> u8 {
        match self {
            Self::Revision(found) | Self::ReadBack { found, .. } => found,
            _ => 0,
        }
    }
}

/// Where and why the sequence gave up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SequenceError {
    /// Step that failed.
    pub stage: Stage,
    /// Register that the step was about.
    pub register: Register,
    /// What was wrong.
    pub cause: Cause,
}

impl SequenceError {
    /// For a fault record: stage, cause, register address and the byte found, from the top byte
    /// down.
    pub const fn detail(&self) -> u32 {
        u32::from_be_bytes([
            self.stage as u8,
            self.cause.code(),
            self.register.address(),
            self.cause.found(),
        ])
    }
}

impl core::fmt::Display for SequenceError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "NAU7802 stage {} ({}), register {}: ",
            self.stage as u8,
            self.stage.description(),
            self.register
        )?;
        match self.cause {
            Cause::Bus => f.write_str(
                "no answer on the bus; check the plug, the mux channel and the pull-ups",
            ),
            Cause::PowerUpTimeout => f.write_str("PUR stayed 0; check the supply"),
            Cause::Revision(found) => write!(
                f,
                "revision 0x{found:X} where 0x{:X} was expected; is it a NAU7802?",
                Revision::EXPECTED
            ),
            Cause::ReadBack { expected, found } => write!(
                f,
                "wrote 0x{expected:02X}, read back 0x{found:02X}; check the bus for noise"
            ),
            Cause::CalibrationTimeout => f.write_str("CALS stayed 1; power the part off and on"),
            Cause::CalibrationError => {
                f.write_str("CAL_ERR; check the bridge wiring and the load for this mode")
            }
            Cause::UnexpectedEvent => {
                f.write_str("event doesn't answer the action; fix the caller")
            }
        }
    }
}

impl core::error::Error for SequenceError {}

/// The register a stage is about.
pub(super) const fn register_of(stage: Stage) -> Register {
    match stage {
        Stage::ResetAssert
        | Stage::ResetRelease
        | Stage::PowerUpDigital
        | Stage::PowerUpReady
        | Stage::PowerUpAnalog
        | Stage::SupplySettle
        | Stage::VerifyPuCtrl
        | Stage::CycleStart
        | Stage::CycleStop
        | Stage::CycleRestart
        | Stage::Finished => Register::PuCtrl,
        Stage::RevisionCheck => Register::Revision,
        Stage::WriteCtrl1 | Stage::VerifyCtrl1 => Register::Ctrl1,
        Stage::WriteCtrl2
        | Stage::VerifyCtrl2
        | Stage::CalibrationStart
        | Stage::CalibrationWait => Register::Ctrl2,
        Stage::WriteI2cCtrl | Stage::VerifyI2cCtrl => Register::I2cCtrl,
        Stage::WritePga | Stage::VerifyPga => Register::Pga,
        Stage::WritePower | Stage::VerifyPower => Register::Power,
        Stage::WriteAdc | Stage::VerifyAdc => Register::Adc,
    }
}
