//! Newtypes that own the scale of a number, so that no bare integer crosses a module.
//!
//! # Choice of formats
//!
//! | quantity | format | range | step |
//! | --- | --- | --- | --- |
//! | force, tension ([`Newton`]) | I10F22 | +-512 N | 0.24 uN |
//! | sums and integrators | i64 with 32 fraction bits | +-2.1e9 N | 0.23 nN |
//! | gains | Q16 as on the wire, Q30 inside filters | | 1.5e-5, 9.3e-10 |
//!
//! A load cell at full scale and gain 128 reads 57.5 N; times the largest 1/cos of 4 that is 230 N,
//! which I10F22 holds with room for an overshoot. One ADC count is 6.85 uN, 29 steps of it.
//! Products of two 32-bit numbers go through i64 (one `smull` on the Cortex-M7).

use fixed::types::I10F22;

/// A NAU7802 conversion result: signed, 24 bits, -8,388,608 to 8,388,607.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct AdcCode(i32);

impl AdcCode {
    /// Largest code; the converter saturates there.
    pub const MAX: Self = Self(0x7F_FFFF);
    /// Smallest code; the converter saturates there.
    pub const MIN: Self = Self(-0x80_0000);

    /// From a sign-extended code; anything outside 24 bits is brought to the nearest end.
    #[must_use]
    pub const fn new(code: i32) -> Self {
        if code > Self::MAX.0 {
            Self::MAX
        } else if code < Self::MIN.0 {
            Self::MIN
        } else {
            Self(code)
        }
    }

    /// The code.
    #[must_use]
    pub const fn get(self) -> i32 {
        self.0
    }

    /// Whether the converter stands at an end of its range, where it does not represent the force.
    #[must_use]
    pub const fn is_saturated(self) -> bool {
        self.0 == Self::MAX.0 || self.0 == Self::MIN.0
    }
}

/// A DAC7731 code: straight binary, 0x0000 = -10 V, 0x8000 = 0 V, 0xFFFF = +10 V less one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct DacCode(pub u16);

impl DacCode {
    /// 0 V: no current. (0x0000 would be -10 V.)
    pub const ZERO_VOLT: Self = Self(0x8000);

    /// Steps above 0 V; negative below.
    #[must_use]
    pub const fn steps(self) -> i32 {
        self.0 as i32 - 0x8000
    }
}

impl Default for DacCode {
    fn default() -> Self {
        Self::ZERO_VOLT
    }
}

/// Encoder position in quadrature counts, extended past the counter's 24 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct EncoderCounts(pub i64);

/// Board time in microseconds; wraps after 71.6 minutes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Micros(pub u32);

impl Micros {
    /// Microseconds from `earlier` to this time, right across a wrap.
    #[must_use]
    pub const fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// Microseconds from this time to `other`, negative where `other` is earlier; right for times
    /// within 35 minutes.
    #[must_use]
    pub const fn until(self, other: Self) -> i32 {
        other.since(self).cast_signed()
    }

    /// The time `us` microseconds later.
    #[must_use]
    pub const fn plus(self, us: u32) -> Self {
        Self(self.0.wrapping_add(us))
    }
}

/// 1 / cos of the angle between cable and load-cell axis, times 65,536.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct InvCos(i32);

impl InvCos {
    /// Cable along the axis.
    pub const ONE: Self = Self(65_536);
    /// 75.5 degrees off the axis; beyond that the cell hardly sees the cable.
    pub const MAX: Self = Self(262_144);

    /// From the wire's number; brought into 1 to 4.
    #[must_use]
    pub const fn from_q16(q16: i32) -> Self {
        if q16 < Self::ONE.0 {
            Self::ONE
        } else if q16 > Self::MAX.0 {
            Self::MAX
        } else {
            Self(q16)
        }
    }

    /// Times 65,536.
    #[must_use]
    pub const fn q16(self) -> i32 {
        self.0
    }
}

impl Default for InvCos {
    fn default() -> Self {
        Self::ONE
    }
}

/// To the nearest integer; ends at i32's ends.
pub(crate) fn rounded(value: f64) -> i32 {
    libm::round(value) as i32
}

/// A force in newton, I10F22.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Newton(pub I10F22);

impl Newton {
    /// No force.
    pub const ZERO: Self = Self(I10F22::ZERO);
    /// Largest number.
    pub const MAX: Self = Self(I10F22::MAX);
    /// Fraction bits of the format.
    pub const FRAC_BITS: u32 = 22;

    /// From the format's bits.
    #[must_use]
    pub const fn from_bits(bits: i32) -> Self {
        Self(I10F22::from_bits(bits))
    }

    /// The format's bits: newton times 2^22.
    #[must_use]
    pub const fn to_bits(self) -> i32 {
        self.0.to_bits()
    }

    /// From wide bits (newton times 2^22), brought to the nearest end.
    #[must_use]
    pub const fn from_wide(bits: i64) -> Self {
        if bits > i32::MAX as i64 {
            Self::from_bits(i32::MAX)
        } else if bits < i32::MIN as i64 {
            Self::from_bits(i32::MIN)
        } else {
            Self::from_bits(bits as i32)
        }
    }

    /// From wide bits with `shift` more fraction bits (1 to 62), rounded to the nearest step.
    /// Rounded, not cut: what is cut is a bias, and the integral would add it up.
    #[must_use]
    pub const fn from_wide_shifted(bits: i64, shift: u32) -> Self {
        Self::from_wide((bits >> shift) + ((bits >> (shift - 1)) & 1))
    }

    /// From micronewton, the wire's unit; saturates at +-512 N. Rounded to the nearest step.
    #[must_use]
    pub const fn from_un(un: i32) -> Self {
        // 2^22 / 10^6 as Q32: right to 6e-11, 0.03 steps at 512 N.
        const STEPS_PER_UN_Q32: i64 = 18_014_398_509; // round(4.194304 * 2^32)
        Self::from_wide((un as i64 * STEPS_PER_UN_Q32 + (1 << 31)) >> 32)
    }

    /// To micronewton, rounded.
    #[must_use]
    pub const fn to_un(self) -> i32 {
        ((self.to_bits() as i64 * 1_000_000 + (1 << 21)) >> 22) as i32
    }

    /// To 0.1 mN, telemetry's unit, rounded.
    #[must_use]
    pub const fn to_tenth_mn(self) -> i32 {
        ((self.to_bits() as i64 * 10_000 + (1 << 21)) >> 22) as i32
    }

    /// To newton. Not for the sample path.
    #[must_use]
    pub fn to_f64(self) -> f64 {
        self.0.to_num()
    }

    /// Sum, brought to the nearest end.
    #[must_use]
    pub const fn saturating_add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }

    /// Difference, brought to the nearest end.
    #[must_use]
    pub const fn saturating_sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }

    /// Not further from zero than `limit` (which must not be negative).
    #[must_use]
    pub fn clamp_abs(self, limit: Self) -> Self {
        self.clamp_to(Self(limit.0.saturating_neg()), limit)
    }

    /// Brought into `low..=high`; `high` wins should they be swapped.
    #[must_use]
    pub fn clamp_to(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
}
