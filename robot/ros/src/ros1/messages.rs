//! The ROS 1 messages that are used, as they are on the wire. Names, types and MD5 sums are those
//! of std_msgs, geometry_msgs, sensor_msgs, crtk_msgs and raven_2; the definitions are their public
//! interface.

pub use crate::geometry::{Pair, Pose};
use roslibrust::{MessageDescriptor, RosMessageType};
use serde::{Deserialize, Serialize};

/// `time`: seconds and nanoseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Time {
    pub secs: u32,
    pub nsecs: u32,
}

/// `duration`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Duration {
    pub secs: i32,
    pub nsecs: i32,
}

/// std_msgs/Header.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Header {
    pub seq: u32,
    pub stamp: Time,
    pub frame_id: String,
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

/// geometry_msgs/TwistStamped.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TwistStamped {
    pub header: Header,
    pub twist: Pair,
}

/// geometry_msgs/WrenchStamped.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WrenchStamped {
    pub header: Header,
    pub wrench: Pair,
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

/// crtk_msgs/OperatingState (the Raven's older `operating_state` has the same fields).
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

/// raven_2/raven_state, layout of 2023 (@d2307c5).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[allow(non_snake_case)] // the message's names
pub struct RavenState {
    pub hdr: Header,
    pub runlevel: i32,
    pub sublevel: i32,
    pub last_seq: i32,
    pub r#type: [i32; 2],
    pub pos: [i32; 6],
    pub ori: [[f32; 9]; 2],
    pub ori_d: [[f32; 9]; 2],
    pub pos_d: [i32; 6],
    pub dt: Duration,
    pub encVals: [i32; 16],
    pub dac_val: [i32; 16],
    pub tau: [f32; 16],
    pub mpos: [f32; 16],
    pub jpos: [f32; 16],
    pub mvel: [f32; 16],
    pub jvel: [f32; 16],
    pub mpos_d: [f32; 16],
    pub jpos_d: [f32; 16],
    pub grasp_d: [f32; 2],
    pub encoffsets: [f32; 16],
    pub jac_vel: [f32; 12],
    pub jac_f: [f32; 12],
}

macro_rules! message {
    ($type:ident, $name:literal, $md5:literal, $definition:expr) => {
        impl RosMessageType for $type {
            const DESCRIPTION: MessageDescriptor =
                MessageDescriptor::new::<Self>($name, $md5, $definition, $name, &[0; 32]);
        }
    };
}

message!(
    PoseStamped,
    "geometry_msgs/PoseStamped",
    "d3812c3cbc69362b77dc0b19b345f8f5",
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n"
);
message!(
    TransformStamped,
    "geometry_msgs/TransformStamped",
    "b5764a33bfeb3588febc2682852579b0",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
);
message!(
    TwistStamped,
    "geometry_msgs/TwistStamped",
    "98d34b0043a2093cf9d9345ab6eef12e",
    "std_msgs/Header header\ngeometry_msgs/Twist twist\n"
);
message!(
    WrenchStamped,
    "geometry_msgs/WrenchStamped",
    "d78d3cb249ce23087ade7e7d0c40cfa7",
    WRENCH_STAMPED
);
message!(
    JointState,
    "sensor_msgs/JointState",
    "3066dcd76a6cfaef579bd0f34173e9fd",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
);
message!(
    OperatingState,
    "crtk_msgs/OperatingState",
    "b1bd4021639d9d9c5fbfff78d6ff3158",
    OPERATING_STATE
);
message!(
    StringStamped,
    "crtk_msgs/StringStamped",
    "5e3e46086181199270f1ac3a28a5977f",
    "std_msgs/Header header\nstring string\n"
);
message!(
    RavenState,
    "raven_2/raven_state",
    "ce9e7f4969049d8bb365de3c98461a01",
    "Header hdr\n"
);

const OPERATING_STATE: &str = "\
std_msgs/Header header
string state
bool is_homed
bool is_busy

================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
";

/// What we publish goes into bags with its whole definition, so that they can be read without the
/// package.
const WRENCH_STAMPED: &str = "\
Header header
Wrench wrench

================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id

================================================================================
MSG: geometry_msgs/Wrench
Vector3  force
Vector3  torque

================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
";
