//! Small watchers: a rate bounded from above and below, setpoints that expire, and the check-in
//! that stands before the watchdog.

use crate::config::Config;
use crate::friction::STILL_SWING;
use crate::units::{EncoderCounts, Micros, Newton};

/// Result of a rate check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Within its bounds.
    Ok,
    /// Nothing for longer than `silent_us`.
    Silent,
    /// The averaged period, in microseconds, is above the bound.
    TooSlow(u32),
    /// The averaged period, in microseconds, is below the bound.
    TooFast(u32),
}

/// Bounds of a rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RateLimits {
    /// Shortest averaged period in microseconds.
    pub min_us: u32,
    /// Longest averaged period in microseconds.
    pub max_us: u32,
    /// Longest gap in microseconds.
    pub silent_us: u32,
}

impl RateLimits {
    /// Of a load-cell converter: 320 SPS +-3 % by its oscillator, plus 2 % for what the datasheet
    /// does not promise (297 to 344 SPS), and silent after four conversions.
    pub const SENSOR: Self = Self {
        min_us: 2_900,
        max_us: 3_370,
        silent_us: 12_500,
    };
}

/// Watches how often something happens. The average is a first-order one over 16 periods, so a
/// single late edge is not a slow rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rate {
    last: Option<Micros>,
    /// Average period in microseconds times 256; 0: not known.
    average_q8: u32,
    /// Periods seen, up to [`Self::SETTLED`].
    seen: u8,
}

impl Rate {
    /// Periods before the average is judged.
    const SETTLED: u8 = 32;

    /// Forgets everything; use it when the source is started again.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Records an event after `missed` unnoticed ones (each counts as a period of its own).
    pub fn observe(&mut self, at: Micros, missed: u8) {
        if let Some(last) = self.last {
            let whole = at.since(last).min(1 << 20);
            let period_q8 = (whole << 8) / (u32::from(missed) + 1);
            self.average_q8 = if self.average_q8 == 0 {
                period_q8
            } else {
                self.average_q8 - (self.average_q8 >> 4) + (period_q8 >> 4)
            };
            self.seen = (self.seen + 1).min(Self::SETTLED);
        }
        self.last = Some(at);
    }

    /// Checks the rate at `now`. `Ok` for a source without any event yet: its bring-up reports
    /// that.
    #[must_use]
    pub fn check(&self, now: Micros, limits: &RateLimits) -> Verdict {
        let Some(last) = self.last else {
            return Verdict::Ok;
        };
        let gap = now.since(last);
        // An observation newer than `now` (an interrupt came between) wraps to a huge gap.
        if gap > limits.silent_us && gap < u32::MAX / 2 {
            return Verdict::Silent;
        }
        if self.seen < Self::SETTLED {
            return Verdict::Ok;
        }
        match self.period_us() {
            period if period > limits.max_us => Verdict::TooSlow(period),
            period if period < limits.min_us => Verdict::TooFast(period),
            _ => Verdict::Ok,
        }
    }

    /// Averaged period in microseconds; 0: not known.
    #[must_use]
    pub const fn period_us(&self) -> u32 {
        self.average_q8 >> 8
    }

    /// Time of the last event.
    #[must_use]
    pub const fn last(&self) -> Option<Micros> {
        self.last
    }
}

/// The time until which setpoints may be held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Expiry {
    renewed: Option<(Micros, u32)>,
}

impl Expiry {
    /// New setpoints came; they hold for `valid_ms`, brought into 1 to 1,000.
    pub fn renew(&mut self, now: Micros, valid_ms: u16) {
        self.renewed = Some((now, u32::from(valid_ms.clamp(1, 1_000)) * 1_000));
    }

    /// There are no setpoints any more (disarmed, stopped).
    pub fn forget(&mut self) {
        self.renewed = None;
    }

    /// Whether setpoints are in force at all and have run out. Call it at least every half hour, or
    /// the wrap of the clock makes expired setpoints valid again; the supervisor calls it every
    /// millisecond.
    #[must_use]
    pub fn is_expired(&self, now: Micros) -> bool {
        self.renewed
            .is_some_and(|(at, valid_us)| now.since(at) > valid_us)
    }

    /// Whether setpoints are in force and have not run out.
    #[must_use]
    pub fn is_valid(&self, now: Micros) -> bool {
        self.renewed
            .is_some_and(|(at, valid_us)| now.since(at) <= valid_us)
    }

    /// Age in milliseconds; 65,535: none.
    #[must_use]
    pub fn age_ms(&self, now: Micros) -> u16 {
        self.renewed.map_or(u16::MAX, |(at, _)| {
            u16::try_from(now.since(at) / 1_000).unwrap_or(u16::MAX - 1)
        })
    }
}

/// Parts that must all have checked in before the watchdog is fed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CheckIn {
    required: u32,
    seen: u32,
}

impl CheckIn {
    /// Requires every part whose bit is set in `required`.
    #[must_use]
    pub const fn new(required: u32) -> Self {
        Self { required, seen: 0 }
    }

    /// Records that the part with this bit number has run. A number above 31 is ignored.
    pub fn check_in(&mut self, part: u32) {
        self.seen |= 1u32.checked_shl(part).unwrap_or(0);
    }

    /// Bits of the parts that have not checked in yet.
    #[must_use]
    pub const fn missing(&self) -> u32 {
        self.required & !self.seen
    }

    /// Whether every required part has checked in. If so, the next round begins.
    #[must_use]
    pub fn complete(&mut self) -> bool {
        let complete = self.missing() == 0;
        if complete {
            self.seen = 0;
        }
        complete
    }
}

/// Counts within which an encoder counts as standing still: its jitter and half a count of play.
const STILL_COUNTS: u64 = 2;

/// Swing of the tension itself below which nothing shows that the reel moves: a motor without power
/// leaves its reel at rest and the tension at what friction holds, while the command rises.
const STILL_TENSION: Newton = Newton::from_un(2_000_000);

/// Samples for which the swing has to stand, 25 ms: a cable that something pulls is over-tension
/// before that.
const STILL_SAMPLES: u8 = 8;

/// Samples behind a spike that are not compared, 12.5 ms: the settling time of the converter's
/// filter. A cable that closes jumps as a spike does, and the command answers before the tension
/// is seen.
const SETTLING_SAMPLES: u8 = 4;

/// Watches an encoder by what the tension does: one that stands still while tension and command
/// differ further than a resting reel allows is unplugged or broken. Without it the loop has
/// neither damping nor direction estimate and oscillates between slack and limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncoderWatch {
    still: Option<Still>,
    /// Samples until the tension is that of the cable again.
    settles: u8,
}

/// Where the encoder stands, and what the reel must have held since.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Still {
    at: EncoderCounts,
    low: Newton,
    high: Newton,
    /// Lowest and highest tension.
    tension: (Newton, Newton),
    beyond: u8,
}

impl EncoderWatch {
    /// One sample of a unit whose motor acts. `spike`: the tension is an earlier one. The swing of
    /// tension less command, when it is more than a reel with this friction can hold.
    pub fn observe(
        &mut self,
        config: &Config,
        counts: EncoderCounts,
        tension: Newton,
        command: Newton,
        spike: bool,
    ) -> Option<Newton> {
        self.settles = if spike {
            SETTLING_SAMPLES
        } else {
            self.settles.saturating_sub(1)
        };
        // Not one that was elsewhere while the tension settled.
        self.still = self
            .still
            .filter(|still| still.at.0.abs_diff(counts.0) <= STILL_COUNTS);
        if self.settles > 0 {
            return None;
        }
        let held = tension.saturating_sub(command);
        let still = self.still.get_or_insert(Still {
            at: counts,
            low: held,
            high: held,
            tension: (tension, tension),
            beyond: 0,
        });
        still.low = still.low.min(held);
        still.high = still.high.max(held);
        let (least, most) = (still.tension.0.min(tension), still.tension.1.max(tension));
        still.tension = (least, most);
        let swing = still.high.saturating_sub(still.low);
        let turns = swing > STILL_SWING && most.saturating_sub(least) > STILL_TENSION;
        if turns && swing > config.still_swing() {
            still.beyond = still.beyond.saturating_add(1);
        }
        (still.beyond >= STILL_SAMPLES).then_some(swing)
    }
}
