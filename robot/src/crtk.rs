//! CRTK topics (collaborative-robotics/documentation, api-robot-motion, api-operating-state) and
//! how they become states.
//!
//! A robot publishes `measured_js`, `measured_cp`, `measured_cv`, `measured_cf`, `setpoint_js` and
//! `operating_state` below its namespace. [`Adapter`] joins them: each `measured_js` makes a state,
//! with the newest of the others whose stamp is near enough; where a robot has no joints, each
//! `measured_cp` does.
//!
//! CRTK leaves open whether a force acts on or by the tool, and frames go by namespace. Both are
//! declared here by the configuration ([`AdapterConfig`]) and travel with every state. What differs
//! on real robots, each with a test:
//!
//! | robot | trap | what the adapter does |
//! | --- | --- | --- |
//! | all | a stamp of 0 marks invalid data, an empty list an unavailable one | `measured_js`: [`StateError::Invalid`]; the others are left out until they are valid again; `None` |
//! | all | `operating_state` is published on change, its stamp often left at 0 | its stamp does not count, the last one holds |
//! | all | joints without names, NaN for what is unknown | left out, see [`RobotState::leave_out_flaws`] |
//! | Raven | `measured_js.effort` is always 0: the field behind it is written in commented-out code only | no effort; take it from `ravenstate` |
//! | Raven | the arms are swapped in `measured_js` (arm1 carries green) and, where gold is the first board, in `measured_cp` | [`raven_topics`] |
//! | Raven | `setpoint_cp` is in frame 0 while `measured_cp` is in the CRTK frame; frame_id is empty | declared by topic |
//! | Raven | `_cp` is a TransformStamped (as in CRTK before 01/2022) | both types |
//! | Raven, force_control branch | `force_applied` is the command, not a measurement | [`force_applied`]: [`Meaning::Commanded`] |
//! | dVRK | `measured_cf` is computed from motor efforts, friction included | [`Meaning::Estimated`] |
//! | dVRK | `measured_cf` is below `body/` and `spatial/`; `body/` is the frame of the tool | `Robot::measured_cf`, [`frame_of_force`] |

use crate::state::{
    Acts, Clock, Effort, Frame, JointState, Meaning, Operating, OperatingState, RobotState, Stamp,
    StateError, TipForce, TipState,
};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

/// Header of a stamped message.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Header {
    /// Counted up by the publisher in ROS 1.
    pub seq: Option<u32>,
    /// Stamp in ns since 1970; 0: the data are invalid.
    pub stamp_ns: i64,
    /// Frame's name.
    pub frame_id: String,
}

/// `sensor_msgs/JointState`.
#[derive(Debug, Clone, PartialEq, Default)]
#[allow(missing_docs)] // the message's own names
pub struct Joints {
    pub name: Vec<String>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

/// Position and orientation: of a PoseStamped or a TransformStamped.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// m.
    pub position_m: [f64; 3],
    /// Unit quaternion.
    pub orientation_xyzw: [f64; 4],
}

/// A linear and an angular vector: of a TwistStamped (m/s, rad/s) or a WrenchStamped (N, N·m).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pair {
    /// Linear part.
    pub linear: [f64; 3],
    /// Angular part.
    pub angular: [f64; 3],
}

/// A message of one of the robot's topics.
#[derive(Debug, Clone, PartialEq)]
pub enum Topic {
    /// `measured_js`.
    MeasuredJs(Joints),
    /// `setpoint_js`.
    SetpointJs(Joints),
    /// `measured_cp`.
    MeasuredCp(Pose),
    /// `measured_cv`.
    MeasuredCv(Pair),
    /// `measured_cf`.
    MeasuredCf(Pair),
    /// `operating_state`: state's word, homed, busy.
    OperatingState(String, bool, bool),
}

/// Which robot publishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Robot {
    /// One that does as CRTK says.
    #[default]
    Generic,
    /// A Raven-II with its crtk branch (@0d10caf).
    #[serde(alias = "raven2")]
    Raven,
    /// A da Vinci research kit, version 1.x or 2.x, on ROS 1 or ROS 2: the topics are the same.
    #[serde(alias = "dvrk1", alias = "dvrk2")]
    Dvrk,
}

impl Robot {
    /// Name of its own force below its namespace.
    const fn measured_cf(self) -> &'static str {
        match self {
            Self::Dvrk => "body/measured_cf",
            Self::Generic | Self::Raven => "measured_cf",
        }
    }

    /// Whether its poses are TransformStamped.
    #[must_use]
    pub const fn cp_is_transform(self) -> bool {
        matches!(self, Self::Raven)
    }
}

/// Names of the robot's topics, where they are not the usual ones: below its namespace, or whole if
/// they begin with `/`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TopicNames {
    /// Joints.
    pub measured_js: Option<String>,
    /// Set points of the joints.
    pub setpoint_js: Option<String>,
    /// Pose of the tip.
    pub measured_cp: Option<String>,
    /// Velocity of the tip.
    pub measured_cv: Option<String>,
    /// The robot's own force. A dVRK's: `body/measured_cf`.
    pub measured_cf: Option<String>,
    /// Operating state.
    pub operating_state: Option<String>,
}

/// Whole names of a robot's topics.
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(missing_docs)] // CRTK's own names
pub struct Topics {
    pub measured_js: String,
    pub setpoint_js: String,
    pub measured_cp: String,
    pub measured_cv: String,
    pub measured_cf: String,
    pub operating_state: String,
}

impl TopicNames {
    /// The whole names: joints and operating state are below `namespace`, the tip's topics below
    /// `cp_namespace`.
    #[must_use]
    pub fn whole(&self, robot: Robot, namespace: &str, cp_namespace: &str) -> Topics {
        let name = |space: &str, given: &Option<String>, usual: &str| {
            let name = given.as_deref().unwrap_or(usual);
            if name.starts_with('/') {
                name.to_owned()
            } else {
                format!("{space}/{name}")
            }
        };
        Topics {
            measured_js: name(namespace, &self.measured_js, "measured_js"),
            setpoint_js: name(namespace, &self.setpoint_js, "setpoint_js"),
            measured_cp: name(cp_namespace, &self.measured_cp, "measured_cp"),
            measured_cv: name(cp_namespace, &self.measured_cv, "measured_cv"),
            measured_cf: name(cp_namespace, &self.measured_cf, robot.measured_cf()),
            operating_state: name(namespace, &self.operating_state, "operating_state"),
        }
    }
}

/// Frame of a force by the name of its topic: CRTK's namespace `body` is that of the tool, all
/// others are told by `frame`.
#[must_use]
pub fn frame_of_force(topic: &str, frame: &Frame) -> Frame {
    if topic.split('/').any(|part| part == "body") {
        Frame::Tool
    } else {
        frame.clone()
    }
}

/// What the messages don't say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdapterConfig {
    /// Which robot.
    pub robot: Robot,
    /// Frame of `measured_cp` and `measured_cv`.
    pub frame: Frame,
    /// Frame of `measured_cf`; `None`: by the name of its topic, see [`frame_of_force`].
    pub force_frame: Option<Frame>,
    /// Sign of the robot's own `measured_cf`. The spec does not say; nothing is assumed.
    pub measured_cf: Option<Acts>,
    /// Whether the robot publishes `measured_js`. Without it each `measured_cp` makes a state.
    pub joints: bool,
    /// Largest difference of stamps within a state, s.
    pub max_skew_s: f64,
}

impl Default for AdapterConfig {
    fn default() -> Self {
        Self {
            robot: Robot::Generic,
            frame: Frame::Rig,
            force_frame: None,
            measured_cf: None,
            joints: true,
            max_skew_s: 0.02,
        }
    }
}

impl AdapterConfig {
    /// A Raven-II.
    #[must_use]
    pub fn raven() -> Self {
        Self {
            robot: Robot::Raven,
            frame: Frame::RavenCrtk,
            ..Self::default()
        }
    }
}

/// Joins topics to states.
#[derive(Debug, Clone)]
pub struct Adapter {
    config: AdapterConfig,
    newest: HashMap<u8, Newest>,
    /// Who publishes each topic.
    publishers: HashMap<u8, Arc<str>>,
    /// The last name of a frame: one copy.
    frame_id: Arc<str>,
    names: Option<Arc<[String]>>,
}

/// The newest message of a topic.
#[derive(Debug, Clone)]
struct Newest {
    stamp_ns: i64,
    frame_id: Arc<str>,
    topic: Topic,
}

/// Which slot of the newest messages a topic has.
const fn slot(topic: &Topic) -> u8 {
    match topic {
        Topic::MeasuredJs(_) => 0,
        Topic::SetpointJs(_) => 1,
        Topic::MeasuredCp(_) => 2,
        Topic::MeasuredCv(_) => 3,
        Topic::MeasuredCf(_) => 4,
        Topic::OperatingState(..) => 5,
    }
}
const OPERATING: u8 = 5;
/// Names of the topics by slot.
const NAMES: [&str; 6] = [
    "measured_js",
    "setpoint_js",
    "measured_cp",
    "measured_cv",
    "measured_cf",
    "operating_state",
];

impl Adapter {
    /// Nothing received yet.
    #[must_use]
    pub fn new(config: AdapterConfig) -> Self {
        Self {
            config,
            newest: HashMap::new(),
            publishers: HashMap::new(),
            frame_id: "".into(),
            names: None,
        }
    }

    /// Takes a message; a state where it completes one.
    ///
    /// # Errors
    /// The message is invalid, and is not used. [`StateError::Optional`]: states are made without
    /// it.
    pub fn take(
        &mut self,
        publisher: &Arc<str>,
        header: &Header,
        topic: Topic,
    ) -> Result<Option<RobotState>, StateError> {
        let slot = slot(&topic);
        let name = NAMES[usize::from(slot)];
        let first = (self.publishers.entry(slot)).or_insert_with(|| Arc::clone(publisher));
        if *first != *publisher {
            return Err(StateError::TwoPublishers {
                first: Arc::clone(first),
                second: Arc::clone(publisher),
            });
        }
        let makes_state = match topic {
            Topic::MeasuredJs(_) => true,
            Topic::MeasuredCp(_) => !self.config.joints,
            _ => false,
        };
        if header.stamp_ns == 0 && slot != OPERATING {
            // What it told before is no longer true.
            self.newest.remove(&slot);
            return Err(match makes_state {
                true => StateError::Invalid,
                false => StateError::Invalid.of_optional(name),
            });
        }
        if *self.frame_id != *header.frame_id {
            self.frame_id = header.frame_id.as_str().into();
        }
        let newest = Newest {
            stamp_ns: header.stamp_ns,
            frame_id: Arc::clone(&self.frame_id),
            topic,
        };
        self.newest.insert(slot, newest);
        Ok(makes_state.then(|| self.state(publisher, header)))
    }

    /// The newest message of a slot, if its stamp is near `stamp_ns`.
    fn near(&self, slot: u8, stamp_ns: i64) -> Option<&Newest> {
        let newest = self.newest.get(&slot)?;
        // An operating state is published on change: the last one holds.
        let skew_s = (stamp_ns.saturating_sub(newest.stamp_ns) as f64 * 1e-9).abs();
        (slot == OPERATING || skew_s <= self.config.max_skew_s).then_some(newest)
    }

    /// The same, without its header.
    fn topic_near(&self, slot: u8, stamp_ns: i64) -> Option<&Topic> {
        self.near(slot, stamp_ns).map(|newest| &newest.topic)
    }

    fn state(&mut self, publisher: &Arc<str>, header: &Header) -> RobotState {
        let at = header.stamp_ns;
        let joints = self.joints(at);
        RobotState {
            publisher: Arc::clone(publisher),
            sequence: header.seq.map(u64::from),
            stamp: Stamp {
                clock: Clock::RobotUtc,
                t_ns: at,
            },
            received: None,
            joints,
            tip: self.tip(at),
            force: self.force(at),
            operating: self.operating(at),
        }
    }

    fn joints(&mut self, at: i64) -> Option<JointState> {
        let Some(Topic::MeasuredJs(joints)) = self.topic_near(0, at).cloned() else {
            return None;
        };
        let setpoint = match self.topic_near(1, at) {
            // Without names their places have to do.
            Some(Topic::SetpointJs(setpoint))
                if setpoint.name == joints.name || setpoint.name.is_empty() =>
            {
                some(&setpoint.position)
            }
            _ => None,
        };
        // The same list of names again and again: one copy.
        let names = match &self.names {
            Some(names) if **names == *joints.name => Arc::clone(names),
            _ => {
                let names: Arc<[String]> = joints.name.clone().into();
                self.names = Some(Arc::clone(&names));
                names
            }
        };
        let effort = match self.config.robot {
            Robot::Raven => None,
            Robot::Generic | Robot::Dvrk => some(&joints.effort),
        };
        Some(JointState {
            names,
            velocity: some(&joints.velocity),
            effort: effort.map(|value| Effort {
                meaning: Meaning::Measured,
                value,
            }),
            setpoint,
            position: joints.position,
        })
    }

    fn tip(&self, at: i64) -> Option<TipState> {
        let newest = self.near(2, at)?;
        let Topic::MeasuredCp(pose) = &newest.topic else {
            return None;
        };
        let velocity = match self.topic_near(3, at) {
            Some(Topic::MeasuredCv(twist)) => Some(twist),
            _ => None,
        };
        Some(TipState {
            frame: self.config.frame.clone(),
            frame_id: Arc::clone(&newest.frame_id),
            stamp_ns: Some(newest.stamp_ns),
            position_m: pose.position_m,
            orientation_xyzw: Some(pose.orientation_xyzw),
            velocity_m_per_s: velocity.map(|twist| twist.linear),
            angular_velocity_rad_per_s: velocity.map(|twist| twist.angular),
        })
    }

    fn force(&self, at: i64) -> Option<TipForce> {
        let Some(Topic::MeasuredCf(wrench)) = self.topic_near(4, at) else {
            return None;
        };
        let frame = self.config.force_frame.as_ref();
        Some(TipForce {
            frame: frame.unwrap_or(&self.config.frame).clone(),
            acts: self.config.measured_cf?,
            meaning: match self.config.robot {
                Robot::Dvrk => Meaning::Estimated,
                Robot::Generic | Robot::Raven => Meaning::Measured,
            },
            force_n: wrench.linear,
            torque_n_m: Some(wrench.angular),
        })
    }

    fn operating(&self, at: i64) -> Option<OperatingState> {
        let Some(Topic::OperatingState(word, is_homed, is_busy)) = self.topic_near(OPERATING, at)
        else {
            return None;
        };
        Some(OperatingState {
            state: operating(word),
            is_homed: *is_homed,
            is_busy: *is_busy,
        })
    }
}

/// The state of a word. One that CRTK does not know is no reason to go on.
#[must_use]
pub fn operating(word: &str) -> Operating {
    match word {
        "DISABLED" => Operating::Disabled,
        "ENABLED" => Operating::Enabled,
        "PAUSED" => Operating::Paused,
        _ => Operating::Fault,
    }
}

/// CRTK: an empty list is an unavailable quantity.
fn some(list: &[f64]) -> Option<Vec<f64>> {
    (!list.is_empty()).then(|| list.to_vec())
}

/// Namespaces of a Raven's gold (left) arm by what is read: (`measured_js`, `measured_cp`).
/// `gold_board` is the place of gold's USB board in the software's list, 0 or 1.
#[must_use]
pub const fn raven_topics(gold_board: u8) -> (&'static str, &'static str) {
    let cp = if gold_board == 0 { "/arm2" } else { "/arm1" };
    ("/arm2", cp)
}

/// Frame of a Raven's `setpoint_cp`: not that of its `measured_cp`.
#[must_use]
pub const fn raven_setpoint_frame() -> Frame {
    Frame::Raven0
}

/// `force_applied` of the Raven's force_control branch: a command in the position field of a
/// JointState; `None` where it has not three components.
#[must_use]
pub fn force_applied(joints: &Joints, frame: Frame) -> Option<TipForce> {
    let force_n: [f64; 3] = joints.position.as_slice().try_into().ok()?;
    Some(TipForce {
        frame,
        acts: Acts::OnTool,
        meaning: Meaning::Commanded,
        force_n,
        torque_n_m: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(stamp_ns: i64) -> Header {
        Header {
            stamp_ns,
            ..Header::default()
        }
    }

    fn joints() -> Joints {
        Joints {
            name: vec!["shoulder".to_owned(), "elbow".to_owned()],
            position: vec![0.5, 1.5],
            velocity: vec![],
            effort: vec![0.0, 0.0],
        }
    }

    const POSE: Pose = Pose {
        position_m: [0.1, 0.2, 0.3],
        orientation_xyzw: [0.0, 0.0, 0.0, 1.0],
    };

    fn take(adapter: &mut Adapter, stamp_ns: i64, topic: Topic) -> Option<RobotState> {
        adapter
            .take(&"robot".into(), &header(stamp_ns), topic)
            .unwrap()
    }

    #[test]
    fn topics_are_joined_where_their_stamps_are_near() {
        let mut adapter = Adapter::new(AdapterConfig::default());
        assert!(take(&mut adapter, 1_000_000, Topic::MeasuredCp(POSE)).is_none());
        assert!(take(
            &mut adapter,
            1_000_000,
            Topic::OperatingState("ENABLED".into(), true, false)
        )
        .is_none());
        let state = take(&mut adapter, 2_000_000, Topic::MeasuredJs(joints())).unwrap();
        assert_eq!(state.tip.unwrap().position_m, POSE.position_m);
        assert_eq!(state.operating.unwrap().state, Operating::Enabled);
        // 100 ms later the old pose is none of this state; the operating state holds.
        let state = take(&mut adapter, 102_000_000, Topic::MeasuredJs(joints())).unwrap();
        assert!(state.tip.is_none());
        assert!(state.operating.is_some());
    }

    #[test]
    fn empty_lists_are_unavailable_and_a_stamp_of_zero_is_invalid() {
        let mut adapter = Adapter::new(AdapterConfig::default());
        let state = take(&mut adapter, 5, Topic::MeasuredJs(joints())).unwrap();
        assert!(state.joints.unwrap().velocity.is_none());
        let error = adapter.take(&"robot".into(), &header(0), Topic::MeasuredJs(joints()));
        assert_eq!(error, Err(StateError::Invalid));
    }

    #[test]
    fn a_stamp_of_zero_in_an_optional_topic_leaves_that_topic_out_and_keeps_the_pose() {
        let pair = Pair {
            linear: [1.0; 3],
            angular: [0.0; 3],
        };
        let others = [
            ("setpoint_js", Topic::SetpointJs(joints())),
            ("measured_cv", Topic::MeasuredCv(pair)),
            ("measured_cf", Topic::MeasuredCf(pair)),
        ];
        for (name, topic) in others {
            let mut adapter = Adapter::new(AdapterConfig {
                measured_cf: Some(Acts::OnTool),
                ..AdapterConfig::default()
            });
            take(&mut adapter, 5, Topic::MeasuredCp(POSE));
            take(&mut adapter, 5, topic.clone());
            let with = take(&mut adapter, 6, Topic::MeasuredJs(joints())).unwrap();
            let error = (adapter.take(&"robot".into(), &header(0), topic)).unwrap_err();
            assert_eq!(error, StateError::Invalid.of_optional(name));
            let without = take(&mut adapter, 7, Topic::MeasuredJs(joints())).unwrap();
            assert_eq!(without.tip.as_ref().unwrap().position_m, POSE.position_m);
            // What it said before is not told any more.
            let parts = |state: &RobotState| {
                [
                    state.joints.as_ref().unwrap().setpoint.is_some(),
                    state.tip.as_ref().unwrap().velocity_m_per_s.is_some(),
                    state.force.is_some(),
                ]
            };
            assert!(parts(&with).contains(&true), "{name}");
            assert_eq!(parts(&without), [false; 3], "{name}");
        }
    }

    #[test]
    fn a_pose_of_stamp_zero_is_none_and_its_frame_and_stamp_travel_with_the_others() {
        let mut adapter = Adapter::new(AdapterConfig::default());
        let named = Header {
            stamp_ns: 5,
            frame_id: "PSM1_base".to_owned(),
            ..Header::default()
        };
        let pose = |header: &Header, adapter: &mut Adapter| {
            adapter.take(&"robot".into(), header, Topic::MeasuredCp(POSE))
        };
        pose(&named, &mut adapter).unwrap();
        let tip = take(&mut adapter, 7, Topic::MeasuredJs(joints()))
            .unwrap()
            .tip;
        let tip = tip.unwrap();
        assert_eq!((&*tip.frame_id, tip.stamp_ns), ("PSM1_base", Some(5)));
        assert!(pose(&header(0), &mut adapter).is_err());
        let state = take(&mut adapter, 8, Topic::MeasuredJs(joints())).unwrap();
        assert!(state.tip.is_none());
    }

    #[test]
    fn a_fault_counts_whatever_its_stamp_and_a_second_publisher_of_a_pose_is_named() {
        let mut adapter = Adapter::new(AdapterConfig::default());
        take(
            &mut adapter,
            0,
            Topic::OperatingState("FAULT".into(), true, false),
        );
        let state = take(&mut adapter, 5, Topic::MeasuredJs(joints())).unwrap();
        assert_eq!(state.operating.unwrap().state, Operating::Fault);
        take(&mut adapter, 5, Topic::MeasuredCp(POSE));
        let error = adapter
            .take(&"another".into(), &header(6), Topic::MeasuredCp(POSE))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("robot") && error.contains("another"),
            "{error}"
        );
    }

    #[test]
    fn set_points_without_names_go_by_their_place() {
        let mut adapter = Adapter::new(AdapterConfig::default());
        for (names, told) in [
            (vec![], true),
            (vec!["x".to_owned(), "y".to_owned()], false),
        ] {
            let setpoint = Joints {
                name: names,
                ..joints()
            };
            take(&mut adapter, 5, Topic::SetpointJs(setpoint));
            let state = take(&mut adapter, 5, Topic::MeasuredJs(joints())).unwrap();
            assert_eq!(state.joints.unwrap().setpoint.is_some(), told);
        }
    }

    #[test]
    fn a_ravens_effort_is_not_a_torque_of_zero() {
        let mut raven = Adapter::new(AdapterConfig::raven());
        let state = take(&mut raven, 5, Topic::MeasuredJs(joints())).unwrap();
        assert!(state.joints.unwrap().effort.is_none());
        // Of another robot a zero is a zero.
        let mut other = Adapter::new(AdapterConfig::default());
        let state = take(&mut other, 5, Topic::MeasuredJs(joints())).unwrap();
        assert_eq!(state.joints.unwrap().effort.unwrap().value, [0.0, 0.0]);
    }

    #[test]
    fn each_robot_has_its_topics_and_each_can_be_named() {
        let of = |robot, names: &TopicNames| names.whole(robot, "/PSM1", "/PSM1");
        let usual = of(Robot::Generic, &TopicNames::default());
        assert_eq!(usual.measured_cf, "/PSM1/measured_cf");
        let dvrk = of(Robot::Dvrk, &TopicNames::default());
        assert_eq!(dvrk.measured_cf, "/PSM1/body/measured_cf");
        assert_eq!(
            (dvrk.measured_cp, dvrk.measured_js),
            (usual.measured_cp, usual.measured_js)
        );
        let named = TopicNames {
            measured_cf: Some("spatial/measured_cf".to_owned()),
            operating_state: Some("/console/operating_state".to_owned()),
            ..TopicNames::default()
        };
        let named = of(Robot::Dvrk, &named);
        assert_eq!(named.measured_cf, "/PSM1/spatial/measured_cf");
        assert_eq!(named.operating_state, "/console/operating_state");
        for (topic, frame) in [
            ("/PSM1/body/measured_cf", Frame::Tool),
            ("/PSM1/spatial/measured_cf", Frame::Rig),
            ("/somebody/measured_cf", Frame::Rig),
        ] {
            assert_eq!(frame_of_force(topic, &Frame::Rig), frame, "{topic}");
        }
        for (word, robot) in [
            ("dvrk2", Robot::Dvrk),
            ("dvrk1", Robot::Dvrk),
            ("dvrk", Robot::Dvrk),
            ("raven2", Robot::Raven),
            ("raven", Robot::Raven),
        ] {
            let read: Robot = serde_json::from_value(word.into()).unwrap();
            assert_eq!(read, robot, "{word}");
        }
    }

    #[test]
    fn golds_topics_are_those_of_arm_2() {
        assert_eq!(raven_topics(0), ("/arm2", "/arm2"));
        assert_eq!(raven_topics(1), ("/arm2", "/arm1"));
    }

    #[test]
    fn a_ravens_frames_differ_between_measured_and_setpoint() {
        let mut raven = Adapter::new(AdapterConfig::raven());
        take(&mut raven, 5, Topic::MeasuredCp(POSE));
        let state = take(&mut raven, 5, Topic::MeasuredJs(joints())).unwrap();
        assert_eq!(state.tip.unwrap().frame, Frame::RavenCrtk);
        assert_eq!(raven_setpoint_frame(), Frame::Raven0);
    }

    #[test]
    fn force_applied_is_a_command() {
        let mut message = joints();
        message.position = vec![0.0, 2.5, 0.0];
        let force = force_applied(&message, Frame::RavenCrtk).unwrap();
        assert_eq!(force.meaning, Meaning::Commanded);
        assert!(force_applied(&joints(), Frame::RavenCrtk).is_none());
    }

    #[test]
    fn a_force_without_a_declared_sign_is_not_passed_on() {
        let wrench = Pair {
            linear: [1.0, 2.0, 3.0],
            angular: [0.0; 3],
        };
        for (acts, robot) in [
            (None, Robot::Dvrk),
            (Some(Acts::ByTool), Robot::Dvrk),
            (Some(Acts::OnTool), Robot::Generic),
        ] {
            let mut adapter = Adapter::new(AdapterConfig {
                robot,
                measured_cf: acts,
                ..AdapterConfig::default()
            });
            take(&mut adapter, 5, Topic::MeasuredCf(wrench));
            let force = take(&mut adapter, 5, Topic::MeasuredJs(joints()))
                .unwrap()
                .force;
            assert_eq!(force.as_ref().map(|force| force.acts), acts);
            if let Some(force) = force {
                // A dVRK's is computed from motor efforts.
                assert_eq!(force.meaning == Meaning::Estimated, robot == Robot::Dvrk);
            }
        }
    }

    #[test]
    fn a_word_that_is_no_state_is_a_fault() {
        let mut adapter = Adapter::new(AdapterConfig::default());
        take(
            &mut adapter,
            5,
            Topic::OperatingState("TELEOP".into(), true, true),
        );
        let state = take(&mut adapter, 5, Topic::MeasuredJs(joints())).unwrap();
        assert_eq!(state.operating.unwrap().state, Operating::Fault);
    }

    #[test]
    fn nan_is_refused() {
        let mut adapter = Adapter::new(AdapterConfig {
            joints: false,
            ..AdapterConfig::default()
        });
        let mut pose = POSE;
        pose.position_m[2] = f64::NAN;
        let state = take(&mut adapter, 5, Topic::MeasuredCp(pose)).unwrap();
        let error = state.check().unwrap_err();
        assert!(
            matches!(error, StateError::NotFinite { index: 2, .. }),
            "{error}"
        );
    }
}
