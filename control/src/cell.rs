//! The load cell's conversion: code to force, with the cell's curve and its creep taken out.
//!
//! ```text
//! force on the cell ─ creep ─ curve ─▶ code        the cell
//! code ─ zero, scale ─ gate ─ curve ─ creep ─▶ force   the board, in the reverse order
//! ```
//!
//! A cell that creeps reads `l + s` under a load `l`, with `ds/dt = (share l - s) / tau`: the
//! reading goes on growing by `share` of a lasting load. A curved cell reads `x` for `x + c x^2`.
//! Both come from weights (`forcectl calibrate gain`); without a calibration both are 0, and the
//! conversion is a straight line.

use crate::units::{rounded, AdcCode, Newton};
use wire::message::{CellCorrection, UnitConfig};

/// Fraction bits of [`CellConfig::scale`].
const SCALE_SHIFT: u32 = 30;
/// Fraction bits of [`CellConfig::curve`].
const CURVE_SHIFT: u32 = 36;
/// Reading up to which the curve is applied, in N; beyond, the correction stays what it is there.
/// Twice the largest calibration weight: a parabola means nothing further out, and the conversion
/// has to rise everywhere.
pub const CURVE_RANGE: Newton = Newton::from_un(20_000_000);
/// Fraction bits of [`CellConfig::creep_rate`].
const RATE_SHIFT: u32 = 42;
/// Fraction bits that [`Creep::state`] has more than [`Newton`].
const STATE_SHIFT: u32 = 26;

/// The conversion's numbers, precomputed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct CellConfig {
    /// Force steps per ADC count, times 2^30: 37 bits, which with 25 bits of code make 62.
    pub scale: i64,
    /// ADC code at zero load; 0 before the first zero.
    pub zero: i32,
    /// Curve in 1/N, times 2^36.
    pub curve: i32,
    /// Share of a lasting load by which the reading grows, times 65,536.
    pub creep_q16: i32,
    /// 1 / time constant in 1/us, times 2^42.
    pub creep_rate: i32,
}

impl CellConfig {
    /// From the wire's numbers, which are in their ranges.
    pub fn new(scale_pn_per_count: i32, zero: i32, cell: &CellCorrection) -> Self {
        let step = f64::from(1u32 << Newton::FRAC_BITS);
        let scale = f64::from(scale_pn_per_count) * 1e-12 * step * f64::from(1u32 << SCALE_SHIFT);
        let bits = libm::exp2(f64::from(CURVE_SHIFT));
        let rate = libm::exp2(f64::from(RATE_SHIFT)) / (f64::from(cell.creep_ms) * 1e3);
        Self {
            scale: libm::round(scale) as i64,
            zero,
            curve: rounded(f64::from(cell.curve_nn_per_n2) * 1e-9 * bits),
            creep_q16: cell.creep_q16,
            creep_rate: rounded(rate),
        }
    }

    /// Code to force by zero and scale alone.
    pub const fn straight(&self, code: AdcCode) -> Newton {
        let counts = code.get() as i64 - self.zero as i64;
        Newton::from_wide_shifted(counts * self.scale, SCALE_SHIFT)
    }

    /// The straight reading with the curve applied: `x + c x^2`.
    pub fn curved(&self, straight: Newton) -> Newton {
        let x = i64::from(straight.clamp_abs(CURVE_RANGE).to_bits());
        // x takes 27 bits and a sign, its square in steps 31 bits, the curve 31 bits.
        let square = (x * x) >> Newton::FRAC_BITS;
        let bend = Newton::from_wide_shifted(square * i64::from(self.curve), CURVE_SHIFT);
        straight.saturating_add(bend)
    }
}

/// What a cell has crept so far. It starts at none with the first zero: a cell that hangs empty is
/// taken as relaxed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Creep {
    /// Newton, with 48 fraction bits.
    state: i64,
}

impl Creep {
    /// Part of the reading that is creep.
    #[must_use]
    pub const fn force(self) -> Newton {
        Newton::from_wide_shifted(self.state, STATE_SHIFT)
    }

    /// Takes the creep out of a reading, and lets it go on under the load that is left.
    pub(crate) fn step(&mut self, cell: &CellConfig, reading: Newton, dt_us: u32) -> Newton {
        if cell.creep_q16 == 0 || cell.zero == 0 {
            self.state = 0;
            return reading;
        }
        let crept = self.force();
        let load = reading.saturating_sub(crept);
        // Where the creep would end under this load.
        let end =
            Newton::from_wide_shifted(i64::from(load.to_bits()) * i64::from(cell.creep_q16), 16);
        // dt over the time constant with 34 fraction bits: at most 29 bits. The distance takes 32
        // and a sign.
        let part = (i64::from(dt_us) * i64::from(cell.creep_rate)) >> 8;
        let distance = i64::from(end.to_bits()) - i64::from(crept.to_bits());
        self.state += (distance * part) >> (34 - STATE_SHIFT);
        load
    }

    /// The zero of a cell whose mean code under no load is `mean`: less what it has crept, which
    /// goes away.
    pub(crate) fn relaxed(self, cell: &CellConfig, mean: AdcCode) -> AdcCode {
        let steps = i64::from(self.force().to_bits()) << SCALE_SHIFT;
        let counts = steps.checked_div(cell.scale).unwrap_or(0);
        let counts = counts.clamp(i64::from(AdcCode::MIN.get()), i64::from(AdcCode::MAX.get()));
        AdcCode::new(mean.get().saturating_sub(counts as i32))
    }
}

/// The same in `f64`, for programs that start from the codes of a recording or a stream: what the
/// board has before its spike gate and filters, without their delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellForce {
    newton_per_count: f64,
    zero: f64,
    correction: CellCorrection,
    crept_n: f64,
    last_us: Option<u64>,
}

impl CellForce {
    /// With zero, scale and correction of a configuration in force.
    #[must_use]
    pub fn new(config: &UnitConfig) -> Self {
        Self {
            newton_per_count: f64::from(config.scale_pn_per_count) * 1e-12,
            zero: f64::from(config.zero_code),
            correction: config.cell,
            crept_n: 0.0,
            last_us: None,
        }
    }

    /// Force along the cell's axis at a conversion, N. The creep starts as that of a cell that has
    /// long had the first load; a time before the last one lets no time pass.
    pub fn at(&mut self, code: i32, at_us: u64) -> f64 {
        let straight_n = (f64::from(code) - self.zero) * self.newton_per_count;
        let range_n = CURVE_RANGE.to_f64();
        let bent_n = straight_n.clamp(-range_n, range_n);
        let reading_n =
            straight_n + f64::from(self.correction.curve_nn_per_n2) * 1e-9 * bent_n * bent_n;
        let share = f64::from(self.correction.creep_q16) / 65_536.0;
        let end_n = share * reading_n / (1.0 + share);
        let left = self.last_us.map_or(0.0, |last| {
            let times = at_us.saturating_sub(last) as f64
                / (1e3 * f64::from(self.correction.creep_ms.max(1)));
            libm::exp(-(1.0 + share) * times)
        });
        self.crept_n = end_n + (self.crept_n - end_n) * left;
        self.last_us = Some(at_us);
        reading_n - self.crept_n
    }
}
