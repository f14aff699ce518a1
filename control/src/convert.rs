//! Force to torque to current to voltage to DAC code.
//!
//! | step | value | source |
//! | --- | --- | --- |
//! | reel radius | 10 mm | thesis 3.2.4 |
//! | gear | 26:7 | thesis 3.2.2 (3.7:1) |
//! | torque constant | 52.1 mN m/A | thesis 3.2.2 |
//! | amplifier Z6A6 | 0.6 A/V | maker's rating, Raven source |
//! | DAC7731 | +-10 V over 65,536 codes | datasheet, strap of this board |
//!
//! 0.0521 * 26/7 / 0.010 = 19.35 N/A; 20 V/65,536 * 0.6 A/V * 19.35 N/A = 3.543 mN a code, or 282.2
//! codes a newton. The unit's configuration carries that last number, so that another amplifier,
//! strap or a measured gain needs no new firmware.

use crate::units::{DacCode, Newton};

/// Torque constant in N m/A.
pub const TORQUE_CONSTANT_NM_PER_A: f64 = 0.0521;
/// Gear ratio, motor turns to a reel turn.
pub const GEAR: f64 = 26.0 / 7.0;
/// Reel radius in m.
pub const REEL_RADIUS_M: f64 = 0.010;
/// Amplifier gain in A/V.
pub const AMPLIFIER_A_PER_V: f64 = 0.6;
/// DAC span in V over 65,536 codes.
pub const DAC_SPAN_V: f64 = 20.0;
/// Encoder counts of a motor turn, at x4.
pub const COUNTS_PER_TURN: f64 = 4_000.0;

/// DAC codes per newton of cable force, from the constants above.
#[must_use]
pub fn nominal_codes_per_newton() -> f64 {
    let newton_per_ampere = TORQUE_CONSTANT_NM_PER_A * GEAR / REEL_RADIUS_M;
    65_536.0 / (DAC_SPAN_V * AMPLIFIER_A_PER_V * newton_per_ampere)
}

/// The DAC code of a command. `codes_per_newton_q16` may be negative (a motor wired the other way
/// round). Rounded to the nearest code, so off by at most half a code (1.77 mN); ends at the DAC's
/// ends.
#[must_use]
pub fn dac_code(command: Newton, codes_per_newton_q16: i32) -> DacCode {
    const SHIFT: u32 = Newton::FRAC_BITS + 16;
    let product = i64::from(command.to_bits()) * i64::from(codes_per_newton_q16);
    // 63 bits less 38.
    let steps = ((product + (1 << (SHIFT - 1))) >> SHIFT) as i32;
    DacCode((steps + 0x8000).clamp(0, 0xFFFF) as u16)
}
