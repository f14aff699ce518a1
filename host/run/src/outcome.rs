//! Result of a run: how it ended, its figures, faults and losses.

use crate::fault::RunFault;
use crate::quality::Shortfall;
use emulator_link::Report;
use force::controller::Reach;
use force::metrics::{Metrics, Step};
use nalgebra::Vector3;
use serde::Serialize;
use session::LinkCounters;
use wire::message::UnitConfig;
use wire::UNITS;

/// Latency from the DRDY edge to the DAC, of samples while holding, ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LatencyMs {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Measured from outside of the firmware (embedded rig), or by the firmware itself.
    pub measured_outside: bool,
}

impl LatencyMs {
    /// From the embedded rig's own record from `t0_ns` on, or from the firmware's times where there
    /// is no such record; `None` where there is neither.
    pub(super) fn of(report: Option<&Report>, t0_ns: u64, firmware_us: &Histogram) -> Option<Self> {
        let mut outside: Vec<f64> = report
            .into_iter()
            .flat_map(|report| &report.latencies)
            .filter(|latency| latency.drdy_ns >= t0_ns)
            .map(|latency| latency.dac_update_ns.saturating_sub(latency.drdy_ns) as f64 * 1e-6)
            .collect();
        let Some(last) = outside.len().checked_sub(1) else {
            let last = firmware_us.count.checked_sub(1)?;
            let ms = |place: u64| firmware_us.at(place) * 1e-3;
            return Some(Self {
                p50: ms(last / 2),
                p99: ms(last * 99 / 100),
                measured_outside: false,
            });
        };
        outside.sort_by(f64::total_cmp);
        Some(Self {
            p50: outside[last / 2],
            p99: outside[last * 99 / 100],
            measured_outside: true,
        })
    }
}

/// How often each value of 16 bits came: exact quantiles of any number of values in 0.5 MB.
#[derive(Debug, Clone, Default)]
pub(super) struct Histogram {
    counts: Vec<u64>,
    count: u64,
}

impl Histogram {
    pub fn add(&mut self, value: u16) {
        let at = usize::from(value);
        if self.counts.len() <= at {
            self.counts.resize(at + 1, 0);
        }
        self.counts[at] += 1;
        self.count += 1;
    }

    /// The value at a place, from 0, of all in order.
    fn at(&self, place: u64) -> f64 {
        let mut before = 0;
        let found = self.counts.iter().position(|count| {
            before += count;
            before > place
        });
        found.unwrap_or_default() as f64
    }
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// As commanded.
    Done,
    /// To the end, but not as commanded: see [`Outcome::shortfalls`].
    Degraded,
    /// Ended early from outside.
    Interrupted,
    /// Ended early by a fault, a lost unit or a lost link.
    Stopped,
}

impl Ended {
    pub(super) const fn of(stopped: bool, interrupted: bool, degraded: bool) -> Self {
        match (stopped, interrupted, degraded) {
            (true, _, _) => Self::Stopped,
            (false, true, _) => Self::Interrupted,
            (false, false, true) => Self::Degraded,
            (false, false, false) => Self::Done,
        }
    }
}

/// Result of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// How it ended.
    pub ended: Ended,
    /// What was not as commanded, the most important first.
    pub shortfalls: Vec<Shortfall>,
    /// The link's name.
    pub link: String,
    /// Firmware version.
    pub firmware: String,
    /// Hash of the rig file.
    pub rig_hash: String,
    /// CRC-32 of the configuration that was in force on the board, zeros included.
    pub config_crc: u32,
    /// Commanded force, robot base frame, N.
    pub commanded_n: Vector3<f64>,
    /// Figures; `None` where the run was too short.
    pub metrics: Option<Metrics>,
    /// How well the applied force is known; `None` where no calibration of this rig is stored.
    pub uncertainty: Option<known::uncertainty::ForceUncertainty>,
    /// How the commanded force compared with what the cables can apply, in the worst cycle.
    pub reach: Option<Reach>,
    /// Faults, in order.
    pub faults: Vec<RunFault>,
    /// DRDY edge to DAC.
    pub latency_ms: Option<LatencyMs>,
    /// Conversions that were not read in time during the run.
    pub samples_lost: u64,
    /// Samples that came in by telemetry since arming.
    pub samples: u64,
    /// Counters of the link.
    pub link_counters: LinkCounters,
    /// For how long the amplifiers were without power while the rig was armed, s (embedded rig).
    pub amplifiers_off_s: f64,
    /// Every cycle.
    #[serde(skip)]
    pub steps: Vec<Step>,
    /// Figures from outside of the firmware (embedded rig).
    #[serde(skip)]
    pub report: Option<Report>,
    /// The configuration that was in force, zeros included.
    #[serde(skip)]
    pub configs: [UnitConfig; UNITS],
}

#[cfg(test)]
impl Outcome {
    /// An outcome of these cycles without anything else, for tests.
    pub fn of_steps(commanded_n: Vector3<f64>, steps: Vec<Step>) -> Self {
        Self {
            ended: Ended::Done,
            shortfalls: Vec::new(),
            link: "rig & <test>".to_owned(),
            firmware: String::new(),
            rig_hash: String::new(),
            config_crc: 0,
            commanded_n,
            metrics: force::metrics::of_run(commanded_n, &steps),
            uncertainty: None,
            reach: None,
            faults: Vec::new(),
            latency_ms: None,
            samples_lost: 0,
            samples: 0,
            link_counters: LinkCounters::default(),
            amplifiers_off_s: 0.0,
            steps,
            report: None,
            configs: rig::Rig::built_in()
                .unwrap()
                .units
                .map(|unit| unit.to_wire()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_counts_more_than_an_end_from_outside_and_that_more_than_quality() {
        for (stopped, interrupted, degraded, ended) in [
            (false, false, false, Ended::Done),
            (false, false, true, Ended::Degraded),
            (false, true, false, Ended::Interrupted),
            (false, true, true, Ended::Interrupted),
            (true, false, true, Ended::Stopped),
            (true, true, true, Ended::Stopped),
        ] {
            assert_eq!(Ended::of(stopped, interrupted, degraded), ended);
        }
    }

    #[test]
    fn latencies_are_those_of_the_firmware_where_no_rig_records_them() {
        let mut us = Histogram::default();
        (1..=101).rev().for_each(|n| us.add(n * 10));
        let found = LatencyMs::of(None, 0, &us).unwrap();
        assert!((found.p50 - 0.51).abs() < 1e-12, "{found:?}");
        assert!((found.p99 - 1.0).abs() < 1e-12, "{found:?}");
        assert!(!found.measured_outside);
        assert_eq!(LatencyMs::of(None, 0, &Histogram::default()), None);
    }
}
