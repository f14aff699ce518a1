//! Vectors of three numbers.

/// A point or direction in the robot frame: x, y, z.
pub type Vec3 = [f64; 3];

pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: Vec3, k: f64) -> Vec3 {
    [a[0] * k, a[1] * k, a[2] * k]
}

pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn unit(a: Vec3) -> Vec3 {
    scale(a, 1.0 / norm(a))
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Two directions that make a right-handed frame with the unit vector `axis`.
fn perpendicular(axis: Vec3) -> (Vec3, Vec3) {
    // Start from the coordinate axis that `axis` has least of: never near parallel.
    let mut helper = [0.0; 3];
    let least = (0..3).min_by(|&i, &j| axis[i].abs().total_cmp(&axis[j].abs()));
    helper[least.unwrap_or(0)] = 1.0;
    let first = unit(cross(axis, helper));
    (first, cross(axis, first))
}

/// `axis` tilted by two small angles in rad about its two perpendicular directions.
pub(crate) fn tilted(axis: Vec3, tilt_rad: [f64; 2]) -> Vec3 {
    let (first, second) = perpendicular(axis);
    unit(add(
        axis,
        add(
            scale(first, libm::tan(tilt_rad[0])),
            scale(second, libm::tan(tilt_rad[1])),
        ),
    ))
}
