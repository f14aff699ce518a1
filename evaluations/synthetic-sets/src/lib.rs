//! Synthetic logs of a force rig with an effect in them that the model does not declare.
//!
//! This crate is test data for the residual analysis. It shares no code and no constants with the
//! analysis or with the plant. It returns columns of numbers and, separately, the truth about them
//! ([`Truth`]).
//!
//! The declared model of every set is the rig's own: *force = commanded force*. The generator moves
//! a reel and commands a force, open loop or through a PI controller. It adds at most three effects
//! of a given size, then noise, and samples the result at a logger's rate.
//!
//! * [`excitation`]: how the reel moves, what is commanded, what the surroundings do;
//! * [`effect`]: the undeclared effects, each a small piece of physics with named parameters;
//! * [`arm`]: sets of another machine, a joint of an arm;
//! * [`set`]: puts a set together and scales the effect to a given size.

pub mod arm;
pub mod effect;
pub mod excitation;
pub mod set;

pub use effect::Kind;
pub use set::{generate, Circumstance, Log, Recipe, Set, Truth};
