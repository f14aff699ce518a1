//! Configuration files: defaults, round trip, and errors that name the key.

use force_plant::{Plant, PlantConfig};

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
