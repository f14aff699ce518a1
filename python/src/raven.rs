//! Kinematics of the Raven-II's left arm.

use crate::usage;
use nalgebra::Vector3;
use pyo3::prelude::*;
use robot::kinematics as arm;

/// Refuses joints that are no numbers, in words as those of a position.
fn finite<const N: usize>(what: &str, values: [f64; N]) -> PyResult<[f64; N]> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(values),
        Some(at) => Err(usage(format!(
            "{what} {} is {}: give finite numbers",
            at + 1,
            values[at]
        ))),
    }
}

/// Position of the tip, m, and its orientation, in frame 0.
#[pyfunction]
pub fn forward(joints: [f64; 6]) -> PyResult<([f64; 3], [[f64; 3]; 3])> {
    let pose = arm::forward(&finite("joint", joints)?);
    let rotation = pose.rotation.matrix();
    let rows = std::array::from_fn(|r| std::array::from_fn(|c| rotation[(r, c)]));
    Ok((pose.position_m.into(), rows))
}

/// Geometric Jacobian of the tip in frame 0.
#[pyfunction]
pub fn jacobian(joints: [f64; 6]) -> PyResult<[[f64; 6]; 6]> {
    let jacobian = arm::jacobian(&finite("joint", joints)?);
    Ok(std::array::from_fn(|r| {
        std::array::from_fn(|c| jacobian[(r, c)])
    }))
}

/// The first three joints for a position of the tip.
#[pyfunction]
pub fn inverse(position_m: [f64; 3], tool: [f64; 3]) -> PyResult<[f64; 3]> {
    arm::inverse(position_m.into(), finite("tool joint", tool)?).map_err(usage)
}

/// Motor angles for the first three joints.
#[pyfunction]
pub fn motors_from_joints(joints: [f64; 3]) -> PyResult<[f64; 3]> {
    Ok(arm::motors_from_joints(finite("joint", joints)?))
}

/// The first three joints for motor angles.
#[pyfunction]
pub fn joints_from_motors(motors_rad: [f64; 3]) -> PyResult<[f64; 3]> {
    Ok(arm::joints_from_motors(finite("motor", motors_rad)?))
}

/// A vector of frame 0 in the CRTK frame.
#[pyfunction]
pub fn to_crtk(vector: [f64; 3]) -> [f64; 3] {
    arm::to_crtk(Vector3::from(vector)).into()
}

/// A vector of the CRTK frame in frame 0.
#[pyfunction]
pub fn from_crtk(vector: [f64; 3]) -> [f64; 3] {
    arm::from_crtk(Vector3::from(vector)).into()
}

/// Names of the joints, their limits, and home.
#[pyfunction]
pub fn limits() -> ([&'static str; 6], [(f64, f64); 6], [f64; 6]) {
    (arm::JOINT_NAMES, arm::LIMITS, arm::HOME)
}
