//! The bytes of every NAU7802 transaction, without a bus.
//!
//! A read is a write of the register address followed, after a repeated START, by a read (datasheet
//! section 8.3): 54 clocks for a sample, 135 us at 400 kHz, plus START and STOP.

use super::code::{AdcCode, Coefficients};
use super::regs::{Channel, PuCtrl, Register, Revision};

/// Write phase of a sample read. Reading 0x12 latches all 24 bits, so the three bytes belong
/// together.
pub const READ_ADC: [u8; 1] = [Register::Adco.address()];
/// Bytes of the read phase that follows [`READ_ADC`].
pub const READ_ADC_LEN: usize = 3;
/// SCL clocks of a sample read: address, register, address again and three data bytes, 9 each.
pub const READ_ADC_CLOCKS: u32 = 6 * 9;

/// Decodes the read phase of [`READ_ADC`]. A read before DRDY returns the previous result: pair it
/// with the DRDY edge.
pub const fn decode_adc(bytes: [u8; READ_ADC_LEN]) -> AdcCode {
    AdcCode::from_be_bytes(bytes)
}

/// Write phase of a status read; one byte follows, decoded by [`decode_status`].
pub const READ_STATUS: [u8; 1] = [Register::PuCtrl.address()];

/// Decodes the byte that follows [`READ_STATUS`].
pub const fn decode_status(byte: u8) -> PuCtrl {
    PuCtrl::from_bits(byte)
}

/// Write phase of a revision read; one byte follows, decoded by [`decode_revision`].
pub const READ_REVISION: [u8; 1] = [Register::Revision.address()];

/// Decodes the byte that follows [`READ_REVISION`].
pub const fn decode_revision(byte: u8) -> Revision {
    Revision::from_bits(byte)
}

/// The bytes that write one register.
pub const fn write_register(register: Register, value: u8) -> [u8; 2] {
    [register.address(), value]
}

/// Write phase of a read of both calibration coefficients; [`Coefficients::LEN`] bytes follow.
pub const fn read_coefficients(channel: Channel) -> [u8; 1] {
    [Coefficients::register(channel).address()]
}

/// The bytes that write both calibration coefficients in one burst.
pub const fn write_coefficients(
    channel: Channel,
    value: Coefficients,
) -> [u8; 1 + Coefficients::LEN] {
    let [a, b, c, d, e, f, g] = value.to_be_bytes();
    [
        Coefficients::register(channel).address(),
        a,
        b,
        c,
        d,
        e,
        f,
        g,
    ]
}
