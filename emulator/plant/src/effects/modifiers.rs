//! The effects of one unit, summed for the physics.

use super::{
    Backlash, ChangingFriction, Creep, Crosstalk, Effect, Periodic, Shaft, Stribeck,
    TemperatureDrift, Tone,
};
use std::f64::consts::TAU;

/// What the physics of one unit asks of the effects; all neutral without any.
#[derive(Clone, Debug, Default)]
pub(crate) struct Modifiers {
    run: u64,
    pub viscous_n_s_per_m: f64,
    pub coulomb_n: f64,
    pub per_load: f64,
    pub changing_friction: Vec<ChangingFriction>,
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
    pub cell_tilt_rad: [f64; 2],
    pub hardening_per_strain: f64,
    pub bridge_tones: Vec<Tone>,
    pub drive_tones: Vec<Tone>,
}

impl Modifiers {
    /// All effects of `effects` that concern `unit`, in a run of the rig (from 0).
    pub fn for_unit(effects: &[Effect], unit: usize, run: u64) -> Self {
        let mut modifiers = Self {
            run,
            ..Self::default()
        };
        for effect in effects {
            if effect.concerns(unit) {
                effect.install(&mut modifiers);
            }
        }
        modifiers
    }

    /// Excess of the friction level at cable speed `v`, N.
    #[inline]
    pub fn friction_excess_n(&self, v_m_per_s: f64) -> f64 {
        self.stribeck
            .iter()
            .map(|s| s.excess_n * libm::exp(-(v_m_per_s / s.velocity_m_per_s).powi(2)))
            .sum()
    }

    /// Addition to the friction level that changes with time, N.
    #[inline]
    pub fn changed_friction_n(&self, time_s: f64) -> f64 {
        self.changing_friction
            .iter()
            .map(|c| {
                let age_s = time_s + self.run as f64 * c.run_s;
                c.end_n + (c.begin_n - c.end_n) * libm::exp(-age_s / c.time_constant_s)
            })
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
                p.amplitude_n * libm::sin(p.order * angle + p.phase_rad)
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
        self.rise_k * (1.0 - libm::exp(-time_s / self.time_constant_s))
    }
}

fn tones_n(tones: &[Tone], time_s: f64) -> f64 {
    tones
        .iter()
        .map(|t| t.amplitude_n * libm::sin(TAU * t.frequency_hz * time_s + t.phase_rad))
        .sum()
}
