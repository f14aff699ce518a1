//! From a Cartesian force to six tensions: pose, controller, allocation, feasibility, and how well
//! the force was held.

pub mod allocation;
pub mod controller;
pub mod feasibility;
pub mod metrics;
pub mod pose;
pub mod preview;
pub mod thinned;
