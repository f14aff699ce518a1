//! The thesis's formulation as it stands (3.7): `|A T - F|^2` within the bounds, no tie-break. Its
//! minimisers are a whole polytope, and which one a numerical solver returns depends on where it
//! starts. Here for comparison only.

use force::allocation::Problem;
use wire::UNITS;

/// Projected gradient descent from `start` (N) until the tensions stand still: one of the
/// minimisers.
#[must_use]
pub fn solve(problem: &Problem, start: [f64; UNITS]) -> [f64; UNITS] {
    let mut tension = start;
    // The largest eigenvalue of A^T A for six unit vectors is at most 6; most rigs have about 2.
    let step = 1.0
        / (0..UNITS)
            .map(|i| {
                (0..UNITS)
                    .map(|j| problem.directions[i].dot(&problem.directions[j]).abs())
                    .sum::<f64>()
            })
            .fold(1.0, f64::max);
    for _ in 0..2000 {
        let miss = problem.force_of(&tension) - problem.force_n;
        let mut moved: f64 = 0.0;
        for (i, t) in tension.iter_mut().enumerate() {
            let next = (*t - step * problem.directions[i].dot(&miss))
                .clamp(problem.lower_n[i], problem.upper_n[i]);
            moved = moved.max((next - *t).abs());
            *t = next;
        }
        if moved < 1e-12 {
            break;
        }
    }
    tension
}
