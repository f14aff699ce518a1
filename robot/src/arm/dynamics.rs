//! Rigid-body dynamics of the first three joints: inertia, gravity, velocity terms, and what the
//! tip does to the joints.
//!
//! The links are point masses at the published centres of mass plus a constant inertia of each
//! joint, chosen so that the diagonal at home is the published one (M11 0.216, M22 0.100 kg·m², M33
//! 0.407 kg; raven2_sim). So the velocity terms are exact for this body, and energy is conserved.
//! The tool is straight: roll, wrist and jaws stand at zero.

use nalgebra::{Matrix3, Vector3};

/// Gravity along -x of frame 0, m/s² (raven2, grav_comp).
pub const GRAVITY: f64 = 9.8;
/// Masses of the gravity model, kg (raven2, grav_comp).
pub const MASS_KG: [f64; 3] = [0.494, 0.750, 0.231];
/// Centres of mass in the links' frames, m (raven2, grav_comp).
const COM_M: [[f64; 3]; 3] = [
    [0.0065, 0.097_75, -0.137_71],
    [-0.002, -0.182_74, -0.230_53],
    [0.0, 0.0, 0.0],
];
/// Published diagonal of the inertia at home.
const HOME_INERTIA: [f64; 3] = [0.216, 0.100, 0.407];
/// From the origin of frame 3 back to the tip along the insertion axis, m: 0.47 + 0.013.
const TOOL_M: f64 = 0.483;

const DEG: f64 = std::f64::consts::PI / 180.0;

/// Axes of the joints and places of the masses at one position.
#[derive(Debug, Clone, Copy)]
pub struct Geometry {
    /// Axes of joints 1 to 3 in frame 0.
    axis: [Vector3<f64>; 3],
    /// Centres of mass in frame 0.
    com_m: [Vector3<f64>; 3],
    /// Tip in frame 0.
    pub tip_m: Vector3<f64>,
}

/// Constants of the chain.
#[derive(Debug, Clone)]
pub struct Body {
    sin_cos_75: (f64, f64),
    sin_cos_128: (f64, f64),
    mass_kg: [f64; 3],
    /// Point mass at the tip, kg.
    payload_kg: f64,
    extra: [f64; 3],
}

impl Body {
    /// A body with these masses, kg.
    #[must_use]
    pub fn new(mass_kg: [f64; 3]) -> Self {
        let mut body = Self {
            sin_cos_75: libm::sincos(75.0 * DEG),
            sin_cos_128: libm::sincos(128.0 * DEG),
            mass_kg: MASS_KG,
            payload_kg: 0.0,
            extra: [0.0; 3],
        };
        let home = [30.0 * DEG, 90.0 * DEG, 0.4];
        let points = body.inertia(&body.geometry(home));
        body.extra = core::array::from_fn(|i| HOME_INERTIA[i] - points[(i, i)]);
        body.mass_kg = mass_kg;
        body
    }

    /// The same body with a point mass at its tip, kg.
    #[must_use]
    pub fn with_payload(mut self, payload_kg: f64) -> Self {
        self.payload_kg = payload_kg;
        self
    }

    /// Masses with their places: the links' and the payload, each with the link that it moves with.
    fn points(&self, g: &Geometry) -> [(usize, Vector3<f64>, f64); 4] {
        let [first, second, third] = g.com_m;
        let [m1, m2, m3] = self.mass_kg;
        [
            (0, first, m1),
            (1, second, m2),
            (2, third, m3),
            (2, g.tip_m, self.payload_kg),
        ]
    }

    /// Tip and insertion axis alone: what the tip needs at every step.
    #[inline]
    #[must_use]
    pub fn tip(&self, q: [f64; 3]) -> Vector3<f64> {
        let (sa, ca) = libm::sincos(q[0] + 205.0 * DEG);
        let (sb, cb) = libm::sincos(q[1] + 180.0 * DEG);
        self.insertion_axis(sa, ca, sb, cb) * (q[2] - TOOL_M)
    }

    #[inline]
    fn insertion_axis(&self, sa: f64, ca: f64, sb: f64, cb: f64) -> Vector3<f64> {
        let ((s1, c1), (s2, c2)) = (self.sin_cos_75, self.sin_cos_128);
        let (x, y) = (s2 * sb, -c1 * s2 * cb - s1 * c2);
        Vector3::new(ca * x - sa * y, sa * x + ca * y, c1 * c2 - s1 * s2 * cb)
    }

    /// Axes and places at these joints (rad, rad, m).
    #[must_use]
    pub fn geometry(&self, q: [f64; 3]) -> Geometry {
        let (sa, ca) = libm::sincos(q[0] + 205.0 * DEG);
        let (sb, cb) = libm::sincos(q[1] + 180.0 * DEG);
        let (s1, c1) = self.sin_cos_75;
        let about_z = |v: Vector3<f64>| Vector3::new(ca * v.x - sa * v.y, sa * v.x + ca * v.y, v.z);
        // Rz(a) Rx(75), then Rz(b).
        let link2 = |v: [f64; 3]| {
            let (x, y, z) = (cb * v[0] - sb * v[1], sb * v[0] + cb * v[1], v[2]);
            about_z(Vector3::new(x, c1 * y - s1 * z, s1 * y + c1 * z))
        };
        let axis3 = self.insertion_axis(sa, ca, sb, cb);
        Geometry {
            axis: [Vector3::z(), about_z(Vector3::new(0.0, -s1, c1)), axis3],
            com_m: [
                about_z(Vector3::from(COM_M[0])),
                link2(COM_M[1]),
                // The published centre of the third link is its frame's origin.
                axis3 * q[2],
            ],
            tip_m: axis3 * (q[2] - TOOL_M),
        }
    }

    /// Columns of the Jacobian of a point that moves with link `link` (from 0).
    #[inline]
    fn columns(g: &Geometry, point_m: Vector3<f64>, link: usize) -> Matrix3<f64> {
        let mut jacobian = Matrix3::zeros();
        jacobian.set_column(0, &g.axis[0].cross(&point_m));
        if link >= 1 {
            jacobian.set_column(1, &g.axis[1].cross(&point_m));
        }
        if link >= 2 {
            jacobian.set_column(2, &g.axis[2]);
        }
        jacobian
    }

    /// Velocity of the tip per joint velocity.
    #[must_use]
    pub fn tip_jacobian(g: &Geometry) -> Matrix3<f64> {
        Self::columns(g, g.tip_m, 2)
    }

    /// Inertia matrix.
    #[must_use]
    pub fn inertia(&self, g: &Geometry) -> Matrix3<f64> {
        let mut inertia = Matrix3::from_diagonal(&Vector3::from(self.extra));
        for (link, place, mass_kg) in self.points(g) {
            let j = Self::columns(g, place, link);
            inertia += j.transpose() * j * mass_kg;
        }
        inertia
    }

    /// Torques that hold the links against gravity.
    #[must_use]
    pub fn gravity(&self, g: &Geometry) -> Vector3<f64> {
        let mut torque = Vector3::zeros();
        for (link, place, mass_kg) in self.points(g) {
            let j = Self::columns(g, place, link);
            torque += j.row(0).transpose() * (mass_kg * GRAVITY);
        }
        torque
    }

    /// Potential energy, J.
    #[must_use]
    pub fn potential_j(&self, g: &Geometry) -> f64 {
        (self.points(g).iter())
            .map(|(_, place, mass_kg)| mass_kg * GRAVITY * place.x)
            .sum()
    }

    /// Torques of the velocity terms (centrifugal, Coriolis) at joint velocities `v`.
    #[must_use]
    pub fn velocity_terms(&self, g: &Geometry, v: Vector3<f64>) -> Vector3<f64> {
        let (w1, w2) = (g.axis[0] * v[0], g.axis[1] * v[1]);
        let turning = w1.cross(&w2);
        let mut torque = Vector3::zeros();
        for (link, p, mass_kg) in self.points(g) {
            let w = if link == 0 { w1 } else { w1 + w2 };
            let mut acceleration = w.cross(&w.cross(&p));
            if link >= 1 {
                acceleration += turning.cross(&p);
            }
            if link == 2 {
                acceleration += w.cross(&(g.axis[2] * v[2])) * 2.0;
            }
            let j = Self::columns(g, p, link);
            torque += j.transpose() * acceleration * mass_kg;
        }
        torque
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{forward, position_jacobian, HOME};

    fn body() -> Body {
        Body::new(MASS_KG)
    }

    #[test]
    fn the_tip_and_its_jacobian_are_those_of_the_kinematics() {
        let body = body();
        for n in 0..50 {
            let q = [
                0.03 * f64::from(n),
                0.8 + 0.02 * f64::from(n),
                0.25 + 0.004 * f64::from(n),
            ];
            let full = [q[0], q[1], q[2], 0.0, 0.0, 0.0];
            let g = body.geometry(q);
            assert!((g.tip_m - forward(&full).position_m).norm() < 1e-12);
            assert!((body.tip(q) - g.tip_m).norm() < 1e-15);
            assert!((Body::tip_jacobian(&g) - position_jacobian(&full)).norm() < 1e-12);
        }
    }

    #[test]
    fn gravity_at_home_is_what_the_ravens_software_commands() {
        // -0.14 N·m, -0.43 N·m, 2.13 N.
        let body = body();
        let gravity = body.gravity(&body.geometry([HOME[0], HOME[1], HOME[2]]));
        for (got, published) in gravity.iter().zip([-0.14, -0.43, 2.13]) {
            assert!((got - published).abs() < 6e-3, "{gravity}");
        }
    }

    #[test]
    fn gravity_over_the_shoulders_range_is_the_published_one() {
        // Shoulder: +1.55 N·m at 0 degrees, -1.79 at 60 (elbow and insertion at home).
        let body = body();
        for (degrees, published) in [(0.0, 1.55), (60.0, -1.79)] {
            let torque = body.gravity(&body.geometry([degrees * DEG, HOME[1], HOME[2]]))[0];
            assert!((torque - published).abs() < 0.01, "{torque} at {degrees}");
        }
    }

    #[test]
    fn inertia_at_home_is_the_published_one_and_positive_everywhere() {
        let body = body();
        let home = body.inertia(&body.geometry([HOME[0], HOME[1], HOME[2]]));
        for (i, published) in HOME_INERTIA.into_iter().enumerate() {
            assert!((home[(i, i)] - published).abs() < 1e-12);
        }
        assert!(
            body.extra.iter().all(|extra| *extra > 0.0),
            "{:?}",
            body.extra
        );
    }

    #[test]
    fn a_payload_weighs_at_the_tip() {
        let (bare, loaded) = (body(), body().with_payload(0.05));
        let g = bare.geometry([0.6, 1.4, 0.36]);
        let more = loaded.gravity(&g) - bare.gravity(&g);
        let weight = Vector3::new(-0.05 * GRAVITY, 0.0, 0.0);
        assert!((more + Body::tip_jacobian(&g).tr_mul(&weight)).norm() < 1e-12);
    }

    #[test]
    fn velocity_terms_are_those_of_lagranges_equation() {
        // d/dt(M v) - 1/2 grad(v' M v), by differences.
        let body = body().with_payload(0.1);
        let inertia = |q: [f64; 3]| body.inertia(&body.geometry(q));
        let h = 1e-6;
        for n in 0..20 {
            let q = [
                0.05 * f64::from(n),
                1.0 + 0.03 * f64::from(n),
                0.3 + 0.01 * f64::from(n),
            ];
            let v = Vector3::new(0.7, -0.4, 0.2);
            let gradient = |i: usize| {
                let (mut up, mut down) = (q, q);
                up[i] += h;
                down[i] -= h;
                (inertia(up) - inertia(down)) / (2.0 * h)
            };
            let rate = gradient(0) * v[0] + gradient(1) * v[1] + gradient(2) * v[2];
            let expected =
                rate * v - Vector3::from_fn(|i, _| 0.5 * (v.transpose() * gradient(i) * v)[0]);
            let got = body.velocity_terms(&body.geometry(q), v);
            assert!((got - expected).norm() < 1e-8, "{got} {expected}");
        }
    }
}
