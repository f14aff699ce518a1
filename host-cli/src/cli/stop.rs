//! `forcectl stop`: 0 V on all motors at once.

use super::connection::{Existing, Role};
use super::exit::{self, Failure, Reply, Result};
use super::Context;
use clap::Args;
use wire::Command;

/// What a stop that was confirmed means.
const STOPPED: &str = "stopped: all motors at 0 V; `forcectl clear` before arming again";

/// Arguments of `stop`.
#[derive(Debug, Args)]
pub struct Stop {
    #[command(flatten)]
    connection: Existing,
}

impl Stop {
    /// Runs the command. It works from every terminal, whoever commands the rig. Without `--link` it stops every rig that has
    /// a service here. It reads no rig file: a mistake in one must not keep the motors running.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        #[cfg(unix)]
        if self.stop_services(context)? {
            return Ok(Reply::done(STOPPED));
        }
        self.connection.load(context)?;
        #[cfg(unix)]
        if let Some(mut client) = self.connection.client(context) {
            client.call(service::protocol::Call::Stop)?;
            return Ok(Reply::done(STOPPED));
        }
        self.connection
            .with_session(Role::Observer, context, |session, _| {
                session.command(&Command::Stop)?;
                Ok(Reply::done(STOPPED))
            })
    }

    /// Stops the rigs that have a service. `false`: no service is concerned.
    #[cfg(unix)]
    fn stop_services(&self, context: &Context) -> Result<bool> {
        let names = self.connection.services();
        let mut failed = Vec::new();
        for name in &names {
            let stopped = service::Client::connect(name, "forcectl stop").and_then(|mut client| {
                client.call(service::protocol::Call::Stop)?;
                Ok(client.welcome().link.clone())
            });
            match stopped {
                Ok(link) => context.output.note(&format!("rig `{name}`: {link}")),
                Err(error) => failed.push(format!("rig `{name}`: {error}")),
            }
        }
        if !failed.is_empty() {
            return Err(Failure::new(exit::LINK, failed.join("\n")));
        }
        Ok(!names.is_empty())
    }
}
