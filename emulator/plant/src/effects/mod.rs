//! Physical effects beyond the rig of [`crate::config`]: for experiments in which the plant does what a
//! model of it does not say. All are off by default.
//!
//! One small struct each. To add one: a struct with its parameters, a row in [`Effect`] (and in
//! `Effect::parts`), an `install` that adds it to the places where the physics asks
//! (`Modifiers`), a test. Several effects of one kind add up.
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

mod install;
mod modifiers;

pub(crate) use modifiers::Modifiers;

use crate::error::within;
use crate::error::ConfigError;
use install::Install;
use serde::{Deserialize, Serialize};

/// One effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Effect {
    /// Friction that grows with speed.
    Viscous(Viscous),
    /// Friction that falls with speed.
    Stribeck(Stribeck),
    /// More, or more load-dependent, Coulomb friction.
    Coulomb(Coulomb),
    /// A pull that repeats with a shaft's angle.
    Periodic(Periodic),
    /// Play between gear and reel.
    Backlash(Backlash),
    /// More inertia on the reel.
    Inertia(Inertia),
    /// The amplifier's gain differs from its nominal value.
    AmplifierGain(AmplifierGain),
    /// The amplifier answers late.
    CommandDelay(CommandDelay),
    /// The bridge's zero walks with time.
    ZeroDrift(ZeroDrift),
    /// The rig warms up; zero and gain of the cell follow.
    TemperatureDrift(TemperatureDrift),
    /// The cell's reading creeps under load.
    Creep(Creep),
    /// Another unit's load shows in this cell's reading.
    Crosstalk(Crosstalk),
    /// The cell's characteristic is curved.
    CellQuadratic(CellQuadratic),
    /// The cable stiffens with strain.
    CableHardening(CableHardening),
    /// A hum on the bridge or in the drive.
    Tone(Tone),
    /// A weight carried at the tip.
    Payload(Payload),
}

/// `-c v` at the cable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Viscous {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// c, N.s/m, 0 to 200.
    pub coefficient_n_s_per_m: f64,
}

/// An excess of the friction level that fades with speed: `excess exp(-(v/v_s)^2)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stribeck {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Excess at standstill, N, 0 to 10.
    pub excess_n: f64,
    /// v_s at the cable, m/s, above 1e-5.
    pub velocity_m_per_s: f64,
}

/// An addition to the friction level: `constant + per_load |u|`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coulomb {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Constant part, N, -5 to 10; the level never falls below zero.
    pub constant_n: f64,
    /// Part per motor pull, -0.5 to 0.5.
    #[serde(default)]
    pub per_load: f64,
}

/// Which shaft's angle counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shaft {
    /// The reel: eccentric rim, unbalance (order 1), gear output.
    Reel,
    /// The motor: cogging, commutation, gear input.
    Motor,
}

/// A pull of `amplitude sin(order angle + phase)` at the cable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Periodic {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Whose angle.
    pub shaft: Shaft,
    /// Periods per turn, 0.01 to 200.
    pub order: f64,
    /// Amplitude, N, 0 to 10.
    pub amplitude_n: f64,
    /// Phase at the starting angle, rad.
    #[serde(default)]
    pub phase_rad: f64,
}

/// Play between the gear (with the encoder's side of the drive) and the reel. The reel becomes a mass of
/// its own; part of the drive's friction moves to its bearing and holds it inside the gap.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backlash {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Whole play, m of cable, 0 to 0.02.
    pub gap_m: f64,
    /// Friction of the reel's bearing, N, 0.01 to 5; taken off the drive's own.
    pub reel_friction_n: f64,
}

/// More reflected mass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inertia {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Mass at the cable, kg, 0 to 20.
    pub mass_kg: f64,
}

/// Gain error of the amplifier.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AmplifierGain {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Relative error, -0.9 to 1.
    pub relative_error: f64,
}

/// Dead time between amplifier input and current command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandDelay {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Delay, s, 0 to 0.5; rounded to whole grid steps.
    pub delay_s: f64,
}

/// Zero drift of the bridge, as force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZeroDrift {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Rate, N/s, -1 to 1.
    pub rate_n_per_s: f64,
}

/// Warm-up from 25 degrees Celsius: `rise (1 - exp(-t/tau))`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemperatureDrift {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Rise, K, -50 to 50.
    pub rise_k: f64,
    /// tau, s, above 0.01.
    pub time_constant_s: f64,
    /// Zero shift, N/K, -1 to 1. Cheap 3 kg cells: about 0.006 (0.02 % of capacity per K).
    pub zero_n_per_k: f64,
    /// Relative change of the cell's gain, 1/K, -0.01 to 0.01.
    #[serde(default)]
    pub gain_per_k: f64,
}

/// Creep of the cell: the reading settles to `(1 + fraction)` of the load.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Creep {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Fraction, -0.5 to 0.5.
    pub fraction: f64,
    /// Time constant, s, above 0.01.
    pub time_constant_s: f64,
}

/// Part of another cell's load in the reading.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crosstalk {
    /// Units that read it, from 0; empty: all but the source.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Unit that it comes from.
    pub from_unit: usize,
    /// Part of its load, -1 to 1.
    pub fraction: f64,
}

/// Reading `f + k f^2` for a load `f`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellQuadratic {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// k, 1/N, -0.02 to 0.02.
    pub per_n: f64,
}

/// Tension `EA e (1 + k e)` for a strain `e`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CableHardening {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// k, 0 to 5000 (12 N is a strain of about 1.2e-3 for the default cable).
    pub per_strain: f64,
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

/// A sine in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tone {
    /// Units, from 0; empty: all.
    #[serde(default)]
    pub units: Vec<usize>,
    /// Where it enters.
    pub place: TonePlace,
    /// Frequency, Hz, 0.001 to 5000.
    pub frequency_hz: f64,
    /// Amplitude, N, 0 to 10.
    pub amplitude_n: f64,
    /// Phase at time zero, rad.
    #[serde(default)]
    pub phase_rad: f64,
}

/// Weight at the tip: adds `mass g` to the force at the tip (and gives the tip way, where it is compliant).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Mass, kg, 0 to 5.
    pub mass_kg: f64,
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
    /// The effect as what it does, and the units that it lists.
    fn parts(&self) -> (&dyn Install, &[usize]) {
        match self {
            Self::Viscous(e) => (e, &e.units),
            Self::Stribeck(e) => (e, &e.units),
            Self::Coulomb(e) => (e, &e.units),
            Self::Periodic(e) => (e, &e.units),
            Self::Backlash(e) => (e, &e.units),
            Self::Inertia(e) => (e, &e.units),
            Self::AmplifierGain(e) => (e, &e.units),
            Self::CommandDelay(e) => (e, &e.units),
            Self::ZeroDrift(e) => (e, &e.units),
            Self::TemperatureDrift(e) => (e, &e.units),
            Self::Creep(e) => (e, &e.units),
            Self::Crosstalk(e) => (e, &e.units),
            Self::CellQuadratic(e) => (e, &e.units),
            Self::CableHardening(e) => (e, &e.units),
            Self::Tone(e) => (e, &e.units),
            Self::Payload(e) => (e, &[]),
        }
    }

    fn concerns(&self, unit: usize) -> bool {
        let listed = self.parts().1;
        let own_source = matches!(self, Self::Crosstalk(c) if c.from_unit == unit);
        !own_source && (listed.is_empty() || listed.contains(&unit))
    }

    /// Checks the parameters; `key` is where the effect stands in the configuration.
    pub(crate) fn validate(&self, key: &str, units: usize) -> Result<(), ConfigError> {
        let (effect, listed) = self.parts();
        for (name, value, low, high) in effect.ranges() {
            within(&format!("{key}.{name}"), value, low, high)?;
        }
        let source = match self {
            Self::Crosstalk(c) => Some(("from_unit", c.from_unit)),
            _ => None,
        };
        for (name, unit) in listed.iter().map(|&u| ("units", u)).chain(source) {
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
