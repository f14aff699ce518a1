//! How far a long run is, on standard error.

use std::io::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Counts sets that are done and prints count and time left, at most every two seconds.
pub struct Progress {
    started: Instant,
    done: AtomicUsize,
    of: usize,
    printed: Mutex<Instant>,
}

impl Progress {
    /// A run of so many sets that starts now.
    #[must_use]
    pub fn new(of: usize) -> Self {
        let now = Instant::now();
        Self {
            started: now,
            done: AtomicUsize::new(0),
            of,
            printed: Mutex::new(now),
        }
    }

    /// One more set is done.
    pub fn step(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let Ok(mut printed) = self.printed.try_lock() else {
            return;
        };
        if done < self.of && printed.elapsed() < Duration::from_secs(2) {
            return;
        }
        *printed = Instant::now();
        let passed = self.started.elapsed().as_secs_f64();
        let left = passed / done as f64 * self.of.saturating_sub(done) as f64;
        eprint!(
            "\r{done}/{} sets, {passed:.0} s, {left:.0} s to go   ",
            self.of
        );
        let _ = std::io::stderr().flush();
    }
}
