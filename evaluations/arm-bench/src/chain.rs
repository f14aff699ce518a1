//! An arm as a chain of links: where they are, and the efforts that move them.
//!
//! The efforts are linear in ten numbers of each link: mass, mass times centre of mass (3), and
//! moments of inertia about the link's frame (6). So masses and inertias are found by least
//! squares.

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};

/// Numbers of a link.
pub const OF_LINK: usize = 10;
/// What holds the arm up, m/s^2: an arm at rest feels it as an acceleration upwards.
pub const UP: Vector3<f64> = Vector3::new(0.0, 0.0, 9.81);

/// A joint and the link that it moves: from the link before by a fixed turn and way, then about or
/// along the own z axis.
#[derive(Debug, Clone, Copy)]
pub struct Joint {
    /// Turn from the link before.
    pub turn: Matrix3<f64>,
    /// Way in the frame of the link before, m.
    pub way: Vector3<f64>,
    /// Whether it slides along its axis.
    pub slides: bool,
}

/// Turn about x, rad.
#[must_use]
pub fn about_x(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

/// Turn about z, rad.
#[must_use]
pub fn about_z(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// A link at an instant, in the frame of the base.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Its frame.
    pub turn: Matrix3<f64>,
    /// Origin of its frame, m.
    pub origin: Vector3<f64>,
    /// Angular velocity and acceleration.
    pub spin: [Vector3<f64>; 2],
    /// Acceleration of the origin above free fall, m/s^2.
    pub acceleration: Vector3<f64>,
}

/// Places of all links.
#[must_use]
pub fn places(chain: &[Joint], q: &[f64], rate: &[f64], acceleration: &[f64]) -> Vec<Place> {
    let mut place = Place {
        turn: Matrix3::identity(),
        origin: Vector3::zeros(),
        spin: [Vector3::zeros(); 2],
        acceleration: UP,
    };
    let mut out = Vec::with_capacity(chain.len());
    for (i, joint) in chain.iter().enumerate() {
        let mut way = place.turn * joint.way;
        let mut turn = place.turn * joint.turn;
        let axis = turn.column(2).into_owned();
        let [spin, more] = place.spin;
        if joint.slides {
            way += axis * q[i];
        } else {
            turn *= about_z(q[i]);
        }
        // The way is fixed to the link before.
        let mut at = place.acceleration + more.cross(&way) + spin.cross(&spin.cross(&way));
        place.spin = if joint.slides {
            at += axis * acceleration[i] + spin.cross(&axis) * (2.0 * rate[i]);
            [spin, more]
        } else {
            let own = axis * rate[i];
            [spin + own, more + axis * acceleration[i] + spin.cross(&own)]
        };
        place.acceleration = at;
        place.origin += way;
        place.turn = turn;
        out.push(place);
    }
    out
}

fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

/// A tensor of inertia (xx, xy, xz, yy, yz, zz) times a vector, as a matrix on the six.
fn inertia_times(v: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    SMatrix::<f64, 3, 6>::from_row_slice(&[
        v.x, v.y, v.z, 0.0, 0.0, 0.0, 0.0, v.x, 0.0, v.y, v.z, 0.0, 0.0, 0.0, v.x, 0.0, v.y, v.z,
    ])
}

/// Efforts of the joints by the numbers of a link: joints times [`OF_LINK`].
#[must_use]
pub fn efforts(chain: &[Joint], places: &[Place], link: usize) -> DMatrix<f64> {
    let place = &places[link];
    let local = |v: &Vector3<f64>| place.turn.transpose() * v;
    let (spin, more) = (local(&place.spin[0]), local(&place.spin[1]));
    let at = local(&place.acceleration);
    // Force and moment about the link's origin.
    let mut force = SMatrix::<f64, 3, OF_LINK>::zeros();
    let mut moment = SMatrix::<f64, 3, OF_LINK>::zeros();
    force.set_column(0, &at);
    force
        .fixed_columns_mut::<3>(1)
        .copy_from(&(cross(&more) + cross(&spin) * cross(&spin)));
    moment.fixed_columns_mut::<3>(1).copy_from(&-cross(&at));
    moment
        .fixed_columns_mut::<6>(4)
        .copy_from(&(inertia_times(&more) + cross(&spin) * inertia_times(&spin)));
    let (force, moment) = (place.turn * force, place.turn * moment);
    let mut out = DMatrix::zeros(chain.len(), OF_LINK);
    for (i, joint) in chain.iter().enumerate().take(link + 1) {
        let axis = places[i].turn.column(2).transpose();
        let row = if joint.slides {
            axis * force
        } else {
            let arm = cross(&(place.origin - places[i].origin));
            axis * (moment + arm * force)
        };
        out.row_mut(i).copy_from(&row);
    }
    out
}

/// Velocities of a point of the last link by those of the joints: three of the point, three turns.
#[must_use]
pub fn jacobian(chain: &[Joint], places: &[Place], point: &Vector3<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(6, chain.len());
    for (i, joint) in chain.iter().enumerate() {
        let axis = places[i].turn.column(2).into_owned();
        let (moves, turns) = if joint.slides {
            (axis, Vector3::zeros())
        } else {
            (axis.cross(&(point - places[i].origin)), axis)
        };
        out.fixed_view_mut::<3, 1>(0, i).copy_from(&moves);
        out.fixed_view_mut::<3, 1>(3, i).copy_from(&turns);
    }
    out
}
