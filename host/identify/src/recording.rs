//! A recorded session, and the rows of a unit as they are analysed.

use control::convert::REEL_RADIUS_M;
use serde::Serialize;
use session::TimedSample;
use std::fmt::Write as _;
use wire::message::UnitConfig;
use wire::UNITS;

/// Age of a conversion when it is ready: half of four conversions, in conversions.
const CONVERSION_AGE: f64 = 2.0;
/// Half the span over which speed is taken, s: 25 ms in all, in which one count is 0.17 mm/s.
const HALF_SPEED_SPAN_S: f64 = 0.0125;
/// Nominal time between two conversions, s.
const SAMPLE_S: f64 = 1.0 / control::NOMINAL_SPS as f64;

/// A recorded session.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Samples, in order.
    pub(super) samples: Vec<Sampled>,
    /// The configurations in force, zeros and scales included.
    pub(super) configs: [UnitConfig; UNITS],
    /// Units that took part.
    pub available: [bool; UNITS],
    /// Part of the amplitude that was left at the end; below 1 where the force at the tip came near
    /// the limit.
    pub swing: f64,
}

/// A sample with what is known beside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampled {
    pub timed: TimedSample,
    /// Force along the cell's axis, unfiltered, N.
    pub cell_n: f64,
    /// 1/cos as it was in force.
    pub inv_cos: f64,
}

/// A row of a session as it is analysed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Row {
    /// Time of the conversion's middle, s.
    pub time_s: f64,
    /// Cable tension, unfiltered, N.
    pub tension_n: f64,
    /// Command in force then, N: DAC output by `dac_codes_per_n`.
    pub command_n: f64,
    /// Cable speed then, m/s, positive winding in.
    pub speed_m_s: f64,
    /// Reel angle then, rad, from the board's encoder position by a reel of 10 mm.
    pub angle_rad: f64,
    /// The others' tensions at that time, N.
    pub neighbours_n: [f64; UNITS],
}

/// A quantity of one unit over time, straight between its points.
#[derive(Debug, Clone, Default)]
struct Track {
    at_s: Vec<f64>,
    value: Vec<f64>,
}

impl Track {
    fn push(&mut self, at_s: f64, value: f64) {
        // Times that stand still would divide by zero.
        if self.at_s.last().is_none_or(|last| at_s > *last) {
            self.at_s.push(at_s);
            self.value.push(value);
        }
    }

    /// `None` outside of what was recorded.
    fn at(&self, t_s: f64) -> Option<f64> {
        let after = self.at_s.partition_point(|at| *at <= t_s);
        let before = after.checked_sub(1)?;
        let (t0, t1) = (*self.at_s.get(before)?, *self.at_s.get(after)?);
        let (y0, y1) = (self.value[before], self.value[after]);
        Some(y0 + (y1 - y0) * (t_s - t0) / (t1 - t0))
    }
}

impl Recording {
    /// Time from the first sample to the last, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let ends = self.samples.first().zip(self.samples.last());
        ends.map_or(0.0, |(first, last)| {
            last.timed.t_us.saturating_sub(first.timed.t_us) as f64 * 1e-6
        })
    }

    /// The rows of a unit (from 0); see the module's page, "Times".
    #[must_use]
    pub fn rows(&self, unit: usize) -> Vec<Row> {
        let mut tension: [Track; UNITS] = Default::default();
        let (mut command, mut travel) = (Track::default(), Track::default());
        let age_s = CONVERSION_AGE * SAMPLE_S;
        for sampled in &self.samples {
            let (timed, s) = (&sampled.timed, &sampled.timed.sample);
            let i = usize::from(s.unit);
            let Some(config) = self.configs.get(i) else {
                continue;
            };
            let t_s = timed.t_us as f64 * 1e-6;
            tension[i].push(t_s - age_s, sampled.cell_n * sampled.inv_cos);
            if i == unit {
                let codes_per_n = f64::from(config.dac_counts_per_n_q16) / 65_536.0;
                let latency_s = f64::from(s.latency_us) * 1e-6;
                command.push(
                    t_s + latency_s + 0.5 * SAMPLE_S,
                    (f64::from(s.dac_code) - 32_768.0) / codes_per_n,
                );
                travel.push(
                    t_s,
                    f64::from(s.encoder_counts) * f64::from(config.travel_nm_per_count) * 1e-9,
                );
            }
        }
        let Some(own) = tension.get(unit) else {
            return Vec::new();
        };
        let row = |(t_s, tension_n): (&f64, &f64)| {
            let after = travel.at(t_s + HALF_SPEED_SPAN_S)?;
            let before = travel.at(t_s - HALF_SPEED_SPAN_S)?;
            Some(Row {
                time_s: *t_s,
                tension_n: *tension_n,
                command_n: command.at(*t_s)?,
                speed_m_s: (after - before) / (2.0 * HALF_SPEED_SPAN_S),
                angle_rad: travel.at(*t_s)? / REEL_RADIUS_M,
                neighbours_n: core::array::from_fn(|i| tension[i].at(*t_s).unwrap_or(0.0)),
            })
        };
        own.at_s.iter().zip(&own.value).filter_map(row).collect()
    }
}

/// The rows of a unit as CSV, with a header.
pub(super) fn csv(rows: &[Row]) -> String {
    let mut text = "time_s,tension_n,command_n,speed_m_s,angle_rad".to_owned();
    (1..=UNITS).for_each(|n| {
        let _ = write!(text, ",tension_{n}_n");
    });
    text.push('\n');
    for r in rows {
        let _ = write!(
            text,
            "{:.6},{:.6},{:.6},{:.7},{:.6}",
            r.time_s, r.tension_n, r.command_n, r.speed_m_s, r.angle_rad
        );
        r.neighbours_n.iter().for_each(|n| {
            let _ = write!(text, ",{n:.5}");
        });
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_is_straight_between_its_points_and_ends_with_them() {
        let mut track = Track::default();
        for (at_s, value) in [(1.0, 2.0), (1.0, 9.0), (3.0, 6.0)] {
            track.push(at_s, value);
        }
        // The second point of one time doesn't count.
        assert_eq!(track.at(1.0), Some(2.0));
        assert_eq!(track.at(2.5), Some(5.0));
        assert_eq!(track.at(0.9), None);
        assert_eq!(track.at(3.0), None);
    }
}
