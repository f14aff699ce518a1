//! Small runs with known motion for the tests.
#![allow(dead_code)]

use literature_sets::effects::by_name;
use literature_sets::parameters::{Parameters, Scene};
use literature_sets::random::Random;
use literature_sets::world::World;
use std::f64::consts::TAU;

/// Step of the grid of the tests in s.
pub const DT: f64 = 1e-3;

/// A run of `seconds` with a velocity in rad/s and a command in N over the time in s; 25 degrees,
/// no neighbours.
pub fn world(seconds: f64, velocity: impl Fn(f64) -> f64, command: impl Fn(f64) -> f64) -> World {
    let n = (seconds / DT).round() as usize;
    let time = |i: usize| i as f64 * DT;
    let mut world = World {
        dt: DT,
        start: 0.0,
        seed: 5,
        velocity: (0..n).map(|i| velocity(time(i))).collect(),
        command: (0..n).map(|i| command(time(i))).collect(),
        temperature: vec![25.0; n],
        neighbours: [vec![0.0; n], vec![0.0; n]],
        pose: [vec![0.0; n], vec![0.0; n]],
        ..World::default()
    };
    world.integrate_angle(0.0);
    world
}

/// Parameters of an effect with given values; the others are drawn.
pub fn parameters(name: &str, values: &[(&str, f64)]) -> Parameters {
    let scene = Scene {
        rate_hz: 100.0,
        max_command_n: 10.0,
        min_command_n: 2.0,
        max_reading_n: 10.0,
        travel_rad: 5.0,
        max_speed_rad_s: 3.0,
    };
    let drawn = by_name(name)
        .unwrap()
        .draw(&mut Random::new(1, "test"), &scene);
    values.iter().fold(drawn, |p, (name, value)| {
        p.get(name);
        p.with(name, *value)
    })
}

/// The reading with an effect, from a tension that equals the command.
pub fn reading(name: &str, values: &[(&str, f64)], world: &World) -> Vec<f64> {
    let mut signal = world.command.clone();
    (by_name(name).unwrap().apply)(&parameters(name, values), world, &mut signal);
    signal
}

/// What an effect takes away from the command: its friction.
pub fn friction(name: &str, values: &[(&str, f64)], world: &World) -> Vec<f64> {
    world
        .command
        .iter()
        .zip(reading(name, values, world))
        .map(|(u, f)| u - f)
        .collect()
}

/// Amplitude of a signal at an order of a phase (cycles for each `TAU` of the phase), by
/// correlation.
pub fn amplitude(signal: &[f64], phase: &[f64], order: f64) -> f64 {
    let sum = |f: fn(f64) -> f64| {
        signal
            .iter()
            .zip(phase)
            .map(|(x, p)| x * f(order * p))
            .sum::<f64>()
    };
    (sum(f64::sin).powi(2) + sum(f64::cos).powi(2)).sqrt() * 2.0 / signal.len() as f64
}

/// Phase of a tone in rad for each row.
pub fn tone_phase(rows: usize, rate_hz: f64) -> Vec<f64> {
    (0..rows).map(|i| TAU * i as f64 / rate_hz).collect()
}

pub fn assert_near(value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{value} is not {expected} +- {tolerance}"
    );
}
