//! The little vector arithmetic the host needs: plain arrays, robot base frame.

/// A point in metres, a force in newtons or a direction: x, y, z in the robot's base frame.
pub type Vec3 = [f64; 3];

/// `a + b`.
#[must_use]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[must_use]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `k a`.
#[must_use]
pub fn scale(a: Vec3, k: f64) -> Vec3 {
    [a[0] * k, a[1] * k, a[2] * k]
}

/// Scalar product.
#[must_use]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Length.
#[must_use]
pub fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// `a` shortened to `length` where it is longer.
#[must_use]
pub fn limited(a: Vec3, length: f64) -> Vec3 {
    let n = norm(a);
    if n > length {
        scale(a, length / n)
    } else {
        a
    }
}

/// `a / |a|`; `None` where the length is zero or not finite.
#[must_use]
pub fn unit(a: Vec3) -> Option<Vec3> {
    let n = norm(a);
    (n.is_finite() && n > 0.0).then(|| scale(a, 1.0 / n))
}
