//! `forcectl clear`: clears latched faults whose cause is gone.

use super::connection::{Existing, Role};
use super::exit::{self, Failure, Reply, Result};
use super::Context;
use clap::Args;
use session::{explain_fault, PERIOD};
use wire::Command;

/// Control cycles until sensors that were down are up again.
const CYCLES: u32 = 20;

/// Arguments of `clear`.
#[derive(Debug, Args)]
pub struct Clear {
    #[command(flatten)]
    connection: Existing,
}

impl Clear {
    /// Runs the command. Faults that remain give exit code 5.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection
            .with_session(Role::Ender, context, |session, _| {
                session.command(&Command::ClearFaults)?;
                for _ in 0..CYCLES {
                    session.exchange(PERIOD)?;
                }
                let status = session.get_status()?;
                let board = (status.fault != 0)
                    .then(|| explain_fault(status.fault, status.fault_detail))
                    .into_iter();
                let units = (status.units.iter().enumerate())
                    .filter(|(_, unit)| unit.fault != 0)
                    .map(|(i, unit)| {
                        let text = explain_fault(unit.fault, unit.fault_detail);
                        format!("unit {}: {text}", i + 1)
                    });
                let left: Vec<String> = board.chain(units).collect();
                if left.is_empty() {
                    return Ok(Reply::done("no fault is latched; nothing is armed"));
                }
                Err(Failure::new(
                    exit::BOARD,
                    format!(
                        "faults remain latched, because their cause is still present: {}",
                        left.join("\n")
                    ),
                ))
            })
    }
}
