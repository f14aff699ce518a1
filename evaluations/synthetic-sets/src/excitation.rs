//! What drives a set: the reel's motion, the commanded force, temperature and a neighbour's force.

use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Seconds between steps of the generator's own clock; logs are taken from every n-th step.
pub const STEP_S: f64 = 0.002;

/// Shaft angle per metre of cable, in radians per metre: the reel's 10 mm and the gear's 26:7.
pub const SHAFT_RAD_PER_M: f64 = 26.0 / 7.0 / 0.010;

/// The signals of one log on the generator's clock.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    /// Cable wound in, in metres.
    pub travel_m: Vec<f64>,
    /// Its first derivative, in m/s; exactly zero while the robot stands.
    pub speed_m_s: Vec<f64>,
    /// Its second derivative, in m/s².
    pub accel_m_s2: Vec<f64>,
    /// Setpoint of the force, in newtons.
    pub setpoint_n: Vec<f64>,
    /// Ambient temperature, in degrees Celsius.
    pub temperature_c: Vec<f64>,
    /// Force of the neighbouring unit, in newtons.
    pub neighbour_n: Vec<f64>,
}

/// A sum of sines with random amplitudes, periods and phases.
struct Waves(Vec<(f64, f64, f64)>);

impl Waves {
    /// `count` sines with angular frequencies in `range_hz`, together of standard deviation `sd`.
    fn random(rng: &mut impl Rng, count: usize, range_hz: (f64, f64), sd: f64) -> Self {
        let raw: Vec<_> = (0..count)
            .map(|_| {
                let hz = range_hz.0 * (range_hz.1 / range_hz.0).powf(rng.random::<f64>());
                (
                    rng.random_range(0.5..1.0),
                    TAU * hz,
                    rng.random_range(0.0..TAU),
                )
            })
            .collect();
        let power: f64 = raw.iter().map(|(a, _, _)| a * a / 2.0).sum();
        let scale = sd / power.sqrt();
        Self(raw.into_iter().map(|(a, w, p)| (a * scale, w, p)).collect())
    }

    fn at(&self, t: f64) -> f64 {
        self.0.iter().map(|(a, w, p)| a * (w * t + p).sin()).sum()
    }
}

/// Draws the signals of one log of `seconds`. The reel runs in both directions at many speeds and
/// stops now and then, as in the gauge records of the thesis; forces stay between 1 and 10 N. The
/// lines of its path lie in `path_hz`.
pub fn draw(rng: &mut impl Rng, seconds: f64, path_hz: (f64, f64)) -> Drive {
    let n = (seconds / STEP_S) as usize;
    let path_sd = 0.02 * rng.random_range(0.7..1.4);
    let path = Waves::random(rng, 4, path_hz, path_sd);
    let force_sd = rng.random_range(0.8..1.6);
    let force = Waves::random(rng, 3, (0.03, 0.8), force_sd);
    let mean_n = rng.random_range(3.0..6.5);
    let neighbour = Waves::random(rng, 3, (0.05, 0.7), 1.2);
    let neighbour_mean_n = rng.random_range(2.5..5.0);
    let warm = Waves::random(rng, 2, (0.3 / seconds, 2.5 / seconds), 1.5);
    let ambient_c = rng.random_range(19.0..25.0);
    // Path time runs on except in stops, which it enters and leaves within 0.15 s.
    let mut stops: Vec<(f64, f64)> = Vec::new();
    let mut t = rng.random_range(2.0..6.0);
    while t < seconds {
        let rest = rng.random_range(0.6..2.5);
        stops.push((t, t + rest));
        t += rest + rng.random_range(5.0..12.0);
    }
    let rate = |t: f64| -> f64 {
        stops.iter().fold(1.0f64, |rate, (from, to)| {
            let edge = |x: f64| (x / 0.15).clamp(0.0, 1.0);
            let smooth = |x: f64| x * x * (3.0 - 2.0 * x);
            rate.min(1.0 - smooth(edge(t - from)) * smooth(edge(to - t)))
        })
    };
    let mut drive = Drive::default();
    let mut path_time = rng.random_range(0.0..100.0);
    for k in 0..n {
        let t = k as f64 * STEP_S;
        drive.travel_m.push(path.at(path_time));
        path_time += STEP_S * rate(t);
        drive
            .setpoint_n
            .push((mean_n + force.at(t)).clamp(1.0, 10.0));
        drive.temperature_c.push(ambient_c + warm.at(t));
        drive
            .neighbour_n
            .push((neighbour_mean_n + neighbour.at(t)).max(0.5));
    }
    let derivative = |x: &[f64]| -> Vec<f64> {
        (0..n)
            .map(|k| {
                let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
                (x[b] - x[a]) / ((b - a).max(1) as f64 * STEP_S)
            })
            .collect()
    };
    drive.speed_m_s = derivative(&drive.travel_m);
    drive.accel_m_s2 = derivative(&drive.speed_m_s);
    drive
}
