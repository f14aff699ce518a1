//! From samples to batches: holds a sample until its DAC word is sent, decimates per link, fills
//! frames.

use control::{Micros, UnitIndex, UNITS};
use heapless::Vec;
use wire::message::{Batch, Sample, BATCH};

/// A batch that isn't full is sent when its first sample is this old, in microseconds.
pub const FLUSH_US: u32 = 5_000;

/// Samples whose DAC word is not sent yet, one for each unit.
#[derive(Debug, Clone, Default)]
pub struct Outstanding {
    samples: [Option<(Micros, Sample)>; UNITS],
}

impl Outstanding {
    /// Holds a sample of the DRDY edge `at` until its word is sent. Returns the previous sample if
    /// its word was never sent; its latency is then 65,535.
    pub fn insert(
        &mut self,
        unit: UnitIndex,
        at: Micros,
        sample: Sample,
    ) -> Option<(Micros, Sample)> {
        let slot = &mut self.samples[unit as usize];
        slot.replace((at, sample)).map(|(at, mut late)| {
            late.latency_us = u16::MAX;
            (at, late)
        })
    }

    /// The word of this unit was sent at `now`: its sample is complete.
    pub fn complete(&mut self, unit: UnitIndex, now: Micros) -> Option<(Micros, Sample)> {
        let (at, mut sample) = self.samples[unit as usize].take()?;
        sample.latency_us = u16::try_from(now.since(at)).unwrap_or(u16::MAX);
        Some((at, sample))
    }
}

/// Fills the batches of one link.
#[derive(Debug, Clone, Default)]
pub struct Batcher {
    first: Micros,
    samples: Vec<Sample, BATCH>,
    seen: [u8; UNITS],
}

impl Batcher {
    /// Takes a sample of the DRDY edge `at`; returns a full batch. `decimation`: one sample in this
    /// many is sent, 0: none.
    pub fn push(&mut self, at: Micros, mut sample: Sample, decimation: u8) -> Option<Batch> {
        let seen = self.seen.get_mut(usize::from(sample.unit))?;
        *seen = seen.saturating_add(1);
        if decimation == 0 || *seen < decimation {
            return None;
        }
        *seen = 0;
        // A gap that does not fit into 16 bits starts another batch.
        let full = if !self.samples.is_empty() && self.first.until(at).unsigned_abs() > 60_000 {
            self.take()
        } else {
            None
        };
        if self.samples.is_empty() {
            self.first = at;
        }
        // The bus may have read a later edge first: the earliest edge is the time of the batch.
        let early = at.until(self.first);
        if early > 0 {
            self.first = at;
            for other in &mut self.samples {
                other.dt_us = other.dt_us.saturating_add(early as u16);
            }
        }
        sample.dt_us = at.since(self.first) as u16;
        // Never full here: a full batch is returned at once.
        let _ = self.samples.push(sample);
        full.or_else(|| {
            if self.samples.is_full() {
                self.take()
            } else {
                None
            }
        })
    }

    /// The batch in progress, if it is old enough.
    pub fn flush(&mut self, now: Micros) -> Option<Batch> {
        if !self.samples.is_empty() && self.first.until(now) > FLUSH_US.cast_signed() {
            self.take()
        } else {
            None
        }
    }

    fn take(&mut self) -> Option<Batch> {
        (!self.samples.is_empty()).then(|| Batch {
            t_us: self.first.0,
            samples: core::mem::take(&mut self.samples),
        })
    }
}
