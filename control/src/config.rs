//! A unit's configuration: the wire's physical numbers, checked, and the values that the sample
//! path needs, precomputed from them. Staged on the board and exchanged at a cycle boundary.
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Name in [`UnitConfig`].
    pub name: &'static str,
    /// Position in [`UnitConfig`], from 0 in the order of declaration.
    pub number: u8,
    /// SI unit of the quantity; empty for a plain number.
    pub unit: &'static str,
    /// Steps of the wire's number in one such unit.
    pub steps: f64,
    /// Smallest size, in that unit, of a number that may have either sign; otherwise 0.
    pub least_size: f64,
    /// Smallest value on the wire.
    pub min: i32,
    /// Largest value on the wire.
    pub max: i32,
    /// The range in the unit.
    range: (f64, f64),
    /// Why.
    pub why: &'static str,
}

impl Field {
    /// The range in [`Field::unit`].
    #[must_use]
    pub const fn range(&self) -> core::ops::RangeInclusive<f64> {
        self.range.0..=self.range.1
    }

    /// A quantity in [`Field::unit`] as it goes over the wire, rounded.
    #[must_use]
    pub const fn to_wire(&self, value: f64) -> i32 {
        steps(value, self.steps)
    }

    fn check(&'static self, got: i32) -> Result<(), OutOfRange> {
        match self.to_wire(self.least_size) {
            0 => self.narrow(got, self.min, self.max),
            least if got < 0 => self.narrow(got, self.min, -least),
            least => self.narrow(got, least, self.max),
        }
    }

    fn narrow(&'static self, got: i32, min: i32, max: i32) -> Result<(), OutOfRange> {
        if (min..=max).contains(&got) {
            return Ok(());
        }
        Err(OutOfRange {
            field: self,
            min,
            max,
            got,
        })
    }
}

/// `value` in steps, of which a unit has so many; rounded half away from 0.
const fn steps(value: f64, per_unit: f64) -> i32 {
    let half = if value < 0.0 { -0.5 } else { 0.5 };
    (value * per_unit + half) as i32
}

// Steps in a unit.
const ONE: f64 = 1.0;
const CENTI: f64 = 1e2;
const MILLI: f64 = 1e3;
const MICRO: f64 = 1e6;
const NANO: f64 = 1e9;
const PICO: f64 = 1e12;
const Q16: f64 = 65_536.0;
const Q32: f64 = 4_294_967_296.0;

/// The table of all numbers. A row: name and position, what a unit of the thesis's rig starts with,
/// the unit and the wire's steps in it, the range in that unit (`size`: with either sign), why.
/// Then the parts of what [`UnitConfig`] nests.
macro_rules! fields {
    (numbers { $($(#[$doc:meta])* $constant:ident = $number:literal, $name:ident = $nominal:literal,
        $unit:literal x $steps:ident, $($size:ident)? $min:literal ..= $max:literal, $why:literal;)* }
     parts { $($(#[$p_doc:meta])* $p_constant:ident = $p_number:literal, $group:ident.$part:ident,
        $p_unit:literal x $p_steps:ident, $p_min:literal ..= $p_max:literal, $p_why:literal;)* }) => {
        /// The fields, for [`OutOfRange::field`] and for messages of the host.
        pub mod field {
            use super::*;
            $($(#[$doc])* pub static $constant: Field = fields!(@field $number, stringify!($name),
                $unit, $steps, $($size)? $min, $max, $why);)*
            $($(#[$p_doc])* pub static $p_constant: Field = fields!(@field $p_number,
                concat!(stringify!($group), ".", stringify!($part)), $p_unit, $p_steps, $p_min, $p_max, $p_why);)*
        }
        /// Every field that has a range: the numbers of [`UnitConfig`] in their order, then the
        /// parts of its filter, ripples and cell.
        pub static FIELDS: &[&Field] = &[$(&field::$constant,)* $(&field::$p_constant,)*];

        impl Config {
            /// What a unit of the thesis's rig starts with, as it goes over the wire.
            #[must_use]
            pub fn nominal() -> UnitConfig {
                UnitConfig {
                    enabled: true,
                    friction_feedforward: true,
                    $($name: fields!(@nominal $name $nominal, $steps),)*
                    ripples: [Ripple::default(); RIPPLES],
                    cell: CellCorrection::NONE,
                }
            }

            /// Checks what came over the wire, in the order of the fields.
            fn check(wire: &UnitConfig) -> Result<(), OutOfRange> {
                $(fields!(@check wire, $constant, $name);)*
                for ripple in &wire.ripples {
                    $(fields!(@check_part ripples, ripple, $p_constant, $group.$part);)*
                }
                $(fields!(@check_part cell, wire.cell, $p_constant, $group.$part);)*
                Ok(())
            }
        }
    };
    (@field $number:literal, $name:expr, $unit:literal, $steps:ident, size $min:literal, $max:literal, $why:literal) => {
        Field { least_size: $min, ..fields!(@field $number, $name, $unit, $steps, -$max, $max, $why) }
    };
    (@field $number:literal, $name:expr, $unit:literal, $steps:ident, $min:expr, $max:literal, $why:literal) => {
        Field {
            name: $name, number: $number, unit: $unit, steps: $steps, least_size: 0.0,
            min: steps($min, $steps), max: steps($max, $steps), range: ($min, $max), why: $why,
        }
    };
    (@nominal filter $corner:literal, $steps:ident) => {
        FilterChoice::LowPass { corner_chz: steps($corner, $steps) as u16 }
    };
    (@nominal $name:ident $value:literal, $steps:ident) => { steps($value, $steps) };
    (@check $wire:ident, $constant:ident, filter) => {
        match $wire.filter {
            FilterChoice::MovingAverage(n) => field::FILTER_SAMPLES.check(i32::from(n))?,
            FilterChoice::LowPass { corner_chz } => field::$constant.check(i32::from(corner_chz))?,
        }
    };
    // With more than half the friction gain, winding in would take more than twice the force.
    (@check $wire:ident, $constant:ident, coulomb_load_q16) => {
        let field = &field::$constant;
        field.narrow($wire.coulomb_load_q16, field.min, field.max.min($wire.friction_gain_q16 / 2))?
    };
    (@check $wire:ident, $constant:ident, $name:ident) => { field::$constant.check($wire.$name)? };
    (@check_part ripples, $holder:expr, $constant:ident, ripples.$part:ident) => { field::$constant.check($holder.$part)? };
    (@check_part cell, $holder:expr, $constant:ident, cell.$part:ident) => { field::$constant.check($holder.$part)? };
    // The filter's are checked with its choice.
    (@check_part $($other:tt)*) => {};
}

fields! {
numbers {
    /// Scale of the load cell.
    SCALE = 1, scale_pn_per_count = 6.85e-6, "N/count" x PICO, size 1e-6 ..= 3e-5,
        "1,000,000 to 30,000,000 in size: measured cells have 6.2 to 7.3 million; the rest leaves room for 1 to 10 kg cells";
    /// Zero.
    ZERO = 2, zero_code = 0.0, "" x ONE, -8_388_608.0 ..= 8_388_607.0, "24-bit code";
    /// Stored zero.
    STORED_ZERO = 3, stored_zero_code = 0.0, "" x ONE, -8_388_608.0 ..= 8_388_607.0, "24-bit code";
    /// Permitted deviation of a zero.
    ZERO_DEVIATION = 4, zero_deviation_un = 8.0, "N" x MICRO, 0.1 ..= 10.0,
        "0.1 N, less than a calibration of the converter moves the zero, to 10 N, twice the weight of a unit: 15 N of preload must never pass";
    /// Corner of the low pass.
    FILTER = 5, filter = 100.0, "Hz" x CENTI, 5.0 ..= 120.0,
        "low pass of 5 Hz (below, the delay makes the loop unstable) to 120 Hz (the sample rate's half is 155 Hz at least)";
    /// Spike gate.
    SPIKE_LIMIT = 6, spike_limit_un = 1.0, "N" x MICRO, 0.05 ..= 60.0,
        "50 mN is ten times the measured noise; 60 N is past the cell's full scale, so the gate never acts";
    /// Proportional gain.
    KP = 7, kp_q16 = 0.3, "N/N" x Q16, 0.0 ..= 20.0, "0 to 20 N/N: the rig was run with up to 15";
    /// Integral gain.
    KI = 8, ki_q16 = 20.0, "N/(N s)" x Q16, 0.0 ..= 200.0, "0 to 200 N/(N s): ten times what 10 ms of delay allow";
    /// Derivative gain.
    KD = 9, kd_q16 = 0.0, "s" x Q16, 0.0 ..= 0.5, "0 to 0.5 s: a sample period is 0.003 s";
    /// Damping.
    DAMPING = 10, damping_q16 = 110.0, "N s/m" x Q16, 0.0 ..= 1000.0,
        "0 to 1,000 N s/m: critical for a 10 N/mm cable is 136";
    /// Friction offset.
    OFFSET = 12, friction_offset_un = 0.155, "N" x MICRO, -3.0 ..= 3.0,
        "measured 155,000; 3 N would be a unit that hangs by its cable";
    /// Friction gain.
    GAIN = 13, friction_gain_q16 = 1.018, "N/N" x Q16, 0.5 ..= 2.0, "0.5 to 2: measured 1.018";
    /// Coulomb friction.
    COULOMB = 14, coulomb_un = 0.909, "N" x MICRO, 0.0 ..= 5.0, "measured 909,000; above 5 N the unit can't hold 2 N";
    /// Load dependence of Coulomb friction.
    COULOMB_LOAD = 15, coulomb_load_q16 = 0.154, "N/N" x Q16, 0.0 ..= 0.4,
        "0 to 0.4 and at most half the friction gain, with more, winding in would take more than twice the force; measured 0.154";
    /// Reversal travel.
    REVERSAL = 16, reversal_nm = 1e-4, "m" x NANO, 1e-5 ..= 5e-3,
        "10 um is two counts, less would be noise; over 5 mm the compensation would come after the disturbance";
    /// Encoder scale.
    TRAVEL = 17, travel_nm_per_count = 4.229e-6, "m/count" x NANO, size 1e-7 ..= 1e-4,
        "100 to 100,000 in size: nominal 4,229";
    /// DAC scale.
    DAC_SCALE = 18, dac_counts_per_n_q16 = 282.21861, "counts/N" x Q16, size 10.0 ..= 1000.0,
        "10 to 1,000 counts/N in size: 282 (Z6A6 at +-10 V), 564 (+-5 V), 141 (Z12A8)";
    /// Force limit.
    FORCE_LIMIT = 19, force_limit_un = 16.0, "N" x MICRO, 0.0 ..= 40.0,
        "0 to 40 N: cables carry up to 12 N and the cell is rated 29 N; the drive can pull 116 N, which must never reach the cable";
    /// Authority over the friction model.
    AUTHORITY = 20, authority_un = 4.0, "N" x MICRO, 0.5 ..= 40.0,
        "0.5 N, less than friction varies, to 40 N, which limits nothing";
    /// Deviation from the friction model.
    PLAUSIBLE = 21, plausible_un = 2.5, "N" x MICRO, 0.5 ..= 20.0,
        "0.5 N, less than friction varies, to 20 N, where the force limit comes first";
    /// Slew limit.
    SLEW = 22, slew_un_per_s = 400.0, "N/s" x MICRO, 1.0 ..= 2000.0,
        "1 N/s, below which nothing settles, to 2,000 N/s, past which it limits nothing";
    /// Over-tension.
    OVER_TENSION = 23, over_tension_un = 20.0, "N" x MICRO, 1.0 ..= 50.0, "1 to 50 N: the cell's converter ends at 57 N";
    /// Viscous friction.
    VISCOUS = 24, viscous_q16 = 0.0, "N s/m" x Q16, 0.0 ..= 100.0,
        "0 to 100 N s/m: below the loop's damping, which keeps the loop stable if this is too large";
    /// Largest tension of a setpoint.
    TENSION_MAX = 27, tension_max_un = 12.0, "N" x MICRO, 0.0 ..= 40.0,
        "0 to 40 N, as the force limit: cables carry up to 12 N (thesis 3.7)";
    /// Gain of the leaking integral.
    LEAKY_KI = 28, leaky_ki_q16 = 30.0, "N/(N s)" x Q16, 0.0 ..= 200.0, "0 to 200 N/(N s), as the integral";
}
parts {
    /// Samples of the moving average.
    FILTER_SAMPLES = 5, filter.samples, "" x ONE, 1.0 ..= 16.0, "moving average of 1 to 16 samples";
    /// A ripple's periods per count.
    RIPPLE_RATE = 25, ripples.periods_per_count_q32, "1/count" x Q32, -0.2 ..= 0.2,
        "a fifth of a period a count at most, in size: finer ones cannot be distinguished from noise";
    /// A ripple's amplitude.
    RIPPLE_AMPLITUDE = 25, ripples.amplitude_un, "N" x MICRO, 0.0 ..= 3.0, "0 to 3 N: more is a broken reel and not a ripple";
    /// A ripple's amplitude per setpoint.
    RIPPLE_LOAD = 25, ripples.amplitude_load_q16, "N/N" x Q16, 0.0 ..= 0.2, "0 to 0.2 N per N: a reel 2 mm out of round";
    /// A load cell's curve.
    CELL_CURVE = 26, cell.curve_nn_per_n2, "1/N" x NANO, -0.02 ..= 0.02,
        "0.02 N per N^2 in size: 20 % at 10 N; with more, the conversion would turn back within its 20 N";
    /// A load cell's creep.
    CELL_CREEP = 26, cell.creep_q16, "N/N" x Q16, -0.2 ..= 0.2, "0.2 in size: 400 times what a load cell of class C3 may creep";
    /// Time constant of a load cell's creep.
    CELL_CREEP_TIME = 26, cell.creep_ms, "s" x MILLI, 0.5 ..= 3600.0,
        "0.5 s, below which the loop's own dynamics are, to 1 h, after which a zero is due";
}
}

/// A number that is out of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutOfRange {
    /// Which.
    pub field: &'static Field,
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
/// How much slower the setpoint may change than the command: 1/8. The command must outrun the
/// setpoint, or there is no margin left for feedback while the setpoint moves.
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
    /// Gain of the leaking integral per nominal sample, times 2^24.
    pub(crate) leaky_ki: i32,
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
    /// The same of a unit that follows setpoints: its zero was measured.
    pub(crate) over_tension_driven: Newton,
    /// [`Config::sum`] of the values above.
    seal: u32,
}

/// Over-tension of a unit that follows setpoints, 13 N: what docs/safety.md counts as a hazard. A
/// unit without a zero reads up to 4 N more than its cable pulls, so it has the configured limit
/// alone.
const DRIVEN_UN: i32 = 13_000_000;
/// Where tensions above 12 N are permitted, this much above the largest: the error at a first
/// reversal with friction 40 % above the declared one (docs/figures.md).
const ABOVE_TENSION_MAX_UN: i32 = 1_000_000;

impl Config {
    /// Checks what came over the wire and precomputes.
    ///
    /// # Errors
    ///
    /// The first number that is out of its range, in the order of the fields.
    pub fn from_wire(wire: &UnitConfig) -> Result<Self, OutOfRange> {
        Self::check(wire)?;
        Ok(Self::computed(wire))
    }

    /// What the sample path needs, from numbers that are within their ranges.
    fn computed(w: &UnitConfig) -> Self {
        let step = f64::from(1u32 << Newton::FRAC_BITS);
        let ki = f64::from(w.ki_q16) / 65_536.0;
        let damping = f64::from(w.damping_q16) / 65_536.0;
        let rate = f64::from(NOMINAL_SPS);
        Self {
            wire: *w,
            cell: CellConfig::new(w.scale_pn_per_count, w.zero_code, &w.cell),
            filter: FilterConfig::new(w.filter),
            spike_limit: Newton::from_un(w.spike_limit_un).to_bits(),
            kp_q16: w.kp_q16,
            ki_us: rounded(ki * 1e-6 * libm::exp2(f64::from(KI_SHIFT))),
            leaky_ki: rounded(f64::from(w.leaky_ki_q16) * 256.0 / rate),
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
            over_tension_driven: Newton::from_un(
                w.over_tension_un
                    .min(DRIVEN_UN.max(w.tension_max_un.saturating_add(ABOVE_TENSION_MAX_UN))),
            ),
            seal: 0,
        }
        .sealed()
    }

    /// The configuration as it came over the wire, with the zero in force.
    #[must_use]
    pub const fn wire(&self) -> &UnitConfig {
        &self.wire
    }

    /// Cable a count of the encoder, in nanometres; negative where the counts fall while winding
    /// in.
    #[must_use]
    pub const fn nm_per_count(&self) -> i32 {
        self.travel_nm
    }

    /// The least tension that `command` can make
    /// ([`friction::Model::least`](crate::friction::Model::least)).
    #[must_use]
    pub const fn least_tension(&self, command: Newton) -> Newton {
        self.friction.least(command)
    }

    /// Tension that the cable must come down to once its motor is at 0 V
    /// ([`friction::Model::let_go`](crate::friction::Model::let_go)).
    #[must_use]
    pub fn let_go(&self) -> Newton {
        self.friction.let_go()
    }

    /// Swing of tension less command that the resting reel may hold
    /// ([`friction::Model::still_swing`](crate::friction::Model::still_swing)).
    #[must_use]
    pub fn still_swing(&self) -> Newton {
        let largest = Newton::from_un(self.wire.tension_max_un);
        self.friction.still_swing(largest)
    }

    /// Whether this unit takes part.
    #[must_use]
    pub const fn enabled(&self) -> bool {
        self.wire.enabled
    }

    /// Tension that trips the unit while it is `driven`, or at 0 V, where its zero may not have
    /// been measured.
    #[must_use]
    pub const fn over_tension(&self, driven: bool) -> Newton {
        if driven {
            self.over_tension_driven
        } else {
            self.over_tension
        }
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

    /// Permitted deviation of a zero in ADC counts.
    #[must_use]
    pub const fn zero_deviation(&self) -> u32 {
        self.zero_deviation
    }

    /// How far the code of a slack cable would be from the stored zero where this tension is
    /// measured, in ADC counts. Not in the sample path: it divides.
    #[must_use]
    pub fn from_stored_zero(&self, tension: Newton) -> i32 {
        let scale = i64::from(self.wire.scale_pn_per_count);
        let counts = (i64::from(tension.to_un()) * 1_000_000).checked_div(scale);
        let zero = i64::from(self.wire.zero_code) - i64::from(self.wire.stored_zero_code);
        let limit = i64::from(AdcCode::MAX.get());
        (counts.unwrap_or(limit) + zero).clamp(-limit, limit) as i32
    }

    /// The same configuration with another zero (see [`crate::zero`]).
    #[must_use]
    pub fn with_zero(mut self, zero: AdcCode) -> Self {
        self.wire.zero_code = zero.get();
        self.cell.zero = zero.get();
        self.sealed()
    }

    fn sealed(mut self) -> Self {
        self.seal = self.sum();
        self
    }

    /// Sum of the numbers that turn codes to forces and forces to codes, each turned by another
    /// amount, so that every single bit that changes changes it.
    fn sum(&self) -> u32 {
        // Not 0, which cleared memory has.
        (self.words().into_iter()).fold(0x5EA1_C0DE, |sum, word| u32::rotate_left(sum, 1) ^ word)
    }

    /// Whether the numbers that a sample needs are as they were computed: a check of every sample,
    /// some 40 instructions. `false` means that the memory has changed.
    #[must_use]
    pub fn is_sealed(&self) -> bool {
        self.seal == self.sum()
    }

    /// Whether the values of the sample path are still those of the wire's numbers: computes them
    /// again. `false` means that the memory has changed. Some ten thousand instructions.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        Self::from_wire(&self.wire).is_ok_and(|fresh| fresh == *self)
    }
}

/// A number of 32 bits under the seal.
trait Word {
    fn bits(self) -> u32;
    #[cfg(feature = "injection")]
    fn from_word(bits: u32) -> Self;
}

macro_rules! words {
    ($($type:ty: $bits:expr, $from:expr;)*) => {$(
        impl Word for $type {
            fn bits(self) -> u32 {
                $bits(self)
            }
            #[cfg(feature = "injection")]
            fn from_word(bits: u32) -> Self {
                $from(bits)
            }
        }
    )*};
}

words! {
    i32: i32::cast_unsigned, u32::cast_signed;
    u32: core::convert::identity, core::convert::identity;
    Newton: |force: Newton| force.to_bits().cast_unsigned(), |bits: u32| Newton::from_bits(bits.cast_signed());
}

macro_rules! sealed {
    ($count:literal: $($first:ident $(.$second:ident)?,)*) => {
        impl Config {
            /// The words of [`Config::sum`]: these numbers, and the cell's scale.
            fn words(&self) -> [u32; $count + 2] {
                let scale = self.cell.scale;
                [$(self.$first $(.$second)?.bits(),)* scale as u32, (scale >> 32) as u32]
            }
        }

        /// For tests of [`Config::is_sealed`] and [`Config::is_sound`].
        #[cfg(feature = "injection")]
        impl Config {
            /// Bits that [`Config::flip`] knows.
            pub const BITS: u32 = Self::SLEW_BIT + 64;
            /// The first of them that belongs to the slew rate, which no sample's check covers.
            pub const SLEW_BIT: u32 = ($count + 2) * 32;

            /// Flips a bit of what was computed from the wire's numbers, as a fault of the memory
            /// does. Bits from [`Config::BITS`] on begin again.
            pub fn flip(&mut self, bit: u32) {
                const SCALE_BIT: u32 = $count * 32;
                let bit = bit % Self::BITS;
                match bit {
                    Self::SLEW_BIT.. => self.slew = self.slew.flipped(bit - Self::SLEW_BIT),
                    SCALE_BIT.. => self.cell.scale ^= 1 << (bit - SCALE_BIT),
                    _ => {
                        let mut words = 0..;
                        $(if words.next() == Some(bit / 32) {
                            let word = self.$first $(.$second)?.bits() ^ 1 << (bit % 32);
                            self.$first $(.$second)? = Word::from_word(word);
                        })*
                    }
                }
            }
        }
    };
}

sealed! { 18:
    cell.zero, spike_limit, kp_q16, ki_us, leaky_ki, kd_rate_q16, damping, travel_nm, dac_q16, force_limit, authority, plausible,
    over_tension, over_tension_driven, zero_deviation, cell.curve, cell.creep_q16, cell.creep_rate,
}

impl Default for Config {
    /// [`Config::nominal`], switched off: the configuration of a board before the host sends one.
    fn default() -> Self {
        Self::computed(&UnitConfig {
            enabled: false,
            ..Self::nominal()
        })
    }
}

/// The nominal DAC scale in wire units, from [`convert`]'s constants.
#[must_use]
pub fn nominal_dac_counts_per_n_q16() -> i32 {
    rounded(convert::nominal_codes_per_newton() * 65_536.0)
}
