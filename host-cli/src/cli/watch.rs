//! Watches a run: shows its progress, and records it on request.

#[cfg(feature = "record")]
use super::exit::Result;
use super::output::Output;
use super::progress::Progress;
use host_cli::force::metrics::Step;
#[cfg(feature = "record")]
use host_cli::record::{RecordError, Recorder};
#[cfg(feature = "record")]
use host_cli::rigfile::RigFile;
use host_cli::run::{Observer, Phase};
#[cfg(feature = "record")]
use host_cli::session::TimedSample;
#[cfg(feature = "record")]
use std::path::Path;
use std::sync::Arc;
#[cfg(feature = "record")]
use wire::message::UnitConfig;
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
    #[cfg(feature = "record")]
    record_error: Option<RecordError>,
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
            #[cfg(feature = "record")]
            record_error: None,
        }
    }

    /// Records the run to this folder.
    #[cfg(feature = "record")]
    pub fn record_to(&mut self, folder: &Path, rig: &RigFile) -> Result<()> {
        self.recorder = Some(Recorder::create(folder, rig)?);
        Ok(())
    }

    /// Records something. A disk that fails ends the recording and not the run.
    #[cfg(feature = "record")]
    fn record(
        &mut self,
        write: impl FnOnce(&mut Recorder) -> std::result::Result<(), RecordError>,
    ) {
        if let Some(recorder) = &mut self.recorder {
            if let Err(error) = write(recorder) {
                let text = format!("{error}; the recording has ended, the run continues");
                self.progress.beside(|output| output.error(&text));
                self.recorder = None;
                self.record_error = Some(error);
            }
        }
    }

    /// Closes the recording.
    #[cfg(feature = "record")]
    pub fn finish_recording(&mut self) -> Result<()> {
        if let Some(recorder) = self.recorder.take() {
            recorder.finish()?;
        }
        self.record_error
            .take()
            .map_or(Ok(()), |error| Err(error.into()))
    }
}

impl Observer for Watch {
    fn progress(&mut self, phase: Phase, fraction: f64) {
        self.progress.at(phase.describe(), fraction);
    }

    fn notice(&mut self, text: &str) {
        self.progress.beside(|output| output.note(text));
    }

    #[cfg(feature = "record")]
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        self.record(|recorder| {
            recorder.configured(configs);
            Ok(())
        });
    }

    #[cfg(feature = "record")]
    fn samples(&mut self, samples: &[TimedSample]) {
        self.record(|recorder| recorder.samples(samples));
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
        self.record(|recorder| recorder.cycle(step));
    }
}
