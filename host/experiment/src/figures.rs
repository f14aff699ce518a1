//! Figures of a trial, and whether it keeps its gates.

use super::dataset::Joiner;
use super::file::{Experiment, Gates};
use super::pull::OneAxis;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use session::{LinkCounters, TimedSample};
use std::collections::BTreeMap;
use wire::message::flags;
use wire::UNITS;

/// Nominal sample rate of a load cell's converter, 1/s; chips differ by a few per cent.
const CELL_RATE_HZ: f64 = 320.0;

/// What is counted while a trial runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Counts {
    one_axis: Option<OneAxis>,
    used: [bool; UNITS],
    trial_s: f64,
    rate_hz: f64,
    last_us: [Option<u64>; UNITS],
    samples: u64,
    samples_lost: u64,
    limited: u64,
    cycles: u64,
    tension_square: [f64; UNITS],
    rows: u64,
    rows_incomplete: u64,
    force_square: f64,
    force_largest: f64,
    force_rows: u64,
    force_age_s: f64,
    sync_error_s: f64,
    frames_lost: u64,
    /// Events of the robot's watch.
    pub robot_events: u64,
    /// How often a part of the robot's states was left out for a flaw, by part.
    pub robot_left_out: BTreeMap<String, u64>,
    /// Why the recording of samples ended early.
    pub record_error: Option<String>,
}

/// Figures of a trial.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Figures {
    /// Rows of the dataset.
    pub rows: u64,
    /// Rows that should be there.
    pub rows_expected: u64,
    /// Rows that lack a force.
    pub rows_incomplete: u64,
    /// RMS of measured less commanded force over the rows, N; one axis: along it.
    pub tracking_rms_n: f64,
    /// Largest of that, N.
    pub tracking_largest_n: f64,
    /// RMS of measured tension less its setpoint per unit, N; 0 for a unit that is not used.
    pub tension_rms_n: [f64; UNITS],
    /// Load-cell samples of the used units.
    pub samples: u64,
    /// Samples that are missing, by gaps in time.
    pub samples_lost: u64,
    /// Telemetry frames that did not arrive.
    pub frames_lost: u64,
    /// Share of samples with the unit's command at its limit.
    pub saturated: f64,
    /// Largest age of a force, s.
    pub force_age_s: f64,
    /// Largest uncertainty of the time between robot and board, s.
    pub sync_error_s: f64,
    /// Events of the robot's watch.
    pub robot_events: u64,
    /// How often a part of the robot's states was left out for a flaw (NaN, no names, a stamp of
    /// 0), by part.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub robot_left_out: BTreeMap<String, u64>,
}

/// One gate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GateResult {
    /// Key in `[gates]`.
    pub name: String,
    /// Reached.
    pub value: f64,
    /// Allowed.
    pub limit: f64,
    /// Whether it is kept.
    pub kept: bool,
}

impl Counts {
    /// Nothing counted yet. `used`: units that take part.
    #[must_use]
    pub fn new(experiment: &Experiment, used: [bool; UNITS]) -> Self {
        Self {
            one_axis: OneAxis::of(&experiment.force),
            used,
            trial_s: experiment.trial_s(),
            rate_hz: experiment.rate_hz,
            last_us: [None; UNITS],
            samples: 0,
            samples_lost: 0,
            limited: 0,
            cycles: 0,
            tension_square: [0.0; UNITS],
            rows: 0,
            rows_incomplete: 0,
            force_square: 0.0,
            force_largest: 0.0,
            force_rows: 0,
            force_age_s: 0.0,
            sync_error_s: 0.0,
            frames_lost: 0,
            robot_events: 0,
            robot_left_out: BTreeMap::new(),
            record_error: None,
        }
    }

    /// Samples while the profile runs.
    pub fn samples(&mut self, samples: &[TimedSample]) {
        for timed in samples {
            let unit = usize::from(timed.sample.unit);
            if !self.used.get(unit).copied().unwrap_or(false) {
                continue;
            }
            self.samples += 1;
            self.limited += u64::from(timed.sample.flags & flags::AT_A_LIMIT != 0);
            if let Some(before) = self.last_us[unit].replace(timed.t_us) {
                let periods = timed.t_us.saturating_sub(before) as f64 * 1e-6 * CELL_RATE_HZ;
                self.samples_lost += (periods.round() as u64).saturating_sub(1);
            }
        }
    }

    /// A control cycle: tensions measured and commanded, N.
    pub fn cycle(&mut self, measured_n: &[f64; UNITS], setpoint_n: &[f64; UNITS], _t_s: f64) {
        self.cycles += 1;
        for unit in (0..UNITS).filter(|unit| self.used[*unit]) {
            let error = measured_n[unit] - setpoint_n[unit];
            if error.is_finite() {
                self.tension_square[unit] += error * error;
            }
        }
    }

    /// The rows of the trial.
    pub fn rows(&mut self, joiner: &Joiner) {
        let column = |name: &str| joiner.rows.column(name).unwrap_or_default();
        let measured = ["force_x_n", "force_y_n", "force_z_n"].map(column);
        let commanded = [
            "force_commanded_x_n",
            "force_commanded_y_n",
            "force_commanded_z_n",
        ]
        .map(column);
        self.rows = joiner.rows.rows() as u64;
        self.rows_incomplete = joiner.worst.incomplete;
        self.force_age_s = joiner.worst.force_age_s;
        self.sync_error_s = joiner.worst.sync_error_s;
        for row in 0..joiner.rows.rows() {
            let error = Vector3::from_fn(|i, _| measured[i][row] - commanded[i][row]);
            let error_n = match &self.one_axis {
                Some(one) => error.dot(&one.axis).abs(),
                None => error.norm(),
            };
            if error_n.is_finite() {
                self.force_square += error_n * error_n;
                self.force_largest = self.force_largest.max(error_n);
                self.force_rows += 1;
            }
        }
    }

    /// Counters of the link.
    pub fn link(&mut self, counters: LinkCounters) {
        self.frames_lost = counters.frames_lost + counters.frames_bad;
    }

    /// The figures.
    #[must_use]
    pub fn figures(&self) -> Figures {
        let root_mean = |sum: f64, count: u64| (sum / count.max(1) as f64).sqrt();
        Figures {
            rows: self.rows,
            rows_expected: (self.trial_s * self.rate_hz).round() as u64,
            rows_incomplete: self.rows_incomplete,
            tracking_rms_n: root_mean(self.force_square, self.force_rows),
            tracking_largest_n: self.force_largest,
            tension_rms_n: self.tension_square.map(|s| root_mean(s, self.cycles)),
            samples: self.samples,
            samples_lost: self.samples_lost,
            frames_lost: self.frames_lost,
            saturated: self.limited as f64 / self.samples.max(1) as f64,
            force_age_s: self.force_age_s,
            sync_error_s: self.sync_error_s,
            robot_events: self.robot_events,
            robot_left_out: self.robot_left_out.clone(),
        }
    }
}

/// The gates of a trial with these figures.
#[must_use]
pub fn judge(figures: &Figures, gates: &Gates) -> Vec<GateResult> {
    let share = |part: u64, of: u64| part as f64 / of.max(1) as f64;
    let missing = figures.rows_expected.saturating_sub(figures.rows) + figures.rows_incomplete;
    [
        (
            "tracking_rms_n",
            figures.tracking_rms_n,
            gates.tracking_rms_n,
        ),
        (
            "samples_lost",
            share(figures.samples_lost, figures.samples + figures.samples_lost),
            gates.samples_lost,
        ),
        (
            "rows_lost",
            share(missing, figures.rows_expected),
            gates.rows_lost,
        ),
        ("sync_error_s", figures.sync_error_s, gates.sync_error_s),
        ("force_age_s", figures.force_age_s, gates.force_age_s),
        ("saturated", figures.saturated, gates.saturated),
    ]
    .map(|(name, value, limit)| GateResult {
        name: name.to_owned(),
        value,
        limit,
        // NaN is not kept.
        kept: value <= limit && (figures.samples > 0 && figures.rows > 0),
    })
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::message::Sample;

    #[test]
    fn missing_samples_are_counted_by_their_gaps_and_units_that_are_not_used_do_not_count() {
        let thesis = Experiment::thesis().unwrap();
        let mut counts = Counts::new(&thesis, [true, false, false, false, false, false]);
        let sample = |unit, t_us, limited: bool| TimedSample {
            t_us,
            sample: Sample {
                unit,
                flags: if limited { flags::LIMITED } else { 0 },
                ..Sample::default()
            },
        };
        // A chip that is 3 % slow, with two samples missing once.
        let times = [0, 3220, 6440, 16_100, 19_320];
        for t in times {
            counts.samples(&[sample(0, t, t == 0), sample(1, t, true)]);
        }
        let figures = counts.figures();
        assert_eq!((figures.samples, figures.samples_lost), (5, 2));
        assert_eq!(figures.saturated, 0.2);
    }

    #[test]
    fn every_gate_can_fail_and_a_trial_without_data_keeps_none() {
        let gates = Gates::default();
        let good = Figures {
            rows: 1000,
            rows_expected: 1000,
            samples: 6000,
            tracking_rms_n: 0.1,
            ..Figures::default()
        };
        assert!(judge(&good, &gates).iter().all(|gate| gate.kept));
        let bad: [(&str, Figures); 6] = [
            (
                "tracking_rms_n",
                Figures {
                    tracking_rms_n: 0.4,
                    ..good.clone()
                },
            ),
            (
                "samples_lost",
                Figures {
                    samples_lost: 60,
                    ..good.clone()
                },
            ),
            (
                "rows_lost",
                Figures {
                    rows: 900,
                    ..good.clone()
                },
            ),
            (
                "sync_error_s",
                Figures {
                    sync_error_s: f64::NAN,
                    ..good.clone()
                },
            ),
            (
                "force_age_s",
                Figures {
                    force_age_s: 0.02,
                    ..good.clone()
                },
            ),
            (
                "saturated",
                Figures {
                    saturated: 0.5,
                    ..good.clone()
                },
            ),
        ];
        for (name, figures) in bad {
            let failed: Vec<String> = judge(&figures, &gates)
                .into_iter()
                .filter(|gate| !gate.kept)
                .map(|gate| gate.name)
                .collect();
            assert_eq!(failed, [name]);
        }
        assert!(judge(&Figures::default(), &gates)
            .iter()
            .all(|gate| !gate.kept));
    }
}
