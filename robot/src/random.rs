//! Random numbers from a seed: one stream for each use, so that a new draw somewhere leaves all
//! others as they were.
//!
//! ChaCha8 has a defined output (`rand_chacha` promises value stability), so a seed means the same
//! robot and the same path on every machine and with every version of this crate.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One stream.
#[derive(Debug, Clone)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream `label`, `index` of `seed`.
    #[must_use]
    pub fn stream(seed: u64, label: &str, index: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&index.to_le_bytes());
        // Labels of this crate are short and differ in their first 16 bytes.
        for (slot, byte) in key[16..].iter_mut().zip(label.bytes()) {
            *slot = byte;
        }
        Self(ChaCha8Rng::from_seed(key))
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0.random::<f64>()
    }

    /// Uniform between the two.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in the logarithm between the two, both positive.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * libm::pow(high / low, self.unit())
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        let (first, second) = (self.unit(), self.unit());
        random::normal(first, second)
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn streams_differ_by_seed_label_and_index_and_repeat() {
        let first = |seed, label, index| Random::stream(seed, label, index).unit();
        let base = first(1, "friction", 0);
        assert_eq!(base, first(1, "friction", 0));
        for other in [
            first(2, "friction", 0),
            first(1, "path", 0),
            first(1, "friction", 1),
        ] {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn log_uniform_stays_within_and_halves_at_the_geometric_mean() {
        let mut random = Random::stream(3, "test", 0);
        let draws: Vec<f64> = (0..4000).map(|_| random.log_uniform(0.1, 10.0)).collect();
        assert!(draws.iter().all(|d| (0.1..=10.0).contains(d)));
        let below = draws.iter().filter(|d| **d < 1.0).count() as f64 / 4000.0;
        assert!((below - 0.5).abs() < 0.03, "{below}");
    }
}
