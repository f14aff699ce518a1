//! Estimators of the contact force from files to figures: load data, evaluate, model card, report
//! with pictures.
//!
//! The models are those of the package `estimator`; `forcectl estimate` is the command line of this
//! module.

pub mod card;
pub mod evaluate;
pub mod explain;
pub mod load;
pub mod pace;
pub mod pictures;
mod plausible;
pub mod report;
pub mod study;

pub use card::ModelCard;
pub use evaluate::Evaluation;
pub use load::{Data, LoadError};
