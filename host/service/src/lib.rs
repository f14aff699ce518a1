//! The service that owns the one link to a rig and serves many clients: `forcectl serve`,
//! `forcectl rig`.
//!
//! ```text
//!                       +-- commander (set-force, hold, ...): setpoints, arm, disarm
//!  board or             |
//!  embedded rig ── hub ─┼── observers (monitor, status, a Python script): telemetry, stop
//!     one link          |
//!                       +── a job of the service itself (hold, set_force), or a program on the pseudo-terminal
//! ```
//!
//! | question | file |
//! | --- | --- |
//! | what do clients and service say | `protocol` |
//! | where is the socket | `socket`, `account` |
//! | a stop, whatever hangs | `stop` |
//! | who may do what, which bytes go where | `hub` |
//! | sequence numbers of frames for each client | `frames` |
//! | what reaches the hub, and what waits for a client | `inbound`, `outbox` |
//! | one connection: reading and writing lines | `connection` |
//! | a client of this library: the service as a [`session::link::RigLink`] | `client` |
//! | what the service does by itself | `job` |
//! | a program that expects a serial port | `terminal` |
//! | accepting clients, start and end | `server` |
//!
//! One client commands at a time, any number observe, and each of them may stop the rig. A
//! commander that goes away has the rig disarmed. If the service itself ends, the setpoints expire
//! and the board stops within 100 ms.
//!
//! It talks over Unix sockets and pseudo-terminals: on other systems this crate is empty, and every
//! command opens the link itself.
#![cfg(unix)]

mod account;
pub mod client;
mod connection;
mod frames;
mod hub;
mod inbound;
mod job;
mod outbox;
pub mod protocol;
pub mod server;
pub mod socket;
pub mod stop;
mod terminal;
#[cfg(test)]
mod tests;

pub use client::{Client, ServiceError};
pub use hub::{Opener, CYCLE};
pub use server::{serve, ServeOptions};
