//! How fast a force may change.
//!
//! A slow ramp moves by few steps of [`Newton`] a sample, and the rounding errors of the steps
//! would add up. So a ramp has 26 more fraction bits.

use crate::units::Newton;

/// Whole numbers that have an opposite, the smallest one included.
pub(crate) trait Signed: Ord + Copy {
    /// The opposite; that of the smallest number is the largest.
    fn opposite(self) -> Self;
}

impl Signed for i32 {
    fn opposite(self) -> Self {
        self.saturating_neg()
    }
}

impl Signed for i64 {
    fn opposite(self) -> Self {
        self.saturating_neg()
    }
}

/// Not further from zero than `bound`, which is not negative. Unlike `clamp` it can't panic
/// whatever the bound is, so no panic is linked into the sample path: a bit of a bound that changes
/// in memory may make it negative until the configuration's sum is checked.
pub(crate) fn clamp_abs<T: Signed>(value: T, bound: T) -> T {
    value.min(bound).max(bound.opposite())
}

/// Fraction bits of a ramp: +-32,768 N in steps of 4e-15 N.
pub const RAMP_BITS: u32 = 48;

const EXTRA: u32 = RAMP_BITS - Newton::FRAC_BITS;

/// How fast a ramp may go, in newton a microsecond, times 2^48.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rate(i64);

impl Rate {
    /// From micronewton a second.
    #[must_use]
    pub fn from_un_per_s(un_per_s: i32) -> Self {
        let newton_per_us = f64::from(un_per_s) * 1e-12;
        Self(libm::round(newton_per_us * libm::exp2(f64::from(RAMP_BITS))) as i64)
    }

    /// A 2^n-th of it.
    #[must_use]
    pub const fn shifted(self, n: u32) -> Self {
        Self(self.0 >> n)
    }

    /// With one bit inverted.
    #[cfg(feature = "injection")]
    pub(crate) const fn flipped(self, bit: u32) -> Self {
        Self(self.0 ^ 1 << bit)
    }
}

/// A force that follows another at a limited rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ramp(i64);

impl Ramp {
    /// Present value.
    #[must_use]
    pub const fn value(self) -> Newton {
        Newton::from_wide_shifted(self.0, EXTRA)
    }

    /// Sets the value without a rate limit.
    pub fn set(&mut self, value: Newton) {
        self.0 = i64::from(value.to_bits()) << EXTRA;
    }

    /// Moves towards `to` for `dt_us` (at most 12,500); returns whether the rate limited it.
    pub fn approach(&mut self, to: Newton, rate: Rate, dt_us: u32) -> bool {
        // 2,000 N/s take 40 bits, the time 14.
        let step = rate.0.saturating_mul(i64::from(dt_us));
        let to = i64::from(to.to_bits()) << EXTRA;
        let distance = to.saturating_sub(self.0);
        self.0 = self.0.saturating_add(clamp_abs(distance, step));
        self.0 != to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_bound_panics() {
        assert_eq!(clamp_abs(7, 5), 5);
        assert_eq!(clamp_abs(-7, 5), -5);
        for bound in [i32::MIN, -5, 0, i32::MAX] {
            for value in [i32::MIN, -7, 7, i32::MAX] {
                let _ = clamp_abs(value, bound);
                let _ = clamp_abs(i64::from(value), i64::MIN);
            }
        }
    }
}
