//! The drive between motor and cable: ripple over the angle, backlash, elasticity, inertia,
//! gravity.

use crate::effects::sensor::SecondOrder;
use crate::parameters::{Draw, Parameters, Scene};
use crate::world::World;
use crate::REEL_RADIUS_M;
use std::f64::consts::PI;

/// Ratio of the gear between motor and reel of the rig.
pub const GEAR_RATIO: f64 = 26.0 / 7.0;

const GRAVITY_M_S2: f64 = 9.80665;

/// Kinematic error of a harmonic drive: Tuttle and Seering 1996, "A nonlinear model of a harmonic
/// drive gear transmission", IEEE TRA 12(3); Ghorbel, Gandhi and Alpeter 2001. The wave generator
/// turns `n` times for one turn of the reel; the error of the output has lines at once and twice
/// the angle of the wave generator. A drive of stiffness `k` that holds a load turns the error into
/// force: `F = (k/r) [e1 sin(n theta + phi1) + e2 sin(2 n theta + phi2)]`.
pub fn harmonic_drive(p: &Parameters, world: &World, tension: &mut [f64]) {
    let arc_minute = PI / 10_800.0;
    let per_error = p.get("k") / REEL_RADIUS_M * arc_minute;
    let (e1, e2, n) = (p.get("e1"), p.get("e2"), p.get("n"));
    let (phi1, phi2) = (p.get("phi1"), p.get("phi2"));
    for (t, angle) in tension.iter_mut().zip(&world.angle) {
        *t += per_error * (e1 * (n * angle + phi1).sin() + e2 * (2.0 * n * angle + phi2).sin());
    }
}

/// Draws [`harmonic_drive`]. Catalogues give ratios of 30 to 160, errors of 0.5 to 2 arc minutes
/// and stiffnesses of small sizes of some N·m/rad upwards.
pub fn draw_harmonic_drive(draw: &mut Draw, _: &Scene) {
    draw.choice("n", "-", &[30.0, 50.0, 80.0, 100.0]);
    draw.log("k", "N m/rad", 2.0, 40.0);
    let e1 = draw.scaled("e1", "arcmin", 0.1, 2.0);
    draw.scaled_ratio("e2", "arcmin", e1, [0.1, 2.0], [0.5, 2.0]);
    draw.phase("phi1");
    draw.phase("phi2");
}

/// Cogging of a motor with permanent magnets: Hanselman 2006, "Brushless Permanent Magnet Motor
/// Design"; Islam, Mir and Sebastian 2004. A torque without current whose order on the motor angle
/// is the least common multiple of slots and poles, `m`, with a second harmonic:
/// `F = a [sin(m g theta + phi1) + h2 sin(2 m g theta + phi2)]`, `g` the gear ratio.
pub fn cogging(p: &Parameters, world: &World, tension: &mut [f64]) {
    let order = p.get("m") * p.get("g");
    let (a, h2, phi1, phi2) = (p.get("a"), p.get("h2"), p.get("phi1"), p.get("phi2"));
    for (t, angle) in tension.iter_mut().zip(&world.angle) {
        *t += a * ((order * angle + phi1).sin() + h2 * (2.0 * order * angle + phi2).sin());
    }
}

/// Draws [`cogging`]. 12 slots with 4, 8, 10 or 14 poles have the orders 12, 24, 60 and 84.
pub fn draw_cogging(draw: &mut Draw, _: &Scene) {
    draw.choice("m", "-", &[6.0, 12.0, 24.0, 36.0, 60.0, 84.0]);
    draw.given("g", "-", GEAR_RATIO);
    draw.scaled("a", "N", 0.005, 0.2);
    draw.uniform("h2", "-", 0.0, 0.5);
    draw.phase("phi1");
    draw.phase("phi2");
}

/// Ripple of meshing teeth: transmission error at the tooth frequency and its second harmonic,
/// proportional to the load (Ozguven and Houser 1988; Smith 2003, "Gear Noise and Vibration"):
/// `T <- T (1 + eps [sin(z theta + phi1) + h2 sin(2 z theta + phi2)])`, `z` teeth on the reel's
/// gear.
pub fn gear_mesh(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (z, eps, h2) = (p.get("z"), p.get("eps"), p.get("h2"));
    let (phi1, phi2) = (p.get("phi1"), p.get("phi2"));
    for (t, angle) in tension.iter_mut().zip(&world.angle) {
        *t *= 1.0 + eps * ((z * angle + phi1).sin() + h2 * (2.0 * z * angle + phi2).sin());
    }
}

/// Draws [`gear_mesh`].
pub fn draw_gear_mesh(draw: &mut Draw, _: &Scene) {
    draw.choice("z", "-", &[20.0, 26.0, 32.0, 40.0, 52.0]);
    draw.scaled("eps", "-", 0.001, 0.02);
    draw.uniform("h2", "-", 0.0, 0.4);
    draw.phase("phi1");
    draw.phase("phi2");
}

/// A reel that runs out: its centre lies `e` from the axis, so the lever of the cable is
/// `r + e cos(theta - phi)` and a torque that is right for `r` gives
/// `T r / (r + e cos(theta - phi))` (geometry of an eccentric pulley, for example Shigley,
/// "Mechanical Engineering Design").
pub fn eccentricity(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (ratio, phi) = (p.get("e") * 1e-3 / REEL_RADIUS_M, p.get("phi"));
    for (t, angle) in tension.iter_mut().zip(&world.angle) {
        *t /= (1.0 + ratio * (angle - phi).cos()).max(0.1);
    }
}

/// Draws [`eccentricity`].
pub fn draw_eccentricity(draw: &mut Draw, _: &Scene) {
    draw.scaled("e", "mm", 0.005, 0.3);
    draw.phase("phi");
}

/// Play: the output follows the drive outside a dead zone of total width `w` and rests inside it,
/// without impact (Tao and Kokotovic 1996, "Adaptive Control of Systems with Actuator and Sensor
/// Nonlinearities"; Nordin and Gutman 2002). The angle of the log is that of the drive; a return
/// spring `k` acts on the output, so `T <- T + k play(theta, w)`. The declared model has the
/// spring, but on the angle of the drive.
pub fn backlash(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (k, half) = (p.get("k"), 0.5 * p.get("w"));
    let mut output = world.angle[0];
    for (t, angle) in tension.iter_mut().zip(&world.angle) {
        output = output.clamp(angle - half, angle + half);
        *t += k * output;
    }
}

/// Draws [`backlash`]. The width is 5 % to 40 % of the travel of the set.
pub fn draw_backlash(draw: &mut Draw, scene: &Scene) {
    draw.scaled("k", "N/rad", 0.02, 2.0);
    draw.log("w", "rad", 0.05 * scene.travel_rad, 0.4 * scene.travel_rad);
}

/// Elastic transmission: Spong 1987, "Modeling and control of elastic joint robots"; Readman 1994.
/// The rotor, of inertia `j` at the reel, drives the reel through a spring `k` and a damper; the
/// reel's angle is imposed and logged. With `q` the twist and `M = j/r`:
/// `M q'' + D q' + k q = u - M theta''`, `T = k q + D q'`, `D = 2 zeta sqrt(k M)`. The spring alone
/// would do nothing; the size is carried by the inertia behind it.
pub fn stretch(p: &Parameters, world: &World, tension: &mut [f64]) {
    let (k, zeta) = (p.get("k"), p.get("zeta"));
    let mass = p.get("j") * 1e-6 / REEL_RADIUS_M;
    if mass <= 0.0 {
        return;
    }
    let omega = (k / mass).sqrt();
    let damping = 2.0 * zeta * (k * mass).sqrt();
    let input = |i: usize| (world.command[i] - mass * world.acceleration(i)) / k;
    let mut twist = SecondOrder::at_rest(omega, zeta, input(0));
    let mut before = input(0);
    for (i, t) in tension.iter_mut().enumerate() {
        let now = input(i);
        if i > 0 {
            twist.step(before, now, world.dt);
        }
        before = now;
        *t += k * twist.value + damping * twist.slope - world.command[i];
    }
}

/// Draws [`stretch`]. 5 N/rad to 100 N/rad at the reel are 0.5 N/mm to 10 N/mm of cable.
pub fn draw_stretch(draw: &mut Draw, _: &Scene) {
    draw.scaled("j", "kg mm2", 1.0, 200.0);
    draw.log("k", "N/rad", 5.0, 100.0);
    draw.uniform("zeta", "-", 0.1, 0.6);
}

/// Inertia of the reel and of the rotor behind the gear, seen at the cable (any text on drives, for
/// example Craig 2005, "Introduction to Robotics"): `F = (j_reel + g^2 j_rotor) theta'' / r`.
pub fn inertia(p: &Parameters, world: &World, tension: &mut [f64]) {
    let g = p.get("g");
    let total = (p.get("j_reel") + g * g * p.get("j_rotor")) * 1e-6 / REEL_RADIUS_M;
    for (i, t) in tension.iter_mut().enumerate() {
        *t -= total * world.acceleration(i);
    }
}

/// Draws [`inertia`].
pub fn draw_inertia(draw: &mut Draw, _: &Scene) {
    let rotor = draw.scaled("j_rotor", "kg mm2", 0.3, 10.0);
    draw.scaled_ratio("j_reel", "kg mm2", rotor, [0.3, 10.0], [0.2, 2.0]);
    draw.given("g", "-", GEAR_RATIO);
}

/// Gravity of a payload on a lever that turns with the reel: `F = m g l sin(theta + phi) / r`
/// (Craig 2005).
pub fn gravity(p: &Parameters, world: &World, tension: &mut [f64]) {
    let amplitude = p.get("m") * 1e-3 * GRAVITY_M_S2 * p.get("l") * 1e-3 / REEL_RADIUS_M;
    let phi = p.get("phi");
    for (t, angle) in tension.iter_mut().zip(&world.angle) {
        *t += amplitude * (angle + phi).sin();
    }
}

/// Draws [`gravity`].
pub fn draw_gravity(draw: &mut Draw, _: &Scene) {
    draw.scaled("m", "g", 0.5, 50.0);
    draw.uniform("l", "mm", 5.0, 60.0);
    draw.phase("phi");
}
