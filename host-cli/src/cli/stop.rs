//! `forcectl stop`: 0 V on all motors at once.

use super::connection::{Existing, Role};
use super::exit::{Reply, Result};
use super::Context;
use clap::Args;
use wire::Command;

/// Arguments of `stop`.
#[derive(Debug, Args)]
pub struct Stop {
    #[command(flatten)]
    connection: Existing,
}

impl Stop {
    /// Runs the command. It works from every terminal, whoever commands the rig.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection.load(context)?;
        let done = Reply::done("stopped: all motors at 0 V; `forcectl clear` before arming again");
        #[cfg(unix)]
        if let Some(mut client) = self.connection.client(context) {
            client.call(host_cli::service::protocol::Call::Stop)?;
            return Ok(done);
        }
        self.connection
            .with_session(Role::Observer, context, |session, _| {
                session.command(&Command::Stop)?;
                Ok(done)
            })
    }
}
