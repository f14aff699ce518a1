//! What the NAU7802 measures and stores, as types: conversion results and calibration coefficients.

use super::regs::{Channel, Gain, Register};

/// A conversion result: 24-bit two's complement, full scale +-0.5 VREF / gain (datasheet section
/// 8).
///
/// One count is VREF / (gain x 2^24): 1.397 nV at 3.0 V and gain 128.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AdcCode(i32);

impl AdcCode {
    /// Negative full scale, -2^23.
    pub const MIN: Self = Self(-(1 << 23));
    /// Positive full scale, 2^23 - 1.
    pub const MAX: Self = Self((1 << 23) - 1);

    /// Takes a value in counts; `None` outside -2^23 ..= 2^23 - 1.
    pub const fn new(counts: i32) -> Option<Self> {
        if counts >= Self::MIN.0 && counts <= Self::MAX.0 {
            Some(Self(counts))
        } else {
            None
        }
    }

    /// Decodes registers 0x12..=0x14, most significant byte first, the sign extended from bit 23.
    pub const fn from_be_bytes(bytes: [u8; 3]) -> Self {
        // Left-justify and shift back arithmetically: the sign travels with the shift. Stopping
        // before the shift back is the classic mistake that reads 256 times too large.
        Self(i32::from_be_bytes([bytes[0], bytes[1], bytes[2], 0]) >> 8)
    }

    /// Encodes as registers 0x12..=0x14 hold it.
    pub const fn to_be_bytes(self) -> [u8; 3] {
        let [_, high, middle, low] = self.0.to_be_bytes();
        [high, middle, low]
    }

    /// The value in counts.
    pub const fn counts(self) -> i32 {
        self.0
    }

    /// At one of the rails: an open bridge, a short or an overload, never a measurement.
    pub const fn is_saturated(self) -> bool {
        self.0 == Self::MIN.0 || self.0 == Self::MAX.0
    }

    /// Differential input in picovolts, rounded toward zero, for a reference in millivolts.
    pub const fn picovolts(self, reference_mv: u16, gain: Gain) -> i64 {
        // counts x mV x 1e9 / (gain x 2^24) with 1e9 = 2^9 x 1953125 cancelled: at most
        // 2^23 x 2^16 x 1953125 = 1.1e18, inside i64.
        self.0 as i64 * reference_mv as i64 * 1_953_125 / ((gain.factor() as i64) << 15)
    }
}

/// Offset coefficient of a channel, 24 bits (0x03..=0x05, 0x0A..=0x0C), subtracted from the
/// measurement before the gain is applied (datasheet section 8.6).
///
/// Kept as the raw bits: our sources do not state the number format, so this is for saving and
/// restoring a calibration, never for arithmetic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OffsetCoefficient(u32);

impl OffsetCoefficient {
    /// No offset: the reset value.
    pub const ZERO: Self = Self(0);

    /// Takes the raw 24 bits; `None` if more are set.
    pub const fn new(bits: u32) -> Option<Self> {
        if bits >> 24 == 0 {
            Some(Self(bits))
        } else {
            None
        }
    }

    /// The raw 24 bits.
    pub const fn bits(self) -> u32 {
        self.0
    }
}

/// Gain coefficient of a channel, 32 bits in units of 2^-23 (0x06..=0x09, 0x0D..=0x10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GainCoefficient(u32);

impl GainCoefficient {
    /// 1.0: the reset value, 0x0080_0000.
    pub const UNITY: Self = Self(0x0080_0000);

    /// Takes the raw bits.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The raw bits.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The factor in millionths, rounded down: 1_000_000 for [`Self::UNITY`].
    pub const fn millionths(self) -> u32 {
        // At most 2^32 x 1e6 / 2^23 = 5.1e8.
        ((self.0 as u64 * 1_000_000) >> 23) as u32
    }
}

impl Default for GainCoefficient {
    fn default() -> Self {
        Self::UNITY
    }
}

/// Both coefficients of a channel: `output = gain x (measurement - offset)` (datasheet section
/// 8.6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Coefficients {
    /// Offset coefficient.
    pub offset: OffsetCoefficient,
    /// Gain coefficient.
    pub gain: GainCoefficient,
}

impl Coefficients {
    /// Bytes of both coefficients together; the two registers are neighbours.
    pub const LEN: usize = 7;

    /// First register of a channel's coefficients.
    pub const fn register(channel: Channel) -> Register {
        match channel {
            Channel::One => Register::Ocal1,
            Channel::Two => Register::Ocal2,
        }
    }

    /// Decodes a burst read that starts at [`Self::register`].
    pub const fn from_be_bytes(bytes: [u8; Self::LEN]) -> Self {
        let [o2, o1, o0, g3, g2, g1, g0] = bytes;
        Self {
            offset: OffsetCoefficient(u32::from_be_bytes([0, o2, o1, o0])),
            gain: GainCoefficient(u32::from_be_bytes([g3, g2, g1, g0])),
        }
    }

    /// Encodes for a burst write that starts at [`Self::register`].
    pub const fn to_be_bytes(self) -> [u8; Self::LEN] {
        let [_, o2, o1, o0] = self.offset.0.to_be_bytes();
        let [g3, g2, g1, g0] = self.gain.0.to_be_bytes();
        [o2, o1, o0, g3, g2, g1, g0]
    }
}
