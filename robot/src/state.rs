//! What a robot tells: one message type for every source, with frame, sign of force, unit and clock
//! declared.
//!
//! Units: rad, m, rad/s, m/s, N·m, N. A quantity that a source does not know is `None` and never 0.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// A clock, by name. Times of different clocks don't compare.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Virtual time of the emulated rig, from power-on.
    Virtual,
    /// Monotonic clock of the computer that runs this program, from an arbitrary start.
    HostMonotonic,
    /// The robot's computer, UTC as its operating system has it (ROS stamps). Can be stepped.
    RobotUtc,
    /// Another one.
    Named(String),
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Virtual => f.write_str("virtual"),
            Self::HostMonotonic => f.write_str("host_monotonic"),
            Self::RobotUtc => f.write_str("robot_utc"),
            Self::Named(name) => f.write_str(name),
        }
    }
}

/// A time on a clock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// Which clock.
    pub clock: Clock,
    /// Time, ns.
    pub t_ns: i64,
}

/// A coordinate frame.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// Frame 0 of the Raven's kinematics: origin at the remote centre, gravity along -x.
    Raven0,
    /// The Raven's CRTK frame: origin at the remote centre, gravity along -z (see
    /// [`crate::kinematics`]).
    RavenCrtk,
    /// Robot base frame of the rig file: where exit points and axes are surveyed.
    Rig,
    /// Frame 6 of the tool: it moves with the tool.
    Tool,
    /// Another one.
    Named(String),
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Raven0 => f.write_str("raven_0"),
            Self::RavenCrtk => f.write_str("raven_crtk"),
            Self::Rig => f.write_str("rig"),
            Self::Tool => f.write_str("tool"),
            Self::Named(name) => f.write_str(name),
        }
    }
}

/// Which way a force counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Acts {
    /// The force of the environment on the tool.
    OnTool,
    /// The force of the tool on the environment.
    ByTool,
}

/// What a force or an effort is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meaning {
    /// A sensor measured it.
    Measured,
    /// It was commanded to actuators, after their limits.
    Commanded,
    /// It was requested, before limits: what is applied can be less.
    Requested,
    /// A model computed it from something else.
    Estimated,
}

/// A force at the tool's tip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipForce {
    /// Frame of the components.
    pub frame: Frame,
    /// Its sign.
    pub acts: Acts,
    /// What it is.
    pub meaning: Meaning,
    /// Force, N.
    pub force_n: [f64; 3],
    /// Torque about the tip, N·m.
    pub torque_n_m: Option<[f64; 3]>,
}

impl TipForce {
    /// The same force with this sign.
    #[must_use]
    pub fn acting(&self, acts: Acts) -> Self {
        let mut force = self.clone();
        if acts != self.acts {
            force.acts = acts;
            force.force_n = force.force_n.map(|n| -n);
            force.torque_n_m = force.torque_n_m.map(|t| t.map(|n| -n));
        }
        force
    }
}

/// Joint torques or forces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effort {
    /// What they are.
    pub meaning: Meaning,
    /// N·m of revolute joints, N of sliding ones, in the order of the joints.
    pub value: Vec<f64>,
}

/// The joints, all lists in the order of the names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// Names.
    pub names: Arc<[String]>,
    /// rad or m.
    pub position: Vec<f64>,
    /// rad/s or m/s.
    pub velocity: Option<Vec<f64>>,
    /// Torques or forces of the drives at the joints.
    pub effort: Option<Effort>,
    /// Set points of the positions.
    pub setpoint: Option<Vec<f64>>,
}

/// The tool's tip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipState {
    /// Frame of all components.
    pub frame: Frame,
    /// The frame's name as the robot itself tells it, empty where it tells none. It is compared,
    /// never used.
    pub frame_id: Arc<str>,
    /// Time of the pose on the robot's clock, ns, where that is not the time of the state.
    pub stamp_ns: Option<i64>,
    /// Position, m.
    pub position_m: [f64; 3],
    /// Orientation of the tool as a unit quaternion x, y, z, w.
    pub orientation_xyzw: Option<[f64; 4]>,
    /// Velocity, m/s.
    pub velocity_m_per_s: Option<[f64; 3]>,
    /// Angular velocity, rad/s.
    pub angular_velocity_rad_per_s: Option<[f64; 3]>,
}

/// CRTK operating state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Operating {
    /// Drives off.
    Disabled,
    /// Drives on.
    Enabled,
    /// Drives on, no motion.
    Paused,
    /// A fault.
    Fault,
}

impl Operating {
    /// CRTK's word.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Disabled => "DISABLED",
            Self::Enabled => "ENABLED",
            Self::Paused => "PAUSED",
            Self::Fault => "FAULT",
        }
    }
}

/// CRTK operating state with its flags.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct OperatingState {
    /// State.
    pub state: Operating,
    /// Joint positions are absolute.
    pub is_homed: bool,
    /// A motion is in progress.
    pub is_busy: bool,
}

/// State of a robot at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotState {
    /// Who published it: kind of the source and the publisher's name where there can be several.
    pub publisher: Arc<str>,
    /// Number that the publisher counts up, where it does.
    pub sequence: Option<u64>,
    /// Time of the state on the robot's clock.
    pub stamp: Stamp,
    /// Time of receipt on this program's clock.
    pub received: Option<Stamp>,
    /// The joints.
    pub joints: Option<JointState>,
    /// The tip.
    pub tip: Option<TipState>,
    /// The force that the robot itself reports.
    pub force: Option<TipForce>,
    /// Operating state.
    pub operating: Option<OperatingState>,
}

/// Why a state can't be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StateError {
    /// A number is NaN or infinite.
    #[error("{field}[{index}] is {value}: not a number to work with; the robot's software reports an invalid state")]
    NotFinite {
        /// Which list.
        field: &'static str,
        /// From 0.
        index: usize,
        /// What it holds.
        value: f64,
    },
    /// A list has another length than the joints' names.
    #[error("{field} has {got} values for {expected} joints")]
    Length {
        /// Which list.
        field: &'static str,
        /// Its length.
        got: usize,
        /// Number of names.
        expected: usize,
    },
    /// A quaternion that is none.
    #[error("the tip's orientation has length {0:.3}, a unit quaternion has 1")]
    Quaternion(f64),
    /// The message is not of the shape that was expected.
    #[error("the message can't be read: {0}")]
    Format(String),
    /// A datagram is none of a robot.
    #[error("one that is no message can't be read ({0}); does another program send to this port?")]
    NoMessage(String),
    /// The publisher says so itself (CRTK: a stamp of 0).
    #[error("its stamp is 0: the publisher marks its data as invalid")]
    Invalid,
    /// A stamp that no clock of these centuries shows in seconds.
    #[error("its stamp is {0:e}, and has to be in s; in ms, us or ns it would be as large")]
    StampUnit(f64),
    /// A datagram tells one thing twice, and not the same.
    #[error("its {key} is `{first}` and `{second}` in one datagram; send one of them, or the same in both")]
    Contradiction {
        /// What.
        key: &'static str,
        /// As it is told first.
        first: String,
        /// As it is told beside that.
        second: String,
    },
    /// Keys of a datagram that mean nothing here.
    #[error("{0} are not read; a stamp is `stamp_s` or `header.stamp`, a frame `frame_id` in `measured_cp` or its `header`; docs/robot.md has all keys")]
    UnknownKeys(String),
    /// Neither joints nor tip.
    #[error("the state holds neither joints nor a tip")]
    Empty,
    /// The joints have no names.
    #[error("{0} joints have no names; their place tells them apart")]
    Nameless(usize),
    /// A topic has another type.
    #[error("{topic} is published as {found}, expected is {expected}; `rostopic info {topic}` names who does. A pose may be a TransformStamped: `cp_is_transform` in [robot]")]
    TopicType {
        /// The topic.
        topic: String,
        /// Its type.
        found: String,
        /// The type that is read.
        expected: String,
    },
    /// Two nodes send the same topic.
    #[error("two publishers: `{first}` and now `{second}`")]
    TwoPublishers {
        /// Whose messages are used.
        first: Arc<str>,
        /// Whose are not.
        second: Arc<str>,
    },
    /// A part without which the state can be used.
    #[error("{field}: {why}")]
    Optional {
        /// Which part.
        field: &'static str,
        /// What is wrong with it.
        why: Box<StateError>,
    },
}

impl StateError {
    /// The same flaw of a part without which the state can be used.
    #[must_use]
    pub fn of_optional(self, field: &'static str) -> Self {
        Self::Optional {
            field,
            why: Box::new(self),
        }
    }

    /// Whether it is about a datagram that is none of a robot.
    #[must_use]
    pub fn is_no_message(&self) -> bool {
        match self {
            Self::Optional { why, .. } => why.is_no_message(),
            error => matches!(error, Self::NoMessage(_)),
        }
    }
}

/// How far a quaternion's length may be from 1: single precision over a whole chain.
const QUATERNION_TOLERANCE: f64 = 1e-3;

impl RobotState {
    /// Whether it tells the operating state and nothing else, as CRTK's topic of that name does.
    #[must_use]
    pub const fn is_operating_alone(&self) -> bool {
        self.joints.is_none() && self.tip.is_none() && self.operating.is_some()
    }

    /// Leaves out each part that has a flaw and without which the state can still be used:
    /// velocities, efforts, set points, an orientation, the robot's own force, and the joints where
    /// there is a tip. Returns what was left out ([`StateError::Optional`]). Joints without names
    /// keep their place and go without.
    pub fn leave_out_flaws(&mut self) -> Vec<StateError> {
        let mut flaws = Flaws::default();
        if let Some(joints) = &mut self.joints {
            let count = joints.position.len();
            if joints.names.is_empty() && count > 0 {
                joints.names = (1..=count).map(|n| format!("joint_{n}")).collect();
                flaws.note("joint names", StateError::Nameless(count));
            }
            let expected = joints.names.len();
            let sound = |field, list: &[f64]| of_length(field, list, expected);
            flaws.part("joint velocity", &mut joints.velocity, |v| {
                sound("joint velocity", v)
            });
            flaws.part("joint effort", &mut joints.effort, |e| {
                sound("joint effort", &e.value)
            });
            flaws.part("joint setpoint", &mut joints.setpoint, |s| {
                sound("joint setpoint", s)
            });
        }
        if self.tip.is_some() {
            flaws.part("joints", &mut self.joints, JointState::check);
        }
        if let Some(tip) = &mut self.tip {
            flaws.part("tip orientation", &mut tip.orientation_xyzw, |q| {
                unit_quaternion("tip orientation", q)
            });
            flaws.part("tip velocity", &mut tip.velocity_m_per_s, |v| {
                finite("tip velocity", v)
            });
            let turning = &mut tip.angular_velocity_rad_per_s;
            flaws.part("tip angular velocity", turning, |v| {
                finite("tip angular velocity", v)
            });
        }
        if let Some(force) = &mut self.force {
            flaws.part("torque", &mut force.torque_n_m, |t| finite("torque", t));
        }
        flaws.part("force", &mut self.force, |f| finite("force", &f.force_n));
        flaws.0
    }

    /// Checks that the state holds a tip or joints, that every number is finite, every list has its
    /// length and an orientation is one, and that the publisher does not mark it as invalid.
    ///
    /// # Errors
    /// The first flaw.
    pub fn check(&self) -> Result<(), StateError> {
        if self.stamp.clock == Clock::RobotUtc && self.stamp.t_ns == 0 {
            return Err(StateError::Invalid);
        }
        if self.joints.is_none() && self.tip.is_none() {
            return Err(StateError::Empty);
        }
        if let Some(tip) = &self.tip {
            finite("tip position", &tip.position_m)?;
        }
        if let Some(joints) = &self.joints {
            joints.check()?;
        }
        // What is left is optional.
        match self.clone().leave_out_flaws().into_iter().next() {
            Some(StateError::Optional { why, .. }) => Err(*why),
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

impl JointState {
    /// Whether there is a finite position for each name.
    fn check(&self) -> Result<(), StateError> {
        of_length("joint position", &self.position, self.names.len())
    }
}

/// What was left out of a state.
#[derive(Default)]
struct Flaws(Vec<StateError>);

impl Flaws {
    fn note(&mut self, field: &'static str, why: StateError) {
        self.0.push(why.of_optional(field));
    }

    /// Leaves a part out where it does not pass.
    fn part<T>(
        &mut self,
        field: &'static str,
        part: &mut Option<T>,
        check: impl Fn(&T) -> Result<(), StateError>,
    ) {
        if let Some(Err(why)) = part.as_ref().map(check) {
            *part = None;
            self.note(field, why);
        }
    }
}

fn of_length(field: &'static str, list: &[f64], expected: usize) -> Result<(), StateError> {
    if list.len() != expected {
        return Err(StateError::Length {
            field,
            got: list.len(),
            expected,
        });
    }
    finite(field, list)
}

fn unit_quaternion(field: &'static str, q: &[f64; 4]) -> Result<(), StateError> {
    finite(field, q)?;
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if (length - 1.0).abs() > QUATERNION_TOLERANCE {
        return Err(StateError::Quaternion(length));
    }
    Ok(())
}

fn finite(field: &'static str, list: &[f64]) -> Result<(), StateError> {
    match list.iter().enumerate().find(|(_, v)| !v.is_finite()) {
        None => Ok(()),
        Some((index, value)) => Err(StateError::NotFinite {
            field,
            index,
            value: *value,
        }),
    }
}

/// Where a robot's frame stands in the rig's robot base frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mount {
    /// Origin of the robot's frame in the rig's, m.
    pub translation_m: [f64; 3],
    /// Its orientation, unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

impl Default for Mount {
    fn default() -> Self {
        Self {
            translation_m: [0.0; 3],
            rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
        }
    }
}

impl Mount {
    /// The rotation; normalised.
    #[must_use]
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        let [x, y, z, w] = self.rotation_xyzw;
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }

    /// Checks the figures.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn check(&self) -> Result<(), StateError> {
        finite("mount.translation_m", &self.translation_m)?;
        unit_quaternion("mount.rotation_xyzw", &self.rotation_xyzw)
    }

    /// A tip of the robot's frame in the rig's frame.
    #[must_use]
    pub fn tip_in_rig(&self, tip: &TipState) -> TipState {
        let rotation = self.rotation();
        let turn = |v: [f64; 3]| <[f64; 3]>::from(rotation * Vector3::from(v));
        let position = rotation * Vector3::from(tip.position_m) + Vector3::from(self.translation_m);
        TipState {
            frame: Frame::Rig,
            frame_id: Arc::clone(&tip.frame_id),
            stamp_ns: tip.stamp_ns,
            position_m: position.into(),
            orientation_xyzw: tip.orientation_xyzw.map(|[x, y, z, w]| {
                let q = rotation * UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                [q.i, q.j, q.k, q.w]
            }),
            velocity_m_per_s: tip.velocity_m_per_s.map(turn),
            angular_velocity_rad_per_s: tip.angular_velocity_rad_per_s.map(turn),
        }
    }

    /// A force of the robot's frame in the rig's frame.
    #[must_use]
    pub fn force_in_rig(&self, force: &TipForce) -> TipForce {
        let rotation = self.rotation();
        let turn = |v: [f64; 3]| <[f64; 3]>::from(rotation * Vector3::from(v));
        TipForce {
            frame: Frame::Rig,
            force_n: turn(force.force_n),
            torque_n_m: force.torque_n_m.map(turn),
            ..force.clone()
        }
    }

    /// A force of the rig's frame in the robot's frame, which is called `frame`.
    #[must_use]
    pub fn force_from_rig(&self, force: &TipForce, frame: Frame) -> TipForce {
        let rotation = self.rotation().inverse();
        let turn = |v: [f64; 3]| <[f64; 3]>::from(rotation * Vector3::from(v));
        TipForce {
            frame,
            force_n: turn(force.force_n),
            torque_n_m: force.torque_n_m.map(turn),
            ..force.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> RobotState {
        RobotState {
            publisher: "test".into(),
            sequence: None,
            stamp: Stamp {
                clock: Clock::RobotUtc,
                t_ns: 5,
            },
            received: None,
            joints: Some(JointState {
                names: ["a".to_owned(), "b".to_owned()].into(),
                position: vec![0.1, 0.2],
                velocity: None,
                effort: None,
                setpoint: None,
            }),
            tip: Some(TipState {
                frame: Frame::RavenCrtk,
                frame_id: "".into(),
                stamp_ns: None,
                position_m: [0.1, 0.2, 0.3],
                orientation_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
                velocity_m_per_s: Some([0.0, 1.0, 0.0]),
                angular_velocity_rad_per_s: None,
            }),
            force: None,
            operating: None,
        }
    }

    #[test]
    fn flaws_are_found_and_named() {
        assert_eq!(state().check(), Ok(()));
        let mut bad = state();
        bad.tip.as_mut().unwrap().position_m[1] = f64::NAN;
        let error = bad.check().unwrap_err();
        assert!(
            matches!(
                error,
                StateError::NotFinite {
                    field: "tip position",
                    index: 1,
                    ..
                }
            ),
            "{error}"
        );
        let mut bad = state();
        bad.joints.as_mut().unwrap().velocity = Some(vec![1.0]);
        assert_eq!(
            bad.check(),
            Err(StateError::Length {
                field: "joint velocity",
                got: 1,
                expected: 2
            })
        );
        let mut bad = state();
        bad.tip.as_mut().unwrap().orientation_xyzw = Some([0.0; 4]);
        assert_eq!(bad.check(), Err(StateError::Quaternion(0.0)));
        let mut bad = state();
        (bad.joints, bad.tip) = (None, None);
        assert_eq!(bad.check(), Err(StateError::Empty));
    }

    #[test]
    fn a_flaw_in_what_is_not_needed_leaves_a_state_that_can_be_used() {
        type Spoil = fn(&mut RobotState);
        let spoil: [(&str, Spoil); 8] = [
            ("joint velocity", |s| {
                s.joints.as_mut().unwrap().velocity = Some(vec![f64::NAN; 2])
            }),
            ("joint setpoint", |s| {
                s.joints.as_mut().unwrap().setpoint = Some(vec![0.0; 3])
            }),
            ("joint effort", |s| {
                s.joints.as_mut().unwrap().effort = Some(Effort {
                    meaning: Meaning::Measured,
                    value: vec![0.0, f64::NAN],
                });
            }),
            ("joints", |s| {
                s.joints.as_mut().unwrap().position[1] = f64::INFINITY
            }),
            ("tip orientation", |s| {
                s.tip.as_mut().unwrap().orientation_xyzw = Some([0.0; 4])
            }),
            ("tip velocity", |s| {
                s.tip.as_mut().unwrap().velocity_m_per_s = Some([f64::NAN; 3])
            }),
            ("tip angular velocity", |s| {
                s.tip.as_mut().unwrap().angular_velocity_rad_per_s = Some([f64::NAN; 3]);
            }),
            ("force", |s| {
                s.force = Some(TipForce {
                    frame: Frame::Rig,
                    acts: Acts::OnTool,
                    meaning: Meaning::Measured,
                    force_n: [f64::NAN; 3],
                    torque_n_m: None,
                });
            }),
        ];
        for (part, spoil) in spoil {
            let mut bad = state();
            spoil(&mut bad);
            assert!(bad.check().is_err(), "{part}");
            let flaws = bad.leave_out_flaws();
            assert!(
                matches!(flaws.as_slice(), [StateError::Optional { field, .. }] if *field == part),
                "{part}: {flaws:?}"
            );
            assert_eq!(bad.check(), Ok(()), "{part}");
            assert_eq!(bad.tip.unwrap().position_m, state().tip.unwrap().position_m);
            // Once only: the rest of the state has none.
            assert_eq!(bad.joints.is_none(), part == "joints");
        }
        // What the state is about is needed.
        let mut bad = state();
        bad.tip.as_mut().unwrap().position_m[0] = f64::NAN;
        assert!(bad.leave_out_flaws().is_empty() && bad.check().is_err());
        let mut bad = state();
        bad.tip = None;
        bad.joints.as_mut().unwrap().position[0] = f64::NAN;
        assert!(bad.leave_out_flaws().is_empty() && bad.check().is_err());
        let mut bad = state();
        bad.stamp.t_ns = 0;
        assert_eq!(bad.check(), Err(StateError::Invalid));
    }

    #[test]
    fn a_force_on_the_tool_is_minus_the_force_by_it() {
        let on = TipForce {
            frame: Frame::Rig,
            acts: Acts::OnTool,
            meaning: Meaning::Measured,
            force_n: [1.0, -2.0, 3.0],
            torque_n_m: Some([0.1, 0.0, 0.0]),
        };
        let by = on.acting(Acts::ByTool);
        assert_eq!(by.force_n, [-1.0, 2.0, -3.0]);
        assert_eq!(by.torque_n_m, Some([-0.1, -0.0, -0.0]));
        assert_eq!(by.acting(Acts::OnTool).force_n, on.force_n);
        assert_eq!(on.acting(Acts::OnTool), on);
    }

    #[test]
    fn a_mount_turns_and_moves_tips_and_turns_forces() {
        // A quarter turn about z.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let mount = Mount {
            translation_m: [1.0, 0.0, 0.0],
            rotation_xyzw: [0.0, 0.0, half, half],
        };
        mount.check().unwrap();
        let tip = mount.tip_in_rig(state().tip.as_ref().unwrap());
        assert_eq!(tip.frame, Frame::Rig);
        for (got, expected) in tip.position_m.iter().zip([0.8, 0.1, 0.3]) {
            assert!((got - expected).abs() < 1e-12);
        }
        for (got, expected) in tip.velocity_m_per_s.unwrap().iter().zip([-1.0, 0.0, 0.0]) {
            assert!((got - expected).abs() < 1e-12);
        }
        let force = TipForce {
            frame: Frame::Rig,
            acts: Acts::OnTool,
            meaning: Meaning::Measured,
            force_n: [1.0, 2.0, 3.0],
            torque_n_m: None,
        };
        let there = mount.force_from_rig(&force, Frame::RavenCrtk);
        let back = mount.force_in_rig(&there);
        for (got, expected) in back.force_n.iter().zip(force.force_n) {
            assert!((got - expected).abs() < 1e-12);
        }
        assert!(Mount {
            rotation_xyzw: [0.0; 4],
            ..Mount::default()
        }
        .check()
        .is_err());
    }

    #[test]
    fn states_survive_json() {
        let text = serde_json::to_string(&state()).unwrap();
        assert_eq!(serde_json::from_str::<RobotState>(&text).unwrap(), state());
    }
}
