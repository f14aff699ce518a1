//! LS7266R1: dual 24-bit quadrature counter, one axis per motor encoder (LSI/CSI datasheet 7266R1).
//!
//! The part sits on an 8-bit parallel bus with C/D#, X/Y#, CS#, RD# and WR#. A control write
//! carries the register in bits 6:5 and "both axes" in bit 7. CNTR is never on the bus itself: it
//! is set through PR and read through OL, a byte at a time, low byte first, under a byte pointer
//! that has to be reset.
//!
//! * [`Rld`], [`Cmr`], [`Ior`], [`Idr`], [`Flags`]: the register map.
//! * [`proto`]: bus operations of each procedure, without a bus.
//! * [`CounterValue`], [`PositionTracker`]: the count and its extension to 64 bits.
//! * [`ParallelBus`], [`Target`]: the interface to the hardware; [`GpioBus`] implements it on
//!   embedded-hal pins.
//! * [`Ls7266r1`]: blocking driver.

mod bus;
mod count;
mod driver;
pub mod proto;
mod regs;

pub use bus::{DataPort, GpioBus, GpioBusError, OpenDrainPort, ParallelBus, Port, Target};
pub use count::{CounterValue, Direction, PositionTracker};
pub use driver::{Config, Error, Ls7266r1, Stage};
pub use regs::{Axis, Cmr, Flags, Idr, Ior, QuadratureMode, Rld};
