//! Torque at the jaw of da Vinci instruments, estimated from motor current and positions on public
//! measured data.
//!
//! The data are of MRDLab/mis-tool-characterization (ODbL). They are no part of this project: a
//! clone is named by an option. A drive turns the spindle of an instrument along a sine; a second
//! motor loads the jaw with a torque that is constant in a run.
//!
//! * [`data`] reads the files, [`filter`] and [`protocol`] are what the publication does before it
//!   scores;
//! * [`features`] is the physics: what a model may know of the last 250 ms and of the last
//!   reversal;
//! * [`sums`] and [`model`] fit a linear model on them, [`split`] and [`score`] keep runs apart and
//!   measure;
//! * [`adapt`] corrects the model of one tool for another with two files;
//! * [`reference`](mod@reference) holds the models to compare with;
//! * [`page`] and [`picture`] print the results.

pub mod adapt;
pub mod data;
pub mod features;
pub mod filter;
pub mod model;
pub mod page;
pub mod picture;
pub mod protocol;
pub mod reference;
pub mod results;
pub mod score;
pub mod split;
pub mod sums;
