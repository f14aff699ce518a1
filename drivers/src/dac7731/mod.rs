//! DAC7731: 16-bit bipolar output converter, one per motor (TI datasheet SBAS249B).
//!
//! # Framing
//! 16 bits, most significant first, taken on the *rising* SCLK edge. CS must rise while SCLK is
//! high: a rising CS with SCLK low shifts one more bit in and corrupts the word. SPI mode 3 idles
//! high and captures on the rising edge, so it satisfies both ([`SPI_MODE`]). A rising LDAC then
//! moves the word to the output; it is asynchronous to the rest.
//!
//! # Zero is not zero
//! The code is straight binary: 0x0000 is **negative full scale**, -10 V in the bipolar range,
//! which is full torque on the motor. 0 V is 0x8000. [`DacCode`] therefore has no conversion from
//! zero that one could reach by accident: its default is [`DacCode::MIDSCALE`].
//!
//! * [`DacCode`], [`Range`]: codes and the datasheet's scale; [`DacCode::to_frame`] is the whole
//!   wire format.
//! * [`Dac7731`]: blocking driver.

mod code;
mod driver;

pub use code::{DacCode, Range};
pub use driver::{Dac7731, Error, NoLine, Operation, LDAC_PULSE_NS, RESET_PULSE_NS};

/// The SPI mode that the part needs: SCLK idles high, data captured on the rising edge.
pub const SPI_MODE: embedded_hal::spi::Mode = embedded_hal::spi::MODE_3;

/// Highest SCLK frequency in hertz. Not confirmed in a datasheet page we could read: stay well
/// below.
pub const MAX_SCLK_HZ: u32 = 20_000_000;

/// Settling time of a full-scale step to 0.003 %, nanoseconds (datasheet, features).
pub const SETTLING_NS: u32 = 5_000;
