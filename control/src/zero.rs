//! Averaging the zero of a load cell, with a check that the cable is slack and at rest.
//!
//! Zero moves with the unit's weight and mounting angle and a little with each calibration of the
//! converter (thesis 3.5.1; device-facts: 0.5 to 1 % steps), so it is taken anew at each start,
//! cables slack. A zero far from the one that was stored with the calibration is no zero: a cable
//! under load would read too little from then on, and its motor pull too much.

use crate::friction::travel;
use crate::units::{AdcCode, EncoderCounts};

/// Samples of an average: 0.8 s at 320 SPS, which takes the standard error of 5 mN noise to 0.3 mN
/// and is 40 periods of 50 Hz mains.
pub const SAMPLES: u16 = 256;

/// Largest difference between two samples of a steady cell, in counts: 35,000 are 0.24 N. Measured
/// idle noise is 1.7 to 5 mN SD, so 256 samples spread over less than 0.04 N; a cable that is
/// touched or a unit that swings spreads over more than 0.3 N.
pub const MAX_SPREAD: u32 = 35_000;

/// Travel of the reel meanwhile that makes a zero none, in nanometres: twice what a presliding
/// contact springs back (50 um). A slack cable turns no reel: a robot that moves does, by a cable
/// that friction of the reel holds tight.
pub const MAX_TRAVEL_NM: i32 = 100_000;

/// Why there is no zero. [`Refused::detail`] is the number that fault pages and telemetry show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// The samples lie this many counts apart: the cable moves.
    Unsteady(u32),
    /// The mean is this many counts from the stored zero: the cable is under load, or the cell is
    /// another one.
    FarOff(i32),
    /// The converter stands at the end of its range.
    Saturated,
    /// The reel turned by this many nanometres of cable: the cable is tight, and the robot moves.
    Turned(i32),
}

/// Result after a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// This many samples are still to come.
    Collecting(u16),
    /// The zero.
    Done(AdcCode),
    /// No zero, and why.
    Refused(Refused),
}

/// Averages one unit's zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Averager {
    sum: i64,
    seen: u16,
    low: i32,
    high: i32,
    /// The zero found when the unit was calibrated, and how far a new one may be from it, in
    /// counts.
    stored: i32,
    deviation: u32,
    /// The encoder at the first sample.
    began: Option<EncoderCounts>,
}

impl Averager {
    /// Starts an average that is refused further than `deviation` counts from the `stored` zero.
    #[must_use]
    pub const fn new(stored: i32, deviation: u32) -> Self {
        Self {
            sum: 0,
            seen: 0,
            low: i32::MAX,
            high: i32::MIN,
            stored,
            deviation,
            began: None,
        }
    }

    /// The encoder at a sample; call it before [`Self::push`]. Why there is no zero, where the reel
    /// has turned.
    pub fn turned(&mut self, counts: EncoderCounts, nm_per_count: i32) -> Option<Refused> {
        let began = *self.began.get_or_insert(counts);
        let travel_nm = travel(began, counts, nm_per_count);
        (travel_nm.saturating_abs() > MAX_TRAVEL_NM).then_some(Refused::Turned(travel_nm))
    }

    /// Takes a sample. After `Done` or `Refused` a new average begins with the next sample.
    pub fn push(&mut self, code: AdcCode) -> Progress {
        if code.is_saturated() {
            *self = Self::new(self.stored, self.deviation);
            return Progress::Refused(Refused::Saturated);
        }
        let value = code.get();
        self.sum += i64::from(value);
        self.seen += 1;
        self.low = self.low.min(value);
        self.high = self.high.max(value);
        if self.seen < SAMPLES {
            return Progress::Collecting(SAMPLES - self.seen);
        }
        let spread = self.high.abs_diff(self.low);
        let samples = i64::from(SAMPLES);
        // Rounded to nearest; not in the sample path, so a division is fine.
        let mean = (self.sum + samples / 2).div_euclid(samples) as i32;
        *self = Self::new(self.stored, self.deviation);
        if spread > MAX_SPREAD {
            Progress::Refused(Refused::Unsteady(spread))
        } else if mean.abs_diff(self.stored) > self.deviation {
            Progress::Refused(Refused::FarOff(mean.saturating_sub(self.stored)))
        } else {
            Progress::Done(AdcCode::new(mean))
        }
    }
}

impl Refused {
    /// Detail of [`crate::Fault::ZeroRefused`]: 0 saturated; otherwise the spread or the code's
    /// magnitude in counts, with bit 31 set where it is a code; with bit 30 set the travel's size
    /// in micrometres.
    #[must_use]
    pub const fn detail(self) -> u32 {
        match self {
            Self::Saturated => 0,
            Self::Unsteady(spread) => spread,
            Self::Turned(travel_nm) => (travel_nm.unsigned_abs() / 1_000) | (1 << 30),
            Self::FarOff(code) => code.unsigned_abs() | 1 << 31,
        }
    }
}
