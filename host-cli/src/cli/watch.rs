//! Watches a run: shows its progress, and records it on request.

#[cfg(feature = "record")]
use super::exit::Result;
use super::output::Output;
use super::progress::Progress;
use force::metrics::Step;
#[cfg(feature = "record")]
use recording::{Finished, Metadata, Recorder};
use run::{Observer, Phase};
#[cfg(feature = "record")]
use session::Received;
#[cfg(feature = "record")]
use std::path::Path;
use std::sync::Arc;
#[cfg(feature = "record")]
use wire::message::{BoardInfo, UnitConfig};
#[cfg(feature = "record")]
use wire::UNITS;

/// The observer of the command line.
pub struct Watch {
    /// Progress of the run.
    pub progress: Progress,
    output: Arc<Output>,
    /// Second of the run whose line was printed last (`-vv`).
    second: Option<i64>,
    #[cfg(feature = "record")]
    recorder: Option<Recorder>,
}

impl Watch {
    /// Shows progress as the options ask for it.
    pub fn new(output: &Arc<Output>) -> Self {
        Self {
            progress: Progress::new(output),
            output: Arc::clone(output),
            second: None,
            #[cfg(feature = "record")]
            recorder: None,
        }
    }

    /// Records the run to this folder.
    #[cfg(feature = "record")]
    pub fn record_to(&mut self, folder: &Path, metadata: &Metadata) -> Result<()> {
        self.recorder = Some(Recorder::create(folder, metadata)?);
        Ok(())
    }

    /// Shows what the recording lacks. A disk that fails does not end the run.
    #[cfg(feature = "record")]
    fn show_trouble(&mut self) {
        if let Some(text) = self.recorder.as_mut().and_then(Recorder::trouble) {
            self.progress.beside(|output| output.error(&text));
        }
    }

    /// Closes the recording; `None` without one.
    #[cfg(feature = "record")]
    pub fn finish_recording(&mut self) -> Option<Finished> {
        self.show_trouble();
        self.recorder.take().map(Recorder::finish)
    }
}

impl Observer for Watch {
    fn progress(&mut self, phase: Phase, fraction: f64) {
        self.progress.at(phase.describe(), fraction);
        #[cfg(feature = "record")]
        if let Some(recorder) = &mut self.recorder {
            recorder.phase(phase);
        }
    }

    fn notice(&mut self, text: &str) {
        self.progress.beside(|output| output.note(text));
        #[cfg(feature = "record")]
        if let Some(recorder) = &mut self.recorder {
            recorder.notice(text);
        }
    }

    #[cfg(feature = "record")]
    fn connected(&mut self, board: &BoardInfo) {
        if let Some(recorder) = &mut self.recorder {
            recorder.board(board);
        }
    }

    #[cfg(feature = "record")]
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        if let Some(recorder) = &mut self.recorder {
            recorder.configured(configs);
        }
    }

    #[cfg(feature = "record")]
    fn received(&mut self, received: &Received) {
        if let Some(recorder) = &mut self.recorder {
            recorder.received(received);
        }
        self.show_trouble();
    }

    fn step(&mut self, step: &Step) {
        let second = step.t_s.floor() as i64;
        if self.output.shows_seconds() && self.second != Some(second) {
            self.second = Some(second);
            let cells = |values: &[f64]| -> String {
                values.iter().map(|value| format!("{value:>8.3}")).collect()
            };
            let line = format!(
                "{:>7.2} s   force N{}   tension N{}",
                step.t_s,
                cells(step.estimated_n.as_slice()),
                cells(&step.measured_tension_n)
            );
            self.progress.beside(|output| output.detail(&line));
        }
        #[cfg(feature = "record")]
        if let Some(recorder) = &mut self.recorder {
            recorder.cycle(step);
        }
    }
}
