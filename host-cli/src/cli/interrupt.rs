//! Ctrl-C, SIGTERM and SIGHUP. All three act alike, and every command that they end exits with 130.
//!
//! While nothing is driven, the first signal ends the program. While a link is open, the first signal requests a
//! controlled stop of the command, and the second ends the program: a board without setpoints goes to 0 V by itself.

use super::exit::{self, Failure, Result};
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
        ctrlc::set_handler(move || {
            let again = shared.requested.swap(true, Ordering::SeqCst);
            if again || shared.controlled_stop.load(Ordering::SeqCst) == 0 {
                output.finish_interrupted();
                std::process::exit(i32::from(exit::INTERRUPTED));
            }
            output.note(
                "\nInterrupted: the motors are disarmed, then the command ends. Press Ctrl-C again to exit at \
                 once; the board goes to 0 V within 100 ms.",
            );
        })
        .map_err(|error| {
            Failure::new(exit::FILE, format!("Ctrl-C cannot be handled: {error}"))
        })?;
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
