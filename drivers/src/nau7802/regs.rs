//! The NAU7802 register map as types (datasheet rev. 1.7, section 11 "Device register map
//! details").
//!
//! Each register is a newtype over its byte. `with_*` methods build a value, getters take one
//! apart; all are `const`, so that a configuration can be a constant in flash.

/// 7-bit I2C address, fixed in silicon (datasheet section 8.3.1: device address byte 0101010x).
pub const ADDRESS: u8 = 0x2A;

numbered! {
    /// Addresses of the registers this driver uses. Multi-byte registers are named by their first
    /// byte; the register pointer auto-increments (0x7F wraps to 0x00).
    Register,
    /// The datasheet's name, for messages.
    name {
        /// 0x00, power-up control (section 11.1).
        PuCtrl = 0x00, "PU_CTRL";
        /// 0x01, LDO voltage, gain and the DRDY pin.
        Ctrl1 = 0x01, "CTRL1";
        /// 0x02, channel, rate and calibration.
        Ctrl2 = 0x02, "CTRL2";
        /// 0x03..=0x05, offset coefficient of channel 1.
        Ocal1 = 0x03, "OCAL1";
        /// 0x06..=0x09, gain coefficient of channel 1.
        Gcal1 = 0x06, "GCAL1";
        /// 0x0A..=0x0C, offset coefficient of channel 2.
        Ocal2 = 0x0A, "OCAL2";
        /// 0x0D..=0x10, gain coefficient of channel 2.
        Gcal2 = 0x0D, "GCAL2";
        /// 0x11, bus pull-ups, fast read, input test switches.
        I2cCtrl = 0x11, "I2C_CTRL";
        /// 0x12..=0x14, conversion result, most significant byte first.
        Adco = 0x12, "ADCO";
        /// 0x15, chopper and common-mode settings of the modulator.
        Adc = 0x15, "ADC";
        /// 0x1B, amplifier options and the read-back selector of 0x15.
        Pga = 0x1B, "PGA";
        /// 0x1C, bias currents and the amplifier's output capacitor.
        Power = 0x1C, "POWER";
        /// 0x1F, device revision.
        Revision = 0x1F, "REVISION";
    }
}

impl Register {
    /// The address byte that goes on the bus.
    pub const fn address(self) -> u8 {
        self as u8
    }
}

impl core::fmt::Display for Register {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} (0x{:02X})", self.name(), self.address())
    }
}

/// Defines a one-byte register type with single-bit fields.
macro_rules! byte_register {
    (
        $(#[$meta:meta])*
        $name:ident { $( $(#[$field_meta:meta])* $bit:literal: $get:ident, $with:ident; )* }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name(u8);

        impl $name {
            /// Takes the byte as it stands on the bus.
            pub const fn from_bits(bits: u8) -> Self {
                Self(bits)
            }

            /// The byte as it stands on the bus.
            pub const fn bits(self) -> u8 {
                self.0
            }

            $(
                $(#[$field_meta])*
                pub const fn $get(self) -> bool {
                    self.0 & (1 << $bit) != 0
                }

                #[doc = concat!("Returns the value with [`Self::", stringify!($get), "`] set to `on`.")]
                #[must_use]
                pub const fn $with(self, on: bool) -> Self {
                    if on { Self(self.0 | (1 << $bit)) } else { Self(self.0 & !(1 << $bit)) }
                }
            )*
        }
    };
}

byte_register! {
    /// PU_CTRL, 0x00, reset value 0x00 (datasheet section 11.1).
    PuCtrl {
        /// AVDDS: the analog supply is the internal LDO rather than the AVDD pin.
        7: avdds, with_avdds;
        /// OSCS: external crystal in place of the internal RC oscillator.
        6: oscs, with_oscs;
        /// CR (read only): a conversion result is waiting. Polling this in place of the DRDY pin
        /// gives stale or doubled samples in the field; use it for diagnosis only.
        5: conversion_ready, with_conversion_ready;
        /// CS: conversions run; the rising edge synchronises the cycle. Nothing converts while 0.
        4: cycle_start, with_cycle_start;
        /// PUR (read only): the digital part is powered and ready.
        3: power_up_ready, with_power_up_ready;
        /// PUA: power up the analog part.
        2: power_up_analog, with_power_up_analog;
        /// PUD: power up the digital part.
        1: power_up_digital, with_power_up_digital;
        /// RR: register reset. A level: every other register stays at reset while it is 1.
        0: register_reset, with_register_reset;
    }
}

byte_register! {
    /// CTRL1, 0x01, reset value 0x00 (datasheet section 11, REG0x01).
    Ctrl1 {
        /// CRP: DRDY is active low (0: active high).
        7: drdy_active_low, with_drdy_active_low;
        /// DRDY_SEL: the DRDY pin carries the crystal clock in place of data-ready.
        6: drdy_is_clock, with_drdy_is_clock;
    }
}

impl Ctrl1 {
    /// VLDO, bits 5:3: output voltage of the internal regulator.
    pub const fn ldo(self) -> LdoVoltage {
        LdoVoltage::from_bits(self.0 >> 3)
    }

    /// Returns the value with another regulator voltage.
    #[must_use]
    pub const fn with_ldo(self, ldo: LdoVoltage) -> Self {
        Self((self.0 & !0x38) | ((ldo as u8) << 3))
    }

    /// GAINS, bits 2:0: gain of the amplifier.
    pub const fn gain(self) -> Gain {
        Gain::from_bits(self.0)
    }

    /// Returns the value with another amplifier gain.
    #[must_use]
    pub const fn with_gain(self, gain: Gain) -> Self {
        Self((self.0 & !0x07) | gain as u8)
    }
}

byte_register! {
    /// CTRL2, 0x02, reset value 0x00 (datasheet section 11, REG0x02; calibration: section 8.6).
    Ctrl2 {
        /// CHS: channel 2 is converted (0: channel 1).
        7: channel_2, with_channel_2;
        /// CAL_ERR (read only): the last calibration failed. Stays until a reset or a valid
        /// calibration; while 1 the coefficients are invalid (section 8.6.3).
        3: calibration_error, with_calibration_error;
        /// CALS: starts a calibration, clears itself at its end. The bit ignores writes while 1.
        /// That the others take them is read from the same line.
        2: calibrating, with_calibrating;
    }
}

impl Ctrl2 {
    /// CRS, bits 6:4: conversion rate; `None` for a reserved code.
    pub const fn rate(self) -> Option<Rate> {
        Rate::from_bits(self.0 >> 4)
    }

    /// Returns the value with another conversion rate.
    #[must_use]
    pub const fn with_rate(self, rate: Rate) -> Self {
        Self((self.0 & !0x70) | ((rate as u8) << 4))
    }

    /// CALMOD, bits 1:0: what the next calibration does; `None` for the reserved code.
    pub const fn calibration_mode(self) -> Option<CalibrationMode> {
        CalibrationMode::from_bits(self.0)
    }

    /// Returns the value with another calibration mode.
    #[must_use]
    pub const fn with_calibration_mode(self, mode: CalibrationMode) -> Self {
        Self((self.0 & !0x03) | mode as u8)
    }
}

byte_register! {
    /// I2C_CTRL, 0x11, reset value 0x00 (datasheet section 11, REG0x11).
    I2cCtrl {
        /// CRSD: pull SDA low when a conversion is complete and the bus is idle ("special
        /// non-standard I2C"). Never set it on a shared bus: every other master and mux sees a held
        /// bus.
        7: sda_low_when_ready, with_sda_low_when_ready;
        /// FRD: fast read ("special non-standard I2C"), see [`crate::nau7802::fast_read`].
        6: fast_read, with_fast_read;
        /// SPE: strong pull-ups, nominal 1.6 kOhm, on SCL and SDA.
        5: strong_pull_up, with_strong_pull_up;
        /// WPD: weak pull-ups, nominal 50 kOhm, switched off.
        4: weak_pull_up_off, with_weak_pull_up_off;
        /// SI: inputs shorted together, to measure the offset.
        3: inputs_shorted, with_inputs_shorted;
        /// BOPGA: 2.5 uA burn-out current into the positive input, to find an open bridge.
        2: burn_out, with_burn_out;
        /// TS: the temperature sensor in place of the inputs.
        1: temperature_sensor, with_temperature_sensor;
        /// BGPCP: bandgap chopper off.
        0: bandgap_chopper_off, with_bandgap_chopper_off;
    }
}

byte_register! {
    /// ADC, 0x15 (datasheet section 11, REG0x15). It reads back only while [`Pga::read_otp`] is 0.
    Adc {
        /// Bit 7: second enable of the fast read; see [`crate::nau7802::fast_read`].
        7: fast_read_enable, with_fast_read_enable;
    }
}

impl Adc {
    /// CHPS = 11, chopper clock off: the only non-reserved setting, and what the power-on sequence
    /// (section 9.1) writes: 0x30.
    pub const CHOPPER_OFF: Self = Self(0x30);
}

byte_register! {
    /// PGA, 0x1B, reset value 0x00 (datasheet section 11, REG0x1B).
    Pga {
        /// RD_OTP_SEL: reads of 0x15 return factory bits in place of the ADC register.
        7: read_otp, with_read_otp;
        /// LDOMODE: more stable regulator with less DC gain, for output capacitors with high ESR.
        6: ldo_stable, with_ldo_stable;
        /// Output buffer enabled.
        5: output_buffer, with_output_buffer;
        /// Amplifier bypassed.
        4: bypass, with_bypass;
        /// Input phase inverted.
        3: invert, with_invert;
        /// Amplifier chopper off.
        0: chopper_off, with_chopper_off;
    }
}

byte_register! {
    /// POWER, 0x1C, reset value 0x00 (datasheet section 11, REG0x1C). Bits 6:4 master bias, 3:2 ADC
    /// current, 1:0 amplifier current stay at 0 (100 %, full accuracy).
    Power {
        /// PGA_CAP_EN: the capacitor across VIN2P/VIN2N filters the amplifier's output. Only while
        /// channel 2 carries no signal.
        7: pga_capacitor, with_pga_capacitor;
    }
}

/// REVISION, 0x1F: the low nibble identifies the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Revision(u8);

impl Revision {
    /// The only revision that the datasheet knows (low nibble of 0x1F).
    pub const EXPECTED: u8 = 0x0F;

    /// Takes the byte as it stands on the bus; the high nibble carries nothing.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 0x0F)
    }

    /// The revision nibble.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Whether this is the part the driver was written for.
    pub const fn is_expected(self) -> bool {
        self.0 == Self::EXPECTED
    }
}

/// Output voltage of the internal regulator (CTRL1 bits 5:3). It must stay below DVDD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum LdoVoltage {
    /// 4.5 V (reset value).
    V4_5 = 0,
    /// 4.2 V.
    V4_2 = 1,
    /// 3.9 V.
    V3_9 = 2,
    /// 3.6 V.
    V3_6 = 3,
    /// 3.3 V.
    V3_3 = 4,
    /// 3.0 V: the highest that a 3.3 V supply regulates cleanly.
    V3_0 = 5,
    /// 2.7 V.
    V2_7 = 6,
    /// 2.4 V.
    V2_4 = 7,
}

impl LdoVoltage {
    /// Decodes the low three bits.
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 0x07 {
            0 => Self::V4_5,
            1 => Self::V4_2,
            2 => Self::V3_9,
            3 => Self::V3_6,
            4 => Self::V3_3,
            5 => Self::V3_0,
            6 => Self::V2_7,
            _ => Self::V2_4,
        }
    }

    /// Nominal voltage in millivolts: 4500 less 300 a step.
    pub const fn millivolts(self) -> u16 {
        4500 - 300 * self as u16
    }
}

/// Gain of the amplifier (CTRL1 bits 2:0), 2^n.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Gain {
    /// 1 (reset value).
    X1 = 0,
    /// 2.
    X2 = 1,
    /// 4.
    X4 = 2,
    /// 8.
    X8 = 3,
    /// 16.
    X16 = 4,
    /// 32.
    X32 = 5,
    /// 64.
    X64 = 6,
    /// 128: load cells.
    X128 = 7,
}

impl Gain {
    /// Decodes the low three bits.
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 0x07 {
            0 => Self::X1,
            1 => Self::X2,
            2 => Self::X4,
            3 => Self::X8,
            4 => Self::X16,
            5 => Self::X32,
            6 => Self::X64,
            _ => Self::X128,
        }
    }

    /// The factor, 1 to 128.
    pub const fn factor(self) -> u8 {
        1 << (self as u8)
    }
}

/// Conversion rate (CTRL2 bits 6:4); codes 4 to 6 are reserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Rate {
    /// 10 samples a second (reset value).
    Sps10 = 0,
    /// 20 samples a second.
    Sps20 = 1,
    /// 40 samples a second.
    Sps40 = 2,
    /// 80 samples a second.
    Sps80 = 3,
    /// 320 samples a second.
    Sps320 = 7,
}

impl Rate {
    /// Decodes the low three bits; `None` for a reserved code.
    pub const fn from_bits(bits: u8) -> Option<Self> {
        match bits & 0x07 {
            0 => Some(Self::Sps10),
            1 => Some(Self::Sps20),
            2 => Some(Self::Sps40),
            3 => Some(Self::Sps80),
            7 => Some(Self::Sps320),
            _ => None,
        }
    }

    /// Nominal rate in hertz. The internal RC oscillator is within 3 % of it, each part on its own.
    pub const fn hertz(self) -> u16 {
        match self {
            Self::Sps10 => 10,
            Self::Sps20 => 20,
            Self::Sps40 => 40,
            Self::Sps80 => 80,
            Self::Sps320 => 320,
        }
    }
}

/// What a calibration measures (CTRL2 bits 1:0, datasheet section 8.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum CalibrationMode {
    /// Offset of the converter itself; the inputs are disconnected meanwhile, the load doesn't
    /// matter.
    InternalOffset = 0,
    /// Offset at the pins: needs zero input, that is, an unloaded cell.
    SystemOffset = 2,
    /// Gain at the pins: needs full-scale input, and a system offset done before.
    SystemGain = 3,
}

impl CalibrationMode {
    /// Decodes the low two bits; `None` for the reserved code 1.
    pub const fn from_bits(bits: u8) -> Option<Self> {
        match bits & 0x03 {
            0 => Some(Self::InternalOffset),
            2 => Some(Self::SystemOffset),
            3 => Some(Self::SystemGain),
            _ => None,
        }
    }
}

/// Input channel (CTRL2 bit 7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Channel {
    /// VIN1P/VIN1N.
    One,
    /// VIN2P/VIN2N.
    Two,
}

/// Level of the DRDY pin that means "a result is waiting" (CTRL1 bit 7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DrdyPolarity {
    /// A rising edge announces a result (reset value).
    ActiveHigh,
    /// A falling edge announces a result.
    ActiveLow,
}
