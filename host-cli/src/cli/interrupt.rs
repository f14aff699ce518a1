//! Ctrl-C, SIGTERM and SIGHUP. All three act alike, and every command that they end exits with 130.
//! A SIGHUP that is ignored at the start, as under `nohup`, stays ignored.
//!
//! While nothing is driven, the first signal ends the program. While a link is open, the first
//! signal requests a controlled stop of the command, and the second ends the program: a board
//! without setpoints goes to 0 V by itself.

use super::exit::{self, Failure, Result};
use super::monitor::screen;
use super::output::Output;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::Arc;

/// The state that the handler shares with the command.
#[derive(Debug, Clone)]
pub struct Interrupt {
    requested: Arc<AtomicBool>,
    /// Number of [`ControlledStop`] values that live.
    controlled_stop: Arc<AtomicUsize>,
}

/// While this value lives, the first signal requests a controlled stop of the command.
#[derive(Debug)]
pub struct ControlledStop {
    controlled_stop: Arc<AtomicUsize>,
}

impl Drop for ControlledStop {
    fn drop(&mut self) {
        self.controlled_stop.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Interrupt {
    /// Installs the handler. Call it once.
    pub fn install(output: &Arc<Output>) -> Result<Self> {
        let interrupt = Self {
            requested: Arc::default(),
            controlled_stop: Arc::default(),
        };
        let (shared, output) = (interrupt.clone(), Arc::clone(output));
        let handler = move || {
            let again = shared.requested.swap(true, Ordering::SeqCst);
            if again || shared.controlled_stop.load(Ordering::SeqCst) == 0 {
                screen::restore();
                output.finish_interrupted();
                std::process::exit(i32::from(exit::INTERRUPTED));
            }
            // The view ends at once, and has no place for a message.
            if screen::taken() {
                return;
            }
            output.note(
                "\nInterrupted: the command ends; a run is ramped down and disarmed first. Press Ctrl-C again to exit at \
                 once; the board then goes to 0 V within 100 ms.",
            );
        };
        let failed =
            |error: String| Failure::new(exit::FILE, format!("signals cannot be handled: {error}"));
        #[cfg(unix)]
        on_termination(handler.clone()).map_err(|error| failed(error.to_string()))?;
        ctrlc::set_handler(handler).map_err(|error| failed(error.to_string()))?;
        Ok(interrupt)
    }

    /// From now on the first signal requests a controlled stop of the command.
    pub fn controlled_stop(&self) -> ControlledStop {
        self.controlled_stop.fetch_add(1, Ordering::SeqCst);
        ControlledStop {
            controlled_stop: Arc::clone(&self.controlled_stop),
        }
    }

    /// The flag that a run watches.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.requested)
    }

    /// Whether a signal has come.
    pub fn requested(&self) -> bool {
        self.requested.load(Ordering::SeqCst)
    }
}

/// Calls the handler on each SIGTERM, and on each SIGHUP unless that is ignored already. A SIGXFSZ
/// does nothing.
#[cfg(unix)]
fn on_termination(handler: impl Fn() + Send + 'static) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGTERM, SIGXFSZ};
    // A file that may not grow (`ulimit -f`) is an error of who writes it, and ends no run.
    signal_hook::flag::register(SIGXFSZ, Arc::default())?;
    let mut list = vec![SIGTERM];
    if !is_ignored(SIGHUP) {
        list.push(SIGHUP);
    }
    let mut signals = signal_hook::iterator::Signals::new(list)?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(|_| handler()))?;
    Ok(())
}

/// Whether the program was started with a signal ignored, by `SigIgn` of `/proc/self/status`
/// (proc(5)). `false` on systems without that file.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|status| {
            let line = status.lines().find_map(|l| l.strip_prefix("SigIgn:"))?;
            u64::from_str_radix(line.trim(), 16).ok()
        })
        .is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
