//! Random numbers: one seed, many independent streams.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A reproducible stream of random numbers. The same seed and label give the same numbers.
#[derive(Clone, Debug)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream with a label, of a seed. Streams with different labels are independent, so a new
    /// consumer does not shift the numbers of the others.
    pub fn new(seed: u64, label: &str) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(fnv1a(label.as_bytes()));
        Self(rng)
    }

    /// Uniform in [`low`, `high`).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Uniform in the logarithm, in [`low`, `high`); both positive.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    /// Normal with mean 0 and variance 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// -1 or 1.
    pub fn sign(&mut self) -> f64 {
        if self.chance(0.5) {
            1.0
        } else {
            -1.0
        }
    }

    /// An index in 0..`n`; 0 where `n` is 0.
    pub fn index(&mut self, n: usize) -> usize {
        ((self.0.random::<f64>() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// An integer in `low`..=`high`.
    pub fn integer(&mut self, low: usize, high: usize) -> usize {
        low + self.index(high - low + 1)
    }
}

/// FNV-1a hash of bytes, 64 bits (Fowler, Noll, Vo 1991). For stream labels and for the comparison
/// of logs; not a cryptographic hash.
pub fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
