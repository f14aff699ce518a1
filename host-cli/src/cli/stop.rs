//! `forcectl stop`: 0 V on all motors at once.

use super::connection::Connection;
use super::exit::{Reply, Result};
use super::Context;
use clap::Args;
use wire::Command;

/// Arguments of `stop`.
#[derive(Debug, Args)]
pub struct Stop {
    #[command(flatten)]
    connection: Connection,
}

impl Stop {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection.with_session(context, |session, _| {
            session.command(&Command::Stop)?;
            Ok(Reply::done(
                "stopped: all motors at 0 V; `forcectl clear` before arming again",
            ))
        })
    }
}
