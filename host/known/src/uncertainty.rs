//! How well the force at the tip is known, from the calibration in force: for the table of a run
//! and for its recording.
//!
//! Three quantities have three uncertainties, each a radius of a ball that holds the true force
//! with 95 %:
//!
//! | quantity | ball about | beside the calibration and the pose |
//! | --- | --- | --- |
//! | mean of the run | the mean of what the load cells say | how the means of parts of the run scatter, over the root of their number |
//! | any instant | the commanded force | how far the cells' estimate is from the command |
//! | the estimate of a cycle | the cells' estimate in this cycle | how much the estimate changes while it grows old |
//!
//! The converter's filter, the board's and the control cycle make an estimate one to two cycles
//! old. It is of one moment, because it takes the tensions along the cables of a cycle ago
//! ([`force::controller::Output::applied_n`]). Along those of the newest pose it is off in
//! proportion to the tip's speed, which a mean over a few seconds keeps. What changes within its
//! age is seen in the run itself. The cells also read the vibration of the motors that hang on
//! them, which is no force of the cables. A mean of two cycles is free of a part of it: the second
//! radius is made of such means, the third of both. `host-cli/tests/coverage.rs` measures how often
//! each radius holds.
//!
//! Left out: friction between load cell and tip.

use calibration::record::{GainRecord, Record};
use calibration::uncertainty::{self, Geometry, TipForce, UnitInput};
use force::metrics::{Step, STEADY_AFTER_S};
use force::thinned::Thinned;
use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};
use serde::Serialize;
use wire::UNITS;

use super::base::{conversion, BOARD_ZERO_SD_N};

/// Uncertainty of the force at the tip. All of it one standard deviation, unless it says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceUncertainty {
    /// Hash of the calibration.
    pub calibration: String,
    /// Its date.
    pub date: String,
    /// Of the size of the mean force, N.
    pub size_sd_n: f64,
    /// Of its direction, degrees; `None` for no force.
    pub direction_sd_deg: Option<f64>,
    /// Radius of the ball about the mean that the load cells say, which holds the true mean force
    /// of the run with 95 %, N.
    pub radius_95_n: f64,
    /// Radius of the ball about the commanded force that holds the true force at any instant with
    /// 95 %, N.
    pub instant_95_n: f64,
    /// Radius of the ball about the load cells' estimate in one cycle that holds the true force
    /// with 95 %, N.
    pub estimate_95_n: f64,
    /// Standard deviation of a coordinate of the tip that was assumed, m.
    pub pose_sd_m: f64,
    /// The largest parts by source, N, in their worst direction.
    pub parts_n: PartsN,
    /// What was not measured and is nominal, in words.
    pub nominal: Vec<String>,
}

/// Standard deviations of the force in the worst direction by source, N.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PartsN {
    /// Gains.
    pub gains: f64,
    /// Zeros, and the hysteresis of the cells.
    pub zeros: f64,
    /// Exit points and axes.
    pub geometry: f64,
    /// The robot's pose.
    pub pose: f64,
    /// How the tensions are held: standard error of the run's mean by the means of its parts.
    pub held: f64,
}

/// A 95 % quantile of sizes that come one after the other.
#[derive(Debug, Clone)]
struct Sizes(Thinned<f64>);

/// Sizes that are kept for a quantile: its standard error is then below 0.5 % in probability.
const KEPT: usize = 4096;

impl Default for Sizes {
    fn default() -> Self {
        Self(Thinned::new(KEPT))
    }
}

impl Sizes {
    fn add(&mut self, size: f64) {
        self.0.push(size);
    }

    fn quantile_95(&self) -> f64 {
        let mut sorted = self.0.kept().to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = (0.95 * sorted.len() as f64) as usize;
        sorted.get(at).or(sorted.last()).copied().unwrap_or(0.0)
    }
}

/// The newest estimates of the force, for what an estimate changes while it grows old.
#[derive(Debug, Clone, Default)]
struct Newest([Option<Vector3<f64>>; 3]);

impl Newest {
    /// Adds an estimate, and gives sizes of changes, N: from the estimate before, and from a mean
    /// of two cycles to the next. Means are two cycles apart, as old as an estimate is at most:
    /// 6.25 ms of the converter's filter and 3 to 6 ms of the board's, and up to a cycle until the
    /// host has read it. The cells' vibration is twice in a change of single estimates, and less
    /// than once in that of means, which take a part of it out: alone they held in 97.0 and in
    /// 88.7 % of the cases (`host-cli/tests/coverage.rs`).
    fn changes_n(&mut self, estimated_n: Vector3<f64>) -> [Option<f64>; 2] {
        let [last, second, third] = self.0;
        self.0 = [Some(estimated_n), last, second];
        let of_one = last.map(|last| (estimated_n - last).norm());
        let of_means = (last.zip(second).zip(third))
            .map(|((last, second), third)| 0.5 * (estimated_n + last - second - third).norm());
        [of_one, of_means]
    }
}

/// Means over parts of a run, for the variance of the run's mean. How they scatter holds what the
/// cycles share: vibration of the motors and the age of an estimate cancel within a part, a slow
/// change does not.
#[derive(Debug, Clone)]
struct Batches {
    /// Sums over whole parts, N.
    sums: Vec<Vector3<f64>>,
    /// Cycles of a part.
    length: u64,
    sum: Vector3<f64>,
    in_sum: u64,
}

/// Cycles of a part at first: 0.2 s, ten times the age of an estimate.
const BATCH: u64 = 20;
/// Whole parts that are kept; then each two become one.
const MOST_BATCHES: usize = 64;

impl Default for Batches {
    fn default() -> Self {
        Self {
            sums: Vec::new(),
            length: BATCH,
            sum: Vector3::zeros(),
            in_sum: 0,
        }
    }
}

impl Batches {
    fn add(&mut self, force_n: Vector3<f64>) {
        self.sum += force_n;
        self.in_sum += 1;
        if self.in_sum < self.length {
            return;
        }
        self.sums.push(std::mem::take(&mut self.sum));
        self.in_sum = 0;
        if self.sums.len() == MOST_BATCHES {
            self.sums = self.sums.chunks(2).map(|two| two[0] + two[1]).collect();
            self.length *= 2;
        }
    }

    /// Variance of the mean over all parts in one of three directions, N^2; 0 with fewer than two
    /// parts.
    fn mean_variance_n2(&self) -> f64 {
        let count = self.sums.len() as f64;
        if count < 2.0 {
            return 0.0;
        }
        let mean = self.sums.iter().sum::<Vector3<f64>>() / count;
        let squares: f64 = self.sums.iter().map(|s| (s - mean).norm_squared()).sum();
        squares / (self.length as f64).powi(2) / 3.0 / (count - 1.0) / count
    }
}

/// What a run held while steady, added up cycle by cycle.
#[derive(Debug, Clone, Default)]
pub struct Steady {
    count: u64,
    tip_m: Vector3<f64>,
    tension_n: [f64; UNITS],
    available: [bool; UNITS],
    newest: Newest,
    /// How far the estimate of the cycle before was from the command.
    off_before_n: Option<Vector3<f64>>,
    off_command_n: Sizes,
    change_n: Sizes,
    batches: Batches,
}

impl Steady {
    /// Adds a cycle; those before the run is steady do not count.
    pub fn add(&mut self, step: &Step) {
        if step.t_s < STEADY_AFTER_S {
            return;
        }
        self.count += 1;
        self.tip_m += step.tip_m;
        self.available = step.available;
        for i in 0..UNITS {
            self.tension_n[i] += step.measured_tension_n[i];
        }
        let off_command_n = step.estimated_n - step.commanded_n;
        if let Some(before_n) = self.off_before_n.replace(off_command_n) {
            (self.off_command_n).add((0.5 * (off_command_n + before_n)).norm());
        }
        for change_n in self
            .newest
            .changes_n(step.estimated_n)
            .into_iter()
            .flatten()
        {
            self.change_n.add(change_n);
        }
        self.batches.add(off_command_n);
    }

    /// Uncertainty of the force. `pose_sd_m`: standard deviation of a coordinate of the tip, m.
    /// `None` without a steady cycle or where a cable stands across its cell.
    #[must_use]
    pub fn uncertainty(&self, record: &Record, pose_sd_m: f64) -> Option<ForceUncertainty> {
        if self.count == 0 {
            return None;
        }
        let count = self.count as f64;
        let mut found = stated(
            record,
            &(self.tip_m / count),
            &self.tension_n.map(|sum| sum / count),
            &self.available,
            pose_sd_m,
            self.batches.mean_variance_n2(),
        )?;
        let systematic_n = found.instant_95_n;
        found.instant_95_n = systematic_n.hypot(self.off_command_n.quantile_95());
        found.estimate_95_n = systematic_n.hypot(self.change_n.quantile_95());
        Some(found)
    }
}

/// Uncertainty of the force that a run held while steady; see [`Steady::uncertainty`].
#[must_use]
pub fn of_run(record: &Record, steps: &[Step], pose_sd_m: f64) -> Option<ForceUncertainty> {
    let mut steady = Steady::default();
    steps.iter().for_each(|step| steady.add(step));
    steady.uncertainty(record, pose_sd_m)
}

/// Radius of the ball about the cells' estimate that holds the force with 95 %, cycle by cycle: for
/// a column beside the estimate. What the estimate does while it grows old is taken from the last 5
/// s.
#[derive(Debug, Clone)]
pub struct Running {
    known: Known,
    newest: Newest,
    changes_n: std::collections::VecDeque<f64>,
    /// Radius of what calibration and pose leave, N, and how many cycles ago it was computed.
    systematic: Option<(f64, usize)>,
}

/// Changes of an estimate that are kept: 5 s of cycles.
const SEEN_CHANGES: usize = 2 * 500;
/// Cycles for which a radius of calibration and pose holds, 0.1 s: the tip moves by about 1 mm
/// meanwhile.
const HOLDS_CYCLES: usize = 10;

impl Running {
    /// With a calibration; `pose_sd_m` as for [`Steady::uncertainty`].
    #[must_use]
    pub fn new(record: &Record, pose_sd_m: f64) -> Self {
        Self {
            known: Known::of(record, pose_sd_m),
            newest: Newest::default(),
            changes_n: std::collections::VecDeque::new(),
            systematic: None,
        }
    }

    /// Radius for this cycle, N. `None` in the first cycles, and where a cable stands across its
    /// cell.
    pub fn radius_95_n(&mut self, step: &Step) -> Option<f64> {
        for change_n in self
            .newest
            .changes_n(step.estimated_n)
            .into_iter()
            .flatten()
        {
            if self.changes_n.len() == SEEN_CHANGES {
                self.changes_n.pop_front();
            }
            self.changes_n.push_back(change_n);
        }
        let systematic_n = match self.systematic {
            Some((radius_n, age)) if age < HOLDS_CYCLES => {
                self.systematic = Some((radius_n, age + 1));
                radius_n
            }
            _ => {
                let found =
                    (self.known).force(&step.tip_m, &step.measured_tension_n, &step.available)?;
                let radius_n = found.radius_95_n();
                self.systematic = Some((radius_n, 1));
                radius_n
            }
        };
        // A quantile of fewer would be any value.
        if self.changes_n.len() < 2 * 20 {
            return None;
        }
        let mut sizes: Vec<f64> = self.changes_n.iter().copied().collect();
        let at = (0.95 * sizes.len() as f64) as usize;
        let (_, change_n, _) = sizes.select_nth_unstable_by(at, f64::total_cmp);
        Some(systematic_n.hypot(*change_n))
    }
}

/// Radius of the ball of what calibration and pose leave of a force, at one tip after the other:
/// for labels whose age is taken off.
#[derive(Debug, Clone)]
pub struct Systematic(Known);

impl Systematic {
    /// With a calibration; `pose_sd_m` as for [`Steady::uncertainty`].
    #[must_use]
    pub fn new(record: &Record, pose_sd_m: f64) -> Self {
        Self(Known::of(record, pose_sd_m))
    }

    /// Radius for these tensions, N, at a tip, m, in N. `None` where a cable stands across its
    /// cell.
    #[must_use]
    pub fn radius_95_n(
        &self,
        tip_m: &Vector3<f64>,
        tension_n: &[f64; UNITS],
        available: &[bool; UNITS],
    ) -> Option<f64> {
        Some(self.0.force(tip_m, tension_n, available)?.radius_95_n())
    }
}

/// What a calibration says of the units, ready for one tip after the other.
#[derive(Debug, Clone)]
struct Known {
    units: Vec<UnitInput>,
    covariance: DMatrix<f64>,
    common_gain_relative_sd: f64,
    pose_sd_m: f64,
}

impl Known {
    fn of(record: &Record, pose_sd_m: f64) -> Self {
        let units = record.units.iter().take(UNITS).map(|unit| {
            let cell_zero = unit.n_per_code.abs() * unit.zero_sd_codes;
            UnitInput {
                exit_m: unit.exit_m.into(),
                axis: unit.axis.into(),
                tension_n: 0.0,
                gain_relative_sd: (unit.n_per_code_sd / unit.n_per_code.abs())
                    .hypot(conversion(unit).left_relative_sd),
                // Where the cell is in the loop of its hysteresis, nobody knows.
                zero_sd_n: (cell_zero.max(BOARD_ZERO_SD_N))
                    .hypot(unit.gain.as_ref().map_or(0.0, GainRecord::hysteresis_sd_n)),
                held_sd_n: 0.0,
            }
        });
        Self {
            units: units.collect(),
            covariance: record.geometry_covariance(),
            common_gain_relative_sd: record.common_gain_relative_sd,
            pose_sd_m,
        }
    }

    /// Force of these tensions, N, at a tip, m.
    fn force(
        &self,
        tip_m: &Vector3<f64>,
        tension_n: &[f64; UNITS],
        available: &[bool; UNITS],
    ) -> Option<TipForce> {
        let mut units = self.units.clone();
        for (i, unit) in units.iter_mut().enumerate() {
            let on = if available[i] { 1.0 } else { 0.0 };
            unit.tension_n = on * tension_n[i];
            unit.zero_sd_n *= on;
        }
        let geometry = Geometry {
            covariance: self.covariance.clone(),
            tip_covariance_m2: Matrix3::identity() * self.pose_sd_m.powi(2),
        };
        uncertainty::tip_force(&units, tip_m, &geometry, self.common_gain_relative_sd).ok()
    }
}

/// Uncertainty of the force of these tensions, N, at a tip, m. The force is taken as constant: all
/// three quantities have one radius.
#[must_use]
pub fn of_tensions(
    record: &Record,
    tip_m: &Vector3<f64>,
    tension_n: &[f64; UNITS],
    available: &[bool; UNITS],
    pose_sd_m: f64,
) -> Option<ForceUncertainty> {
    stated(record, tip_m, tension_n, available, pose_sd_m, 0.0)
}

/// The same with a variance of the mean in every direction, N^2. The radii of instant and estimate
/// are without it.
fn stated(
    record: &Record,
    tip_m: &Vector3<f64>,
    tension_n: &[f64; UNITS],
    available: &[bool; UNITS],
    pose_sd_m: f64,
    mean_n2: f64,
) -> Option<ForceUncertainty> {
    let mut nominal = Vec::new();
    for (unit, _) in record.units.iter().zip(available).filter(|(_, on)| **on) {
        let missing = [
            (unit.gain_date.is_empty(), "gain"),
            (unit.geometry_date.is_empty(), "geometry"),
        ];
        nominal.extend(
            missing
                .iter()
                .filter(|(missing, _)| *missing)
                .map(|(_, what)| format!("{what} of unit {}", unit.number)),
        );
    }
    let mut found = Known::of(record, pose_sd_m).force(tip_m, tension_n, available)?;
    let systematic_n = found.radius_95_n();
    found.covariance_n2 += Matrix3::identity() * mean_n2;
    let worst = |m: &Matrix3<f64>| SymmetricEigen::new(*m).eigenvalues.max().max(0.0).sqrt();
    Some(ForceUncertainty {
        calibration: record.content_hash(),
        date: record.date.clone(),
        size_sd_n: found.size_sd_n(),
        direction_sd_deg: found.direction_sd_rad().map(f64::to_degrees),
        radius_95_n: found.radius_95_n(),
        instant_95_n: systematic_n,
        estimate_95_n: systematic_n,
        pose_sd_m,
        parts_n: PartsN {
            gains: worst(&(found.parts.gains + found.parts.common_gain)),
            zeros: worst(&found.parts.zeros),
            geometry: worst(&found.parts.geometry),
            pose: worst(&found.parts.tip),
            held: mean_n2.sqrt(),
        },
        nominal,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base;
    use rig::Rig;

    #[test]
    fn a_measured_rig_is_known_better_than_a_nominal_one() {
        let rig = Rig::built_in().unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        let tip = rig.workspace.center_m;
        let at = |record: &Record, pose_sd_m: f64| {
            of_tensions(
                record,
                &tip,
                &[5.0, 2.0, 2.0, 2.0, 2.0, 2.0],
                &[true; 6],
                pose_sd_m,
            )
            .unwrap()
        };
        let before = at(&record, 0.0);
        assert_eq!(before.nominal.len(), 12);
        for unit in &mut record.units {
            unit.gain_date = "2026-11-22".to_owned();
            unit.geometry_date = "2026-11-22".to_owned();
            unit.n_per_code_sd = 3e-4 * unit.n_per_code;
            let small = unit.covariance_matrix() * 0.0025;
            unit.set_covariance(&small);
        }
        let after = at(&record, 0.0);
        assert!(after.nominal.is_empty());
        assert!(
            after.radius_95_n < 0.1 * before.radius_95_n,
            "{before:?} {after:?}"
        );
        // 5 % of 5 N along one cable: the gains lead before.
        assert!((0.2..0.4).contains(&before.parts_n.gains), "{before:?}");
        assert!(after.size_sd_n <= after.radius_95_n);
        assert!(after.direction_sd_deg.unwrap() > 0.0);
        assert_eq!(of_run(&record, &[], 0.0), None);
        // The pose is a part of its own: 5 N at 0.3 to 0.4 m, 1 mm across.
        let moved = at(&record, 1e-3);
        assert!((0.01..0.05).contains(&moved.parts_n.pose), "{moved:?}");
        assert!(moved.radius_95_n > after.radius_95_n.hypot(2.0 * moved.parts_n.pose));
    }

    fn step(k: usize, estimated_n: Vector3<f64>) -> Step {
        let rig = Rig::built_in().unwrap();
        Step {
            t_s: STEADY_AFTER_S + 0.01 * k as f64,
            tip_m: rig.workspace.center_m,
            commanded_n: Vector3::zeros(),
            estimated_n,
            applied_n: None,
            tension_setpoint_n: [3.0; UNITS],
            measured_tension_n: [3.0; UNITS],
            true_tension_n: None,
            available: [true; UNITS],
        }
    }

    #[test]
    fn what_changes_within_the_age_of_an_estimate_is_in_its_radius() {
        let rig = Rig::built_in().unwrap();
        let record = base::nominal(&rig, "2026-11-22");
        // 0.4 N up and down: slowly, and so fast that an estimate that is two cycles old says
        // nothing.
        let of = |period: f64| {
            let steps: Vec<Step> = (0..2000)
                .map(|k| {
                    let phase = std::f64::consts::TAU * k as f64 / period;
                    step(k, Vector3::new(0.4 * phase.sin(), 0.0, 0.0))
                })
                .collect();
            let mut running = Running::new(&record, 0.0);
            let columns: Vec<Option<f64>> = steps.iter().map(|s| running.radius_95_n(s)).collect();
            assert_eq!(columns[10], None);
            let last = columns.last().copied().flatten().unwrap();
            (of_run(&record, &steps, 0.0).unwrap(), last)
        };
        let (slow, slow_last) = of(1000.0);
        let (fast, fast_last) = of(4.05);
        let rig_tip = step(0, Vector3::zeros()).tip_m;
        let of_calibration =
            of_tensions(&record, &rig_tip, &[3.0; UNITS], &[true; UNITS], 0.0).unwrap();
        let calibration = of_calibration.radius_95_n;
        // Two whole periods are not steady: parts of 0.4 s have means of +-0.4 N along one of three
        // directions. A part of a fast one has a mean of 0.
        assert!((0.015..0.03).contains(&slow.parts_n.held), "{slow:?}");
        assert!(fast.parts_n.held < 0.002, "{fast:?}");
        // The 95 % quantile of a slow sine is 0.997 of its amplitude; the mean of two cycles leaves
        // cos(pi/4.05) of the fast one.
        for (found, most) in [(&slow, 1.0), (&fast, 0.714)] {
            let off = (found.instant_95_n.powi(2) - calibration.powi(2)).sqrt();
            assert!((off / 0.4 - most).abs() < 0.02, "{found:?}");
        }
        assert!(slow.estimate_95_n < calibration.hypot(0.01), "{slow:?}");
        let change = (fast.estimate_95_n.powi(2) - calibration.powi(2)).sqrt();
        // From one cycle to the next 0.8 sin(pi/4.05) = 0.56 N at most; from a mean of two to the
        // next 0.8 cos(pi/4.05) sin(2 pi/4.05) = 0.57 N.
        assert!((0.55..0.572).contains(&change), "{fast:?}");
        assert!((slow_last / slow.estimate_95_n - 1.0).abs() < 0.01);
        assert!((fast_last / fast.estimate_95_n - 1.0).abs() < 0.01);
    }

    /// Against the variance of the means of many runs: independent cycles, cycles that cancel,
    /// cycles that hang together.
    #[test]
    fn the_variance_of_a_mean_is_that_of_many_runs() {
        const CYCLES: usize = 3000;
        const RUNS: usize = 400;
        let mut random = random::SplitMix64::stream(5, "means", 0);
        let mut noise = || Vector3::from_fn(|_, _| random.normal());
        for (name, moving, keeps) in [
            ("white", 0.0, 0.0),
            ("cancels", 1.0, 0.0),
            ("slow", 0.0, 0.9),
        ] {
            let (mut squares, mut stated) = (0.0, 0.0);
            for _ in 0..RUNS {
                let mut batches = Batches::default();
                let (mut sum, mut before, mut held) = (Vector3::zeros(), noise(), Vector3::zeros());
                for _ in 0..CYCLES {
                    let new = noise();
                    held = held * keeps + new - before * moving;
                    before = new;
                    batches.add(held);
                    sum += held;
                }
                squares += (sum / CYCLES as f64).norm_squared() / 3.0 / RUNS as f64;
                stated += batches.mean_variance_n2() / RUNS as f64;
            }
            let ratio = (stated / squares).sqrt();
            // What cancels does so within a part: its two ends are left, so many times as there are
            // parts.
            let range = if moving > 0.0 { 1.0..9.0 } else { 0.85..1.15 };
            assert!(range.contains(&ratio), "{name}: {ratio}");
        }
        assert_eq!(Batches::default().mean_variance_n2(), 0.0);
    }

    #[test]
    fn a_quantile_of_a_long_run_needs_little_memory() {
        let mut sizes = Sizes::default();
        for i in 0..1_000_003_u64 {
            sizes.add((i % 1000) as f64);
        }
        assert!(sizes.0.kept().len() <= KEPT);
        assert!((sizes.quantile_95() - 950.0).abs() < 15.0);
        assert_eq!(Sizes::default().quantile_95(), 0.0);
    }
}
