//! Finds what a force model lacks, from measured data.
//!
//! Given logs and a declared model (linear in its parameters, `MODEL.toml`), the analysis fits the
//! model, looks at its residual on groups that were held out, and searches a catalogue of physical
//! effects for what is missing. It names the effect with its parameters, says which rivals it beat
//! and by how much, lists what is there but does not matter, and admits when nothing is missing,
//! when the data cannot tell, and when the catalogue has no name for what is left.
//!
//! [`run`] does everything; [`load::load`] and [`analyse`] are its two halves.

#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod analysis;
mod compensation;
mod effects;
mod error;
/// The expression language of model files.
pub mod expr;
mod frame;
mod hygiene;
mod linalg;
/// Reading logs.
pub mod load;
mod model;
mod problem;
mod progress;
mod report;
/// The measured data of the thesis rig: where they are, and their two layouts.
pub mod rig;
mod search;
/// The model file.
pub mod spec;
mod stats;
mod svg;

pub use analysis::{analyse, baseline, run, Baseline, Options};
pub use compensation::{Compensation, Ripple};
pub use effects::{experiment, meaning, names, EffectKind, Form, Param};
pub use error::Error;
pub use frame::Frame;
pub use hygiene::Finding;
pub use progress::{Console, Progress, Ticker};
pub use report::{
    clear, num, Ambiguity, Effect, Figures, NotMaterial, Plot, Report, Rival, Structure, Tested,
    Verdict,
};
pub use stats::ResidualTest;
