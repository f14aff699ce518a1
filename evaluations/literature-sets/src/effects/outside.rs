//! Effects outside any catalogue an analysis could be expected to have. A fair analysis reports
//! that something is left, or names a part that the effect really contains, and does not name a
//! wrong effect with confidence.

use crate::effects::friction::{bouc_wen_state, held_sign};
use crate::parameters::{Draw, Parameters, Scene};
use crate::random::Random;
use crate::world::World;
use std::f64::consts::{PI, TAU};

/// Coulomb friction only while the reel is in a sector of its turn, as from a rubbing spot or a bad
/// weld of the cable (position-dependent friction: Armstrong-Helouvry 1991, "Control of Machines
/// with Friction", chapter 4).
pub fn sector_friction(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (fc, from, width) = (p.get("fc"), p.get("from"), p.get("width"));
    for ((t, sign), angle) in tension.iter_mut().zip(held_sign(world)).zip(&world.angle) {
        if (angle - from).rem_euclid(TAU) < width {
            *t -= fc * sign;
        }
    }
}

/// Draws [`sector_friction`].
pub fn draw_sector_friction(draw: &mut Draw, _: &Scene) {
    draw.scaled("fc", "N", 0.02, 1.0);
    draw.phase("from");
    draw.uniform("width", "rad", 0.3, 0.6 * PI);
}

/// A spring with two slopes: above the load `at` a second load path (a stop, a hinge) takes a share
/// of the force, as in bilinear stiffness (Thompson and Stewart 2002, "Nonlinear Dynamics and
/// Chaos"): `y = F - share max(0, F - at)`.
pub fn kink(p: &Parameters, _: &World, signal: &mut [f64]) {
    let (share, at) = (p.get("share"), p.get("at"));
    for s in signal.iter_mut() {
        *s -= share * (*s - at).max(0.0);
    }
}

/// Draws [`kink`].
pub fn draw_kink(draw: &mut Draw, scene: &Scene) {
    draw.signed("share", "-", 0.003, 0.2);
    let range = scene.max_command_n - scene.min_command_n;
    draw.uniform(
        "at",
        "N",
        scene.min_command_n + 0.3 * range,
        scene.min_command_n + 0.7 * range,
    );
}

/// Bouc-Wen hysteresis whose force is proportional to the load (Do, Tjahjowidodo, Lau and Phee
/// 2014, hysteresis of tendon-sheath transmissions): `T <- T (1 - mu z)`.
pub fn bouc_wen_load(p: &Parameters, world: &World, tension: &mut [f64]) {
    let mu = p.get("mu");
    for (t, z) in tension.iter_mut().zip(bouc_wen_state(p, world)) {
        *t *= 1.0 - mu * z;
    }
}

/// Draws [`bouc_wen_load`].
pub fn draw_bouc_wen_load(draw: &mut Draw, _: &Scene) {
    draw.scaled("mu", "-", 0.01, 0.3);
    draw.log("d", "rad", 0.02, 0.5);
    draw.uniform("beta", "-", 0.5, 0.9);
    draw.choice("n", "-", &[1.0, 2.0, 3.0]);
}

/// Contact bursts at rest: an external contact with the resting cable. Decaying oscillations at
/// random times (a Poisson process), cut off where the reel moves again.
pub fn rest_bursts(p: &Parameters, world: &World, tension: &mut [f64]) {
    let mut random = Random::new(world.seed, "rest-bursts");
    let chance = p.get("rate") * world.dt;
    bursts(
        p,
        world,
        tension,
        |_, resting| resting && random.chance(chance),
        true,
    );
}

/// Draws [`rest_bursts`].
pub fn draw_rest_bursts(draw: &mut Draw, _: &Scene) {
    draw_burst(draw);
    draw.log("rate", "1/s", 1.0, 5.0);
}

/// Bursts on release: each time the reel breaks loose after a rest the cable rings (stick-slip:
/// Rabinowicz 1958; Armstrong-Helouvry, Dupont and Canudas de Wit 1994).
pub fn release_bursts(p: &Parameters, world: &World, tension: &mut [f64]) {
    let mut rested = 0.0;
    bursts(
        p,
        world,
        tension,
        |_, resting| {
            let release = !resting && rested > 0.1;
            rested = if resting { rested + world.dt } else { 0.0 };
            release
        },
        false,
    );
}

/// Draws [`release_bursts`].
pub fn draw_release_bursts(draw: &mut Draw, _: &Scene) {
    draw_burst(draw);
}

fn draw_burst(draw: &mut Draw) {
    draw.scaled("a", "N", 0.02, 1.0);
    draw.log("f", "Hz", 2.0, 12.0);
    draw.log("decay", "s", 0.05, 0.3);
}

/// Adds `a cos(2 pi f t) exp(-t/decay)` from each start, with a random sign and an amplitude of 0.5
/// to 1.5 times `a`.
fn bursts(
    p: &Parameters,
    world: &World,
    tension: &mut [f64],
    mut starts: impl FnMut(usize, bool) -> bool,
    only_at_rest: bool,
) {
    let (a, f, decay) = (p.get("a"), p.get("f"), p.get("decay"));
    let mut random = Random::new(world.seed, "bursts");
    let (mut amplitude, mut since) = (0.0, 0.0);
    for (i, t) in tension.iter_mut().enumerate() {
        let resting = world.velocity[i] == 0.0;
        if starts(i, resting) {
            (amplitude, since) = (random.sign() * random.uniform(0.5, 1.5), 0.0);
        }
        if only_at_rest && !resting {
            amplitude = 0.0;
        }
        *t += a * amplitude * (TAU * f * since).cos() * (-since / decay).exp();
        since += world.dt;
    }
}
