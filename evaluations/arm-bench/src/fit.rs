//! Linear models of the efforts: filtered alike on both sides, fitted by sums that logs can be left
//! out of.

use crate::log::Log;
use nalgebra::{DMatrix, DVector};

/// Time constant of the two low-passes, s. Regressors and efforts pass the same, so it costs no
/// bias; it holds off the noise of accelerations that are differences of velocities. Estimate.
const FILTER_S: f64 = 0.04;
/// What the filters need until the first row is forgotten, s.
const SETTLE_S: f64 = 0.5;
/// Sum of the joints' speeds from which a row counts, rad/s: before the first such row the arm
/// waits for its trajectory.
const MOVES: f64 = 0.02;
/// Weight of the penalty on weights, per that of the rows: against regressors that are the same.
const PENALTY: f64 = 1e-7;

/// What a model knows of a row, not filtered: regressors by joint, joints times numbers.
pub type Basis<'a> = &'a dyn Fn(&[f64], &[f64], &[f64]) -> DMatrix<f64>;

/// Rows of a log after the filters.
#[derive(Debug, Clone, Default)]
pub struct Filtered {
    /// Regressors.
    pub basis: Vec<DMatrix<f64>>,
    /// Efforts.
    pub effort: Vec<DVector<f64>>,
    /// Number of the row in the log.
    pub row: Vec<usize>,
}

/// Two low-passes in a row, begun at the first value.
#[derive(Debug, Clone)]
pub struct Filter {
    share: f64,
    state: Option<[DMatrix<f64>; 2]>,
}

impl Filter {
    /// A filter for rows of this distance, s.
    #[must_use]
    pub fn new(step_s: f64) -> Self {
        Self {
            share: step_s / (step_s + FILTER_S),
            state: None,
        }
    }

    /// The next value.
    pub fn step(&mut self, value: &DMatrix<f64>) -> DMatrix<f64> {
        let share = self.share;
        let [first, second] = self
            .state
            .get_or_insert_with(|| [value.clone(), value.clone()]);
        *first += (value - &*first) * share;
        *second += (&*first - &*second) * share;
        second.clone()
    }
}

/// Accelerations: differences of the velocities to the row before.
#[must_use]
pub fn accelerations(log: &Log, row: usize) -> Vec<f64> {
    let before = row.saturating_sub(1);
    let pairs = log.rate[row].iter().zip(&log.rate[before]);
    pairs.map(|(now, then)| (now - then) / log.step_s).collect()
}

/// Filters a log. `gain`: torque per effort, by joint.
#[must_use]
pub fn filtered(log: &Log, gain: &[f64], basis: Basis) -> Filtered {
    let (mut of_basis, mut of_effort) = (Filter::new(log.step_s), Filter::new(log.step_s));
    let speed = |row: usize| log.rate[row].iter().map(|v| v.abs()).sum::<f64>();
    let rows = log.position.len();
    let first = (0..rows).find(|row| speed(*row) > MOVES).unwrap_or(rows);
    let last = (0..rows).rfind(|row| speed(*row) > MOVES).unwrap_or(0);
    let settle = (SETTLE_S / log.step_s) as usize;
    let mut out = Filtered::default();
    for row in 0..rows {
        let (q, v) = (&log.position[row], &log.rate[row]);
        let basis = of_basis.step(&basis(q, v, &accelerations(log, row)));
        let effort = log.effort[row].iter().zip(gain).map(|(e, k)| e * k);
        let effort = DMatrix::from_iterator(gain.len(), 1, effort);
        let effort = of_effort.step(&effort).column(0).into_owned();
        if (first + settle..=last).contains(&row) {
            out.basis.push(basis);
            out.effort.push(effort);
            out.row.push(row);
        }
    }
    out
}

/// Sums of a log, by joint.
#[derive(Debug, Clone)]
pub struct Sums {
    products: Vec<DMatrix<f64>>,
    right: Vec<DVector<f64>>,
    squares: Vec<f64>,
    rows: f64,
}

impl Sums {
    /// Of filtered rows.
    ///
    /// # Panics
    /// Without a row.
    #[must_use]
    pub fn of(filtered: &Filtered) -> Self {
        let (joints, width) = filtered.basis[0].shape();
        let mut sums = Self {
            products: vec![DMatrix::zeros(width, width); joints],
            right: vec![DVector::zeros(width); joints],
            squares: vec![0.0; joints],
            rows: filtered.basis.len() as f64,
        };
        for (basis, effort) in filtered.basis.iter().zip(&filtered.effort) {
            for i in 0..joints {
                let row = basis.row(i).transpose();
                sums.products[i].ger(1.0, &row, &row, 1.0);
                sums.right[i].axpy(effort[i], &row, 1.0);
                sums.squares[i] += effort[i] * effort[i];
            }
        }
        sums
    }

    /// Sums over several logs.
    ///
    /// # Panics
    /// Without a log.
    #[must_use]
    pub fn total(parts: &[&Self]) -> Self {
        let mut sum = parts[0].clone();
        for part in &parts[1..] {
            for i in 0..sum.squares.len() {
                sum.products[i] += &part.products[i];
                sum.right[i] += &part.right[i];
                sum.squares[i] += part.squares[i];
            }
            sum.rows += part.rows;
        }
        sum
    }

    /// Standard deviation that weights leave of a joint's effort.
    fn left(&self, i: usize, weights: &DVector<f64>) -> f64 {
        let square = self.squares[i] - 2.0 * self.right[i].dot(weights)
            + (&self.products[i] * weights).dot(weights);
        (square.max(0.0) / self.rows).sqrt()
    }

    /// Fits weights that all joints share: each joint counts by what is left of it. `None` where
    /// nothing can be told.
    #[must_use]
    pub fn fit(&self) -> Option<Linear> {
        let joints = self.squares.len();
        let mut deviation: Vec<f64> = (0..joints)
            .map(|i| (self.squares[i] / self.rows).sqrt().max(1e-9))
            .collect();
        let mut weights = DVector::zeros(self.right[0].len());
        for _ in 0..3 {
            let mut products = DMatrix::zeros(weights.len(), weights.len());
            let mut right = DVector::zeros(weights.len());
            for (i, sd) in deviation.iter().enumerate() {
                products += &self.products[i] / (sd * sd);
                right += &self.right[i] / (sd * sd);
            }
            let scale = products.diagonal().map(|d| (d + 1e-12).sqrt().recip());
            let penalty = PENALTY * self.rows.sqrt();
            let normal = DMatrix::from_fn(scale.len(), scale.len(), |i, j| {
                let own = if i == j { penalty } else { 0.0 };
                products[(i, j)] * scale[i] * scale[j] + own
            });
            let solved = normal.cholesky()?.solve(&right.component_mul(&scale));
            weights = solved.component_mul(&scale);
            deviation = (0..joints)
                .map(|i| self.left(i, &weights).max(1e-9))
                .collect();
        }
        Some(Linear { weights, deviation })
    }
}

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Linear {
    /// Weights.
    pub weights: DVector<f64>,
    /// Standard deviation of what is left of each joint's effort in the training.
    pub deviation: Vec<f64>,
}

impl Linear {
    /// What the efforts have above the model, row by row.
    #[must_use]
    pub fn left(&self, filtered: &Filtered) -> Vec<DVector<f64>> {
        let rows = filtered.basis.iter().zip(&filtered.effort);
        rows.map(|(basis, effort)| effort - basis * &self.weights)
            .collect()
    }
}

/// Regressors of a joint put into their own columns: the weights of joints are then apart.
#[must_use]
pub fn apart(of_joint: &[Vec<f64>]) -> DMatrix<f64> {
    let width = of_joint[0].len();
    let mut out = DMatrix::zeros(of_joint.len(), width * of_joint.len());
    for (i, row) in of_joint.iter().enumerate() {
        for (k, value) in row.iter().enumerate() {
            out[(i, width * i + k)] = *value;
        }
    }
    out
}

/// Matrices side by side.
#[must_use]
pub fn beside(parts: &[DMatrix<f64>]) -> DMatrix<f64> {
    let width = parts.iter().map(DMatrix::ncols).sum();
    let mut out = DMatrix::zeros(parts[0].nrows(), width);
    let mut at = 0;
    for part in parts {
        out.columns_mut(at, part.ncols()).copy_from(part);
        at += part.ncols();
    }
    out
}
