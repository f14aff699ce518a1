//! The robot beside the force rig: a virtual Raven-II arm, trajectories, messages and sources of
//! robot state.
//!
//! | question | module |
//! | --- | --- |
//! | where is the tip for these joints, and back | [`kinematics`] |
//! | where shall the joints be at each time | [`trajectory`] |
//! | how fast does the tip move | [`motion`] |
//! | what does a robot tell, in which frame, with which sign, on which clock | [`state`] |
//! | what is true of CRTK topics and of the Raven's own message | [`crtk`], [`ravenstate`] |
//! | is it one robot, alive, with a clock that runs | [`watch`] |
//! | where do states come from | [`source`] |
//! | an arm that anyone can run | `arm` (feature `arm`) |
//!
//! An estimator depends on this package without the feature `arm`: it sees what a robot publishes
//! and can't name the truth. docs/robot.md tells how the arm is modelled.

#![forbid(unsafe_code)]

#[cfg(feature = "arm")]
pub mod arm;
pub mod crtk;
pub mod kinematics;
pub mod motion;
pub mod random;
pub mod ravenstate;
pub mod source;
pub mod state;
pub mod trajectory;
pub mod watch;
