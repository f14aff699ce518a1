//! Plants that differ from the declared one, one property at a time.
#![allow(dead_code)] // each user takes a part

use plant::config::{PathConfig, SweepPath};
use plant::PlantConfig;

fn changed(change: impl FnOnce(&mut PlantConfig)) -> PlantConfig {
    let mut plant = PlantConfig::default();
    change(&mut plant);
    plant
}

pub fn scale_friction(plant: &mut PlantConfig, factor: f64) {
    plant.friction.coulomb_n *= factor;
    plant.friction.per_load *= factor;
}

/// Friction and cables that differ, each changed both ways.
pub fn other() -> Vec<(&'static str, PlantConfig)> {
    vec![
        ("as declared", PlantConfig::default()),
        (
            "half the presliding distance",
            changed(|p| p.friction.presliding_m *= 0.5),
        ),
        (
            "twice the presliding distance",
            changed(|p| p.friction.presliding_m *= 2.0),
        ),
        (
            "no breakaway",
            changed(|p| p.friction.breakaway_ratio = 1.0),
        ),
        (
            "twice the breakaway",
            changed(|p| p.friction.breakaway_ratio += p.friction.breakaway_ratio - 1.0),
        ),
        (
            "half the cable's stiffness",
            changed(|p| p.cable.axial_stiffness_n *= 0.5),
        ),
        (
            "twice the cable's stiffness",
            changed(|p| p.cable.axial_stiffness_n *= 2.0),
        ),
    ]
}

/// These, another level of friction, and other motions of the robot.
pub fn all() -> Vec<(&'static str, PlantConfig)> {
    let mut plants = other();
    plants.extend([
        ("a fifth less friction", changed(|p| scale_friction(p, 0.8))),
        ("a fifth more friction", changed(|p| scale_friction(p, 1.2))),
        (
            "a robot that gives 0.5 mm/N",
            changed(|p| p.robot.tip_compliance_m_per_n = 0.5e-3),
        ),
        (
            "a robot that gives 1 mm/N",
            changed(|p| p.robot.tip_compliance_m_per_n = 1e-3),
        ),
        (
            "a robot two and a half times as fast",
            changed(|p| {
                if let PathConfig::Random(path) = &mut p.robot.path {
                    path.rms_speed_m_per_s = 0.03;
                }
            }),
        ),
        (
            "a robot that turns back at once, at 5 mm/s",
            changed(|p| p.robot.path = PathConfig::Sweep(SweepPath::default())),
        ),
    ]);
    plants
}
