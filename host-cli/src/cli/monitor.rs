//! `forcectl monitor`: tensions as they come, ten lines per second.
//!
//! With `--json` each line is one object: `{"t_s": ..., "tension_n": [...]}` for tensions (`null` for a unit without a
//! sample), `{"t_s": ..., "fault": ..., "unit": ..., "text": ...}` for a fault (`null` for the whole board). An error is
//! the last line: `{"error": ..., "exit_code": ...}`.

use super::connection::{booted_here, configure_embedded, Connection, Role};
use super::exit::{Reply, Result};
use super::{values, Context};
use clap::Args;
use host_cli::session::{explain_fault, Session, PERIOD};
use serde_json::json;
use wire::{Command, UNITS};

/// How long `monitor` and `record` run on the embedded rig where no duration is given, s.
pub const EMBEDDED_DURATION_S: f64 = 3.0;
/// Control cycles of 10 ms from one line to the next.
const CYCLES_PER_LINE: u32 = 10;

/// Arguments of `monitor`.
#[derive(Debug, Args)]
pub struct Monitor {
    /// End after this time [default: at Ctrl-C; embedded rig: 3]
    #[arg(long, value_name = "SECONDS", value_parser = values::seconds)]
    duration: Option<f64>,
    #[command(flatten)]
    connection: Connection,
}

/// The end of a command that watches the board.
pub struct End {
    start_ns: u64,
    duration_s: Option<f64>,
}

impl End {
    /// Starts to count. The embedded rig gets a duration, because its time passes as fast as it can be computed.
    pub fn after(session: &mut Session<'_>, duration_s: Option<f64>) -> Self {
        let default_s = booted_here(session).then_some(EMBEDDED_DURATION_S);
        Self {
            start_ns: session.now_ns(),
            duration_s: duration_s.or(default_s),
        }
    }

    /// Time since the start, s, in whole microseconds.
    pub fn elapsed_s(&self, session: &Session<'_>) -> f64 {
        ((session.now_ns() - self.start_ns) / 1_000) as f64 / 1e6
    }

    /// Part of the duration that is over; 0 where it is not known.
    #[cfg(feature = "record")]
    pub fn fraction(&self, session: &Session<'_>) -> f64 {
        self.duration_s.map_or(0.0, |s| self.elapsed_s(session) / s)
    }

    /// Whether the duration is over, or Ctrl-C was pressed.
    pub fn reached(&self, session: &Session<'_>, context: &Context) -> bool {
        let over = self
            .duration_s
            .is_some_and(|s| self.elapsed_s(session) >= s);
        over || context.interrupt.requested()
    }
}

impl Monitor {
    /// Runs the command. It ends early where its output is not read.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let output = &context.output;
        self.connection.with_session(Role::Observer, context, |session, rig| {
            configure_embedded(session, rig)?;
            session.command(&Command::Stream { decimation: 1 })?;
            let end = End::after(session, self.duration);
            if !output.json() {
                let units: String = (1..=UNITS)
                    .map(|n| format!("{:>8}", format!("unit {n}")))
                    .collect();
                output.line(&format!("{:>9}  {units}   (N)", "t s"));
            }
            let mut cycle = 0_u32;
            while !end.reached(session, context) && output.is_open() {
                session.advance(PERIOD)?;
                let t_s = end.elapsed_s(session);
                for fault in &session.drain().faults {
                    let unit = usize::from(fault.unit) < UNITS;
                    let unit = unit.then(|| u16::from(fault.unit) + 1);
                    let text = explain_fault(fault.code, fault.detail);
                    if output.json() {
                        let object =
                            json!({"t_s": t_s, "fault": fault.code, "unit": unit, "text": text});
                        output.line(&object.to_string());
                    } else {
                        let who = unit.map_or_else(|| "board".to_owned(), |n| format!("unit {n}"));
                        output.error(&format!("{who}: {text}"));
                    }
                }
                cycle += 1;
                if cycle.is_multiple_of(CYCLES_PER_LINE) {
                    let tensions = session.tension_n().map(|t| t.map(|(tension, _)| tension));
                    output.line(&if output.json() {
                        json!({"t_s": t_s, "tension_n": tensions}).to_string()
                    } else {
                        let cells = tensions.map(|tension| {
                            tension.map_or_else(|| format!("{:>8}", "-"), |t| format!("{t:>8.3}"))
                        });
                        format!("{t_s:>9.2}  {}", cells.join(""))
                    });
                }
            }
            Ok(Reply::text(""))
        })
    }
}
