//! Friction does what its literature says.

mod common;

use common::{assert_near, friction, reading, world, DT};
use literature_sets::effects::friction::{dahl_step, stribeck};
use std::f64::consts::TAU;

const STRIBECK_SPEEDS: [f64; 5] = [0.02, 0.1, 0.3, -0.1, -2.0];

#[test]
fn lugre_settles_on_its_stribeck_curve() {
    let p = [
        ("fc", 0.4),
        ("fs", 0.7),
        ("vs", 0.2),
        ("d", 0.01),
        ("sigma1", 0.01),
        ("sigma2", 0.05),
    ];
    for v in STRIBECK_SPEEDS {
        let f = friction("lugre", &p, &world(20.0, |_| v, |_| 5.0));
        let curve = (0.4 + 0.3 * (-(v / 0.2_f64).powi(2)).exp()) * v.signum() + 0.05 * v;
        assert_near(f[f.len() - 1], curve, 1e-6);
    }
}

#[test]
fn lugre_starts_as_a_spring_and_follows_its_differential_equation() {
    let p = [
        ("fc", 0.4),
        ("fs", 0.6),
        ("vs", 0.2),
        ("d", 0.02),
        ("sigma1", 0.004),
        ("sigma2", 0.02),
    ];
    let velocity = |t: f64| 0.3 * (TAU * 0.7 * t).sin();
    let f = friction("lugre", &p, &world(3.0, velocity, |_| 5.0));
    // Euler with a thousandth of the step.
    let (sigma0, mut z, h) = (0.4 / 0.02, 0.0, DT / 1000.0);
    let mut worst = 0.0_f64;
    for (i, f) in f.iter().enumerate() {
        let (v, mut slope) = (velocity(i as f64 * DT), 0.0);
        for _ in 0..1000 {
            slope = v - sigma0 * v.abs() * z / stribeck(v, 0.4, 0.6, 0.2, 2.0);
            z += h * slope;
        }
        worst = worst.max((f - (sigma0 * z + 0.004 * slope + 0.02 * v)).abs());
    }
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn dahl_follows_the_closed_form_of_its_loop() {
    // Saturated, then back: with i = 1, F = fc (2 exp(-x/d) - 1).
    let back = world(4.0, |t| if t < 2.0 { 1.0 } else { -0.1 }, |_| 5.0);
    let f = friction("dahl", &[("fc", 0.5), ("d", 0.02), ("i", 1.0)], &back);
    assert_near(f[1999], 0.5, 1e-9);
    for n in [10, 100, 300] {
        let x = 0.1 * DT * (n as f64 + 1.0);
        assert_near(f[2000 + n], 0.5 * (2.0 * (-x / 0.02_f64).exp() - 1.0), 1e-9);
    }
}

#[test]
fn dahl_with_other_exponents_follows_its_differential_equation() {
    for i in [0.5, 1.0, 1.5, 2.0] {
        let (mut fine, steps) = (-0.9_f64, 200_000);
        for _ in 0..steps {
            fine += (0.03 / 0.02) / f64::from(steps) * (1.0 - fine).abs().powf(i);
        }
        assert_near(dahl_step(-0.9, 0.03, 0.02, i), fine, 1e-4);
        assert_near(dahl_step(0.9, -0.03, 0.02, i), -fine, 1e-4);
    }
    assert_near(dahl_step(0.0, 1.0, 0.02, 0.5), 1.0, 1e-12);
}

#[test]
fn static_friction_of_armstrong_rises_with_the_dwell_time() {
    let p = |gamma: f64| {
        [
            ("fc", 0.3),
            ("fs_a", 0.35),
            ("fs_inf", 0.6),
            ("fv", 0.0),
            ("vs", 0.2),
            ("delta", 2.0),
            ("d", 0.002),
            ("tau_l", 1.0),
            ("gamma", gamma),
        ]
    };
    for dwell in [0.5, 5.0] {
        let run = world(dwell + 0.2, |t| if t < dwell { 0.0 } else { 0.05 }, |_| 5.0);
        let peak = friction("armstrong", &p(1.0), &run)
            .into_iter()
            .fold(0.0, f64::max);
        // The break takes fs/kt/v = 40 ms more at most, and the slip starts at a velocity of a
        // quarter of vs.
        let at_break = |t: f64| 0.35 + 0.25 * t / (t + 1.0);
        let slip = |fs: f64| 0.3 + (fs - 0.3) * (-(0.05 / 0.2_f64).powi(2)).exp();
        let (low, high) = (
            slip(at_break(dwell)),
            at_break(dwell + 0.04) + 0.6 / 0.002 * 0.05 * DT,
        );
        assert!(peak >= low && peak <= high, "{low} <= {peak} <= {high}");
    }
}

#[test]
fn armstrong_slides_on_its_stribeck_curve_with_memory() {
    let p = [
        ("fc", 0.3),
        ("fs_a", 0.5),
        ("fs_inf", 0.5),
        ("fv", 0.04),
        ("vs", 0.3),
        ("delta", 1.0),
        ("d", 0.001),
        ("tau_l", 20.0),
        ("gamma", 1.0),
    ];
    let velocity = |t: f64| 0.5 + 0.3 * (TAU * t).sin();
    let f = friction("armstrong", &p, &world(3.0, velocity, |_| 5.0));
    for i in [1500, 1800, 2700] {
        let t = i as f64 * DT;
        let curve = 0.3 + 0.2 * (-velocity(t - 0.020) / 0.3).exp() + 0.04 * velocity(t);
        assert_near(f[i], curve, 1e-9);
    }
}

#[test]
fn armstrong_presliding_is_a_spring() {
    let p = [
        ("fs_a", 0.5),
        ("fs_inf", 0.5),
        ("fc", 0.3),
        ("fv", 0.0),
        ("d", 0.05),
        ("gamma", 1.0),
    ];
    // Small motion: x goes to 0.01 rad and back to 0.
    let run = world(2.0, |t| if t < 1.0 { 0.01 } else { -0.01 }, |_| 5.0);
    let f = friction("armstrong", &p, &run);
    assert_near(f[999], 0.01 * 0.5 / 0.05, 1e-9);
    assert_near(f[1999], 0.0, 1e-9);
}

#[test]
fn maxwell_slip_settles_on_its_stribeck_curve() {
    let p = [
        ("fc", 0.4),
        ("fs", 0.7),
        ("vs", 0.2),
        ("delta", 2.0),
        ("d_min", 0.001),
        ("d_max", 0.05),
        ("c", 20.0),
    ];
    for v in STRIBECK_SPEEDS {
        let f = friction("maxwell-slip", &p, &world(8.0, |_| v, |_| 5.0));
        assert_near(
            f[f.len() - 1],
            stribeck(v, 0.4, 0.7, 0.2, 2.0) * v.signum(),
            1e-5,
        );
    }
}

#[test]
fn maxwell_slip_obeys_masing() {
    // With fs = fc the loop is rate-independent: the branch after a reversal is the virgin curve at
    // twice the scale.
    let p = [
        ("fc", 0.5),
        ("fs", 0.5),
        ("d_min", 0.002),
        ("d_max", 0.1),
        ("c", 1e4),
    ];
    let run = world(4.0, |t| if t < 1.0 { 0.2 } else { -0.05 }, |_| 5.0);
    let f = friction("maxwell-slip", &p, &run);
    let virgin = |x: f64| f[((x / 0.2) / DT).round() as usize - 1];
    assert_near(f[999], 0.5, 1e-6);
    for x in [0.004, 0.02, 0.1] {
        let after = f[999 + (x / 0.05 / DT).round() as usize];
        assert_near(f[999] - after, 2.0 * virgin(x / 2.0), 2e-3);
    }
}

#[test]
fn bouc_wen_is_tanh_for_a_square_and_dahl_for_beta_one() {
    let loading = world(1.0, |_| 0.1, |_| 5.0);
    let f = friction(
        "bouc-wen",
        &[("fh", 1.0), ("d", 0.03), ("beta", 0.6), ("n", 2.0)],
        &loading,
    );
    for i in [100, 400, 900] {
        assert_near(f[i], (0.1 * DT * (i as f64 + 1.0) / 0.03).tanh(), 1e-4);
    }
    let around = world(5.0, |t| 0.3 * (TAU * t).sin(), |_| 5.0);
    let bouc_wen = friction(
        "bouc-wen",
        &[("fh", 0.4), ("d", 0.03), ("beta", 1.0), ("n", 1.0)],
        &around,
    );
    let dahl = friction("dahl", &[("fc", 0.4), ("d", 0.03), ("i", 1.0)], &around);
    for (a, b) in bouc_wen.iter().zip(&dahl) {
        assert_near(*a, *b, 1e-3);
    }
}

#[test]
fn coulomb_has_one_magnitude_and_holds_its_sign_at_rest() {
    let run = world(
        3.0,
        |t| match t {
            t if t < 0.5 || (1.5..2.0).contains(&t) => 0.0,
            t if t < 1.5 => 2.0,
            _ => -0.1,
        },
        |_| 5.0,
    );
    let f = friction("coulomb", &[("fc", 0.3)], &run);
    for (at, expected) in [(100, 0.0), (1000, 0.3), (1800, 0.3), (2500, -0.3)] {
        assert_near(f[at], expected, 1e-12);
    }
}

#[test]
fn capstan_has_the_ratio_of_euler_and_grows_with_the_load() {
    let run = world(2.0, |t| if t < 1.0 { 1.0 } else { -1.0 }, |_| 5.0);
    let t = reading("capstan", &[("mu", 0.1), ("phi", 3.0)], &run);
    assert_near(t[1500] / t[500], (2.0 * 0.1 * 3.0_f64).exp(), 1e-9);
    let heavy = reading(
        "capstan",
        &[("mu", 0.1), ("phi", 3.0)],
        &world(1.0, |_| 1.0, |_| 10.0),
    );
    assert_near(heavy[500], 2.0 * t[500], 1e-9);
}

#[test]
fn viscous_friction_depends_on_load_and_temperature() {
    let mut run = world(1.0, |t| t, |_| 5.0);
    assert_near(friction("viscous", &[("b", 0.1)], &run)[800], 0.08, 1e-9);
    assert_near(
        friction("viscous-load", &[("b", 0.1), ("kappa", 0.2)], &run)[800],
        0.16,
        1e-9,
    );
    run.temperature.fill(35.0);
    let warm = friction(
        "viscous-temperature",
        &[("b", 0.1), ("beta", 2f64.ln() / 10.0)],
        &run,
    );
    assert_near(warm[800], 0.04, 1e-9);
}

#[test]
fn sector_friction_acts_in_its_sector_only() {
    let run = world(20.0, |_| 1.0, |_| 5.0);
    let f = friction(
        "sector-friction",
        &[("fc", 0.3), ("from", 6.0), ("width", 1.0)],
        &run,
    );
    for (angle, f) in run.angle.iter().zip(&f) {
        let turned = angle.rem_euclid(TAU);
        let inside = (turned - 6.0).rem_euclid(TAU) < 1.0;
        if (turned - 6.0).abs() > 0.01 && (turned - 7.0 + TAU).abs() > 0.01 {
            assert_near(*f, if inside { 0.3 } else { 0.0 }, 1e-12);
        }
    }
}

#[test]
fn bouc_wen_with_load_scales_with_the_tension() {
    let velocity = |t: f64| 0.3 * (TAU * t).sin();
    let p = [("mu", 0.1), ("d", 0.03), ("beta", 0.6), ("n", 2.0)];
    let z = friction(
        "bouc-wen",
        &[("fh", 1.0), ("d", 0.03), ("beta", 0.6), ("n", 2.0)],
        &world(3.0, velocity, |_| 5.0),
    );
    let f = friction("bouc-wen-load", &p, &world(3.0, velocity, |t| 3.0 + t));
    for i in [300, 1700, 2900] {
        assert_near(f[i], 0.1 * z[i] * (3.0 + i as f64 * DT), 1e-9);
    }
}
