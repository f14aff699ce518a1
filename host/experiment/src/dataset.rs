//! The dataset's columns, and how load-cell samples and robot states become its rows.
//!
//! A row is a state of the robot. The tension of each cable at its time is interpolated between the
//! two load-cell samples around it, from raw codes, with the delay of the converter's filter taken
//! off; the force at the tip is their sum along the cables' directions at the tip that the robot
//! reports. What the plant truly does goes into another table.

use control::cell::CellForce;
use force::controller::{problem, Cables};
use known::uncertainty::Systematic;
use nalgebra::Vector3;
pub use recording::table::Column;
use recording::table::ColumnTable;
use rig::link_pose::ROBOT_SD_M;
use rig::{PoseChoice, Rig};
use robot::state::RobotState;
use session::TimedSample;
use std::collections::VecDeque;
use wire::message::UnitConfig;
use wire::UNITS;

use super::table::Table;

/// Joints of a row.
pub const JOINTS: usize = 3;
/// Group delay of the NAU7802's filter at 320 samples per second, s: two sample periods of its
/// fourth-order sinc.
pub const CELL_DELAY_S: f64 = 0.00625;
/// A tension is interpolated over a gap of at most this, s; over a longer one it is missing.
const LONGEST_GAP_S: f64 = 0.05;
/// A state waits for the samples after it for at most this, s.
const LONGEST_WAIT_S: f64 = 0.25;

/// A column for each joint: shoulder and elbow in one unit, the insertion in another.
macro_rules! joints {
    ($name:literal, $turning:literal, $sliding:literal, $what:literal) => {
        [
            (concat!($name, "_1"), $turning, concat!("shoulder, ", $what)),
            (concat!($name, "_2"), $turning, concat!("elbow, ", $what)),
            (
                concat!($name, "_3"),
                $sliding,
                concat!("insertion, ", $what),
            ),
        ]
    };
}

/// A column for each axis of the rig's frame.
macro_rules! axes {
    ($before:literal, $after:literal, $unit:literal, $what:literal) => {
        [
            (concat!($before, "x", $after), $unit, concat!($what, ", x")),
            (concat!($before, "y", $after), $unit, concat!($what, ", y")),
            (concat!($before, "z", $after), $unit, concat!($what, ", z")),
        ]
    };
}

/// A column for each unit.
macro_rules! tensions {
    ($name:literal, $what:literal) => {
        [
            (concat!($name, "_1_n"), "N", concat!("cable 1, ", $what)),
            (concat!($name, "_2_n"), "N", concat!("cable 2, ", $what)),
            (concat!($name, "_3_n"), "N", concat!("cable 3, ", $what)),
            (concat!($name, "_4_n"), "N", concat!("cable 4, ", $what)),
            (concat!($name, "_5_n"), "N", concat!("cable 5, ", $what)),
            (concat!($name, "_6_n"), "N", concat!("cable 6, ", $what)),
        ]
    };
}

/// The columns of all parts, in order; `N` must be their count.
const fn joined<const N: usize>(parts: &[&[Column]]) -> [Column; N] {
    let mut all = [("", "", ""); N];
    let (mut part, mut at) = (0, 0);
    while part < parts.len() {
        let mut column = 0;
        while column < parts[part].len() {
            all[at] = parts[part][column];
            (at, column) = (at + 1, column + 1);
        }
        part += 1;
    }
    assert!(at == N, "count of the columns");
    all
}

/// Columns of the dataset.
pub const COLUMNS: [Column; 39] = joined(&[
    &[
        ("t_s", "s", "time since the force profile's start, on the board's clock"),
        ("board_time_s", "s", "the same instant since the board's power-on"),
        ("robot_time_s", "s", "the robot's own stamp, on its own clock"),
    ],
    &joints!("joint_position", "rad", "m", "from the encoders"),
    &joints!("joint_velocity", "rad/s", "m/s", "as the robot publishes it"),
    &joints!(
        "joint_effort",
        "N·m",
        "N",
        "torque or force of the drive at the joint; the data card says whether commanded or measured"
    ),
    &joints!("joint_setpoint", "rad", "m", "set point"),
    &axes!("tip_", "_m", "m", "tip as the robot reports it, rig frame"),
    &axes!(
        "force_",
        "_n",
        "N",
        "the label: force on the tool by the cables, rig frame, from the load cells"
    ),
    &axes!(
        "force_commanded_",
        "_n",
        "N",
        "commanded force on the tool, rig frame"
    ),
    &tensions!(
        "tension",
        "tension, interpolated; missing for a unit that is not used"
    ),
    &[
        ("force_age_s", "s", "distance in time from the row to the nearest load-cell sample, the largest of the used units"),
        ("sync_error_s", "s", "uncertainty of the time between robot and board"),
        ("tip_age_s", "s", "age of the tip at the time of the row, by the robot's stamps of both; below 0: the tip is the younger one"),
        ("force_95_n", "N", "radius of the ball about the label that holds the force with 95 %, by calibration and pose; missing without a calibration"),
        ("saturated", "1", "1: a unit's command was at its limit in the control cycle of this row"),
        ("operating_state", "1", "CRTK: 0 disabled, 1 enabled, 2 paused, 3 fault; missing where the robot tells none"),
        ("quality", "1", "1: the row can be used; 0: a value that it needs is missing"),
        ("trial", "1", "number of the trial"),
        ("attempt", "1", "number of the attempt at it"),
    ],
]);

/// Index of `board_time_s` in [`COLUMNS`].
pub(super) const BOARD_TIME: usize = 1;

/// Columns of the truth, which exists for a virtual rig only.
pub const TRUTH_COLUMNS: [Column; 28] = joined(&[
    &[("t_s", "s", "as in the dataset: same rows, same order")],
    &axes!(
        "true_force_",
        "_n",
        "N",
        "force on the tool in the plant, rig frame"
    ),
    &joints!("true_contact_effort", "N·m", "N", "that force at the joint"),
    &joints!("true_joint_position", "rad", "m", "position of the link"),
    &joints!(
        "true_joint_velocity",
        "rad/s",
        "m/s",
        "velocity of the link"
    ),
    &joints!(
        "true_motor_friction",
        "N·m",
        "N",
        "friction at the motor, in the joint's unit"
    ),
    &joints!("true_link_friction", "N·m", "N", "friction at the link"),
    &axes!("true_tip_", "_m", "m", "tip, rig frame"),
    &tensions!("true_tension", "tension in the plant"),
]);

/// The rows in a trial's recording.
pub const ROWS: ColumnTable = ColumnTable {
    topic: "/robot",
    schema_name: "force_rig.RobotState",
    row: "a state of the robot with the force at its time: a row of the dataset",
    columns: &COLUMNS,
};

/// Their truth.
pub const TRUTH: ColumnTable = ColumnTable {
    topic: "/truth",
    schema_name: "force_rig.Truth",
    row: "what the plant truly did, for each row of /robot; no estimator may read it",
    columns: &TRUTH_COLUMNS,
};

/// An empty table with these columns.
#[must_use]
pub fn table(columns: &[Column]) -> Table {
    Table::new(columns.iter().map(|c| c.0.to_owned()).collect())
}

/// A robot state that waits for its load-cell samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Waiting {
    /// The state, in the rig's frame.
    pub state: RobotState,
    /// Its time on the board's clock, s.
    pub board_s: f64,
    /// Uncertainty of that, s.
    pub sync_error_s: f64,
    /// Commanded force at that time, N.
    pub commanded_n: Vector3<f64>,
    /// Whether a unit was at its limit.
    pub saturated: bool,
    /// The truth at that time, its columns after `t_s`.
    pub truth: Option<Vec<f64>>,
}

/// Worst figures of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Worst {
    /// Largest [`force_age_s`](COLUMNS), s.
    pub force_age_s: f64,
    /// Largest `sync_error_s`, s.
    pub sync_error_s: f64,
    /// Rows that lack something.
    pub incomplete: u64,
}

/// Turns states and samples into rows.
#[derive(Debug)]
pub struct Joiner {
    rig: Rig,
    cells: [CellForce; UNITS],
    /// What the calibration says of the label, where there is one.
    known: Option<Systematic>,
    /// Time and force along the cell's axis of each unit's latest samples, s and N.
    samples: [VecDeque<(f64, f64)>; UNITS],
    waiting: VecDeque<Waiting>,
    /// Board time of `t_s = 0`.
    start_s: f64,
    trial: usize,
    attempt: u32,
    /// The rows.
    pub rows: Table,
    /// Their truth, row by row.
    pub truth: Table,
    /// Worst figures so far.
    pub worst: Worst,
    /// Whether the robot tells its joints: a row needs them then.
    has_joints: bool,
}

impl Joiner {
    /// For a rig with these configurations in force; `start_s` is the board time of the force
    /// profile's start.
    #[must_use]
    pub fn new(
        rig: &Rig,
        configs: &[UnitConfig; UNITS],
        start_s: f64,
        trial: usize,
        attempt: u32,
    ) -> Self {
        Self {
            rig: rig.clone(),
            cells: configs.each_ref().map(CellForce::new),
            known: rig.calibration.as_deref().map(|record| {
                // The tip is the robot's, and the rig file may know of none.
                let pose_sd_m = match rig.pose {
                    PoseChoice::Rig => ROBOT_SD_M,
                    _ => rig.pose_sd_m,
                };
                Systematic::new(record, pose_sd_m)
            }),
            samples: Default::default(),
            waiting: VecDeque::new(),
            start_s,
            trial,
            attempt,
            rows: table(&COLUMNS),
            truth: table(&TRUTH_COLUMNS),
            worst: Worst::default(),
            has_joints: false,
        }
    }

    /// Takes load-cell samples in the order in which they came.
    pub fn samples(&mut self, samples: &[TimedSample]) {
        for timed in samples {
            let unit = usize::from(timed.sample.unit);
            let Some(cell) = self.cells.get_mut(unit) else {
                continue;
            };
            let cell_n = cell.at(timed.sample.adc_code, timed.t_us);
            let t_s = timed.t_us as f64 * 1e-6 - CELL_DELAY_S;
            let list = &mut self.samples[unit];
            list.push_back((t_s, cell_n));
            while list.len() > 2 && list[0].0 < t_s - 1.0 {
                list.pop_front();
            }
        }
    }

    /// Takes a state of the robot.
    pub fn state(&mut self, waiting: Waiting) {
        self.waiting.push_back(waiting);
    }

    /// Makes rows of the states whose samples have come by board time `now_s`; of all that wait,
    /// where `end` is set.
    pub fn join(&mut self, now_s: f64, end: bool) {
        while let Some(first) = self.waiting.front() {
            let at = first.board_s;
            let complete = (0..UNITS)
                .filter(|i| self.rig.units[*i].enabled)
                .all(|i| self.samples[i].back().is_some_and(|(t, _)| *t >= at));
            if !(complete || end || now_s - at > LONGEST_WAIT_S) {
                return;
            }
            if let Some(first) = self.waiting.pop_front() {
                self.row(&first);
            }
        }
    }

    /// Force along the cell's axis at a time, N, and the distance to the nearest sample, s.
    fn cell_at(&self, unit: usize, at: f64) -> Option<(f64, f64)> {
        let list = &self.samples[unit];
        let after = list.partition_point(|(t, _)| *t < at);
        let (t1, f1) = *list.get(after)?;
        let (t0, f0) = *list.get(after.checked_sub(1)?)?;
        if t1 - t0 > LONGEST_GAP_S {
            return None;
        }
        let part = (at - t0) / (t1 - t0).max(1e-9);
        Some((f0 + (f1 - f0) * part, (at - t0).min(t1 - at)))
    }

    /// Tensions at a tip and time, N; the force that they apply, N; the largest age, s.
    fn forces(&self, tip_m: Vector3<f64>, at: f64) -> Option<([f64; UNITS], Vector3<f64>, f64)> {
        let enabled = self.rig.units.map(|unit| unit.enabled);
        let cables = Cables::at(&self.rig, tip_m, &enabled).ok()?;
        let mut tension_n = [0.0; UNITS];
        let mut age_s = 0.0_f64;
        for unit in (0..UNITS).filter(|unit| enabled[*unit]) {
            let (cell_n, distance_s) = self.cell_at(unit, at)?;
            tension_n[unit] = cell_n * f64::from(cables.inv_cos_q16[unit]) / 65_536.0;
            age_s = age_s.max(distance_s);
        }
        let force_n = problem(&self.rig, &cables, &enabled).force_of(&tension_n);
        for (tension, enabled) in tension_n.iter_mut().zip(enabled) {
            if !enabled {
                *tension = f64::NAN;
            }
        }
        Some((tension_n, force_n, age_s))
    }

    fn row(&mut self, waiting: &Waiting) {
        let state = &waiting.state;
        let joints = state.joints.as_ref();
        let three = |list: Option<&Vec<f64>>| -> [f64; JOINTS] {
            core::array::from_fn(|i| list.and_then(|l| l.get(i)).copied().unwrap_or(f64::NAN))
        };
        let tip_m = state.tip.as_ref().map(|tip| tip.position_m);
        let found = tip_m.and_then(|tip| self.forces(tip.into(), waiting.board_s));
        let (tension_n, force_n, age_s) =
            found.unwrap_or(([f64::NAN; UNITS], Vector3::repeat(f64::NAN), f64::NAN));
        let t_s = waiting.board_s - self.start_s;
        let mut row = Vec::with_capacity(COLUMNS.len());
        row.extend([t_s, waiting.board_s, state.stamp.t_ns as f64 * 1e-9]);
        row.extend(three(joints.map(|j| &j.position)));
        row.extend(three(joints.and_then(|j| j.velocity.as_ref())));
        row.extend(three(
            joints.and_then(|j| j.effort.as_ref().map(|e| &e.value)),
        ));
        row.extend(three(joints.and_then(|j| j.setpoint.as_ref())));
        row.extend(tip_m.unwrap_or([f64::NAN; 3]));
        row.extend(force_n.iter());
        row.extend(waiting.commanded_n.iter());
        row.extend(tension_n);
        row.extend([age_s, waiting.sync_error_s]);
        row.push(state.tip.as_ref().map_or(f64::NAN, |tip| {
            let tip_ns = tip.stamp_ns.unwrap_or(state.stamp.t_ns);
            state.stamp.t_ns.saturating_sub(tip_ns) as f64 * 1e-9
        }));
        let enabled = self.rig.units.map(|unit| unit.enabled);
        let radius_n = found.and(tip_m).and_then(|tip| {
            let known = self.known.as_ref()?;
            known.radius_95_n(
                &tip.into(),
                &tension_n.map(|t| if t.is_nan() { 0.0 } else { t }),
                &enabled,
            )
        });
        row.push(radius_n.unwrap_or(f64::NAN));
        row.push(f64::from(u8::from(waiting.saturated)));
        row.push(
            state
                .operating
                .map_or(f64::NAN, |o| f64::from(o.state as u8)),
        );
        self.has_joints |= joints.is_some();
        let complete = found.is_some() && joints.is_some() == self.has_joints;
        row.push(f64::from(u8::from(complete)));
        row.extend([self.trial as f64, f64::from(self.attempt)]);
        self.rows.push(&row);
        let mut truth = vec![t_s];
        match &waiting.truth {
            Some(values) => truth.extend(values),
            None => truth.resize(TRUTH_COLUMNS.len(), f64::NAN),
        }
        self.truth.push(&truth);
        self.worst.force_age_s = self.worst.force_age_s.max(age_s);
        self.worst.sync_error_s = self.worst.sync_error_s.max(waiting.sync_error_s);
        self.worst.incomplete += u64::from(!complete);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot::state::{Clock, Frame, Stamp, TipState};
    use wire::message::{CellCorrection, Sample};

    fn state(rig: &Rig, at_s: f64) -> Waiting {
        Waiting {
            state: RobotState {
                publisher: "test".into(),
                sequence: None,
                stamp: Stamp {
                    clock: Clock::Virtual,
                    t_ns: (at_s * 1e9) as i64,
                },
                received: None,
                joints: None,
                tip: Some(TipState {
                    frame: Frame::Rig,
                    frame_id: "".into(),
                    stamp_ns: None,
                    position_m: rig.workspace.center_m.into(),
                    orientation_xyzw: None,
                    velocity_m_per_s: None,
                    angular_velocity_rad_per_s: None,
                }),
                force: None,
                operating: None,
            },
            board_s: at_s,
            sync_error_s: 1e-6,
            commanded_n: Vector3::zeros(),
            saturated: false,
            truth: None,
        }
    }

    fn sample(unit: u8, t_s: f64, cell_n: f64) -> TimedSample {
        TimedSample {
            t_us: (t_s * 1e6).round() as u64,
            sample: Sample {
                unit,
                adc_code: (cell_n / 6.85e-6).round() as i32,
                ..Sample::default()
            },
        }
    }

    #[test]
    fn tensions_are_interpolated_at_the_time_of_the_state_and_the_filter_s_delay_is_taken_off() {
        let rig = Rig::built_in().unwrap();
        let configs = rig.units.map(|unit| unit.to_wire());
        let mut joiner = Joiner::new(&rig, &configs, 1.0, 4, 1);
        // Each cell's force rises by its number of N per second; units are sampled one after
        // another.
        for n in 0..400 {
            for unit in 0..UNITS as u8 {
                let t = f64::from(n) * 0.003_125 + f64::from(unit) * 4e-4;
                let true_at = t - CELL_DELAY_S;
                joiner.samples(&[sample(unit, t, 2.0 + f64::from(unit + 1) * true_at)]);
            }
        }
        let mut waiting = state(&rig, 1.1);
        waiting.state.tip.as_mut().unwrap().stamp_ns = Some(1_088_000_000);
        joiner.state(waiting);
        joiner.join(1.2, false);
        assert!((joiner.rows.column("tip_age_s").unwrap()[0] - 0.012).abs() < 1e-12);
        assert_eq!(joiner.rows.rows(), 1);
        let get = |name: &str| joiner.rows.column(name).unwrap()[0];
        assert!((get("t_s") - 0.1).abs() < 1e-12);
        for (i, unit) in rig.units.iter().enumerate() {
            let (_, cosine) = unit.cable_at(rig.workspace.center_m).unwrap();
            let wanted = (2.0 + (i + 1) as f64 * 1.1) / cosine;
            let found = get(&format!("tension_{}_n", i + 1));
            assert!((found - wanted).abs() < 2e-4, "{found} {wanted}");
        }
        assert!(get("force_age_s") <= 0.5 * 0.003_125 + 1e-6);
        assert_eq!((get("quality"), get("trial")), (1.0, 4.0));
        assert!(get("joint_position_1").is_nan());
        assert!(get("force_95_n").is_nan());
    }

    /// The cells' curve and creep, which the board takes out, are not in the labels either.
    #[test]
    fn forces_are_those_of_the_board_s_conversion() {
        let rig = Rig::built_in().unwrap();
        let mut configs = rig.units.map(|unit| unit.to_wire());
        for config in &mut configs {
            config.cell = CellCorrection {
                curve_nn_per_n2: 5_000_000,
                creep_q16: 6_554,
                creep_ms: 1_000,
            };
        }
        let mut joiner = Joiner::new(&rig, &configs, 0.0, 1, 1);
        // 4 N from 0.5 s on: a cell reads 10 % more after some seconds, and is curved by 2 %.
        let load_n = |t: f64| if t < 0.5 { 0.0f64 } else { 4.0 };
        let mut crept_n = 0.0f64;
        for n in 0..1_300 {
            let t = f64::from(n) * 0.003_125;
            crept_n += (0.1 * load_n(t) - crept_n) * 0.003_125;
            let reading_n = load_n(t) + crept_n;
            let straight_n = ((1.0 + 4.0 * 5e-3 * reading_n).sqrt() - 1.0) / (2.0 * 5e-3);
            for unit in 0..UNITS as u8 {
                joiner.samples(&[sample(unit, t, straight_n)]);
            }
            if n % 320 == 310 {
                joiner.state(state(&rig, t - 0.1));
                joiner.join(t, false);
            }
        }
        assert_eq!(joiner.rows.rows(), 4);
        for (i, unit) in rig.units.iter().enumerate() {
            let (_, cosine) = unit.cable_at(rig.workspace.center_m).unwrap();
            let found = joiner.rows.column(&format!("tension_{}_n", i + 1)).unwrap();
            for tension_n in found {
                assert!((tension_n * cosine - 4.0).abs() < 3e-3, "{found:?}");
            }
        }
    }

    #[test]
    fn a_label_has_the_radius_of_its_calibration() {
        let mut rig = Rig::built_in().unwrap();
        let record = known::base::nominal(&rig, "2026-11-22");
        rig.calibration = Some(Box::new(record));
        let configs = rig.units.map(|unit| unit.to_wire());
        let mut joiner = Joiner::new(&rig, &configs, 0.0, 1, 1);
        for n in 0..100 {
            for unit in 0..UNITS as u8 {
                joiner.samples(&[sample(unit, f64::from(n) * 0.003_125, 2.0)]);
            }
        }
        joiner.state(state(&rig, 0.2));
        joiner.state(state(&rig, 0.9));
        joiner.join(1.0, true);
        let radii = joiner.rows.column("force_95_n").unwrap();
        // Nominal gains of 5 %, exit points of 5 mm: 2 N of each cable.
        assert!((0.2..1.5).contains(&radii[0]), "{radii:?}");
        assert!(radii[1].is_nan(), "a row without force has none");
    }

    #[test]
    fn a_gap_of_samples_gives_a_row_without_force_and_none_is_lost() {
        let rig = Rig::built_in().unwrap();
        let configs = rig.units.map(|unit| unit.to_wire());
        let mut joiner = Joiner::new(&rig, &configs, 0.0, 1, 1);
        for n in (0..100).chain(140..160) {
            for unit in 0..UNITS as u8 {
                joiner.samples(&[sample(unit, f64::from(n) * 0.003_125, 2.0)]);
            }
        }
        for at in [0.2, 0.36, 0.45, 0.6] {
            joiner.state(state(&rig, at));
        }
        joiner.join(0.5, false);
        // The last one still waits for its samples.
        assert_eq!(joiner.rows.rows(), 3);
        joiner.join(0.6, true);
        assert_eq!(joiner.rows.column("quality").unwrap(), [1.0, 0.0, 1.0, 0.0]);
        assert_eq!(joiner.worst.incomplete, 2);
        assert!(joiner.rows.column("force_y_n").unwrap()[1].is_nan());
    }
}
