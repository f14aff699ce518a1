//! `forcectl hold`: arms and holds tensions until it is ended.

use super::connection::Connection;
use super::exit::{self, Reply, Result};
use super::watch::Watch;
use super::{values, Context};
use clap::Args;
use run::{hold_tensions, HeldTensions, TensionOptions};
use std::fmt::Write as _;
use wire::UNITS;

/// Arguments of `hold`.
#[derive(Debug, Args)]
pub struct Hold {
    /// Tensions of units 1 to 6 in N
    /// [default: zero force at the tip with the least tensions of the rig file]
    #[arg(long, value_name = "N", num_args = UNITS, value_parser = values::newton)]
    tension: Option<Vec<f64>>,
    /// End after this time [default: at Ctrl-C]
    #[arg(long, value_name = "SECONDS", value_parser = values::seconds)]
    duration: Option<f64>,
    #[command(flatten)]
    connection: Connection,
}

impl Hold {
    /// Runs the command. Ctrl-C is its usual end: the rig is disarmed and the table printed.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        self.connection.require_rig_file(&rig)?;
        let rig = self.connection.calibrated(rig, context)?;
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        // An embedded rig of the command's own runs as fast as it can: it needs an end.
        let own = link.booted_here() && !self.connection.paced();
        let options = TensionOptions {
            tension_n: self
                .tension
                .as_ref()
                .and_then(|tension| tension.as_slice().try_into().ok()),
            duration_s: self.duration.or(own.then_some(3.0)),
            zeroing: self.connection.zeroing(),
            stop: context.interrupt.flag(),
        };
        let mut watch = Watch::new(&context.output);
        let held = hold_tensions(link.as_mut(), &rig, &options, &mut watch, &mut || {});
        watch.progress.done();
        let held = held?;
        let mut json =
            serde_json::to_value(held).map_err(|error| exit::Failure::new(exit::FILE, error))?;
        let shortfalls = held.shortfalls();
        json["shortfalls"] = shortfalls.clone().into();
        let reply = Reply::new(table(&held, &shortfalls), json);
        Ok(if shortfalls.is_empty() {
            reply
        } else {
            reply.with_code(exit::DEGRADED)
        })
    }
}

/// The table for people.
fn table(held: &HeldTensions, shortfalls: &[String]) -> String {
    let mut out = String::new();
    let cell =
        |value: Option<f64>| value.map_or_else(|| format!("{:>7}", "-"), |v| format!("{v:>7.3}"));
    let units = |values: [Option<f64>; UNITS]| values.map(cell).join(" ");
    row!(out, "held for {:.1} s, then disarmed", held.held_s);
    row!(
        out,
        "tension, N             1       2       3       4       5       6"
    );
    row!(out, "  measured       {}", units(held.tension_n));
    row!(out, "  RMS error      {}", units(held.error_rms_n));
    for shortfall in shortfalls {
        row!(out, "not as asked for    {shortfall}");
    }
    out
}
