//! Configuration files: defaults, round trip, and errors that name the key.

use plant::{Plant, PlantConfig};
use random::SplitMix64;

fn refused(change: impl FnOnce(&mut PlantConfig)) -> String {
    let mut config = PlantConfig::default();
    change(&mut config);
    Plant::new(config, 1)
        .expect_err("must be refused")
        .to_string()
}

#[test]
fn default_is_valid_and_survives_toml() {
    let config = PlantConfig::default();
    config.validate().unwrap();
    let text = toml::to_string(&config).unwrap();
    assert_eq!(toml::from_str::<PlantConfig>(&text).unwrap(), config);
    assert_eq!(toml::from_str::<PlantConfig>("").unwrap(), config);
    assert!((config.drive.tension_per_current_n_per_a() - 19.35).abs() < 0.01);
}

#[test]
fn a_file_may_hold_a_part_only() {
    let config: PlantConfig = toml::from_str(
        r#"
        [cable]
        initial_slack_m = 0.01
        [robot.path]
        kind = "sweep"
        speed_m_per_s = 0.02
        [[effects]]
        kind = "tone"
        place = "bridge"
        units = [3]
        frequency_hz = 50.0
        amplitude_n = 0.05
        "#,
    )
    .unwrap();
    config.validate().unwrap();
    assert_eq!(config.cable.initial_slack_m, 0.01);
    assert_eq!(config.units.len(), 6);
    assert_eq!(config.effects.len(), 1);
}

#[test]
fn unknown_keys_are_refused_by_name() {
    for text in [
        "step_us = 50",
        "[cable]\nstifness_n = 1.0",
        "[robot.path]\nkind = \"random\"\nbox_m = 1.0",
        "[[units]]\nposition_m = [1.0, 0.0, 0.0]\nangle = 3.0",
        "[[effects]]\nkind = \"viscous\"\ncoefficient_n_s_per_m = 1.0\nextra = 2.0",
    ] {
        let error = toml::from_str::<PlantConfig>(text).unwrap_err().to_string();
        let key = ["step_us", "stifness_n", "box_m", "angle", "extra"]
            .into_iter()
            .find(|k| text.contains(k))
            .unwrap();
        assert!(error.contains(key), "{error}");
    }
    let error = toml::from_str::<PlantConfig>("[[effects]]\nkind = \"magic\"").unwrap_err();
    assert!(error.to_string().contains("magic"));
}

#[test]
fn values_out_of_range_are_refused_by_name() {
    let cases: Vec<(String, &str)> = vec![
        (refused(|c| c.step_ns = 0), "step_ns"),
        (
            refused(|c| c.amplifier.bandwidth_hz = f64::NAN),
            "amplifier.bandwidth_hz",
        ),
        (
            refused(|c| c.drive.reel_radius_m = 0.0),
            "drive.reel_radius_m",
        ),
        (
            refused(|c| c.drive.encoder_counts_per_turn = 0),
            "drive.encoder_counts_per_turn",
        ),
        (
            refused(|c| c.friction.breakaway_ratio = 0.9),
            "friction.breakaway_ratio",
        ),
        (
            refused(|c| c.cable.initial_slack_m = -0.1),
            "cable.initial_slack_m",
        ),
        (
            refused(|c| c.load_cell.gravity_m_per_s2[1] = f64::INFINITY),
            "load_cell.gravity_m_per_s2",
        ),
        (refused(|c| c.units.clear()), "units"),
        (
            refused(|c| c.units[3].position_m = c.robot.workspace_center_m),
            "units[3].position_m",
        ),
        (
            refused(|c| (c.friction.presliding_m, c.friction.coulomb_n) = (1e-6, 10.0)),
            "friction.presliding_m",
        ),
        (
            refused(|c| {
                *c = toml::from_str(
                    "[[effects]]\nkind = \"crosstalk\"\nfrom_unit = 6\nfraction = 0.1",
                )
                .unwrap();
            }),
            "effects[0].from_unit",
        ),
        (
            refused(|c| {
                *c = toml::from_str(
                    "[[effects]]\nkind = \"creep\"\nfraction = 0.1\ntime_constant_s = 0.0",
                )
                .unwrap();
            }),
            "effects[0].time_constant_s",
        ),
    ];
    for (message, key) in cases {
        if !key.is_empty() {
            assert!(message.contains(&format!("`{key}")), "{key}: {message}");
        }
        assert!(
            message.contains("expected") || message.contains("too fast"),
            "{message}"
        );
    }
}

/// Whatever passes the check must be integrable: corners of the allowed ranges, drawn at random.
#[test]
fn every_accepted_configuration_stays_finite() {
    let (mut accepted, mut refused) = (0, 0);
    for case in 0..200 {
        let mut rng = SplitMix64::stream(77, "corner", case);
        let mut corner = |low: f64, high: f64| match rng.bits() % 3 {
            0 => low,
            1 => high,
            _ => (low * high).sqrt(),
        };
        let mut config = PlantConfig {
            step_ns: corner(1e4, 1e5) as u64,
            ..PlantConfig::default()
        };
        config.amplifier.gain_a_per_v = corner(0.1, 10.0);
        config.amplifier.bandwidth_hz = corner(10.0, 1e5);
        config.drive.rotor_inertia_kg_m2 = corner(1e-7, 1e-4);
        config.friction.coulomb_n = corner(0.01, 20.0);
        config.friction.per_load = corner(0.01, 0.9);
        config.friction.breakaway_ratio = corner(1.0, 3.0);
        config.friction.presliding_m = corner(1e-6, 1e-3);
        config.friction.presliding_damping_ratio = corner(0.01, 1.0);
        config.friction.viscous_n_s_per_m = corner(1e-3, 1e3);
        config.cable.axial_stiffness_n = corner(100.0, 2e5);
        config.cable.damping_s = corner(1e-5, 5e-3);
        config.load_cell.stiffness_n_per_m = corner(1e3, 1e6);
        config.load_cell.assembly_mass_kg = corner(0.05, 5.0);
        config.robot.tip_compliance_m_per_n = corner(1e-6, 1e-2);
        config.robot.tip_relaxation_s = corner(1e-3, 10.0);
        let backlash = "kind = \"backlash\"\ngap_m = 0.001\nreel_friction_n = 0.3";
        if case % 4 == 0 {
            config.effects.push(toml::from_str(backlash).unwrap());
        }
        let Ok(mut plant) = Plant::new(config.clone(), case as u64) else {
            refused += 1;
            continue;
        };
        accepted += 1;
        plant.set_amplifier_power(true);
        plant.set_robot_moving(true);
        let mut largest = 0.0_f64;
        for unit in 0..6 {
            let volts = 5.0 / 19.35 / config.amplifier.gain_a_per_v;
            plant.set_amplifier_volts(unit, volts).unwrap();
        }
        for ms in 1..600_u64 {
            plant.advance_to(ms * 1_000_000);
            for unit in 0..6 {
                assert!(plant.tension_n(unit).is_finite(), "case {case}: {config:?}");
                if ms > 300 {
                    largest = largest.max(plant.tension_n(unit));
                }
            }
        }
        // 5 N of pull and at most 25 N of breakaway at three times: nothing may feed itself.
        assert!(largest < 200.0, "case {case}: {largest} N\n{config:?}");
    }
    assert!(accepted > 40 && refused > 10, "{accepted} {refused}");
}
