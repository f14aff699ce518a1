//! Sensorless estimation of the contact force: from joint positions, velocities and efforts of a
//! cable-driven robot to the force on its tool.
//!
//! [`data`] turns logs into sequences, [`sequence`] is what every model reads, [`model`] what every
//! model does, `network` the neural ones. [`estimator`] is a model with all that belongs to it,
//! [`mod@stream`] runs it row by row, [`metrics`] is how good it is, [`interval`] how sure.

pub mod baseline;
pub mod data;
pub mod estimator;
pub mod geometry;
pub mod interval;
pub mod kind;
pub mod mapping;
pub mod metrics;
pub mod misfit;
pub mod model;
pub mod motion;
#[cfg(feature = "networks")]
pub mod network;
#[cfg(feature = "networks")]
pub mod neural;
pub mod physics;
pub mod pieces;
pub mod recalibration;
pub mod refusal;
pub mod ridge;
pub mod sequence;
pub mod stream;
pub mod trees;
pub mod wander;
