//! The exact solution of an allocation by trying every active set: each cable at its lower bound,
//! at its upper bound or between, 3^6 sets. Slow and simple on purpose; it shares no code with the
//! solver it judges.

use super::Problem;
use wire::UNITS;

/// Slack within which a free tension counts as within its bounds, N.
const WITHIN_N: f64 = 1e-9;

/// Of all active sets the tensions (N) that keep the bounds and have the least objective. The
/// problem's numbers have to be finite and its tie-break positive.
#[must_use]
pub fn solve(problem: &Problem) -> [f64; UNITS] {
    let mut best = (f64::INFINITY, problem.lower_n);
    for code in 0..3_u32.pow(UNITS as u32) {
        let mut digits = code;
        let mut tension = [0.0; UNITS];
        let mut free = Vec::with_capacity(UNITS);
        let mut redundant = false;
        for (i, slot) in tension.iter_mut().enumerate() {
            match digits % 3 {
                0 => *slot = problem.lower_n[i],
                // With equal bounds (a unit that takes no part) one of the three is enough.
                _ if !problem.takes_part(i) => redundant = true,
                1 => *slot = problem.upper_n[i],
                _ => free.push(i),
            }
            digits /= 3;
        }
        if redundant || !stationary(problem, &mut tension, &free) {
            continue;
        }
        let objective = problem.objective(&tension);
        if objective < best.0 {
            best = (objective, tension);
        }
    }
    best.1
}

/// Sets the free tensions where the gradient is zero; `false` where they leave their bounds.
fn stationary(problem: &Problem, tension: &mut [f64; UNITS], free: &[usize]) -> bool {
    let n = free.len();
    // What is left of the force for the free cables.
    let missing = problem.force_n - problem.force_of(tension);
    // Rows of (A^T A + eps I | A^T missing + eps T_ref).
    let mut m = [[0.0; UNITS + 1]; UNITS];
    for (a, &i) in free.iter().enumerate() {
        for (b, &j) in free.iter().enumerate() {
            m[a][b] = problem.directions[i].dot(&problem.directions[j]);
        }
        m[a][a] += problem.tie_break;
        m[a][UNITS] =
            problem.directions[i].dot(&missing) + problem.tie_break * problem.reference_n[i];
    }
    // Gauss with row pivots.
    for column in 0..n {
        let pivot = (column..n)
            .max_by(|a, b| m[*a][column].abs().total_cmp(&m[*b][column].abs()))
            .unwrap_or(column);
        m.swap(column, pivot);
        let head = m[column];
        for row in m.iter_mut().take(n).skip(column + 1) {
            let factor = row[column] / head[column];
            for (value, above) in row.iter_mut().zip(head).skip(column) {
                *value -= factor * above;
            }
        }
    }
    for row in (0..n).rev() {
        let known: f64 = (row + 1..n).map(|k| m[row][k] * tension[free[k]]).sum();
        let value = (m[row][UNITS] - known) / m[row][row];
        let i = free[row];
        if !(problem.lower_n[i] - WITHIN_N..=problem.upper_n[i] + WITHIN_N).contains(&value) {
            return false;
        }
        tension[i] = value;
    }
    true
}
