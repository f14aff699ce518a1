//! Host library of the force rig, and the command line `forcectl` on top of it.
//!
//! | question | module |
//! | --- | --- |
//! | what is this rig | [`rigfile`] |
//! | how do bytes get to the board | [`link`] |
//! | what do host and board say | [`session`] |
//! | the board's clock against the host's | [`clock`] |
//! | one rig, many terminals | [`service`] |
//! | what does a rig do now | [`telemetry`] |
//! | where is the tip | [`force::pose`] |
//! | which tensions make a force | [`force::allocation`] |
//! | what is sent 100 times a second | [`force::controller`] |
//! | a whole run | [`run`] |
//! | what is measured of a rig, and how well its force is known | [`calibrate`] |
//! | how good was it | [`force::metrics`], [`plot`] |
//! | what does the rig lack in its rig file | [`identify`](mod@crate::identify), [`findings`](mod@crate::identify::findings) |
//! | a day in the lab: trials, datasets | [`experiment`](mod@crate::experiment) |
//! | which force acts on the tool, from the robot's state alone | [`estimate`](mod@crate::estimate) |
//! | what is kept of it | [`recording`](mod@crate::recording) |
//!
//! SI units throughout; the wire's integers end at [`session`].
// Only the program prints, in `cli::output`.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod calibrate;
pub mod clock;
#[cfg(feature = "estimate")]
pub mod estimate;
#[cfg(feature = "record")]
pub mod experiment;
pub mod force;
#[cfg(feature = "residual")]
pub mod identify;
pub mod inject;
pub mod link;
pub mod plot;
#[cfg(feature = "record")]
pub mod recording;
pub mod rigfile;
pub mod run;
#[cfg(unix)]
pub mod service;
pub mod session;
pub mod telemetry;
