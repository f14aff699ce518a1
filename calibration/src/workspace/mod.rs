//! Which forces a rig can apply at the tip, where, and where its units should stand.
//!
//! With the directions `d_i` of the cables (from the tip to the exit points) and tensions within
//! `[t_min, t_max]` (thesis 3.7: 2 to 12 N) the feasible forces at a pose are the zonotope
//! `{ sum t_i d_i }`: [`zonotope`]. [`map`] looks at it over a set of poses, [`place`] moves exit
//! points within mounting limits so that the least or the mean of it grows.

pub mod map;
pub mod place;
pub mod zonotope;

pub use map::{cable_directions, Pose, PoseReport};
pub use place::{Mount, Objective, Placement};
pub use zonotope::Zonotope;

/// Why a set of feasible forces can't be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WorkspaceError {
    /// Slices of different lengths, or none.
    #[error("{directions} cables and {bounds} tension ranges: there has to be one range for each of at least one cable")]
    Counts {
        /// Cables.
        directions: usize,
        /// Tension ranges.
        bounds: usize,
    },
    /// A number that can't be used.
    #[error("cable {cable}: {what}")]
    BadCable {
        /// Cable, from 1.
        cable: usize,
        /// What is wrong with it.
        what: &'static str,
    },
    /// The cables lie in a plane or on a line.
    #[error("the cables' directions lie in a plane: no force across it is feasible; move the tip or the units")]
    Flat,
    /// The tip is in an exit point.
    #[error("the tip at {tip_m:?} m is less than 1 mm from the exit point of cable {cable}")]
    AtExit {
        /// Cable, from 1.
        cable: usize,
        /// Tip, m.
        tip_m: [f64; 3],
    },
    /// There is no pose.
    #[error("there is no pose to look at")]
    NoPose,
    /// An option that can't be used.
    #[error("{name} is {value}: {problem}")]
    BadOption {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is wrong.
        problem: &'static str,
    },
}
