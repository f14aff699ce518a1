//! Calibration of the force rig: from weights, a digitizer and a moving tip to gains, zeros, exit
//! points and load-cell axes, each with its covariance.
//!
//! The crate is pure: it reads text and numbers and returns values. It opens no file and no device.
//!
//! | module | question it answers | source |
//! | --- | --- | --- |
//! | [`zero`] | what does a load cell read with a slack cable, and is the cable slack | thesis 3.5.1 |
//! | [`gain`] | how many newtons is one converter count | thesis 3.5.1 |
//! | [`gravity`] | how heavy is a weight where the rig stands | |
//! | [`geometry`] | where are the exit points and how are the cells mounted, from a digitizer | thesis 3.5.2 |
//! | [`self_calibration`] | the same from a moving tip, and has the rig moved since | |
//! | [`workspace`] | which forces are feasible at a pose; where should the units stand | thesis 3.7, 5.2 |
//! | [`uncertainty`] | how well is the force at the tip known | thesis 3.7 |
//! | [`record`] | one file that keeps all of it | |
//!
//! # Conventions
//!
//! SI units in the robot's base frame: metre, newton, radian, kilogram, second. A field or argument
//! names its unit (`_m`, `_n`, `_rad`, `_codes`). A *code* is one count of the NAU7802 at the gain
//! in use, a signed 24-bit number. An axis is a unit vector from the force unit to the workspace:
//! with `d` the direction from the tip to the exit point, a cell reads `T cos(theta)`,
//! `cos(theta) = -axis . d`.
//!
//! Bad input is an error that names file and line; no function panics on it.

// Test helpers are shared with the integration tests, which know this crate by its name.
#[cfg(test)]
extern crate self as calibration;

pub mod gain;
pub mod geometry;
pub mod gravity;
pub mod input;
pub mod kabsch;
pub mod record;
pub mod se3;
pub mod self_calibration;
pub mod stats;
pub mod uncertainty;
pub mod workspace;
pub mod zero;

pub use gravity::STANDARD_M_PER_S2 as STANDARD_GRAVITY_M_PER_S2;
