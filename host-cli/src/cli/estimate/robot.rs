//! The robot's source of states as rows of a model, live: for `estimate run`, and for `monitor
//! --estimate`.

use crate::cli::exit::{self, Failure, Result};
use estimate::load;
use estimate::pace::{Anew, Pace, Take};
use estimator::estimator::Estimator;
use estimator::motion::INPUTS;
use estimator::stream::Sure;
use nalgebra::Vector3;
use robot::source::{Estimate, Source, SourceConfig};
use robot::state::{Acts, Frame, Meaning, RobotState, Stamp, TipForce};
use std::path::Path;
use std::time::Instant;

/// What came from the robot, in order.
pub enum Heard {
    /// Something to be told.
    Note(String),
    /// The next row begins a sequence.
    Anew,
    /// Rows are missing: the next one comes this time after the last, s.
    Gap(f64),
    /// A row: the stamp of its state, and the inputs.
    Row(Stamp, [f32; INPUTS]),
}

/// A robot that a model follows.
pub struct Robot<'a> {
    estimator: &'a Estimator,
    source: Box<dyn Source>,
    began: Instant,
    pace: Pace,
    gap_noted: bool,
    /// The last event that was told.
    told: String,
}

impl<'a> Robot<'a> {
    /// Opens the source that `[robot]` of the file names; `any`: it may be another robot than the
    /// model's.
    ///
    /// # Errors
    /// The file names no live source, or another robot; the source can't be opened.
    pub fn open(estimator: &'a Estimator, file: &Path, any: bool) -> Result<Self> {
        let config = robot_table(file)?;
        if matches!(config, SourceConfig::Virtual(_)) {
            return Err(Failure::usage("the virtual arm lives inside a run of `forcectl experiment run`; estimate from its dataset with `estimate run --replay`"));
        }
        if !any {
            check_name(estimator, config.robot(), file)?;
        }
        let source = robot_ros::open(&config).map_err(|error| Failure::new(exit::LINK, error))?;
        Ok(Self::of(estimator, source))
    }

    fn of(estimator: &'a Estimator, source: Box<dyn Source>) -> Self {
        Self {
            estimator,
            source,
            began: Instant::now(),
            pace: Pace::new(estimator.step_s),
            gap_noted: false,
            told: String::new(),
        }
    }

    /// What came since the last call. It does not wait.
    ///
    /// # Errors
    /// The source is lost, or its states are no rows of the model.
    pub fn poll(&mut self) -> Result<Vec<Heard>> {
        let lost = |error| Failure::new(exit::LINK, error);
        let now_ns = i64::try_from(self.began.elapsed().as_nanos()).unwrap_or(i64::MAX);
        let poll = self.source.poll(now_ns).map_err(lost)?;
        let mut heard = Vec::new();
        for text in poll.events.iter().map(ToString::to_string) {
            // A robot in fault says so with every state.
            if text != self.told {
                heard.push(Heard::Note(text.clone()));
                self.told = text;
            }
        }
        if poll.stop().is_some() && self.pace.goes_on() {
            let text = "the stream of states broke off: the estimate begins anew";
            heard.extend([Heard::Note(text.to_owned()), Heard::Anew]);
            self.pace.broke_off();
        }
        for state in &poll.states {
            match self.pace.take(state.stamp.t_ns).map_err(Failure::usage)? {
                Take::Between => continue,
                Take::Next => {}
                Take::Anew(why) => {
                    // A gap may come at every row: once is enough.
                    let gap = matches!(why, Anew::Gap { .. });
                    if !(gap && self.gap_noted) {
                        heard.push(Heard::Note(why.to_string()));
                    }
                    self.gap_noted |= gap;
                    heard.push(match why {
                        Anew::Gap { distance_ns } => Heard::Gap(distance_ns as f64 * 1e-9),
                        Anew::Back => Heard::Anew,
                    });
                }
            }
            match inputs(state, &self.estimator.absent) {
                Ok(input) => heard.push(Heard::Row(state.stamp.clone(), input)),
                // Told with its flaw above; it may be there again in the next state.
                Err(_) if !poll.left_out.is_empty() => {
                    heard.push(Heard::Anew);
                    self.pace.broke_off();
                }
                Err(why) => {
                    let why = format!("{}: {why}", self.source.name());
                    return Err(Failure::new(exit::LINK, why));
                }
            }
        }
        Ok(heard)
    }

    /// Publishes the force of the state with this stamp, where it can be used: CRTK has no word for
    /// a force that is not known.
    ///
    /// # Errors
    /// The source is lost.
    pub fn publish(&mut self, force: &[f32], sure: Sure, stamp: Stamp) -> Result<()> {
        if !sure.usable() {
            return Ok(());
        }
        let estimate = Estimate {
            force: tip_force(self.estimator, force),
            half_n: (sure.half_n).map(|half_n| half_widths(self.estimator, half_n)),
            stamp,
        };
        let published = self.source.publish_estimate(&estimate);
        published.map_err(|error| Failure::new(exit::LINK, error))
    }
}

/// Refuses a robot whose name is not that of the model's training.
fn check_name(estimator: &Estimator, name: Option<&str>, file: &Path) -> Result<()> {
    if estimator.robot == load::UNNAMED {
        return Err(Failure::usage(
            "nothing named the robot of this model's training, so nothing tells whether it is this one. Give `name` in [robot] of the experiment and train again, or take the model with --any-robot",
        ));
    }
    match name {
        Some(name) => Ok(load::check_robot(estimator, name, false)?),
        None => Err(Failure::usage(format!(
            "{}: [robot] has no `name`, and an address does not tell which robot publishes there. The model is of the robot `{}`: if this is it, write name = {:?}, else train a model of it. --any-robot takes the model as it is",
            file.display(), estimator.robot, estimator.robot
        ))),
    }
}

/// `[robot]` of a TOML file.
fn robot_table(file: &Path) -> Result<SourceConfig> {
    let text = files::read_text(file)
        .map_err(|error| Failure::usage(format!("{}: {error}", file.display())))?;
    let mut table: toml::Table = toml::from_str(&text)
        .map_err(|error| Failure::usage(format!("{}: {error}", file.display())))?;
    let robot = table
        .remove("robot")
        .ok_or_else(|| Failure::usage(format!("{}: there is no [robot] table", file.display())))?;
    robot
        .try_into()
        .map_err(|error| Failure::usage(format!("{}: [robot] {error}", file.display())))
}

/// A state as the row of a model. Inputs without which the model was trained are 0; a robot need
/// not publish them.
fn inputs(
    state: &RobotState,
    absent: &[usize],
) -> std::result::Result<[f32; INPUTS], &'static str> {
    let joints = state
        .joints
        .as_ref()
        .ok_or("the robot publishes no joints")?;
    let groups = [
        (Some(&joints.position), "the robot publishes no joints"),
        (
            joints.velocity.as_ref(),
            "the robot publishes no joint velocities",
        ),
        (
            joints.effort.as_ref().map(|effort| &effort.value),
            "the robot publishes no joint efforts (on a Raven they are in /ravenstate alone)",
        ),
    ];
    let mut row = [0.0; INPUTS];
    for (n, (values, none)) in groups.into_iter().enumerate() {
        for i in 0..3 {
            if absent.contains(&(3 * n + i)) {
                continue;
            }
            row[3 * n + i] = *values
                .ok_or(none)?
                .get(i)
                .ok_or("the robot has fewer than three joints")?
                as f32;
        }
    }
    Ok(row)
}

/// The force as CRTK knows forces.
fn tip_force(estimator: &Estimator, force: &[f32]) -> TipForce {
    let mut vector = Vector3::zeros();
    for (axis, value) in estimator.axes.iter().zip(force) {
        vector[*axis] = f64::from(*value);
    }
    TipForce {
        frame: Frame::Rig,
        acts: Acts::OnTool,
        meaning: Meaning::Estimated,
        force_n: vector.into(),
        torque_n_m: None,
    }
}

/// Half widths of the components of a force, N. Of several components the interval is a ball.
fn half_widths(estimator: &Estimator, half_n: f64) -> [f64; 3] {
    core::array::from_fn(|axis| {
        if estimator.axes.contains(&axis) {
            half_n
        } else {
            0.0
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use estimator::estimator::{Kind, NetworkLimits, Training};
    use estimator::geometry::Base;
    use estimator::sequence::Sequence;
    use estimator::trees::TreesConfig;
    use robot::source::{Poll, SourceError};
    use robot::state::Clock;
    use std::sync::{Arc, Mutex};

    /// Keeps what is published.
    struct Ear(Arc<Mutex<Vec<Estimate>>>);

    impl Source for Ear {
        fn name(&self) -> String {
            "ear".to_owned()
        }

        fn poll(&mut self, _: i64) -> std::result::Result<Poll, SourceError> {
            Ok(Poll::default())
        }

        fn publish_estimate(
            &mut self,
            estimate: &Estimate,
        ) -> std::result::Result<(), SourceError> {
            self.0.lock().unwrap().push(estimate.clone());
            Ok(())
        }
    }

    /// What goes out over ROS 1 and ROS 2: `robot/ros/tests/ros1.rs` and `ros2.rs` have the topics.
    #[test]
    fn what_is_not_valid_is_not_published_and_the_stamp_is_the_states() {
        let training = Training {
            kind: Kind::Zero,
            axes: vec![1],
            base: Base::default(),
            robot: "arm".to_owned(),
            trees: TreesConfig::default(),
            networks: NetworkLimits::default(),
            intervals: false,
            absent: Vec::new(),
        };
        let still = Sequence {
            trial: 1,
            start_s: 0.0,
            step_s: 0.02,
            input: vec![0.0; INPUTS],
            inputs: INPUTS,
            target: vec![0.0; 3],
            targets: 3,
        };
        let estimator = Estimator::train(&training, &[&still], &mut |_| {}).unwrap();
        let published = Arc::default();
        let mut robot = Robot::of(&estimator, Box::new(Ear(Arc::clone(&published))));
        let sure = |valid, misfits| Sure {
            half_n: Some(0.3),
            valid,
            misfits,
        };
        let states = [(false, false), (false, true), (true, true), (true, false)];
        for (t_ns, (valid, misfits)) in (7..).zip(states) {
            let clock = Clock::RobotUtc;
            (robot.publish(&[2.5], sure(valid, misfits), Stamp { t_ns, clock })).unwrap();
        }
        let published = published.lock().unwrap();
        assert_eq!(published.len(), 1);
        assert_eq!(published[0].stamp.t_ns, 10);
        assert_eq!(published[0].force.force_n, [0.0, 2.5, 0.0]);
        assert_eq!(published[0].half_n, Some([0.0, 0.3, 0.0]));
    }
}
