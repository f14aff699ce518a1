//! Figures on the allocation: agreement with the oracle, time of a solve, steps along a path.

mod thesis;

use force::allocation::cases::{directions, exits, random_problem};
use force::allocation::{oracle, AllocationError, Allocator, Path, Problem};
use nalgebra::Vector3;
use random::SplitMix64;
use std::time::{Duration, Instant};
use wire::UNITS;

/// What [`oracle_comparison`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OracleReport {
    /// Cases compared.
    pub cases: u32,
    /// Largest difference of any tension to the oracle's, N.
    pub max_error_n: f64,
    /// Cases whose first active set had to be repaired.
    pub repaired: u32,
    /// Cases in which all active sets were tried.
    pub enumerated: u32,
}

/// Compares `cases` random allocations with the exact oracle.
///
/// # Errors
/// [`AllocationError`] where a case can't be solved at all.
pub fn oracle_comparison(cases: u32, seed: u64) -> Result<OracleReport, AllocationError> {
    let mut allocator = Allocator::new()?;
    let mut random = SplitMix64::new(seed);
    let mut report = OracleReport {
        cases,
        max_error_n: 0.0,
        repaired: 0,
        enumerated: 0,
    };
    for _ in 0..cases {
        let problem = random_problem(&mut random);
        let (tension, path) = allocator.tensions(&problem)?;
        let exact = oracle::solve(&problem);
        for (t, e) in tension.iter().zip(exact) {
            report.max_error_n = report.max_error_n.max((t - e).abs());
        }
        match path {
            Path::Polished | Path::Warm => {}
            Path::Repaired => report.repaired += 1,
            Path::Enumerated => report.enumerated += 1,
        }
    }
    Ok(report)
}

/// Wall-clock times of solves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SolveTimes {
    /// Half of the solves take no longer.
    pub median: Duration,
    /// 99.9 % of the solves take no longer.
    pub p999: Duration,
    /// The longest.
    pub longest: Duration,
}

impl SolveTimes {
    fn of(mut times: Vec<Duration>) -> Self {
        times.sort_unstable();
        let at = |share: f64| {
            let last = times.len().saturating_sub(1);
            times
                .get((last as f64 * share) as usize)
                .copied()
                .unwrap_or_default()
        };
        Self {
            median: at(0.5),
            p999: at(0.999),
            longest: at(1.0),
        }
    }
}

/// Times of the solves of a control loop, as [`force::controller::Controller`] has them: the tip
/// moves on a circle of 50 mm and the force turns with it, at 100 Hz, and each solve knows the
/// active set of the one before.
///
/// # Errors
/// [`AllocationError`] where a case can't be solved at all.
pub fn cycle_times(cycles: u32, seed: u64) -> Result<SolveTimes, AllocationError> {
    let mut allocator = Allocator::warm()?;
    let exits = exits(&mut SplitMix64::new(seed), 0.05);
    let problems = (0..cycles).map(|cycle| path_problem(&exits, f64::from(cycle) * PATH_STEP_RAD));
    times(&mut allocator, problems)
}

/// Times of solves without a solution before them, of random cases with forces within reach and
/// not.
///
/// # Errors
/// [`AllocationError`] where a case can't be solved at all.
pub fn cold_times(cases: u32, seed: u64) -> Result<SolveTimes, AllocationError> {
    let mut allocator = Allocator::new()?;
    let mut random = SplitMix64::new(seed);
    let problems = (0..cases).map(|_| random_problem(&mut random));
    times(&mut allocator, problems)
}

fn times(
    allocator: &mut Allocator,
    problems: impl Iterator<Item = Problem>,
) -> Result<SolveTimes, AllocationError> {
    let times = problems.map(|problem| {
        let start = Instant::now();
        std::hint::black_box(allocator.tensions(std::hint::black_box(&problem))?);
        Ok(start.elapsed())
    });
    Ok(SolveTimes::of(times.collect::<Result<_, _>>()?))
}

/// Angle between two problems of a path: a circle in 400 steps, 4 s at 100 Hz.
const PATH_STEP_RAD: f64 = std::f64::consts::TAU / 400.0;

/// A problem on a path: the tip on a circle of 50 mm, the force turning with it.
fn path_problem(exits: &[Vector3<f64>; UNITS], angle_rad: f64) -> Problem {
    let (sin, cos) = angle_rad.sin_cos();
    let tip_m = Vector3::new(0.05 * cos, 0.05 * sin, 0.02 * sin);
    Problem {
        directions: directions(exits, tip_m),
        force_n: Vector3::new(2.5 * sin, 2.5 * cos, 1.0 * (2.0 * angle_rad).sin()),
        lower_n: [2.0; UNITS],
        upper_n: [12.0; UNITS],
        reference_n: [2.0; UNITS],
        tie_break: 1e-4,
    }
}

/// Largest change of any tension between neighbours of a 400-step path, in N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSteps {
    /// With the tie-break.
    pub largest_step_n: f64,
    /// The thesis's formulation, the solver started anywhere within the bounds each time.
    pub thesis_largest_step_n: f64,
    /// Largest distance between the two formulations' forces at the tip: both apply the commanded
    /// force.
    pub force_difference_n: f64,
}

/// Walks the tip once around a 50 mm circle while the force turns, in 400 steps, and compares
/// neighbours.
///
/// # Errors
/// [`AllocationError`] where a case can't be solved at all.
pub fn path_steps(seed: u64) -> Result<PathSteps, AllocationError> {
    let mut allocator = Allocator::new()?;
    let mut random = SplitMix64::new(seed);
    let exits = exits(&mut random, 0.05);
    let mut steps = PathSteps {
        largest_step_n: 0.0,
        thesis_largest_step_n: 0.0,
        force_difference_n: 0.0,
    };
    let mut before: Option<([f64; UNITS], [f64; UNITS])> = None;
    for step in 0..=400 {
        let problem = path_problem(&exits, f64::from(step) * PATH_STEP_RAD);
        let (tied, _) = allocator.tensions(&problem)?;
        let start = core::array::from_fn(|_| random.uniform(2.0, 12.0));
        let untied = thesis::solve(&problem, start);
        let apart = problem.force_of(&tied) - problem.force_of(&untied);
        steps.force_difference_n = steps.force_difference_n.max(apart.norm());
        if let Some((tied_before, untied_before)) = before {
            for i in 0..UNITS {
                let step = (tied[i] - tied_before[i]).abs();
                steps.largest_step_n = steps.largest_step_n.max(step);
                let step = (untied[i] - untied_before[i]).abs();
                steps.thesis_largest_step_n = steps.thesis_largest_step_n.max(step);
            }
        }
        before = Some((tied, untied));
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensions_follow_a_path_without_jumps_where_the_untied_problem_jumps() {
        let steps = path_steps(11).unwrap();
        assert!(steps.largest_step_n < 0.5, "{steps:?}");
        assert!(
            steps.thesis_largest_step_n > 4.0 * steps.largest_step_n,
            "{steps:?}"
        );
    }
}
