//! Kinematics of the Raven-II's left (gold) arm: forward, inverse, Jacobian, limits, coupling of
//! the motors.
//!
//! Modified Denavit-Hartenberg: `T_i = Rx(alpha_(i-1)) Tx(a_(i-1)) Rz(theta_i) Tz(d_i)`. Frame 0
//! stands at the remote centre of motion, gravity along its -x. Joints 1, 2 (shoulder, elbow) in
//! rad, joint 3 (insertion) in m; roll, wrist and the jaws' mean in rad. Source of all figures:
//! uw-biorobotics/raven2, `r2_kinematics`, `defines.h`, `tools.cpp`.
//!
//! Two frames are in use. *Frame 0* is that of the kinematics and of `ravenstate`; the *CRTK frame*
//! is what the arm's CRTK topics report: `x = -y0, y = -z0, z = x0`, gravity along -z.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Joint positions: shoulder rad, elbow rad, insertion m, roll, wrist, jaws' mean rad.
pub type Joints = [f64; 6];

/// A row of the table: angle and offset before the joint, then the joint's own constants.
struct Row {
    alpha_rad: f64,
    a_m: f64,
    d_m: f64,
    theta_rad: f64,
}

const DEG: f64 = PI / 180.0;

/// Modified DH table of the left arm; joint variables are added to `theta_rad` (joint 3: to `d_m`).
const TABLE: [Row; 6] = [
    Row {
        alpha_rad: 0.0,
        a_m: 0.0,
        d_m: 0.0,
        theta_rad: 205.0 * DEG,
    },
    Row {
        alpha_rad: 75.0 * DEG,
        a_m: 0.0,
        d_m: 0.0,
        theta_rad: PI,
    },
    Row {
        alpha_rad: 128.0 * DEG,
        a_m: 0.0,
        d_m: 0.0,
        theta_rad: FRAC_PI_2,
    },
    Row {
        alpha_rad: 0.0,
        a_m: 0.0,
        d_m: -0.47,
        theta_rad: 0.0,
    },
    Row {
        alpha_rad: FRAC_PI_2,
        a_m: 0.0,
        d_m: 0.0,
        theta_rad: -FRAC_PI_2,
    },
    Row {
        alpha_rad: FRAC_PI_2,
        a_m: 0.013,
        d_m: 0.0,
        theta_rad: 0.0,
    },
];

/// Lower and upper limits of the joints, in their units.
pub const LIMITS: [(f64, f64); 6] = [
    (0.0, FRAC_PI_2),
    (45.0 * DEG, 135.0 * DEG),
    (0.23, 0.56),
    (-182.0 * DEG, 182.0 * DEG),
    (-70.0 * DEG, 70.0 * DEG),
    (-105.0 * DEG, 105.0 * DEG),
];

/// Home: 30 degrees, 90 degrees, 0.4 m, tool straight.
pub const HOME: Joints = [30.0 * DEG, FRAC_PI_2, 0.4, 0.0, 0.0, 0.0];

/// Names of the joints as the arm's CRTK topics and our files use them.
pub const JOINT_NAMES: [&str; 6] = ["shoulder", "elbow", "insertion", "roll", "wrist", "jaws"];

/// Motor angle per joint travel without coupling: rad/rad, rad/rad, rad/m.
pub const TRANSMISSION: [f64; 3] = [136.20, 121.52, 2158.6];

/// How the first joints turn the motors of the later ones, in units of the later joint.
///
/// `motor = TRANSMISSION * (COUPLING * joint)`: m2 turns with q2 + 0.14545 q1, m3 with
/// q3 + 0.0077974 q1 + 0.0080774 q2 (m per rad).
pub const COUPLING: [[f64; 3]; 3] = [
    [1.0, 0.0, 0.0],
    [0.145_45, 1.0, 0.0],
    [0.007_797_4, 0.008_077_4, 1.0],
];

/// Motor angles in rad for the first three joints.
#[must_use]
pub fn motors_from_joints(q: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| TRANSMISSION[i] * (0..3).map(|k| COUPLING[i][k] * q[k]).sum::<f64>())
}

/// The first three joints for motor angles in rad: the inverse of [`motors_from_joints`].
#[must_use]
pub fn joints_from_motors(m: [f64; 3]) -> [f64; 3] {
    let mut q = [0.0; 3];
    for i in 0..3 {
        let others: f64 = (0..i).map(|k| COUPLING[i][k] * q[k]).sum();
        q[i] = m[i] / TRANSMISSION[i] - others;
    }
    q
}

/// Where the tool's tip is, and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPose {
    /// Position, frame 0, m.
    pub position_m: Vector3<f64>,
    /// Orientation of frame 6 in frame 0.
    pub rotation: Rotation3<f64>,
}

fn about_x(angle_rad: f64) -> Rotation3<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    #[rustfmt::skip]
    let matrix = Matrix3::new(1.0, 0.0, 0.0,  0.0, cos, -sin,  0.0, sin, cos);
    Rotation3::from_matrix_unchecked(matrix)
}

fn about_z(angle_rad: f64) -> Rotation3<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    #[rustfmt::skip]
    let matrix = Matrix3::new(cos, -sin, 0.0,  sin, cos, 0.0,  0.0, 0.0, 1.0);
    Rotation3::from_matrix_unchecked(matrix)
}

/// Frames 1 to 6 in frame 0.
fn frames(q: &Joints) -> [TipPose; 6] {
    let mut rotation = Rotation3::identity();
    let mut position_m = Vector3::zeros();
    core::array::from_fn(|i| {
        let row = &TABLE[i];
        let (theta, d) = if i == 2 {
            (row.theta_rad, row.d_m + q[2])
        } else {
            (row.theta_rad + q[i], row.d_m)
        };
        rotation *= about_x(row.alpha_rad);
        position_m += rotation * Vector3::new(row.a_m, 0.0, 0.0);
        rotation *= about_z(theta);
        position_m += rotation * Vector3::new(0.0, 0.0, d);
        TipPose {
            position_m,
            rotation,
        }
    })
}

/// Pose of the tool's tip (origin of frame 6) in frame 0.
#[must_use]
pub fn forward(q: &Joints) -> TipPose {
    frames(q)[5]
}

/// Geometric Jacobian of the tip in frame 0: rows 0 to 2 its velocity in m/s, rows 3 to 5 its
/// angular velocity in rad/s, one column for each joint.
#[must_use]
pub fn jacobian(q: &Joints) -> Matrix6<f64> {
    let frames = frames(q);
    let tip = frames[5].position_m;
    let mut jacobian = Matrix6::zeros();
    for (i, frame) in frames.iter().enumerate() {
        let axis = frame.rotation * Vector3::z();
        let (linear, angular) = if i == 2 {
            (axis, Vector3::zeros())
        } else {
            (axis.cross(&(tip - frame.position_m)), axis)
        };
        jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&linear);
        jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&angular);
    }
    jacobian
}

/// The first three columns of [`jacobian`]'s velocity: what the first three joints do to the tip.
#[must_use]
pub fn position_jacobian(q: &Joints) -> Matrix3<f64> {
    jacobian(q).fixed_view::<3, 3>(0, 0).into_owned()
}

/// Why no joints reach a position.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// Not a position.
    #[error("the position [{0}, {1}, {2}] m is not finite")]
    NotFinite(f64, f64, f64),
    /// The direction from the remote centre is none that the shoulder and elbow can point to.
    #[error("the position [{x:.4}, {y:.4}, {z:.4}] m (frame 0) is in a direction from the remote centre that shoulder and elbow can't point the tool to")]
    Direction {
        /// m.
        x: f64,
        /// m.
        y: f64,
        /// m.
        z: f64,
    },
    /// The joints that reach it are past their limits.
    #[error("the position needs joint {joint} at {value:.4} (rad or m), allowed are {min:.4} to {max:.4}")]
    Limit {
        /// Joint from 1.
        joint: usize,
        /// Needed.
        value: f64,
        /// Lower limit.
        min: f64,
        /// Upper limit.
        max: f64,
    },
}

/// The first three joints that bring the tip to `position_m` (frame 0), with roll, wrist and jaws
/// as given. The solution within the joint limits is taken.
///
/// # Errors
/// [`InverseError`]: no joints reach it, or none within their limits.
pub fn inverse(position_m: Vector3<f64>, tool: [f64; 3]) -> Result<[f64; 3], InverseError> {
    let [x, y, z] = position_m.into();
    if !position_m.iter().all(|v| v.is_finite()) {
        return Err(InverseError::NotFinite(x, y, z));
    }
    let direction = InverseError::Direction { x, y, z };
    // The candidate that is least past its limits explains most.
    let mut best: Option<(f64, InverseError)> = None;
    for (side, sign) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        let Some(start) = straight(position_m, side, sign) else {
            continue;
        };
        let Some(q) = refine(position_m, start, tool) else {
            continue;
        };
        match past_limits(q) {
            None => return Ok(q),
            Some(limit) if best.is_none_or(|(least, _)| limit.0 < least) => best = Some(limit),
            Some(_) => {}
        }
    }
    Err(best.map_or(direction, |(_, limit)| limit))
}

/// The joint that is furthest past its limits, by more than rounding, with the excess as a part of
/// its range.
fn past_limits(q: [f64; 3]) -> Option<(f64, InverseError)> {
    const SLACK: f64 = 1e-9;
    let past = |i: usize| {
        let (min, max) = LIMITS[i];
        let excess = (min - q[i]).max(q[i] - max) / (max - min);
        let limit = InverseError::Limit {
            joint: i + 1,
            value: q[i],
            min,
            max,
        };
        (excess > SLACK).then_some((excess, limit))
    };
    (0..3).filter_map(past).max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Exact solution for a straight tool: the tip is on the insertion axis then, at 0.483 m - q3
/// beyond the remote centre. `side` is -1 for a tool that is drawn back past the centre; `sign`
/// chooses between the elbow's two angles.
fn straight(position_m: Vector3<f64>, side: f64, sign: f64) -> Option<[f64; 3]> {
    let reach = position_m.norm();
    if reach < 1e-6 {
        return None;
    }
    let axis = -position_m * (side / reach);
    // axis = Rz(a) Rx(75) Rz(b) Rx(128) z, with a = q1 + 205, b = q2 + 180 degrees.
    let (s1, c1) = libm::sincos(TABLE[1].alpha_rad);
    let (s2, c2) = libm::sincos(TABLE[2].alpha_rad);
    let cos_b = (c1 * c2 - axis.z) / (s1 * s2);
    if cos_b.abs() > 1.0 {
        return None;
    }
    let b = sign * libm::acos(cos_b);
    // Before Rz(a): x = s2 sin b, y = -c1 s2 cos b - s1 c2.
    let (sin_b, cos_b) = libm::sincos(b);
    let (x, y) = (s2 * sin_b, -c1 * s2 * cos_b - s1 * c2);
    let a = libm::atan2(axis.y, axis.x) - libm::atan2(y, x);
    let wrapped = |angle: f64| (angle + PI).rem_euclid(2.0 * PI) - PI;
    Some([
        wrapped(a - TABLE[0].theta_rad),
        wrapped(b - TABLE[1].theta_rad),
        TABLE[5].a_m - TABLE[3].d_m - side * reach,
    ])
}

/// Newton's method from `start`; `None` where it does not settle.
fn refine(position_m: Vector3<f64>, start: [f64; 3], tool: [f64; 3]) -> Option<[f64; 3]> {
    let mut q: Joints = [start[0], start[1], start[2], tool[0], tool[1], tool[2]];
    for _ in 0..30 {
        let error = position_m - forward(&q).position_m;
        if error.norm() < 1e-12 {
            break;
        }
        let step = position_jacobian(&q).lu().solve(&error)?;
        for i in 0..3 {
            q[i] += step[i];
        }
    }
    let error = (position_m - forward(&q).position_m).norm();
    (error < 1e-9).then_some([q[0], q[1], q[2]])
}

/// A vector of frame 0 in the CRTK frame.
#[must_use]
pub fn to_crtk(v: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-v.y, -v.z, v.x)
}

/// A vector of the CRTK frame in frame 0.
#[must_use]
pub fn from_crtk(v: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.z, -v.x, -v.y)
}

/// Rotation from frame 0 to the CRTK frame.
#[must_use]
pub fn crtk_rotation() -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(Matrix3::new(
        0.0, -1.0, 0.0, //
        0.0, 0.0, -1.0, //
        1.0, 0.0, 0.0,
    ))
}
