//! Friction of the drive and the cable guide. All take away from the tension while the reel winds
//! in (velocity > 0).

use crate::parameters::{Draw, Parameters, Scene};
use crate::world::{interpolate, World};
use std::f64::consts::PI;

/// Range of a Coulomb level in N.
const COULOMB: [f64; 2] = [0.02, 1.0];

/// The Stribeck curve: `fc + (fs - fc) exp(-|v/vs|^delta)` (Bo and Pavelescu 1982, "The
/// friction-speed relation and its influence on the critical velocity of stick-slip motion", Wear
/// 82; `delta = 1` is Tustin 1947, `delta = 2` Armstrong-Helouvry 1991).
pub fn stribeck(speed: f64, fc: f64, fs: f64, vs: f64, delta: f64) -> f64 {
    fc + (fs - fc) * (-(speed.abs() / vs).powf(delta)).exp()
}

/// For each step the sign of the velocity; at rest the last one, before the first motion 0.
pub fn held_sign(world: &World) -> impl Iterator<Item = f64> + '_ {
    let mut held = 0.0;
    world.velocity.iter().map(move |v| {
        if *v != 0.0 {
            held = v.signum();
        }
        held
    })
}

/// Coulomb 1785: a force of constant magnitude against the motion. At rest it keeps its last sign,
/// which is the limit of a Dahl model with a short presliding distance; before the first motion it
/// is 0.
pub fn coulomb(p: &Parameters, world: &World, tension: &mut [f64]) {
    let fc = p.get("fc");
    for (t, sign) in tension.iter_mut().zip(held_sign(world)) {
        *t -= fc * sign;
    }
}

/// Draws [`coulomb`].
pub fn draw_coulomb(draw: &mut Draw, _: &Scene) {
    draw.scaled("fc", "N", COULOMB[0], COULOMB[1]);
}

/// Euler 1769 and Eytelwein 1808, the capstan: a cable that slides over a guide with wrap angle
/// `phi` and friction coefficient `mu` leaves it with `exp(-mu phi sgn(v))` times its tension.
/// Kaneko, Yamashita and Tanie 1991 and Palli and Melchiorri 2006 use it for tendons. At rest the
/// sign is held.
pub fn capstan(p: &Parameters, world: &World, tension: &mut [f64]) {
    let exponent = p.get("mu") * p.get("phi");
    for (t, sign) in tension.iter_mut().zip(held_sign(world)) {
        *t *= (-exponent * sign).exp();
    }
}

/// Draws [`capstan`]. PTFE on steel has a friction coefficient of about 0.04, steel on brass of
/// about 0.3.
pub fn draw_capstan(draw: &mut Draw, _: &Scene) {
    draw.scaled("mu", "-", 0.01, 0.3);
    draw.uniform("phi", "rad", 0.5 * PI, 3.0 * PI);
}

/// Viscous friction (Reynolds 1886): `b v`.
pub fn viscous(p: &Parameters, world: &World, tension: &mut [f64]) {
    let b = p.get("b");
    for (t, v) in tension.iter_mut().zip(&world.velocity) {
        *t -= b * v;
    }
}

/// Draws [`viscous`].
pub fn draw_viscous(draw: &mut Draw, _: &Scene) {
    draw.scaled("b", "N s/rad", 0.002, 0.2);
}

/// Viscous friction that grows with the load: `b (1 + kappa u) v`, with the commanded force `u` as
/// load (Waiboer, Aarts and Jonker 2005 and Bittencourt and Gunnarsson 2012 find such a dependence
/// on load in robot joints).
pub fn viscous_load(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (b, kappa) = (p.get("b"), p.get("kappa"));
    for ((t, v), u) in tension.iter_mut().zip(&world.velocity).zip(&world.command) {
        *t -= b * (1.0 + kappa * u) * v;
    }
}

/// Draws [`viscous_load`].
pub fn draw_viscous_load(draw: &mut Draw, _: &Scene) {
    draw.scaled("b", "N s/rad", 0.002, 0.1);
    draw.log("kappa", "1/N", 0.1, 1.0);
}

/// Viscous friction of a lubricant that thins with temperature: `b exp(-beta (T - 25)) v` (Reynolds
/// 1886; for robot joints Bittencourt and Gunnarsson 2012, who find a halving over about 20 K).
pub fn viscous_temperature(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (b, beta) = (p.get("b"), p.get("beta"));
    for ((t, v), temperature) in tension
        .iter_mut()
        .zip(&world.velocity)
        .zip(&world.temperature)
    {
        *t -= b * (-beta * (temperature - 25.0)).exp() * v;
    }
}

/// Draws [`viscous_temperature`].
pub fn draw_viscous_temperature(draw: &mut Draw, _: &Scene) {
    draw.scaled("b", "N s/rad", 0.002, 0.2);
    draw.uniform("beta", "1/K", 0.02, 0.06);
}

/// Dahl 1968, "A solid friction model", and 1976:
/// `dF/dx = (fc/d) |1 - (F/fc) sgn v|^i sgn(1 - (F/fc) sgn v)`, where `d = fc/sigma` is the
/// presliding distance. Each step is integrated in closed form.
pub fn dahl(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (fc, d, i) = (p.get("fc"), p.get("d"), p.get("i"));
    let mut h: f64 = 0.0;
    for (t, v) in tension.iter_mut().zip(&world.velocity) {
        h = dahl_step(h, v * world.dt, d, i);
        *t -= fc * h;
    }
}

/// The Dahl state `F/fc` after a displacement `dx`, from `h`. With `g = 1 - h sgn(dx)`:
/// `dg/ds = -g^i`, `s = |dx|/d`.
pub fn dahl_step(h: f64, dx: f64, d: f64, i: f64) -> f64 {
    if dx == 0.0 {
        return h;
    }
    let (sign, s) = (dx.signum(), dx.abs() / d);
    let gap = (1.0 - h * sign).max(0.0);
    if gap == 0.0 {
        return sign;
    }
    let gap = if i == 1.0 {
        gap * (-s).exp()
    } else {
        (gap.powf(1.0 - i) - (1.0 - i) * s)
            .max(0.0)
            .powf(1.0 / (1.0 - i))
    };
    sign * (1.0 - gap)
}

/// Draws [`dahl`].
pub fn draw_dahl(draw: &mut Draw, _: &Scene) {
    draw.scaled("fc", "N", COULOMB[0], COULOMB[1]);
    draw.log("d", "rad", 3e-3, 0.3);
    draw.choice("i", "-", &[1.0, 1.0, 0.5, 1.5, 2.0]);
}

/// LuGre: Canudas de Wit, Olsson, Astrom and Lischinsky 1995, "A new model for control of systems
/// with friction", IEEE TAC 40(3): `dz/dt = v - sigma0 |v| z / g(v)`,
/// `F = sigma0 z + sigma1 dz/dt + sigma2 v`, with `g` the [`stribeck`] curve. `sigma0 = fc/d`.
pub fn lugre(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (fc, fs, vs, d) = (p.get("fc"), p.get("fs"), p.get("vs"), p.get("d"));
    let (sigma0, sigma1, sigma2) = (fc / d, p.get("sigma1"), p.get("sigma2"));
    let mut z = 0.0;
    for (t, v) in tension.iter_mut().zip(&world.velocity) {
        let before = z;
        if *v != 0.0 && sigma0 != 0.0 {
            // Exact for a constant velocity within the step.
            let g = stribeck(*v, fc, fs, vs, 2.0);
            let steady = v.signum() * g / sigma0;
            z = steady + (z - steady) * (-sigma0 * v.abs() * world.dt / g).exp();
        }
        *t -= sigma0 * z + sigma1 * (z - before) / world.dt + sigma2 * v;
    }
}

/// Draws [`lugre`].
pub fn draw_lugre(draw: &mut Draw, _: &Scene) {
    let fc = draw.scaled("fc", "N", COULOMB[0], COULOMB[1]);
    draw.scaled_ratio("fs", "N", fc, COULOMB, [1.1, 2.0]);
    draw.log("vs", "rad/s", 0.05, 0.8);
    draw.log("d", "rad", 2e-3, 0.1);
    draw.scaled_ratio("sigma1", "N s/rad", fc, COULOMB, [0.0, 0.02]);
    draw.scaled_ratio("sigma2", "N s/rad", fc, COULOMB, [0.0, 0.1]);
}

/// The seven-parameter model of Armstrong-Helouvry, Dupont and Canudas de Wit 1994, "A survey of
/// models, analysis tools and compensation methods for the control of machines with friction",
/// Automatica 30(7), with the exponential of Bo and Pavelescu for the Stribeck part.
///
/// - Presliding: a spring, `F = kt x`, with `kt = fs_inf/d`, until `F` reaches the static friction.
/// - Static friction that rises with the dwell time `t2` in presliding:
///   `fs = fs_a + (fs_inf - fs_a) t2 / (t2 + gamma)`.
/// - Sliding: `F = [fc + (fs - fc) exp(-|v(t - tau_l)/vs|^delta)] sgn(v) + fv v`, with the
///   frictional memory `tau_l`.
pub fn armstrong(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (fc, fv, fs_a, fs_inf) = (p.get("fc"), p.get("fv"), p.get("fs_a"), p.get("fs_inf"));
    let (vs, delta, gamma) = (p.get("vs"), p.get("delta"), p.get("gamma"));
    let kt = fs_inf / p.get("d");
    let memory = p.get("tau_l") * 1e-3 / world.dt;
    let (mut spring, mut dwell, mut fs, mut sliding) = (0.0_f64, 0.0, fs_a, 0.0_f64);
    for (i, t) in tension.iter_mut().enumerate() {
        let v = world.velocity[i];
        if sliding != 0.0 && v * sliding <= 0.0 {
            (sliding, dwell) = (0.0, 0.0);
        }
        if sliding == 0.0 {
            spring += kt * v * world.dt;
            dwell += world.dt;
            fs = fs_a + (fs_inf - fs_a) * dwell / (dwell + gamma);
            if spring.abs() >= fs && v * spring > 0.0 {
                sliding = v.signum();
            }
            spring = spring.clamp(-fs_inf, fs_inf);
        }
        if sliding != 0.0 {
            let remembered = interpolate(&world.velocity, i as f64 - memory);
            spring = stribeck(remembered, fc, fs, vs, delta) * sliding;
        }
        *t -= spring + fv * v;
    }
}

/// Draws [`armstrong`]. Ranges of `tau_l` (1 ms to 50 ms) and `gamma` (0 s to 200 s) from the
/// survey's table of parameters, `gamma` cut to what a run of a minute can show.
pub fn draw_armstrong(draw: &mut Draw, _: &Scene) {
    let fc = draw.scaled("fc", "N", COULOMB[0], COULOMB[1]);
    draw.scaled_ratio("fs_a", "N", fc, COULOMB, [1.0, 1.2]);
    draw.scaled_ratio("fs_inf", "N", fc, COULOMB, [1.3, 2.2]);
    draw.scaled_ratio("fv", "N s/rad", fc, COULOMB, [0.0, 0.1]);
    draw.log("vs", "rad/s", 0.05, 0.8);
    draw.choice("delta", "-", &[0.5, 1.0, 2.0]);
    draw.log("d", "rad", 1e-3, 0.05);
    draw.log("tau_l", "ms", 1.0, 50.0);
    draw.log("gamma", "s", 0.1, 20.0);
}

/// Elements of [`maxwell_slip`].
const ELEMENTS: usize = 8;

/// Generalised Maxwell-slip: Al-Bender, Lampaert and Swevers 2005, "The generalized Maxwell-slip
/// model", IEEE TAC 50(11). Parallel elements, each with a share `alpha = 1/8` of the friction:
/// sticking `dF/dx = k`, until `|F| = alpha s(v)`; then slipping
/// `dF/dt = sgn(v) C (alpha - |F|/s(v))`, until the velocity reverses. `s(v)` is the [`stribeck`]
/// curve. The distances at which the elements break away are log-spaced from `d_min` to `d_max`.
pub fn maxwell_slip(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (fc, fs, vs, delta) = (p.get("fc"), p.get("fs"), p.get("vs"), p.get("delta"));
    let (d_min, d_max, attraction) = (p.get("d_min"), p.get("d_max"), p.get("c"));
    let alpha = 1.0 / ELEMENTS as f64;
    let stiffness: Vec<f64> = (0..ELEMENTS)
        .map(|e| alpha * fs / (d_min * (d_max / d_min).powf(e as f64 / (ELEMENTS - 1) as f64)))
        .collect();
    let mut force = [0.0_f64; ELEMENTS];
    let mut slipping = [0.0_f64; ELEMENTS];
    for (t, v) in tension.iter_mut().zip(&world.velocity) {
        if *v == 0.0 {
            // Elements stick at rest and hold their force.
            slipping = [0.0; ELEMENTS];
            *t -= force.iter().sum::<f64>();
            continue;
        }
        let s = stribeck(*v, fc, fs, vs, delta);
        let decay = (-attraction * world.dt / s).exp();
        for e in 0..ELEMENTS {
            if slipping[e] != 0.0 && v * slipping[e] <= 0.0 {
                slipping[e] = 0.0;
            }
            let limit = alpha * s;
            if slipping[e] == 0.0 {
                force[e] += stiffness[e] * v * world.dt;
                if force[e].abs() >= limit && force[e] * v > 0.0 {
                    slipping[e] = v.signum();
                    // The overshoot of one step is not part of the model.
                    force[e] = force[e].clamp(-alpha * fs, alpha * fs);
                }
            } else {
                let steady = limit * slipping[e];
                force[e] = steady + (force[e] - steady) * decay;
            }
        }
        *t -= force.iter().sum::<f64>();
    }
}

/// Draws [`maxwell_slip`].
pub fn draw_maxwell_slip(draw: &mut Draw, _: &Scene) {
    let fc = draw.scaled("fc", "N", COULOMB[0], COULOMB[1]);
    draw.scaled_ratio("fs", "N", fc, COULOMB, [1.05, 2.0]);
    draw.log("vs", "rad/s", 0.05, 0.8);
    draw.choice("delta", "-", &[1.0, 2.0]);
    draw.log("d_min", "rad", 1e-3, 0.01);
    draw.log("d_max", "rad", 0.02, 0.3);
    draw.scaled_ratio("c", "N/s", fc, COULOMB, [10.0, 200.0]);
}

/// Bouc 1967 and Wen 1976, "Method for random vibration of hysteretic systems": the hysteretic part
/// `F = fh z` with `d dz/dx = 1 - |z|^n (gamma + beta sgn(v z))`, `gamma = 1 - beta`, so that `|z|`
/// stays below 1. Integrated with the midpoint rule in substeps of at most a tenth of `d`.
pub fn bouc_wen(p: &Parameters, world: &World, tension: &mut [f64]) {
    let fh = p.get("fh");
    for (t, z) in tension.iter_mut().zip(bouc_wen_state(p, world)) {
        *t -= fh * z;
    }
}

/// The hysteretic state `z` of [`bouc_wen`] for each step.
pub fn bouc_wen_state<'a>(p: &Parameters, world: &'a World) -> impl Iterator<Item = f64> + 'a {
    let (beta, n, d) = (p.get("beta"), p.get("n"), p.get("d"));
    let mut z = 0.0_f64;
    world.velocity.iter().map(move |v| {
        let dx = v * world.dt / d;
        if dx.abs() > 10.0 {
            // Settled after ten times `d` in one direction.
            z = dx.signum();
            return z;
        }
        let substeps = (dx.abs() * 10.0).ceil();
        let h = dx / substeps.max(1.0);
        let slope = |z: f64| 1.0 - z.abs().powf(n) * (1.0 - beta + beta * (h * z).signum());
        for _ in 0..substeps as usize {
            let middle = z + 0.5 * h * slope(z);
            z += h * slope(middle);
        }
        z
    })
}

/// Draws [`bouc_wen`].
pub fn draw_bouc_wen(draw: &mut Draw, _: &Scene) {
    draw.scaled("fh", "N", COULOMB[0], COULOMB[1]);
    draw.log("d", "rad", 5e-3, 0.3);
    draw.uniform("beta", "-", 0.5, 0.9);
    draw.choice("n", "-", &[1.0, 2.0, 3.0]);
}
