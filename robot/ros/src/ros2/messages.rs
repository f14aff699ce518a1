//! The ROS 2 messages that are used, as they are on the wire (CDR). Names and fields are those of
//! std_msgs, geometry_msgs, sensor_msgs and crtk_msgs; the definitions are their public interface.

use crate::geometry::{Pair, Pose};
use robot::crtk;
use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// builtin_interfaces/Time: since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    pub sec: i32,
    pub nanosec: u32,
}

/// std_msgs/Header.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

impl From<&Header> for crtk::Header {
    fn from(header: &Header) -> Self {
        Self {
            seq: None,
            stamp_ns: i64::from(header.stamp.sec) * 1_000_000_000 + i64::from(header.stamp.nanosec),
            frame_id: header.frame_id.clone(),
        }
    }
}

/// sensor_msgs/JointState.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct JointState {
    pub header: Header,
    pub name: Vec<String>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

impl From<JointState> for crtk::Joints {
    fn from(message: JointState) -> Self {
        Self {
            name: message.name,
            position: message.position,
            velocity: message.velocity,
            effort: message.effort,
        }
    }
}

/// geometry_msgs/PoseStamped.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseStamped {
    pub header: Header,
    pub pose: Pose,
}

/// geometry_msgs/TransformStamped.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TransformStamped {
    pub header: Header,
    pub child_frame_id: String,
    pub transform: Pose,
}

/// geometry_msgs/TwistStamped and WrenchStamped: the same layout.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PairStamped {
    pub header: Header,
    pub pair: Pair,
}

/// crtk_msgs/OperatingState.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct OperatingState {
    pub header: Header,
    pub state: String,
    pub is_homed: bool,
    pub is_busy: bool,
}

/// crtk_msgs/StringStamped.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StringStamped {
    pub header: Header,
    pub string: String,
}

impl Message for StringStamped {}
impl Message for JointState {}
impl Message for PoseStamped {}
impl Message for TransformStamped {}
impl Message for PairStamped {}
impl Message for OperatingState {}
