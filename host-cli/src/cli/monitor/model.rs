//! What the monitor knows: the newest telemetry, a history for the curves, and a log.

use super::source::{Event, Update};
use crate::cli::values::AXES;
use control::geometry::{applied_force, cable_direction};
use nalgebra::Vector3;
use rig::Rig;
use serde_json::{json, Value};
use session::telemetry::Telemetry;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use wire::UNITS;

/// Period of the history, s.
pub const HISTORY_S: f64 = 0.5;
/// Its length in points.
const HISTORY: usize = 400;
/// Events that are kept.
const LOG: usize = 200;
/// The worst latency counts over this time, s.
const LATENCY_WINDOW_S: f64 = 1.0;

/// A tension, and whether it can be called one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// No sample in the last 0.1 s.
    None,
    /// The unit is not configured or switched off.
    Offline,
    /// The zero is being taken.
    Zeroing,
    /// The board holds no zero of this unit: the number (N) has an unknown offset.
    NoZero(f64),
    /// A tension, N.
    Tension(f64),
}

/// The force on the tool that a model tells of the robot's state.
#[cfg_attr(not(feature = "estimate"), allow(dead_code))]
#[derive(Debug, Clone, PartialEq)]
pub enum Estimated {
    /// No usable state of the robot came yet, or none for a second.
    Silent,
    /// A force.
    Force {
        /// Components that the model estimates, robot base frame, N.
        force_n: [Option<f64>; 3],
        /// Half width of the 90 % interval, N; `None`: the model has none.
        half_n: Option<f64>,
        /// Whether it can be used.
        valid: bool,
        /// The model no longer fits the robot.
        misfits: bool,
    },
}

impl Estimated {
    /// In words. What is not valid is never a bare number.
    pub fn text(&self) -> String {
        let Self::Force {
            force_n,
            half_n,
            valid,
            misfits,
        } = self
        else {
            return "no states of the robot".to_owned();
        };
        let cells = AXES.iter().zip(force_n);
        let cells = cells.filter_map(|(axis, n)| n.map(|n| format!("{axis}{n:>8.3}")));
        let force = cells.collect::<Vec<_>>().join("  ");
        match (misfits, valid, half_n) {
            (true, ..) => format!("INVALID: the model no longer fits this robot ({force})"),
            (_, false, _) => format!("invalid: the friction's state is not known ({force})"),
            (_, _, Some(half_n)) => format!("{force}  +- {half_n:.3} (90 %)"),
            (_, _, None) => force,
        }
    }

    /// With the names of `estimate run --json`; `null` without a state.
    pub fn json(&self) -> Value {
        let Self::Force {
            force_n,
            half_n,
            valid,
            misfits,
        } = self
        else {
            return Value::Null;
        };
        let mut object = json!({"half_width_n": half_n, "valid": valid, "misfits": misfits});
        for (axis, force_n) in AXES.iter().zip(force_n) {
            if let Some(force_n) = force_n {
                object[format!("estimate_{axis}_n")] = json!(force_n);
            }
        }
        object
    }
}

/// The state of what is watched.
#[derive(Debug, Default)]
pub struct Model {
    /// The newest telemetry.
    pub now: Telemetry,
    /// When it came.
    pub came: Option<Instant>,
    /// Tensions of the last minutes, one point each [`HISTORY_S`], oldest first; `None` where there
    /// was none.
    pub history: VecDeque<[Option<f64>; UNITS]>,
    /// Events, oldest first.
    pub log: VecDeque<Event>,
    /// What a model tells of the force; `None`: no model was asked for.
    pub estimate: Option<Estimated>,
    /// Where the cables leave the reels, robot base frame, m.
    pub exits_m: Option<[Vector3<f64>; UNITS]>,
    history_due_s: f64,
    latencies: VecDeque<(f64, u16)>,
}

impl Model {
    /// Nothing is known yet of this rig but where its cables leave the reels.
    pub fn of(rig: &Rig) -> Self {
        Self {
            exits_m: Some(rig.units.map(|unit| unit.exit_m)),
            ..Self::default()
        }
    }

    /// Takes an update.
    pub fn take(&mut self, update: Update) {
        match update {
            Update::Event(event) => self.note(event),
            Update::Telemetry(telemetry) => self.telemetry(*telemetry),
            Update::Estimate(estimate) => self.estimate = Some(estimate),
        }
    }

    fn telemetry(&mut self, telemetry: Telemetry) {
        let t_s = telemetry.t_s;
        // Another link counts its time anew.
        if t_s < self.now.t_s {
            self.latencies.clear();
            self.history_due_s = t_s;
        }
        self.now = telemetry;
        self.came = Some(Instant::now());
        if let Some(latency_us) = self.now.latency_us {
            self.latencies.push_back((t_s, latency_us));
        }
        while matches!(self.latencies.front(), Some((at, _)) if at + LATENCY_WINDOW_S < t_s) {
            self.latencies.pop_front();
        }
        if t_s >= self.history_due_s {
            self.history_due_s = t_s + HISTORY_S;
            let point = std::array::from_fn(|i| match self.reading(i) {
                Reading::Tension(tension_n) => Some(tension_n),
                _ => None,
            });
            self.history.push_back(point);
            if self.history.len() > HISTORY {
                self.history.pop_front();
            }
        }
    }

    /// Adds an event to the log.
    pub fn note(&mut self, event: Event) {
        self.log.push_back(event);
        if self.log.len() > LOG {
            self.log.pop_front();
        }
    }

    /// Force at the tip by the setpoints in force, robot base frame, N; `None` where not all units
    /// that are there run, or the tip is not known.
    pub fn commanded_n(&self) -> Option<[f64; 3]> {
        let (exits_m, tip_m) = (self.exits_m?, self.now.tip_m?);
        let (mut directions, mut setpoints) = (Vec::new(), Vec::new());
        for (i, exit_m) in exits_m.iter().enumerate() {
            match self.now.unit_state[i].as_deref() {
                Some("offline") => {}
                Some("running" | "stopping") => {
                    directions.push(cable_direction(*exit_m, tip_m.into())?);
                    setpoints.push(self.now.setpoint_n[i]?);
                }
                _ => return None,
            }
        }
        (!setpoints.is_empty()).then(|| applied_force(&directions, &setpoints).into())
    }

    /// Longest latency of the last second, us.
    pub fn worst_latency_us(&self) -> Option<u16> {
        self.latencies.iter().map(|(_, latency)| *latency).max()
    }

    /// The reading of a unit, from 0.
    pub fn reading(&self, i: usize) -> Reading {
        reading(&self.now, i)
    }

    /// For how long nothing has come, where that is long enough to say so.
    pub fn silence(&self, limit: Duration) -> Option<Duration> {
        self.came
            .map(|came| came.elapsed())
            .filter(|age| *age > limit)
    }
}

/// The reading of a unit, from 0, in this telemetry.
pub fn reading(now: &Telemetry, i: usize) -> Reading {
    let state = now.unit_state[i].as_deref().unwrap_or_default();
    match (state, now.tension_n[i]) {
        ("offline", _) => Reading::Offline,
        ("zeroing", _) => Reading::Zeroing,
        _ if now.state == "zeroing" => Reading::Zeroing,
        (_, None) => Reading::None,
        // Not known yet is no licence to call it a tension.
        (_, Some(value)) if now.zeroed[i] == Some(true) => Reading::Tension(value),
        (_, Some(value)) => Reading::NoZero(value),
    }
}
