//! Noise of the load cell and its amplifier: white, AR(1), 1/f and a mains tone, in random shares.

use crate::fit::rms;
use crate::random::Random;
use serde_json::{json, Value};
use std::f64::consts::TAU;

/// Colour of the noise of a set. The shares are parts of the variance and sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Share of white noise.
    pub white: f64,
    /// Share of first-order autoregressive noise.
    pub autoregressive: f64,
    /// Coefficient of the autoregressive noise from row to row, 0 to below 1.
    pub coefficient: f64,
    /// Share of 1/f noise.
    pub flicker: f64,
    /// Share of a tone.
    pub tone: f64,
    /// Frequency of the tone in Hz, before it is sampled by the rows.
    pub tone_hz: f64,
}

impl Colour {
    /// Only white noise.
    pub const WHITE: Self = Self {
        white: 1.0,
        autoregressive: 0.0,
        coefficient: 0.0,
        flicker: 0.0,
        tone: 0.0,
        tone_hz: 50.0,
    };

    /// A random colour: always white noise, each other component with a probability of one half
    /// (tone: one fifth).
    pub fn draw(random: &mut Random) -> Self {
        let white = random.uniform(0.3, 1.0);
        let autoregressive = if random.chance(0.5) {
            random.uniform(0.1, 1.0)
        } else {
            0.0
        };
        let flicker = if random.chance(0.5) {
            random.uniform(0.1, 0.6)
        } else {
            0.0
        };
        let tone = if random.chance(0.2) {
            random.uniform(0.05, 0.3)
        } else {
            0.0
        };
        let sum = white + autoregressive + flicker + tone;
        Self {
            white: white / sum,
            autoregressive: autoregressive / sum,
            coefficient: random.uniform(0.4, 0.95),
            flicker: flicker / sum,
            tone: tone / sum,
            tone_hz: if random.chance(0.5) { 50.0 } else { 60.0 } * (1.0 + 5e-4 * random.normal()),
        }
    }

    /// For `truth.json`.
    pub fn to_json(self, rate_hz: f64) -> Value {
        json!({
            "white": self.white,
            "autoregressive": self.autoregressive,
            "autoregressive_coefficient_per_row": self.coefficient,
            "flicker": self.flicker,
            "tone": self.tone,
            "tone_hz": self.tone_hz,
            "tone_alias_hz": alias_hz(self.tone_hz, rate_hz),
        })
    }

    /// Noise with the variance 1 in expectation, one value for each row.
    ///
    /// The autoregressive part is stationary from its first value. The 1/f part is the sum of
    /// first-order processes of equal variance whose time constants are octaves apart, a classical
    /// approximation (van der Ziel 1950; Barnes and Jarvis 1971); its spectrum falls as 1/f from
    /// the inverse of the run's length to a quarter of the row rate.
    pub fn generate(&self, rows: usize, rate_hz: f64, random: &mut Random) -> Vec<f64> {
        let mut noise = vec![0.0; rows];
        for x in &mut noise {
            *x += self.white.sqrt() * random.normal();
        }
        add_autoregressive(&mut noise, self.autoregressive, self.coefficient, random);
        let octaves = (rows.max(2) as f64).log2().ceil() as i32;
        for octave in 0..octaves {
            let coefficient = (-(2f64.powi(-octave))).exp();
            add_autoregressive(
                &mut noise,
                self.flicker / f64::from(octaves),
                coefficient,
                random,
            );
        }
        let phase = random.uniform(0.0, TAU);
        for (i, x) in noise.iter_mut().enumerate() {
            *x +=
                (2.0 * self.tone).sqrt() * (TAU * self.tone_hz * i as f64 / rate_hz + phase).sin();
        }
        noise
    }
}

fn add_autoregressive(noise: &mut [f64], variance: f64, coefficient: f64, random: &mut Random) {
    if variance == 0.0 {
        return;
    }
    let mut state = variance.sqrt() * random.normal();
    let step = (variance * (1.0 - coefficient * coefficient)).sqrt();
    for x in noise {
        *x += state;
        state = coefficient * state + step * random.normal();
    }
}

/// Frequency in Hz at which a tone appears after sampling at a rate in Hz.
pub fn alias_hz(frequency_hz: f64, rate_hz: f64) -> f64 {
    (frequency_hz - (frequency_hz / rate_hz).round() * rate_hz).abs()
}

/// Scales the noise of all runs by one factor, so that its RMS over all rows is exactly `rms_n`.
pub fn scale_to_rms(runs: &mut [Vec<f64>], rms_n: f64) {
    let all = runs.concat();
    let now = rms(&all);
    if now > 0.0 {
        runs.iter_mut().flatten().for_each(|x| *x *= rms_n / now);
    }
}
