//! The rig without the emulated controller: the firmware's pure half on the host, with the board's
//! chips and the plant.
//!
//! ```text
//! host program ─ bytes of the wire ─▶ CoreRig: board::machine, board::bus, control ◀▶ emulator::board (chips) ─▶ plant
//! ```
//!
//! What runs is the code of the image, compiled for the host: the bus scheduler with the
//! converters' bring-up, the command-level machine with its state machines, supervisor and faults,
//! the control core, the telemetry batches and the frames. The chips, their clocks and noise, the
//! PLC and the plant are those of the embedded rig, from the same seed. A host program sees the
//! same bytes on the serial line; `forcectl` reaches it with `--link fast`.
//!
//! # What is left out, and what stands in its place
//!
//! | in the embedded rig | here |
//! | --- | --- |
//! | instructions of the core, interrupts | fixed delays: [`timing`] |
//! | registers, SPI and counter bus bit by bit | whole operations on the same chip models (`emulator::board`) |
//! | I2C byte by byte | the transaction at its end, with the duration of its bits at 400 kHz |
//! | USB | commands of one caller, without its bytes; the injections that need its plug are refused |
//! | watchdog, crash record | a reset 50 ms after the superloop hangs; the record's code |
//! | RTT log | none |
//!
//! Faults of the superloop's timing can't occur here, but for those of [`Defects`], which has what
//! is broken in the controller itself. How far the results are from the image's is tested by
//! `tests/scenarios/tests/fast_mode.rs`.

#![forbid(unsafe_code)]

mod defects;
mod line;
mod rig;
mod sensors;
mod superloop;
pub mod timing;

pub use defects::{Bits, Defects};
pub use rig::{CoreRig, Options, RigError};
