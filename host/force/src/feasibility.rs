//! Whether the cables can hold zero force at the tip, and how large a force they can apply, over
//! the poses that a rig file allows.
//!
//! Every cable pulls at least `tension_min_n` while the rig is armed. Where no tensions within the
//! limits add up to zero force, an armed rig pulls the robot aside whatever is commanded, so
//! nothing may be armed there. The poses are those of the pose source: the clamped tip of
//! `source = "static"`, or a grid over the ball `[workspace]`.

use crate::allocation::{AllocationError, Allocator, Problem};
use crate::controller::{problem, Cables, ControlError};
use nalgebra::Vector3;
use rig::{PoseChoice, Rig};
use serde::Serialize;
use wire::UNITS;

/// Steps of the grid from the workspace's centre to its surface.
const GRID: i32 = 3;
/// Longer than any force that six cables of 60 N can apply, N.
const BEYOND_N: f64 = 1000.0;

/// What the cables can do over the poses of a rig file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Feasibility {
    /// Poses that were examined.
    pub poses: usize,
    /// Poses at which zero force is out of reach.
    pub out_of_reach: usize,
    /// The pose at which the nearest force is furthest from zero; `None` where zero is within reach
    /// everywhere.
    pub worst: Option<Residual>,
    /// Largest force along +x, -x, +y, -y, +z, -z that is within reach at every pose, N; 0 where
    /// zero is not.
    pub least_force_n: [f64; 6],
}

/// The force that is left at a pose where zero is commanded.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Residual {
    /// Tip, robot base frame, m.
    pub tip_m: Vector3<f64>,
    /// Length of the force that the cables apply at least, N.
    pub force_n: f64,
}

impl Feasibility {
    /// Why nothing may be armed; `None` where zero force is within reach everywhere.
    #[must_use]
    pub fn refusal(&self) -> Option<ZeroOutOfReach> {
        self.worst.map(|worst| ZeroOutOfReach {
            poses: self.poses,
            out_of_reach: self.out_of_reach,
            worst,
        })
    }
}

/// Zero force is out of reach at some poses of a rig file.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "zero force is out of reach at {out_of_reach} of {poses} poses: with every cable from `tension_min_n` to `tension_max_n` the tip is \
     pulled with at least {:.2} N at [{:.3}, {:.3}, {:.3}] m; check `exit_m` and `enabled` of the units (two units in one \
     place?), or give a larger `tension_max_n`, or a smaller `tension_min_n` or `radius_m`",
    worst.force_n, worst.tip_m.x, worst.tip_m.y, worst.tip_m.z
)]
pub struct ZeroOutOfReach {
    /// Poses that were examined.
    pub poses: usize,
    /// Those at which it is out of reach.
    pub out_of_reach: usize,
    /// The pose at which the nearest force is furthest from zero.
    pub worst: Residual,
}

/// Examines the poses of a rig file with the units that are available.
///
/// # Errors
/// A cable is too far off its load cell's axis at one of the poses, the clamped tip is outside the
/// workspace, or no unit is available.
pub fn examine(rig: &Rig, available: &[bool; UNITS]) -> Result<Feasibility, ControlError> {
    walk(rig, available, true)
}

/// As [`examine`] without the largest forces, which take most of its time: `least_force_n` is
/// infinite.
///
/// # Errors
/// As [`examine`].
pub fn examine_zero(rig: &Rig, available: &[bool; UNITS]) -> Result<Feasibility, ControlError> {
    walk(rig, available, false)
}

fn walk(rig: &Rig, available: &[bool; UNITS], forces: bool) -> Result<Feasibility, ControlError> {
    let mut allocator = Allocator::new()?;
    let mut found = Feasibility {
        poses: 0,
        out_of_reach: 0,
        worst: None,
        least_force_n: [f64::INFINITY; 6],
    };
    for tip_m in poses(rig) {
        let zero = problem(rig, &Cables::at(rig, tip_m, available)?, available);
        found.poses += 1;
        let allocation = allocator.solve(&zero)?;
        if allocation.feasible {
            let axes = if forces { 0..6 } else { 0..0 };
            for axis in axes {
                let largest_n = largest_n(&mut allocator, &zero, axis)?;
                found.least_force_n[axis] = found.least_force_n[axis].min(largest_n);
            }
            continue;
        }
        found.out_of_reach += 1;
        found.least_force_n = [0.0; 6];
        let force_n = allocation.residual_n;
        if found.worst.is_none_or(|worst| force_n > worst.force_n) {
            found.worst = Some(Residual { tip_m, force_n });
        }
    }
    Ok(found)
}

/// Force that the available cables apply at least at a tip where zero is commanded, N; `None` where
/// zero is within reach.
///
/// # Errors
/// As [`examine`], at this tip.
pub fn residual_at(
    rig: &Rig,
    tip_m: Vector3<f64>,
    available: &[bool; UNITS],
) -> Result<Option<f64>, ControlError> {
    let zero = problem(rig, &Cables::at(rig, tip_m, available)?, available);
    let allocation = Allocator::new()?.solve(&zero)?;
    Ok((!allocation.feasible).then_some(allocation.residual_n))
}

/// Largest force within reach along an axis (0 to 5: +x, -x, +y, -y, +z, -z), N; 0 where the solver
/// fails.
fn largest_n(
    allocator: &mut Allocator,
    zero: &Problem,
    axis: usize,
) -> Result<f64, AllocationError> {
    let mut force_n = Vector3::zeros();
    force_n[axis / 2] = if axis.is_multiple_of(2) {
        BEYOND_N
    } else {
        -BEYOND_N
    };
    let allocation = allocator.solve(&Problem { force_n, ..*zero })?;
    Ok(BEYOND_N * allocation.fraction.value().unwrap_or(0.0))
}

/// The poses that are examined, robot base frame, m.
fn poses(rig: &Rig) -> Vec<Vector3<f64>> {
    if let PoseChoice::Static { position_m } = rig.pose {
        return vec![position_m];
    }
    let workspace = rig.workspace;
    let step_m = workspace.radius_m / f64::from(GRID);
    let mut poses = Vec::new();
    let mut add = |offset: Vector3<f64>| {
        // A hair inside, so that rounding does not put the surface outside of the workspace.
        poses.push(workspace.center_m + offset * (1.0 - 1e-9));
    };
    for x in -GRID..=GRID {
        for y in -GRID..=GRID {
            for z in -GRID..=GRID {
                let offset = Vector3::new(x, y, z).map(f64::from);
                if offset.norm() < f64::from(GRID) {
                    add(offset * step_m);
                }
                // The grid's own surface, projected to the ball's.
                if offset.amax() == f64::from(GRID) {
                    add(offset.normalize() * workspace.radius_m);
                }
            }
        }
    }
    poses
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig::built_in().unwrap()
    }

    #[test]
    fn the_built_in_rig_can_hold_zero_everywhere() {
        let found = examine(&rig(), &[true; UNITS]).unwrap();
        assert!(found.poses > 200, "{found:?}");
        assert_eq!((found.out_of_reach, found.worst), (0, None));
        assert_eq!(found.refusal(), None);
        for force_n in found.least_force_n {
            assert!((4.0..12.0).contains(&force_n), "{found:?}");
        }
    }

    #[test]
    fn a_copied_unit_or_a_lost_one_leaves_a_force() {
        let mut copied = rig();
        copied.units[1].exit_m = copied.units[0].exit_m;
        copied.units[1].axis = copied.units[0].axis;
        let found = examine(&copied, &[true; UNITS]).unwrap();
        assert!(2 * found.out_of_reach > found.poses, "{found:?}");
        assert!(found.worst.unwrap().force_n > 3.0, "{found:?}");
        let zero = examine_zero(&copied, &[true; UNITS]).unwrap();
        assert_eq!(zero.worst, found.worst);
        let text = found.refusal().unwrap().to_string();
        assert!(text.contains("zero force is out of reach"), "{text}");
        for lost in 0..UNITS {
            let mut available = [true; UNITS];
            available[lost] = false;
            let rig = rig();
            assert!(examine(&rig, &available).unwrap().out_of_reach > 0);
            let left = residual_at(&rig, rig.workspace.center_m, &available).unwrap();
            assert!(left.is_some_and(|n| n > 1.0), "{left:?}");
        }
        let rig = rig();
        assert_eq!(
            residual_at(&rig, rig.workspace.center_m, &[true; UNITS]),
            Ok(None)
        );
    }

    #[test]
    fn a_clamped_tip_is_the_only_pose() {
        let mut rig = rig();
        rig.pose = PoseChoice::Static {
            position_m: rig.workspace.center_m,
        };
        assert_eq!(examine(&rig, &[true; UNITS]).unwrap().poses, 1);
        rig.pose = PoseChoice::Static {
            position_m: rig.workspace.center_m + Vector3::new(0.5, 0.0, 0.0),
        };
        let error = examine(&rig, &[true; UNITS]).unwrap_err();
        assert!(
            matches!(error, ControlError::OutsideWorkspace { .. }),
            "{error}"
        );
    }
}
