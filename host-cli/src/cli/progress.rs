//! Progress of a run on standard error: a bar on a terminal, one line for each phase elsewhere.

use super::output::{self, Output};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::sync::Arc;

/// Progress of a run.
pub struct Progress {
    output: Arc<Output>,
    bar: Option<ProgressBar>,
    phase: Option<&'static str>,
}

impl Progress {
    /// Progress as the options ask for it.
    pub fn new(output: &Arc<Output>) -> Self {
        let bar = (output.shows_progress() && output::stderr_is_terminal()).then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr_with_hz(10));
            if let Ok(style) = ProgressStyle::with_template("{msg:42} {bar:30} {elapsed:>4}") {
                bar.set_style(style);
            }
            bar
        });
        Self {
            output: Arc::clone(output),
            bar,
            phase: None,
        }
    }

    /// A phase began, or went on to this fraction of it (0 to 1).
    pub fn at(&mut self, phase: &'static str, fraction: f64) {
        if self.phase != Some(phase) {
            self.phase = Some(phase);
            match &self.bar {
                Some(bar) => bar.set_message(phase),
                None => self.output.note(&format!("{phase} ...")),
            }
        }
        if let Some(bar) = &self.bar {
            bar.set_position((fraction.clamp(0.0, 1.0) * 1000.0) as u64);
        }
    }

    /// Prints something beside the bar.
    pub fn beside(&self, print: impl FnOnce(&Output)) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print(&self.output)),
            None => print(&self.output),
        }
    }

    /// Removes the bar.
    pub fn done(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
