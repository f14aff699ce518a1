//! A session with the board: links, connecting, commands with their responses, telemetry, clocks.
//!
//! | question | file |
//! | --- | --- |
//! | how do bytes get to the board | [`link`] |
//! | faults to inject into an emulated rig, as text | [`inject`] |
//! | what a session holds and what arrived | `session` |
//! | who is the board, which protocol does it speak | `handshake` |
//! | a command and its response | `request` |
//! | what is sent when, setpoints among it; time passes | `exchange` |
//! | frames to samples, faults and status; board time | `receive` |
//! | which request for the status was sent when | `timekeeping` |
//! | the board's clock against the host's | [`clock`] |
//! | what a rig does now, as one object | [`telemetry`] |
//! | how long a step may take, by the board's clock | `patience` |
//! | numbers in words | `explain` |
//! | what can go wrong | `error` |
//!
//! Whatever arrives while a command waits for its response is stored and returned by
//! [`Session::drain`], so no sample is lost during a request. While setpoints are in force they are
//! sent again every 10 ms, also during a request: the board stops within 100 ms when they cease. SI
//! units throughout; the wire's integers end here.

pub mod clock;
mod error;
mod exchange;
mod explain;
mod gaps;
mod handshake;
pub mod inject;
pub mod link;
mod patience;
mod receive;
mod request;
mod session;
pub mod telemetry;
mod timekeeping;

pub use error::SessionError;
pub use explain::{
    command_name, explain_crash_record, explain_fault, explain_refusal, motor_state_name,
    system_state_name, LatchedFault,
};
pub use gaps::Gaps;
pub use patience::Patience;
pub use session::{
    LinkCounters, Received, Session, TimedSample, PERIOD, SETPOINTS_VALID_MS, SILENCE_TIMEOUT,
};
