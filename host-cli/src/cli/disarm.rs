//! `forcectl disarm`: ramps the torques down.

use super::connection::Connection;
use super::exit::{Reply, Result};
use super::Context;
use clap::Args;
use control::SystemState;
use std::time::Duration;
use wire::Command;

/// Arguments of `disarm`.
#[derive(Debug, Args)]
pub struct Disarm {
    #[command(flatten)]
    connection: Connection,
}

impl Disarm {
    /// Runs the command, which ends when the motors are at 0 V.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection.with_session(context, |session, _| {
            session.command(&Command::Disarm)?;
            session.wait_for(Duration::from_secs(3), "disarming", |status| {
                !SystemState::from_u8(status.state).is_some_and(SystemState::drives)
            })?;
            Ok(Reply::done("disarmed"))
        })
    }
}
