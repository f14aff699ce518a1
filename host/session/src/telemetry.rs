//! What a rig does now, as one object: tensions, setpoints, states, faults, the force at the tip.
//! One data model for everyone who watches: the service sends it 50 times a second, and `monitor`
//! shows it, whether it comes from a service or from a session of its own.
//!
//! [`Gatherer`] puts it together from the board's messages.

use crate::{system_state_name, LatchedFault};
use control::geometry::{applied_force, cable_direction};
use control::{MotorState, SystemState};
use emulator_link::Truth;
use nalgebra::Vector3;
use rig::{PoseChoice, Rig};
use serde::{Deserialize, Serialize};
use wire::message::{Sample, Status, UnitConfig};
use wire::UNITS;

/// A tension without a newer sample for this long is not shown, ns.
pub const FRESH_NS: u64 = 100_000_000;

/// Tensions, forces and states at one time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Telemetry {
    /// Time of the link, s.
    pub t_s: f64,
    /// Newest cable tension of each unit, N; `null` without a sample in the last 0.1 s. A number
    /// without a zero (see `zeroed`) has an unknown offset of up to tens of newtons.
    pub tension_n: [Option<f64>; UNITS],
    /// Setpoint in force at that sample, N.
    pub setpoint_n: [Option<f64>; UNITS],
    /// State of the board (`ready`, `running`, `fault`, ...; `no status`, `no link`).
    pub state: String,
    /// Tip of the robot, base frame, m, where the link reports it or the rig file says it.
    pub tip_m: Option<[f64; 3]>,
    /// Force of the cables at the tip in the plant, N (emulated rig).
    pub true_force_n: Option<[f64; 3]>,
    /// Tensions in the plant, N (emulated rig).
    #[serde(default)]
    pub true_tension_n: Option<[f64; UNITS]>,
    /// Force at the tip by the measured tensions and the cable directions of the rig file, N. Units
    /// that are switched off count as slack. One that is faulted is at 0 V, and friction may hold
    /// its cable: it counts with what its load cell reads. `null` without a pose, or where a unit
    /// that is not switched off has no sample or no zero.
    #[serde(default)]
    pub force_n: Option<[f64; 3]>,
    /// Whether the board holds a zero of each unit; `null`: its configuration was not read yet.
    #[serde(default)]
    pub zeroed: [Option<bool>; UNITS],
    /// State of each unit (`offline`, `ready`, `running`, `faulted`, ...); `null` without a status.
    #[serde(default)]
    pub unit_state: [Option<String>; UNITS],
    /// Encoder position of each unit, counts (the lowest 32 bits), whether its load cell measures
    /// or not; `null` without a status.
    #[serde(default)]
    pub encoder_counts: [Option<i32>; UNITS],
    /// Newest code of each load cell's converter, without zero and scale; `null` without a status,
    /// 0 before the first sample.
    #[serde(default)]
    pub adc_code: [Option<i32>; UNITS],
    /// Latched faults, that of the board first.
    #[serde(default)]
    pub faults: Vec<LatchedFault>,
    /// Whether the E-stop loop is closed; `null` without a status.
    #[serde(default)]
    pub estop_closed: Option<bool>,
    /// Age of the setpoints in force, ms; `null`: none are in force.
    #[serde(default)]
    pub setpoint_age_ms: Option<u16>,
    /// Longest time from a sample's DRDY edge to its DAC word since the last telemetry, us; `null`
    /// without samples.
    #[serde(default)]
    pub latency_us: Option<u16>,
    /// What was lost.
    #[serde(default)]
    pub drops: Drops,
    /// Who commands, where a service knows it.
    #[serde(default)]
    pub commander: Option<String>,
    /// Everyone connected to the service.
    #[serde(default)]
    pub clients: Vec<String>,
}

/// What was lost since the link was opened, or since the board's boot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Drops {
    /// Frames of the board that never arrived, by gaps in their numbers, since the link was opened.
    pub frames_lost: u64,
    /// Frames that arrived damaged, since the link was opened.
    pub frames_bad: u64,
    /// Frames that the board's queue had no room for, since its boot.
    pub board_dropped: u32,
    /// Frames from the host that arrived damaged at the board, since its boot.
    pub board_bad: u32,
    /// Conversions that the board did not read in time, all units, since its boot.
    pub conversions_missed: u64,
}

/// The newest sample of a unit.
#[derive(Debug, Clone, Copy, Default)]
struct Newest {
    at_ns: u64,
    tension_n: f64,
    setpoint_n: f64,
}

/// Puts [`Telemetry`] together from what arrives.
#[derive(Debug)]
pub struct Gatherer {
    exits_m: Option<[Vector3<f64>; UNITS]>,
    fixed_tip_m: Option<[f64; 3]>,
    newest: [Newest; UNITS],
    latency_us: Option<u16>,
    configs: [Option<UnitConfig>; UNITS],
    configs_crc: Option<u32>,
    tip_m: Option<[f64; 3]>,
    truth: Option<Truth>,
}

impl Gatherer {
    /// For the rig of this rig file: where its cables leave the reels, and where the tip is if it
    /// is clamped. Without a rig file there is no force.
    #[must_use]
    pub fn new(rig: Option<&Rig>) -> Self {
        Self {
            exits_m: rig.map(|rig| rig.units.map(|unit| unit.exit_m)),
            fixed_tip_m: rig.and_then(|rig| match rig.pose {
                PoseChoice::Static { position_m } => Some(position_m.into()),
                PoseChoice::Rig | PoseChoice::Udp { .. } => None,
            }),
            newest: [Newest::default(); UNITS],
            latency_us: None,
            configs: [None; UNITS],
            configs_crc: None,
            tip_m: None,
            truth: None,
        }
    }

    /// A sample arrived at this time of the link.
    pub fn sample(&mut self, now_ns: u64, sample: &Sample) {
        if let Some(newest) = self.newest.get_mut(usize::from(sample.unit)) {
            *newest = Newest {
                at_ns: now_ns,
                tension_n: f64::from(sample.tension) * 1e-4,
                setpoint_n: f64::from(sample.setpoint) * 1e-4,
            };
            self.latency_us = self.latency_us.max(Some(sample.latency_us));
        }
    }

    /// The robot's tip, as the link reports it.
    pub fn pose(&mut self, tip_m: [f64; 3]) {
        self.tip_m = Some(tip_m);
    }

    /// The plant's true state.
    pub fn truth(&mut self, truth: &Truth) {
        self.truth = Some(truth.clone());
    }

    /// Whether the configurations of the board have to be read: they are unknown, or have changed
    /// since. Call [`Gatherer::reading`] when they are requested.
    #[must_use]
    pub fn wants_configs(&self, status: &Status) -> bool {
        self.configs_crc != Some(status.config_crc)
    }

    /// The configurations are requested. What is known until they come is the old one's.
    pub fn reading(&mut self, status: &Status) {
        self.configs_crc = Some(status.config_crc);
    }

    /// A configuration of the board, unit from 0.
    pub fn config(&mut self, unit: u8, config: &UnitConfig) {
        if let Some(slot) = self.configs.get_mut(usize::from(unit)) {
            *slot = Some(*config);
        }
    }

    /// Forgets what was known of a board that was reset.
    pub fn forget(&mut self) {
        self.configs = [None; UNITS];
        self.configs_crc = None;
        self.newest = [Newest::default(); UNITS];
        self.latency_us = None;
    }

    /// What is known at this time of the link. `status` is the newest one of the board; `state`
    /// stands for it where there is none. Latencies count from the last call.
    pub fn telemetry(&mut self, now_ns: u64, status: Option<&Status>, state: &str) -> Telemetry {
        let fresh = self.newest.map(|newest| {
            (newest.at_ns > 0 && newest.at_ns + FRESH_NS >= now_ns).then_some(newest)
        });
        let tension_n = fresh.map(|newest| newest.map(|n| n.tension_n));
        let tip_m = self.tip_m.or(self.fixed_tip_m);
        Telemetry {
            t_s: now_ns as f64 * 1e-9,
            tension_n,
            setpoint_n: fresh.map(|newest| newest.map(|n| n.setpoint_n)),
            state: status.map_or_else(|| state.to_owned(), |s| system_state_name(s.state)),
            tip_m,
            true_force_n: self.truth.as_ref().map(|truth| truth.tip_force_n),
            true_tension_n: self.truth.as_ref().map(|truth| truth.tension_n),
            force_n: status
                .zip(tip_m)
                .and_then(|(status, tip_m)| self.force(status, &tension_n, tip_m)),
            zeroed: self.zeroed(status),
            unit_state: status.map_or_else(Default::default, |status| {
                status
                    .units
                    .map(|unit| Some(crate::motor_state_name(unit.state)))
            }),
            encoder_counts: std::array::from_fn(|i| status.map(|s| s.units[i].encoder_counts)),
            adc_code: std::array::from_fn(|i| status.map(|s| s.units[i].adc_code)),
            faults: status.map_or_else(Vec::new, |s| LatchedFault::all_of(s).collect()),
            estop_closed: status.map(|status| status.estop_closed),
            setpoint_age_ms: status
                .map(|status| status.setpoint_age_ms)
                .filter(|age| *age != u16::MAX),
            latency_us: self.latency_us.take(),
            drops: status.map_or_else(Drops::default, |status| Drops {
                board_dropped: status.frames_dropped,
                board_bad: status.frames_bad,
                conversions_missed: status.units.iter().map(|unit| u64::from(unit.missed)).sum(),
                ..Drops::default()
            }),
            commander: None,
            clients: Vec::new(),
        }
    }

    /// Whether the board holds zeros. While one is being taken there is none.
    fn zeroed(&self, status: Option<&Status>) -> [Option<bool>; UNITS] {
        std::array::from_fn(|i| {
            let zeroing = status.is_some_and(|status| {
                MotorState::from_u8(status.units[i].state) == Some(MotorState::Zeroing)
                    || status.state == SystemState::Zeroing as u8
            });
            // A board that was powered up holds 0, which no load cell's zero is.
            self.configs[i].map(|config| config.zero_code != 0 && !zeroing)
        })
    }

    fn force(
        &self,
        status: &Status,
        tension_n: &[Option<f64>; UNITS],
        tip_m: [f64; 3],
    ) -> Option<[f64; 3]> {
        let exits_m = self.exits_m?;
        let zeroed = self.zeroed(Some(status));
        let mut directions = Vec::with_capacity(UNITS);
        let mut tensions = Vec::with_capacity(UNITS);
        for i in 0..UNITS {
            let off = MotorState::from_u8(status.units[i].state) == Some(MotorState::Offline);
            if off || !self.configs[i].is_some_and(|config| config.enabled) {
                continue;
            }
            if zeroed[i] != Some(true) {
                return None;
            }
            directions.push(cable_direction(exits_m[i], tip_m.into())?);
            tensions.push(tension_n[i]?);
        }
        // With no unit at all nothing is measured, not even zero.
        (!tensions.is_empty()).then(|| applied_force(&directions, &tensions).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: u64 = 5_000_000_000;
    const TIP_M: [f64; 3] = [-0.08, 0.025, -0.14];

    fn status() -> Status {
        let unit = wire::message::UnitStatus {
            state: MotorState::Running as u8,
            ..Default::default()
        };
        Status {
            t_us: 0,
            state: SystemState::Running as u8,
            fault: 0,
            fault_detail: 0,
            estop_closed: true,
            units: [unit; UNITS],
            tip_force_un: [0; 3],
            alive_withheld: false,
            config_crc: 7,
            setpoint_age_ms: u16::MAX,
            frames_dropped: 0,
            frames_bad: 0,
            bus_recoveries: 0,
            sleep_permille: 0,
            queue_high_water: 0,
        }
    }

    /// Every unit has a zero and pulls with 1 N, 2 N, ...
    fn gathered(rig: &Rig) -> Gatherer {
        let mut gatherer = Gatherer::new(Some(rig));
        for (i, unit) in rig.units.iter().enumerate() {
            let config = UnitConfig {
                zero_code: 1000,
                ..unit.to_wire()
            };
            gatherer.config(i as u8, &config);
            let sample = Sample {
                unit: i as u8,
                tension: 10_000 * (i as i32 + 1),
                latency_us: 100 + i as u16,
                ..Sample::default()
            };
            gatherer.sample(NOW_NS, &sample);
        }
        gatherer.pose(TIP_M);
        gatherer
    }

    /// Force of some units along their cables.
    fn by_hand(rig: &Rig, units: &[usize]) -> Vector3<f64> {
        let tip = Vector3::from(TIP_M);
        units.iter().fold(Vector3::zeros(), |sum, &i| {
            let span = rig.units[i].exit_m - tip;
            sum + span / span.norm() * (i as f64 + 1.0)
        })
    }

    #[test]
    fn the_force_is_that_of_the_cables_that_take_part() {
        let rig = Rig::built_in().unwrap();
        let mut gatherer = gathered(&rig);
        let mut status = status();
        let now = gatherer.telemetry(NOW_NS, Some(&status), "");
        let force = Vector3::from(now.force_n.unwrap());
        let all = by_hand(&rig, &[0, 1, 2, 3, 4, 5]);
        assert!((force - all).norm() < 1e-9, "{force} {all}");
        assert_eq!(now.latency_us, Some(105));
        assert_eq!(now.setpoint_age_ms, None);
        // A faulted unit is at 0 V and named; its cable pulls with what its load cell reads.
        status.units[2].state = MotorState::Faulted as u8;
        status.units[2].fault = 33;
        status.fault = 2;
        let now = gatherer.telemetry(NOW_NS, Some(&status), "");
        assert!((Vector3::from(now.force_n.unwrap()) - all).norm() < 1e-9);
        let codes: Vec<_> = now.faults.iter().map(|f| (f.unit, f.code)).collect();
        assert_eq!(codes, [(None, 2), (Some(3), 33)]);
        // Latencies are those since the last call.
        assert_eq!(now.latency_us, None);
        // One that is switched off has no part.
        status.units[2].state = MotorState::Offline as u8;
        let now = gatherer.telemetry(NOW_NS, Some(&status), "");
        let force = Vector3::from(now.force_n.unwrap());
        assert!((force - by_hand(&rig, &[0, 1, 3, 4, 5])).norm() < 1e-9);
        // What a faulted one pulls with is not known without a sample: the force is not known
        // either.
        status.units[2].state = MotorState::Faulted as u8;
        gatherer.newest[2] = Newest::default();
        let now = gatherer.telemetry(NOW_NS, Some(&status), "");
        assert_eq!((now.force_n, now.tension_n[2]), (None, None));
    }

    #[test]
    fn there_is_no_force_without_zero_sample_or_pose() {
        let rig = Rig::built_in().unwrap();
        let status = status();
        let force =
            |gatherer: &mut Gatherer, now_ns| gatherer.telemetry(now_ns, Some(&status), "").force_n;
        assert!(force(&mut gathered(&rig), NOW_NS).is_some());
        assert_eq!(force(&mut gathered(&rig), NOW_NS + FRESH_NS + 1), None);
        let mut no_zero = gathered(&rig);
        no_zero.config(4, &rig.units[4].to_wire());
        assert_eq!(force(&mut no_zero, NOW_NS), None);
        let now = no_zero.telemetry(NOW_NS, Some(&status), "");
        assert_eq!(now.zeroed[3..], [Some(true), Some(false), Some(true)]);
        let mut no_pose = gathered(&rig);
        no_pose.tip_m = None;
        assert_eq!(force(&mut no_pose, NOW_NS), None);
        let mut clamped = rig.clone();
        clamped.pose = PoseChoice::Static {
            position_m: TIP_M.into(),
        };
        let mut clamped = gathered(&clamped);
        clamped.tip_m = None;
        assert!(force(&mut clamped, NOW_NS).is_some());
    }

    #[test]
    fn configurations_are_read_again_when_they_change() {
        let mut gatherer = Gatherer::new(None);
        let mut status = status();
        assert!(gatherer.wants_configs(&status));
        gatherer.reading(&status);
        assert!(!gatherer.wants_configs(&status));
        status.config_crc += 1;
        assert!(gatherer.wants_configs(&status));
        gatherer.reading(&status);
        gatherer.forget();
        assert!(gatherer.wants_configs(&status));
        let now = gatherer.telemetry(NOW_NS, None, "no link");
        assert_eq!((now.state.as_str(), now.zeroed), ("no link", [None; UNITS]));
    }
}
