//! Drive, load cell, amplifier and logger do what their literature says.

mod common;

use common::{amplitude, assert_near, friction, parameters, reading, tone_phase, world, DT};
use literature_sets::effects::sensor::clipping_level;
use literature_sets::world::World;
use std::f64::consts::{PI, TAU};

/// The reel turns eight times at constant speed.
fn turning(load: f64) -> World {
    let seconds = 8.0;
    world(seconds, |_| TAU, |_| load)
}

fn ripple(name: &str, values: &[(&str, f64)], load: f64) -> (Vec<f64>, Vec<f64>) {
    let run = turning(load);
    (
        reading(name, values, &run)
            .iter()
            .map(|f| f - load)
            .collect(),
        run.angle,
    )
}

#[test]
fn harmonic_drive_has_lines_at_once_and_twice_the_input() {
    let p = [("n", 50.0), ("k", 10.0), ("e1", 1.0), ("e2", 0.5)];
    let (f, angle) = ripple("harmonic-drive", &p, 5.0);
    // One arc minute at 10 N·m/rad and 10 mm.
    let expected = 10.0 * PI / 10_800.0 / 0.01;
    assert_near(amplitude(&f, &angle, 50.0), expected, 1e-3 * expected);
    assert_near(
        amplitude(&f, &angle, 100.0),
        0.5 * expected,
        1e-3 * expected,
    );
    for order in [1.0, 25.0, 49.0, 150.0] {
        assert_near(amplitude(&f, &angle, order), 0.0, 1e-3 * expected);
    }
}

#[test]
fn cogging_has_the_order_of_the_motor_and_no_load_dependence() {
    for load in [2.0, 10.0] {
        let run = world(7.0, |_| TAU, |_| load);
        let f: Vec<f64> = reading("cogging", &[("m", 12.0), ("a", 0.1), ("h2", 0.3)], &run)
            .iter()
            .map(|f| f - load)
            .collect();
        let order = 12.0 * 26.0 / 7.0;
        assert_near(amplitude(&f, &run.angle, order), 0.1, 1e-3);
        assert_near(amplitude(&f, &run.angle, 2.0 * order), 0.03, 1e-3);
    }
}

#[test]
fn gear_mesh_has_the_order_of_the_teeth_and_grows_with_the_load() {
    for load in [2.0, 10.0] {
        let (f, angle) = ripple(
            "gear-mesh",
            &[("z", 26.0), ("eps", 0.01), ("h2", 0.2)],
            load,
        );
        assert_near(amplitude(&f, &angle, 26.0), 0.01 * load, 1e-4 * load);
        assert_near(amplitude(&f, &angle, 52.0), 0.002 * load, 1e-4 * load);
    }
}

#[test]
fn eccentric_reel_has_a_line_once_per_turn_that_grows_with_the_load() {
    for load in [2.0, 10.0] {
        let (f, angle) = ripple("eccentricity", &[("e", 0.2), ("phi", 1.0)], load);
        // 1/(1 + x cos) = 1 - x cos + ...: x is 0.2 mm over 10 mm.
        assert_near(amplitude(&f, &angle, 1.0), 0.02 * load, 1e-3 * load);
        let at = angle.iter().position(|a| *a >= 1.0).unwrap();
        assert_near(f[at] + load, load / 1.02, 1e-5);
    }
}

#[test]
fn backlash_rests_over_its_width_at_a_reversal() {
    let run = world(6.0, |t| if t < 3.0 { 1.0 } else { -1.0 }, |_| 5.0);
    let spring: Vec<f64> = reading("backlash", &[("k", 0.2), ("w", 0.8)], &run)
        .iter()
        .map(|f| f - 5.0)
        .collect();
    let (top, width) = (2999, (0.8 / DT) as usize);
    assert_near(spring[top], 0.2 * (run.angle[top] - 0.4), 1e-9);
    for i in [top + 10, top + width / 2, top + width - 10] {
        assert_near(spring[i], spring[top], 1e-3);
    }
    let after = top + width + 500;
    assert_near(spring[after], 0.2 * (run.angle[after] + 0.4), 1e-9);
}

#[test]
fn backlash_beside_its_spring_is_coulomb_friction_with_presliding() {
    let run = world(20.0, |t| (0.9 * t).sin() + 0.4 * (2.1 * t).cos(), |_| 5.0);
    let missing: Vec<f64> = friction("backlash", &[("k", 0.2), ("w", 0.5)], &run)
        .iter()
        .zip(&run.angle)
        .map(|(f, angle)| f + 0.2 * angle)
        .collect();
    // An elastic-perfectly plastic element, stepped on its own: stiffness k, limit k w/2.
    let mut element = 0.0_f64;
    for (angles, missing) in run.angle.windows(2).zip(&missing[1..]) {
        element = (element + 0.2 * (angles[1] - angles[0])).clamp(-0.05, 0.05);
        assert_near(*missing, element, 1e-9);
    }
}

#[test]
fn elastic_transmission_rings_at_its_resonance_and_carries_the_static_load() {
    let p = [("j", 50.0), ("k", 20.0), ("zeta", 0.1)];
    let f = reading(
        "stretch",
        &p,
        &world(4.0, |_| 0.0, |t| if t < 0.5 { 2.0 } else { 6.0 }),
    );
    assert_near(f[400], 2.0, 1e-9);
    assert_near(f[3999], 6.0, 1e-3);
    let crossings: Vec<f64> = (500..1500)
        .filter(|i| f[*i] < 6.0 && f[i + 1] >= 6.0)
        .map(|i| i as f64 * DT)
        .collect();
    let omega = (20.0_f64 / (50e-6 / 0.01)).sqrt();
    let period = TAU / (omega * (1.0 - 0.01_f64).sqrt());
    assert_near((crossings[2] - crossings[0]) / 2.0, period, 2e-3);
}

#[test]
fn elastic_transmission_is_inertia_far_below_its_resonance() {
    let velocity = |t: f64| 2.0 * (TAU * 0.5 * t).sin();
    let run = world(8.0, velocity, |_| 5.0);
    let stretch = friction("stretch", &[("j", 30.0), ("k", 100.0), ("zeta", 0.5)], &run);
    let inertia = friction("inertia", &[("j_rotor", 0.0), ("j_reel", 30.0)], &run);
    for i in [3000, 5100, 7700] {
        assert_near(stretch[i], inertia[i], 0.04 * 0.003 * TAU);
    }
}

#[test]
fn inertia_of_the_rotor_counts_with_the_square_of_the_gear() {
    let run = world(1.0, |t| 10.0 * t, |_| 5.0);
    let f = friction("inertia", &[("j_rotor", 2.0), ("j_reel", 5.0)], &run);
    assert_near(
        f[500],
        (5e-6 + 2e-6 * (26.0_f64 / 7.0).powi(2)) * 10.0 / 0.01,
        1e-9,
    );
}

#[test]
fn gravity_has_the_torque_of_its_lever() {
    let run = turning(5.0);
    let f = friction("gravity", &[("m", 20.0), ("l", 30.0), ("phi", 0.0)], &run);
    let quarter = run.angle.iter().position(|a| *a >= PI / 2.0).unwrap();
    // 20 g at 30 mm are 5.88 mN·m.
    assert_near(-f[quarter], 0.02 * 9.80665 * 0.03 / 0.01, 1e-4);
}

#[test]
fn first_order_lag_has_its_step_response() {
    let run = world(2.0, |_| 0.0, |t| if t < 1.0 { 2.0 } else { 6.0 });
    let f = reading("lag-first", &[("tau", 50.0)], &run);
    assert_near(f[990], 2.0, 1e-9);
    for after in [0.05, 0.15] {
        // The step lies between two grid points.
        let t = after - 0.5 * DT;
        assert_near(
            f[999 + (after / DT) as usize],
            6.0 - 4.0 * (-t / 0.05_f64).exp(),
            2e-3,
        );
    }
}

#[test]
fn first_order_lag_shifts_a_ramp_by_its_time_constant_at_any_rate() {
    for tau in [0.2, 3.0, 80.0] {
        let f = reading(
            "lag-first",
            &[("tau", tau)],
            &world(2.0, |_| 0.0, |t| 5.0 * t),
        );
        assert_near(f[1900], 5.0 * (1.9 - tau * 1e-3), 1e-6);
    }
}

#[test]
fn second_order_lag_overshoots_as_its_damping_says() {
    for zeta in [0.3, 0.6] {
        let run = world(3.0, |_| 0.0, |t| if t < 1.0 { 2.0 } else { 3.0 });
        let f = reading("lag-second", &[("tau", 30.0), ("zeta", zeta)], &run);
        let peak = f.iter().copied().fold(0.0, f64::max);
        assert_near(
            peak - 3.0,
            (-PI * zeta / (1.0 - zeta * zeta).sqrt()).exp(),
            3e-3,
        );
        assert_near(f[2999], 3.0, 1e-3);
    }
    let ramp = reading(
        "lag-second",
        &[("tau", 30.0), ("zeta", 0.5)],
        &world(2.0, |_| 0.0, |t| 5.0 * t),
    );
    assert_near(ramp[1900], 5.0 * (1.9 - 0.030), 1e-6);
}

#[test]
fn delay_is_the_peak_of_the_cross_correlation() {
    let run = world(
        20.0,
        |_| 0.0,
        |t| 5.0 + (2.0 * t).sin() + (13.0 * t).cos() + (31.0 * t).sin(),
    );
    let f = reading("delay", &[("tau", 37.0)], &run);
    let correlation = |lag: usize| {
        (1000..19_000)
            .map(|i| (f[i] - 5.0) * (run.command[i - lag] - 5.0))
            .sum::<f64>()
    };
    let best = (0..200)
        .max_by(|a, b| correlation(*a).total_cmp(&correlation(*b)))
        .unwrap();
    assert_eq!(best, 37);
    // Between the grid's steps as well.
    let ramp = world(2.0, |_| 0.0, |t| 4.0 * t);
    assert_near(
        reading("delay", &[("tau", 10.4)], &ramp)[1500],
        4.0 * (1.5 - 0.0104),
        1e-9,
    );
}

#[test]
fn clock_skew_grows_over_the_run() {
    let run = world(60.0, |_| 0.0, |t| 0.1 * t);
    let f = reading("clock-skew", &[("skew", 500.0), ("drift", 0.0)], &run);
    for t in [1.0, 30.0, 50.0] {
        assert_near(f[(t / DT) as usize], 0.1 * t * (1.0 + 500e-6), 1e-9);
    }
    let f = reading("clock-skew", &[("skew", 0.0), ("drift", 600.0)], &run);
    assert_near(f[50_000], 0.1 * (50.0 + 0.5 * 600e-6 / 60.0 * 2500.0), 1e-9);
}

#[test]
fn creep_follows_its_exponentials_and_returns_to_zero() {
    // Loaded with 10 N for 60 s, then unloaded, as the test of OIML R 60 but shorter.
    let run = world(150.0, |_| 0.0, |t| if t < 60.0 { 10.0 } else { 0.0 });
    let f = reading(
        "creep",
        &[("a1", 0.2), ("a2", 0.1), ("tau1", 5.0), ("tau2", 100.0)],
        &run,
    );
    let grown = |t: f64| 0.02 * (1.0 - (-t / 5.0).exp()) + 0.01 * (1.0 - (-t / 100.0).exp());
    for t in [1.0, 10.0, 59.0] {
        assert_near(f[(t / DT) as usize] - 10.0, grown(t), 2e-5);
    }
    for t in [5.0, 80.0] {
        let left = 0.02 * (1.0 - (-12.0_f64).exp()) * (-t / 5.0_f64).exp()
            + 0.01 * (1.0 - (-0.6_f64).exp()) * (-t / 100.0_f64).exp();
        assert_near(f[((60.0 + t) / DT) as usize], left, 2e-5);
    }
}

#[test]
fn load_cell_characteristic_is_the_polynomial() {
    let f = reading(
        "nonlinearity",
        &[("c2", 1.0), ("c3", -0.4)],
        &world(1.0, |_| 0.0, |t| 15.0 * t),
    );
    assert_near(f[0], 0.0, 1e-12);
    assert_near(f[500], 7.5 + 15.0 * (0.01 * 0.25 - 0.004 * 0.125), 1e-9);
}

#[test]
fn temperature_moves_zero_and_span() {
    let mut run = world(1.0, |_| 0.0, |_| 8.0);
    run.temperature.fill(35.0);
    assert_near(
        reading("temperature-zero", &[("z", 2.0)], &run)[0],
        8.02,
        1e-12,
    );
    assert_near(
        reading("temperature-span", &[("s", 0.01)], &run)[0],
        8.0 * 1.001,
        1e-12,
    );
}

#[test]
fn crosstalk_adds_shares_of_the_neighbours() {
    let mut run = world(1.0, |_| 0.0, |_| 8.0);
    run.neighbours[0].fill(3.0);
    run.neighbours[1].fill(10.0);
    assert_near(
        reading("crosstalk", &[("c1", 2.0), ("c2", -1.0)], &run)[0],
        8.0 + 0.06 - 0.1,
        1e-12,
    );
}

#[test]
fn clipping_ends_at_its_level_and_a_kink_changes_the_slope() {
    let run = world(1.0, |_| 0.0, |t| 10.0 * t);
    let p = [("reference", 10.0), ("depth", 2.0)];
    let f = reading("clipping", &p, &run);
    assert_near(clipping_level(&parameters("clipping", &p)), 8.0, 1e-12);
    assert_near(f[500], 5.0, 1e-9);
    assert_near(f[950], 8.0, 1e-12);
    let f = reading("kink", &[("share", 0.1), ("at", 6.0)], &run);
    assert_near(f[500], 5.0, 1e-9);
    assert_near(f[900], 9.0 - 0.3, 1e-9);
}

#[test]
fn mains_is_one_line() {
    let f: Vec<f64> = reading(
        "mains",
        &[("a", 0.05), ("nominal", 50.0), ("detune", 0.0)],
        &world(4.0, |_| 0.0, |_| 5.0),
    )
    .iter()
    .map(|f| f - 5.0)
    .collect();
    let phase = tone_phase(f.len(), 1.0 / DT);
    assert_near(amplitude(&f, &phase, 50.0), 0.05, 1e-6);
    assert_near(amplitude(&f, &phase, 60.0), 0.0, 1e-6);
}

#[test]
fn bursts_come_at_rest_or_on_release_only() {
    // Moves in every second second.
    let run = world(
        60.0,
        |t| {
            if (t as usize).is_multiple_of(2) {
                0.0
            } else {
                1.0
            }
        },
        |_| 5.0,
    );
    let p = [("a", 0.3), ("f", 5.0), ("decay", 0.1)];
    let energy = |f: &[f64], moving: bool| -> f64 {
        f.iter()
            .zip(&run.velocity)
            .filter(|(_, v)| (**v != 0.0) == moving)
            .map(|(f, _)| f * f)
            .sum()
    };
    let mut resting = p.to_vec();
    resting.push(("rate", 2.0));
    let rest = friction("rest-bursts", &resting, &run);
    assert!(energy(&rest, false) > 1.0);
    assert_eq!(energy(&rest, true), 0.0);
    let release = friction("release-bursts", &p, &run);
    assert!(energy(&release, true) > 1.0);
    assert!(energy(&release, false) < 1e-6 * energy(&release, true));
    let starts = (1..run.len()).filter(|i| run.velocity[i - 1] == 0.0 && run.velocity[*i] != 0.0);
    for i in starts {
        assert!((0.15..=0.45).contains(&release[i].abs()), "{}", release[i]);
    }
}
