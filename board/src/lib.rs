//! The pure half of the firmware: everything that can run and be tested on any host.
//!
//! The hardware half (PAC, interrupts, `unsafe`) is in `hw` and exists on the target only.
#![cfg_attr(target_os = "none", no_std)]
#![deny(missing_docs)]

pub mod bus;
pub mod clocks;
pub mod machine;
pub mod pins;
pub mod telemetry;

/// The part's name for probe-rs.
pub const CHIP: &str = "STM32H753ZITx";
