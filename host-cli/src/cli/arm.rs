//! `forcectl arm`: lets the motors act on setpoints.

use super::connection::Connection;
use super::exit::{Failure, Reply, Result};
use super::watch::Watch;
use super::Context;
use clap::Args;
use host_cli::run::{self, Observer, RunError};
use wire::Command;

/// Arguments of `arm`.
#[derive(Debug, Args)]
pub struct Arm {
    #[command(flatten)]
    connection: Connection,
}

impl Arm {
    /// Runs the command. A board that does not hold this rig file gets it first, and is zeroed.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection.with_session(context, |session, rig| {
            let configured = rig.units.map(|unit| unit.to_wire());
            // The zeros are the board's own.
            let mut on_board = session.get_configs()?;
            for config in &mut on_board {
                config.zero_code = config.stored_zero_code;
            }
            if on_board != configured {
                let mut watch = Watch::new(&context.output);
                watch.notice(
                    "the board does not hold this rig file; it is sent, and zeros are taken (cables slack)",
                );
                let stop = context.interrupt.flag();
                let prepared = run::prepare_board(session, rig, &stop, &mut watch);
                watch.progress.done();
                prepared?;
            }
            if context.interrupt.requested() {
                return Err(Failure::from(RunError::Interrupted));
            }
            session.command(&Command::Arm)?;
            Ok(Reply::done(
                "armed; the motors act on setpoints while a program sends them (`forcectl set-force`), and stop when it \
                 stops sending",
            ))
        })
    }
}
