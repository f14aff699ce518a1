//! Kinematics against published figures and an oracle with 4x4 matrices, written from the table
//! alone.

use nalgebra::{Matrix4, Vector3, Vector4};
use robot::kinematics::{
    forward, from_crtk, inverse, jacobian, joints_from_motors, motors_from_joints, to_crtk,
    InverseError, Joints, HOME, LIMITS,
};

/// The table of the left arm, degrees and metres: alpha(i-1), a(i-1), d, theta.
const TABLE: [[f64; 4]; 6] = [
    [0.0, 0.0, 0.0, 205.0],
    [75.0, 0.0, 0.0, 180.0],
    [128.0, 0.0, 0.0, 90.0],
    [0.0, 0.0, -0.47, 0.0],
    [90.0, 0.0, 0.0, -90.0],
    [90.0, 0.013, 0.0, 0.0],
];

/// Craig's closed form of a link's transform.
fn oracle(q: &Joints) -> Matrix4<f64> {
    let mut product = Matrix4::identity();
    for (i, [alpha, a, d, theta]) in TABLE.into_iter().enumerate() {
        let (sa, ca) = libm::sincos(alpha.to_radians());
        let (theta, d) = if i == 2 {
            (theta.to_radians(), d + q[2])
        } else {
            (theta.to_radians() + q[i], d)
        };
        let (st, ct) = libm::sincos(theta);
        #[rustfmt::skip]
        let link = Matrix4::new(
            ct, -st, 0.0, a,
            st * ca, ct * ca, -sa, -sa * d,
            st * sa, ct * sa, ca, ca * d,
            0.0, 0.0, 0.0, 1.0,
        );
        product *= link;
    }
    product
}

/// Joints anywhere within their limits.
fn any_joints(n: u64) -> Joints {
    let mut state = n.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    core::array::from_fn(|i| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let part = (state >> 11) as f64 / (1_u64 << 53) as f64;
        let (min, max) = LIMITS[i];
        min + (max - min) * part
    })
}

#[test]
fn the_tip_is_where_the_published_code_puts_it() {
    // Measured with uw-biorobotics/raven2's forward kinematics: (-77.95, -25.27, 13.23) mm.
    let tip = forward(&HOME).position_m;
    let published = Vector3::new(-0.07795, -0.02527, 0.01323);
    assert!((tip - published).norm() < 1e-5, "{tip}");
}

#[test]
fn the_jacobian_at_home_is_the_published_one() {
    let jacobian = jacobian(&HOME);
    let published = [
        [0.025, 0.014, 0.939],
        [-0.078, -0.010, 0.304],
        [0.0, 0.063, -0.159],
    ];
    for (row, values) in published.into_iter().enumerate() {
        for (column, value) in values.into_iter().enumerate() {
            assert!(
                (jacobian[(row, column)] - value).abs() < 6e-4,
                "{row} {column}: {}",
                jacobian[(row, column)]
            );
        }
    }
}

#[test]
fn forward_agrees_with_the_oracle_everywhere() {
    for n in 0..500 {
        let q = any_joints(n);
        let pose = forward(&q);
        let oracle = oracle(&q);
        let position = oracle * Vector4::new(0.0, 0.0, 0.0, 1.0);
        assert!((pose.position_m - position.xyz()).norm() < 1e-13);
        let rotation = oracle.fixed_view::<3, 3>(0, 0).into_owned();
        assert!((pose.rotation.matrix() - rotation).norm() < 1e-13);
    }
}

#[test]
fn the_jacobian_is_the_derivative_of_the_oracle() {
    let h = 1e-6;
    for n in 0..100 {
        let q = any_joints(n);
        let jacobian = jacobian(&q);
        for i in 0..6 {
            let (mut up, mut down) = (q, q);
            up[i] += h;
            down[i] -= h;
            let rate = (oracle(&up) - oracle(&down)) / (2.0 * h);
            let velocity = Vector3::new(rate[(0, 3)], rate[(1, 3)], rate[(2, 3)]);
            assert!((jacobian.fixed_view::<3, 1>(0, i) - velocity).norm() < 1e-9);
            // dR/dq R^T is the skew matrix of the angular velocity.
            let skew =
                rate.fixed_view::<3, 3>(0, 0) * oracle(&q).fixed_view::<3, 3>(0, 0).transpose();
            let angular = Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]);
            assert!((jacobian.fixed_view::<3, 1>(3, i) - angular).norm() < 1e-8);
        }
    }
}

#[test]
fn inverse_undoes_forward_for_any_tool() {
    for n in 0..500 {
        let mut q = any_joints(n);
        if n % 2 == 0 {
            q[3..].fill(0.0);
        } else {
            // A bent wrist within reason: with 70 degrees the tip can pass the remote centre.
            q[4] *= 0.5;
            q[2] = q[2].min(0.42);
        }
        let found = inverse(forward(&q).position_m, [q[3], q[4], q[5]]).unwrap();
        // A bent tool can have a second solution; its tip is the same.
        let again = forward(&[found[0], found[1], found[2], q[3], q[4], q[5]]);
        assert!((again.position_m - forward(&q).position_m).norm() < 1e-9);
        // At 0.483 m the tip is on the remote centre, behind it a second solution may be within the
        // limits.
        if n % 2 == 0 && q[2] < 0.475 {
            for i in 0..3 {
                assert!(
                    (found[i] - q[i]).abs() < 1e-9,
                    "{n}: joint {i}: {} for {}",
                    found[i],
                    q[i]
                );
            }
        }
    }
}

#[test]
fn positions_out_of_reach_say_why() {
    let home = forward(&HOME).position_m;
    let error = inverse(home * 4.0, [0.0; 3]).unwrap_err();
    assert!(
        matches!(error, InverseError::Limit { joint: 3, .. }),
        "{error}"
    );
    let error = inverse(Vector3::new(0.0, 0.0, 0.1), [0.0; 3]).unwrap_err();
    assert!(matches!(error, InverseError::Direction { .. }), "{error}");
    let error = inverse(Vector3::new(f64::NAN, 0.0, 0.0), [0.0; 3]).unwrap_err();
    assert!(matches!(error, InverseError::NotFinite(..)), "{error}");
}

#[test]
fn motors_and_joints_are_inverse_and_coupled() {
    let q = [0.5, 1.2, 0.4];
    let m = motors_from_joints(q);
    let back = joints_from_motors(m);
    for i in 0..3 {
        assert!((back[i] - q[i]).abs() < 1e-12);
    }
    assert!((m[1] - 121.52 * (1.2 + 0.14545 * 0.5)).abs() < 1e-9);
    assert!((m[2] - 2158.6 * (0.4 + 0.0077974 * 0.5 + 0.0080774 * 1.2)).abs() < 1e-9);
}

#[test]
fn the_crtk_frame_has_gravity_down() {
    // Frame 0 has gravity along -x.
    assert_eq!(
        to_crtk(Vector3::new(-9.8, 0.0, 0.0)),
        Vector3::new(0.0, 0.0, -9.8)
    );
    let v = Vector3::new(0.1, -0.2, 0.3);
    assert_eq!(from_crtk(to_crtk(v)), v);
}
