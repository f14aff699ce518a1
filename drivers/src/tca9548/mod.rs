//! TCA9548A: eight-channel I2C multiplexer (TI datasheet SCPS207).
//!
//! One control byte, bit n = channel n; any set of channels may be on at once. The part switches
//! only after the STOP of the write, so the mask and the traffic behind it are two transactions.
//!
//! * [`Selector`]: which mask is in force, without a bus. It skips a write that would change
//!   nothing and trusts nothing after a failure.
//! * [`Tca9548`]: blocking driver over the same, with the reset line.
//! * [`recovery`]: frees a blocked bus, step by step.

mod driver;
pub mod recovery;
mod selector;

pub use driver::{Error, NoResetLine, Operation, Tca9548, RESET_PULSE_NS, RESET_RECOVERY_NS};
pub use selector::{Address, ChannelMask, MuxState, ReadBackError, Selector};
