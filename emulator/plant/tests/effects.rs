//! Each optional effect acts as documented: the same rig with and without it, side by side.

// An oracle of its own.
#![expect(clippy::disallowed_methods)]

mod common;
use common::{gauge, least_squares, volts_for_pull};
use plant::config::PathConfig;
use plant::{Effect, Plant, PlantConfig};

fn effect(toml: &str) -> Effect {
    toml::from_str(toml).unwrap()
}

/// The gauge experiment at `pull` without and with `effect`; rows of (time, plain, changed).
fn side_by_side(
    effect_toml: &str,
    pull: f64,
    speed_m_per_s: f64,
    seconds: u64,
    mut see: impl FnMut(f64, &Plant, &Plant),
) {
    let config = gauge(0.012, speed_m_per_s);
    let mut changed = config.clone();
    changed.effects.push(effect(effect_toml));
    let volts = volts_for_pull(&config, pull);
    let mut pair = [config, changed].map(|c| Plant::new(c, 5).unwrap());
    for plant in &mut pair {
        plant.set_amplifier_power(true);
        plant.set_amplifier_volts(0, volts).unwrap();
        plant.set_robot_moving(speed_m_per_s > 0.0);
    }
    for ms in 1..seconds * 1000 {
        for plant in &mut pair {
            plant.advance_to(ms * 1_000_000);
        }
        see(ms as f64 * 1e-3, &pair[0], &pair[1]);
    }
}

/// Mean change of tension while the reel pays out at the sweep's speed, N.
fn change_while_paying_out(effect_toml: &str, speed_m_per_s: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    // The first leg takes 12 mm over the speed; the end of it is steady.
    let leg = 0.012 / speed_m_per_s;
    side_by_side(
        effect_toml,
        5.0,
        speed_m_per_s,
        (leg + 1.0) as u64,
        |t, plain, changed| {
            if t > 0.6 * leg && t < 0.95 * leg {
                sum += changed.tension_n(0) - plain.tension_n(0);
                count += 1;
            }
        },
    );
    sum / f64::from(count)
}

#[test]
fn viscous_adds_speed_times_coefficient() {
    let change = change_while_paying_out("kind = \"viscous\"\ncoefficient_n_s_per_m = 40.0", 0.01);
    assert!((change - 0.4).abs() < 0.01, "{change}");
}

#[test]
fn stribeck_adds_at_low_speed_and_fades() {
    let toml = "kind = \"stribeck\"\nexcess_n = 0.3\nvelocity_m_per_s = 0.01";
    let slow = change_while_paying_out(toml, 0.003);
    let fast = change_while_paying_out(toml, 0.03);
    assert!((slow - 0.3 * (-0.09_f64).exp()).abs() < 0.02, "{slow}");
    assert!(fast.abs() < 0.01, "{fast}");
}

#[test]
fn coulomb_raises_the_level_by_constant_and_load() {
    let toml = "kind = \"coulomb\"\nconstant_n = 0.2\nper_load = 0.05";
    let change = change_while_paying_out(toml, 0.01);
    assert!((change - 0.45).abs() < 0.01, "{change}");
}

/// Its level is that of its time, also in a later run of the same rig.
#[test]
fn friction_that_changes_has_the_level_of_its_time() {
    let toml = "kind = \"changing_friction\"\nbegin_n = 0.8\nend_n = 0.2\ntime_constant_s = 1.5";
    let level = |age_s: f64| 0.2 + 0.6 * (-age_s / 1.5).exp();
    let mut seen = 0;
    // The first leg of the sweep ends after 4 s.
    side_by_side(toml, 5.0, 0.003, 4, |t, plain, changed| {
        if t > 1.0 && t < 3.8 {
            let more = changed.tension_n(0) - plain.tension_n(0);
            assert!((more - level(t)).abs() < 0.03, "{more} N at {t} s");
            seen += 1;
        }
    });
    assert!(seen > 2_700);
    let tension = |run_s: f64, run: u64| {
        let mut config = gauge(0.012, 0.003);
        let effect = effect(&format!("{toml}\nrun_s = {run_s:?}"));
        config.effects.push(effect);
        let volts = volts_for_pull(&config, 5.0);
        let mut plant = Plant::of_run(config, 5, run).unwrap();
        plant.set_amplifier_power(true);
        plant.set_amplifier_volts(0, volts).unwrap();
        plant.set_robot_moving(true);
        plant.advance_to(3_000_000_000);
        plant.tension_n(0)
    };
    assert_eq!(tension(0.0, 2), tension(0.0, 0));
    let less = tension(0.5, 0) - tension(0.5, 2);
    assert!((less - (level(3.0) - level(4.0))).abs() < 0.02, "{less}");
}

/// A cell that stands askew sees the share along its axis, also where the cable's direction
/// changes.
#[test]
fn a_tilted_cell_weighs_the_share_along_its_axis() {
    let at = |across_m: f64, toml: &str| {
        let mut config = gauge(0.012, 0.01);
        config.robot.path = PathConfig::Fixed(plant::config::FixedPath {
            offset_m: [0.0, 0.0, across_m],
        });
        config.survey.axis_sd_rad = 0.0;
        config.effects.push(effect(toml));
        let volts = volts_for_pull(&config, 5.0);
        let mut plant = Plant::new(config, 5).unwrap();
        plant.set_amplifier_power(true);
        plant.set_amplifier_volts(0, volts).unwrap();
        plant.advance_to(500_000_000);
        plant.cell_force_n(0) / plant.tension_n(0)
    };
    let (along, tilted) = ("first_rad = 0.0", "first_rad = 0.2");
    let share = |across_m: f64, tilt: &str| at(across_m, &format!("kind = \"cell_tilt\"\n{tilt}"));
    assert!((share(0.0, along) - 1.0).abs() < 1e-5);
    assert!((share(0.0, tilted) - 0.2_f64.cos()).abs() < 1e-3);
    // The unit is 0.4 m away.
    let turned = (0.05_f64 / 0.4).atan();
    let [up, down] = [0.05, -0.05].map(|across_m| share(across_m, tilted));
    let due = (0.2 - turned).cos() - (0.2 + turned).cos();
    assert!(((up - down).abs() - due).abs() < 2e-3, "{up} {down} {due}");
    let aside = share(0.05, "second_rad = 0.2");
    assert!(
        (aside - 0.2_f64.cos() * turned.cos()).abs() < 2e-3,
        "{aside}"
    );
}

#[test]
fn periodic_pull_follows_the_shaft() {
    for (shaft, order, ratio) in [("reel", 3.0, 1.0), ("motor", 2.0, 26.0 / 7.0)] {
        let toml = format!(
            "kind = \"periodic\"\nshaft = \"{shaft}\"\norder = {order:?}\namplitude_n = 0.25\nphase_rad = 0.7"
        );
        let (mut rows, mut values) = (Vec::new(), Vec::new());
        side_by_side(&toml, 5.0, 0.005, 12, |t, plain, changed| {
            if t > 3.5 && t < 8.0 {
                let angle = order * ratio * changed.reel_rad(0);
                rows.push([angle.sin(), angle.cos(), 1.0]);
                values.push(changed.tension_n(0) - plain.tension_n(0));
            }
        });
        let fit = least_squares(&rows, &values);
        let (amplitude, phase) = (fit[0].hypot(fit[1]), fit[1].atan2(fit[0]));
        assert!((amplitude - 0.25).abs() < 0.01, "{shaft}: {amplitude}");
        assert!((phase - 0.7).abs() < 0.05, "{shaft}: {phase}");
    }
}

#[test]
fn backlash_lets_the_motor_turn_through_the_gap() {
    let mut config = gauge(0.01, 0.005);
    config.cable.initial_slack_m = 0.05;
    config.effects.push(effect(
        "kind = \"backlash\"\ngap_m = 0.002\nreel_friction_n = 0.3",
    ));
    let mut plant = Plant::new(config, 1).unwrap();
    plant.set_amplifier_power(true);
    let mut span = (0.0_f64, 0.0_f64);
    for ms in 1..600_u64 {
        // Alternating: a pull of 2.5 N for 60 ms each way.
        let sign = if (ms / 60).is_multiple_of(2) {
            1.0
        } else {
            -1.0
        };
        let volts = sign * volts_for_pull(plant.config(), 2.5);
        plant.set_amplifier_volts(0, volts).unwrap();
        plant.advance_to(ms * 1_000_000);
        let motor_rad = -(plant.encoder_counts(0) as f64) / 4000.0 * std::f64::consts::TAU;
        let lead_m = (motor_rad * 7.0 / 26.0 - plant.reel_rad(0)) * 0.01;
        span = (span.0.min(lead_m), span.1.max(lead_m));
    }
    // The mesh gives another 0.05 mm or so on either side.
    assert!((span.1 - span.0 - 0.002).abs() < 0.0003, "{span:?}");
}

#[test]
fn inertia_slows_the_reel() {
    let speed_after = |mass: f64| {
        let mut config = gauge(0.01, 0.005);
        config.cable.initial_slack_m = 0.1;
        if mass > 0.0 {
            config
                .effects
                .push(effect(&format!("kind = \"inertia\"\nmass_kg = {mass:?}")));
        }
        let volts = volts_for_pull(&config, 10.0);
        let mut plant = Plant::new(config, 1).unwrap();
        plant.set_amplifier_power(true);
        plant.set_amplifier_volts(0, volts).unwrap();
        plant.advance_to(20_000_000);
        plant.reel_rad_per_s(0)
    };
    let own = PlantConfig::default().drive.reflected_mass_kg();
    let ratio = speed_after(0.0) / speed_after(own);
    assert!((ratio - 2.0).abs() < 0.05, "{ratio}");
}

#[test]
fn amplifier_gain_and_delay_act_on_the_current() {
    side_by_side(
        "kind = \"amplifier_gain\"\nrelative_error = 0.1",
        5.0,
        0.0,
        1,
        |t, plain, changed| {
            if t > 0.1 {
                assert!((changed.current_a(0) / plain.current_a(0) - 1.1).abs() < 1e-9);
            }
        },
    );
    let mut early = None;
    side_by_side(
        "kind = \"command_delay\"\ndelay_s = 0.02",
        5.0,
        0.0,
        1,
        |t, plain, changed| {
            assert_eq!(changed.current_a(0) > 0.0, t > 0.020, "{t}");
            if early.is_none() {
                early = Some(plain.current_a(0));
            }
            if (t - 0.021).abs() < 1e-9 {
                assert_eq!(Some(changed.current_a(0)), early);
            }
        },
    );
}

/// Change of the reading as force: bridge difference over the cell's own gain.
fn reading_change_n(plain: &Plant, changed: &Plant) -> f64 {
    (changed.bridge_v_per_v(0) - plain.bridge_v_per_v(0)) / plain.parameters(0).bridge_per_n
}

#[test]
fn effects_on_the_reading_leave_the_tension_alone() {
    type Expect = fn(f64, f64) -> f64;
    let cases: [(&str, Expect, f64); 5] = [
        ("kind = \"zero_drift\"\nrate_n_per_s = 0.01", |t, _| 0.01 * t, 1e-9),
        (
            "kind = \"temperature_drift\"\nrise_k = 10.0\ntime_constant_s = 4.0\nzero_n_per_k = 0.006\ngain_per_k = 1e-3",
            |t, f| 10.0 * (1.0 - (-t / 4.0).exp()) * (0.006 + 1e-3 * f),
            1e-9,
        ),
        ("kind = \"cell_quadratic\"\nper_n = 0.005", |_, f| 0.005 * f * f, 1e-9),
        (
            "kind = \"tone\"\nplace = \"bridge\"\nfrequency_hz = 50.0\namplitude_n = 0.1\nphase_rad = 0.5",
            |t, _| 0.1 * (std::f64::consts::TAU * 50.0 * t + 0.5).sin(),
            1e-9,
        ),
        // The force rises within 50 ms and then stands: a first-order answer to a step.
        (
            "kind = \"creep\"\nfraction = 0.02\ntime_constant_s = 2.0",
            |t, f| 0.02 * f * (1.0 - (-t / 2.0).exp()),
            0.003,
        ),
    ];
    for (toml, expect, tolerance) in cases {
        let mut seen = 0;
        side_by_side(toml, 5.0, 0.0, 8, |t, plain, changed| {
            assert_eq!(plain.tension_n(0), changed.tension_n(0));
            let load = plain.truth().units[0].cell_load_n;
            let (found, due) = (reading_change_n(plain, changed), expect(t, load));
            assert!(
                (found - due).abs() < tolerance,
                "{toml}\nat {t} s: {found} N, {due} N due"
            );
            seen += 1;
        });
        assert!(seen > 7_000);
    }
}

#[test]
fn drive_tone_shakes_the_tension() {
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    let toml = "kind = \"tone\"\nplace = \"drive\"\nfrequency_hz = 2.0\namplitude_n = 0.2";
    side_by_side(toml, 5.0, 0.002, 6, |t, plain, changed| {
        if t > 3.0 {
            let phase = std::f64::consts::TAU * 2.0 * t;
            rows.push([phase.sin(), phase.cos(), 1.0]);
            values.push(changed.tension_n(0) - plain.tension_n(0));
        }
    });
    let fit = least_squares(&rows, &values);
    assert!((fit[0].hypot(fit[1]) - 0.2).abs() < 0.03, "{fit:?}");
}

#[test]
fn crosstalk_brings_the_other_units_load_only() {
    let mut config = PlantConfig::default();
    config.robot.path = PathConfig::Fixed(Default::default());
    let plain_config = config.clone();
    config.effects.push(effect(
        "kind = \"crosstalk\"\nfrom_unit = 2\nfraction = 0.05",
    ));
    let mut pair = [plain_config, config].map(|c| Plant::new(c, 4).unwrap());
    for plant in &mut pair {
        plant.set_amplifier_power(true);
        plant.set_amplifier_volts(2, 0.6).unwrap();
        plant.advance_to(2_000_000_000);
    }
    let [plain, changed] = &pair;
    for unit in 0..6 {
        let difference = changed.bridge_v_per_v(unit) - plain.bridge_v_per_v(unit);
        let found = difference / plain.parameters(unit).bridge_per_n;
        let due = if unit == 2 {
            0.0
        } else {
            0.05 * plain.cell_force_n(2)
        };
        assert!((found - due).abs() < 1e-5, "unit {unit}: {found} {due}");
    }
    assert!(plain.cell_force_n(2) > 4.0);
}

#[test]
fn a_hardening_cable_stretches_by_its_law() {
    side_by_side(
        "kind = \"cable_hardening\"\nper_strain = 500.0",
        10.0,
        0.0,
        1,
        |t, plain, changed| {
            if t < 0.9 {
                return;
            }
            for (plant, k) in [(plain, 0.0), (changed, 500.0)] {
                let config = plant.config();
                let u = &plant.truth().units[0];
                let wound = u.reel_rad * config.drive.reel_radius_m;
                let weight = plant.parameters(0).assembly_weight_n;
                let sag = (u.cell_load_n - weight) / config.load_cell.stiffness_n_per_m;
                let cosine = u.cell_force_n / u.tension_n;
                let weight_sag = weight / config.load_cell.stiffness_n_per_m * cosine;
                let free = u.cable_length_m - weight_sag - wound;
                let strain = (wound - sag * cosine) / free;
                let due = config.cable.axial_stiffness_n * strain * (1.0 + k * strain);
                assert!(
                    (u.tension_n - due).abs() < 0.01,
                    "k {k}: {} N, {due} N due",
                    u.tension_n
                );
            }
            assert!(changed.reel_rad(0) < 0.85 * plain.reel_rad(0));
        },
    );
}

#[test]
fn payload_weighs_on_the_tip() {
    let mut config = PlantConfig::default();
    config
        .effects
        .push(effect("kind = \"payload\"\nmass_kg = 0.1"));
    let mut plant = Plant::new(config, 1).unwrap();
    plant.advance_to(1_000_000);
    let force = plant.tip_force_n();
    assert!((force[2] + 0.980665).abs() < 1e-9 && force[0].abs() < 1e-9);
}

#[test]
fn an_effect_reaches_only_the_units_it_lists() {
    let mut config = PlantConfig::default();
    config.robot.path = PathConfig::Fixed(Default::default());
    let plain_config = config.clone();
    config.effects.push(effect(
        "kind = \"amplifier_gain\"\nunits = [1, 4]\nrelative_error = 0.2",
    ));
    let mut pair = [plain_config, config].map(|c| Plant::new(c, 4).unwrap());
    for plant in &mut pair {
        plant.set_amplifier_power(true);
        for unit in 0..6 {
            plant.set_amplifier_volts(unit, 0.4).unwrap();
        }
        plant.advance_to(500_000_000);
    }
    for unit in 0..6 {
        let same = pair[0].tension_n(unit) == pair[1].tension_n(unit);
        assert_eq!(same, unit != 1 && unit != 4, "unit {unit}");
    }
}

/// A calibration weight goes through the cell: its curve and its creep are in the reading.
#[test]
fn a_weight_on_the_cell_is_read_with_curve_and_creep() {
    let mut config = gauge(1e-5, 1e-5);
    config
        .effects
        .push(effect("kind = \"cell_quadratic\"\nper_n = 0.01"));
    config.effects.push(effect(
        "kind = \"creep\"\nfraction = 0.1\ntime_constant_s = 0.5",
    ));
    let mut plant = Plant::new(config, 3).unwrap();
    plant.advance_to(1_000_000_000);
    let per_n = plant.parameters(0).bridge_per_n;
    let empty = plant.bridge_v_per_v(0);
    // Motor and rack hang there already.
    let weight = plant.parameters(0).assembly_weight_n * 1.1;
    plant.hang_on_cell(0, 5.0);
    let at = |load: f64| load + 0.01 * load * load;
    let read = |plant: &Plant| (plant.bridge_v_per_v(0) - empty) / per_n;
    assert!((read(&plant) - (at(weight + 5.0) - at(weight))).abs() < 0.02);
    plant.advance_to(6_000_000_000);
    assert!((read(&plant) - (at(weight + 5.5) - at(weight))).abs() < 0.02);
    plant.hang_on_cell(0, 0.0);
    plant.advance_to(12_000_000_000);
    assert!(read(&plant).abs() < 0.01);
}
