//! A clock that is never asked for its time: a robot that publishes states with its own stamps.
//!
//! An arrival bounds the offset from above: our time is at least the sender's plus the offset.
//! Nothing bounds it from below, so a least delay has to be assumed: in each second, at least one
//! message takes no longer than this from its stamp to its arrival. Then the fastest message of
//! each second bounds the offset from both sides, and [`BoardClock`] does the rest. Offset and
//! uncertainty are as good as the assumption.

use super::{Bin, BoardClock, Bound, Estimate};

/// Time of the sender in which the fastest message is looked for, us.
const BLOCK_US: u64 = 1_000_000;
/// Largest drift of two computers' clocks that is covered: crystals have 50 ppm, NTP slews by 500
/// ppm at most.
const DRIFT_MAX: f64 = 5e-4;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct OneWayClock {
    clock: BoardClock,
    least_delay_ns: i64,
    /// The fastest message of the block that is not complete, and the sender's time at which the
    /// block ends, us.
    fastest: Option<Bound>,
    until_us: u64,
}

impl OneWayClock {
    /// For messages of which at least one in a second takes at most `least_delay_s`.
    #[must_use]
    pub fn new(least_delay_s: f64) -> Self {
        Self {
            clock: BoardClock::live().with_drift_max(DRIFT_MAX),
            least_delay_ns: (least_delay_s * 1e9) as i64,
            fastest: None,
            until_us: 0,
        }
    }

    /// A message that was stamped at `sent_us` by the sender's clock arrived at `received_ns` by
    /// ours. Returns whether the estimate has changed for good.
    pub fn push(&mut self, sent_us: u64, received_ns: u64) -> bool {
        let completed = self.fastest.is_some() && sent_us >= self.until_us;
        if completed {
            let bin = self.open();
            self.fastest = None;
            self.clock.push_bin(bin);
        }
        if self.fastest.is_none() {
            self.until_us = sent_us + BLOCK_US;
        }
        let bound = Bound {
            board_us: sent_us,
            offset_ns: received_ns as i64 - (sent_us as i64).saturating_mul(1000),
        };
        if self.fastest.is_none_or(|b| bound.offset_ns <= b.offset_ns) {
            self.fastest = Some(bound);
        }
        completed
    }

    /// Bounds by the block that is not complete.
    fn open(&self) -> Bin {
        Bin {
            upper: self.fastest,
            lower: self.fastest.map(|bound| Bound {
                offset_ns: bound.offset_ns - self.least_delay_ns,
                ..bound
            }),
        }
    }

    /// Offset and drift at a time of the sender, us; `None` before the first message.
    #[must_use]
    pub fn at(&self, sent_us: u64) -> Option<Estimate> {
        if let Some(estimate) = self.clock.at(sent_us) {
            return Some(estimate);
        }
        // Within the first block, what it holds so far has to do.
        let mut first = BoardClock::live().with_drift_max(DRIFT_MAX);
        first.push_bin(self.open());
        first.at(sent_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages each 10 ms for a minute whose delays are 0.3 to 9.3 ms, on a clock that drifts.
    fn clock(drift: f64, least_ms: f64, seconds: u64) -> OneWayClock {
        let mut clock = OneWayClock::new(2e-3);
        for n in 0..seconds * 100 {
            let sent_us = 1_700_000_000_000_000 + n * 10_000;
            let delay_ms = least_ms + (n * 7 % 10) as f64;
            clock.push(
                sent_us,
                true_ns(drift, n * 10_000) + (delay_ms * 1e6) as u64,
            );
        }
        clock
    }

    /// Our time when the sender's clock shows `passed_us` since its start, ns.
    fn true_ns(drift: f64, passed_us: u64) -> u64 {
        100_000_000_000 + (passed_us as f64 * 1e3 * (1.0 + drift)) as u64
    }

    #[test]
    fn the_truth_is_within_the_uncertainty_which_is_half_the_least_delay() {
        for drift in [-4e-4, 0.0, 50e-6, 4e-4] {
            for seconds in [1, 3, 60, 200] {
                let clock = clock(drift, 0.3, seconds);
                let at_us = seconds * 1_000_000 - 10_000;
                let estimate = clock.at(1_700_000_000_000_000 + at_us).unwrap();
                let error_ns = estimate.host_ns(estimate.board_us) - true_ns(drift, at_us) as f64;
                assert!(
                    error_ns.abs() <= estimate.uncertainty_ns + 500.0,
                    "{drift} {seconds}: {error_ns} {estimate:?}"
                );
                assert!(estimate.uncertainty_ns < 2.1e6, "{seconds}: {estimate:?}");
            }
        }
    }

    #[test]
    fn nothing_is_known_before_the_first_message_and_a_wrong_assumption_shows_as_an_offset() {
        assert!(OneWayClock::new(2e-3).at(5).is_none());
        // Every message takes 5 ms and more: the offset is too large by what the assumption misses.
        let estimate = clock(0.0, 5.0, 60).at(1_700_000_059_990_000).unwrap();
        let error_ns = estimate.host_ns(estimate.board_us) - true_ns(0.0, 59_990_000) as f64;
        assert!((3.9e6..=4.1e6).contains(&error_ns), "{error_ns}");
    }
}
