//! Force on measured robot arms from joint torques, on public data: a UR10e and the patient-side
//! arm of a da Vinci research kit.
//!
//! The data are no part of this project: clones are named by options. Models are trained on logs
//! without a load and estimate the load of other logs. Logs are kept apart, never rows.
//!
//! * [`log`](mod@log) reads the files;
//! * [`chain`] is the kinematics of an arm, and its inverse dynamics as a linear function of
//!   masses;
//! * [`fit`] filters and fits linear models of the torques;
//! * [`ur10e`] and [`psm`] are the two robots, [`page`] prints what they give.

pub mod chain;
pub mod fit;
pub mod log;
pub mod page;
pub mod psm;
pub mod ur10e;
