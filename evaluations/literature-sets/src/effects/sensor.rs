//! The load cell, its amplifier and the logger.

use crate::parameters::{Draw, Parameters, Scene};
use crate::random::Random;
use crate::world::{interpolate, World};
use crate::FULL_SCALE_N;
use std::f64::consts::TAU;

/// Reference temperature of the load cell in degrees Celsius.
pub const REFERENCE_C: f64 = 25.0;

/// A second-order lag, `y'' + 2 zeta omega y' + omega^2 y = omega^2 x`, exact for inputs that are
/// linear between steps.
#[derive(Clone, Copy, Debug)]
pub struct SecondOrder {
    omega: f64,
    zeta: f64,
    /// Output.
    pub value: f64,
    /// Time derivative of the output, per s.
    pub slope: f64,
}

impl SecondOrder {
    /// In equilibrium with an input. `omega` in rad/s, `zeta` below 1.
    pub fn at_rest(omega: f64, zeta: f64, input: f64) -> Self {
        Self {
            omega,
            zeta: zeta.min(0.999),
            value: input,
            slope: 0.0,
        }
    }

    /// One step of `dt` s while the input goes from `from` to `to`.
    pub fn step(&mut self, from: f64, to: f64, dt: f64) {
        let (omega, zeta) = (self.omega, self.zeta);
        let rate = (to - from) / dt;
        // A ramp is followed at a distance of 2 zeta / omega times its rate.
        let behind = rate * 2.0 * zeta / omega;
        let (error, error_slope) = (self.value - (from - behind), self.slope - rate);
        let damped = omega * (1.0 - zeta * zeta).sqrt();
        let (sin, cos) = (damped * dt).sin_cos();
        let decay = (-zeta * omega * dt).exp();
        let quadrature = (error_slope + zeta * omega * error) / damped;
        self.value = to - behind + decay * (error * cos + quadrature * sin);
        self.slope = rate
            + decay
                * (-zeta * omega * (error * cos + quadrature * sin)
                    + damped * (quadrature * cos - error * sin));
    }
}

/// First-order lag of the sensor (any text on measurement, for example Doebelin 2003, "Measurement
/// Systems"): `tau y' + y = F`. Exact for signals that are linear between steps.
pub fn lag_first(p: &Parameters, world: &World, signal: &mut [f64]) {
    let tau = p.get("tau") * 1e-3;
    if tau <= 0.0 {
        return;
    }
    let decay = (-world.dt / tau).exp();
    let (mut y, mut before) = (signal[0], signal[0]);
    for s in signal.iter_mut() {
        let rate = *s - before;
        y = decay * (y - before) + *s - rate * tau / world.dt * (1.0 - decay);
        before = *s;
        *s = y;
    }
}

/// Draws [`lag_first`].
pub fn draw_lag_first(draw: &mut Draw, _: &Scene) {
    draw.scaled("tau", "ms", 1.0, 100.0);
}

/// Second-order lag of the sensor (Doebelin 2003): `y'' + 2 zeta y'/tau + y/tau^2 = F/tau^2`.
pub fn lag_second(p: &Parameters, world: &World, signal: &mut [f64]) {
    let tau = p.get("tau") * 1e-3;
    if tau <= 0.0 {
        return;
    }
    let mut lag = SecondOrder::at_rest(1.0 / tau, p.get("zeta"), signal[0]);
    let mut before = signal[0];
    for s in signal.iter_mut() {
        lag.step(before, *s, world.dt);
        before = *s;
        *s = lag.value;
    }
}

/// Draws [`lag_second`].
pub fn draw_lag_second(draw: &mut Draw, _: &Scene) {
    draw.scaled("tau", "ms", 1.0, 60.0);
    draw.uniform("zeta", "-", 0.3, 0.95);
}

/// Pure delay: `y(t) = F(t - tau)`.
pub fn delay(p: &Parameters, world: &World, signal: &mut [f64]) {
    let steps = p.get("tau") * 1e-3 / world.dt;
    let old = signal.to_vec();
    for (i, s) in signal.iter_mut().enumerate() {
        *s = interpolate(&old, i as f64 - steps);
    }
}

/// Draws [`delay`].
pub fn draw_delay(draw: &mut Draw, _: &Scene) {
    draw.scaled("tau", "ms", 1.0, 100.0);
}

/// Two loggers with clocks of different rate (Mills 1991, "Internet time synchronization": offset,
/// skew and drift of clocks). Both start together; at the time `t` of the log the force was taken
/// at `t + skew t + drift t^2/2`.
pub fn clock_skew(p: &Parameters, world: &World, signal: &mut [f64]) {
    let (skew, drift) = (p.get("skew") * 1e-6, p.get("drift") * 1e-6 / 60.0);
    let old = signal.to_vec();
    for (i, s) in signal.iter_mut().enumerate() {
        let time = world.time(i);
        *s = world.sample(&old, time + skew * time + 0.5 * drift * time * time);
    }
}

/// Draws [`clock_skew`]. Crystals are within 20 ppm to 100 ppm, RC oscillators within 1 %.
pub fn draw_clock_skew(draw: &mut Draw, _: &Scene) {
    let skew = draw.signed("skew", "ppm", 20.0, 10_000.0);
    draw.scaled_ratio("drift", "ppm/min", skew, [-10_000.0, 10_000.0], [-0.3, 0.3]);
}

/// Creep of the load cell: OIML R 60 (2017) defines it as the change of the output under constant
/// load and tests it with the return to zero. Anelastic relaxation with two time constants (Zener
/// 1948, "Elasticity and Anelasticity of Metals"): `y = F + a1 x1 + a2 x2`, `tau x' + x = F`. The
/// cell is unloaded before the run starts.
pub fn creep(p: &Parameters, world: &World, signal: &mut [f64]) {
    let (a1, a2) = (p.get("a1") * 1e-2, p.get("a2") * 1e-2);
    let (k1, k2) = (
        1.0 - (-world.dt / p.get("tau1")).exp(),
        1.0 - (-world.dt / p.get("tau2")).exp(),
    );
    let (mut x1, mut x2) = (0.0, 0.0);
    for s in signal.iter_mut() {
        x1 += k1 * (*s - x1);
        x2 += k2 * (*s - x2);
        *s += a1 * x1 + a2 * x2;
    }
}

/// Draws [`creep`]. OIML class C cells creep by less than about 0.03 % of the load in 30 min, cheap
/// ones by 0.1 %.
pub fn draw_creep(draw: &mut Draw, _: &Scene) {
    let a1 = draw.signed("a1", "% of load", 0.01, 0.3);
    draw.scaled_ratio("a2", "% of load", a1, [-0.3, 0.3], [0.3, 1.5]);
    draw.log("tau1", "s", 4.0, 30.0);
    draw.log("tau2", "s", 60.0, 600.0);
}

/// Nonlinearity of the load cell's characteristic (OIML R 60; VDI/VDE/DKD 2638), as polynomial of
/// the load over the full scale `fs` = 15 N: `y = F + fs [c2 (F/fs)^2 + c3 (F/fs)^3]`.
pub fn nonlinearity(p: &Parameters, _: &World, signal: &mut [f64]) {
    let (c2, c3) = (p.get("c2") * 1e-2, p.get("c3") * 1e-2);
    for s in signal.iter_mut() {
        let x = *s / FULL_SCALE_N;
        *s += FULL_SCALE_N * x * x * (c2 + c3 * x);
    }
}

/// Draws [`nonlinearity`].
pub fn draw_nonlinearity(draw: &mut Draw, _: &Scene) {
    let c2 = draw.signed("c2", "% of full scale", 0.02, 1.0);
    draw.scaled_ratio("c3", "% of full scale", c2, [-1.0, 1.0], [-0.7, 0.7]);
}

/// Temperature coefficient of the zero (OIML R 60: temperature effect on minimum dead load output):
/// `y = F + z (T - 25 degrees)`.
pub fn temperature_zero(p: &Parameters, world: &World, signal: &mut [f64]) {
    let z = p.get("z") * 1e-3;
    for (s, temperature) in signal.iter_mut().zip(&world.temperature) {
        *s += z * (temperature - REFERENCE_C);
    }
}

/// Draws [`temperature_zero`]. 0.02 % of 15 N over 10 K are 0.3 mN/K; uncompensated bridges have
/// ten times as much.
pub fn draw_temperature_zero(draw: &mut Draw, _: &Scene) {
    draw.signed("z", "mN/K", 0.1, 10.0);
}

/// Temperature coefficient of the span (OIML R 60: temperature effect on sensitivity):
/// `y = F [1 + s (T - 25 degrees)]`.
pub fn temperature_span(p: &Parameters, world: &World, signal: &mut [f64]) {
    let span = p.get("s") * 1e-2;
    for (s, temperature) in signal.iter_mut().zip(&world.temperature) {
        *s *= 1.0 + span * (temperature - REFERENCE_C);
    }
}

/// Draws [`temperature_span`].
pub fn draw_temperature_span(draw: &mut Draw, _: &Scene) {
    draw.signed("s", "%/K", 0.001, 0.05);
}

/// Crosstalk from the loads of two neighbour channels (Webster 1999, "The Measurement,
/// Instrumentation and Sensors Handbook"; data sheets of multiplexed amplifiers):
/// `y = F + c1 n1 + c2 n2`.
pub fn crosstalk(p: &Parameters, world: &World, signal: &mut [f64]) {
    let (c1, c2) = (p.get("c1") * 1e-2, p.get("c2") * 1e-2);
    for (i, s) in signal.iter_mut().enumerate() {
        *s += c1 * world.neighbours[0][i] + c2 * world.neighbours[1][i];
    }
}

/// Draws [`crosstalk`].
pub fn draw_crosstalk(draw: &mut Draw, _: &Scene) {
    let c1 = draw.signed("c1", "%", 0.1, 3.0);
    draw.scaled_ratio("c2", "%", c1, [-3.0, 3.0], [-0.8, 0.8]);
}

/// Saturation of the amplifier (Doebelin 2003): the output stays at `reference - depth`, with the
/// largest reading of the set without effects as reference. It also clips the noise, so readings at
/// the limit repeat exactly.
pub fn clipping(p: &Parameters, _: &World, signal: &mut [f64]) {
    let level = clipping_level(p);
    for s in signal.iter_mut() {
        *s = s.min(level);
    }
}

/// Level of [`clipping`] in N.
pub fn clipping_level(p: &Parameters) -> f64 {
    p.get("reference") - p.get("depth")
}

/// Draws [`clipping`].
pub fn draw_clipping(draw: &mut Draw, scene: &Scene) {
    draw.given("reference", "N", scene.max_reading_n);
    draw.scaled("depth", "N", 0.1, 5.0);
}

/// Mains pick-up (Horowitz and Hill 2015, "The Art of Electronics"): a tone at 50 Hz or 60 Hz or
/// twice that, sampled without a filter. The phase differs from run to run.
pub fn mains(p: &Parameters, world: &World, signal: &mut [f64]) {
    let (a, f) = (p.get("a"), p.get("nominal") * (1.0 + p.get("detune")));
    let phase = Random::new(world.seed, "mains").uniform(0.0, TAU);
    for (i, s) in signal.iter_mut().enumerate() {
        *s += a * (TAU * f * world.time(i) + phase).sin();
    }
}

/// Draws [`mains`]. The grid is within 0.1 % of its nominal frequency.
pub fn draw_mains(draw: &mut Draw, _: &Scene) {
    draw.scaled("a", "N", 0.001, 0.2);
    draw.choice("nominal", "Hz", &[50.0, 60.0, 100.0, 120.0]);
    draw.uniform("detune", "-", -0.001, 0.001);
}
