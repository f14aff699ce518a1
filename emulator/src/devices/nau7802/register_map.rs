//! Register map: addresses, bits, reset values (NAU7802 datasheet section 11).

pub(super) mod reg {
    pub(in super::super) const PU_CTRL: u8 = 0x00;
    pub(in super::super) const CTRL1: u8 = 0x01;
    pub(in super::super) const CTRL2: u8 = 0x02;
    pub(in super::super) const OCAL1: usize = 0x03;
    pub(in super::super) const GCAL1: usize = 0x06;
    pub(in super::super) const OCAL2: usize = 0x0A;
    pub(in super::super) const GCAL2: usize = 0x0D;
    pub(in super::super) const I2C_CTRL: u8 = 0x11;
    pub(in super::super) const ADCO_B2: u8 = 0x12;
    pub(in super::super) const ADCO_B0: u8 = 0x14;
    pub(in super::super) const ADC: u8 = 0x15;
    pub(in super::super) const PGA: u8 = 0x1B;
    pub(in super::super) const REVISION: u8 = 0x1F;
}

pub(super) mod bit {
    pub(in super::super) const RR: u8 = 0x01;
    pub(in super::super) const PUD: u8 = 0x02;
    pub(in super::super) const PUA: u8 = 0x04;
    pub(in super::super) const PUR: u8 = 0x08;
    pub(in super::super) const CS: u8 = 0x10;
    pub(in super::super) const CR: u8 = 0x20;
    pub(in super::super) const AVDDS: u8 = 0x80;
    pub(in super::super) const CHS: u8 = 0x80;
    pub(in super::super) const CAL_ERR: u8 = 0x08;
    pub(in super::super) const CALS: u8 = 0x04;
    pub(in super::super) const CRP: u8 = 0x80;
    pub(in super::super) const DRDY_SEL: u8 = 0x40;
    pub(in super::super) const FRD: u8 = 0x40;
    pub(in super::super) const SHORT: u8 = 0x08;
    pub(in super::super) const CHOPPER_OFF: u8 = 0x30;
    pub(in super::super) const RD_OTP_SEL: u8 = 0x80;
}

pub(super) const REGISTERS: usize = 0x20;

pub(super) fn reset_values() -> [u8; REGISTERS] {
    let mut registers = [0; REGISTERS];
    // Gain calibration 0x00800000 = 1.0, both channels.
    registers[reg::GCAL1 + 1] = 0x80;
    registers[reg::GCAL2 + 1] = 0x80;
    registers
}
