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

use crate::config::within;
use crate::error::ConfigError;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

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
    /// The amplifier's gain is not what its label says.
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

/// What the physics of one unit asks of the effects; all neutral without any.
#[derive(Clone, Debug, Default)]
pub(crate) struct Modifiers {
    pub viscous_n_s_per_m: f64,
    pub coulomb_n: f64,
    pub per_load: f64,
    pub stribeck: Vec<Stribeck>,
    pub periodic: Vec<Periodic>,
    pub backlash: Option<Backlash>,
    pub mass_kg: f64,
    pub amplifier_gain_error: f64,
    pub delay_s: f64,
    pub drift_n_per_s: f64,
    pub temperature: Vec<TemperatureDrift>,
    pub creep: Vec<Creep>,
    pub crosstalk: Vec<Crosstalk>,
    pub quadratic_per_n: f64,
    pub hardening_per_strain: f64,
    pub bridge_tones: Vec<Tone>,
    pub drive_tones: Vec<Tone>,
}

impl Modifiers {
    /// All effects of `effects` that concern `unit`.
    pub fn for_unit(effects: &[Effect], unit: usize) -> Self {
        let mut modifiers = Self::default();
        for effect in effects {
            if effect.concerns(unit) {
                effect.parts().0.install(&mut modifiers);
            }
        }
        modifiers
    }

    /// Excess of the friction level at cable speed `v`, N.
    #[inline]
    pub fn friction_excess_n(&self, v_m_per_s: f64) -> f64 {
        self.stribeck
            .iter()
            .map(|s| s.excess_n * (-(v_m_per_s / s.velocity_m_per_s).powi(2)).exp())
            .sum()
    }

    /// Pull of the periodic effects and tones, N.
    #[inline]
    pub fn pull_n(&self, time_s: f64, reel_rad: f64, motor_rad: f64) -> f64 {
        let periodic: f64 = self
            .periodic
            .iter()
            .map(|p| {
                let angle = match p.shaft {
                    Shaft::Reel => reel_rad,
                    Shaft::Motor => motor_rad,
                };
                p.amplitude_n * (p.order * angle + p.phase_rad).sin()
            })
            .sum();
        periodic + tones_n(&self.drive_tones, time_s)
    }

    /// Temperature above the start, K.
    pub fn temperature_rise_k(&self, time_s: f64) -> f64 {
        self.temperature.iter().map(|t| t.rise_at(time_s)).sum()
    }

    /// Reading as force for the load `load_n` (with creep) and what other cells add, N.
    pub fn reading_n(&self, time_s: f64, load_n: f64, crosstalk_n: f64) -> f64 {
        let (zero, gain) = self.temperature.iter().fold((0.0, 1.0), |(zero, gain), t| {
            let rise = t.rise_at(time_s);
            (zero + t.zero_n_per_k * rise, gain + t.gain_per_k * rise)
        });
        gain * (load_n + self.quadratic_per_n * load_n * load_n)
            + zero
            + self.drift_n_per_s * time_s
            + crosstalk_n
            + tones_n(&self.bridge_tones, time_s)
    }
}

impl TemperatureDrift {
    fn rise_at(&self, time_s: f64) -> f64 {
        self.rise_k * (1.0 - (-time_s / self.time_constant_s).exp())
    }
}

fn tones_n(tones: &[Tone], time_s: f64) -> f64 {
    tones
        .iter()
        .map(|t| t.amplitude_n * (TAU * t.frequency_hz * time_s + t.phase_rad).sin())
        .sum()
}

/// The seam: how an effect reaches the physics, and what values it can have.
trait Install {
    /// Adds the effect to what the physics of one unit asks.
    fn install(&self, to: &mut Modifiers);
    /// Name, value, lowest and highest of every parameter.
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)>;
}

impl Install for Viscous {
    fn install(&self, to: &mut Modifiers) {
        to.viscous_n_s_per_m += self.coefficient_n_s_per_m;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![(
            "coefficient_n_s_per_m",
            self.coefficient_n_s_per_m,
            0.0,
            200.0,
        )]
    }
}

impl Install for Stribeck {
    fn install(&self, to: &mut Modifiers) {
        to.stribeck.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("excess_n", self.excess_n, 0.0, 10.0),
            ("velocity_m_per_s", self.velocity_m_per_s, 1e-5, 10.0),
        ]
    }
}

impl Install for Coulomb {
    fn install(&self, to: &mut Modifiers) {
        to.coulomb_n += self.constant_n;
        to.per_load += self.per_load;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("constant_n", self.constant_n, -5.0, 10.0),
            ("per_load", self.per_load, -0.5, 0.5),
        ]
    }
}

impl Install for Periodic {
    fn install(&self, to: &mut Modifiers) {
        to.periodic.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("order", self.order, 0.01, 200.0),
            ("amplitude_n", self.amplitude_n, 0.0, 10.0),
            ("phase_rad", self.phase_rad, -1e3, 1e3),
        ]
    }
}

impl Install for Backlash {
    fn install(&self, to: &mut Modifiers) {
        // Plays in series act as one; the bearing's friction is that of the stiffer one.
        let before = to.backlash.take();
        to.backlash = Some(Backlash {
            units: Vec::new(),
            gap_m: self.gap_m + before.as_ref().map_or(0.0, |b| b.gap_m),
            reel_friction_n: self
                .reel_friction_n
                .max(before.map_or(0.0, |b| b.reel_friction_n)),
        });
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("gap_m", self.gap_m, 0.0, 0.02),
            ("reel_friction_n", self.reel_friction_n, 0.01, 5.0),
        ]
    }
}

impl Install for Inertia {
    fn install(&self, to: &mut Modifiers) {
        to.mass_kg += self.mass_kg;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("mass_kg", self.mass_kg, 0.0, 20.0)]
    }
}

impl Install for AmplifierGain {
    fn install(&self, to: &mut Modifiers) {
        to.amplifier_gain_error += self.relative_error;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("relative_error", self.relative_error, -0.9, 1.0)]
    }
}

impl Install for CommandDelay {
    fn install(&self, to: &mut Modifiers) {
        to.delay_s += self.delay_s;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("delay_s", self.delay_s, 0.0, 0.5)]
    }
}

impl Install for ZeroDrift {
    fn install(&self, to: &mut Modifiers) {
        to.drift_n_per_s += self.rate_n_per_s;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("rate_n_per_s", self.rate_n_per_s, -1.0, 1.0)]
    }
}

impl Install for TemperatureDrift {
    fn install(&self, to: &mut Modifiers) {
        to.temperature.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("rise_k", self.rise_k, -50.0, 50.0),
            ("time_constant_s", self.time_constant_s, 0.01, 1e6),
            ("zero_n_per_k", self.zero_n_per_k, -1.0, 1.0),
            ("gain_per_k", self.gain_per_k, -0.01, 0.01),
        ]
    }
}

impl Install for Creep {
    fn install(&self, to: &mut Modifiers) {
        to.creep.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("fraction", self.fraction, -0.5, 0.5),
            ("time_constant_s", self.time_constant_s, 0.01, 1e6),
        ]
    }
}

impl Install for Crosstalk {
    fn install(&self, to: &mut Modifiers) {
        to.crosstalk.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("fraction", self.fraction, -1.0, 1.0)]
    }
}

impl Install for CellQuadratic {
    fn install(&self, to: &mut Modifiers) {
        to.quadratic_per_n += self.per_n;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("per_n", self.per_n, -0.02, 0.02)]
    }
}

impl Install for CableHardening {
    fn install(&self, to: &mut Modifiers) {
        to.hardening_per_strain += self.per_strain;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("per_strain", self.per_strain, 0.0, 5e3)]
    }
}

impl Install for Tone {
    fn install(&self, to: &mut Modifiers) {
        match self.place {
            TonePlace::Bridge => to.bridge_tones.push(self.clone()),
            TonePlace::Drive => to.drive_tones.push(self.clone()),
        }
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("frequency_hz", self.frequency_hz, 1e-3, 5e3),
            ("amplitude_n", self.amplitude_n, 0.0, 10.0),
            ("phase_rad", self.phase_rad, -1e3, 1e3),
        ]
    }
}

impl Install for Payload {
    // Acts at the tip, not in a unit: see `payload_kg`.
    fn install(&self, _to: &mut Modifiers) {}
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("mass_kg", self.mass_kg, 0.0, 5.0)]
    }
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
