//! The rig's own random numbers: small, seeded, the same on every machine.
//!
//! Each device draws from a stream of its own (seed and a label), so that adding a device or
//! drawing once more in one of them leaves every other device's numbers as they were.

use random::SplitMix64;

/// A stream of one device.
#[derive(Debug, Clone)]
pub struct Rng {
    random: SplitMix64,
    spare: Option<f64>,
}

impl Rng {
    /// The stream of `label` under `seed`. Different labels give unrelated streams.
    #[must_use]
    pub fn new(seed: u64, label: u64) -> Self {
        let mut random = SplitMix64::new(seed ^ label.wrapping_mul(0xD1B5_4A32_D192_ED03));
        random.bits();
        Self {
            random,
            spare: None,
        }
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.random.unit()
    }

    /// Uniform in [-1, 1).
    pub fn uniform_signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    /// Normal with mean 0 and variance 1 (Marsaglia's polar method).
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (x, y) = (self.uniform_signed(), self.uniform_signed());
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                let scale = (-2.0 * square.ln() / square).sqrt();
                self.spare = Some(y * scale);
                return x * scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ_by_label() {
        let draw = |seed, label| {
            let mut rng = Rng::new(seed, label);
            (0..8).map(|_| rng.uniform()).collect::<Vec<_>>()
        };
        assert_eq!(draw(1, 2), draw(1, 2));
        assert_ne!(draw(1, 2), draw(1, 3));
        assert_ne!(draw(1, 2), draw(2, 2));
    }

    #[test]
    fn normal_has_mean_zero_and_variance_one() {
        let mut rng = Rng::new(7, 0);
        let draws: Vec<f64> = (0..100_000).map(|_| rng.normal()).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.02, "{mean}");
        assert!((variance - 1.0).abs() < 0.02, "{variance}");
    }
}
