//! The pictures of a report.

use crate::rig::{simulate, Excitation, Row};
use residual_columns::stats::Rng;
use residual_report::{Effect, Report};

fn effect<'a>(report: &'a Report, name: &str) -> &'a Effect {
    let found = report.effects.iter().find(|e| e.name == name);
    found.unwrap_or_else(|| panic!("no {name}\n{}", report.markdown()))
}

/// Half the height of the line of means before and after.
fn heights(effect: &Effect) -> [f64; 2] {
    [1, 2].map(|column| {
        let means = effect.plot.means.iter().map(|m| m[column]);
        let (lo, hi) = means.fold((f64::MAX, f64::MIN), |(lo, hi), m| (lo.min(m), hi.max(m)));
        0.5 * (hi - lo)
    })
}

/// Each run has a phase of its own; the picture has one.
#[test]
fn a_tone_is_drawn_over_its_period() {
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        0.3 * (std::f64::consts::TAU * 3.7 * s.elapsed + f64::from(s.group)).sin()
    });
    let tone = effect(&report, "tone");
    assert_eq!(tone.plot.against, "time within one period, s");
    let [before, after] = heights(tone);
    assert!(
        (before - 0.3).abs() < 0.05 && after < 0.05,
        "{before} {after}"
    );
    // It begins to rise at the left.
    let first = tone.plot.means[1];
    assert!(first[0] < 0.04 && first[1] > 0.02, "{first:?}");
}

#[test]
fn a_ripple_of_many_periods_is_drawn_over_one() {
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        0.3 * (7.0 * s.angle).sin()
    });
    let ripple = effect(&report, "periodic_angle");
    assert!(
        ripple.plot.against.starts_with("angle within one period, "),
        "{}",
        ripple.plot.against
    );
    let [before, after] = heights(ripple);
    assert!(
        (before - 0.3).abs() < 0.05 && after < 0.05,
        "{before} {after}"
    );
}

/// The zero of each run wanders in its own way, so the means over the time in the run cancel.
#[test]
fn what_shows_in_time_alone_is_drawn_run_by_run() {
    let mut rng = Rng::new(5);
    let mut zero = 0.0;
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        if s.first {
            zero = rng.normal();
        }
        // Forgets within some 15 s.
        zero += 0.05 * rng.normal() - 0.0013 * zero;
        zero
    });
    let plot = report.plot_unknown.as_ref();
    let plot = plot.unwrap_or_else(|| panic!("{}", report.markdown()));
    assert_eq!(plot.against, "time, one run after another, s");
    let means = || plot.means.iter().map(|m| m[2]);
    let (lo, hi) = (
        means().fold(f64::MAX, f64::min),
        means().fold(f64::MIN, f64::max),
    );
    assert!(hi - lo > 2.0 * plot.rms[1], "{lo} {hi} {:?}", plot.rms);
    let last = plot.x.iter().copied().fold(0.0, f64::max);
    assert!(
        plot.x.windows(2).all(|w| w[0] <= w[1]) && last > 300.0,
        "{last}"
    );
}

/// Half the sum and half the difference of the means in the two directions, at a place of the
/// angle.
fn directions(
    effect: &Effect,
    length: f64,
    column: usize,
    within: &dyn Fn(f64) -> bool,
) -> [f64; 2] {
    let mean = |backward: bool| {
        let own: Vec<f64> = effect
            .plot
            .means
            .iter()
            .filter(|m| (m[0] < 0.0) == backward && within(m[0].rem_euclid(length)))
            .map(|m| m[column])
            .collect();
        assert!(own.len() > 1, "{:?}", effect.plot.means);
        own.iter().sum::<f64>() / own.len() as f64
    };
    let (forward, backward) = (mean(false), mean(true));
    [0.5 * (forward + backward), 0.5 * (forward - backward)]
}

/// Over all turns, and over both directions together, the means would cancel.
#[test]
fn friction_that_depends_on_the_angle_is_drawn_in_a_turn_for_each_direction() {
    use std::f64::consts::TAU;
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        let inside = (s.angle - 1.0).rem_euclid(TAU) < 1.2;
        if inside {
            -0.5 * s.velocity.signum()
        } else {
            0.0
        }
    });
    let friction = effect(&report, "angle_friction");
    let label = &friction.plot.against;
    assert!(label.starts_with("angle in a turn, rad;"), "{label}");
    let x = &friction.plot.x;
    assert!(x.iter().all(|x| (-TAU..TAU).contains(x)), "{x:?}");
    let inside = |x: f64| (1.1..2.1).contains(&x);
    let [even, odd] = directions(friction, TAU, 1, &inside);
    assert!(even.abs() < 0.1 && (odd + 0.5).abs() < 0.1, "{even} {odd}");
    let [_, odd] = directions(friction, TAU, 2, &inside);
    assert!(odd.abs() < 0.1, "{odd}");
    let [_, odd] = directions(friction, TAU, 1, &|x| (3.0..5.5).contains(&x));
    assert!(odd.abs() < 0.1, "{odd}");
}

#[test]
fn a_ripple_of_friction_is_drawn_over_one_period() {
    use std::f64::consts::TAU;
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        -(0.5 + 0.3 * (3.0 * s.angle).sin()) * s.velocity.signum()
    });
    let friction = effect(&report, "angle_friction");
    let length = TAU / 3.0;
    let label = &friction.plot.against;
    assert!(label.starts_with("angle in a period, rad;"), "{label}");
    let x = &friction.plot.x;
    assert!(x.iter().all(|x| (-length..length).contains(x)), "{x:?}");
    let [_, odd] = directions(friction, length, 1, &|x| (0.3..0.8).contains(&x));
    assert!((odd + 0.28).abs() < 0.1, "{odd}");
}

/// A loop of Dahl's model over the angle.
fn loop_of_angle(width: f64) -> impl FnMut(&Row) -> f64 {
    let (mut z, mut last) = (0.0, 0.0);
    move |s| {
        if s.first {
            (z, last) = (0.0, s.angle);
        }
        let dx = s.angle - last;
        last = s.angle;
        let sign = if dx >= 0.0 { 1.0 } else { -1.0 };
        z = sign + (z - sign) * (-dx.abs() / width).exp();
        0.5 * z
    }
}

#[test]
fn a_loop_of_position_is_drawn_over_the_position() {
    let report = simulate(&Excitation::default(), 1.0, &mut loop_of_angle(3.0));
    let hysteresis = effect(&report, "hysteresis");
    assert!(hysteresis.form.contains("position"), "{}", hysteresis.form);
    assert_eq!(hysteresis.plot.against, "angle, rad");
}

#[test]
fn an_elastic_turn_is_drawn_over_the_position() {
    let report = simulate(&Excitation::default(), 1.0, &mut loop_of_angle(0.1));
    let presliding = effect(&report, "presliding");
    assert_eq!(presliding.form, "elastic turn");
    assert_eq!(presliding.plot.against, "angle, rad");
}
