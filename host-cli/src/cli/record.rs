//! `forcectl record`: records every sample and drives nothing.

use super::connection::{booted_here, configure_embedded, Connection, Role};
use super::exit::{self, Failure, Reply, Result};
use super::monitor::End;
use super::output::path_json;
use super::progress::Progress;
use super::{values, Context};
use clap::Args;
use recording::{Metadata, Recorder};
use serde_json::json;
use session::PERIOD;
use std::path::PathBuf;
use wire::Command;

/// Arguments of `record`.
#[derive(Debug, Args)]
pub struct Record {
    /// Folder for the recording
    folder: PathBuf,
    /// End after this time [default: at Ctrl-C; embedded rig: 3]
    #[arg(long, value_name = "SECONDS", value_parser = values::seconds)]
    duration: Option<f64>,
    #[command(flatten)]
    connection: Connection,
}

impl Record {
    /// Runs the command. A lost link ends the recording; what was received is kept.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection
            .with_session(Role::Observer, context, |session, rig| {
                self.connection.warn_of_changes(rig, context)?;
                configure_embedded(session, rig)?;
                let emulated = session.link().controls().is_some();
                let metadata = Metadata::new(rig, emulated)
                    .with("link", session.link().name())
                    .with("command", "record");
                let metadata = if booted_here(session) && !self.connection.paced() {
                    metadata
                } else {
                    metadata.never_waits()
                };
                let mut recorder = Recorder::create(&self.folder, &metadata)?;
                if let Some(board) = session.info() {
                    recorder.board(board);
                }
                recorder.configured(&session.get_configs()?);
                session.command(&Command::Stream { decimation: 1 })?;
                session.drain();
                let mut progress = Progress::new(&context.output);
                let end = End::after(session, self.duration);
                let mut lost = None;
                while !end.reached(session, context) {
                    if let Err(error) = session.exchange(PERIOD) {
                        lost = Some(error);
                        break;
                    }
                    recorder.received(&session.drain());
                    if let Some(text) = recorder.trouble() {
                        progress.beside(|output| output.error(&text));
                    }
                    progress.at("recording", end.fraction(session));
                }
                progress.done();
                let finished = recorder.finish().complete()?;
                let counters = session.counters();
                let reply = Reply::new(
                    format!(
                        "{} samples in {}, {} dropped; telemetry frames lost {}, damaged {}\n",
                        finished.samples,
                        self.folder.display(),
                        finished.dropped_samples,
                        counters.frames_lost,
                        counters.frames_bad
                    ),
                    json!({"samples": finished.samples, "dropped_samples": finished.dropped_samples, "folder": path_json(&self.folder), "link": counters}),
                );
                match lost {
                    Some(error) => Err(Failure::from(error).with_reply(reply)),
                    None if finished.samples == 0 => {
                        context.output.note("no sample came in this time: a rig brings its sensors up first; record for longer, and see `forcectl status`");
                        Ok(reply.with_code(exit::DEGRADED))
                    }
                    None => Ok(reply),
                }
            })
    }
}
