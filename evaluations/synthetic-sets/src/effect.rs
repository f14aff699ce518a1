//! The undeclared effects: each adds a force to what the command alone would give.
//!
//! `size` is the one number that is scaled until the effect has the given RMS; the other parameters
//! (a time constant, an order, a frequency) are drawn. Signs follow the rig: friction opposes
//! winding in, so it lowers the force while the reel winds in.

use crate::excitation::{Drive, SHAFT_RAD_PER_M, STEP_S};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// What kind of effect is hidden in a set. The first block has names that a catalogue of physical
/// effects would know; the next four are in no catalogue. The last four are a part of one that is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs)] // the table in `physics` says what each one does
pub enum Kind {
    Coulomb,
    LoadDependentCoulomb,
    Viscous,
    Stribeck,
    Presliding,
    Hysteresis,
    PeriodicAngle,
    Inertia,
    Delay,
    ClockSkew,
    Gain,
    Offset,
    Quadratic,
    Saturation,
    DriftTime,
    DriftTemperature,
    Creep,
    Crosstalk,
    Tone,
    TravelLoad,
    SpeedWindow,
    NeighbourThreshold,
    Telegraph,
    PartialDelay,
    SoftKink,
    KinkByLog,
    ReversedStribeck,
}

impl Kind {
    /// Effects that a catalogue would know.
    pub const KNOWN: [Self; 19] = [
        Self::Coulomb,
        Self::LoadDependentCoulomb,
        Self::Viscous,
        Self::Stribeck,
        Self::Presliding,
        Self::Hysteresis,
        Self::PeriodicAngle,
        Self::Inertia,
        Self::Delay,
        Self::ClockSkew,
        Self::Gain,
        Self::Offset,
        Self::Quadratic,
        Self::Saturation,
        Self::DriftTime,
        Self::DriftTemperature,
        Self::Creep,
        Self::Crosstalk,
        Self::Tone,
    ];

    /// Effects that are in no catalogue.
    pub const UNCATALOGUED: [Self; 4] = [
        Self::TravelLoad,
        Self::SpeedWindow,
        Self::NeighbourThreshold,
        Self::Telegraph,
    ];

    /// Effects as real drives have them, of which a catalogue has the pure form: a delay that a
    /// part of the load has, a change of slope that is no corner, one with a corner of its own in
    /// each log, and a friction that is smaller at low speed instead of larger.
    pub const IMPURE: [Self; 4] = [
        Self::PartialDelay,
        Self::SoftKink,
        Self::KinkByLog,
        Self::ReversedStribeck,
    ];

    /// Name in snake case, as a catalogue would spell it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Coulomb => "coulomb",
            Self::LoadDependentCoulomb => "load_dependent_coulomb",
            Self::Viscous => "viscous",
            Self::Stribeck => "stribeck",
            Self::Presliding => "presliding",
            Self::Hysteresis => "hysteresis",
            Self::PeriodicAngle => "periodic_angle",
            Self::Inertia => "inertia",
            Self::Delay => "delay",
            Self::ClockSkew => "clock_skew",
            Self::Gain => "gain",
            Self::Offset => "offset",
            Self::Quadratic => "quadratic",
            Self::Saturation => "saturation",
            Self::DriftTime => "drift_time",
            Self::DriftTemperature => "drift_temperature",
            Self::Creep => "creep",
            Self::Crosstalk => "crosstalk",
            Self::Tone => "tone",
            Self::TravelLoad => "travel_load",
            Self::SpeedWindow => "speed_window",
            Self::NeighbourThreshold => "neighbour_threshold",
            Self::Telegraph => "telegraph",
            Self::PartialDelay => "partial_delay",
            Self::SoftKink => "soft_kink",
            Self::KinkByLog => "kink_by_log",
            Self::ReversedStribeck => "reversed_stribeck",
        }
    }

    /// Whether the force is proportional to `size`.
    const fn linear(self) -> bool {
        !matches!(
            self,
            Self::Delay | Self::ClockSkew | Self::Saturation | Self::PartialDelay
        )
    }

    /// Smallest and largest `size` that the search may try, for the others.
    const fn bounds(self) -> (f64, f64) {
        match self {
            Self::Delay | Self::PartialDelay => (0.0, 0.8),
            Self::ClockSkew => (0.0, 0.05),
            _ => (0.0, 8.0),
        }
    }
}

/// An effect with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// What it is.
    pub kind: Kind,
    /// The number that was scaled, in the unit that [`Effect::parameters`] names.
    pub size: f64,
    shape: [f64; 2],
    seed: u64,
}

/// Memory of an effect while a log is made.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    direction: f64,
    z: f64,
    slow: Option<f64>,
    level: f64,
    next_flip: f64,
    noise: u64,
}

impl Effect {
    /// Draws the shape of an effect; its size is 1 until it is scaled.
    pub fn draw(kind: Kind, rng: &mut impl Rng) -> Self {
        let shape = match kind {
            Kind::Stribeck => [rng.random_range(0.004..0.010), 0.0],
            Kind::Hysteresis => [rng.random_range(0.003..0.008), 0.0],
            // Shaft orders: the reel (7/26 of the shaft), the shaft, its winding.
            Kind::PeriodicAngle => [
                [7.0 / 26.0, 1.0, 2.0, 7.0][rng.random_range(0..4)],
                rng.random_range(0.0..TAU),
            ],
            Kind::Creep => [rng.random_range(4.0..12.0), 0.0],
            Kind::Tone => [rng.random_range(0.9..4.5), rng.random_range(0.0..TAU)],
            Kind::SpeedWindow => [
                rng.random_range(0.010..0.016),
                rng.random_range(0.003..0.005),
            ],
            Kind::NeighbourThreshold => [rng.random_range(3.0..4.5), 0.0],
            // The share of the load that is late.
            Kind::PartialDelay => [rng.random_range(0.13..0.22), 0.0],
            // Where the slope changes, and over which range of the load.
            Kind::SoftKink => [rng.random_range(4.0..5.5), rng.random_range(0.3..1.0)],
            // The middle of the loads where the slope changes, and how far off it a log's may be.
            Kind::KinkByLog => [rng.random_range(4.0..5.0), rng.random_range(0.7..1.3)],
            Kind::ReversedStribeck => [rng.random_range(0.004..0.010), 0.0],
            _ => [0.0, 0.0],
        };
        Self {
            kind,
            size: 1.0,
            shape,
            seed: rng.random(),
        }
    }

    /// Physical parameters: name with unit, value.
    #[must_use]
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        let [a, b] = self.shape;
        match self.kind {
            Kind::Coulomb | Kind::Presliding => vec![("friction_n", self.size)],
            Kind::LoadDependentCoulomb => vec![("friction_per_load", self.size)],
            Kind::Viscous => vec![("friction_n_per_rad_s", self.size / SHAFT_RAD_PER_M)],
            Kind::Stribeck => vec![
                ("friction_n", self.size),
                ("speed_rad_s", a * SHAFT_RAD_PER_M),
            ],
            Kind::Hysteresis => vec![("force_n", self.size), ("travel_rad", a * SHAFT_RAD_PER_M)],
            Kind::PeriodicAngle => vec![("amplitude_n", self.size), ("order", a), ("phase_rad", b)],
            Kind::Inertia => vec![("inertia_n_per_rad_s2", self.size / SHAFT_RAD_PER_M)],
            Kind::Delay => vec![("delay_s", self.size)],
            Kind::ClockSkew => vec![("skew", self.size)],
            Kind::Gain => vec![("gain", self.size)],
            Kind::Offset => vec![("offset_n", self.size)],
            Kind::Quadratic => vec![("per_n", self.size)],
            Kind::Saturation => vec![("limit_n", 10.0 - self.size)],
            Kind::DriftTime => vec![("rate_n_per_s", self.size)],
            Kind::DriftTemperature => vec![("rate_n_per_k", self.size)],
            Kind::Creep => vec![("fraction", self.size), ("time_constant_s", a)],
            Kind::Crosstalk => vec![("fraction", self.size)],
            Kind::Tone => vec![("amplitude_n", self.size), ("frequency_hz", a)],
            Kind::TravelLoad
            | Kind::SpeedWindow
            | Kind::NeighbourThreshold
            | Kind::Telegraph
            | Kind::PartialDelay
            | Kind::SoftKink
            | Kind::KinkByLog
            | Kind::ReversedStribeck => vec![("size", self.size)],
        }
    }

    /// A number from 0 to 1 that each log has for itself, chosen by its setpoint at the start.
    fn number_of_log(&self, drive: &Drive) -> f64 {
        let mixed = (self.seed ^ drive.setpoint_n[0].to_bits())
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (mixed >> 40) as f64 / (1u64 << 24) as f64
    }

    /// Force that the effect adds at step `k`, given the commands so far (`commands[k]` the
    /// newest).
    fn force(&self, memory: &mut Memory, k: usize, drive: &Drive, commands: &[f64]) -> f64 {
        let (t, speed, load) = (k as f64 * STEP_S, drive.speed_m_s[k], commands[k]);
        let sign = if speed == 0.0 { 0.0 } else { speed.signum() };
        if sign != 0.0 {
            memory.direction = sign;
        }
        let [a, b] = self.shape;
        match self.kind {
            Kind::Coulomb => -self.size * sign,
            Kind::LoadDependentCoulomb => -self.size * load * sign,
            Kind::Viscous => -self.size * speed,
            Kind::Stribeck => -self.size * sign * (-(speed / a).powi(2)).exp(),
            Kind::Presliding => -self.size * memory.direction,
            Kind::Hysteresis => {
                // Dahl: the force builds up over a travel of `a` after each reversal.
                let step = speed * STEP_S / a;
                memory.z = (memory.z + step * (1.0 - memory.z * step.signum())).clamp(-1.0, 1.0);
                -self.size * memory.z
            }
            Kind::PeriodicAngle => self.size * (a * drive.travel_m[k] * SHAFT_RAD_PER_M + b).sin(),
            Kind::Inertia => -self.size * drive.accel_m_s2[k],
            Kind::Delay => earlier(commands, k as f64 - self.size / STEP_S) - load,
            Kind::PartialDelay => a * (earlier(commands, k as f64 - self.size / STEP_S) - load),
            Kind::SoftKink => self.size * b * ((load - a) / b).exp().ln_1p(),
            Kind::KinkByLog => {
                self.size * (load - a - b * (2.0 * self.number_of_log(drive) - 1.0)).max(0.0)
            }
            Kind::ReversedStribeck => self.size * sign * (-(speed / a).powi(2)).exp(),
            Kind::ClockSkew => earlier(commands, k as f64 * (1.0 - self.size)) - load,
            Kind::Gain => self.size * load,
            Kind::Offset => self.size,
            Kind::Quadratic => self.size * load * load,
            Kind::Saturation => load.min(10.0 - self.size) - load,
            Kind::DriftTime => self.size * t,
            Kind::DriftTemperature => self.size * (drive.temperature_c[k] - 22.0),
            Kind::Creep => {
                let slow = memory.slow.get_or_insert(0.0);
                *slow += (load - *slow) * STEP_S / a;
                self.size * *slow
            }
            Kind::Crosstalk => self.size * drive.neighbour_n[k],
            Kind::Tone => self.size * (TAU * a * t + b).sin(),
            Kind::TravelLoad => self.size * (drive.travel_m[k] / 0.02) * (load - 4.5),
            Kind::SpeedWindow => self.size * (-((speed.abs() - a) / b).powi(2)).exp(),
            Kind::NeighbourThreshold => {
                self.size * f64::from(u8::from(drive.neighbour_n[k] > a)) * (load - 4.0).signum()
            }
            Kind::Telegraph => {
                if t >= memory.next_flip {
                    // A multiplicative congruential step: the log's generator stays untouched. Each
                    // log has its own sequence, chosen by the setpoint at the start.
                    memory.noise = (memory.noise ^ self.seed ^ drive.setpoint_n[0].to_bits())
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1);
                    memory.next_flip =
                        t + 0.8 + 3.0 * ((memory.noise >> 40) as f64 / (1u64 << 24) as f64);
                    memory.level = if memory.level > 0.0 { -1.0 } else { 1.0 };
                }
                self.size * memory.level
            }
        }
    }
}

/// The command at a fractional step, the first one before the log begins.
fn earlier(commands: &[f64], at: f64) -> f64 {
    let at = at.max(0.0);
    let (k, part) = (at as usize, at.fract());
    let first = commands[k.min(commands.len() - 1)];
    let second = commands[(k + 1).min(commands.len() - 1)];
    first + (second - first) * part
}

/// Effects at work during one log.
#[derive(Debug, Clone)]
pub struct AtWork<'a>(Vec<(&'a Effect, Memory)>);

impl<'a> AtWork<'a> {
    /// All of `effects`, each without a past.
    #[must_use]
    pub fn new(effects: &'a [Effect]) -> Self {
        Self(
            effects
                .iter()
                .map(|effect| (effect, Memory::default()))
                .collect(),
        )
    }

    /// Sum of their forces at step `k`.
    pub fn force(&mut self, k: usize, drive: &Drive, commands: &[f64]) -> f64 {
        self.0
            .iter_mut()
            .map(|(effect, memory)| effect.force(memory, k, drive, commands))
            .sum()
    }
}

/// Sets `size` so that the effect's RMS over these drives, with the setpoint as command, is
/// `rms_n`.
pub fn scale(effect: &mut Effect, drives: &[Drive], rms_n: f64) {
    let rms = |size: f64| {
        let sized = [Effect {
            size,
            ..effect.clone()
        }];
        let (mut sum, mut n) = (0.0, 0);
        for drive in drives {
            let mut work = AtWork::new(&sized);
            for k in 0..drive.setpoint_n.len() {
                sum += work.force(k, drive, &drive.setpoint_n[..=k]).powi(2);
                n += 1;
            }
        }
        (sum / f64::from(n.max(1))).sqrt()
    };
    effect.size = if effect.kind.linear() {
        rms_n / rms(1.0)
    } else {
        let (mut low, mut high) = effect.kind.bounds();
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if rms(middle) < rms_n {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    };
}
