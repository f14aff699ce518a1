//! Feasible forces of a rig over its workspace, and where its units should stand.

use super::picture::Map;
use super::{CalibrateError, Result};
use calibration::workspace::{map, place, Mount, Objective, Placement, PoseReport, WorkspaceError};
use nalgebra::Vector3;
use rig::Rig;

/// What to look at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Poses within this distance of the workspace's centre, m.
    pub radius_m: f64,
    /// Poses along a diameter.
    pub across: usize,
}

/// Squares of a map along a side, at least.
const FINEST: usize = 25;

/// Exit points and tension ranges of the units that take part.
fn cables(rig: &Rig) -> (Vec<Vector3<f64>>, Vec<(f64, f64)>) {
    rig.units
        .iter()
        .filter(|unit| unit.enabled)
        .map(|unit| (unit.exit_m, (unit.tension_min_n, unit.tension_max_n)))
        .unzip()
}

/// Feasible forces over the workspace, N.
#[derive(Debug, Clone, PartialEq)]
pub struct Feasible {
    /// Poses that were looked at.
    pub poses: usize,
    /// Force that is feasible in every direction, at the worst pose.
    pub least_n: f64,
    /// The same on average.
    pub mean_n: f64,
    /// Poses at which not even zero force is feasible: the cables can't be tensioned there.
    pub infeasible: usize,
    /// Force that is feasible along +x, -x, +y, -y, +z and -z, at the worst pose; `None` where it
    /// is not feasible in that direction at some pose, not even zero.
    pub along_n: [Option<f64>; 6],
}

/// Feasible forces at the poses of a ball about the workspace's centre.
///
/// # Errors
/// The cables can't be: in a plane, a tip in an exit point.
pub fn report(rig: &Rig, options: &Options) -> Result<Feasible> {
    let found = at(rig, &poses(rig, options)).map_err(CalibrateError::refused)?;
    Ok(Feasible::of(&found))
}

/// Poses of a ball about the workspace's centre, m, robot base frame.
#[must_use]
pub fn poses(rig: &Rig, options: &Options) -> Vec<Vector3<f64>> {
    map::ball_grid(&rig.workspace.center_m, options.radius_m, options.across)
}

impl Feasible {
    /// Of what was found at each pose.
    #[must_use]
    pub fn of(found: &[PoseReport]) -> Self {
        let least =
            |of: &dyn Fn(&PoseReport) -> f64| found.iter().map(of).fold(f64::INFINITY, f64::min);
        Self {
            poses: found.len(),
            least_n: least(&|r| r.radius_n),
            mean_n: found.iter().map(|r| r.radius_n).sum::<f64>() / found.len() as f64,
            infeasible: found.iter().filter(|r| r.radius_n < 0.0).count(),
            along_n: std::array::from_fn(|k| {
                let all = found.iter().map(|r| r.along_n[k]);
                all.reduce(|one, other| Some(one?.min(other?))).flatten()
            }),
        }
    }
}

/// Feasible forces at these tips, m, robot base frame.
///
/// # Errors
/// The cables can't be: in a plane, a tip in an exit point. Or there is no tip.
pub fn at(
    rig: &Rig,
    tips: &[Vector3<f64>],
) -> std::result::Result<Vec<PoseReport>, WorkspaceError> {
    let (exits, bounds) = cables(rig);
    map::map(&exits, &bounds, tips)
}

/// Maps of the force that is feasible in every direction, over the three planes through the centre.
#[must_use]
pub fn planes(rig: &Rig, options: &Options) -> Vec<Map> {
    let (exits, bounds) = cables(rig);
    let center = rig.workspace.center_m;
    let count = options.across.max(FINEST);
    let offset = |i: usize| options.radius_m * (2.0 * i as f64 / (count - 1) as f64 - 1.0);
    [(0, 1, 2), (0, 2, 1), (1, 2, 0)]
        .into_iter()
        .map(|(a, b, fixed)| {
            let names = ["x", "y", "z"];
            let value = |r: usize, c: usize| {
                let mut tip = center;
                tip[a] += offset(c);
                tip[b] += offset(r);
                if (tip - center).norm() > options.radius_m * (1.0 + 1e-9) {
                    return f64::NAN;
                }
                map::map(&exits, &bounds, &[tip]).map_or(f64::NAN, |found| found[0].radius_n)
            };
            let span = |axis: usize| {
                let middle = center[axis];
                (
                    1e3 * (middle - options.radius_m),
                    1e3 * (middle + options.radius_m),
                )
            };
            Map {
                title: format!("{} = {:.0} mm", names[fixed], 1e3 * center[fixed]),
                axes: (names[a], names[b]),
                span_mm: [span(a), span(b)],
                values: (0..count)
                    .map(|r| (0..count).map(|c| value(r, c)).collect())
                    .collect(),
            }
        })
        .collect()
}

/// Exit points within `within_m` of the present ones along each axis, for the largest least force
/// that is feasible in every direction over the ball. Units in `fixed` stay.
///
/// # Errors
/// No such placement can be looked for.
pub fn placed(
    rig: &Rig,
    options: &Options,
    within_m: f64,
    fixed: &[u8],
    clearance_m: f64,
) -> Result<Placement> {
    let (start_m, bounds_n) = cables(rig);
    let mounts = rig
        .units
        .iter()
        .filter(|unit| unit.enabled)
        .map(|unit| {
            if fixed.contains(&unit.number) {
                return Mount::Fixed;
            }
            let side = Vector3::repeat(within_m);
            Mount::Box {
                least_m: unit.exit_m - side,
                largest_m: unit.exit_m + side,
            }
        })
        .collect();
    place::place(&place::Task {
        start_m,
        mounts,
        bounds_n,
        poses: map::ball_grid(&rig.workspace.center_m, options.radius_m, options.across),
        objective: Objective::LeastRadius,
        clearance_m,
        random_starts: 4,
    })
    .map_err(CalibrateError::refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_rig_pulls_everywhere_and_better_when_placed_anew() {
        let rig = Rig::built_in().unwrap();
        let options = Options {
            radius_m: 0.05,
            across: 3,
        };
        let found = report(&rig, &options).unwrap();
        assert!((7.0..10.0).contains(&found.least_n), "{found:?}");
        let maps = planes(&rig, &options);
        assert_eq!(maps.len(), 3);
        // The corners of the square are outside of the ball.
        assert!(maps[0].values[0][0].is_nan() && maps[0].values[12][12] > 7.0);
        let better = placed(&rig, &options, 0.1, &[3, 4, 5, 6], 0.15).unwrap();
        assert!(better.value >= better.start_value, "{better:?}");
        assert_eq!(better.exits_m[5], rig.units[5].exit_m);
    }
}
