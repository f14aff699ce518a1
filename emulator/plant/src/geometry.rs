//! Where the six units stand, in the robot frame.

use crate::config::PlantConfig;
use crate::vector::{sub, tilted, unit, Vec3};
use serde::Serialize;

/// One unit as the survey of the thesis (section 3.5.2) reports it: what a rig file would hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NominalUnit {
    /// Where the cable leaves the reel, robot frame, m.
    pub position_m: Vec3,
    /// Measuring axis of the load cell, unit vector, robot frame, pointing *toward* the workspace
    /// centre. A cable along it reads its whole tension: with `d` the direction from the tip to
    /// [`Self::position_m`], the cell senses `T cos(theta)`, `cos(theta) = -axis . d`.
    pub axis: Vec3,
}

/// The surveyed geometry of all units. The plant's own differs from it by the survey's errors
/// ([`crate::config::SurveyConfig`]), drawn from the seed.
pub fn nominal_geometry(config: &PlantConfig) -> Vec<NominalUnit> {
    config
        .units
        .iter()
        .map(|u| {
            let toward = unit(sub(config.robot.workspace_center_m, u.position_m));
            NominalUnit {
                position_m: u.position_m,
                axis: tilted(toward, u.axis_tilt_rad),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{dot, norm};

    #[test]
    fn default_rig_has_three_roughly_orthogonal_antiparallel_pairs() {
        let config = PlantConfig::default();
        let center = config.robot.workspace_center_m;
        let from: Vec<Vec3> = nominal_geometry(&config)
            .iter()
            .map(|u| sub(u.position_m, center))
            .collect();
        assert_eq!(from.len(), 6);
        for f in &from {
            assert!((0.35..=0.50).contains(&norm(*f)), "{}", norm(*f));
        }
        for pair in 0..3 {
            let cosine = dot(unit(from[2 * pair]), unit(from[2 * pair + 1]));
            assert!((-0.9999..-0.97).contains(&cosine), "pair {pair}: {cosine}");
            for other in 0..6 {
                if other / 2 != pair {
                    let cosine = dot(unit(from[2 * pair]), unit(from[other]));
                    assert!(cosine.abs() < 0.25, "{pair} {other}: {cosine}");
                }
            }
        }
    }

    #[test]
    fn tilt_has_the_given_angle() {
        let axis = unit([0.3, -0.2, 0.9]);
        let angle = libm::acos(dot(axis, tilted(axis, [0.02, 0.0])));
        assert!((angle - 0.02).abs() < 1e-9);
        assert!((norm(tilted(axis, [0.1, -0.2])) - 1.0).abs() < 1e-12);
    }
}
