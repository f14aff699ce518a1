//! Sensorless estimation of the contact force: from joint positions, velocities and efforts of a
//! cable-driven robot to the force on its tool.
//!
//! [`sequence`] holds what every model reads, [`model`] what every model does.

pub mod model;
pub mod sequence;
