//! Where robot states come from: `[robot]` of the rig file, one trait for all of them.
//!
//! | `kind` | what it is | file |
//! | --- | --- | --- |
//! | `virtual` | the virtual arm of the fast rig; whoever runs the rig feeds its states | `fed.rs` |
//! | `crtk-ros1` | a robot with CRTK topics, or the Raven's `ravenstate`, over ROS 1 | package `robot-ros` |
//! | `crtk-ros2` | a robot with CRTK topics over ROS 2 | package `robot-ros` |
//! | `udp` | JSON datagrams | `udp.rs` |
//! | `static` | a clamped tip | `fixed.rs` |
//!
//! `robot-ros` also opens the source that a configuration names.
//!
//! Every source passes its states through a [`Watch`]: what comes out of [`Source::poll`] can be
//! used, and what is not in order comes out as an [`Event`]. A caller that gets an event that
//! [`Event::stops`] brings the rig to its safe state.
//!
//! ```toml
//! [robot]
//! kind = "udp"
//! listen = "127.0.0.1:4712"
//! frame = "raven_crtk"
//! [robot.watch]
//! max_age_s = 0.1
//! ```

mod fed;
mod fixed;
mod udp;

pub use fed::Fed;
pub use fixed::Fixed;
pub use udp::Udp;

use crate::crtk::{AdapterConfig, TopicNames, Topics};
use crate::state::{
    Clock, Frame, Mount, OperatingState, RobotState, Stamp, StateError, TipForce, TipState,
};
use crate::watch::{Event, Unfit, Watch, WatchConfig};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What came since the last poll.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Poll {
    /// States that can be used, in order.
    pub states: Vec<RobotState>,
    /// What is not in order.
    pub events: Vec<Event>,
    /// Forces that the robot's side asks for (CRTK `servo_cf`), in order.
    pub requests: Vec<TipForce>,
    /// What the robot's side commands the rig (CRTK `state_command`): `disable`, `pause` and
    /// others, in order.
    pub commands: Vec<String>,
    /// How often a part of a state was left out for a flaw, by part; the state was used without it.
    pub left_out: BTreeMap<&'static str, u64>,
    /// Our time less the robot's for the state that was on its way for the shortest time, of the
    /// last one to two seconds, ns.
    pub least_delay_ns: i64,
}

impl Poll {
    /// When the tip of one of [`Self::states`] was there, on our clock, ns: its stamp, as if it had
    /// been on its way as long as the fastest. So the scatter of the arrivals is not in it; a
    /// constant delay is. `None` without a tip, and where only the arrival is known.
    #[must_use]
    pub fn tip_at_ns(&self, state: &RobotState) -> Option<i64> {
        let stamp_ns = state.tip.as_ref()?.stamp_ns.unwrap_or(state.stamp.t_ns);
        match &state.received {
            None => Some(stamp_ns),
            Some(received) if received.clock == state.stamp.clock => None,
            Some(received) => Some(
                stamp_ns
                    .saturating_add(self.least_delay_ns)
                    .min(received.t_ns),
            ),
        }
    }

    /// The first event for which the rig has to go to its safe state.
    #[must_use]
    pub fn stop(&self) -> Option<&Event> {
        self.events.iter().find(|event| event.stops())
    }

    /// Counts a part that was left out of a state; the first one is an event.
    fn note_left_out(&mut self, flaw: &StateError, watch: &mut Watch) {
        if let StateError::Optional { field, .. } = flaw {
            *self.left_out.entry(field).or_default() += 1;
        }
        self.events.extend(watch.left_out(flaw));
    }

    /// Adds what another poll brought after this one.
    pub fn extend(&mut self, later: Self) {
        self.states.extend(later.states);
        self.events.extend(later.events);
        self.requests.extend(later.requests);
        self.commands.extend(later.commands);
        for (part, count) in later.left_out {
            *self.left_out.entry(part).or_default() += count;
        }
        self.least_delay_ns = later.least_delay_ns;
    }
}

/// A source of robot states.
pub trait Source: Send {
    /// Name in messages.
    fn name(&self) -> String;

    /// What came by `now_ns` of the caller's clock (the one that counts for ages: the host's
    /// monotonic clock, or virtual time).
    ///
    /// # Errors
    /// The source is gone and stays so.
    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError>;

    /// Tells the robot's side the force that the rig applies and the one that it aims at (CRTK
    /// `measured_cf`, `setpoint_cf`). Sources without a way back do nothing.
    ///
    /// # Errors
    /// The source is gone and stays so.
    fn publish(&mut self, applied: &TipForce, setpoint: &TipForce) -> Result<(), SourceError> {
        let _ = (applied, setpoint);
        Ok(())
    }

    /// Tells the robot's side in which state the rig is (CRTK `operating_state`), when it changes.
    /// Who joins late is told too. Sources without a way back do nothing.
    ///
    /// # Errors
    /// The source is gone and stays so.
    fn publish_operating(&mut self, operating: OperatingState) -> Result<(), SourceError> {
        let _ = operating;
        Ok(())
    }

    /// Tells the robot's side a contact force that a model estimates: `measured_cf_estimated`
    /// beside CRTK's `measured_cf`, and its interval as `measured_cf_estimated_half_width`, since a
    /// wrench has no place for it. Sources without a way back do nothing.
    ///
    /// # Errors
    /// The source is gone and stays so.
    fn publish_estimate(&mut self, estimate: &Estimate) -> Result<(), SourceError> {
        let _ = estimate;
        Ok(())
    }
}

/// A contact force that a model estimates.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Force.
    pub force: TipForce,
    /// Half width of the 90 % interval in each component of the force, N: 0 where it is not
    /// estimated, the same in all where the interval is a ball. `None`: the model has no intervals.
    pub half_n: Option<[f64; 3]>,
    /// Stamp of the state from which it is estimated: the instant that it is about, not that of its
    /// computation.
    pub stamp: Stamp,
}

/// Why a source can't be opened or has gone.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A key of the configuration.
    #[error("[robot] {key}: {why}")]
    Config {
        /// Which key.
        key: &'static str,
        /// What is wrong with it.
        why: String,
    },
    /// Its place on the mount.
    #[error("[robot] mount: {0}")]
    Mount(StateError),
    /// An address can't be listened on.
    #[error("robot states can't be received on {listen}: {cause}; check `listen` in [robot] and whether another program has the port")]
    Listen {
        /// The address.
        listen: String,
        /// The operating system's words.
        cause: std::io::Error,
    },
    /// Built without the feature.
    #[error("[robot] kind = \"{kind}\" is not built in: {how}")]
    NotBuilt {
        /// Kind.
        kind: &'static str,
        /// What to do.
        how: &'static str,
    },
    /// ROS 2 refuses.
    #[error("ROS 2 domain {domain}: {why}; check `domain`, `namespace` and `node` in [robot] and the network of this computer")]
    Ros2 {
        /// Domain.
        domain: u16,
        /// What happened.
        why: String,
    },
    /// ROS 1 is there, and something about a node or a topic is wrong.
    #[error("ROS 1 at {master}: {why}")]
    RosNode {
        /// URI of the master.
        master: String,
        /// What happened, and what to do.
        why: String,
    },
    /// ROS is not there, or refuses.
    #[error("ROS 1 at {master}: {why}; is `roscore` running, and do ROS_MASTER_URI and ROS_IP fit both computers?")]
    Ros {
        /// URI of the master.
        master: String,
        /// What happened.
        why: String,
    },
}

/// `[robot]` of the rig file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum SourceConfig {
    /// The virtual arm of the fast rig.
    Virtual(VirtualConfig),
    /// CRTK or `ravenstate` over ROS 1.
    #[serde(rename = "crtk-ros1")]
    CrtkRos1(Ros1Config),
    /// CRTK over ROS 2.
    #[serde(rename = "crtk-ros2")]
    CrtkRos2(Ros2Config),
    /// JSON datagrams.
    Udp(UdpConfig),
    /// A clamped tip.
    Static(StaticConfig),
}

impl SourceConfig {
    /// Name of the robot, where `[robot]` has one. What its models are for is told by this name and
    /// never by an address.
    #[must_use]
    pub fn robot(&self) -> Option<&str> {
        let name = match self {
            Self::Virtual(_) | Self::Static(_) => return None,
            Self::CrtkRos1(c) => &c.name,
            Self::CrtkRos2(c) => &c.name,
            Self::Udp(c) => &c.name,
        };
        name.as_deref()
    }
}

/// The virtual arm.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VirtualConfig {
    /// Seed of the arm's parameters; `None`: that of the rig.
    pub seed: Option<u64>,
    /// The arm.
    #[cfg(feature = "arm")]
    pub arm: crate::arm::ArmConfig,
    /// What is tolerated.
    pub watch: WatchConfig,
}

/// ROS 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros1Config {
    /// Name of the robot: see [`SourceConfig::robot`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// URI of the master; `None`: the environment variable ROS_MASTER_URI, else
    /// `http://localhost:11311`.
    pub master: Option<String>,
    /// Name of our node.
    pub node: String,
    /// Namespace of the robot's `measured_js` (a Raven's gold arm: `/arm2`, see
    /// [`crate::crtk::raven_topics`]).
    pub namespace: String,
    /// Namespace of its `measured_cp`, where that is another one.
    pub cp_namespace: Option<String>,
    /// Whether `measured_cp` is a TransformStamped, as in CRTK before 01/2022; `None`: on a Raven.
    pub cp_is_transform: Option<bool>,
    /// Names of the robot's topics, where they are not the usual ones.
    pub topics: TopicNames,
    /// Topic of the Raven's own message, for example `/ravenstate`; states come from it in place of
    /// the CRTK topics.
    pub ravenstate: Option<String>,
    /// Slot of gold in it, 0 or 1.
    pub ravenstate_slot: u8,
    /// Namespace below which we publish `measured_cf`, `setpoint_cf` and take `servo_cf`;
    /// `operating_state` and `state_command` are one above, where it ends with `spatial`, `body` or
    /// `local`.
    pub publish: String,
    /// What the messages don't say.
    pub adapter: AdapterConfig,
    /// Where the robot's frame stands in the rig's.
    pub mount: Mount,
    /// What is tolerated.
    pub watch: WatchConfig,
}

impl Default for Ros1Config {
    fn default() -> Self {
        Self {
            name: None,
            master: None,
            node: "/force_rig".to_owned(),
            namespace: "/PSM1".to_owned(),
            cp_namespace: None,
            cp_is_transform: None,
            topics: TopicNames::default(),
            ravenstate: None,
            ravenstate_slot: 0,
            publish: "/cable_rig/spatial".to_owned(),
            adapter: AdapterConfig::default(),
            mount: Mount::default(),
            watch: WatchConfig::default(),
        }
    }
}

/// ROS 2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2Config {
    /// Name of the robot: see [`SourceConfig::robot`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// DDS domain; `None`: the environment variable ROS_DOMAIN_ID, else 0.
    pub domain: Option<u16>,
    /// Name of our node.
    pub node: String,
    /// Namespace of the robot's `measured_js`.
    pub namespace: String,
    /// Namespace of its `measured_cp`, where that is another one.
    pub cp_namespace: Option<String>,
    /// Whether `measured_cp` is a TransformStamped, as in CRTK before 01/2022; `None`: on a Raven.
    pub cp_is_transform: Option<bool>,
    /// Names of the robot's topics, where they are not the usual ones.
    pub topics: TopicNames,
    /// Namespace below which we publish `measured_cf`, `setpoint_cf` and take `servo_cf`;
    /// `operating_state` and `state_command` are one above, where it ends with `spatial`, `body` or
    /// `local`.
    pub publish: String,
    /// What the messages don't say.
    pub adapter: AdapterConfig,
    /// Where the robot's frame stands in the rig's.
    pub mount: Mount,
    /// What is tolerated.
    pub watch: WatchConfig,
}

impl Default for Ros2Config {
    fn default() -> Self {
        Self {
            name: None,
            domain: None,
            node: "force_rig".to_owned(),
            namespace: "/PSM1".to_owned(),
            cp_namespace: None,
            cp_is_transform: None,
            topics: TopicNames::default(),
            publish: "/cable_rig/spatial".to_owned(),
            adapter: AdapterConfig::default(),
            mount: Mount::default(),
            watch: WatchConfig::default(),
        }
    }
}

impl Ros1Config {
    /// Whole names of the robot's topics.
    #[must_use]
    pub fn topics(&self) -> Topics {
        let cp = self.cp_namespace.as_deref().unwrap_or(&self.namespace);
        self.topics.whole(self.adapter.robot, &self.namespace, cp)
    }
}

impl Ros2Config {
    /// Whole names of the robot's topics.
    #[must_use]
    pub fn topics(&self) -> Topics {
        let cp = self.cp_namespace.as_deref().unwrap_or(&self.namespace);
        self.topics.whole(self.adapter.robot, &self.namespace, cp)
    }
}

/// JSON datagrams: see [`Udp`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UdpConfig {
    /// Name of the robot: see [`SourceConfig::robot`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Address and port to listen on.
    pub listen: String,
    /// Frame of the poses.
    pub frame: Frame,
    /// Where the robot's frame stands in the rig's.
    pub mount: Mount,
    /// What is tolerated.
    pub watch: WatchConfig,
}

impl Default for UdpConfig {
    fn default() -> Self {
        Self {
            name: None,
            listen: "127.0.0.1:4712".to_owned(),
            frame: Frame::Rig,
            mount: Mount::default(),
            watch: WatchConfig::default(),
        }
    }
}

/// A clamped tip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StaticConfig {
    /// Position, rig's frame, m.
    pub position_m: [f64; 3],
}

/// When a message came that a thread of a source took at `came`: on the caller's clock, which
/// showed `now_ns` at `polled`.
#[must_use]
pub fn arrival(now_ns: i64, polled: std::time::Instant, came: std::time::Instant) -> Stamp {
    let ago = polled.saturating_duration_since(came).as_nanos();
    Stamp {
        clock: Clock::HostMonotonic,
        t_ns: now_ns.saturating_sub(i64::try_from(ago).unwrap_or(i64::MAX)),
    }
}

/// Puts what a source received through its watch: good states in the rig's frame, events for the
/// rest.
#[must_use]
pub fn sift(
    received: Vec<Result<RobotState, StateError>>,
    watch: &mut Watch,
    mount: &Mount,
    now_ns: i64,
) -> Poll {
    let mut poll = Poll::default();
    for state in received {
        let mut state = match state {
            Ok(state) => state,
            Err(flaw @ StateError::Optional { .. }) => {
                poll.note_left_out(&flaw, watch);
                continue;
            }
            Err(StateError::TwoPublishers { first, second }) => {
                poll.events.push(Event::TwoPublishers { first, second });
                continue;
            }
            Err(error) => {
                poll.events.push(Event::Invalid(error));
                continue;
            }
        };
        if state.is_operating_alone() {
            // It is no state of the arm, and makes none younger.
            let unfit = state.operating.and_then(Unfit::of);
            poll.events.extend(unfit.map(Event::NotOperating));
            continue;
        }
        for flaw in watch.settle(&mut state) {
            poll.note_left_out(&flaw, watch);
        }
        match watch.state(&state, now_ns) {
            Ok(event) => {
                poll.events.extend(event);
                if let Some(tip) = &mut state.tip {
                    *tip = tip_in_rig(tip, mount);
                }
                state.force =
                    (state.force).and_then(|force| force_in_rig(&force, state.tip.as_ref(), mount));
                poll.states.push(state);
            }
            Err(event) if watch.is_news(&event) => poll.events.push(event),
            Err(_) => {}
        }
    }
    poll.events.extend(watch.tick(now_ns));
    poll.least_delay_ns = watch.least_delay_ns();
    poll
}

/// A force in the rig's frame. One in the tool's turns with the tip, which is in the rig's frame
/// already; without an orientation nobody knows its direction.
fn force_in_rig(force: &TipForce, tip: Option<&TipState>, mount: &Mount) -> Option<TipForce> {
    if force.frame != Frame::Tool {
        return Some(mount.force_in_rig(force));
    }
    let turned = Mount {
        rotation_xyzw: tip?.orientation_xyzw?,
        ..Mount::default()
    };
    Some(turned.force_in_rig(force))
}

/// A tip in the rig's frame. One of frame 0 goes through the CRTK frame, on which the mount is
/// defined.
fn tip_in_rig(tip: &TipState, mount: &Mount) -> TipState {
    use crate::kinematics::{crtk_rotation, to_crtk};
    use nalgebra::{Quaternion, UnitQuaternion, Vector3};
    if tip.frame != Frame::Raven0 {
        return mount.tip_in_rig(tip);
    }
    let turn = |v: [f64; 3]| <[f64; 3]>::from(to_crtk(Vector3::from(v)));
    let rotation = UnitQuaternion::from_rotation_matrix(&crtk_rotation());
    mount.tip_in_rig(&TipState {
        frame: Frame::RavenCrtk,
        frame_id: tip.frame_id.clone(),
        stamp_ns: tip.stamp_ns,
        position_m: turn(tip.position_m),
        orientation_xyzw: tip.orientation_xyzw.map(|[x, y, z, w]| {
            let q = rotation * UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            [q.i, q.j, q.k, q.w]
        }),
        velocity_m_per_s: tip.velocity_m_per_s.map(turn),
        angular_velocity_rad_per_s: tip.angular_velocity_rad_per_s.map(turn),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Clock, Stamp};

    /// A robot's clock is this far from ours, ns.
    const AHEAD_NS: i64 = 1_700_000_000_000_000_000;

    fn state(stamp: (Clock, i64), came: Option<(Clock, i64)>) -> RobotState {
        let at = |(clock, t_ns)| Stamp { clock, t_ns };
        RobotState {
            publisher: "test".into(),
            sequence: None,
            stamp: at(stamp),
            received: came.map(at),
            joints: None,
            tip: Some(TipState {
                frame: Frame::Rig,
                frame_id: "".into(),
                stamp_ns: None,
                position_m: [0.1, 0.2, 0.3],
                orientation_xyzw: None,
                velocity_m_per_s: None,
                angular_velocity_rad_per_s: None,
            }),
            force: None,
            operating: None,
        }
    }

    #[test]
    fn a_pose_that_comes_late_was_there_all_the_same() {
        let mut source = Fed::new("test", WatchConfig::default());
        for n in 0..300_i64 {
            let was_ns = n * 10_000_000;
            // 2 ms on their way at least, and up to 6 ms more.
            let came_ns = was_ns + 2_000_000 + n * 7 % 5 * 1_500_000;
            source.feed([state(
                (Clock::RobotUtc, was_ns + AHEAD_NS),
                Some((Clock::HostMonotonic, came_ns)),
            )]);
            let poll = source.poll(was_ns + 9_000_000).unwrap();
            let at_ns = poll.tip_at_ns(&poll.states[0]).unwrap();
            assert!(at_ns <= came_ns, "{n}: {at_ns}");
            // One of five is not late; its block of a second has to have begun.
            assert!(n < 5 || at_ns == was_ns + 2_000_000, "{n}: {at_ns}");
        }
    }

    #[test]
    fn an_arrival_alone_is_no_time_of_a_pose_and_a_stamp_of_our_clock_is() {
        let mut source = Fed::new("test", WatchConfig::default());
        let came = (Clock::HostMonotonic, 4_000_000);
        source.feed([state(came.clone(), Some(came))]);
        source.feed([state((Clock::Virtual, 5_000_000), None)]);
        let poll = source.poll(6_000_000).unwrap();
        let times: Vec<_> = poll
            .states
            .iter()
            .map(|state| poll.tip_at_ns(state))
            .collect();
        assert_eq!(times, [None, Some(5_000_000)]);
        let mut blind = poll.states[1].clone();
        blind.tip = None;
        assert_eq!(poll.tip_at_ns(&blind), None);
    }
}
