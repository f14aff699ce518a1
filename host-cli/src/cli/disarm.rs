//! `forcectl disarm`: ramps the torques down.

use super::connection::{Existing, Role};
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
    connection: Existing,
}

impl Disarm {
    /// Runs the command, which ends when the motors are at 0 V. It ends what `forcectl arm` began;
    /// a program that commands the rig itself is not interrupted.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection.load(context)?;
        #[cfg(unix)]
        if let Some(mut client) = self.connection.client(context) {
            client.call(service::protocol::Call::Disarm)?;
            return Ok(Reply::done("disarmed"));
        }
        self.connection
            .with_session(Role::Ender, context, |session, _| {
                session.command(&Command::Disarm)?;
                session.wait_for(Duration::from_secs(3), "disarming", |status| {
                    !SystemState::from_u8(status.state).is_some_and(SystemState::drives)
                })?;
                Ok(Reply::done("disarmed"))
            })
    }
}
