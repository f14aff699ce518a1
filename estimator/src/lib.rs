//! Sensorless estimation of the contact force: from joint positions, velocities and efforts of a
//! cable-driven robot to the force on its tool.
//!
//! [`sequence`] holds what every model reads, [`model`] what every model does, [`network`] the neural ones.

pub mod model;
pub mod network;
pub mod sequence;
