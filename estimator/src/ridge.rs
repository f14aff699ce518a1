//! Linear least squares with a small penalty, from sums: the rows are never all in memory.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Penalty per row on the standardised coefficients. It keeps nearly collinear regressors finite
/// and biases by less than 1e-3.
const PENALTY: f64 = 1e-6;
/// Deviation per mean below which a regressor counts as constant. A variance from sums has an error
/// of some 1e-16 of the squared mean, so a constant seems to have a deviation of up to some 1e-8 of
/// its value.
const CONSTANT: f64 = 1e-6;
/// Rows that are multiplied at once.
const BLOCK: usize = 512;

/// Sums of products of rows `[regressors, targets]`.
#[derive(Debug, Clone)]
pub struct Sums {
    regressors: usize,
    targets: usize,
    rows: usize,
    /// Sum of `row * row'`.
    products: DMatrix<f64>,
    /// Sum of rows.
    sum: DVector<f64>,
    block: Vec<f64>,
}

impl Sums {
    /// Empty sums for rows of `regressors` and `targets` values.
    #[must_use]
    pub fn new(regressors: usize, targets: usize) -> Self {
        let width = regressors + targets;
        Self {
            regressors,
            targets,
            rows: 0,
            products: DMatrix::zeros(width, width),
            sum: DVector::zeros(width),
            block: Vec::with_capacity(BLOCK * width),
        }
    }

    /// Adds a row.
    ///
    /// # Panics
    ///
    /// If the lengths are not those of [`Sums::new`].
    pub fn push(&mut self, regressors: &[f64], targets: &[f64]) {
        assert!(regressors.len() == self.regressors && targets.len() == self.targets);
        self.block.extend_from_slice(regressors);
        self.block.extend_from_slice(targets);
        self.rows += 1;
        if self.block.len() >= BLOCK * (self.regressors + self.targets) {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let width = self.regressors + self.targets;
        let rows = self.block.len() / width;
        // Row-major rows are the columns of this matrix.
        let block = DMatrix::from_column_slice(width, rows, &self.block);
        self.products.gemm(1.0, &block, &block.transpose(), 1.0);
        self.sum += block.column_sum();
        self.block.clear();
    }

    /// Adds the rows of another.
    #[must_use]
    pub fn merge(mut self, mut other: Self) -> Self {
        self.flush();
        other.flush();
        self.products += other.products;
        self.sum += other.sum;
        self.rows += other.rows;
        self
    }

    /// The fit; `None` with fewer rows than regressors.
    #[must_use]
    pub fn solve(mut self) -> Option<Ridge> {
        self.flush();
        let (n, k) = (self.regressors, self.targets);
        if self.rows <= n {
            return None;
        }
        let rows = self.rows as f64;
        let mean = &self.sum / rows;
        let covariance = &self.products / rows - &mean * mean.transpose();
        let scale = DVector::from_fn(n, |i, _| {
            let sd = covariance[(i, i)].max(0.0).sqrt();
            // A constant regressor is the intercept's.
            if sd > f64::max(1e-9, CONSTANT * mean[i].abs()) {
                1.0 / sd
            } else {
                0.0
            }
        });
        let mut normal = DMatrix::from_fn(n, n, |i, j| covariance[(i, j)] * scale[i] * scale[j]);
        for i in 0..n {
            normal[(i, i)] += if scale[i] == 0.0 { 1.0 } else { PENALTY };
        }
        let right = DMatrix::from_fn(n, k, |i, j| covariance[(i, n + j)] * scale[i]);
        let solution = normal.cholesky()?.solve(&right);
        let mut weights = Vec::with_capacity(n * k);
        let mut intercept = Vec::with_capacity(k);
        for j in 0..k {
            let column: Vec<f64> = (0..n).map(|i| solution[(i, j)] * scale[i]).collect();
            intercept.push(
                mean[n + j]
                    - column
                        .iter()
                        .zip(mean.iter())
                        .map(|(w, m)| w * m)
                        .sum::<f64>(),
            );
            weights.extend(column);
        }
        Some(Ridge {
            weights,
            intercept,
            regressors: n,
        })
    }
}

/// A fitted linear map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ridge {
    /// Weights of the first target, then of the next.
    weights: Vec<f64>,
    intercept: Vec<f64>,
    regressors: usize,
}

impl Ridge {
    /// Value of a target for a row of regressors.
    #[must_use]
    pub fn value(&self, target: usize, row: &[f64]) -> f64 {
        let weights = self.weights(target);
        self.intercept[target] + weights.iter().zip(row).map(|(w, x)| w * x).sum::<f64>()
    }

    /// Weights of the regressors for a target.
    #[must_use]
    pub fn weights(&self, target: usize) -> &[f64] {
        &self.weights[target * self.regressors..(target + 1) * self.regressors]
    }

    /// Number of fitted numbers.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.weights.len() + self.intercept.len()
    }

    /// Number of regressors of a row.
    #[must_use]
    pub const fn regressors(&self) -> usize {
        self.regressors
    }

    /// Number of targets.
    #[must_use]
    pub fn targets(&self) -> usize {
        self.intercept.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_found_in_two_parts_with_a_constant_regressor() {
        let plane = |x: f64, y: f64| 3.0 - 2.0 * x + 0.5 * y;
        let mut parts = [Sums::new(3, 1), Sums::new(3, 1)];
        for n in 0..2_000 {
            let (x, y) = (
                (f64::from(n) * 0.37).sin(),
                (f64::from(n) * 0.11).cos() * 1e-3,
            );
            parts[n as usize % 2].push(&[x, 7.0, y], &[plane(x, y)]);
        }
        let [a, b] = parts;
        let ridge = a.merge(b).solve().unwrap();
        for (x, y) in [(0.3, 1e-3), (-1.0, -1e-3)] {
            let error = ridge.value(0, &[x, 7.0, y]) - plane(x, y);
            assert!(error.abs() < 1e-5, "{error}");
        }
        assert_eq!(ridge.parameters(), 4);
    }

    /// Sums of a constant leave a variance that is not quite zero. Taken for a spread, it
    /// correlates with anything.
    #[test]
    fn constants_are_told_from_their_rounding() {
        let constants = [0.743_145_3, 0.669_130_6, -0.497_260_9, 0.380_1, 17.3, 1e4];
        let mut sums = Sums::new(constants.len() + 1, 1);
        let mut row = [0.0; 7];
        row[1..].copy_from_slice(&constants);
        for n in 0..20_000 {
            row[0] = (f64::from(n) * 0.37).sin();
            sums.push(&row, &[2.0 - 3.0 * row[0]]);
        }
        let ridge = sums.solve().expect("more rows than regressors");
        for x in [-1.0, 0.3] {
            row[0] = x;
            let error = ridge.value(0, &row) - (2.0 - 3.0 * x);
            assert!(error.abs() < 1e-4, "{error}");
        }
        assert!(ridge.weights[1..].iter().all(|w| *w == 0.0), "{ridge:?}");
    }

    #[test]
    fn too_few_rows_are_no_fit() {
        let mut sums = Sums::new(3, 1);
        sums.push(&[1.0, 2.0, 3.0], &[1.0]);
        assert!(sums.solve().is_none());
    }
}
