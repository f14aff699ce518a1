//! Units of angles.

/// Radians per unit, if `unit` is an angle.
pub fn radians(unit: &str) -> Option<f64> {
    match unit.trim() {
        "rad" | "radian" | "radians" => Some(1.0),
        "deg" | "degree" | "degrees" | "°" => Some(std::f64::consts::PI / 180.0),
        "rev" | "turn" | "turns" => Some(std::f64::consts::TAU),
        "mrad" => Some(1e-3),
        _ => None,
    }
}
