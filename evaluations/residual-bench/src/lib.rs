//! Tests the residual analysis on synthetic logs whose truth is known.
//!
//! The crate `synthetic_sets` generates logs of a force rig with effects that the declared model
//! does not have. It returns the truth separately. The crate `residual` gets the logs and the
//! declared model, nothing else. This crate compares verdict, first effect, parameters and
//! remaining error with the truth.
//!
//! * [`arm`]: joints of an arm, with a table of their own;
//! * [`case`]: which sets are made;
//! * [`evaluate`]: one set through the analysis, and its outcome;
//! * [`judge`]: what counts as right: names that mean the same physics, and parameters;
//! * [`literature`]: the same for the second generator, `literature_sets`, with a binary of its
//!   own;
//! * [`real`]: public measured data sets, with a binary of their own;
//! * [`table`]: confusion table, rates beside their targets, closing summary.

pub mod arm;
pub mod case;
pub mod evaluate;
pub mod judge;
pub mod literature;
pub mod real;
pub mod table;
