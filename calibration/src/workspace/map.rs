//! Feasible forces over a set of poses.

use super::{WorkspaceError, Zonotope};
use nalgebra::Vector3;

/// A tip position, base frame, m.
pub type Pose = Vector3<f64>;

/// What is feasible at a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseReport {
    /// Tip, base frame, m.
    pub tip_m: Pose,
    /// Every force up to this size is feasible, N; negative where not even no force is.
    pub radius_n: f64,
    /// Largest force along +x, -x, +y, -y, +z, -z, N; `None` where none is feasible.
    pub along_n: [Option<f64>; 6],
    /// Volume of the set, N^3.
    pub volume_n3: f64,
}

/// Directions of the cables at a tip: unit vectors from the tip to the exit points (all m).
///
/// # Errors
/// [`WorkspaceError::AtExit`] for a tip closer than 1 mm to an exit point.
pub fn cable_directions(
    exits_m: &[Vector3<f64>],
    tip_m: &Pose,
) -> Result<Vec<Vector3<f64>>, WorkspaceError> {
    exits_m
        .iter()
        .enumerate()
        .map(|(i, exit)| {
            (exit - tip_m)
                .try_normalize(1e-3)
                .ok_or(WorkspaceError::AtExit {
                    cable: i + 1,
                    tip_m: (*tip_m).into(),
                })
        })
        .collect()
}

/// The feasible forces at each pose.
///
/// # Errors
/// [`WorkspaceError`].
pub fn map(
    exits_m: &[Vector3<f64>],
    bounds_n: &[(f64, f64)],
    poses: &[Pose],
) -> Result<Vec<PoseReport>, WorkspaceError> {
    if poses.is_empty() {
        return Err(WorkspaceError::NoPose);
    }
    poses
        .iter()
        .map(|tip| {
            let set = Zonotope::new(&cable_directions(exits_m, tip)?, bounds_n)?;
            let mut along_n = [None; 6];
            for (k, slot) in along_n.iter_mut().enumerate() {
                let mut u = Vector3::zeros();
                u[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
                *slot = set.largest_n(&u);
            }
            Ok(PoseReport {
                tip_m: *tip,
                radius_n: set.radius_n(),
                along_n,
                volume_n3: set.volume_n3(),
            })
        })
        .collect()
}

/// Poses on a cubic grid within a ball: about `across` points along a diameter, the centre one of
/// them. Centre and radius in m.
#[must_use]
pub fn ball_grid(center_m: &Vector3<f64>, radius_m: f64, across: usize) -> Vec<Pose> {
    let half = (across.max(1) as i64 - 1) / 2;
    let step = if half > 0 {
        radius_m / half as f64
    } else {
        0.0
    };
    let mut out = Vec::new();
    for i in -half..=half {
        for j in -half..=half {
            for k in -half..=half {
                let offset = Vector3::new(i as f64, j as f64, k as f64) * step;
                if offset.norm() <= radius_m * (1.0 + 1e-9) {
                    out.push(center_m + offset);
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing::{CENTER_M, UNITS};

    #[test]
    fn the_example_rig_pulls_everywhere_in_its_workspace() {
        let exits: Vec<Vector3<f64>> = UNITS.iter().map(|u| Vector3::from(u.0)).collect();
        let poses = ball_grid(&Vector3::from(CENTER_M), 0.05, 5);
        assert_eq!(poses.len(), 33);
        let reports = map(&exits, &[(2.0, 12.0); 6], &poses).unwrap();
        for r in &reports {
            assert!(r.radius_n > 4.0 && r.radius_n < 12.0, "{r:?}");
            let least = r
                .along_n
                .iter()
                .map(|a| a.unwrap())
                .fold(f64::INFINITY, f64::min);
            assert!(r.radius_n <= least + 1e-9);
        }
    }

    #[test]
    fn bad_poses_are_refused() {
        let exits: Vec<Vector3<f64>> = UNITS.iter().map(|u| Vector3::from(u.0)).collect();
        let bounds = [(2.0, 12.0); 6];
        assert_eq!(map(&exits, &bounds, &[]), Err(WorkspaceError::NoPose));
        assert!(matches!(
            map(&exits, &bounds, &[exits[3]]),
            Err(WorkspaceError::AtExit { cable: 4, .. })
        ));
        assert!(map(&exits, &bounds, &[Vector3::repeat(f64::NAN)]).is_err());
        assert_eq!(ball_grid(&Vector3::zeros(), 0.1, 0).len(), 1);
    }
}
