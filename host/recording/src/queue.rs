//! Between a run and the thread that writes: what waits, and what both sides know.

use force::metrics::Step;
use session::Received;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use wire::message::UnitConfig;
use wire::UNITS;

/// What goes to the writer.
pub(super) enum Item {
    Received(Box<Received>),
    /// A cycle, and its host time, ns; 0: that of what was received last.
    Cycle(Box<Step>, u64),
    Phase(&'static str),
    Configured(Box<[UnitConfig; UNITS]>),
    Notice(String),
    /// A row of a table of numbers: its topic, board time (s) and values.
    Columns(&'static str, f64, Vec<f64>),
    Metadata(String, BTreeMap<String, String>),
}

/// What both sides know.
#[derive(Debug, Default)]
pub(super) struct Shared {
    samples: AtomicU64,
    cycles: AtomicU64,
    dropped_samples: AtomicU64,
    dropped_cycles: AtomicU64,
    /// Why the disk takes nothing at the moment.
    pub(super) trouble: Mutex<Option<String>>,
    /// Why the file is not complete.
    pub(super) failure: Mutex<Option<String>>,
}

impl Shared {
    pub(super) fn drop_samples(&self, count: u64) {
        self.dropped_samples.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn drop_cycles(&self, count: u64) {
        self.dropped_cycles.fetch_add(count, Ordering::Relaxed);
    }

    /// The storage holds this many samples and cycles.
    pub(super) fn stored(&self, (samples, cycles): (u64, u64)) {
        self.samples.store(samples, Ordering::Relaxed);
        self.cycles.store(cycles, Ordering::Relaxed);
    }

    /// The storage was never to take more: of so many, the rest counts as dropped.
    pub(super) fn never_stored(&self, (samples, cycles): (u64, u64)) {
        let (stored_samples, stored_cycles) = self.in_file();
        self.drop_samples(samples - stored_samples);
        self.drop_cycles(cycles - stored_cycles);
    }

    /// Samples and cycles that the storage holds.
    pub(super) fn in_file(&self) -> (u64, u64) {
        (
            self.samples.load(Ordering::Relaxed),
            self.cycles.load(Ordering::Relaxed),
        )
    }

    /// Samples and cycles that there was no room for.
    pub(super) fn dropped(&self) -> (u64, u64) {
        (
            self.dropped_samples.load(Ordering::Relaxed),
            self.dropped_cycles.load(Ordering::Relaxed),
        )
    }

    pub(super) fn trouble(&self, why: &str) {
        *self.trouble.lock().unwrap_or_else(PoisonError::into_inner) = Some(why.to_owned());
    }

    pub(super) fn fail(&self, why: &str) {
        self.failure
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert_with(|| why.to_owned());
    }
}
