//! Synthetic logs of a force rig that lack known effects, for tests of the residual analysis.
//!
//! This package depends on nothing of this project. The effects, their equations and their
//! parameter ranges come from the literature, not from the analysis under test.
//!
//! The rig: a motor pulls a cable over a reel (radius 10 mm). A load cell measures the tension of
//! the cable, 0 N to 15 N. The motion of the cable end is imposed from outside; the motor follows a
//! commanded cable force. A positive velocity winds the cable in, so friction of the drive lowers
//! the measured tension while the velocity is positive.
//!
//! A [`set::Set`] is a group of runs whose declared model lacks zero to three effects. Each effect
//! is scaled until the part of it that the declared model can't absorb has a chosen multiple of the
//! RMS of the sensor noise.

pub mod compare;
pub mod declared;
pub mod effects;
pub mod excitation;
pub mod fit;
pub mod log;
pub mod noise;
pub mod parameters;
pub mod random;
pub mod request;
mod rig;
mod sampling;
pub mod set;
mod truth;
pub mod world;
pub mod write;

/// Radius of the reel in m.
pub const REEL_RADIUS_M: f64 = 0.010;

/// Upper end of the range of the load cell in N.
pub const FULL_SCALE_N: f64 = 15.0;

/// Simulation steps for each row of a log, at a row rate in Hz: at least 10, and at least 2000 in a
/// second, so that mains tones and the ripple of fast gears are resolved at slow row rates too.
pub fn steps_per_row(rate_hz: f64) -> usize {
    ((2000.0 / rate_hz).ceil() as usize).max(10)
}
