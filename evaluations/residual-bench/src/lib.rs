//! Sits the residual analysis its exam.
//!
//! The crate `undeclared` makes logs of a force rig with effects that the declared model does not have,
//! and keeps the truth apart. The crate `residual` gets the logs and the declared model, nothing else.
//! Here the two meet: verdict, first effect, parameters and remaining error are compared with the truth.
//!
//! * [`case`]: which sets are made;
//! * [`exam`]: one set through the analysis, and its outcome;
//! * [`judge`]: what counts as right: names that mean the same physics, and parameters;
//! * [`table`]: confusion table, rates beside their targets, closing summary.
#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod case;
pub mod exam;
pub mod judge;
pub mod table;
