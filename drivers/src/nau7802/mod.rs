//! NAU7802: 24-bit bridge converter, one per load cell (Nuvoton datasheet rev. 1.7, January 2012).
//!
//! * [`Register`] and the byte types: the register map.
//! * [`Config`]: settings and the register values they become.
//! * [`proto`]: bytes of each transaction. [`proto::READ_ADC`] and [`proto::decode_adc`] are the
//!   whole sample path.
//! * [`Bringup`]: power-up, configuration, verification and calibration as a state machine.
//! * [`Settling`]: which results to discard after a start.
//! * [`Nau7802`]: blocking driver over the same.
//! * [`fast_read`]: what FRD is, and why it is off.
//!
//! # Traps that this driver avoids
//! The conversion-ready bit is not a substitute for the DRDY pin; CALS is waited for and CAL_ERR
//! checked after each calibration; CS is set, or nothing converts; results are sign-extended from
//! 24 bits; the revision is read only once PUR is up, and then retried a bounded number of times;
//! six results are discarded after a start, whether or not the part announces them.
//!
//! # Timing
//! DRDY announces a result that is already 6.25 ms old at 320 samples a second (group delay of the
//! converter's filter, inferred to be a sinc4). No latency counted from DRDY contains it.

//!
//! # Without blocking
//! A sample, and one turn of a bring-up, as an interrupt handler or a superloop sees them:
//! ```
//! use drivers::nau7802::{proto, Action, AdcCode, Bringup, Config, Event};
//!
//! // After the DRDY edge: send `READ_ADC`, read three bytes, decode.
//! assert_eq!(proto::READ_ADC, [0x12]);
//! assert_eq!(proto::decode_adc([0xFF, 0xFF, 0xFE]), AdcCode::new(-2).unwrap());
//!
//! // Superloop: start the action, come back when it has completed.
//! let mut bring_up = Bringup::new(Config::FORCE_UNIT);
//! assert_eq!(bring_up.next(Event::Start), Action::Write([0x00, 0x01]));
//! assert_eq!(bring_up.next(Event::Written), Action::Write([0x00, 0x00]));
//! ```

pub mod bringup;
mod code;
mod config;
mod driver;
pub mod fast_read;
pub mod proto;
mod regs;
mod settling;

pub use bringup::{Action, Bringup, Cause, Event, SequenceError, Stage};
pub use code::{AdcCode, Coefficients, GainCoefficient, OffsetCoefficient};
pub use config::Config;
pub use driver::{Error, Nau7802, Operation};
pub use regs::{
    Adc, CalibrationMode, Channel, Ctrl1, Ctrl2, DrdyPolarity, Gain, I2cCtrl, LdoVoltage, Pga,
    Power, PuCtrl, Rate, Register, Revision, ADDRESS,
};
pub use settling::Settling;
