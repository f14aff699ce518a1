//! Random problems, for tests and evaluations.

use super::Problem;
use control::geometry::cable_direction;
use nalgebra::Vector3;
use random::SplitMix64;
use wire::UNITS;

/// A direction, uniform on the sphere.
fn direction(random: &mut SplitMix64) -> Vector3<f64> {
    loop {
        let v = Vector3::from_fn(|_, _| random.uniform(-1.0, 1.0));
        let n = v.norm();
        if (0.1..=1.0).contains(&n) {
            return v * (1.0 / n);
        }
    }
}

/// Six exits around a workspace, in three roughly antiparallel pairs, each moved by up to
/// `spread_m`.
#[must_use]
pub fn exits(random: &mut SplitMix64, spread_m: f64) -> [Vector3<f64>; UNITS] {
    core::array::from_fn(|i| {
        let mut exit = Vector3::zeros();
        exit[i / 2] = if i % 2 == 0 { 0.42 } else { -0.42 };
        exit + Vector3::from_fn(|_, _| random.uniform(-spread_m, spread_m))
    })
}

/// Directions of the cables from a tip to their exits.
#[must_use]
pub fn directions(exits: &[Vector3<f64>; UNITS], tip_m: Vector3<f64>) -> [Vector3<f64>; UNITS] {
    exits.map(|exit| cable_direction(exit, tip_m).unwrap_or_else(Vector3::x))
}

/// A random case: a rig near the thesis's or (one in four) six directions at random, a force up to
/// 20 N, so that some are out of reach, either reference, sometimes a unit missing.
#[must_use]
pub fn random_problem(random: &mut SplitMix64) -> Problem {
    let directions = if random.unit() < 0.25 {
        core::array::from_fn(|_| direction(random))
    } else {
        let exits = exits(random, 0.12);
        let tip_m = Vector3::from_fn(|_, _| random.uniform(-0.1, 0.1));
        directions(&exits, tip_m)
    };
    let size = 20.0 * random.unit().powi(2);
    let mut problem = Problem {
        directions,
        force_n: direction(random) * size,
        lower_n: [2.0; UNITS],
        upper_n: [12.0; UNITS],
        reference_n: [if random.unit() < 0.5 { 2.0 } else { 7.0 }; UNITS],
        tie_break: 1e-4,
    };
    if random.unit() < 0.15 {
        let gone = ((random.unit() * UNITS as f64) as usize).min(UNITS - 1);
        problem.lower_n[gone] = 0.0;
        problem.upper_n[gone] = 0.0;
    }
    problem
}
