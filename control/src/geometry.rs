//! Cable geometry of the thesis, section 3.7, generic over the number type: the host computes in
//! `f64`, a board that has an FPU may in `f32`. Not in the sample path.
//!
//! Only the host calls it: the board gets directions with the setpoints, and [`crate::tip`] adds
//! the forces up.
//!
//! All points and directions are in the robot's base frame (metre, or unit length).

use nalgebra::{RealField, Vector3};

/// Direction from the tip to the point where the cable meets the reel, of unit length:
/// V = (P_unit - P_tip) / |P_unit - P_tip|. `None` where the two are closer than 1 mm (or not
/// finite): there is no direction then.
#[must_use]
pub fn cable_direction<T: RealField + Copy>(
    unit: Vector3<T>,
    tip: Vector3<T>,
) -> Option<Vector3<T>> {
    let span = unit - tip;
    let length = span.norm();
    let shortest = nalgebra::convert::<f64, T>(1e-3);
    // Written so that NaN ends in None.
    if length >= shortest && length.is_finite() {
        Some(span / length)
    } else {
        None
    }
}

/// Cosine of the angle between cable and load-cell axis: V . A / (|V| |A|), in -1 to 1. `None`
/// where one of them has no length.
#[must_use]
pub fn cos_cell_angle<T: RealField + Copy>(cable: Vector3<T>, axis: Vector3<T>) -> Option<T> {
    let lengths = cable.norm() * axis.norm();
    if lengths > T::default_epsilon() && lengths.is_finite() {
        let one = T::one();
        Some((cable.dot(&axis) / lengths).clamp(-one, one))
    } else {
        None
    }
}

/// Tension of a cable from the force its load cell reads: T = F / cos theta.
#[must_use]
pub fn tension<T: RealField + Copy>(cell_force: T, cos: T) -> T {
    cell_force / cos
}

/// Load-cell force of a cable's tension: F = T cos theta.
#[must_use]
pub fn cell_force<T: RealField + Copy>(tension: T, cos: T) -> T {
    tension * cos
}

/// Force that the cables apply at the tip: the sum of T_i V_i. Directions without a tension, and
/// tensions without a direction, are left out.
#[must_use]
pub fn applied_force<T: RealField + Copy>(directions: &[Vector3<T>], tensions: &[T]) -> Vector3<T> {
    directions
        .iter()
        .zip(tensions)
        .fold(Vector3::zeros(), |sum, (direction, &tension)| {
            sum + *direction * tension
        })
}

/// 1 / cos as the wire carries it (times 65,536, rounded). `None` where the cable stands 75.5
/// degrees or more off the axis: 1 / cos is above 4 and the cell hardly sees the cable.
#[must_use]
pub fn inv_cos_q16<T: RealField + Copy>(cos: T) -> Option<i32> {
    let quarter = nalgebra::convert::<f64, T>(0.25);
    if cos >= quarter && cos <= T::one() {
        let scaled = nalgebra::convert::<f64, T>(65_536.0) / cos;
        nalgebra::try_convert::<T, f64>(scaled).map(|q16| libm::round(q16) as i32)
    } else {
        None
    }
}

/// A direction as the wire carries it (unit vector times 16,384, rounded); zero where it is none.
#[must_use]
pub fn direction_q14<T: RealField + Copy>(direction: &Vector3<T>) -> [i16; 3] {
    let one = f64::from(wire::message::DIRECTION_ONE);
    direction
        .map(|component| {
            nalgebra::try_convert::<T, f64>(component).map_or(0, |v| libm::round(v * one) as i16)
        })
        .into()
}

/// The angle of a cosine in degrees, for display and warnings only: micromath's polynomial is right
/// to 0.5 degrees and ten times faster than an exact one.
#[must_use]
pub fn angle_deg(cos: f32) -> f32 {
    micromath::F32Ext::acos(cos.clamp(-1.0, 1.0)).to_degrees()
}
