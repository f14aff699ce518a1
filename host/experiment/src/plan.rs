//! The trials of an experiment, drawn from its seed, and whether the rig can do them.

use super::file::{Experiment, Force};
use super::profile::Profile;
use super::pull::{Examiner, Reach};
use force::controller::ControlError;
use nalgebra::Vector3;
use rig::Rig;
use robot::kinematics::{forward, to_crtk};
use robot::source::SourceConfig;
use robot::state::{Frame, Mount, TipState};
use robot::trajectory::{Trajectory, TrajectoryConfig, TrajectoryError};
use serde::Serialize;
use sha2::{Digest, Sha256};

/// Distance in time between two examined poses, s: a tip moves by at most 2 mm meanwhile.
const EXAMINED_EVERY_S: f64 = 0.1;
/// How much longer a trajectory goes on than its trial, s: the end of the force comes first.
const MARGIN_S: f64 = 10.0;

/// A trial as it is to be run.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Number, from 1.
    pub number: usize,
    /// Path of the virtual arm's joints; `None`: the robot moves by itself.
    pub trajectory: Option<Trajectory>,
    /// Commanded force.
    pub profile: Profile,
}

/// Why the trials can't be run. Nothing was driven.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A trajectory.
    #[error("{0}")]
    Trajectory(#[from] TrajectoryError),
    /// The allocation.
    #[error("{0}")]
    Control(#[from] ControlError),
    /// The rig file does not fit.
    #[error("{0}")]
    Rig(String),
    /// A force or pose is out of reach.
    #[error("{0}")]
    OutOfReach(Box<OutOfReach>),
}

/// The first place at which the rig can't do what the experiment asks for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutOfReach {
    /// Trial, from 1.
    pub trial: usize,
    /// Time in it, s.
    pub t_s: f64,
    /// Joints, rad, rad, m.
    pub joints: [f64; 3],
    /// Tip, robot base frame, m.
    pub tip_m: Vector3<f64>,
    /// Commanded force, N.
    pub commanded_n: Vector3<f64>,
    /// Nearest force within reach there, N; `None`: the pose itself is out of reach.
    pub nearest_force_n: Option<Vector3<f64>>,
    /// Nearest tip within reach, m; `None`: the force is out of reach and not the pose.
    pub nearest_tip_m: Option<Vector3<f64>>,
    /// Examined places, and how many of them are out of reach.
    pub places: usize,
    /// See `places`.
    pub out_of_reach: usize,
    /// Factor by which `largest_n` and both rates have to be smaller so that all forces are within
    /// reach: the profile keeps its times then. 0 where a pose is out of reach.
    pub factor: f64,
}

impl std::fmt::Display for OutOfReach {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let v = |v: &Vector3<f64>, d: usize| format!("[{:.d$}, {:.d$}, {:.d$}]", v.x, v.y, v.z);
        let [q1, q2, q3] = self.joints;
        write!(
            f,
            "trial {} can't be done at {:.1} s (joints {:.2} deg, {:.2} deg, {q3:.4} m, tip {} m): ",
            self.trial,
            self.t_s,
            q1.to_degrees(),
            q2.to_degrees(),
            v(&self.tip_m, 4)
        )?;
        match (&self.nearest_force_n, &self.nearest_tip_m) {
            (Some(nearest), _) => write!(
                f,
                "the force {} N is out of reach, the nearest is {} N. {} of {} examined places are out of reach; with \
                 largest_n, slowest_n_per_s and fastest_n_per_s of [force] times {:.2} none is",
                v(&self.commanded_n, 3),
                v(nearest, 3),
                self.out_of_reach,
                self.places,
                (self.factor * 100.0).floor() / 100.0
            ),
            (None, Some(tip)) => write!(
                f,
                "the pose is outside of [workspace], or a cable is too far off its axis; the nearest pose within is {} m. {} of \
                 {} examined places are out of reach; narrow `lower` and `upper` of [[trajectory]], or move the arm's mount",
                v(tip, 4),
                self.out_of_reach,
                self.places
            ),
            (None, None) => write!(f, "neither the pose nor a pose near it is within reach"),
        }?;
        f.write_str("; nothing was driven")
    }
}

/// A seed for one use of one trial.
#[must_use]
pub fn derive(seed: u64, label: &str, number: u64) -> u64 {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    hash.update(number.to_le_bytes());
    hash.update(label.as_bytes());
    let digest = hash.finalize();
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&digest[..8]);
    // JSON readers keep 53 bits.
    u64::from_le_bytes(bytes) >> 11
}

/// Trial `number` (from 1) of an experiment.
///
/// # Errors
/// The trajectory can't be drawn.
pub fn trial(experiment: &Experiment, number: usize) -> Result<Trial, PlanError> {
    let trajectory = match &experiment.robot {
        SourceConfig::Virtual(_) if !experiment.trajectories.is_empty() => {
            let index = (number - 1) % experiment.trajectories.len();
            let config = TrajectoryConfig {
                duration_s: experiment.trial_s() + MARGIN_S,
                ..experiment.trajectories[index]
            };
            let seed = derive(experiment.seed, "trajectory", number as u64);
            Some(Trajectory::new(&config, seed)?)
        }
        _ => None,
    };
    Ok(Trial {
        number,
        trajectory,
        profile: Profile::new(
            &experiment.force,
            experiment.seed,
            number as u64,
            experiment.trial_s(),
        ),
    })
}

/// The tip for joints of the arm at a mount, robot base frame, m.
#[must_use]
pub fn tip_m(joints: [f64; 3], mount: &Mount) -> Vector3<f64> {
    let [q1, q2, q3] = joints;
    let in_crtk = TipState {
        frame: Frame::RavenCrtk,
        frame_id: "".into(),
        stamp_ns: None,
        position_m: to_crtk(forward(&[q1, q2, q3, 0.0, 0.0, 0.0]).position_m).into(),
        orientation_xyzw: None,
        velocity_m_per_s: None,
        angular_velocity_rad_per_s: None,
    };
    mount.tip_in_rig(&in_crtk).position_m.into()
}

/// Examines every trial of `numbers`; returns how many places were examined. A robot that moves by
/// itself is examined at the workspace's centre.
///
/// # Errors
/// [`PlanError`], with the first place that is out of reach and what is within reach.
pub fn examine(experiment: &Experiment, rig: &Rig, numbers: &[usize]) -> Result<usize, PlanError> {
    let rig = experiment.prepare_rig(rig).map_err(PlanError::Rig)?;
    let largest_n = experiment.force.largest_n();
    if largest_n > rig.controller.force_limit_n {
        return Err(PlanError::Rig(format!(
            "[force] largest_n = {largest_n} is above the rig's limit of {} N (`force_limit_n` in [controller] of the rig file)",
            rig.controller.force_limit_n
        )));
    }
    if matches!(experiment.force, Force::ThreeAxes { .. }) {
        run::require_feasible(&rig).map_err(|error| PlanError::Rig(error.to_string()))?;
    }
    let mount = match &experiment.robot {
        SourceConfig::Virtual(config) => config.arm.mount,
        _ => Mount::default(),
    };
    let mut walk = Walk {
        examiner: Examiner::new(&rig, &experiment.force)?,
        rig: &rig,
        resting_m: match &experiment.robot {
            SourceConfig::Static(robot) => robot.position_m.into(),
            _ => rig.workspace.center_m,
        },
        first: None,
        places: 0,
        out_of_reach: 0,
        part: 1.0,
    };
    for number in numbers {
        let trial = trial(experiment, *number)?;
        let count = (experiment.trial_s() / EXAMINED_EVERY_S) as usize;
        for n in 0..=count {
            walk.examine(&trial, n as f64 * EXAMINED_EVERY_S, &mount)?;
        }
    }
    match walk.first {
        None => Ok(walk.places),
        Some(first) => Err(PlanError::OutOfReach(Box::new(OutOfReach {
            places: walk.places,
            out_of_reach: walk.out_of_reach,
            factor: walk.part,
            ..first
        }))),
    }
}

struct Walk<'a> {
    examiner: Examiner,
    rig: &'a Rig,
    /// The tip of a robot without a trajectory of its own: where it stands, else the centre of the
    /// workspace.
    resting_m: Vector3<f64>,
    first: Option<OutOfReach>,
    places: usize,
    out_of_reach: usize,
    part: f64,
}

impl Walk<'_> {
    fn examine(&mut self, trial: &Trial, t_s: f64, mount: &Mount) -> Result<(), PlanError> {
        let joints = (trial.trajectory.as_ref()).map_or([0.0; 3], |t| t.at(t_s).position);
        let tip = match trial.trajectory {
            Some(_) => tip_m(joints, mount),
            None => self.resting_m,
        };
        let commanded_n = trial.profile.at(t_s);
        self.places += 1;
        let (nearest_force_n, nearest_tip_m) = match self.examiner.examine(tip, commanded_n)? {
            Reach::Within => return Ok(()),
            Reach::Force { nearest_n, part } => {
                self.part = self.part.min(part);
                (Some(nearest_n), None)
            }
            Reach::Pose => {
                self.part = 0.0;
                (None, self.nearest_tip(tip)?)
            }
        };
        self.out_of_reach += 1;
        self.first.get_or_insert(OutOfReach {
            trial: trial.number,
            t_s,
            joints,
            tip_m: tip,
            commanded_n,
            nearest_force_n,
            nearest_tip_m,
            places: 0,
            out_of_reach: 0,
            factor: 0.0,
        });
        Ok(())
    }

    /// The nearest tip on the way to the workspace's centre at which the cables work.
    fn nearest_tip(&mut self, tip: Vector3<f64>) -> Result<Option<Vector3<f64>>, PlanError> {
        let center_m = self.rig.workspace.center_m;
        for step in (0..1000).rev() {
            let at = center_m + (tip - center_m) * (f64::from(step) * 1e-3);
            if self.examiner.examine(at, Vector3::zeros())? != Reach::Pose {
                return Ok(Some(at));
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot::source::VirtualConfig;

    fn thesis() -> Experiment {
        Experiment::thesis().unwrap()
    }

    #[test]
    fn the_default_experiment_is_within_reach() {
        let rig = Rig::built_in().unwrap();
        let numbers: Vec<usize> = (1..=9).collect();
        let places = examine(&thesis(), &rig, &numbers).unwrap();
        assert_eq!(places, 9 * 12_001);
    }

    #[test]
    fn a_force_out_of_reach_is_refused_with_the_nearest_and_what_is_within() {
        let rig = Rig::built_in().unwrap();
        let mut wanted = thesis().quick();
        wanted.minutes = 5.0;
        let Force::OneAxis {
            largest_n,
            slowest_n_per_s,
            fastest_n_per_s,
            ..
        } = &mut wanted.force
        else {
            panic!("it is one-axis");
        };
        (*largest_n, *slowest_n_per_s, *fastest_n_per_s) = (11.5, 3.0, 5.0);
        let error = examine(&wanted, &rig, &[1]).unwrap_err();
        let PlanError::OutOfReach(found) = &error else {
            panic!("{error}");
        };
        assert!(found.nearest_force_n.is_some() && found.factor > 0.8);
        let text = error.to_string();
        assert!(
            text.contains("trial 1 ") && text.contains("nothing was driven"),
            "{text}"
        );
        // What it proposes is within reach.
        let factor = (found.factor * 100.0).floor() / 100.0;
        let Force::OneAxis {
            largest_n,
            slowest_n_per_s,
            fastest_n_per_s,
            ..
        } = &mut wanted.force
        else {
            panic!("it is one-axis");
        };
        for value in [largest_n, slowest_n_per_s, fastest_n_per_s] {
            *value *= factor;
        }
        examine(&wanted, &rig, &[1]).unwrap();
    }

    #[test]
    fn a_pose_out_of_reach_is_refused_with_the_nearest_pose() {
        let rig = Rig::built_in().unwrap();
        let mut wanted = thesis().quick();
        let mut config = VirtualConfig::default();
        config.arm.mount.translation_m[1] += 0.2;
        wanted.robot = SourceConfig::Virtual(config);
        let error = examine(&wanted, &rig, &[1]).unwrap_err();
        let PlanError::OutOfReach(found) = &error else {
            panic!("{error}");
        };
        let nearest = found.nearest_tip_m.unwrap();
        let radius = (nearest - rig.workspace.center_m).norm();
        assert!((0.095..=0.1).contains(&radius), "{radius}");
        assert!(error.to_string().contains("[workspace]"), "{error}");
    }

    #[test]
    fn trials_differ_and_repeat() {
        let thesis = thesis();
        let first = trial(&thesis, 1).unwrap();
        assert_eq!(first, trial(&thesis, 1).unwrap());
        assert_ne!(first.trajectory, trial(&thesis, 2).unwrap().trajectory);
        assert_ne!(derive(1, "chips", 1), derive(1, "chips", 2));
        assert_ne!(derive(1, "chips", 1), derive(1, "trajectory", 1));
    }
}
