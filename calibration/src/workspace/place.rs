//! Where the units should stand: exit points moved within their mounting limits so that more force
//! is feasible over a set of poses (thesis 5.2).
//!
//! The objective is not smooth (the least over faces and poses), and a unit has at most three
//! numbers, so the search is by pattern (Hooke and Jeeves, *J. ACM* 8 (1961) 212): each number is
//! tried by a step to either side, steps that help are kept and repeated, and the step is halved
//! when none helps. It is started from the present rig and from random points within the limits (a
//! fixed seed: the same input gives the same answer); for the least radius, the mean is climbed
//! first. The result is a local optimum, the best of the starts.

use super::{cable_directions, Pose, WorkspaceError, Zonotope};
use nalgebra::Vector3;
use random::SplitMix64;

/// Where the exit point of a unit may be.
#[derive(Debug, Clone, PartialEq)]
pub enum Mount {
    /// It stays.
    Fixed,
    /// Anywhere in a box along the axes of the base frame, m.
    Box {
        /// Least x, y, z.
        least_m: Vector3<f64>,
        /// Largest x, y, z.
        largest_m: Vector3<f64>,
    },
    /// Anywhere on a plate: `corner + a side_1 + b side_2` with a and b in 0 to 1, m.
    Plate {
        /// A corner.
        corner_m: Vector3<f64>,
        /// The side from there.
        side_1_m: Vector3<f64>,
        /// The other side from there.
        side_2_m: Vector3<f64>,
    },
}

impl Mount {
    fn freedoms(&self) -> usize {
        match self {
            Self::Fixed => 0,
            Self::Box { .. } => 3,
            Self::Plate { .. } => 2,
        }
    }

    /// The point for numbers in 0 to 1.
    fn point(&self, numbers: &[f64], start_m: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Fixed => *start_m,
            Self::Box { least_m, largest_m } => {
                Vector3::from_fn(|i, _| least_m[i] + numbers[i] * (largest_m[i] - least_m[i]))
            }
            Self::Plate {
                corner_m,
                side_1_m,
                side_2_m,
            } => corner_m + side_1_m * numbers[0] + side_2_m * numbers[1],
        }
    }

    /// The numbers of the allowed point nearest to the start (for a plate with right angles; near
    /// to it for others).
    fn numbers(&self, start_m: &Vector3<f64>) -> Vec<f64> {
        let part = |value: f64, size: f64| {
            if size > 0.0 {
                (value / size).clamp(0.0, 1.0)
            } else {
                0.0
            }
        };
        match self {
            Self::Fixed => Vec::new(),
            Self::Box { least_m, largest_m } => (0..3)
                .map(|i| part(start_m[i] - least_m[i], largest_m[i] - least_m[i]))
                .collect(),
            Self::Plate {
                corner_m,
                side_1_m,
                side_2_m,
            } => [side_1_m, side_2_m]
                .iter()
                .map(|side| part((start_m - corner_m).dot(side), side.norm_squared()))
                .collect(),
        }
    }

    fn is_good(&self) -> bool {
        match self {
            Self::Fixed => true,
            Self::Box { least_m, largest_m } => (0..3).all(|i| {
                least_m[i] <= largest_m[i] && largest_m[i].is_finite() && least_m[i].is_finite()
            }),
            Self::Plate {
                corner_m,
                side_1_m,
                side_2_m,
            } => [corner_m, side_1_m, side_2_m]
                .iter()
                .all(|v| v.iter().all(|x| x.is_finite())),
        }
    }
}

/// What is to grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Objective {
    /// The force that is feasible in every direction at every pose, N.
    LeastRadius,
    /// The mean over the poses of the force that is feasible in every direction, N.
    MeanRadius,
    /// The mean over the poses of the volume of the feasible set, N^3.
    MeanVolume,
}

/// Units placed anew.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// Exit points, base frame, m.
    pub exits_m: Vec<Vector3<f64>>,
    /// Objective there, in its unit.
    pub value: f64,
    /// Objective of the start as given.
    pub start_value: f64,
    /// Sets of exit points looked at.
    pub evaluations: usize,
}

impl Placement {
    /// Value over that of the start, less 1. Meaningless where the start's is not positive.
    #[must_use]
    pub fn relative_gain(&self) -> f64 {
        self.value / self.start_value - 1.0
    }
}

/// What is given to [`place`].
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// Present exit points, base frame, m.
    pub start_m: Vec<Vector3<f64>>,
    /// Where each may be.
    pub mounts: Vec<Mount>,
    /// Least and largest tension of each cable, N.
    pub bounds_n: Vec<(f64, f64)>,
    /// Tip positions that count.
    pub poses: Vec<Pose>,
    /// What is to grow.
    pub objective: Objective,
    /// No exit point closer than this to any pose, m: room for the robot.
    pub clearance_m: f64,
    /// Random starts beside the given one.
    pub random_starts: usize,
}

/// The objective of a set of exit points.
///
/// # Errors
/// [`WorkspaceError`].
pub fn value(
    exits_m: &[Vector3<f64>],
    bounds_n: &[(f64, f64)],
    poses: &[Pose],
    objective: Objective,
) -> Result<f64, WorkspaceError> {
    if poses.is_empty() {
        return Err(WorkspaceError::NoPose);
    }
    let mut least = f64::INFINITY;
    let mut sum = 0.0;
    for tip in poses {
        let set = Zonotope::new(&cable_directions(exits_m, tip)?, bounds_n)?;
        let here = match objective {
            Objective::MeanVolume => set.volume_n3(),
            _ => set.radius_n(),
        };
        least = least.min(here);
        sum += here;
    }
    let mean = sum / poses.len() as f64;
    Ok(match objective {
        Objective::LeastRadius => least,
        Objective::MeanRadius | Objective::MeanVolume => mean,
    })
}

/// Exit points for more feasible force. Never worse than the start where that is within the
/// mounting limits.
///
/// # Errors
/// [`WorkspaceError`]; [`WorkspaceError::Counts`] where exit points, mounts and tensions differ in
/// number.
pub fn place(task: &Task) -> Result<Placement, WorkspaceError> {
    let units = task.start_m.len();
    for count in [task.mounts.len(), task.bounds_n.len()] {
        if count != units {
            return Err(WorkspaceError::Counts {
                directions: units,
                bounds: count,
            });
        }
    }
    if let Some(bad) = task.mounts.iter().position(|m| !m.is_good()) {
        return Err(WorkspaceError::BadCable {
            cable: bad + 1,
            what: "its mounting limits are not finite, or least is above largest",
        });
    }
    let is_distance = task.clearance_m >= 0.0;
    if !is_distance {
        return Err(WorkspaceError::BadOption {
            name: "clearance_m",
            value: task.clearance_m,
            problem: "it is a distance in m, 0 or more",
        });
    }
    let start_value = value(&task.start_m, &task.bounds_n, &task.poses, task.objective)?;
    let mut search = Search {
        task,
        objective: task.objective,
        evaluations: 0,
    };
    let first: Vec<f64> = task
        .mounts
        .iter()
        .zip(&task.start_m)
        .flat_map(|(m, s)| m.numbers(s))
        .collect();
    let mut best = search.descend(first.clone());
    if task.objective == Objective::LeastRadius {
        let found = search.by_way_of_the_mean(first);
        if found.1 > best.1 {
            best = found;
        }
    }
    let mut random = SplitMix64::new(0x9E37_79B9_7F4A_7C15);
    for _ in 0..task.random_starts {
        let numbers = (0..best.0.len()).map(|_| random.unit()).collect();
        let found = search.by_way_of_the_mean(numbers);
        if found.1 > best.1 {
            best = found;
        }
    }
    let exits_m = search.exits(&best.0);
    // The search climbs a slightly different hill (see `Search::score`): report the plain value.
    let found = value(&exits_m, &task.bounds_n, &task.poses, task.objective);
    let (exits_m, reached) = match found {
        Ok(v) if v >= start_value || !search.start_is_allowed() => (exits_m, v),
        _ => (task.start_m.clone(), start_value),
    };
    Ok(Placement {
        exits_m,
        value: reached,
        start_value,
        evaluations: search.evaluations,
    })
}

struct Search<'t> {
    task: &'t Task,
    /// What is climbed now.
    objective: Objective,
    evaluations: usize,
}

impl Search<'_> {
    fn exits(&self, numbers: &[f64]) -> Vec<Vector3<f64>> {
        let mut at = 0;
        self.task
            .mounts
            .iter()
            .zip(&self.task.start_m)
            .map(|(mount, start)| {
                let count = mount.freedoms();
                let point = mount.point(&numbers[at..at + count], start);
                at += count;
                point
            })
            .collect()
    }

    fn start_is_allowed(&self) -> bool {
        let clear = self.is_clear(&self.task.start_m);
        let within = self
            .task
            .mounts
            .iter()
            .zip(&self.task.start_m)
            .all(|(m, s)| (m.point(&m.numbers(s), s) - s).norm() < 1e-6);
        clear && within
    }

    fn is_clear(&self, exits_m: &[Vector3<f64>]) -> bool {
        exits_m.iter().all(|e| {
            self.task
                .poses
                .iter()
                .all(|p| (e - p).norm() >= self.task.clearance_m)
        })
    }

    fn score(&mut self, numbers: &[f64]) -> f64 {
        self.evaluations += 1;
        let task = self.task;
        let exits = self.exits(numbers);
        if !self.is_clear(&exits) {
            return f64::NEG_INFINITY;
        }
        let of = |objective| {
            value(&exits, &task.bounds_n, &task.poses, objective).unwrap_or(f64::NEG_INFINITY)
        };
        match self.objective {
            // A little of the mean, so that there is a slope where the worst pose does not feel a
            // unit.
            Objective::LeastRadius => of(Objective::LeastRadius) + 0.02 * of(Objective::MeanRadius),
            other => of(other),
        }
    }

    /// The least radius has many ridges on which no single number helps; the mean has fewer. So the
    /// mean is climbed first, and the least radius from there.
    fn by_way_of_the_mean(&mut self, at: Vec<f64>) -> (Vec<f64>, f64) {
        if self.task.objective != Objective::LeastRadius {
            return self.descend(at);
        }
        self.objective = Objective::MeanRadius;
        let (at, _) = self.descend(at);
        self.objective = Objective::LeastRadius;
        self.descend(at)
    }

    fn descend(&mut self, mut at: Vec<f64>) -> (Vec<f64>, f64) {
        let mut best = self.score(&at);
        let mut step = 0.25;
        while step > 1e-3 {
            let before = at.clone();
            let mut better = false;
            for i in 0..at.len() {
                for sign in [1.0, -1.0] {
                    let old = at[i];
                    at[i] = (old + sign * step).clamp(0.0, 1.0);
                    if at[i] == old {
                        continue;
                    }
                    let score = self.score(&at);
                    if score > best {
                        best = score;
                        better = true;
                        break;
                    }
                    at[i] = old;
                }
            }
            if better {
                // The pattern: once more by the same way.
                let further: Vec<f64> = at
                    .iter()
                    .zip(&before)
                    .map(|(now, was)| (2.0 * now - was).clamp(0.0, 1.0))
                    .collect();
                let score = self.score(&further);
                if score > best {
                    best = score;
                    at = further;
                }
            } else {
                step *= 0.5;
            }
        }
        (at, best)
    }
}

#[cfg(test)]
mod tests {
    use super::super::map::ball_grid;
    use super::*;
    use crate::geometry::testing::{CENTER_M, UNITS};

    fn task() -> Task {
        let start_m: Vec<Vector3<f64>> = UNITS.iter().map(|u| Vector3::from(u.0)).collect();
        Task {
            mounts: start_m
                .iter()
                .map(|s| Mount::Box {
                    least_m: s.add_scalar(-0.1),
                    largest_m: s.add_scalar(0.1),
                })
                .collect(),
            start_m,
            bounds_n: vec![(2.0, 12.0); 6],
            poses: ball_grid(&Vector3::from(CENTER_M), 0.05, 3),
            objective: Objective::LeastRadius,
            clearance_m: 0.1,
            random_starts: 1,
        }
    }

    #[test]
    fn the_example_rig_gains_within_its_limits() {
        let task = task();
        let found = place(&task).unwrap();
        assert!(found.value > 1.1 * found.start_value, "{found:?}");
        for (mount, exit) in task.mounts.iter().zip(&found.exits_m) {
            let Mount::Box { least_m, largest_m } = mount else {
                panic!()
            };
            assert!((0..3).all(|i| (least_m[i]..=largest_m[i]).contains(&exit[i])));
        }
        let again = value(&found.exits_m, &task.bounds_n, &task.poses, task.objective).unwrap();
        assert_eq!(again, found.value);
        assert_eq!(place(&task).unwrap(), found);
        // Climbing the mean must not come out with a better least.
        let mean = place(&Task {
            objective: Objective::MeanRadius,
            ..task.clone()
        })
        .unwrap();
        let least = value(&mean.exits_m, &task.bounds_n, &task.poses, task.objective);
        assert!(found.value >= least.unwrap());
    }

    #[test]
    fn a_known_optimum_is_found() {
        // One unit out of place in a rig of orthogonal pairs, on a plate; straight opposite is
        // best.
        let mut task = task();
        let c = Vector3::from(CENTER_M);
        let axes = [
            Vector3::x(),
            -Vector3::x(),
            Vector3::y(),
            -Vector3::y(),
            Vector3::z(),
            -Vector3::z(),
        ];
        task.start_m = axes.iter().map(|a| c + a * 0.5).collect();
        task.poses = vec![c];
        task.mounts = vec![Mount::Fixed; 6];
        task.mounts[0] = Mount::Plate {
            corner_m: c + Vector3::new(0.5, -0.3, -0.2),
            side_1_m: Vector3::new(0.0, 0.7, 0.0),
            side_2_m: Vector3::new(0.0, 0.0, 0.45),
        };
        task.start_m[0] = c + Vector3::new(0.5, 0.25, 0.15);
        task.objective = Objective::LeastRadius;
        let found = place(&task).unwrap();
        assert!(
            (found.exits_m[0] - c - Vector3::new(0.5, 0.0, 0.0)).norm() < 0.01,
            "{found:?}"
        );
        assert!((found.value - 10.0).abs() < 0.1);
    }

    #[test]
    fn bad_tasks_are_refused() {
        let mut few = task();
        few.mounts.pop();
        assert!(matches!(place(&few), Err(WorkspaceError::Counts { .. })));
        let mut turned = task();
        turned.mounts[2] = Mount::Box {
            least_m: Vector3::repeat(1.0),
            largest_m: Vector3::zeros(),
        };
        assert!(matches!(
            place(&turned),
            Err(WorkspaceError::BadCable { cable: 3, .. })
        ));
        let mut nan = task();
        nan.clearance_m = f64::NAN;
        assert!(matches!(place(&nan), Err(WorkspaceError::BadOption { .. })));
        let mut none = task();
        none.poses.clear();
        assert_eq!(place(&none), Err(WorkspaceError::NoPose));
        let mut fixed = task();
        fixed.mounts = vec![Mount::Fixed; 6];
        let found = place(&fixed).unwrap();
        assert_eq!(
            (found.value, &found.exits_m),
            (found.start_value, &fixed.start_m)
        );
    }
}
