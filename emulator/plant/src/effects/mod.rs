//! Physical effects beyond the rig of [`crate::config`]: for experiments in which the plant does
//! what a model of it does not say. All are off by default.
//!
//! One row of the table each: parameters with their ranges, and how the effect enters the places
//! where the physics asks (`Modifiers`). To add one: a row and a test. Several effects of one kind
//! add up.
//!
//! In TOML, `units` counts from 0 and may be left out for all units:
//!
//! ```toml
//! [[effects]]
//! kind = "periodic"
//! units = [0, 3]
//! shaft = "reel"
//! order = 1.0
//! amplitude_n = 0.3
//! ```

mod modifiers;

pub(crate) use modifiers::Modifiers;

use crate::error::{ConfigError, Within};
use serde::{Deserialize, Serialize};

/// Which shaft's angle counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shaft {
    /// The reel: eccentric rim, unbalance (order 1), gear output.
    Reel,
    /// The motor: cogging, commutation, gear input.
    Motor,
}

/// Where a tone enters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TonePlace {
    /// Electrical, on the bridge output; amplitude as force.
    Bridge,
    /// Mechanical, as a pull of the drive.
    Drive,
}

/// A row: `Kind(units) { parameters, with ranges } |effect, modifiers| how it enters`. `units` is
/// left out where the effect is not in a unit.
macro_rules! effects {
    ($($(#[$doc:meta])* $kind:ident($($units:ident)?) {
        $($(#[$field_doc:meta])* $field:ident: $type:ident $(in $low:literal ..= $high:literal)?,)*
    } |$effect:ident, $to:ident| $install:expr;)*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
            #[serde(deny_unknown_fields)]
            pub struct $kind {
                $(
                    /// Units, from 0; empty: all.
                    #[serde(default)]
                    pub $units: Vec<usize>,
                )?
                $($(#[$field_doc])* pub $field: $type,)*
            }
        )*

        /// One effect.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind", rename_all = "snake_case")]
        pub enum Effect {
            $($(#[$doc])* $kind($kind),)*
        }

        impl Effect {
            /// Adds the effect to what the physics of one unit asks.
            fn install(&self, to: &mut Modifiers) {
                match self {
                    $(Self::$kind($effect) => {
                        let $to = to;
                        $install
                    })*
                }
            }

            /// Name, value, lowest and highest of every parameter that has a range.
            fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
                match self {
                    $(Self::$kind(effect) => {
                        vec![$($((stringify!($field), effect.$field, $low, $high),)?)*]
                    })*
                }
            }

            /// The units that it lists.
            fn listed(&self) -> &[usize] {
                match self {
                    $(Self::$kind(_effect) => effects!(@listed _effect $($units)?),)*
                }
            }
        }
    };
    (@listed $effect:ident) => { &[] };
    (@listed $effect:ident $units:ident) => { &$effect.$units };
}

effects! {
    /// Friction that grows with speed: `-c v` at the cable.
    Viscous(units) {
        /// c, N.s/m, 0 to 200.
        coefficient_n_s_per_m: f64 in 0.0 ..= 200.0,
    } |effect, to| to.viscous_n_s_per_m += effect.coefficient_n_s_per_m;

    /// An excess of the friction level that fades with speed: `excess exp(-(v/v_s)^2)`.
    Stribeck(units) {
        /// Excess at standstill, N, 0 to 10.
        excess_n: f64 in 0.0 ..= 10.0,
        /// v_s at the cable, m/s, above 1e-5.
        velocity_m_per_s: f64 in 1e-5 ..= 10.0,
    } |effect, to| to.stribeck.push(effect.clone());

    /// An addition to the friction level: `constant + per_load |u|`.
    Coulomb(units) {
        /// Constant part, N, -5 to 10; the level never falls below zero.
        constant_n: f64 in -5.0 ..= 10.0,
        /// Part per motor pull, -0.5 to 0.5.
        #[serde(default)]
        per_load: f64 in -0.5 ..= 0.5,
    } |effect, to| {
        to.coulomb_n += effect.constant_n;
        to.per_load += effect.per_load;
    };

    /// An addition to the friction level that changes with time, as grease does that warms: `end +
    /// (begin - end) exp(-t/tau)`.
    ChangingFriction(units) {
        /// Addition at the start of the first run, N, -5 to 10; the level never falls below zero.
        begin_n: f64 in -5.0 ..= 10.0,
        /// Addition in the end, N, -5 to 10.
        end_n: f64 in -5.0 ..= 10.0,
        /// tau, s, above 0.01.
        time_constant_s: f64 in 0.01 ..= 1e6,
        /// How much later than the run before a further run of the rig begins, s, 0 to 100000; 0:
        /// each begins anew.
        #[serde(default)]
        run_s: f64 in 0.0 ..= 1e5,
    } |effect, to| to.changing_friction.push(effect.clone());

    /// A pull of `amplitude sin(order angle + phase)` at the cable.
    Periodic(units) {
        /// Whose angle.
        shaft: Shaft,
        /// Periods per turn, 0.01 to 200.
        order: f64 in 0.01 ..= 200.0,
        /// Amplitude, N, 0 to 10.
        amplitude_n: f64 in 0.0 ..= 10.0,
        /// Phase at the starting angle, rad.
        #[serde(default)]
        phase_rad: f64 in -1e3 ..= 1e3,
    } |effect, to| to.periodic.push(effect.clone());

    /// Play between the gear (with the encoder's side of the drive) and the reel. The reel becomes
    /// a mass of its own; part of the drive's friction moves to its bearing and holds it inside the
    /// gap.
    Backlash(units) {
        /// Whole play, m of cable, 0 to 0.02.
        gap_m: f64 in 0.0 ..= 0.02,
        /// Friction of the reel's bearing, N, 0.01 to 5; taken off the drive's own.
        reel_friction_n: f64 in 0.01 ..= 5.0,
    } |effect, to| {
        // Plays in series act as one; the bearing's friction is that of the stiffer one.
        let before = to.backlash.take();
        to.backlash = Some(Backlash {
            units: Vec::new(),
            gap_m: effect.gap_m + before.as_ref().map_or(0.0, |b| b.gap_m),
            reel_friction_n: effect
                .reel_friction_n
                .max(before.map_or(0.0, |b| b.reel_friction_n)),
        });
    };

    /// More reflected mass.
    Inertia(units) {
        /// Mass at the cable, kg, 0 to 20.
        mass_kg: f64 in 0.0 ..= 20.0,
    } |effect, to| to.mass_kg += effect.mass_kg;

    /// Gain error of the amplifier.
    AmplifierGain(units) {
        /// Relative error, -0.9 to 1.
        relative_error: f64 in -0.9 ..= 1.0,
    } |effect, to| to.amplifier_gain_error += effect.relative_error;

    /// Dead time between amplifier input and current command.
    CommandDelay(units) {
        /// Delay, s, 0 to 0.5; rounded to whole grid steps.
        delay_s: f64 in 0.0 ..= 0.5,
    } |effect, to| to.delay_s += effect.delay_s;

    /// Zero of the bridge that walks with time, as force.
    ZeroDrift(units) {
        /// Rate, N/s, -1 to 1.
        rate_n_per_s: f64 in -1.0 ..= 1.0,
    } |effect, to| to.drift_n_per_s += effect.rate_n_per_s;

    /// Warm-up from 25 degrees Celsius: `rise (1 - exp(-t/tau))`.
    TemperatureDrift(units) {
        /// Rise, K, -50 to 50.
        rise_k: f64 in -50.0 ..= 50.0,
        /// tau, s, above 0.01.
        time_constant_s: f64 in 0.01 ..= 1e6,
        /// Zero shift, N/K, -1 to 1. Cheap 3 kg cells: about 0.006 (0.02 % of capacity per K).
        zero_n_per_k: f64 in -1.0 ..= 1.0,
        /// Relative change of the cell's gain, 1/K, -0.01 to 0.01.
        #[serde(default)]
        gain_per_k: f64 in -0.01 ..= 0.01,
    } |effect, to| to.temperature.push(effect.clone());

    /// Creep of the cell: the reading settles to `(1 + fraction)` of the load.
    Creep(units) {
        /// Fraction, -0.5 to 0.5.
        fraction: f64 in -0.5 ..= 0.5,
        /// Time constant, s, above 0.01.
        time_constant_s: f64 in 0.01 ..= 1e6,
    } |effect, to| to.creep.push(effect.clone());

    /// Part of another cell's load in the reading.
    Crosstalk(units) {
        /// Unit that it comes from.
        from_unit: usize,
        /// Part of its load, -1 to 1.
        fraction: f64 in -1.0 ..= 1.0,
    } |effect, to| to.crosstalk.push(effect.clone());

    /// Reading `f + k f^2` for a load `f`.
    CellQuadratic(units) {
        /// k, 1/N, -0.02 to 0.02.
        per_n: f64 in -0.02 ..= 0.02,
    } |effect, to| to.quadratic_per_n += effect.per_n;

    /// Axis of the cell that is not where the survey found it: a tilt beside that of
    /// `units.axis_tilt_rad`.
    CellTilt(units) {
        /// The first of its angles, rad, -0.5 to 0.5.
        #[serde(default)]
        first_rad: f64 in -0.5 ..= 0.5,
        /// The second, rad, -0.5 to 0.5.
        #[serde(default)]
        second_rad: f64 in -0.5 ..= 0.5,
    } |effect, to| {
        to.cell_tilt_rad[0] += effect.first_rad;
        to.cell_tilt_rad[1] += effect.second_rad;
    };

    /// Tension `EA e (1 + k e)` for a strain `e`.
    CableHardening(units) {
        /// k, 0 to 5000 (12 N is a strain of about 1.2e-3 for the default cable).
        per_strain: f64 in 0.0 ..= 5e3,
    } |effect, to| to.hardening_per_strain += effect.per_strain;

    /// A sine in time.
    Tone(units) {
        /// Where it enters.
        place: TonePlace,
        /// Frequency, Hz, 0.001 to 5000.
        frequency_hz: f64 in 1e-3 ..= 5e3,
        /// Amplitude, N, 0 to 10.
        amplitude_n: f64 in 0.0 ..= 10.0,
        /// Phase at time zero, rad.
        #[serde(default)]
        phase_rad: f64 in -1e3 ..= 1e3,
    } |effect, to| match effect.place {
        TonePlace::Bridge => to.bridge_tones.push(effect.clone()),
        TonePlace::Drive => to.drive_tones.push(effect.clone()),
    };

    /// Weight at the tip: adds `mass g` to the force at the tip (and gives the tip way, where it is
    /// compliant).
    Payload() {
        /// Mass, kg, 0 to 5.
        mass_kg: f64 in 0.0 ..= 5.0,
    } |_effect, _to| {}; // acts at the tip: see `payload_kg`
}

/// Weight carried at the tip, kg.
pub(crate) fn payload_kg(effects: &[Effect]) -> f64 {
    effects
        .iter()
        .map(|e| match e {
            Effect::Payload(p) => p.mass_kg,
            _ => 0.0,
        })
        .sum()
}

impl Effect {
    fn concerns(&self, unit: usize) -> bool {
        let listed = self.listed();
        let own_source = matches!(self, Self::Crosstalk(c) if c.from_unit == unit);
        !own_source && (listed.is_empty() || listed.contains(&unit))
    }

    /// Checks the parameters; `key` is where the effect stands in the configuration.
    pub(crate) fn validate(&self, key: &str, units: usize) -> Result<(), ConfigError> {
        for (name, value, low, high) in self.ranges() {
            value.within(&format!("{key}.{name}"), low, high)?;
        }
        let source = match self {
            Self::Crosstalk(c) => Some(("from_unit", c.from_unit)),
            _ => None,
        };
        for (name, unit) in self.listed().iter().map(|&u| ("units", u)).chain(source) {
            if unit >= units {
                return Err(ConfigError::new(
                    format!("{key}.{name}"),
                    format!("unit {unit} found, 0 to {} expected", units - 1),
                ));
            }
        }
        Ok(())
    }
}
