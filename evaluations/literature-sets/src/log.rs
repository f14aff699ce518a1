//! From a run without noise to the rows of its log.

use crate::random::Random;
use crate::rig::Sampling;
use crate::FULL_SCALE_N;

/// Time in s that the logger's clock shows at the first row.
const CLOCK_START_S: f64 = 1.0;

/// One log.
#[derive(Clone, Debug)]
pub struct Run {
    /// Name of the measured log that gave motion and command.
    pub excitation: Option<String>,
    /// Names of the columns, the time first.
    pub columns: Vec<&'static str>,
    /// Rows, with a value for each column; SI units as the names say.
    pub rows: Vec<Vec<f64>>,
    /// Noise in each row of the log in N, before quantisation and clipping.
    pub noise: Vec<f64>,
    /// Reading in each row without noise and quantisation, in N.
    pub clean: Vec<f64>,
    /// Rows that were lost.
    pub rows_lost: usize,
    /// Rows whose reading without noise lies outside 0 N to 15 N, where a real cable or cell would
    /// do something else.
    pub rows_out_of_range: usize,
}

/// Name of the file of run `i`, counted from 0.
pub fn file_name(i: usize) -> String {
    format!("run{:02}.csv", i + 1)
}

/// How a run becomes a log.
pub(crate) struct Log {
    /// Step of the reading, N.
    pub quantum_n: f64,
    /// RMS of the jitter of the row times, s.
    pub jitter_s: f64,
    /// RMS of the noise of the velocity while the reel turns, rad/s.
    pub speed_noise_rad_s: f64,
    /// Whether there is a temperature column.
    pub has_temperature: bool,
    /// Largest reading, N.
    pub ceiling: f64,
}

impl Log {
    /// The log of a run; `clean` are its readings without noise, N.
    pub fn write(
        &self,
        sampling: &Sampling,
        clean: Vec<f64>,
        noise: Vec<f64>,
        mut random: Random,
    ) -> Run {
        let world = &sampling.world;
        let mut columns = vec!["time_s", "force_n", "command_n", "speed_rad_s", "angle_rad"];
        if self.has_temperature {
            columns.push("temperature_c");
        }
        columns.extend([
            "neighbour_1_n",
            "neighbour_2_n",
            "shoulder_rad",
            "elbow_rad",
        ]);
        let mut last = f64::NEG_INFINITY;
        let rows = sampling
            .times
            .iter()
            .zip(clean.iter().zip(&noise))
            .map(|(&t, (clean, noise))| {
                let at = |signal: &[f64]| world.sample(signal, t);
                // The time stamp misses the moment of the sample by a little; it still grows.
                let stamp = round(
                    t + CLOCK_START_S + 0.1 * self.jitter_s * random.normal(),
                    1e-6,
                )
                .max(last + 1e-6);
                last = stamp;
                let velocity = at(&world.velocity);
                let speed = if velocity == 0.0 {
                    0.0
                } else {
                    velocity + self.speed_noise_rad_s * random.normal()
                };
                let mut row = vec![
                    stamp,
                    round((clean + noise).min(self.ceiling), self.quantum_n),
                    round(at(&world.command), 1e-4),
                    round(speed, 1e-4),
                    round(at(&world.angle), 1e-4),
                ];
                if self.has_temperature {
                    row.push(round(at(&world.temperature) + 0.02 * random.normal(), 0.01));
                }
                for neighbour in &world.neighbours {
                    row.push(round(at(neighbour) + 0.003 * random.normal(), 1e-3));
                }
                row.extend(world.pose.iter().map(|joint| round(at(joint), 1e-4)));
                row
            })
            .collect();
        let rows_out_of_range = clean
            .iter()
            .filter(|f| !(0.0..=FULL_SCALE_N).contains(*f))
            .count();
        Run {
            columns,
            rows,
            noise,
            clean,
            rows_out_of_range,
            excitation: sampling.excitation.clone(),
            rows_lost: sampling.rows_lost,
        }
    }
}

fn round(value: f64, step: f64) -> f64 {
    // Adding zero turns -0 into 0.
    (value / step).round() * step + 0.0
}
