//! Parts of geometry_msgs that ROS 1 and ROS 2 have in common, as they are on the wire.

use robot::crtk;
use serde::{Deserialize, Serialize};

/// geometry_msgs/Vector3 and Point.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

impl From<Vector3> for [f64; 3] {
    fn from(v: Vector3) -> Self {
        [v.x, v.y, v.z]
    }
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

/// geometry_msgs/Quaternion.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

/// geometry_msgs/Pose, and geometry_msgs/Transform, which has the same layout.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    pub position: Vector3,
    pub orientation: Quaternion,
}

/// The linear and angular part of a geometry_msgs/Twist, the force and torque of a Wrench.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pair {
    pub linear: Vector3,
    pub angular: Vector3,
}

impl From<Pose> for crtk::Pose {
    fn from(pose: Pose) -> Self {
        let q = pose.orientation;
        Self {
            position_m: pose.position.into(),
            orientation_xyzw: [q.x, q.y, q.z, q.w],
        }
    }
}

impl From<Pair> for crtk::Pair {
    fn from(pair: Pair) -> Self {
        Self {
            linear: pair.linear.into(),
            angular: pair.angular.into(),
        }
    }
}
