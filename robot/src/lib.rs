//! The robot.
#[cfg(feature = "arm")]
pub mod arm;
pub mod kinematics;
pub mod random;
pub mod ravenstate;
pub mod state;
pub mod trajectory;
