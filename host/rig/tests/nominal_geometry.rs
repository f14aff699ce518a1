//! The example rig file and the plant agree on where the units stand, so that the embedded rig is
//! the rig that the file describes.

use plant::{nominal_geometry, PlantConfig};
use rig::Rig;

#[test]
fn the_example_rig_file_holds_the_plants_surveyed_geometry() {
    let rig = Rig::built_in().expect("the example is right");
    let plant = PlantConfig::default();
    let units = nominal_geometry(&plant);
    assert_eq!(units.len(), rig.units.len());
    for (file, plant) in rig.units.iter().zip(&units) {
        for axis in 0..3 {
            assert!(
                (file.exit_m[axis] - plant.position_m[axis]).abs() < 1e-9,
                "unit {}",
                file.number
            );
            assert!(
                (file.axis[axis] - plant.axis[axis]).abs() < 2e-6,
                "unit {}",
                file.number
            );
        }
    }
    assert_eq!(
        <[f64; 3]>::from(rig.workspace.center_m),
        plant.robot.workspace_center_m
    );
    // The random path never leaves the box, and the box is inside the sphere that the host allows.
    if let plant::config::PathConfig::Random(path) = &plant.robot.path {
        let corner = path.half_extent_m.iter().map(|h| h * h).sum::<f64>().sqrt();
        assert!(corner < rig.workspace.radius_m);
    }
}

#[test]
fn the_example_rig_file_holds_the_plants_drive() {
    let rig = Rig::built_in().expect("the example is right");
    let plant = PlantConfig::default();
    let drive = &plant.drive;
    let turn_m = std::f64::consts::TAU * drive.reel_radius_m;
    let counts = f64::from(drive.encoder_counts_per_turn) * drive.gear_ratio;
    let sign = if drive.encoder_inverted { -1.0 } else { 1.0 };
    let per_volt = plant.amplifier.gain_a_per_v * drive.tension_per_current_n_per_a();
    let codes_per_n = 65_536.0 / 20.0 / per_volt;
    for unit in &rig.units {
        assert!((unit.travel_m_per_count / (sign * turn_m / counts) - 1.0).abs() < 1e-3);
        assert!((unit.dac_codes_per_n / codes_per_n - 1.0).abs() < 1e-3);
        assert_eq!(unit.coulomb_n, plant.friction.coulomb_n);
        assert_eq!(unit.coulomb_per_n, plant.friction.per_load);
        assert_eq!(unit.friction_gain, plant.friction.gain);
        assert_eq!(unit.friction_offset_n, plant.friction.offset_n);
    }
}
