//! What a set is to contain.

use crate::effects::Effect;
use crate::excitation::Measured;

/// Slowest and fastest row rate in Hz.
pub const RATES_HZ: [f64; 2] = [20.0, 320.0];

/// Smallest and largest RMS of the noise in N.
pub const NOISES_N: [f64; 2] = [0.001, 0.060];

/// What a set is to contain.
#[derive(Clone, Debug)]
pub struct Request {
    /// Seed of everything.
    pub seed: u64,
    /// Effects that the declared model lacks; empty for an empty set.
    pub effects: Vec<&'static Effect>,
    /// RMS of each effect after the best fit of the declared model, over the RMS of the noise. 0:
    /// nothing is missing.
    pub size: f64,
    /// Rows per second.
    pub rate_hz: f64,
    /// RMS of the noise in N; drawn log-uniform from [`NOISES_N`] if `None`.
    pub noise_n: Option<f64>,
    /// Runs; drawn from 4 to 8 if `None`.
    pub runs: Option<usize>,
    /// Duration of each run in s; drawn from 40 to 90 for each run if `None`.
    pub duration_s: Option<f64>,
    /// Measured logs to take motion and command from.
    pub excitation: Option<Measured>,
    /// Whether to look for effects that describe the same force.
    pub compare: bool,
}

impl Request {
    /// A request with everything drawn.
    pub fn new(seed: u64, effects: Vec<&'static Effect>, size: f64, rate_hz: f64) -> Self {
        Self {
            seed,
            effects,
            size,
            rate_hz,
            noise_n: None,
            runs: None,
            duration_s: None,
            excitation: None,
            compare: true,
        }
    }

    pub(crate) fn check(&self) -> Result<(), String> {
        let within = |name: &str, value: f64, [low, high]: [f64; 2], unit: &str| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(format!(
                    "{name} is {value} {unit}; give {low} {unit} to {high} {unit}"
                ))
            }
        };
        within("the row rate", self.rate_hz, RATES_HZ, "Hz")?;
        within("the size", self.size, [0.0, 100.0], "times the noise")?;
        if let Some(noise) = self.noise_n {
            within("the noise", noise, NOISES_N, "N RMS")?;
        }
        if let Some(duration) = self.duration_s {
            within("the duration of a run", duration, [5.0, 600.0], "s")?;
        }
        if let Some(runs) = self.runs {
            within("the number of runs", runs as f64, [2.0, 100.0], "runs")?;
        }
        if self.effects.len() > 3 {
            return Err(format!(
                "{} effects in one set; give at most 3",
                self.effects.len()
            ));
        }
        for (i, effect) in self.effects.iter().enumerate() {
            if self.effects[..i].contains(effect) {
                return Err(format!(
                    "effect {} is given twice; give each once",
                    effect.name
                ));
            }
        }
        Ok(())
    }
}
