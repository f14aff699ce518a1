//! Zeros over power-ups: whether a new one is that of a slack cable.

/// Zeros of one unit over its power-ups, oldest first. Between two power-ups the mounting part is
/// the same, so that the change is the converter's.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct History {
    entries: Vec<PowerUp>,
}

/// The zero at one power-up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PowerUp {
    /// Zero, N.
    pub zero_n: f64,
    /// Its standard error, N.
    pub se_n: f64,
    /// Mounting part, N, as [`split`](super::split) gives it.
    pub mounting_n: f64,
}

/// Two zeros that agree within so many of their combined standard errors are of one power-up.
const SAME_POWER_UP_SE: f64 = 5.0;

impl PowerUp {
    /// Whether both zeros are of one power-up: the converter calibrates itself anew at each, and
    /// two calibrations rarely come as near to each other as two measurements of one.
    #[must_use]
    pub fn is_of_the_same_power_up(&self, other: &Self) -> bool {
        (self.zero_n - other.zero_n).abs() <= SAME_POWER_UP_SE * self.se_n.hypot(other.se_n)
    }
}

/// How a new zero compares with the earlier ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// There is nothing to compare with.
    First,
    /// Within what power-ups of this unit do.
    Plausible {
        /// Distance from the expected zero in standard deviations.
        z: f64,
    },
    /// Higher than power-ups explain: the cable may be preloaded by about this force.
    Preloaded {
        /// Force above the expected zero, N.
        excess_n: f64,
        /// Distance in standard deviations.
        z: f64,
    },
    /// Lower than power-ups explain: the unit may have been turned, or the cell damaged.
    Moved {
        /// Force below the expected zero, N, negative.
        change_n: f64,
        /// Distance in standard deviations.
        z: f64,
    },
}

impl Verdict {
    /// Whether the zero may be stored.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        matches!(self, Self::First | Self::Plausible { .. })
    }
}

impl History {
    /// From earlier power-ups, oldest first.
    #[must_use]
    pub fn new(entries: Vec<PowerUp>) -> Self {
        Self { entries }
    }

    /// Adds one that was accepted.
    pub fn push(&mut self, entry: PowerUp) {
        self.entries.push(entry);
    }

    /// Adds one that was accepted; a zero of the same power-up as the last one takes its place.
    /// Returns whether it did.
    pub fn add(&mut self, entry: PowerUp) -> bool {
        let repeats = self
            .entries
            .last()
            .is_some_and(|last| last.is_of_the_same_power_up(&entry));
        if repeats {
            self.entries.pop();
        }
        self.entries.push(entry);
        repeats
    }

    /// The entries, oldest first.
    #[must_use]
    pub fn entries(&self) -> &[PowerUp] {
        &self.entries
    }

    /// The converter's offset that a further power-up is expected to show, N, and the standard
    /// deviation of one power-up's offset about it, N. The latter is pulled towards `prior_n` as if
    /// that had been seen in [`PRIOR_POWER_UPS`] power-ups. `None` without an entry.
    #[must_use]
    pub fn expected_n(&self, prior_n: f64) -> Option<(f64, f64)> {
        let recent = &self.entries[self.entries.len().saturating_sub(RECENT)..];
        if recent.is_empty() {
            return None;
        }
        let count = recent.len() as f64;
        let mean = recent.iter().map(converter_n).sum::<f64>() / count;
        let squares: f64 = recent
            .iter()
            .map(|entry| (converter_n(entry) - mean).powi(2))
            .sum();
        let variance =
            (PRIOR_POWER_UPS * prior_n * prior_n + squares) / (PRIOR_POWER_UPS + count - 1.0);
        Some((mean, variance.sqrt()))
    }

    /// Compares a new zero with the earlier ones in two ways; it has to pass both.
    ///
    /// * Its distance from the mean of the earlier ones in standard deviations, against `limit_sd`:
    ///   each power-up's calibration misses the same offset of the bridge anew and independently
    ///   (device facts, NAU7802), and a unit's own spread is learnt.
    /// * The range that the earlier ones leave. A calibration misses by `miss_n` (N) at most, so
    ///   every zero bounds the bridge's offset from both sides, and the offset bounds the next
    ///   zero. Where the earlier ones lie further apart than that, half their range stands for
    ///   `miss_n`.
    #[must_use]
    pub fn judge(&self, new: &PowerUp, miss_n: f64, limit_sd: f64) -> Verdict {
        let Some((expected, spread)) = self.expected_n(miss_n / 3f64.sqrt()) else {
            return Verdict::First;
        };
        let change = converter_n(new) - expected;
        let count = self.entries.len().min(RECENT) as f64;
        let sd = (spread * spread * (1.0 + 1.0 / count) + new.se_n * new.se_n).sqrt();
        let z = change / sd;
        let (low, high) = self.range_n(miss_n);
        let reading = 4.0 * new.se_n;
        let within = (low - reading..=high + reading).contains(&converter_n(new));
        // Written so that NaN is not plausible.
        if z.abs() <= limit_sd && within {
            Verdict::Plausible { z }
        } else if z < 0.0 {
            Verdict::Moved {
                change_n: change,
                z,
            }
        } else {
            Verdict::Preloaded {
                excess_n: change,
                z,
            }
        }
    }

    /// Least and largest converter's offset that the earlier power-ups leave possible, N.
    fn range_n(&self, miss_n: f64) -> (f64, f64) {
        let recent = self.entries.iter().rev().take(RECENT);
        let (mut least, mut largest) = (f64::INFINITY, f64::NEG_INFINITY);
        for entry in recent {
            least = least.min(converter_n(entry));
            largest = largest.max(converter_n(entry));
        }
        let miss = miss_n.max(0.5 * (largest - least));
        (largest - 2.0 * miss, least + 2.0 * miss)
    }
}

/// Power-ups that count as seen with the expected spread.
pub const PRIOR_POWER_UPS: f64 = 3.0;
/// The last so many power-ups are looked at: older ones may be of before a drift of the bridge.
const RECENT: usize = 20;

fn converter_n(entry: &PowerUp) -> f64 {
    entry.zero_n - entry.mounting_n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preloaded_cable_is_not_taken_for_a_zero() {
        let at = |zero_n| PowerUp {
            zero_n,
            se_n: 0.001,
            mounting_n: 2.0,
        };
        let history = History::new(vec![at(2.10), at(2.12), at(2.09), at(2.11)]);
        assert!(history.judge(&at(2.14), 0.1, 4.0).is_accepted());
        assert!(matches!(
            history.judge(&at(4.1), 0.1, 4.0),
            Verdict::Preloaded { excess_n, .. } if (excess_n - 1.995).abs() < 1e-9
        ));
        assert!(matches!(
            history.judge(&at(1.1), 0.1, 4.0),
            Verdict::Moved { .. }
        ));
        assert!(!history.judge(&at(f64::NAN), 0.1, 4.0).is_accepted());
        assert_eq!(History::default().judge(&at(9.0), 0.1, 4.0), Verdict::First);
        // A unit that was turned knows its new mounting part; the converter's offset has not moved.
        let turned = PowerUp {
            zero_n: 1.11,
            se_n: 0.001,
            mounting_n: 1.0,
        };
        assert!(history.judge(&turned, 0.1, 4.0).is_accepted());
    }

    #[test]
    fn a_zero_measured_again_is_no_further_power_up() {
        let at = |zero_n| PowerUp {
            zero_n,
            se_n: 0.0001,
            mounting_n: 2.0,
        };
        let mut history = History::default();
        assert!(!history.add(at(2.1)));
        // 0.5 mN away, with 0.14 mN for both together.
        assert!(history.add(at(2.1005)));
        assert_eq!(history.entries(), [at(2.1005)]);
        assert!(!history.add(at(2.102)));
        // The last one only: an earlier power-up does not come back.
        assert!(!history.add(at(2.1005)));
        assert!(!history.add(at(f64::NAN)));
        assert_eq!(history.entries().len(), 4);
    }

    #[test]
    fn earlier_power_ups_bound_the_next_one() {
        let at = |zero_n| PowerUp {
            zero_n,
            se_n: 0.0005,
            mounting_n: 0.0,
        };
        // The bridge's offset is 0: both ends of the range have been seen, so nothing above 0.3 N
        // is a slack cable.
        let history = History::new([-0.29, 0.28, 0.1, -0.1, 0.2].map(at).to_vec());
        assert!(history.judge(&at(0.29), 0.3, 3.0).is_accepted());
        assert!(matches!(
            history.judge(&at(0.36), 0.3, 3.0),
            Verdict::Preloaded { .. }
        ));
        assert!(matches!(
            history.judge(&at(-0.4), 0.3, 3.0),
            Verdict::Moved { .. }
        ));
        // A unit that misses by more than it should is judged by its own range.
        let wide = History::new([-0.5, 0.5, 0.3, -0.4, 0.1].map(at).to_vec());
        assert!(wide.judge(&at(0.45), 0.3, 3.0).is_accepted());
    }
}
