//! `forcectl arm`: arms a rig that stays, and leaves it armed.

use super::connection::Existing;
use super::exit::{Failure, Reply, Result};
use super::Context;
use clap::Args;

/// Arguments of `arm`.
#[derive(Debug, Args)]
pub struct Arm {
    #[command(flatten)]
    connection: Existing,
}

impl Arm {
    /// Runs the command. The rig's service sends the setpoints: the board stops 100 ms after they
    /// cease.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        self.connection.require_rig_file(&rig)?;
        self.connection.require_unchanged(context)?;
        #[cfg(unix)]
        if let Some(mut client) = self.connection.client(context) {
            let theirs = rig::Rig::parse(&client.welcome().rig_file, &client.welcome().rig_text)?;
            if theirs.hash() != rig.hash() {
                return Err(Failure::usage(format!(
                        "the service holds with its own rig file ({}), which differs from this one; use `forcectl hold` with \
                         this one, or start the service with it",
                        client.welcome().rig_file
                    ),
                ));
            }
            client.hold(service::protocol::HoldParams::default())?;
            return Ok(Reply::done(
                "armed; the service holds zero force with the least tensions until `forcectl disarm`",
            ));
        }
        Err(Failure::usage("`arm` leaves the rig armed after it has ended, and only a service can send setpoints then; omit --direct, or use \
             `forcectl hold --direct`",
        ))
    }
}
