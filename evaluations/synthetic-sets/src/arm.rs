//! Logs of a joint of an arm with two joints: dry friction, weights, inertia, and motions in which
//! other forms take their shape.
//!
//! Textbook rigid-body terms: the outer joint carries a weight over the sum of both angles, the
//! inner one also a weight over its own.

use crate::set::normal;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use std::f64::consts::TAU;

/// Seconds between rows.
const ROW_S: f64 = 0.02;

/// Step of the differences that give speed and acceleration, in seconds.
const STEP_S: f64 = 1e-4;

/// How the joints move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Both swing together, each log at a frequency of its own.
    Together,
    /// Back and forth at nearly constant speed, both together, each log at a speed of its own.
    BackAndForth,
    /// Three sines for each joint.
    Free,
}

impl Motion {
    /// All.
    pub const ALL: [Self; 3] = [Self::Together, Self::BackAndForth, Self::Free];

    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Together => "both swing together",
            Self::BackAndForth => "back and forth together",
            Self::Free => "each by itself",
        }
    }
}

/// What to generate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    /// How the joints move.
    pub motion: Motion,
    /// Whether the torque is that of the outer joint; else of the inner one.
    pub outer: bool,
    /// Size of the torques, in N·m.
    pub scale_nm: f64,
    /// RMS of the noise as a share of `scale_nm`.
    pub noise: f64,
    /// Share of the widest arc that is used.
    pub arc: f64,
    /// Seed of everything.
    pub seed: u64,
}

/// One log: columns of equal length, in s, rad, rad/s and N·m.
#[derive(Debug, Clone, Default)]
pub struct Log {
    /// Time.
    pub time_s: Vec<f64>,
    /// Torque of the joint: the target.
    pub torque_nm: Vec<f64>,
    /// Its angle.
    pub angle_rad: Vec<f64>,
    /// Its speed.
    pub speed_rad_s: Vec<f64>,
    /// Angle of the other joint.
    pub other_rad: Vec<f64>,
}

/// Logs of one joint.
#[derive(Debug, Clone)]
pub struct Set {
    /// One log for each group.
    pub logs: Vec<Log>,
    /// RMS of the noise, in N·m.
    pub noise_rms_nm: f64,
}

/// Amplitude, angular frequency and phase of sines.
type Sines = Vec<(f64, f64, f64)>;

/// Where both joints are.
enum Path {
    Sines(Sines, Sines),
    /// Amplitudes, turns of the cycle in a second, phase, and how much earlier the second joint is.
    Ramps([f64; 2], f64, f64, f64),
}

impl Path {
    fn draw(recipe: &Recipe, log: usize, rng: &mut impl Rng) -> Self {
        let arc = recipe.arc;
        let phase = rng.random_range(0.0..TAU);
        let wide = rng.random_range(1.0..1.6) * arc;
        let ratio = rng.random_range(0.9..1.1);
        let n = log as f64;
        match recipe.motion {
            Motion::Together => {
                let w = 0.4 * (1.0 + n);
                let first = vec![(wide, w, phase), (0.1 * arc, 2.3 * w, 0.0)];
                Self::Sines(first, vec![(ratio * wide, w, phase + 0.05)])
            }
            Motion::BackAndForth => {
                let rate = (1.0 + 0.7 * n) / 8.0;
                Self::Ramps([1.4 * wide, 1.4 * ratio * wide], rate, phase / TAU, 0.02)
            }
            Motion::Free => {
                let mut three = || -> Sines {
                    (0..3)
                        .map(|_| {
                            (
                                arc * rng.random_range(0.2..0.7),
                                rng.random_range(0.3..2.2),
                                rng.random_range(0.0..TAU),
                            )
                        })
                        .collect()
                };
                Self::Sines(three(), three())
            }
        }
    }

    /// Angles of both joints.
    fn at(&self, t: f64) -> [f64; 2] {
        let sines = |s: &Sines| s.iter().map(|(a, w, p)| a * (w * t + p).sin()).sum();
        // A triangle with rounded corners.
        let ramp = |x: f64| {
            let wave = (TAU * x).sin() * 0.97;
            wave.asin() / 0.97f64.asin()
        };
        match self {
            Self::Sines(first, second) => [sines(first), sines(second)],
            Self::Ramps([a, b], rate, phase, earlier) => [
                a * ramp(rate * t + phase),
                b * ramp(rate * t + phase + earlier),
            ],
        }
    }
}

/// Generates a set.
#[must_use]
pub fn generate(recipe: &Recipe) -> Set {
    let mut rng = ChaCha12Rng::seed_from_u64(recipe.seed);
    let mut size = || recipe.scale_nm * rng.random_range(0.5..1.5);
    let (friction, sum, inner) = (size(), size(), size());
    let inertia = 0.15 * size();
    let groups = rng.random_range(4..=6);
    let noise_nm = recipe.noise * recipe.scale_nm;
    let (mut squares, mut rows) = (0.0, 0.0);
    let logs = (0..groups)
        .map(|k| {
            let path = Path::draw(recipe, k, &mut rng);
            let mut slow = normal(&mut rng);
            let mut log = Log::default();
            for i in 0..900 {
                let t = f64::from(i) * ROW_S;
                let [before, here, after] = [t - STEP_S, t, t + STEP_S].map(|t| path.at(t));
                let own = usize::from(recipe.outer);
                let speed = (after[own] - before[own]) / (2.0 * STEP_S);
                let turn = (after[own] - 2.0 * here[own] + before[own]) / (STEP_S * STEP_S);
                let mut torque =
                    friction * speed.signum() + sum * (here[0] + here[1]).sin() + inertia * turn;
                if !recipe.outer {
                    torque += inner * here[0].sin();
                }
                // A half of the noise's power is slow, with a time constant of 0.3 s.
                let keep = (-ROW_S / 0.3f64).exp();
                slow = keep * slow + (1.0 - keep * keep).sqrt() * normal(&mut rng);
                let noise = noise_nm * 0.5f64.sqrt() * (normal(&mut rng) + slow);
                squares += noise * noise;
                rows += 1.0;
                log.time_s.push(t);
                log.torque_nm.push(torque + noise);
                log.angle_rad.push(here[own]);
                log.speed_rad_s.push(speed);
                log.other_rad.push(here[1 - own]);
            }
            log
        })
        .collect();
    Set {
        logs,
        noise_rms_nm: (squares / rows).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_torque_is_that_of_a_link_in_motion() {
        for motion in Motion::ALL {
            let set = generate(&Recipe {
                motion,
                outer: true,
                scale_nm: 2.0,
                noise: 0.0,
                arc: 1.0,
                seed: 3,
            });
            assert!(set.logs.len() >= 4 && set.noise_rms_nm == 0.0);
            for log in &set.logs {
                let largest = log.torque_nm.iter().fold(0.0f64, |a, b| a.max(b.abs()));
                assert!((1.0..40.0).contains(&largest), "{motion:?}: {largest}");
                // The speed is the slope of the angle.
                for i in 1..log.time_s.len() - 1 {
                    let slope = (log.angle_rad[i + 1] - log.angle_rad[i - 1]) / (2.0 * ROW_S);
                    assert!(
                        (slope - log.speed_rad_s[i]).abs() < 0.6,
                        "{motion:?} row {i}"
                    );
                }
            }
        }
    }
}
