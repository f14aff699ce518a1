//! Bring-up of a NAU7802 as a state machine without a bus, for a superloop and for blocking code alike.
//!
//! ```text
//! RR=1, RR=0, PUD=1, 200 us, wait PUR, revision        datasheet section 9.1 (power-on sequence)
//!   -> CTRL1, PU_CTRL (0xAE), supply settles           voltage chosen before the regulator starts
//!   -> CTRL2, I2C_CTRL, PGA, POWER, ADC (0x30)
//!   -> read every one of them back
//!   -> CS=1, calibrate, wait CALS=0, check CAL_ERR      section 8.6
//!   -> CS=0, CS=1                                      fresh conversion cycle
//! ```
//!
//! The owner performs each [`Action`] and reports the outcome as an [`Event`]. Nothing in between is
//! hidden: the waits are actions too, so six converters calibrate at the same time on one bus, each
//! with its own machine. The converter runs during its calibration, so DRDY edges come before
//! [`Action::Done`]: ignore them until then.
//!
//! Each wait and each retry is bounded ([`limits`]). A failed bus transaction leaves the part's state
//! unknown, so the sequence starts over from its beginning, a bounded number of times.

use super::config::Config;
use super::proto;
use super::regs::{CalibrationMode, Ctrl2, PuCtrl, Register, Revision};

/// Bounds and waits of the sequence. Times are lower bounds in microseconds.
pub mod limits {
    /// From PUD=1 to the first look at PUR (datasheet section 9.1: about 200 us).
    pub const POWER_UP_WAIT_US: u32 = 200;
    /// Between looks at PUR.
    pub const POWER_UP_POLL_US: u32 = 1_000;
    /// Looks at PUR before giving up: 100 ms altogether.
    pub const POWER_UP_POLLS: u16 = 100;
    /// Between reads of the revision: a cold part may answer with something else at first.
    pub const REVISION_POLL_US: u32 = 1_000;
    /// Reads of the revision before giving up.
    pub const REVISION_TRIES: u16 = 10;
    /// From CALS=1 to the first look at it. A calibration takes about 344 ms; earlier looks would only
    /// load the bus that the other converters share.
    pub const CALIBRATION_WAIT_US: u32 = 340_000;
    /// Between looks at CALS.
    pub const CALIBRATION_POLL_US: u32 = 4_000;
    /// Looks at CALS before giving up: 1.1 s altogether, three times the usual.
    pub const CALIBRATION_POLLS: u16 = 200;
    /// Calibrations that may end with CAL_ERR before giving up.
    pub const CALIBRATION_TRIES: u16 = 3;
    /// Times the sequence may start over after a failed bus transaction.
    pub const BUS_RESTARTS: u16 = 3;
    /// Wait before the sequence starts over, for the bus to be recovered meanwhile.
    pub const BUS_RESTART_WAIT_US: u32 = 1_000;
}

/// What the owner of the bus does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Write these bytes to [`super::ADDRESS`], then report [`Event::Written`].
    Write([u8; 2]),
    /// Write the register address, then read one byte after a repeated START; report [`Event::Read`].
    WriteRead([u8; 1]),
    /// Let at least this many microseconds pass, then report [`Event::Waited`].
    WaitUs(u32),
    /// Finished: the converter runs; the first six conversions settle and DRDY stays quiet for them.
    Done,
    /// Given up. The part may be in any state; start again with a new machine.
    Failed(SequenceError),
}

/// What came of the last [`Action`].
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

/// Steps of the sequence. The number goes into fault records: never renumber.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Stage {
    /// RR=1.
    ResetAssert = 1,
    /// RR=0.
    ResetRelease = 2,
    /// PUD=1 and the wait after it.
    PowerUpDigital = 3,
    /// Waiting for PUR.
    PowerUpReady = 4,
    /// Revision check.
    RevisionCheck = 5,
    /// Voltage, gain and DRDY polarity.
    WriteCtrl1 = 6,
    /// Analog power; conversions stopped.
    PowerUpAnalog = 7,
    /// Wait for the analog supply.
    SupplySettle = 8,
    /// Channel and rate.
    WriteCtrl2 = 9,
    /// Bus options.
    WriteI2cCtrl = 10,
    /// Amplifier options.
    WritePga = 11,
    /// Amplifier capacitor.
    WritePower = 12,
    /// Chopper off.
    WriteAdc = 13,
    /// Read-back of PU_CTRL.
    VerifyPuCtrl = 14,
    /// Read-back of CTRL1.
    VerifyCtrl1 = 15,
    /// Read-back of CTRL2.
    VerifyCtrl2 = 16,
    /// Read-back of I2C_CTRL.
    VerifyI2cCtrl = 17,
    /// Read-back of PGA; also makes sure that the next read-back reads the ADC register.
    VerifyPga = 18,
    /// Read-back of POWER.
    VerifyPower = 19,
    /// Read-back of ADC.
    VerifyAdc = 20,
    /// CS=1: a calibration needs the converter running.
    CycleStart = 21,
    /// CALS=1.
    CalibrationStart = 22,
    /// Waiting for CALS=0, then checking CAL_ERR.
    CalibrationWait = 23,
    /// CS=0.
    CycleStop = 24,
    /// CS=1 again, so that the first result comes from a whole cycle after the calibration.
    CycleRestart = 25,
    /// Nothing left to do.
    Finished = 26,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 26] = [
        Self::ResetAssert,
        Self::ResetRelease,
        Self::PowerUpDigital,
        Self::PowerUpReady,
        Self::RevisionCheck,
        Self::WriteCtrl1,
        Self::PowerUpAnalog,
        Self::SupplySettle,
        Self::WriteCtrl2,
        Self::WriteI2cCtrl,
        Self::WritePga,
        Self::WritePower,
        Self::WriteAdc,
        Self::VerifyPuCtrl,
        Self::VerifyCtrl1,
        Self::VerifyCtrl2,
        Self::VerifyI2cCtrl,
        Self::VerifyPga,
        Self::VerifyPower,
        Self::VerifyAdc,
        Self::CycleStart,
        Self::CalibrationStart,
        Self::CalibrationWait,
        Self::CycleStop,
        Self::CycleRestart,
        Self::Finished,
    ];

    /// The stage of a fault record: the top byte of [`SequenceError::detail`].
    pub const fn from_number(number: u8) -> Option<Self> {
        if number >= 1 && number as usize <= Self::ALL.len() {
            Some(Self::ALL[number as usize - 1])
        } else {
            None
        }
    }

    /// What the stage does, for messages and documentation.
    pub const fn description(self) -> &'static str {
        match self {
            Self::ResetAssert => "assert the register reset",
            Self::ResetRelease => "release the register reset",
            Self::PowerUpDigital => "power up the digital part",
            Self::PowerUpReady => "wait for power-up ready",
            Self::RevisionCheck => "check the revision",
            Self::WriteCtrl1 => "set supply voltage, gain and DRDY polarity",
            Self::PowerUpAnalog => "power up the analog part",
            Self::SupplySettle => "let the analog supply settle",
            Self::WriteCtrl2 => "set channel and rate",
            Self::WriteI2cCtrl => "set the bus options",
            Self::WritePga => "set the amplifier options",
            Self::WritePower => "set the amplifier capacitor",
            Self::WriteAdc => "turn the modulator chopper off",
            Self::VerifyPuCtrl => "read the power control back",
            Self::VerifyCtrl1 => "read supply voltage, gain and DRDY polarity back",
            Self::VerifyCtrl2 => "read channel and rate back",
            Self::VerifyI2cCtrl => "read the bus options back",
            Self::VerifyPga => "read the amplifier options back",
            Self::VerifyPower => "read the amplifier capacitor back",
            Self::VerifyAdc => "read the modulator chopper back",
            Self::CycleStart => "start the converter",
            Self::CalibrationStart => "start the calibration",
            Self::CalibrationWait => "wait for the calibration and check it",
            Self::CycleStop => "stop the converter",
            Self::CycleRestart => "start a fresh conversion cycle",
            Self::Finished => "finished",
        }
    }
}

/// Why the sequence gave up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cause {
    /// The bus failed [`limits::BUS_RESTARTS`] + 1 times: part unplugged, mux channel wrong, bus held.
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
    /// CAL_ERR after [`limits::CALIBRATION_TRIES`] calibrations: input out of the mode's range.
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

    const fn found(self) -> u8 {
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
    /// For a fault record: stage, cause, register address and the byte found, from the top byte down.
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
const fn register_of(stage: Stage) -> Register {
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

/// What the last action was, to tell an answer from a mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pending {
    Start,
    Write,
    Read,
    Wait,
    RestartWait,
    Over(Action),
}

/// The sequence for one converter. See the [module](self) for the order and how to drive it.
#[derive(Clone, Debug)]
pub struct Bringup {
    config: Config,
    mode: CalibrationMode,
    first: Stage,
    stage: Stage,
    pending: Pending,
    polls: u16,
    calibrations: u16,
    restarts: u16,
}

impl Bringup {
    /// From power-on or any unknown state to a running, calibrated converter.
    pub const fn new(config: Config) -> Self {
        Self::starting_at(Stage::ResetAssert, config, config.calibration)
    }

    /// Changes the settings of a part that is up. Includes the calibration that every change of gain,
    /// rate, channel or supply asks for.
    pub const fn reconfigure(config: Config) -> Self {
        Self::starting_at(Stage::WriteCtrl1, config, config.calibration)
    }

    /// Calibrates a part that is up and set to `config`.
    pub const fn calibrate(config: Config, mode: CalibrationMode) -> Self {
        Self::starting_at(Stage::CycleStart, config, mode)
    }

    const fn starting_at(first: Stage, config: Config, mode: CalibrationMode) -> Self {
        Self {
            config,
            mode,
            first,
            stage: first,
            pending: Pending::Start,
            polls: 0,
            calibrations: 0,
            restarts: 0,
        }
    }

    /// The step under way, for progress displays.
    pub const fn stage(&self) -> Stage {
        self.stage
    }

    /// Whether the last action was [`Action::Done`] or [`Action::Failed`].
    pub const fn is_over(&self) -> bool {
        matches!(self.pending, Pending::Over(_))
    }

    /// Takes the outcome of the last action and returns the next one. After the end it keeps returning
    /// the final action, whatever the event.
    pub fn next(&mut self, event: Event) -> Action {
        let action = self.step(event);
        self.pending = match action {
            Action::Write(_) => Pending::Write,
            Action::WriteRead(_) => Pending::Read,
            Action::WaitUs(_) if self.pending == Pending::RestartWait => Pending::RestartWait,
            Action::WaitUs(_) => Pending::Wait,
            Action::Done | Action::Failed(_) => Pending::Over(action),
        };
        action
    }

    fn step(&mut self, event: Event) -> Action {
        match (self.pending, event) {
            (Pending::Over(last), _) => last,
            (Pending::Start, Event::Start) => self.enter(self.first),
            (Pending::Write | Pending::Read, Event::BusFault) => self.restart(),
            (Pending::RestartWait, Event::Waited) => {
                self.calibrations = 0;
                self.enter(self.first)
            }
            (Pending::Write, Event::Written) => self.after_write(),
            (Pending::Read, Event::Read(byte)) => self.after_read(byte),
            (Pending::Wait, Event::Waited) => self.after_wait(),
            _ => self.fail(Cause::UnexpectedEvent),
        }
    }

    fn fail(&self, cause: Cause) -> Action {
        Action::Failed(SequenceError {
            stage: self.stage,
            register: register_of(self.stage),
            cause,
        })
    }

    fn restart(&mut self) -> Action {
        if self.restarts >= limits::BUS_RESTARTS {
            return self.fail(Cause::Bus);
        }
        self.restarts += 1;
        self.pending = Pending::RestartWait;
        Action::WaitUs(limits::BUS_RESTART_WAIT_US)
    }

    /// First action of a stage.
    fn enter(&mut self, stage: Stage) -> Action {
        self.stage = stage;
        self.polls = 0;
        let config = &self.config;
        let value = match stage {
            Stage::ResetAssert => PuCtrl::from_bits(0).with_register_reset(true).bits(),
            Stage::ResetRelease => 0,
            Stage::PowerUpDigital => PuCtrl::from_bits(0).with_power_up_digital(true).bits(),
            Stage::WriteCtrl1 => config.ctrl1().bits(),
            Stage::PowerUpAnalog | Stage::CycleStop => config.pu_ctrl().bits(),
            Stage::CycleStart | Stage::CycleRestart => {
                config.pu_ctrl().with_cycle_start(true).bits()
            }
            Stage::WriteCtrl2 => config.ctrl2().bits(),
            Stage::WriteI2cCtrl => config.i2c_ctrl().bits(),
            Stage::WritePga => config.pga().bits(),
            Stage::WritePower => config.power().bits(),
            Stage::WriteAdc => config.adc().bits(),
            Stage::CalibrationStart => config.ctrl2_calibrate(self.mode).bits(),
            Stage::SupplySettle => return Action::WaitUs(config.supply_settle_us),
            Stage::CalibrationWait => return Action::WaitUs(limits::CALIBRATION_WAIT_US),
            Stage::PowerUpReady => return Action::WaitUs(limits::POWER_UP_WAIT_US),
            Stage::RevisionCheck
            | Stage::VerifyPuCtrl
            | Stage::VerifyCtrl1
            | Stage::VerifyCtrl2
            | Stage::VerifyI2cCtrl
            | Stage::VerifyPga
            | Stage::VerifyPower
            | Stage::VerifyAdc => return self.read(),
            Stage::Finished => return Action::Done,
        };
        Action::Write(proto::write_register(register_of(stage), value))
    }

    fn read(&self) -> Action {
        Action::WriteRead([register_of(self.stage).address()])
    }

    fn after_write(&mut self) -> Action {
        let next = match self.stage {
            Stage::ResetAssert => Stage::ResetRelease,
            Stage::ResetRelease => Stage::PowerUpDigital,
            Stage::PowerUpDigital => Stage::PowerUpReady,
            Stage::WriteCtrl1 => Stage::PowerUpAnalog,
            Stage::PowerUpAnalog => Stage::SupplySettle,
            Stage::WriteCtrl2 => Stage::WriteI2cCtrl,
            Stage::WriteI2cCtrl => Stage::WritePga,
            Stage::WritePga => Stage::WritePower,
            Stage::WritePower => Stage::WriteAdc,
            Stage::WriteAdc => Stage::VerifyPuCtrl,
            Stage::CycleStart => Stage::CalibrationStart,
            Stage::CalibrationStart => Stage::CalibrationWait,
            Stage::CycleStop => Stage::CycleRestart,
            Stage::CycleRestart => Stage::Finished,
            _ => return self.fail(Cause::UnexpectedEvent),
        };
        self.enter(next)
    }

    fn after_wait(&mut self) -> Action {
        match self.stage {
            Stage::SupplySettle => self.enter(Stage::WriteCtrl2),
            Stage::PowerUpReady | Stage::RevisionCheck | Stage::CalibrationWait => self.read(),
            _ => self.fail(Cause::UnexpectedEvent),
        }
    }

    /// Waits for the next look, or gives up after `limit` looks.
    fn poll_again(&mut self, limit: u16, wait_us: u32, cause: Cause) -> Action {
        self.polls += 1;
        if self.polls >= limit {
            self.fail(cause)
        } else {
            Action::WaitUs(wait_us)
        }
    }

    fn after_read(&mut self, byte: u8) -> Action {
        let config = &self.config;
        match self.stage {
            Stage::PowerUpReady => {
                if PuCtrl::from_bits(byte).power_up_ready() {
                    self.enter(Stage::RevisionCheck)
                } else {
                    self.poll_again(
                        limits::POWER_UP_POLLS,
                        limits::POWER_UP_POLL_US,
                        Cause::PowerUpTimeout,
                    )
                }
            }
            Stage::RevisionCheck => {
                let revision = Revision::from_bits(byte);
                if revision.is_expected() {
                    self.enter(Stage::WriteCtrl1)
                } else {
                    self.poll_again(
                        limits::REVISION_TRIES,
                        limits::REVISION_POLL_US,
                        Cause::Revision(revision.bits()),
                    )
                }
            }
            Stage::CalibrationWait => self.after_calibration_read(Ctrl2::from_bits(byte)),
            Stage::VerifyPuCtrl => self.verify(
                byte,
                config.pu_ctrl().bits(),
                Config::PU_CTRL_MASK,
                Stage::VerifyCtrl1,
            ),
            Stage::VerifyCtrl1 => {
                self.verify(byte, config.ctrl1().bits(), 0xFF, Stage::VerifyCtrl2)
            }
            // The low nibble is calibration command and status, not a setting.
            Stage::VerifyCtrl2 => {
                self.verify(byte, config.ctrl2().bits(), 0xF0, Stage::VerifyI2cCtrl)
            }
            Stage::VerifyI2cCtrl => {
                self.verify(byte, config.i2c_ctrl().bits(), 0xFF, Stage::VerifyPga)
            }
            // Bits 2:1 are reserved.
            Stage::VerifyPga => self.verify(byte, config.pga().bits(), 0xF9, Stage::VerifyPower),
            Stage::VerifyPower => self.verify(byte, config.power().bits(), 0xFF, Stage::VerifyAdc),
            // Bits 7:6: whether the fast-read enable reads back is not documented.
            Stage::VerifyAdc => self.verify(byte, config.adc().bits(), 0x3F, Stage::CycleStart),
            _ => self.fail(Cause::UnexpectedEvent),
        }
    }

    fn verify(&mut self, found: u8, expected: u8, mask: u8, next: Stage) -> Action {
        if (found & mask) == (expected & mask) {
            self.enter(next)
        } else {
            self.fail(Cause::ReadBack { expected, found })
        }
    }

    fn after_calibration_read(&mut self, ctrl2: Ctrl2) -> Action {
        if ctrl2.calibrating() {
            return self.poll_again(
                limits::CALIBRATION_POLLS,
                limits::CALIBRATION_POLL_US,
                Cause::CalibrationTimeout,
            );
        }
        if !ctrl2.calibration_error() {
            return self.enter(Stage::CycleStop);
        }
        self.calibrations += 1;
        if self.calibrations >= limits::CALIBRATION_TRIES {
            self.fail(Cause::CalibrationError)
        } else {
            self.enter(Stage::CalibrationStart)
        }
    }
}
