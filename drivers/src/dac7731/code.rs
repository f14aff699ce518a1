//! DAC codes and their scale (DAC7731 datasheet, "Digital interface": straight binary code).

/// Output range, set by pin straps on the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Range {
    /// -10 V to +10 V.
    PlusMinus10V,
    /// -5 V to +5 V.
    PlusMinus5V,
    /// 0 V to +10 V. Not for a motor: the reset to mid-scale gives 5 V here.
    ZeroTo10V,
}

impl Range {
    /// Output at code 0, in microvolts.
    pub const fn bottom_uv(self) -> i32 {
        match self {
            Self::PlusMinus10V => -10_000_000,
            Self::PlusMinus5V => -5_000_000,
            Self::ZeroTo10V => 0,
        }
    }

    /// Difference between the ends of the range in microvolts: 2^16 codes.
    pub const fn span_uv(self) -> i32 {
        match self {
            Self::PlusMinus10V => 20_000_000,
            Self::PlusMinus5V | Self::ZeroTo10V => 10_000_000,
        }
    }

    /// The code that gives 0 V.
    pub const fn zero_volts(self) -> DacCode {
        match self {
            Self::PlusMinus10V | Self::PlusMinus5V => DacCode::MIDSCALE,
            Self::ZeroTo10V => DacCode::BOTTOM,
        }
    }
}

/// A 16-bit output code, offset binary: output = bottom + code x span / 2^16.
///
/// One code is 305.2 uV in the +-10 V range and 152.6 uV in the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DacCode(u16);

impl DacCode {
    /// 0 V in the bipolar ranges; the state after a reset with RSTSEL = 1.
    pub const MIDSCALE: Self = Self(0x8000);
    /// Lowest output: **negative full scale** in the bipolar ranges. Never a safe value there.
    pub const BOTTOM: Self = Self(0x0000);
    /// Highest output: positive full scale less one code.
    pub const TOP: Self = Self(0xFFFF);

    /// From the code itself, as the datasheet counts: 0x8000 is mid-scale.
    pub const fn from_offset_binary(code: u16) -> Self {
        Self(code)
    }

    /// From a signed distance to mid-scale, in codes: 0 is 0 V in the bipolar ranges.
    pub const fn from_signed(counts: i16) -> Self {
        // Offset binary is two's complement with the sign bit inverted.
        Self((counts as u16) ^ 0x8000)
    }

    /// As [`Self::from_signed`], with values out of range held at the ends.
    pub const fn from_signed_saturating(counts: i32) -> Self {
        if counts < i16::MIN as i32 {
            Self::BOTTOM
        } else if counts > i16::MAX as i32 {
            Self::TOP
        } else {
            Self::from_signed(counts as i16)
        }
    }

    /// The nearest code to a voltage in microvolts, held at the ends of the range.
    pub const fn from_microvolts(range: Range, microvolts: i32) -> Self {
        let above = microvolts as i64 - range.bottom_uv() as i64;
        let span = range.span_uv() as i64;
        // Add half a code before the division to round to the nearest; floor keeps it exact below
        // zero.
        let code = (above * 0x1_0000 + span / 2).div_euclid(span);
        if code < 0 {
            Self::BOTTOM
        } else if code > 0xFFFF {
            Self::TOP
        } else {
            Self(code as u16)
        }
    }

    /// The code itself, straight binary.
    pub const fn offset_binary(self) -> u16 {
        self.0
    }

    /// Signed distance to mid-scale, in codes.
    pub const fn signed(self) -> i16 {
        (self.0 ^ 0x8000) as i16
    }

    /// Nominal output in microvolts, rounded down.
    pub const fn microvolts(self, range: Range) -> i32 {
        let above = (self.0 as i64 * range.span_uv() as i64) >> 16;
        // At most 20 V: fits.
        range.bottom_uv() + above as i32
    }

    /// The two bytes on the wire, most significant first.
    pub const fn to_frame(self) -> [u8; 2] {
        self.0.to_be_bytes()
    }

    /// The code that two bytes on the wire mean.
    pub const fn from_frame(frame: [u8; 2]) -> Self {
        Self(u16::from_be_bytes(frame))
    }
}

impl Default for DacCode {
    /// [`Self::MIDSCALE`].
    fn default() -> Self {
        Self::MIDSCALE
    }
}
