//! What a NAU7802 should be set to, and the register values that follow from it.

use super::regs::{
    Adc, CalibrationMode, Channel, Ctrl1, Ctrl2, DrdyPolarity, Gain, I2cCtrl, LdoVoltage, Pga,
    Power, PuCtrl, Rate,
};

/// Settings of one converter. [`Config::FORCE_UNIT`] is what a force unit uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Internal regulator voltage; `None` takes the analog supply from the AVDD pin.
    pub ldo: Option<LdoVoltage>,
    /// Time in microseconds for the analog supply to settle before anything is calibrated on it.
    /// The datasheet gives no figure that we know of; drivers in the wild wait 250 ms. Not
    /// confirmed.
    pub supply_settle_us: u32,
    /// Regulator trimmed for output capacitors with high ESR (PGA bit 6).
    pub ldo_stable: bool,
    /// Amplifier gain.
    pub gain: Gain,
    /// Conversion rate.
    pub rate: Rate,
    /// Input channel.
    pub channel: Channel,
    /// Active level of DRDY.
    pub drdy: DrdyPolarity,
    /// Filter capacitor across VIN2P/VIN2N; needs channel 2 free.
    pub pga_capacitor: bool,
    /// Calibration done as part of the bring-up and of every reconfiguration.
    pub calibration: CalibrationMode,
    /// Enables the fast read; see [`crate::nau7802::fast_read`] before setting it.
    pub fast_read: bool,
}

impl Config {
    /// A force unit: 3.0 V bridge supply from the regulator, gain 128, 320 samples a second,
    /// channel 1, DRDY active high, capacitor across the free channel 2, internal offset
    /// calibration.
    pub const FORCE_UNIT: Self = Self {
        ldo: Some(LdoVoltage::V3_0),
        supply_settle_us: 250_000,
        ldo_stable: false,
        gain: Gain::X128,
        rate: Rate::Sps320,
        channel: Channel::One,
        drdy: DrdyPolarity::ActiveHigh,
        pga_capacitor: true,
        calibration: CalibrationMode::InternalOffset,
        fast_read: false,
    };

    /// Time from the start of the analog part to a calibration, in microseconds: the longer one of
    /// [`Self::supply_settle_us`] and of what published drivers wait for at the rate in force.
    /// These are TRDY (100 ms and five samples), then ten results with the six that settle before
    /// them, here one more for a clock that is 3 % slow: 168 750 at 320 SPS, 2 300 000 at 10 SPS.
    pub const fn supply_wait_us(&self) -> u32 {
        let ready_us = 100_000 + 22 * 1_000_000 / self.rate.hertz() as u32;
        if self.supply_settle_us > ready_us {
            self.supply_settle_us
        } else {
            ready_us
        }
    }

    /// Bits of PU_CTRL that hold a setting; the others are status or command bits.
    pub(super) const PU_CTRL_MASK: u8 = PuCtrl::from_bits(0)
        .with_avdds(true)
        .with_oscs(true)
        .with_power_up_analog(true)
        .with_power_up_digital(true)
        .bits();

    /// Value of PU_CTRL with the conversions stopped: 0xAE with the internal regulator, the value
    /// of the datasheet's power-on sequence (section 9.1); bits 5 and 3 in it are read-only.
    pub const fn pu_ctrl(&self) -> PuCtrl {
        PuCtrl::from_bits(0x2E).with_avdds(self.ldo.is_some())
    }

    /// Value of CTRL1.
    pub const fn ctrl1(&self) -> Ctrl1 {
        let base = Ctrl1::from_bits(0)
            .with_gain(self.gain)
            .with_drdy_active_low(matches!(self.drdy, DrdyPolarity::ActiveLow));
        match self.ldo {
            Some(ldo) => base.with_ldo(ldo),
            None => base,
        }
    }

    /// Value of CTRL2 without a calibration running.
    pub const fn ctrl2(&self) -> Ctrl2 {
        Ctrl2::from_bits(0)
            .with_rate(self.rate)
            .with_channel_2(matches!(self.channel, Channel::Two))
    }

    /// Value of CTRL2 that starts a calibration and keeps channel and rate.
    pub const fn ctrl2_calibrate(&self, mode: CalibrationMode) -> Ctrl2 {
        self.ctrl2()
            .with_calibration_mode(mode)
            .with_calibrating(true)
    }

    /// Value of I2C_CTRL.
    pub const fn i2c_ctrl(&self) -> I2cCtrl {
        I2cCtrl::from_bits(0).with_fast_read(self.fast_read)
    }

    /// Value of PGA. Bit 7 stays 0 so that the ADC register can be read back.
    pub const fn pga(&self) -> Pga {
        Pga::from_bits(0).with_ldo_stable(self.ldo_stable)
    }

    /// Value of POWER.
    pub const fn power(&self) -> Power {
        Power::from_bits(0).with_pga_capacitor(self.pga_capacitor)
    }

    /// Value of ADC: 0x30, with bit 7 as well for the fast read.
    pub const fn adc(&self) -> Adc {
        Adc::CHOPPER_OFF.with_fast_read_enable(self.fast_read)
    }

    /// Full scale of the input in nanovolts at this gain, for the regulator's nominal voltage or,
    /// with an external supply, `external_mv`: 0.5 VREF / gain, 11_718_750 at 3.0 V and gain 128.
    pub const fn full_scale_nv(&self, external_mv: u16) -> u64 {
        let millivolts = match self.ldo {
            Some(ldo) => ldo.millivolts(),
            None => external_mv,
        };
        millivolts as u64 * 500_000 / self.gain.factor() as u64
    }
}

impl Default for Config {
    fn default() -> Self {
        Self::FORCE_UNIT
    }
}
