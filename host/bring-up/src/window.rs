//! Samples of all units over a time: where they rest, and how far they go.

use crate::spectrum;
use rig::Rig;
use session::{Session, SessionError, TimedSample};
use std::time::Duration;
use wire::UNITS;

/// Samples whose mean counts as a code: 12.5 ms, what the converter's filter takes.
const MEAN_OF: usize = 4;

/// Time over which a place of rest is measured.
pub(crate) const REST: Duration = Duration::from_millis(400);

/// Samples of all units.
#[derive(Debug, Default)]
pub(crate) struct Window {
    codes: [Vec<f64>; UNITS],
    counts: [Vec<i32>; UNITS],
    span_us: [Option<(u64, u64)>; UNITS],
}

impl Window {
    /// What arrives in `duration`.
    pub fn over(session: &mut Session<'_>, duration: Duration) -> Result<Self, SessionError> {
        session.drain();
        let end_ns = session.now_ns() + duration.as_nanos() as u64;
        while session.now_ns() < end_ns {
            session.exchange(session::PERIOD)?;
        }
        Ok(Self::of(&session.drain().samples))
    }

    /// These samples.
    pub fn of(samples: &[TimedSample]) -> Self {
        let mut window = Self::default();
        for timed in samples {
            let unit = usize::from(timed.sample.unit);
            if unit >= UNITS {
                continue;
            }
            window.codes[unit].push(f64::from(timed.sample.adc_code));
            window.counts[unit].push(timed.sample.encoder_counts);
            let first = window.span_us[unit].map_or(timed.t_us, |(first, _)| first);
            window.span_us[unit] = Some((first, timed.t_us));
        }
        window
    }

    /// Samples of a unit.
    pub fn samples(&self, unit: usize) -> usize {
        self.codes[unit].len()
    }

    /// Time from a unit's first sample to its last, s.
    pub fn seconds(&self, unit: usize) -> f64 {
        self.span_us[unit].map_or(0.0, |(first, last)| (last - first) as f64 * 1e-6)
    }

    /// Mean code of a unit; `None` without a sample.
    pub fn mean_code(&self, unit: usize) -> Option<f64> {
        mean(&self.codes[unit])
    }

    /// Standard deviation of a unit's codes.
    pub fn code_sd(&self, unit: usize) -> f64 {
        let codes = &self.codes[unit];
        let Some(middle) = mean(codes) else {
            return 0.0;
        };
        let sum: f64 = codes.iter().map(|code| (code - middle).powi(2)).sum();
        (sum / (codes.len().max(2) - 1) as f64).sqrt()
    }

    /// The tone that stands out of a unit's codes: frequency, Hz, and amplitude.
    pub fn tone(&self, unit: usize) -> Option<(f64, f64)> {
        let codes = &self.codes[unit];
        spectrum::strongest(codes, (codes.len().max(1) - 1) as f64 / self.seconds(unit))
    }

    /// Last position of a unit's encoder.
    pub fn last_counts(&self, unit: usize) -> Option<i32> {
        self.counts[unit].last().copied()
    }

    /// Position of a unit's encoder that is furthest from `from`, as the difference, counts.
    pub fn furthest_counts(&self, unit: usize, from: i32) -> i32 {
        (self.counts[unit].iter())
            .map(|counts| counts.wrapping_sub(from))
            .max_by_key(|difference| difference.unsigned_abs())
            .unwrap_or(0)
    }

    /// Mean of four codes of a unit in a row that is furthest from `from`, as the difference.
    pub fn furthest_code(&self, unit: usize, from: f64) -> f64 {
        (self.codes[unit].windows(MEAN_OF))
            .filter_map(|codes| Some(mean(codes)? - from))
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(0.0)
    }
}

pub(crate) fn mean(codes: &[f64]) -> Option<f64> {
    (!codes.is_empty()).then(|| codes.iter().sum::<f64>() / codes.len() as f64)
}

/// Load-cell force per code of each unit, N.
pub(crate) fn scales(rig: &Rig) -> [f64; UNITS] {
    rig.units.map(|unit| unit.scale_n_per_count)
}

/// Where all units rest: codes and counts; 0 for a unit without a sample.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Rest {
    pub code: [f64; UNITS],
    pub counts: [i32; UNITS],
}

impl Rest {
    pub fn of(window: &Window) -> Self {
        Self {
            code: std::array::from_fn(|unit| window.mean_code(unit).unwrap_or(0.0)),
            counts: std::array::from_fn(|unit| window.last_counts(unit).unwrap_or(0)),
        }
    }
}
