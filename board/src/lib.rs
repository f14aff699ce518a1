//! The parts of the firmware, for its binary and for the tests on the board itself.
//!
//! Everything but `hw` is pure: it runs and is tested on any host (`cargo test -p board`).
//!
//! The hardware half (PAC, interrupts, `unsafe`) is in `hw` and exists on the target only.
#![cfg_attr(target_os = "none", no_std)]

/// The atomic types of `shared`; its test has others.
mod atomics {
    pub use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
}

pub mod bus;
pub mod clocks;
#[cfg(target_os = "none")]
#[allow(unsafe_code)] // registers, interrupts, memory that outlives a reset
pub mod hw;
pub mod machine;
pub mod pins;
pub mod register_table;
pub mod shared;
pub mod telemetry;

/// The part's name for probe-rs.
pub const CHIP: &str = "STM32H753ZITx";
