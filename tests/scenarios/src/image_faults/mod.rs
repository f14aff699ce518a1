//! Flips of single bits in the running image, and what came of each.
//!
//! `cargo xtask faults` injects into the firmware's core on the plant. Here the whole image runs in
//! the embedded rig, armed, and one bit of a core register, of the variables, of the stack or of a
//! peripheral's register changes at a drawn time. Hazards, their limits and the watch for them are
//! those of the package `faults`; the drive's constants are the plant's.
//!
//! | module | question |
//! | --- | --- |
//! | [`draw`] | which bit, and when |
//! | [`case`] | one run: boot, arm, flip, watch |
//! | [`table`] | the summary |

pub mod case;
pub mod draw;
pub mod table;

pub use case::{Outcome, Stage};
pub use draw::{Flip, Memory, Place, Plan};
