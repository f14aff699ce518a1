//! Sums of products of regressors and truth. They add and subtract, so that every split is fitted
//! and scored without reading rows again.

use nalgebra::{DMatrix, DVector};
use std::ops::{AddAssign, Range, SubAssign};

/// Rows that are multiplied at once.
const BLOCK: usize = 256;

/// Sums over rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Sums {
    /// Number of rows.
    pub rows: f64,
    /// Regressors times regressors.
    products: DMatrix<f64>,
    /// Regressors times truth.
    right: DVector<f64>,
    /// Truth times truth.
    square: f64,
}

impl Sums {
    /// Empty sums of so many regressors.
    #[must_use]
    pub fn new(width: usize) -> Self {
        Self {
            rows: 0.0,
            products: DMatrix::zeros(width, width),
            right: DVector::zeros(width),
            square: 0.0,
        }
    }

    /// Sums over rows of regressors, row after row, and their truth.
    #[must_use]
    pub fn of(width: usize, regressors: &[f64], truth: &[f64]) -> Self {
        let mut out = Self::new(width);
        for (block, truth) in regressors.chunks(BLOCK * width).zip(truth.chunks(BLOCK)) {
            // Rows one after another are the columns of this matrix.
            let block = DMatrix::from_column_slice(width, truth.len(), block);
            let truth = DVector::from_column_slice(truth);
            out.products.gemm(1.0, &block, &block.transpose(), 1.0);
            out.right.gemv(1.0, &block, &truth, 1.0);
            out.square += truth.norm_squared();
            out.rows += truth.len() as f64;
        }
        out
    }

    /// Number of regressors.
    #[must_use]
    pub fn width(&self) -> usize {
        self.right.len()
    }

    /// The same rows without some regressors.
    #[must_use]
    pub fn without(&self, columns: Range<usize>) -> Self {
        let kept: Vec<usize> = (0..self.width()).filter(|c| !columns.contains(c)).collect();
        Self {
            rows: self.rows,
            products: DMatrix::from_fn(kept.len(), kept.len(), |i, j| {
                self.products[(kept[i], kept[j])]
            }),
            right: DVector::from_fn(kept.len(), |i, _| self.right[kept[i]]),
            square: self.square,
        }
    }

    /// Sum of squared errors of these weights over the rows.
    #[must_use]
    pub fn squared_error(&self, weights: &DVector<f64>) -> f64 {
        let explained = weights.dot(&(&self.products * weights));
        (self.square - 2.0 * weights.dot(&self.right) + explained).max(0.0)
    }

    /// Weights of least squares with a penalty on the weights of regressors that are scaled to mean
    /// square 1, per row. `None` without rows.
    #[must_use]
    pub fn ridge(&self, penalty: f64) -> Option<DVector<f64>> {
        let width = self.width();
        // A regressor that is zero in all rows gets the weight 0.
        let scale = DVector::from_fn(width, |i, _| {
            let square = self.products[(i, i)] / self.rows;
            if square > 0.0 {
                square.sqrt().recip()
            } else {
                0.0
            }
        });
        let normal = DMatrix::from_fn(width, width, |i, j| {
            let product = self.products[(i, j)] * scale[i] * scale[j] / self.rows;
            product + if i == j { penalty.max(1e-12) } else { 0.0 }
        });
        let right = self.right.component_mul(&scale) / self.rows;
        Some(normal.cholesky()?.solve(&right).component_mul(&scale))
    }

    /// Weights with a normal prior: mean 0, the standard deviations of the regressors' weights
    /// times the regressors are 1, and each row counts `information` (the reciprocal of a
    /// variance).
    #[must_use]
    pub fn posterior(&self, information: f64) -> Option<DVector<f64>> {
        let width = self.width();
        let normal = &self.products * information + DMatrix::identity(width, width);
        Some(normal.cholesky()?.solve(&(&self.right * information)))
    }
}

impl AddAssign<&Self> for Sums {
    fn add_assign(&mut self, other: &Self) {
        self.rows += other.rows;
        self.products += &other.products;
        self.right += &other.right;
        self.square += other.square;
    }
}

impl SubAssign<&Self> for Sums {
    fn sub_assign(&mut self, other: &Self) {
        self.rows -= other.rows;
        self.products -= &other.products;
        self.right -= &other.right;
        self.square -= other.square;
    }
}

/// Sum of those with these numbers.
#[must_use]
pub fn total<'a>(width: usize, parts: impl Iterator<Item = &'a Sums>) -> Sums {
    parts.fold(Sums::new(width), |mut sum, part| {
        sum += part;
        sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of `[x, 1, 0]` with the truth 2 x - 1 and an error of alternating sign.
    fn rows(from: i32, to: i32, error: f64) -> Sums {
        let (mut regressors, mut truth) = (Vec::new(), Vec::new());
        for n in from..to {
            let x = f64::from(n) * 0.01;
            regressors.extend([x, 1.0, 0.0]);
            truth.push(2.0 * x - 1.0 + if n % 2 == 0 { error } else { -error });
        }
        Sums::of(3, &regressors, &truth)
    }

    #[test]
    fn a_line_is_found_in_parts_and_its_error_needs_no_rows() {
        let parts = [rows(0, 700, 0.5), rows(700, 1000, 0.5)];
        let mut sum = total(3, parts.iter());
        let weights = sum.ridge(1e-9).unwrap();
        assert!(
            (weights[0] - 2.0).abs() < 1e-3 && (weights[1] + 1.0).abs() < 1e-2,
            "{weights}"
        );
        assert_eq!(weights[2], 0.0);
        let rmse = (sum.squared_error(&weights) / sum.rows).sqrt();
        assert!((rmse - 0.5).abs() < 1e-3, "{rmse}");
        sum -= &parts[1];
        assert!((sum.squared_error(&weights) - parts[0].squared_error(&weights)).abs() < 1e-6);
    }

    #[test]
    fn without_its_slope_a_line_is_its_mean() {
        let sums = rows(0, 1000, 0.0).without(0..1);
        let weights = sums.ridge(0.0).unwrap();
        assert_eq!(weights.len(), 2);
        assert!((weights[0] - 8.99).abs() < 1e-6, "{weights}");
    }

    #[test]
    fn a_prior_holds_the_weights_where_rows_say_little() {
        let sums = rows(0, 100, 0.0);
        let (weak, strong) = (sums.posterior(1e-6).unwrap(), sums.posterior(1e6).unwrap());
        assert!(weak[0].abs() < 1e-3, "{weak}");
        assert!((strong[0] - 2.0).abs() < 1e-4, "{strong}");
    }
}
