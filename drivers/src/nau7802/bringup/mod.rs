//! Bring-up of a NAU7802 as a state machine without a bus, for a superloop and for blocking code
//! alike.
//!
//! ```text
//! RR=1, RR=0, PUD=1, 200 us, wait PUR                  datasheet section 9.1 (power-on sequence)
//!   -> CTRL1, CTRL2, I2C_CTRL, PGA, POWER, ADC (0x30)  all settings before the analog part
//!   -> PU_CTRL (0xAE), CS=1, supply settles            it starts at them, and converts meanwhile
//!   -> revision, and read every setting back
//!   -> calibrate, wait CALS=0, check CAL_ERR            section 8.6
//!   -> CS=0, CS=1                                      fresh conversion cycle
//!   -> the owner discards six results                  section 8.4, see `Settling`
//! ```
//!
//! The owner performs each [`Action`] and reports the outcome as an [`Event`]. Nothing in between
//! is hidden: the waits are actions too, so six converters calibrate at the same time on one bus,
//! each with its own machine. The converter runs before and during its calibration, so DRDY edges
//! come before [`Action::Done`]: ignore them until then.
//!
//! The order and the wait for the supply are those that published drivers need on silicon: they set
//! the rate before PUA or wait 600 ms after it, read the revision after PUA, and read ten results
//! away before they calibrate ([`Config::supply_wait_us`]).
//!
//! Each wait and each retry is bounded ([`limits`]). A failed bus transaction leaves the part's
//! state unknown, so the sequence restarts from its beginning, a bounded number of times.

mod types;

pub use types::{Action, Cause, Event, SequenceError, Stage};

use super::config::Config;
use super::proto;
use super::regs::{CalibrationMode, Ctrl2, PuCtrl, Revision};
use types::register_of;

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
    /// From CALS=1 to the first look at it. A calibration takes about 344 ms; earlier looks would
    /// only load the bus that the other converters share.
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

/// The last action, to distinguish a matching event from a wrong one.
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

    /// Changes the settings of a part that is up. Includes the calibration that every change of
    /// gain, rate, channel or supply requires.
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

    /// Takes the outcome of the last action and returns the next one. After the end it keeps
    /// returning the final action, whatever the event.
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
            Stage::SupplySettle => return Action::WaitUs(config.supply_wait_us()),
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
            Stage::WriteCtrl1 => Stage::WriteCtrl2,
            Stage::WriteCtrl2 => Stage::WriteI2cCtrl,
            Stage::WriteI2cCtrl => Stage::WritePga,
            Stage::WritePga => Stage::WritePower,
            Stage::WritePower => Stage::WriteAdc,
            Stage::WriteAdc => Stage::PowerUpAnalog,
            Stage::PowerUpAnalog => Stage::CycleStart,
            Stage::CycleStart => Stage::SupplySettle,
            Stage::CalibrationStart => Stage::CalibrationWait,
            Stage::CycleStop => Stage::CycleRestart,
            Stage::CycleRestart => Stage::Finished,
            _ => return self.fail(Cause::UnexpectedEvent),
        };
        self.enter(next)
    }

    fn after_wait(&mut self) -> Action {
        match self.stage {
            Stage::SupplySettle => self.enter(Stage::RevisionCheck),
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
                    self.enter(Stage::WriteCtrl1)
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
                    self.enter(Stage::VerifyPuCtrl)
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
            Stage::VerifyAdc => {
                self.verify(byte, config.adc().bits(), 0x3F, Stage::CalibrationStart)
            }
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
