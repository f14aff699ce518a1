//! Work that takes long: on a thread of its own, without the interpreter's lock, with Ctrl-C.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::any::Any;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{channel, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Between two looks for Ctrl-C. Nobody waits for an answer to a key for longer.
const LOOK: Duration = Duration::from_millis(50);

/// What ends the work of a thread after Ctrl-C.
struct Stopped;

/// What the work tells, and whether it is to go on.
pub struct Watch {
    stop: Arc<AtomicBool>,
    told: Mutex<Sender<String>>,
}

impl Watch {
    /// Ends the work where Ctrl-C was pressed: unwinds to [`run`]. The crates have no way to stop
    /// an analysis or a training, and call this at each step of their progress.
    pub fn check(&self) {
        go_on(&self.stop);
    }

    /// Tells a line of progress.
    pub fn tell(&self, text: &str) {
        self.check();
        let told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        // The receiver lives as long as the work.
        let _ = told.send(text.to_owned());
    }
}

fn go_on(stop: &AtomicBool) {
    if stop.load(Ordering::Relaxed) {
        // No panic: nothing is wrong, and nothing is printed.
        resume_unwind(Box::new(Stopped));
    }
}

impl residual::Progress for &Watch {
    fn stage(&mut self, text: &str) {
        self.tell(text);
    }

    fn ticker(&mut self) -> Option<residual::Ticker> {
        let stop = self.stop.clone();
        Some(Arc::new(move |_, _| go_on(&stop)))
    }
}

/// Runs `work`, and calls `progress` with each line that it tells. Ctrl-C, and an exception of
/// `progress`, end the work at its next step.
///
/// # Errors
/// That exception; `RuntimeError` where the work panicked, which is a fault of the crate.
pub fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> T + Send,
) -> PyResult<T> {
    let (told, lines) = channel();
    let lines = Mutex::new(lines);
    let stop = Arc::new(AtomicBool::new(false));
    let watch = Watch {
        stop: stop.clone(),
        told: Mutex::new(told),
    };
    std::thread::scope(|scope| {
        // The watch goes with the work: its end closes the channel.
        let worker = scope.spawn(move || work(&watch));
        let mut interrupted = None;
        loop {
            let line = py.detach(|| {
                let lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
                lines.recv_timeout(LOOK)
            });
            if line == Err(RecvTimeoutError::Disconnected) {
                break;
            }
            if interrupted.is_some() {
                continue;
            }
            let told = match (line, progress) {
                (Ok(text), Some(progress)) => progress.call1((text,)).map(drop),
                _ => Ok(()),
            };
            if let Err(exception) = told.and_then(|()| py.check_signals()) {
                stop.store(true, Ordering::Relaxed);
                interrupted = Some(exception);
            }
        }
        let ended = py.detach(|| worker.join());
        match (ended, interrupted) {
            (_, Some(exception)) => Err(exception),
            (Ok(result), None) => Ok(result),
            (Err(panic), None) => Err(PyRuntimeError::new_err(format!(
                "a fault of this program: {}; please report it with what you called",
                words(&*panic)
            ))),
        }
    })
}

/// What a panic said.
fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("no words")
}
