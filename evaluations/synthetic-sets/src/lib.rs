//! Synthetic logs of a force rig with an effect in them that the model does not declare.
//!
//! This crate is the exam of the residual analysis. It shares no code and no constants with the analysis
//! or with the plant: it writes columns of numbers, and keeps apart what it did to them ([`Truth`]).
//!
//! The declared model of every set is the rig's own: *force = commanded force*. The generator moves a
//! reel, commands a force (open loop, or through a PI controller that fights the effect), adds at most two
//! effects of a wanted size, then noise, and samples the lot at a logger's rate.
//!
//! * [`excitation`]: how the reel moves, what is commanded, what the surroundings do;
//! * [`effect`]: the undeclared effects, each a small piece of physics with named parameters;
//! * [`set`]: puts a set together and scales the effect to a wanted size.
#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod effect;
pub mod excitation;
pub mod set;

pub use effect::Kind;
pub use set::{generate, Log, Recipe, Set, Truth};
