//! UTC of a host time.
//!
//! On a real rig the monotonic clock is read first and UTC right after it. What passes between the
//! two makes the difference too large, so the smallest difference counts. It may grow by 500 ppm,
//! the most by which NTP slews a clock. A larger change means that the clock was set.
//!
//! On an emulated rig host time is that of the emulation. UTC begins with the recording and passes
//! with it.

/// Fastest change of the difference that is followed without an event.
const SLEW: f64 = 500e-6;
/// A difference this much larger for [`SET_AFTER`] readings in a row, or smaller at once, is a
/// clock that was set, ns.
const SET_NS: i64 = 50_000_000;
const SET_AFTER: u32 = 50;

/// UTC minus host time.
#[derive(Debug, Clone)]
pub struct UtcClock {
    emulated: bool,
    start_utc_ns: u64,
    offset_ns: Option<i64>,
    at_host_ns: u64,
    late: u32,
}

impl UtcClock {
    /// For a recording that starts at a UTC, ns since 1970.
    #[must_use]
    pub const fn new(emulated: bool, start_utc_ns: u64) -> Self {
        Self {
            emulated,
            start_utc_ns,
            offset_ns: None,
            at_host_ns: 0,
            late: 0,
        }
    }

    /// Takes host time and UTC of one moment, ns. Returns by how much UTC was set, ns, where it
    /// was.
    pub fn push(&mut self, host_ns: u64, utc_ns: u64) -> Option<i64> {
        let Some(before) = self.offset_ns else {
            let utc_ns = if self.emulated {
                self.start_utc_ns
            } else {
                utc_ns
            };
            self.offset_ns = Some(utc_ns as i64 - host_ns as i64);
            self.at_host_ns = host_ns;
            return None;
        };
        if self.emulated {
            return None;
        }
        let found = utc_ns as i64 - host_ns as i64;
        let may_grow_ns = (host_ns.saturating_sub(self.at_host_ns) as f64 * SLEW) as i64;
        self.at_host_ns = host_ns;
        self.late = if found > before + SET_NS {
            self.late + 1
        } else {
            0
        };
        let set = found < before - SET_NS || self.late >= SET_AFTER;
        if set {
            self.late = 0;
            self.offset_ns = Some(found);
            return Some(found - before);
        }
        self.offset_ns = Some(found.min(before + may_grow_ns));
        None
    }

    /// UTC minus host time, ns.
    #[must_use]
    pub fn offset_ns(&self) -> i64 {
        self.offset_ns.unwrap_or(self.start_utc_ns as i64)
    }

    /// UTC of a host time, ns since 1970.
    #[must_use]
    pub fn of(&self, host_ns: f64) -> u64 {
        u64::try_from(self.offset_ns() + host_ns as i64).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn the_shortest_delay_counts_and_a_slew_is_followed() {
        let mut clock = UtcClock::new(false, 0);
        let utc = |host_ns: u64, delay_ns: u64| 1_700_000_000 * S + host_ns + delay_ns;
        clock.push(0, utc(0, 3_000_000));
        clock.push(S, utc(S, 10_000));
        clock.push(2 * S, utc(2 * S, 8_000_000));
        assert!(clock.offset_ns() <= 1_700_000_000 * S as i64 + 510_000);
        // 100 ppm fast for ten minutes: 60 ms.
        for n in 3..603 {
            clock.push(n * S, utc(n * S, n * 100_000));
        }
        let error = clock.offset_ns() - (1_700_000_000 * S + 602 * 100_000) as i64;
        assert!(error.abs() < 1_000, "{error}");
    }

    #[test]
    fn a_clock_that_is_set_is_told() {
        let mut clock = UtcClock::new(false, 0);
        let mut told = Vec::new();
        for n in 0..400u64 {
            let host_ns = n * S / 100;
            // Set back by a second at 1 s, ahead by two at 2.5 s. A single late reading at 0.5 s is
            // none.
            let set = i64::from(n >= 250) * 2_000_000_000 - i64::from(n >= 100) * 1_000_000_000;
            let late = if n == 50 { 80_000_000 } else { 0 };
            let utc_ns = 1_700_000_000 * S as i64 + host_ns as i64 + set + late;
            told.extend(clock.push(host_ns, utc_ns as u64));
        }
        assert_eq!(told.len(), 2, "{told:?}");
        assert!((told[0] + 1_000_000_000).abs() < 10_000_000);
        assert!((told[1] - 2_000_000_000).abs() < 10_000_000);
    }

    #[test]
    fn an_emulated_rig_has_the_utc_of_its_start_and_its_own_pace() {
        let mut clock = UtcClock::new(true, 1_700_000_000 * S);
        clock.push(5 * S, 1_700_000_000 * S);
        clock.push(605 * S, 1_700_000_001 * S);
        assert_eq!(clock.of(605e9), 1_700_000_600 * S);
    }
}
