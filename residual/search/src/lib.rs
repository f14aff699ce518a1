//! The search: which effects of the catalogue, together, explain what the declared model lacks.
//!
//! Each step scans the whole catalogue on the current residual. A candidate counts if its held-out
//! gain is material, stands out from the gains that decoys of the residual reach with the same
//! terms, and is steady over blocks. Among those that explain nearly the same, the one with fewer
//! parameters is taken first; a richer one that still adds something is taken in a later step and
//! then replaces what it makes superfluous. So an effect that only imitates another
//! one (a line in position for a hysteresis) can be added, but is removed later.
//!
//! `run` is the course of a search. Its steps: `forward` adds effects, `polish` refines their
//! nonlinear parameters, `merge` puts one effect in the place of two, `rivals` lets the whole
//! catalogue compete for each place, `exchange` tries another form of an effect with one more
//! effect, `prune` removes what the others make superfluous. `paths` searches again without effects
//! that take the shape of others, and from the best `subset` of the textbook terms.

pub mod declared;
mod exchange;
pub mod extended;
pub mod figures;
mod forward;
mod friction;
mod load;
mod merge;
pub mod model;
mod outcome;
pub mod paths;
mod polish;
mod prune;
pub mod ranking;
mod rivals;
mod run;
pub mod scan;
mod scanned;
mod screening;
mod state;
mod subset;

pub use outcome::Rival;
pub use outcome::{without, Outcome, Standing, Weight};
pub use state::Search;
