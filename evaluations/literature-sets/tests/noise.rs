//! The noise has the spectrum that its colour says.

mod common;

use common::{amplitude, assert_near, tone_phase};
use literature_sets::fit::rms;
use literature_sets::noise::{alias_hz, scale_to_rms, Colour};
use literature_sets::random::Random;

const ROWS: usize = 4096;
const RATE_HZ: f64 = 100.0;

/// Mean power of a colour around a frequency in Hz, over 40 runs.
fn power(colour: &Colour, around_hz: f64) -> f64 {
    let mut random = Random::new(3, "noise test");
    let phase = tone_phase(ROWS, RATE_HZ);
    let resolution = RATE_HZ / ROWS as f64;
    let bins: Vec<f64> = (-2..=2)
        .map(|n| ((around_hz / resolution).round() + f64::from(n)) * resolution)
        .collect();
    let mut sum = 0.0;
    for _ in 0..40 {
        let noise = colour.generate(ROWS, RATE_HZ, &mut random);
        sum += bins
            .iter()
            .map(|f| amplitude(&noise, &phase, *f).powi(2))
            .sum::<f64>();
    }
    sum / 200.0
}

#[test]
fn white_noise_is_flat_and_has_its_power() {
    // A line of white noise of variance 1 has the mean squared amplitude 4/rows.
    for f in [1.0, 10.0, 45.0] {
        assert_near(power(&Colour::WHITE, f) * ROWS as f64 / 4.0, 1.0, 0.25);
    }
}

#[test]
fn autoregressive_noise_has_the_spectrum_of_its_coefficient() {
    let colour = Colour {
        white: 0.0,
        autoregressive: 1.0,
        coefficient: 0.8,
        ..Colour::WHITE
    };
    for f in [1.0, 5.0, 40.0] {
        let cos = (std::f64::consts::TAU * f / RATE_HZ).cos();
        let expected = (1.0 - 0.64) / (1.0 + 0.64 - 1.6 * cos);
        assert_near(power(&colour, f) * ROWS as f64 / 4.0 / expected, 1.0, 0.25);
    }
}

#[test]
fn flicker_noise_falls_as_one_over_f() {
    let colour = Colour {
        white: 0.0,
        flicker: 1.0,
        ..Colour::WHITE
    };
    let at = |f: f64| power(&colour, f) * f;
    let reference = at(1.0);
    for f in [0.3, 3.0, 10.0] {
        assert_near(at(f) / reference, 1.0, 0.35);
    }
}

#[test]
fn tone_appears_at_its_alias() {
    let colour = Colour {
        white: 0.5,
        tone: 0.5,
        tone_hz: 60.0,
        ..Colour::WHITE
    };
    assert_near(alias_hz(60.0, RATE_HZ), 40.0, 1e-12);
    assert_near(alias_hz(100.05, RATE_HZ), 0.05, 1e-9);
    let noise = colour.generate(ROWS, RATE_HZ, &mut Random::new(1, "tone"));
    assert_near(
        amplitude(&noise, &tone_phase(ROWS, RATE_HZ), 40.0),
        1.0,
        0.06,
    );
}

#[test]
fn every_colour_has_variance_one() {
    let mut random = Random::new(9, "colours");
    for _ in 0..6 {
        let colour = Colour::draw(&mut random);
        let runs: Vec<f64> = (0..60)
            .flat_map(|_| colour.generate(ROWS, RATE_HZ, &mut random))
            .collect();
        assert_near(rms(&runs), 1.0, 0.05);
        assert_near(
            colour.white + colour.autoregressive + colour.flicker + colour.tone,
            1.0,
            1e-12,
        );
    }
}

#[test]
fn scaling_is_exact_over_all_runs() {
    let mut runs = vec![vec![1.0; 10], vec![-3.0; 30]];
    scale_to_rms(&mut runs, 0.02);
    assert_near(rms(&runs.concat()), 0.02, 1e-15);
    assert_near(runs[1][0] / runs[0][0], -3.0, 1e-12);
}
