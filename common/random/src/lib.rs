//! Seeded random numbers, the same on every machine and with every version: SplitMix64.
//!
//! Steele, Lea, Flood: *Fast splittable pseudorandom number generators*, OOPSLA 2014, section 4: a
//! 64-bit counter with a mixing function.
//!
//! Uses are independent by their seeds and labels, not by their code: each draws from a stream of
//! its own, so that a new draw somewhere leaves all others as they were. The virtual arm and the
//! second generator of synthetic logs (`robot`, `literature-sets`) draw from ChaCha8 of the crate
//! `rand_chacha` instead, each by its own rule, so that plant, analysis and that generator have no
//! random number in common.

/// One stream of random numbers.
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// The stream that begins at this state.
    #[must_use]
    pub const fn new(state: u64) -> Self {
        Self(state)
    }

    /// The stream `label`, `index` of a `seed`.
    #[must_use]
    pub fn stream(seed: u64, label: &str, index: usize) -> Self {
        // FNV-1a over the label, then the index: any fixed mapping to distinct 64-bit words will
        // do.
        let hash = label
            .bytes()
            .chain((index as u64).to_le_bytes())
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
                (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3)
            });
        Self(Self(seed ^ hash.rotate_left(17)).bits() ^ hash)
    }

    /// The next 64 bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1), 53 bits.
    pub const fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [low, high).
    pub const fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Standard normal (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let (first, second) = (self.unit(), self.unit());
        normal(first, second)
    }

    /// Standard normal, drawn again where it is further than `most` from 0.
    pub fn normal_within(&mut self, most: f64) -> f64 {
        loop {
            let value = self.normal();
            if value.abs() <= most {
                return value;
            }
        }
    }
}

/// Standard normal from two that are uniform in [0, 1) (Box and Muller).
#[must_use]
pub fn normal(first: f64, second: f64) -> f64 {
    (-2.0 * libm::log(1.0 - first)).sqrt() * libm::cos(std::f64::consts::TAU * second)
}

/// Uniform in [0, 1), the same for the same number: the draw of this number from the stream that
/// begins at 0.
#[must_use]
pub const fn of(number: u64) -> f64 {
    SplitMix64(number.wrapping_sub(1).wrapping_mul(STEP)).unit()
}

/// What the counter grows by: 2^64 by the golden section, odd.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

#[cfg(test)]
mod tests {
    use super::{of, SplitMix64};

    #[test]
    fn bits_match_the_published_sequence() {
        // First outputs for state 1234567, as printed in many independent implementations.
        let mut random = SplitMix64::new(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
        let mut random = SplitMix64::new(0);
        for number in 1..4 {
            assert_eq!(of(number), random.unit());
        }
    }

    #[test]
    fn streams_differ_by_seed_label_and_index() {
        let first = |s, l, i| SplitMix64::stream(s, l, i).bits();
        let base = first(1, "friction", 0);
        // Every emulated rig is drawn from these streams: they never change.
        assert_eq!(base, 4_110_884_095_492_099_164);
        assert_ne!(base, first(2, "friction", 0));
        assert_ne!(base, first(1, "path", 0));
        assert_ne!(base, first(1, "friction", 1));
    }

    #[test]
    fn normal_has_unit_variance_and_less_where_it_is_cut() {
        let moments = |draw: fn(&mut SplitMix64) -> f64| {
            let mut random = SplitMix64::stream(3, "test", 0);
            let draws: Vec<f64> = (0..20_000).map(|_| draw(&mut random)).collect();
            let mean = draws.iter().sum::<f64>() / draws.len() as f64;
            let square = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>();
            (mean, square / draws.len() as f64)
        };
        let (mean, variance) = moments(SplitMix64::normal);
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03);
        // Cutting at 2.5 leaves 0.911 of the variance.
        let (mean, variance) = moments(|random| random.normal_within(2.5));
        assert!(mean.abs() < 0.03 && (variance - 0.911).abs() < 0.03);
    }
}
