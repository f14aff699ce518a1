//! A run with the robot moving: samples for the self-calibration, and how well the stored geometry
//! predicts them.

use super::{CalibrateError, Result};
use calibration::geometry::UnitGeometry;
use calibration::record::Record;
use calibration::self_calibration::{
    self, exit_point, fuse, moved, ExitEstimate, Moved, Prior, Sample,
};
use force::metrics::Step;
use nalgebra::{Matrix3, Vector3};
use rig::Rig;
use run::{Observer, Phase};
use session::Received;
use wire::message::{BoardInfo, UnitConfig};
use wire::UNITS;

/// Watches a run for another observer, and keeps what a self-calibration needs.
pub struct Collector<'o> {
    inner: &'o mut dyn Observer,
    travel_m_per_count: [f64; UNITS],
    newest: [Option<i32>; UNITS],
    /// What the user is told when the force has been commanded for so long, s.
    pub notice: Option<(f64, &'static str)>,
    /// Samples of each unit, one for each control cycle.
    pub samples: [Vec<Sample>; UNITS],
}

impl<'o> Collector<'o> {
    /// A collector for a rig; everything goes on to `inner`.
    pub fn new(rig: &Rig, inner: &'o mut dyn Observer) -> Self {
        Self {
            inner,
            travel_m_per_count: rig.units.map(|unit| unit.travel_m_per_count),
            newest: [None; UNITS],
            notice: None,
            samples: std::array::from_fn(|_| Vec::new()),
        }
    }
}

impl Observer for Collector<'_> {
    fn progress(&mut self, phase: Phase, fraction: f64) {
        self.inner.progress(phase, fraction);
    }

    fn notice(&mut self, text: &str) {
        self.inner.notice(text);
    }

    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        self.inner.configured(configs);
    }

    fn connected(&mut self, board: &BoardInfo) {
        self.inner.connected(board);
    }

    fn received(&mut self, received: &Received) {
        for timed in &received.samples {
            if let Some(newest) = self.newest.get_mut(usize::from(timed.sample.unit)) {
                *newest = Some(timed.sample.encoder_counts);
            }
        }
        self.inner.received(received);
    }

    fn step(&mut self, step: &Step) {
        if let Some((_, text)) = self.notice.take_if(|(at_s, _)| step.t_s >= *at_s) {
            self.inner.notice(text);
        }
        // A run reports the samples of a cycle before the cycle. Before the force is commanded the
        // cables are tensioned: the reels turn without the tip.
        if step.t_s >= 0.0 {
            for i in 0..UNITS {
                let Some(counts) = self.newest[i].filter(|_| step.available[i]) else {
                    continue;
                };
                self.samples[i].push(Sample {
                    tip_m: step.tip_m,
                    // Winding in counts up; paid out is positive here.
                    travel_m: -f64::from(counts) * self.travel_m_per_count[i],
                    tension_n: step.measured_tension_n[i],
                });
            }
        }
        self.inner.step(step);
    }
}

/// What a run says of one unit.
#[derive(Debug, Clone)]
pub struct UnitRun {
    /// Unit, from 1.
    pub unit: u8,
    /// Exit point from the run alone.
    pub alone: ExitEstimate,
    /// Joined with the stored one: position (m) and covariance (m^2).
    pub joined: Option<(Vector3<f64>, Matrix3<f64>)>,
}

/// What a run says of the rig.
#[derive(Debug, Clone)]
pub struct Run {
    /// Unit by unit.
    pub units: Vec<UnitRun>,
    /// Units for which the run gives nothing, and why.
    pub not: Vec<(u8, String)>,
    /// Whether the rig stands where the calibration says.
    pub moved: Moved,
}

/// A run tells whether a unit was moved where it knows two directions of the exit point better than
/// this, m. The comparison shows a move from about four standard deviations on ([`MOVED_LEVEL`]):
/// 2 cm, less than a clamp that is put elsewhere.
pub const TOLD_SD_M: f64 = 0.005;

impl Run {
    /// Units of which the run tells too little to say whether they stand where the calibration
    /// says: no exit point at all, or fewer than two directions of it to [`TOLD_SD_M`]. Along its
    /// cable a run tells little of any unit.
    #[must_use]
    pub fn untold(&self) -> Vec<u8> {
        let blind = |unit: &&UnitRun| unit.alone.directions[1].sd_m > TOLD_SD_M;
        let blind = self.units.iter().filter(blind).map(|unit| unit.unit);
        let mut found: Vec<u8> = self.not.iter().map(|(unit, _)| *unit).collect();
        found.extend(blind);
        found.sort_unstable();
        found
    }
}

/// Control cycles from one sample to the next that counts, 0.2 s. Errors of neighbouring cycles are
/// alike (a delay times the speed of the tip), and the estimate takes them as independent.
const EVERY: usize = 20;

/// False alarms of the comparison with the stored geometry: one in so many runs is 1 over this.
pub const MOVED_LEVEL: f64 = 0.001;

/// The run's estimate of each unit, and whether the rig has moved against `record`.
///
/// # Errors
/// No unit gives an estimate.
pub fn evaluate(samples: &[Vec<Sample>; UNITS], record: &Record, prior: &Prior) -> Result<Run> {
    let mut units = Vec::new();
    let mut not = Vec::new();
    let mut stored = Vec::new();
    for (unit, samples) in record.units.iter().zip(samples) {
        let samples: Vec<Sample> = samples.iter().copied().step_by(EVERY).collect();
        if samples.is_empty() {
            continue;
        }
        let covariance = unit.covariance_matrix();
        stored.push(UnitGeometry {
            unit: unit.number,
            exit_m: unit.exit_m.into(),
            axis: unit.axis.into(),
            covariance,
        });
        match exit_point(&samples, prior, Some(unit.exit_m.into())) {
            Ok(alone) => {
                let old: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
                let joined = fuse(
                    (&alone.exit_m, &alone.covariance_m2),
                    (&unit.exit_m.into(), &old),
                );
                units.push(UnitRun {
                    unit: unit.number,
                    alone,
                    joined,
                });
            }
            Err(why) => not.push((unit.number, why.to_string())),
        }
    }
    if units.is_empty() {
        let why: Vec<String> = not
            .iter()
            .map(|(u, why)| format!("unit {u}: {why}"))
            .collect();
        return Err(CalibrateError::refused(if why.is_empty() {
            self_calibration::SelfCalibrationError::TooFew { got: 0 }.to_string()
        } else {
            why.join("\n")
        }));
    }
    let found: Vec<(u8, ExitEstimate)> = units.iter().map(|u| (u.unit, u.alone.clone())).collect();
    Ok(Run {
        moved: moved(&stored, &found, MOVED_LEVEL),
        units,
        not,
    })
}

/// Residual of a unit's cable length over a part of the tip's motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Unit, from 1.
    pub unit: u8,
    /// Which part, `+x` to `-z`: where the tip is furthest from the middle of its motion.
    pub side: &'static str,
    /// Mean of predicted less measured length, m.
    pub residual_m: f64,
    /// Standard deviation to be expected of it, m.
    pub sd_m: f64,
}

/// Residuals of the run's own estimate, unit by unit and side by side of the motion: a side that
/// stands out tells of an error of the robot's pose, a cable that touches, or a reel that is out of
/// round.
#[must_use]
pub fn residuals(samples: &[Vec<Sample>; UNITS], run: &Run, prior: &Prior) -> Vec<Part> {
    const SIDES: [&str; 6] = ["+x", "-x", "+y", "-y", "+z", "-z"];
    let sd_m = prior.travel_sd_m.hypot(prior.tip_sd_m);
    let mut out = Vec::new();
    for found in &run.units {
        let samples = samples.get(usize::from(found.unit) - 1);
        let samples: Vec<&Sample> = samples.into_iter().flatten().step_by(EVERY).collect();
        let count = samples.len().max(1) as f64;
        let middle = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / count;
        let mut sums = [(0.0, 0usize); 6];
        for s in samples {
            let offset = s.tip_m - middle;
            let axis = offset.iamax();
            let side = 2 * axis + usize::from(offset[axis] < 0.0);
            let fit = &found.alone;
            let measured = fit.length_m
                + (1.0 + fit.scale) * s.travel_m
                + fit.compliance_m_per_n * s.tension_n;
            sums[side].0 += (fit.exit_m - s.tip_m).norm() - measured;
            sums[side].1 += 1;
        }
        for (side, (sum, count)) in SIDES.into_iter().zip(sums) {
            if count > 0 {
                out.push(Part {
                    unit: found.unit,
                    side,
                    residual_m: sum / count as f64,
                    sd_m: sd_m / (count as f64).sqrt(),
                });
            }
        }
    }
    out
}

/// Middle of the tip's motion and its standard deviation in the direction of the least motion, m;
/// `None` without samples.
#[must_use]
pub fn motion(samples: &[Vec<Sample>; UNITS]) -> Option<(Vector3<f64>, f64)> {
    let samples = samples.iter().find(|s| !s.is_empty())?;
    let count = samples.len() as f64;
    let middle = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / count;
    let mut scatter = Matrix3::zeros();
    for s in samples {
        let d = s.tip_m - middle;
        scatter += d * d.transpose();
    }
    let least = scatter.symmetric_eigenvalues().min().max(0.0);
    Some((middle, (least / count).sqrt()))
}

/// Puts the joined exit points into the record. The axes stay.
pub fn apply(record: &mut Record, run: &Run) {
    let date = record.date.clone();
    let mut all = record.geometry_covariance();
    let n = record.units.len();
    for found in &run.units {
        let at = record.units.iter().position(|u| u.number == found.unit);
        let (Some(at), Some((exit_m, covariance))) = (at, found.joined) else {
            continue;
        };
        record.units[at].exit_m = exit_m.into();
        record.units[at].geometry_date.clone_from(&date);
        // The run's errors are those of this unit alone; what it shared with others is not known
        // any more.
        for other in (0..n).filter(|other| *other != at) {
            all.view_mut((6 * at, 6 * other), (6, 6)).fill(0.0);
            all.view_mut((6 * other, 6 * at), (6, 6)).fill(0.0);
        }
        all.view_mut((6 * at, 6 * at + 3), (3, 3)).fill(0.0);
        all.view_mut((6 * at + 3, 6 * at), (3, 3)).fill(0.0);
        all.view_mut((6 * at, 6 * at), (3, 3))
            .copy_from(&covariance);
    }
    record.set_geometry_covariance(&all);
}

/// Root mean square difference of measured and predicted cable length with the stored exit point,
/// m; the unknown length at zero travel is taken off. `None` without samples.
#[must_use]
pub fn length_rms_m(samples: &[Sample], exit_m: &Vector3<f64>) -> Option<f64> {
    let differences: Vec<f64> = samples
        .iter()
        .map(|s| (exit_m - s.tip_m).norm() - s.travel_m)
        .collect();
    let count = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / count;
    let square = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
    square.is_finite().then(|| square.sqrt())
}

/// What the length of a cable by the encoder says of the stored geometry, after a run with the
/// robot moving.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthVerdict {
    /// Unit, from 1.
    pub unit: u8,
    /// Root mean square difference to the length by the tip and the stored exit point, m.
    pub rms_m: f64,
    /// What it may be, m; `None`: the tip moved too little to tell.
    pub limit_m: Option<f64>,
}

impl LengthVerdict {
    /// The lengths disagree: exit point, frame, sign or counts per metre are wrong, or the cable is
    /// another unit's.
    #[must_use]
    pub fn disagrees(&self) -> bool {
        self.limit_m.is_some_and(|limit_m| self.rms_m > limit_m)
    }
}

/// Difference that stretch of the cable and the calibration's own errors make, m: 2 N on 5 N/mm are
/// 0.4 mm.
const LENGTH_FLOOR_M: f64 = 5e-4;

/// What errors of the pose may add, in standard deviations of a coordinate: over a run their root
/// mean square is one.
const LENGTH_SDS: f64 = 1.5;

/// Least root mean square distance of the tip from its middle for a verdict, m.
const LEAST_MOTION_M: f64 = 5e-3;

/// Judges the length of a unit's cable; `pose_sd_m` is the standard deviation of a coordinate of
/// the tip. `None` without samples.
#[must_use]
pub fn judge_length(
    unit: u8,
    samples: &[Sample],
    exit_m: &Vector3<f64>,
    pose_sd_m: f64,
) -> Option<LengthVerdict> {
    let rms_m = length_rms_m(samples, exit_m)?;
    let count = samples.len() as f64;
    let middle = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / count;
    let square = samples.iter().map(|s| (s.tip_m - middle).norm_squared());
    let moved_m = (square.sum::<f64>() / count).sqrt();
    Some(LengthVerdict {
        unit,
        rms_m,
        limit_m: (moved_m >= LEAST_MOTION_M).then_some(length_limit_m(pose_sd_m)),
    })
}

/// What the length of a cable may be off, m; `pose_sd_m` is the standard deviation of a coordinate
/// of the tip.
pub(crate) fn length_limit_m(pose_sd_m: f64) -> f64 {
    LENGTH_FLOOR_M + LENGTH_SDS * pose_sd_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::self_calibration::MovedVerdict;
    use known::base;

    /// Samples of a tip on a path within 60 mm, with 0.1 mm of noise on the travel.
    fn run_of(exits: &[Vector3<f64>; UNITS], center: &Vector3<f64>) -> [Vec<Sample>; UNITS] {
        std::array::from_fn(|i| {
            let mut noise = random::SplitMix64::stream(9, "travel", i);
            (0..3000)
                .map(|k| {
                    let t = f64::from(k) * 0.01;
                    let tip_m = center
                        + Vector3::new((1.1 * t).sin(), (1.7 * t).sin(), (2.3 * t).cos()) * 0.06;
                    Sample {
                        tip_m,
                        travel_m: (exits[i] - tip_m).norm() - 0.4 + 1e-4 * noise.normal_within(2.5),
                        tension_n: 3.0,
                    }
                })
                .collect()
        })
    }

    #[test]
    fn a_run_agrees_with_the_truth_and_tells_what_moved() {
        let rig = Rig::built_in().unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        for unit in &mut record.units {
            let small = unit.covariance_matrix() * 0.01;
            unit.set_covariance(&small);
            unit.geometry_date = "2026-11-01".to_owned();
        }
        let mut exits: [Vector3<f64>; UNITS] = rig.units.map(|unit| unit.exit_m);
        let run = evaluate(
            &run_of(&exits, &rig.workspace.center_m),
            &record,
            &Prior::default(),
        )
        .unwrap();
        assert_eq!(run.moved.verdict, MovedVerdict::Unmoved);
        assert!(run.not.is_empty() && run.untold().is_empty());
        // A fifth of the run, in which the tip moves by 3 mm: too little is told.
        let center = rig.workspace.center_m;
        let mut short = run_of(&exits, &center).map(|samples| samples[..600].to_vec());
        for (exit_m, samples) in exits.iter().zip(&mut short) {
            for sample in samples {
                sample.tip_m = center + 0.05 * (sample.tip_m - center);
                sample.travel_m = (exit_m - sample.tip_m).norm() - 0.4;
            }
        }
        let few = evaluate(&short, &record, &Prior::default()).unwrap();
        assert_eq!(few.untold(), [1, 2, 3, 4, 5, 6]);
        let samples = run_of(&exits, &rig.workspace.center_m);
        let parts = residuals(&samples, &run, &Prior::default());
        assert_eq!(parts.len(), 36);
        assert!(parts.iter().all(|p| p.residual_m.abs() < 3e-4), "{parts:?}");
        let (middle, least) = motion(&samples).unwrap();
        assert!((middle - rig.workspace.center_m).norm() < 5e-3 && (0.03..0.06).contains(&least));
        let mut joined = record.clone();
        apply(&mut joined, &run);
        joined.write().unwrap();
        for (unit, truth) in joined.units.iter().zip(&exits) {
            assert!((Vector3::from(unit.exit_m) - truth).norm() < 1e-3);
            assert_eq!(unit.geometry_date, "2026-11-22");
        }
        exits[3].x += 0.012;
        let samples = run_of(&exits, &rig.workspace.center_m);
        let run = evaluate(&samples, &record, &Prior::default()).unwrap();
        assert_eq!(run.moved.verdict, MovedVerdict::Units(vec![4]));
        let stored = Vector3::from(record.units[3].exit_m);
        assert!(length_rms_m(&samples[3], &stored) > length_rms_m(&samples[3], &exits[3]));
        assert_eq!(length_rms_m(&[], &stored), None);
        let none: [Vec<Sample>; UNITS] = std::array::from_fn(|_| Vec::new());
        assert!(evaluate(&none, &record, &Prior::default()).is_err());
    }

    /// An exit that is mirrored, another unit's cable and a wrong sign are seen in the lengths; a
    /// tip that stands tells nothing.
    #[test]
    fn wrong_geometry_shows_in_the_lengths() {
        let rig = Rig::built_in().unwrap();
        let exits = rig.units.each_ref().map(|unit| unit.exit_m);
        let center = exits.iter().sum::<Vector3<f64>>() / UNITS as f64;
        let runs = run_of(&exits, &center);
        let judge = |unit: usize, samples: &[Sample], exit_m: Vector3<f64>| {
            judge_length(unit as u8 + 1, samples, &exit_m, 2e-4).expect("samples")
        };
        for (i, samples) in runs.iter().enumerate() {
            let right = judge(i, samples, exits[i]);
            assert!(!right.disagrees() && right.limit_m.is_some(), "{right:?}");
            let mirrored = Vector3::new(exits[i].x, exits[i].y, 2.0 * center.z - exits[i].z);
            let others = exits[(i + 1) % UNITS];
            for wrong in [mirrored, others] {
                if (wrong - exits[i]).norm() > 0.02 {
                    assert!(judge(i, samples, wrong).disagrees(), "unit {}", i + 1);
                }
            }
            let reversed: Vec<Sample> = samples
                .iter()
                .map(|s| Sample {
                    travel_m: -s.travel_m,
                    ..*s
                })
                .collect();
            assert!(judge(i, &reversed, exits[i]).disagrees());
            let still: Vec<Sample> = samples
                .iter()
                .map(|s| Sample {
                    tip_m: center,
                    ..*s
                })
                .collect();
            assert_eq!(judge(i, &still, exits[i]).limit_m, None);
        }
    }
}
