//! Finds what a force model lacks, from measured data.
//!
//! Given logs and a declared model (linear in its parameters, `MODEL.toml`), the analysis fits the
//! model, looks at its residual on groups that were held out, and searches a catalogue of physical
//! effects for what is missing. It names the effect with its parameters, says which rivals it beat
//! and by how much, lists what is there but does not matter, and admits when nothing is missing,
//! when the data cannot tell, and when the catalogue has no name for what is left.
//!
//! [`run`] does everything; [`load::load`] and [`analyse`] are its two halves.

mod analysis;
mod assembly;
mod compensation;
mod data;
mod declared;
mod diagnostics;
mod effects;
mod error;
/// The expression language of model files.
pub mod expr;
mod extended;
mod feedback;
mod figures;
mod frame;
mod hygiene;
mod intervals;
mod leftover;
mod linalg;
/// Reading logs.
pub mod load;
mod model;
mod nested;
mod problem;
mod progress;
mod ranking;
mod report;
/// The measured data of the thesis rig: where they are, and their two layouts.
pub mod rig;
mod scan;
mod search;
/// The model file.
pub mod spec;
mod stats;
mod svg;
mod verdict;

pub use analysis::{analyse, run, Options};
pub use compensation::{Compensation, Ripple};
pub use data::{Data, DataBuilder};
pub use declared::{baseline, Baseline};
pub use effects::{experiment, meaning, names, EffectKind, Form, Param};
pub use error::Error;
pub use frame::Frame;
pub use hygiene::Finding;
pub use nested::{nested, Nested, NestedFold};
pub use progress::{Console, Progress, Ticker};
pub use report::{
    clear, num, Ambiguity, Effect, Figures, NotMaterial, Plot, Report, Rival, Structure, Tested,
    Verdict,
};
pub use stats::ResidualTest;
