//! Progress of an analysis: stages, and the fraction done of a long scan.

use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Called with the number of candidates done and of all candidates in this scan, from any thread.
pub type Ticker = Arc<dyn Fn(usize, usize) + Send + Sync>;

/// Receives the progress of an analysis. `()` ignores it.
pub trait Progress {
    /// A stage begins; `text` is one line that describes it.
    fn stage(&mut self, text: &str);

    /// What scans report their progress to; `None` if progress is not shown.
    fn ticker(&mut self) -> Option<Ticker> {
        None
    }
}

impl Progress for () {
    fn stage(&mut self, _: &str) {}
}

/// Least time between two reports of one scan on a terminal, where each replaces the last.
const ON_TERMINAL: Duration = Duration::from_millis(200);
/// The same in a log, where each is a line.
const IN_LOG: Duration = Duration::from_secs(5);

/// Prints stages with the time since the start to standard error, and in between the fraction of
/// the scan that is done: in place on a terminal, as a line every few seconds elsewhere.
pub struct Console {
    start: Instant,
    terminal: bool,
    /// When something was last written, and whether an unfinished line stands on the terminal.
    last: Arc<Mutex<(Instant, bool)>>,
}

impl Default for Console {
    fn default() -> Self {
        let start = Instant::now();
        Console {
            start,
            terminal: std::io::stderr().is_terminal(),
            last: Arc::new(Mutex::new((start, false))),
        }
    }
}

/// The time since the start, as it stands at the head of each line.
fn stamp(start: Instant) -> String {
    format!("[{:7.2} s]", start.elapsed().as_secs_f64())
}

impl Progress for Console {
    fn stage(&mut self, text: &str) {
        if let Ok(mut last) = self.last.lock() {
            let clear = if last.1 { "\r\x1b[K" } else { "" };
            // Progress that cannot be shown is no reason to stop.
            let _ = writeln!(std::io::stderr(), "{clear}{} {text}", stamp(self.start));
            *last = (Instant::now(), false);
        }
    }

    fn ticker(&mut self) -> Option<Ticker> {
        let (start, terminal, last) = (self.start, self.terminal, self.last.clone());
        Some(Arc::new(move |done, all| {
            // If another thread is printing, its report is enough.
            let Ok(mut last) = last.try_lock() else {
                return;
            };
            let pause = if terminal { ON_TERMINAL } else { IN_LOG };
            if last.0.elapsed() < pause {
                return;
            }
            let text = format!(
                "{}   {:3} % of {all} candidates",
                stamp(start),
                100 * done / all.max(1)
            );
            let mut err = std::io::stderr().lock();
            // Progress that cannot be printed does not stop the analysis.
            let _ = if terminal {
                write!(err, "\r{text}\x1b[K").and_then(|()| err.flush())
            } else {
                writeln!(err, "{text}")
            };
            *last = (Instant::now(), terminal);
        }))
    }
}

impl Drop for Console {
    fn drop(&mut self) {
        if self.last.lock().is_ok_and(|last| last.1) {
            let _ = writeln!(std::io::stderr(), "\r\x1b[K");
        }
    }
}
