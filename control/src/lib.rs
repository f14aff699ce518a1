//! The control core of the force rig: what happens between a load cell's code and a DAC's code, and
//! when it is allowed to happen.
//!
//! No peripherals, no global state, no allocation, no panics. The same objects run on the board, in
//! the emulated rig and in unit tests.
//!
//! | question | module |
//! | --- | --- |
//! | what do the numbers mean | [`units`], [`convert`] |
//! | from a load cell's code to its force | [`cell`] |
//! | what can be configured, within which ranges | [`config`] |
//! | one sample of one unit | [`mod@unit`], made of [`filter`], [`friction`], [`pid`], [`limits`] |
//! | zeroing | [`zero`] |
//! | when may a motor pull | [`state`], [`motor`], [`system`], [`supervisor`] |
//! | can the load cell and the motor be believed | [`plausible`] |
//! | has 0 V an effect | [`let_go`] |
//! | how hard do the cables pull at the tip | [`tip`] |
//! | what went wrong and how to clear it | [`faults`] |
//! | where do the cables point (not in the sample path) | [`geometry`] |
//!
//! # Error of the fixed-point arithmetic
//!
//! At most 1 mN from load code to command (the force before it is rounded to a DAC code, which adds
//! up to half a code, 1.77 mN). `tests/reference.rs` compares every sample with an independent
//! `f64` version of the whole step, written from these pages, over configurations anywhere in their
//! ranges and runs of up to 100,000 samples, integrators included; found: 0.26 mN at worst in 32
//! million samples. `cargo run -p control --example fixed_point_error` prints the figure.
//!
//! # Cost
//!
//! 32-bit by 32-bit and a few 64-bit multiplications, no division, no float and no panic in
//! [`Controller::step`]: built for the Cortex-M7 it is 1,500 instructions long with all its
//! branches, of which a sample takes a part.
//!
//! # Signs
//!
//! Tension, force and command are positive where the motor pulls the cable in. Encoder travel is
//! positive where the reel winds in. Direction +1 is winding in, -1 paying out.
#![no_std]
#![warn(
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic
)]

pub mod cell;
pub mod config;
pub mod convert;
pub mod faults;
pub mod filter;
pub mod friction;
pub mod geometry;
pub mod let_go;
pub mod limits;
pub mod motor;
pub mod pid;
pub mod plausible;
pub mod preview;
pub mod state;
pub mod supervisor;
pub mod system;
pub mod tip;
pub mod unit;
pub mod units;
pub mod zero;

pub use config::Config;
pub use faults::Fault;
pub use state::{MotorState, SystemState};
pub use unit::{Controller, Input, Output, State};
pub use units::{AdcCode, DacCode, EncoderCounts, InvCos, Micros, Newton};
pub use wire::{UnitIndex, UnitSet, UNITS};

/// Nominal sample rate of a NAU7802 at CRS = 7, in samples a second (datasheet 11.3). The RC
/// oscillator makes it 310 to 330.
pub const NOMINAL_SPS: u32 = 320;

/// Nominal time between two samples of a unit in microseconds.
pub const NOMINAL_PERIOD_US: u32 = 1_000_000 / NOMINAL_SPS;
