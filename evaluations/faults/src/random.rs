//! Numbers from a seed: one stream for each case, so that a case is the same in every shard and
//! order.

use random::SplitMix64;

/// A stream of numbers.
#[derive(Debug, Clone)]
pub struct Random(SplitMix64);

impl Random {
    /// The stream of `seed` with this number.
    #[must_use]
    pub fn stream(seed: u64, number: u64) -> Self {
        let state = seed ^ number.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut random = Self(SplitMix64::new(state));
        random.bits();
        random
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// A whole number from 0 to `count - 1`.
    pub fn below(&mut self, count: u64) -> u64 {
        self.bits() % count.max(1)
    }

    /// A number from 0 to 1.
    pub fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// A number between two.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.uniform(low, high)
    }

    /// Standard normal, near enough: a sum of twelve.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}
