//! The embedded rig: the unmodified firmware image on an emulated STM32H753, with models of every
//! chip on the motor control board and the plant behind them, in virtual time.
//!
//! ```text
//! host program ─ emulator-link ─▶ Rig ─▶ engine (core, controller's peripherals) ◀▶ Board (chips, wires) ─▶ plant
//! ```
//!
//! * [`Rig`] boots an image and steps it; the binary `rig` puts it behind a pipe.
//! * [`engine`] is the interface to the CPU engine, [`board`] everything outside the controller's
//!   package, [`devices`] the chips, [`probe`] the latency measurement, [`allowed`] the list of
//!   register accesses that may go unanswered, each with its reason.
//!
//! Without the feature `engine` only the board, the chips and the probe are here.
//!
//! Everything random comes from the seed; the same image, seed and bytes give the same run, bit for
//! bit.
//!
//! # What a time means here
//!
//! Conversions, bus transfers and serial lines take the time they take on the part. Instructions
//! take 4 ns each, with no wait states and no caches: latencies carry that caveat.

#[cfg(feature = "engine")]
pub mod allowed;
pub mod board;
pub mod devices;
#[cfg(feature = "engine")]
pub mod engine;
#[cfg(feature = "engine")]
pub mod image;
pub mod probe;
#[cfg(feature = "engine")]
mod rig;
pub mod rng;
#[cfg(feature = "engine")]
mod rtt;
pub mod wiring;

#[cfg(feature = "engine")]
pub use rig::{Options, Rig, RigError};
