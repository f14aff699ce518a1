//! Friction as the force gauge sees it: band at rest, hysteresis when the cable moves, stiction.

mod common;
use common::{gauge, least_squares, volts_for_pull};
use plant::Plant;

/// Pulls a moving cable at constant commands and fits the law of the measured rig to what the gauge
/// shows.
#[test]
fn slow_sweep_reproduces_the_drawn_friction_law() {
    for seed in [1, 2, 3] {
        let mut rows = Vec::new();
        let mut forces = Vec::new();
        let mut parameters = None;
        for pull in [2.2, 3.0, 4.0, 5.0, 8.0, 12.0] {
            let config = gauge(0.010, 0.008);
            let volts = volts_for_pull(&config, pull);
            let mut plant = Plant::new(config, seed).unwrap();
            plant.set_amplifier_power(true);
            plant.set_amplifier_volts(0, volts).unwrap();
            plant.advance_to(500_000_000);
            plant.set_robot_moving(true);
            for ms in 500..12_000_u64 {
                plant.advance_to(ms * 1_000_000);
                let speed = plant.reel_rad_per_s(0) * plant.config().drive.reel_radius_m;
                // Steady sliding only: standstill and the ringing after each turn are other
                // regimes.
                if ms > 2_000 && (speed.abs() - 0.008).abs() < 0.0004 {
                    let sign = speed.signum();
                    rows.push([1.0, pull, sign, sign * pull]);
                    forces.push(plant.tension_n(0));
                }
            }
            parameters = Some(plant.parameters(0).clone());
        }
        let fit = least_squares(&rows, &forces);
        let p = parameters.unwrap();
        let expected = [p.offset_n, p.gain, -p.coulomb_n, -p.per_load];
        for (found, expected) in fit.iter().zip(expected) {
            assert!(
                (found - expected).abs() < 0.02 * expected.abs().max(0.3),
                "seed {seed}: fitted {fit:?}, drawn {expected:?}"
            );
        }
        let residual = common::rms(&rows, &forces, &fit);
        assert!(residual < 0.03, "seed {seed}: {residual} N");
    }
}

#[test]
fn the_rigs_mean_is_the_measured_law() {
    let count = 200;
    let mean = (0..count)
        .map(|seed| {
            let plant = Plant::new(gauge(0.01, 0.005), seed).unwrap();
            let p = plant.parameters(0).clone();
            [p.offset_n, p.gain, p.coulomb_n, p.per_load]
        })
        .fold([0.0; 4], |sum, p| {
            [0, 1, 2, 3].map(|k| sum[k] + p[k] / f64::from(count as u32))
        });
    for (found, measured) in mean.iter().zip([0.155, 1.018, 0.909, 0.154]) {
        assert!((found / measured - 1.0).abs() < 0.03, "{mean:?}");
    }
}

#[test]
fn a_command_on_a_standing_tip_ends_inside_the_band() {
    for pull in [1.5, 3.0, 6.0, 12.0] {
        for seed in 0..4 {
            let config = gauge(0.01, 0.005);
            let volts = volts_for_pull(&config, pull);
            let breakaway = config.friction.breakaway_ratio;
            let mut plant = Plant::new(config, seed).unwrap();
            plant.set_amplifier_power(true);
            plant.set_amplifier_volts(0, volts).unwrap();
            plant.advance_to(2_000_000_000);
            let p = plant.parameters(0).clone();
            let middle = p.offset_n + p.gain * pull;
            let half = breakaway * (p.coulomb_n + p.per_load * pull);
            let tension = plant.tension_n(0);
            assert!(
                (tension - middle).abs() <= half + 1e-3,
                "pull {pull}, seed {seed}: {tension} N, band {middle} +- {half} N"
            );
            assert!(tension > 0.2);
            assert!(plant.reel_rad_per_s(0).abs() < 1e-4);
        }
    }
}

#[test]
fn the_reel_holds_any_force_inside_the_band_without_creeping() {
    let config = gauge(0.01, 0.005);
    let mut plant = Plant::new(config.clone(), 7).unwrap();
    plant.set_amplifier_power(true);
    plant
        .set_amplifier_volts(0, volts_for_pull(&config, 6.0))
        .unwrap();
    plant.advance_to(1_000_000_000);
    // 0.5 N less pull stays inside the band of about +-1.8 N: presliding only.
    let before = plant.reel_rad(0);
    plant
        .set_amplifier_volts(0, volts_for_pull(&config, 5.5))
        .unwrap();
    plant.advance_to(2_000_000_000);
    let (held, tension) = (plant.reel_rad(0), plant.tension_n(0));
    assert!((held - before).abs() * 0.01 < config.friction.presliding_m);
    plant.advance_to(30_000_000_000);
    assert!((plant.reel_rad(0) - held).abs() < 1e-9);
    assert!((plant.tension_n(0) - tension).abs() < 1e-6);
    // Far outside, it lets go.
    plant
        .set_amplifier_volts(0, volts_for_pull(&config, 1.0))
        .unwrap();
    plant.advance_to(31_000_000_000);
    assert!((plant.reel_rad(0) - held).abs() * 0.01 > config.friction.presliding_m);
    assert!(plant.tension_n(0) < tension - 1.0);
}

/// Breakaway lies above kinetic friction: when the tip starts to pull out cable, tension overshoots
/// the sliding level.
#[test]
fn breakaway_exceeds_kinetic_friction() {
    let mut config = gauge(0.01, 0.0001);
    config.friction.breakaway_ratio = 1.3;
    let volts = volts_for_pull(&config, 4.0);
    let mut plant = Plant::new(config, 3).unwrap();
    plant.set_amplifier_power(true);
    plant.set_amplifier_volts(0, volts).unwrap();
    plant.advance_to(500_000_000);
    plant.set_robot_moving(true);
    let mut peak = 0.0_f64;
    for ms in 500..15_000_u64 {
        plant.advance_to(ms * 1_000_000);
        peak = peak.max(plant.tension_n(0));
    }
    let p = plant.parameters(0).clone();
    let kinetic = p.offset_n + p.gain * 4.0 + p.coulomb_n + p.per_load * 4.0;
    let breakaway = p.offset_n + p.gain * 4.0 + 1.3 * (p.coulomb_n + p.per_load * 4.0);
    assert!(
        peak > kinetic + 0.5 * (breakaway - kinetic),
        "{peak} {kinetic} {breakaway}"
    );
    assert!(peak < breakaway + 0.01, "{peak} {breakaway}");
}

#[test]
fn without_power_energy_only_falls_and_the_reel_comes_to_rest() {
    let mut config = gauge(0.01, 0.005);
    // The constant pull would work on the reel; without it nothing feeds the unit.
    config.friction.offset_n = 0.0;
    config.friction.offset_sd_n = 0.0;
    let volts = volts_for_pull(&config, 10.0);
    let mut plant = Plant::new(config, 5).unwrap();
    plant.set_amplifier_power(true);
    plant.set_amplifier_volts(0, volts).unwrap();
    plant.advance_to(1_000_000_000);
    assert!(plant.tension_n(0) > 7.0);
    plant.set_amplifier_power(false);
    // After 2 ms the current is zero.
    plant.advance_to(1_002_000_000);
    let mut energy = plant.stored_energy_j(0);
    let start = energy;
    for step in 0..40_000_u64 {
        plant.advance_to(1_002_000_000 + step * 50_000);
        let now = plant.stored_energy_j(0);
        // Semi-implicit Euler lets the energy ripple by a part of order omega h.
        assert!(
            now <= energy + 0.01 * start,
            "step {step}: {now} J after {energy} J"
        );
        energy = energy.min(now);
    }
    assert!(energy < 0.2 * start, "{energy} of {start} J");
    assert!(plant.reel_rad_per_s(0).abs() < 1e-4);
    let p = plant.parameters(0);
    assert!(
        plant.tension_n(0) <= 1.1 * p.coulomb_n,
        "{}",
        plant.tension_n(0)
    );
}
