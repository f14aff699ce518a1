//! Least squares on held-out groups, and diagnostics of the residual that they leave, whatever
//! effects are in the model.

pub mod diagnostics;
pub mod problem;
