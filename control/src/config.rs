//! A unit's configuration: the wire's physical numbers, checked, and the values that the sample path needs, precomputed
//! from them. Staged on the board and exchanged at a cycle boundary.
//!
//! Nothing here runs in the sample path, so conversions use `f64` (from libm) and divisions freely.

use crate::cell::CellConfig;
use crate::convert;
use crate::filter::FilterConfig;
use crate::limits::Rate;
use crate::units::{rounded, AdcCode, Newton};
use crate::NOMINAL_SPS;
use wire::message::{CellCorrection, FilterChoice, Ripple, UnitConfig, RIPPLES};

/// A number of the configuration, its range, and why the range is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name in [`UnitConfig`].
    pub name: &'static str,
    /// Position in [`UnitConfig`], from 0 in the order of declaration.
    pub number: u8,
    /// Smallest value.
    pub min: i32,
    /// Largest value.
    pub max: i32,
    /// Why.
    pub why: &'static str,
}

macro_rules! fields {
    ($($(#[$doc:meta])* $constant:ident = $number:literal, $name:literal, $min:literal ..= $max:literal, $why:literal;)*) => {
        /// The fields, for [`OutOfRange::field`] and for messages of the host.
        pub mod field {
            use super::Field;
            $($(#[$doc])* pub const $constant: Field = Field {
                name: $name, number: $number, min: $min, max: $max, why: $why,
            };)*
        }
        /// Every field that has a range, in the order of [`UnitConfig`].
        pub const FIELDS: &[Field] = &[$(field::$constant,)*];
    };
}

fields! {
    /// Scale of the load cell.
    SCALE = 1, "scale_pn_per_count", -30_000_000 ..= 30_000_000,
        "1,000,000 to 30,000,000 in size: measured cells have 6.2 to 7.3 million; the rest leaves room for 1 to 10 kg cells";
    /// Zero.
    ZERO = 2, "zero_code", -8_388_608 ..= 8_388_607, "24-bit code";
    /// Stored zero.
    STORED_ZERO = 3, "stored_zero_code", -8_388_608 ..= 8_388_607, "24-bit code";
    /// Permitted deviation of a zero.
    ZERO_DEVIATION = 4, "zero_deviation_un", 100_000 ..= 10_000_000,
        "0.1 N, less than a calibration of the converter moves the zero, to 10 N, twice the weight of a unit: 15 N of preload must never pass";
    /// Samples of the moving average, or corner of the low pass in 0.01 Hz.
    FILTER = 5, "filter", 1 ..= 12_000,
        "moving average of 1 to 16 samples; low pass of 5 Hz (below, the delay makes the loop unstable) to 120 Hz (the sample rate's half is 155 Hz at least)";
    /// Spike gate.
    SPIKE_LIMIT = 6, "spike_limit_un", 50_000 ..= 60_000_000,
        "50 mN is ten times the measured noise; 60 N is past the cell's full scale, so the gate never acts";
    /// Proportional gain.
    KP = 7, "kp_q16", 0 ..= 1_310_720, "0 to 20 N/N: the rig was run with up to 15";
    /// Integral gain.
    KI = 8, "ki_q16", 0 ..= 13_107_200, "0 to 200 N/(N s): ten times what 10 ms of delay allow";
    /// Derivative gain.
    KD = 9, "kd_q16", 0 ..= 32_768, "0 to 0.5 s: a sample period is 0.003 s";
    /// Damping.
    DAMPING = 10, "damping_q16", 0 ..= 65_536_000, "0 to 1,000 N s/m: critical for a 10 N/mm cable is 136";
    /// Friction offset.
    OFFSET = 12, "friction_offset_un", -3_000_000 ..= 3_000_000, "measured 155,000; 3 N would be a unit that hangs by its cable";
    /// Friction gain.
    GAIN = 13, "friction_gain_q16", 32_768 ..= 131_072, "0.5 to 2: measured 1.018";
    /// Coulomb friction.
    COULOMB = 14, "coulomb_un", 0 ..= 5_000_000, "measured 909,000; above 5 N the unit can't hold 2 N";
    /// Load dependence of Coulomb friction.
    COULOMB_LOAD = 15, "coulomb_load_q16", 0 ..= 26_214, "0 to 0.4 and at most half the friction gain, with more, winding in would take more than twice the force; measured 0.154";
    /// Reversal travel.
    REVERSAL = 16, "reversal_nm", 10_000 ..= 5_000_000,
        "10 um is two counts, less would be noise; over 5 mm the compensation would come after the disturbance";
    /// Encoder scale.
    TRAVEL = 17, "travel_nm_per_count", -100_000 ..= 100_000, "100 to 100,000 in size: nominal 4,229";
    /// DAC scale.
    DAC_SCALE = 18, "dac_counts_per_n_q16", -65_536_000 ..= 65_536_000,
        "10 to 1,000 counts/N in size: 282 (Z6A6 at +-10 V), 564 (+-5 V), 141 (Z12A8)";
    /// Force limit.
    FORCE_LIMIT = 19, "force_limit_un", 0 ..= 40_000_000,
        "0 to 40 N: cables carry up to 12 N and the cell is rated 29 N; the drive can pull 116 N, which must never reach the cable";
    /// Authority over the friction model.
    AUTHORITY = 20, "authority_un", 500_000 ..= 40_000_000,
        "0.5 N, less than friction varies, to 40 N, which limits nothing";
    /// Deviation from the friction model.
    PLAUSIBLE = 21, "plausible_un", 500_000 ..= 20_000_000,
        "0.5 N, less than friction varies, to 20 N, where the force limit comes first";
    /// Slew limit.
    SLEW = 22, "slew_un_per_s", 1_000_000 ..= 2_000_000_000,
        "1 N/s, below which nothing settles, to 2,000 N/s, past which it limits nothing";
    /// Over-tension.
    OVER_TENSION = 23, "over_tension_un", 1_000_000 ..= 50_000_000, "1 to 50 N: the cell's converter ends at 57 N";
    /// Viscous friction.
    VISCOUS = 24, "viscous_q16", 0 ..= 6_553_600, "0 to 100 N s/m: below the loop's damping, which keeps the loop stable if this is too large";
    /// A ripple's periods per count.
    RIPPLE_RATE = 25, "ripples.periods_per_count_q32", -858_993_459 ..= 858_993_459,
        "a fifth of a period a count at most, in size: finer ones cannot be distinguished from noise";
    /// A ripple's amplitude.
    RIPPLE_AMPLITUDE = 25, "ripples.amplitude_un", 0 ..= 3_000_000, "0 to 3 N: more is a broken reel and not a ripple";
    /// A ripple's amplitude per setpoint.
    RIPPLE_LOAD = 25, "ripples.amplitude_load_q16", 0 ..= 13_107, "0 to 0.2 N per N: a reel 2 mm out of round";
    /// A load cell's curve.
    CELL_CURVE = 26, "cell.curve_nn_per_n2", -20_000_000 ..= 20_000_000,
        "0.02 N per N^2 in size: 20 % at 10 N; with more, the conversion would turn back within its 20 N";
    /// A load cell's creep.
    CELL_CREEP = 26, "cell.creep_q16", -13_107 ..= 13_107, "0.2 in size: 400 times what a load cell of class C3 may creep";
    /// Time constant of a load cell's creep.
    CELL_CREEP_TIME = 26, "cell.creep_ms", 500 ..= 3_600_000,
        "0.5 s, below which the loop's own dynamics are, to 1 h, after which a zero is due";
}

/// A number that is out of its range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutOfRange {
    /// Which.
    pub field: Field,
    /// Smallest allowed value here (may be narrower than [`Field::min`]).
    pub min: i32,
    /// Largest allowed value here.
    pub max: i32,
    /// What was given.
    pub got: i32,
}

impl core::fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "{} = {}: allowed are {} to {} ({})",
            self.field.name, self.got, self.min, self.max, self.field.why
        )
    }
}

impl core::error::Error for OutOfRange {}

/// Fraction bits of `ki` per microsecond.
pub(crate) const KI_SHIFT: u32 = 42;
/// How much slower the setpoint may change than the command: 1/8. The command must outrun the setpoint, or
/// there is no margin left for feedback while the setpoint moves.
pub const SETPOINT_SLEW_SHIFT: u32 = 3;

/// A checked configuration with everything the sample path needs, precomputed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    wire: UnitConfig,
    pub(crate) cell: CellConfig,
    pub(crate) filter: FilterConfig,
    pub(crate) spike_limit: i32,
    pub(crate) kp_q16: i32,
    /// Integral gain per microsecond, times 2^42.
    pub(crate) ki_us: i32,
    /// Derivative gain times the nominal rate, times 65,536.
    pub(crate) kd_rate_q16: i32,
    /// Force steps per nanometre a nominal sample, times 65,536.
    pub(crate) damping: i32,
    pub(crate) friction: crate::friction::Model,
    pub(crate) travel_nm: i32,
    pub(crate) dac_q16: i32,
    pub(crate) force_limit: Newton,
    pub(crate) authority: Newton,
    pub(crate) plausible: Newton,
    /// Permitted deviation of a zero in ADC counts.
    pub(crate) zero_deviation: u32,
    pub(crate) slew: Rate,
    pub(crate) setpoint_slew: Rate,
    pub(crate) over_tension: Newton,
    /// [`Config::sum`] of the values above.
    seal: u32,
}

impl Config {
    /// What a unit of the thesis's rig starts with, as it goes over the wire.
    #[must_use]
    pub const fn nominal() -> UnitConfig {
        UnitConfig {
            enabled: true,
            scale_pn_per_count: 6_850_000,
            zero_code: 0,
            stored_zero_code: 0,
            zero_deviation_un: 8_000_000,
            filter: FilterChoice::LowPass { corner_chz: 10_000 },
            spike_limit_un: 1_000_000,
            kp_q16: 19_661, // 0.3
            ki_q16: 25 * 65_536,
            kd_q16: 0,
            damping_q16: 110 * 65_536,
            friction_feedforward: true,
            friction_offset_un: 155_000,
            friction_gain_q16: 66_716, // 1.018
            coulomb_un: 909_000,
            coulomb_load_q16: 10_093, // 0.154
            reversal_nm: 100_000,
            travel_nm_per_count: 4_229,
            dac_counts_per_n_q16: 18_495_479, // 282.22
            force_limit_un: 16_000_000,
            authority_un: 4_000_000,
            plausible_un: 2_500_000,
            slew_un_per_s: 400_000_000,
            over_tension_un: 20_000_000,
            viscous_q16: 0,
            ripples: [Ripple {
                periods_per_count_q32: 0,
                phase_q32: 0,
                amplitude_un: 0,
                amplitude_load_q16: 0,
            }; RIPPLES],
            cell: CellCorrection::NONE,
        }
    }

    /// Checks what came over the wire and precomputes.
    ///
    /// # Errors
    ///
    /// The first number that is out of its range, in the order of the fields.
    pub fn from_wire(wire: &UnitConfig) -> Result<Self, OutOfRange> {
        let w = wire;
        sized(field::SCALE, w.scale_pn_per_count, 1_000_000)?;
        within(field::ZERO, w.zero_code)?;
        within(field::STORED_ZERO, w.stored_zero_code)?;
        within(field::ZERO_DEVIATION, w.zero_deviation_un)?;
        match w.filter {
            FilterChoice::MovingAverage(n) => {
                narrow(field::FILTER, i32::from(n), 1, 16)?;
            }
            FilterChoice::LowPass { corner_chz } => {
                narrow(field::FILTER, i32::from(corner_chz), 500, 12_000)?;
            }
        }
        within(field::SPIKE_LIMIT, w.spike_limit_un)?;
        within(field::KP, w.kp_q16)?;
        within(field::KI, w.ki_q16)?;
        within(field::KD, w.kd_q16)?;
        within(field::DAMPING, w.damping_q16)?;
        within(field::OFFSET, w.friction_offset_un)?;
        within(field::GAIN, w.friction_gain_q16)?;
        within(field::COULOMB, w.coulomb_un)?;
        narrow(
            field::COULOMB_LOAD,
            w.coulomb_load_q16,
            field::COULOMB_LOAD.min,
            field::COULOMB_LOAD.max.min(w.friction_gain_q16 / 2),
        )?;
        within(field::REVERSAL, w.reversal_nm)?;
        sized(field::TRAVEL, w.travel_nm_per_count, 100)?;
        sized(field::DAC_SCALE, w.dac_counts_per_n_q16, 655_360)?;
        within(field::FORCE_LIMIT, w.force_limit_un)?;
        within(field::AUTHORITY, w.authority_un)?;
        within(field::PLAUSIBLE, w.plausible_un)?;
        within(field::SLEW, w.slew_un_per_s)?;
        within(field::OVER_TENSION, w.over_tension_un)?;
        within(field::VISCOUS, w.viscous_q16)?;
        for ripple in &w.ripples {
            within(field::RIPPLE_RATE, ripple.periods_per_count_q32)?;
            within(field::RIPPLE_AMPLITUDE, ripple.amplitude_un)?;
            within(field::RIPPLE_LOAD, ripple.amplitude_load_q16)?;
        }
        within(field::CELL_CURVE, w.cell.curve_nn_per_n2)?;
        within(field::CELL_CREEP, w.cell.creep_q16)?;
        within(field::CELL_CREEP_TIME, w.cell.creep_ms)?;

        let step = f64::from(1u32 << Newton::FRAC_BITS);
        let ki = f64::from(w.ki_q16) / 65_536.0;
        let damping = f64::from(w.damping_q16) / 65_536.0;
        let rate = f64::from(NOMINAL_SPS);
        Ok(Self {
            wire: *w,
            cell: CellConfig::new(w.scale_pn_per_count, w.zero_code, &w.cell),
            filter: FilterConfig::new(w.filter),
            spike_limit: Newton::from_un(w.spike_limit_un).to_bits(),
            kp_q16: w.kp_q16,
            ki_us: rounded(ki * 1e-6 * libm::exp2(f64::from(KI_SHIFT))),
            kd_rate_q16: w.kd_q16.saturating_mul(NOMINAL_SPS as i32),
            damping: rounded(damping * rate * 1e-9 * step * 65_536.0),
            friction: crate::friction::Model::new(w),
            travel_nm: w.travel_nm_per_count,
            dac_q16: w.dac_counts_per_n_q16,
            force_limit: Newton::from_un(w.force_limit_un),
            authority: Newton::from_un(w.authority_un),
            plausible: Newton::from_un(w.plausible_un),
            zero_deviation: rounded(
                f64::from(w.zero_deviation_un) * 1e6 / f64::from(w.scale_pn_per_count),
            )
            .unsigned_abs(),
            slew: Rate::from_un_per_s(w.slew_un_per_s),
            setpoint_slew: Rate::from_un_per_s(w.slew_un_per_s).shifted(SETPOINT_SLEW_SHIFT),
            over_tension: Newton::from_un(w.over_tension_un),
            seal: 0,
        }
        .sealed())
    }

    /// The configuration as it came over the wire, with the zero in force.
    #[must_use]
    pub const fn wire(&self) -> &UnitConfig {
        &self.wire
    }

    /// Cable a count of the encoder, in nanometres; negative where the counts fall while winding in.
    #[must_use]
    pub const fn nm_per_count(&self) -> i32 {
        self.travel_nm
    }

    /// The least tension that `command` can make ([`friction::Model::least`](crate::friction::Model::least)).
    #[must_use]
    pub const fn least_tension(&self, command: Newton) -> Newton {
        self.friction.least(command)
    }

    /// Whether this unit takes part.
    #[must_use]
    pub const fn enabled(&self) -> bool {
        self.wire.enabled
    }

    /// Largest commanded cable force.
    #[must_use]
    pub const fn force_limit(&self) -> Newton {
        self.force_limit
    }

    /// The averager of this unit's zero.
    #[must_use]
    pub const fn zero_averager(&self) -> crate::zero::Averager {
        crate::zero::Averager::new(self.wire.stored_zero_code, self.zero_deviation)
    }

    /// The same configuration with another zero (see [`crate::zero`]).
    #[must_use]
    pub const fn with_zero(mut self, zero: AdcCode) -> Self {
        self.wire.zero_code = zero.get();
        self.cell.zero = zero.get();
        self.sealed()
    }

    const fn sealed(mut self) -> Self {
        self.seal = self.sum();
        self
    }

    /// Sum of the numbers that turn codes to forces and forces to codes, each turned by another amount, so that every single
    /// bit that changes changes it.
    const fn sum(&self) -> u32 {
        let words = [
            self.cell.scale as u32,
            (self.cell.scale >> 32) as u32,
            self.cell.zero as u32,
            self.cell.curve as u32,
            self.cell.creep_q16 as u32,
            self.cell.creep_rate as u32,
            self.spike_limit as u32,
            self.kp_q16 as u32,
            self.ki_us as u32,
            self.kd_rate_q16 as u32,
            self.damping as u32,
            self.travel_nm as u32,
            self.dac_q16 as u32,
            self.force_limit.to_bits() as u32,
            self.authority.to_bits() as u32,
            self.plausible.to_bits() as u32,
            self.over_tension.to_bits() as u32,
            self.zero_deviation,
        ];
        // Not 0, which cleared memory has.
        let mut sum = 0x5EA1_C0DE;
        let mut rest = words.as_slice();
        while let Some((word, others)) = rest.split_first() {
            sum = u32::rotate_left(sum, 1) ^ *word;
            rest = others;
        }
        sum
    }

    /// Whether the numbers that a sample needs are as they were computed: a check of every sample, some 40 instructions.
    /// `false` means that the memory has changed.
    #[must_use]
    pub const fn is_sealed(&self) -> bool {
        self.seal == self.sum()
    }

    /// Whether the values of the sample path are still those of the wire's numbers: computes them again. `false` means that the
    /// memory has changed. Some ten thousand instructions.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        Self::from_wire(&self.wire).is_ok_and(|fresh| fresh == *self)
    }
}

/// For tests of [`Config::is_sealed`] and [`Config::is_sound`].
#[cfg(feature = "injection")]
impl Config {
    /// Bits that [`Config::flip`] knows.
    pub const BITS: u32 = Self::SLEW_BIT + 64;
    /// The first of them that belongs to the slew rate, which no sample's check covers.
    pub const SLEW_BIT: u32 = 18 * 32;

    /// Flips a bit of what was computed from the wire's numbers, as a fault of the memory does. Bits from
    /// [`Config::BITS`] on begin again.
    pub fn flip(&mut self, bit: u32) {
        let bit = bit % Self::BITS;
        let mask = 1 << (bit % 32);
        let newton = |value: &mut Newton| *value = Newton::from_bits(value.to_bits() ^ mask);
        match bit / 32 {
            0 => self.cell.zero ^= mask,
            1 => self.spike_limit ^= mask,
            2 => self.kp_q16 ^= mask,
            3 => self.ki_us ^= mask,
            4 => self.kd_rate_q16 ^= mask,
            5 => self.damping ^= mask,
            6 => self.travel_nm ^= mask,
            7 => self.dac_q16 ^= mask,
            8 => newton(&mut self.force_limit),
            9 => newton(&mut self.authority),
            10 => newton(&mut self.plausible),
            11 => newton(&mut self.over_tension),
            12 => self.zero_deviation ^= mask as u32,
            13 => self.cell.curve ^= mask,
            14 => self.cell.creep_q16 ^= mask,
            15 => self.cell.creep_rate ^= mask,
            16 | 17 => self.cell.scale ^= 1 << (bit - 16 * 32),
            _ => self.slew = self.slew.flipped(bit - Self::SLEW_BIT),
        }
    }
}

impl Default for Config {
    /// [`Config::nominal`], switched off: the configuration of a board before the host sends one.
    fn default() -> Self {
        let mut wire = Self::nominal();
        wire.enabled = false;
        // The nominal configuration is within its ranges (tested). Should an edit break that, a
        // configuration without gains and force is still a safe one.
        Self::from_wire(&wire).unwrap_or(Self {
            wire,
            cell: CellConfig::NONE,
            filter: FilterConfig::new(FilterChoice::MovingAverage(1)),
            spike_limit: 0,
            kp_q16: 0,
            ki_us: 0,
            kd_rate_q16: 0,
            damping: 0,
            friction: crate::friction::Model::new(&wire),
            travel_nm: 0,
            dac_q16: 0,
            force_limit: Newton::ZERO,
            authority: Newton::ZERO,
            plausible: Newton::ZERO,
            zero_deviation: 0,
            slew: Rate::default(),
            setpoint_slew: Rate::default(),
            over_tension: Newton::ZERO,
            seal: 0,
        })
    }
}

/// The nominal DAC scale in wire units, from [`convert`]'s constants.
#[must_use]
pub fn nominal_dac_counts_per_n_q16() -> i32 {
    rounded(convert::nominal_codes_per_newton() * 65_536.0)
}

fn within(field: Field, got: i32) -> Result<(), OutOfRange> {
    narrow(field, got, field.min, field.max)
}

fn narrow(field: Field, got: i32, min: i32, max: i32) -> Result<(), OutOfRange> {
    if (min..=max).contains(&got) {
        Ok(())
    } else {
        Err(OutOfRange {
            field,
            min,
            max,
            got,
        })
    }
}

/// For numbers that have a sign and may not be near zero.
fn sized(field: Field, got: i32, smallest: i32) -> Result<(), OutOfRange> {
    if got < 0 {
        narrow(field, got, field.min, -smallest)
    } else {
        narrow(field, got, smallest, field.max)
    }
}
