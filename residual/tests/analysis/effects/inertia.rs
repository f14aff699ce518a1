//! Force that accelerates the moving mass.

use crate::rig::knowing;
use residual_effects::*;

/// A model with a velocity, for tests of its slopes.
const MODEL: &str = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                     velocity = { column = \"v\", unit = \"rad/s\" }\n\
                     [[terms]]\nname = \"a\"\nexpr = \"1\"\n";

/// A slope over a third of a period is no acceleration any more.
#[test]
fn slopes_are_short_beside_the_motion() {
    let (rows, dt) = (1000, 0.02);
    let widths = |hz: f64| {
        let w = std::f64::consts::TAU * hz;
        let velocity: Vec<f64> = (0..rows).map(|i| (w * dt * i as f64).sin()).collect();
        let columns = [("target", velocity.clone()), ("velocity", velocity)];
        let mut grid = vec![];
        knowing(MODEL, &columns, rows, |ctx| {
            grid = effect(EffectKind::Inertia).variants(ctx)[0]
                .psi
                .as_ref()
                .unwrap()
                .grid
                .clone();
        });
        grid
    };
    assert_eq!(widths(0.68), [1.0, 2.0, 3.0, 5.0, 8.0]);
    assert_eq!(widths(0.1), [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0]);
    assert_eq!(widths(8.0), [1.0]);
}

/// Of few rows the slope loses a part of the acceleration. A noisy velocity takes a slope over many
/// rows, which loses a part as well and is noisy itself.
#[test]
fn is_neither_too_large_nor_too_small() {
    for (dt, noise) in [(0.05, 0.01), (0.01, 0.3)] {
        let (inertia, term) = found(dt, noise);
        assert!((inertia - 0.1).abs() < 0.002, "{inertia} {term}");
    }
}

/// Stamps that scatter make the declared slope of the velocity noisy. The same inertia with a wider
/// slope is better, and the model lacks neither a gain nor an inertia.
#[test]
fn a_declared_inertia_is_not_exchanged_for_its_own_wider_slope() {
    use residual::{analyse, spec::Spec, Data};
    use residual_columns::stats::Rng;
    let (runs, rows, dt) = (4, 2000, 0.005);
    let mut rng = Rng::new(5);
    let mut columns = [vec![], vec![], vec![]];
    for i in 0..runs * rows {
        let t = (i % rows) as f64 * dt;
        let at = t + 2.3 * (i / rows) as f64;
        let acceleration = 9.0 * (9.0 * at).cos() * 3.0 - 4.1 * (4.1 * at).sin() * 3.0;
        columns[0].push(t + 0.9 * dt * (rng.uniform() - 0.5));
        columns[1].push(3.0 * ((9.0 * at).sin() + (4.1 * at).cos()) + 0.01 * rng.normal());
        columns[2].push(0.02 * acceleration + 0.05 * rng.normal());
    }
    let [time, velocity, target] = columns;
    let data = Data::from_columns(time, [("velocity", velocity), ("target", target)])
        .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
        .build()
        .unwrap();
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N m\" }\n\
         roles.velocity = { column = \"v\", unit = \"rad/s\" }\n\
         [[terms]]\nname = \"inertia\"\nexpr = \"deriv(velocity, 3)\"\nfixed = 0.02\n";
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let names: Vec<_> = report.effects.iter().map(|e| e.name.to_string()).collect();
    assert_eq!(names, [""; 0], "{}", report.summary());
}

/// An inertia of 0.1 found in rows `dt` apart with a `noise` of the velocity, and its term.
fn found(dt: f64, noise: f64) -> (f64, String) {
    use residual::{analyse, spec::Spec, Data};
    use residual_columns::stats::Rng;
    let (runs, rows) = (4, 1500);
    let mut rng = Rng::new(3);
    let w = [9.0, 4.1];
    let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        (0..runs * rows)
            .map(|i| f((i % rows) as f64 * dt + 2.3 * (i / rows) as f64))
            .collect()
    };
    let speed = of(&|t| (w[0] * t).sin() + (w[1] * t).cos());
    let acceleration = of(&|t| w[0] * (w[0] * t).cos() - w[1] * (w[1] * t).sin());
    let mut noisy =
        |x: &[f64], size: f64| -> Vec<f64> { x.iter().map(|x| x + size * rng.normal()).collect() };
    let velocity = noisy(&speed, noise);
    let force: Vec<f64> = acceleration.iter().map(|a| 0.1 * a).collect();
    let target = noisy(&force, 0.1);
    let data = Data::from_columns(
        (0..runs * rows).map(|i| (i % rows) as f64 * dt).collect(),
        [("velocity", velocity), ("target", target)],
    )
    .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
    .build()
    .unwrap();
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N\" }\n\
         roles.velocity = { column = \"v\", unit = \"m/s\" }\n\
         selection.only = [\"inertia\"]\n\
         [[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let own = report.effects.first().expect("an inertia");
    (own.params["inertia"], own.terms[0].clone())
}

/// Velocities whose noise is not white: from the difference of two angles of an encoder, from its
/// slope, held for several rows, and filtered. How much of it a slope has is not known, so there is
/// no factor.
#[test]
fn noise_of_another_colour_gives_no_factor() {
    let (rows, dt, count) = (20_000, 0.02, 0.0015);
    let angle = |i: usize| {
        let exact = (0.35 * dt * i as f64).sin() + 0.3 * (0.85 * dt * i as f64).cos();
        (exact / count).round() * count
    };
    let difference = |i: usize| (angle(i + 1) - angle(i)) / dt;
    let slope = |i: usize| {
        let two = angle(i + 4) - angle(i) + 0.5 * (angle(i + 3) - angle(i + 1));
        two / (5.0 * dt)
    };
    let filtered = |size: f64| -> Vec<f64> {
        let mut rng = residual_columns::stats::Rng::new(2);
        let mut slow = [0.0; 2];
        let mut noise = || {
            slow[0] = 0.9 * slow[0] + 0.1 * rng.normal();
            slow[1] = 0.9 * slow[1] + 0.1 * slow[0];
            size * slow[1]
        };
        (0..rows)
            .map(|i| noise() + (0.35 * dt * i as f64).cos())
            .collect()
    };
    let of = |f: &dyn Fn(usize) -> f64| (0..rows).map(f).collect::<Vec<f64>>();
    for velocity in [
        of(&difference),
        of(&slope),
        of(&|i| slope(i / 10 * 10)),
        filtered(2.0),
        filtered(0.2),
    ] {
        let columns = [("target", velocity.clone()), ("velocity", velocity)];
        knowing(MODEL, &columns, rows, |ctx| {
            let slopes = ctx.slopes("velocity");
            let texts: Vec<String> = slopes.widths().iter().map(|h| slopes.text(*h)).collect();
            assert!(texts.iter().all(|t| t.starts_with("deriv")), "{texts:?}");
        });
    }
}

/// Sines of few rows: also the narrowest slope loses a part.
#[test]
fn what_the_slopes_lose_of_a_sine_is_made_up_for() {
    for (w, widths) in [
        (10.0, vec![1.0, 2.0, 3.0]),
        (20.0, vec![1.0]),
        (38.0, vec![1.0]),
    ] {
        loses_nothing_of_a_sine(w, &widths);
    }
}

/// The slopes of a sine of an angular frequency, in rows 0.02 s apart, have these half widths and
/// the size of its acceleration.
fn loses_nothing_of_a_sine(w: f64, widths: &[f64]) {
    let (rows, dt) = (1000, 0.02);
    let velocity: Vec<f64> = (0..rows).map(|i| (w * dt * i as f64).sin()).collect();
    let columns = [("target", velocity.clone()), ("velocity", velocity)];
    knowing(MODEL, &columns, rows, |ctx| {
        let slopes = ctx.slopes("velocity");
        assert_eq!(slopes.widths(), widths);
        for half in slopes.widths() {
            let own = ctx.values(&slopes.text(half));
            let size = own.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
            assert!((size / w - 1.0).abs() < 0.01, "{half} {size}");
        }
    });
}

/// A drive with limited acceleration: it changes in steps, also between two rows.
#[test]
fn what_the_slopes_lose_of_steps_is_made_up_for() {
    let (rows, dt) = (3000, 0.02);
    // 20 rad/s² for a tenth of a second, and back, with pauses of other lengths.
    let acceleration = |t: f64| match t.rem_euclid(1.342) {
        t if t < 0.11 => 20.0,
        t if t > 0.6 && t < 0.71 => -20.0,
        _ => 0.0,
    };
    let (fine, mut speed) = (100, 0.0);
    let mut rng = residual_columns::stats::Rng::new(4);
    let (mut velocity, mut exact) = (vec![], vec![]);
    for i in 0..rows * fine {
        let t = i as f64 * dt / fine as f64;
        if i % fine == 0 {
            velocity.push(speed + 0.001 * rng.normal());
            exact.push(acceleration(t));
        }
        speed += acceleration(t) * dt / fine as f64;
    }
    let columns = [("target", exact.clone()), ("velocity", velocity)];
    knowing(MODEL, &columns, rows, |ctx| {
        let slopes = ctx.slopes("velocity");
        let coefficient = |slope: &[f64]| {
            let product = |other: &[f64]| residual_columns::linalg::dot(slope, other);
            product(&exact) / product(slope)
        };
        let without = coefficient(&ctx.values("deriv(velocity, 1)"));
        assert!(without > 1.02, "{without}");
        for half in &slopes.widths()[..3] {
            let with = coefficient(&ctx.values(&slopes.text(*half)));
            assert!((with - 1.0).abs() < 0.008, "{half} {with}");
        }
    });
}

#[test]
fn is_named() {
    crate::rig::names("inertia", |s| 0.2 * s.acceleration);
}
