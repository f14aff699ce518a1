//! From a Cartesian force to six tensions: pose, controller, allocation, and how well the force was held.

pub mod allocation;
pub mod controller;
pub mod metrics;
pub mod pose;
