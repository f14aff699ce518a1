//! From a force at the tip to six cable tensions.
//!
//! The thesis (3.7) minimises `|A T - F|^2` within 2 to 12 N. Six tensions and three force
//! components leave a whole set of minimisers, and a solver may return any of them, so that
//! tensions jump while the force hardly changes. Here a tie-break makes the answer unique and
//! continuous:
//!
//! ```text
//! minimise |A T - F|^2 + eps |T - T_ref|^2   subject to  lower_i <= T_i <= upper_i
//! ```
//!
//! clarabel solves it. Its interior point stops a little inside of the bounds, and with a small
//! `eps` a tiny gap in the objective is a visible gap in `T`; so the solution's active set is taken
//! and the optimality conditions (KKT) are solved for it exactly, and checked. Should the check
//! fail, a few active-set steps repair it, and as a last resort all active sets are tried
//! ([`oracle`]).
//!
//! A force out of reach is never silently replaced: [`Allocation`] holds the nearest one, how far
//! it is, and the largest fraction of the commanded one that the cables can apply (a linear
//! program).

pub mod cases;
pub mod oracle;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use control::geometry::applied_force;
use nalgebra::Vector3;
use wire::UNITS;

/// Residual in newtons below which a force counts as reached; above, the linear program is solved.
pub const REACHED_N: f64 = 1e-3;

/// One allocation to solve. Units without a cable in play have `upper_n == 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Problem {
    /// Unit vectors from the tip to where each cable leaves its reel.
    pub directions: [Vector3<f64>; UNITS],
    /// Force to apply at the tip, N.
    pub force_n: Vector3<f64>,
    /// Least tension of each cable, N; 0 for a unit that takes no part.
    pub lower_n: [f64; UNITS],
    /// Largest tension of each cable, N; 0 for a unit that takes no part.
    pub upper_n: [f64; UNITS],
    /// Tensions to stay near to, N.
    pub reference_n: [f64; UNITS],
    /// Weight of staying near, dimensionless. At 1e-4 the force it costs is below a millinewton.
    pub tie_break: f64,
}

impl Problem {
    /// Whether unit `i` (from 0) takes part.
    #[must_use]
    pub fn takes_part(&self, i: usize) -> bool {
        self.upper_n[i] > 0.0
    }

    /// Force at the tip in N for tensions in N: `A T` (thesis 3.7).
    #[must_use]
    pub fn force_of(&self, tension_n: &[f64; UNITS]) -> Vector3<f64> {
        applied_force(&self.directions, tension_n)
    }

    /// The objective in N^2.
    #[must_use]
    pub fn objective(&self, tension_n: &[f64; UNITS]) -> f64 {
        let miss = self.force_of(tension_n) - self.force_n;
        let away: f64 = (0..UNITS)
            .filter(|i| self.takes_part(*i))
            .map(|i| (tension_n[i] - self.reference_n[i]).powi(2))
            .sum();
        miss.norm_squared() + self.tie_break * away
    }

    /// Half the objective's Hessian, the units that take no part decoupled.
    fn hessian(&self) -> [[f64; UNITS]; UNITS] {
        core::array::from_fn(|i| {
            core::array::from_fn(|j| {
                let coupled = if self.takes_part(i) && self.takes_part(j) {
                    self.directions[i].dot(&self.directions[j])
                } else {
                    0.0
                };
                coupled + if i == j { self.tie_break } else { 0.0 }
            })
        })
    }

    /// Half the objective's linear term.
    fn linear(&self) -> [f64; UNITS] {
        core::array::from_fn(|i| {
            if self.takes_part(i) {
                -self.directions[i].dot(&self.force_n) - self.tie_break * self.reference_n[i]
            } else {
                0.0
            }
        })
    }

    fn is_finite(&self) -> bool {
        let all = |values: &[f64]| values.iter().all(|v| v.is_finite());
        self.directions.iter().all(|d| all(d.as_slice()))
            && all(self.force_n.as_slice())
            && all(&self.lower_n)
            && all(&self.upper_n)
            && all(&self.reference_n)
            && self.tie_break.is_finite()
            && self.tie_break > 0.0
            && (0..UNITS).all(|i| self.lower_n[i] <= self.upper_n[i])
    }
}

/// Tensions, and what they do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allocation {
    /// Cable tensions, N.
    pub tension_n: [f64; UNITS],
    /// Force that they apply at the tip, N.
    pub force_n: Vector3<f64>,
    /// Distance between that and the commanded force, N.
    pub residual_n: f64,
    /// Whether the commanded force is within reach of the cables.
    pub feasible: bool,
    /// How much of the commanded force the cables can apply in exactly its direction.
    pub fraction: Fraction,
    /// How the tensions were found.
    pub path: Path,
}

/// How much of a commanded force the cables can apply in exactly its direction. As JSON a number,
/// or the words `not even zero` or `unknown`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fraction {
    /// The largest fraction, 0 to 1.
    Of(f64),
    /// No fraction, so not even zero force.
    NotEvenZero,
    /// The linear program was not solved. It says nothing about the force.
    Unknown,
}

impl Fraction {
    /// The fraction, where there is one.
    #[must_use]
    pub const fn value(self) -> Option<f64> {
        match self {
            Self::Of(fraction) => Some(fraction),
            Self::NotEvenZero | Self::Unknown => None,
        }
    }

    /// From the status of the linear program and its solution.
    fn of_program(status: SolverStatus, solution: f64) -> Self {
        match status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => Self::Of(solution.clamp(0.0, 1.0)),
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                Self::NotEvenZero
            }
            _ => Self::Unknown,
        }
    }
}

impl serde::Serialize for Fraction {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Of(fraction) => serializer.serialize_f64(*fraction),
            Self::NotEvenZero => serializer.serialize_str("not even zero"),
            Self::Unknown => serializer.serialize_str("unknown"),
        }
    }
}

/// How a solution was found; the later ones are slower and should be rare.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// The active set of the solution before, repaired where needed, satisfied the optimality
    /// conditions ([`Allocator::warm`]).
    Warm,
    /// clarabel's active set satisfied the optimality conditions at once.
    Polished,
    /// A few active-set steps were needed.
    Repaired,
    /// All active sets were tried.
    Enumerated,
}

/// Why an allocation could not be computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AllocationError {
    /// A number is NaN or infinite, a bound above the other, or the tie-break not positive.
    #[error("allocation: a direction, force, bound or the tie-break is not a usable number; check the rig file and the pose")]
    NotFinite,
    /// clarabel rejected the problem's structure: a fault of this program.
    #[error("allocation: the solver refused the problem's structure")]
    Solver,
}

/// Solves allocations; keeps the solvers' structures between calls.
pub struct Allocator {
    quadratic: DefaultSolver<f64>,
    linear: DefaultSolver<f64>,
    /// Whether the last active set is tried before clarabel.
    warm: bool,
    last_set: Option<[Held; UNITS]>,
}

impl std::fmt::Debug for Allocator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Allocator").finish_non_exhaustive()
    }
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: 60,
        // Data updates need the structure untouched.
        presolve_enable: false,
        input_sparse_dropzeros: false,
        ..DefaultSettings::default()
    }
}

/// Upper triangle of a symmetric 6 x 6 matrix, column by column.
fn upper_triangle(h: &[[f64; UNITS]; UNITS]) -> Vec<f64> {
    (0..UNITS)
        .flat_map(|column| (0..=column).map(move |row| (row, column)))
        .map(|(row, column)| h[row][column])
        .collect()
}

impl Allocator {
    /// Builds the solvers.
    ///
    /// # Errors
    /// [`AllocationError::Solver`] where clarabel refuses the structure.
    pub fn new() -> Result<Self, AllocationError> {
        Ok(Self {
            quadratic: quadratic_solver()?,
            linear: linear_solver()?,
            warm: false,
            last_set: None,
        })
    }

    /// Builds solvers that try the active set of the solution before, as in a control loop, where
    /// it seldom changes. The optimality conditions are checked all the same, so the solution is
    /// the same; it takes a tenth of the time. clarabel solves what is left.
    ///
    /// # Errors
    /// As [`Allocator::new`].
    pub fn warm() -> Result<Self, AllocationError> {
        Ok(Self {
            warm: true,
            ..Self::new()?
        })
    }

    /// Solves one problem.
    ///
    /// # Errors
    /// [`AllocationError::NotFinite`] for unusable numbers.
    pub fn solve(&mut self, problem: &Problem) -> Result<Allocation, AllocationError> {
        let (tension_n, path) = self.tensions(problem)?;
        let force_n = problem.force_of(&tension_n);
        let residual_n = (force_n - problem.force_n).norm();
        let (feasible, fraction) = if residual_n <= REACHED_N {
            (true, Fraction::Of(1.0))
        } else {
            // At the edge of what is feasible the tie-break alone may cost more than REACHED_N.
            let fraction = self.largest_fraction(problem)?;
            (fraction.value().is_some_and(|s| s > 1.0 - 1e-6), fraction)
        };
        Ok(Allocation {
            tension_n,
            force_n,
            residual_n,
            feasible,
            fraction,
            path,
        })
    }

    /// The tensions alone: the quadratic program and its polish.
    ///
    /// # Errors
    /// [`AllocationError::NotFinite`] for unusable numbers.
    pub fn tensions(&mut self, problem: &Problem) -> Result<([f64; UNITS], Path), AllocationError> {
        if !problem.is_finite() {
            return Err(AllocationError::NotFinite);
        }
        if let Some(last) = self.last_set {
            let set = core::array::from_fn(|i| {
                if problem.takes_part(i) {
                    last[i]
                } else {
                    Held::Lower
                }
            });
            if let Some((tension, set, _)) = polish(problem, set) {
                self.last_set = Some(set);
                return Ok((tension, Path::Warm));
            }
        }
        let set = self.active_set(problem)?;
        Ok(match polish(problem, set) {
            Some((tension, set, path)) => {
                self.last_set = self.warm.then_some(set);
                (tension, path)
            }
            None => (oracle::solve(problem), Path::Enumerated),
        })
    }

    /// clarabel's idea of which bounds hold the solution.
    fn active_set(&mut self, problem: &Problem) -> Result<[Held; UNITS], AllocationError> {
        let hessian = upper_triangle(&problem.hessian());
        let linear = problem.linear().to_vec();
        let mut bounds = vec![0.0; 2 * UNITS];
        for i in 0..UNITS {
            // A unit that takes no part is decoupled; an interval around zero gives the solver an
            // interior.
            let (lower, upper) = if problem.takes_part(i) {
                (problem.lower_n[i], problem.upper_n[i])
            } else {
                (-1.0, 1.0)
            };
            bounds[i] = upper;
            bounds[UNITS + i] = -lower;
        }
        let solver = &mut self.quadratic;
        solver
            .update_P(&hessian)
            .and_then(|()| solver.update_q(&linear))
            .and_then(|()| solver.update_b(&bounds))
            .map_err(|_| AllocationError::Solver)?;
        solver.solve();
        let (slack, dual) = (&solver.solution.s, &solver.solution.z);
        Ok(core::array::from_fn(|i| {
            if !problem.takes_part(i) {
                Held::Lower
            } else if dual[i] > slack[i] {
                Held::Upper
            } else if dual[UNITS + i] > slack[UNITS + i] {
                Held::Lower
            } else {
                Held::Free
            }
        }))
    }

    /// Largest `s` in 0 to 1 for which `A T = s F` has a solution within the bounds.
    fn largest_fraction(&mut self, problem: &Problem) -> Result<Fraction, AllocationError> {
        let mut matrix = Vec::with_capacity(linear_nonzeros());
        let mut bounds = vec![0.0; 3 + 2 * UNITS + 2];
        for i in 0..UNITS {
            let direction = if problem.takes_part(i) {
                problem.directions[i]
            } else {
                Vector3::zeros()
            };
            matrix.extend(direction.iter());
            matrix.extend([1.0, -1.0]);
            let (lower, upper) = if problem.takes_part(i) {
                (problem.lower_n[i], problem.upper_n[i])
            } else {
                (-1.0, 1.0)
            };
            bounds[3 + i] = upper;
            bounds[3 + UNITS + i] = -lower;
        }
        matrix.extend((-problem.force_n).iter());
        matrix.extend([1.0, -1.0]);
        bounds[3 + 2 * UNITS] = 1.0;
        let solver = &mut self.linear;
        solver
            .update_A(&matrix)
            .and_then(|()| solver.update_b(&bounds))
            .map_err(|_| AllocationError::Solver)?;
        solver.solve();
        Ok(Fraction::of_program(
            solver.solution.status,
            solver.solution.x[UNITS],
        ))
    }
}

fn quadratic_solver() -> Result<DefaultSolver<f64>, AllocationError> {
    let mut column_start = vec![0];
    let mut rows = Vec::new();
    for column in 0..UNITS {
        rows.extend(0..=column);
        column_start.push(rows.len());
    }
    let identity =
        core::array::from_fn(|i| core::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    let hessian = CscMatrix::new(UNITS, UNITS, column_start, rows, upper_triangle(&identity));
    // T <= upper, -T <= -lower.
    let constraints = CscMatrix::new(
        2 * UNITS,
        UNITS,
        (0..=UNITS).map(|i| 2 * i).collect(),
        (0..UNITS).flat_map(|i| [i, UNITS + i]).collect(),
        (0..UNITS).flat_map(|_| [1.0, -1.0]).collect(),
    );
    let mut bounds = vec![12.0; UNITS];
    bounds.extend([-2.0; UNITS]);
    let cones = [NonnegativeConeT(2 * UNITS)];
    DefaultSolver::new(
        &hessian,
        &[0.0; UNITS],
        &constraints,
        &bounds,
        &cones,
        settings(),
    )
    .map_err(|_| AllocationError::Solver)
}

/// Entries of the linear program's matrix: five per column, seven columns.
const fn linear_nonzeros() -> usize {
    5 * (UNITS + 1)
}

/// Variables: six tensions and the fraction. Rows: 3 equalities, upper and lower bounds, and
/// 0 <= fraction <= 1.
fn linear_solver() -> Result<DefaultSolver<f64>, AllocationError> {
    let n = UNITS + 1;
    let mut rows = Vec::with_capacity(linear_nonzeros());
    for i in 0..UNITS {
        rows.extend([0, 1, 2, 3 + i, 3 + UNITS + i]);
    }
    let fraction = 3 + 2 * UNITS;
    rows.extend([0, 1, 2, fraction, fraction + 1]);
    let values = vec![1.0; rows.len()];
    let constraints = CscMatrix::new(
        fraction + 2,
        n,
        (0..=n).map(|i| 5 * i).collect(),
        rows,
        values,
    );
    let mut cost = vec![0.0; n];
    cost[UNITS] = -1.0;
    let cones = [ZeroConeT(3), NonnegativeConeT(2 * UNITS + 2)];
    let mut settings = settings();
    // Equilibrating by the placeholder values above would only skew the real ones.
    settings.equilibrate_enable = false;
    let none = CscMatrix::zeros((n, n));
    DefaultSolver::new(
        &none,
        &cost,
        &constraints,
        &vec![0.0; fraction + 2],
        &cones,
        settings,
    )
    .map_err(|_| AllocationError::Solver)
}

/// Where a tension sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Held {
    /// At its lower bound.
    Lower,
    /// Between the bounds.
    Free,
    /// At its upper bound.
    Upper,
}

/// Slack within which a bound counts as kept (N) and a multiplier as having its sign (N).
const KKT_TOLERANCE: f64 = 1e-10;

/// Solves the optimality conditions for an active set and repairs the set where they don't hold.
/// `None` where a dozen repairs weren't enough. With the tensions comes the set that holds them.
fn polish(
    problem: &Problem,
    mut set: [Held; UNITS],
) -> Option<([f64; UNITS], [Held; UNITS], Path)> {
    let h = problem.hessian();
    let q = problem.linear();
    for round in 0..12 {
        let tension = solve_free(problem, &h, &q, &set)?;
        let path = if round == 0 {
            Path::Polished
        } else {
            Path::Repaired
        };
        match worst_violation(problem, &h, &q, &set, &tension) {
            None => return Some((tension, set, path)),
            Some((unit, held)) => set[unit] = held,
        }
    }
    None
}

/// The bound or multiplier that is furthest on the wrong side, and what the unit has to be instead.
fn worst_violation(
    problem: &Problem,
    h: &[[f64; UNITS]; UNITS],
    q: &[f64; UNITS],
    set: &[Held; UNITS],
    tension: &[f64; UNITS],
) -> Option<(usize, Held)> {
    let mut worst = (KKT_TOLERANCE, None);
    for i in (0..UNITS).filter(|i| problem.takes_part(*i)) {
        let gradient: f64 = q[i] + (0..UNITS).map(|j| h[i][j] * tension[j]).sum::<f64>();
        let candidates = match set[i] {
            Held::Free => [
                (problem.lower_n[i] - tension[i], Held::Lower),
                (tension[i] - problem.upper_n[i], Held::Upper),
            ],
            Held::Lower => [(-gradient, Held::Free); 2],
            Held::Upper => [(gradient, Held::Free); 2],
        };
        for (violation, held) in candidates {
            if violation > worst.0 {
                worst = (violation, Some((i, held)));
            }
        }
    }
    worst.1
}

/// Tensions where the held ones sit at their bounds and the gradient of the free ones is zero: a
/// Cholesky solve of the free block. `None` where the block is not positive definite.
fn solve_free(
    problem: &Problem,
    h: &[[f64; UNITS]; UNITS],
    q: &[f64; UNITS],
    set: &[Held; UNITS],
) -> Option<[f64; UNITS]> {
    let mut tension: [f64; UNITS] = core::array::from_fn(|i| match set[i] {
        Held::Lower => problem.lower_n[i],
        Held::Upper => problem.upper_n[i],
        Held::Free => 0.0,
    });
    let mut free = [0; UNITS];
    let mut n = 0;
    for i in (0..UNITS).filter(|i| set[*i] == Held::Free) {
        free[n] = i;
        n += 1;
    }
    let free = &free[..n];
    let mut l = [[0.0; UNITS]; UNITS];
    let mut y = [0.0; UNITS];
    for (a, &i) in free.iter().enumerate() {
        for (b, &j) in free[..=a].iter().enumerate() {
            let below: f64 = (0..b).map(|k| l[a][k] * l[b][k]).sum();
            let value = h[i][j] - below;
            if a == b {
                if value <= 0.0 {
                    return None;
                }
                l[a][a] = value.sqrt();
            } else {
                l[a][b] = value / l[b][b];
            }
        }
        let held: f64 = (0..UNITS)
            .filter(|j| set[*j] != Held::Free)
            .map(|j| h[i][j] * tension[j])
            .sum();
        let below: f64 = (0..a).map(|k| l[a][k] * y[k]).sum();
        y[a] = (-q[i] - held - below) / l[a][a];
    }
    for a in (0..n).rev() {
        let above: f64 = (a + 1..n).map(|k| l[k][a] * tension[free[k]]).sum();
        tension[free[a]] = (y[a] - above) / l[a][a];
    }
    Some(tension)
}

#[cfg(test)]
mod tests {
    use super::cases::random_problem;
    use super::*;
    use random::SplitMix64;

    /// Three orthogonal antiparallel pairs.
    fn cross() -> Problem {
        Problem {
            directions: [
                Vector3::x(),
                -Vector3::x(),
                Vector3::y(),
                -Vector3::y(),
                Vector3::z(),
                -Vector3::z(),
            ],
            force_n: Vector3::new(0.0, 2.5, 0.0),
            lower_n: [2.0; UNITS],
            upper_n: [12.0; UNITS],
            reference_n: [2.0; UNITS],
            tie_break: 1e-4,
        }
    }

    #[test]
    fn the_textbook_case() {
        let solution = Allocator::new().unwrap().solve(&cross()).unwrap();
        // Pulling y by hand: T3 - T4 = 2.5 with T4 at its bound; the tie-break costs 1e-4 of it.
        let expected = [2.0, 2.0, 4.5, 2.0, 2.0, 2.0];
        for (got, want) in solution.tension_n.iter().zip(expected) {
            assert!((got - want).abs() < 5e-4, "{:?}", solution.tension_n);
        }
        assert!(solution.feasible && solution.residual_n < 5e-4);
    }

    #[test]
    fn a_force_out_of_reach_is_reported_with_its_feasible_fraction() {
        let mut problem = cross();
        problem.force_n = Vector3::new(0.0, 25.0, 0.0);
        let solution = Allocator::new().unwrap().solve(&problem).unwrap();
        assert!(!solution.feasible);
        // 12 N against 2 N: 10 N is the most.
        assert!((solution.residual_n - 15.0).abs() < 1e-9);
        assert!((solution.fraction.value().unwrap() - 0.4).abs() < 1e-6);
        assert_eq!(solution.tension_n[2], 12.0);
        assert_eq!(solution.tension_n[3], 2.0);
    }

    #[test]
    fn a_unit_that_takes_no_part_gets_nothing_and_the_rest_says_what_remains() {
        let mut problem = cross();
        problem.lower_n[2] = 0.0;
        problem.upper_n[2] = 0.0;
        let solution = Allocator::new().unwrap().solve(&problem).unwrap();
        assert_eq!(solution.tension_n[2], 0.0);
        assert!(!solution.feasible);
        // Unit 4 pulls 2 N along -y whatever is done: not even zero is within reach.
        assert_eq!(solution.fraction, Fraction::NotEvenZero);
        assert!((solution.residual_n - 4.5).abs() < 1e-9);
    }

    #[test]
    fn a_solver_that_fails_says_nothing_about_the_force() {
        for (status, fraction, json) in [
            (SolverStatus::Solved, Fraction::Of(0.25), "0.25"),
            (
                SolverStatus::PrimalInfeasible,
                Fraction::NotEvenZero,
                "\"not even zero\"",
            ),
            (
                SolverStatus::NumericalError,
                Fraction::Unknown,
                "\"unknown\"",
            ),
            (
                SolverStatus::MaxIterations,
                Fraction::Unknown,
                "\"unknown\"",
            ),
        ] {
            let found = Fraction::of_program(status, 0.25);
            assert_eq!(found, fraction, "{status:?}");
            assert_eq!(serde_json::to_string(&found).unwrap(), json);
        }
    }

    #[test]
    fn agrees_with_all_active_sets() {
        let mut allocator = Allocator::new().unwrap();
        let mut random = SplitMix64::new(7);
        let mut worst: f64 = 0.0;
        let mut enumerated = 0;
        for case in 0..3000 {
            let problem = random_problem(&mut random);
            let (tension, path) = allocator.tensions(&problem).unwrap();
            let exact = oracle::solve(&problem);
            for i in 0..UNITS {
                worst = worst.max((tension[i] - exact[i]).abs());
            }
            assert!(
                worst < 1e-7,
                "case {case}: {tension:?} {exact:?} {problem:?}"
            );
            enumerated += usize::from(path == Path::Enumerated);
        }
        assert!(enumerated < 3, "{enumerated} cases had to be enumerated");
    }

    #[test]
    fn a_warm_start_changes_the_time_and_not_the_answer() {
        let mut warm = Allocator::warm().unwrap();
        let mut random = SplitMix64::new(9);
        let mut by_path = [0; 2];
        for case in 0..600 {
            let mut problem = random_problem(&mut random);
            // Some steps of a loop each, then an unrelated problem; a unit drops out and comes back
            // on the way.
            for step in 0..5 {
                problem.force_n *= 0.97;
                let (lower, upper) = (problem.lower_n[case % UNITS], problem.upper_n[case % UNITS]);
                if step == 2 {
                    (problem.lower_n[case % UNITS], problem.upper_n[case % UNITS]) = (0.0, 0.0);
                }
                let (tension, path) = warm.tensions(&problem).unwrap();
                let exact = oracle::solve(&problem);
                for i in 0..UNITS {
                    assert!(
                        (tension[i] - exact[i]).abs() < 1e-7,
                        "case {case}: {tension:?} {exact:?}"
                    );
                }
                by_path[usize::from(path == Path::Warm)] += 1;
                (problem.lower_n[case % UNITS], problem.upper_n[case % UNITS]) = (lower, upper);
            }
        }
        assert!(by_path[1] > 9 * by_path[0], "{by_path:?}");
    }

    #[test]
    fn unusable_numbers_are_refused() {
        let mut allocator = Allocator::new().unwrap();
        for bad in [f64::NAN, f64::INFINITY] {
            let mut problem = cross();
            problem.force_n[1] = bad;
            assert_eq!(allocator.solve(&problem), Err(AllocationError::NotFinite));
        }
        let mut problem = cross();
        problem.lower_n[0] = 13.0;
        assert_eq!(allocator.solve(&problem), Err(AllocationError::NotFinite));
        // And the allocator works on afterwards.
        assert!(allocator.solve(&cross()).unwrap().feasible);
    }
}
