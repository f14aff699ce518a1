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
    /// Weight of the intercept: number of rows, less where a part of them has its own.
    weight: f64,
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
            weight: 0.0,
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
        self.weight += 1.0;
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
    pub fn merge(&mut self, mut other: Self) {
        self.flush();
        other.flush();
        self.products += other.products;
        self.sum += other.sum;
        self.rows += other.rows;
        self.weight += other.weight;
    }

    /// Number of regressors of a row.
    #[must_use]
    pub const fn regressors(&self) -> usize {
        self.regressors
    }

    /// Number of rows.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// Sums of the first `keep` regressors and the targets, where the other regressors have
    /// coefficients of their own in these rows. `usual`: inverse of the covariance of the
    /// coefficients before anything is known, per noise of a row. `None`: it is not positive.
    #[must_use]
    pub fn without_own(&mut self, keep: usize, usual: &DMatrix<f64>) -> Option<Self> {
        self.flush();
        let own = self.regressors - keep;
        let width = keep + self.targets;
        let place = |i: usize| if i < keep { i } else { i + own };
        let known = (self.products.view((keep, keep), (own, own)) + usual).cholesky()?;
        let across = DMatrix::from_fn(own, width, |i, j| self.products[(keep + i, place(j))]);
        let sum = self.sum.rows(keep, own).into_owned();
        let (by_across, by_sum) = (known.solve(&across), known.solve(&sum));
        Some(Self {
            regressors: keep,
            targets: self.targets,
            rows: self.rows,
            weight: self.weight - sum.dot(&by_sum),
            products: DMatrix::from_fn(width, width, |i, j| self.products[(place(i), place(j))])
                - across.tr_mul(&by_across),
            sum: DVector::from_fn(width, |i, _| self.sum[place(i)]) - across.tr_mul(&by_sum),
            block: Vec::new(),
        })
    }

    /// Makes regressors 0 in all rows: a fit gives them no weight.
    pub fn forget(&mut self, regressors: core::ops::Range<usize>) {
        self.flush();
        for i in regressors {
            self.products.fill_row(i, 0.0);
            self.products.fill_column(i, 0.0);
            self.sum[i] = 0.0;
        }
    }

    /// Sum of squares that a map leaves of the only target.
    #[must_use]
    pub fn left(&mut self, map: &Ridge) -> f64 {
        self.flush();
        let weights = map.weights(0);
        let left = DVector::from_fn(self.regressors + 1, |i, _| {
            weights.get(i).map_or(1.0, |weight| -weight)
        });
        let intercept = map.intercept[0];
        let with_left = &self.products * &left - &self.sum * intercept;
        left.dot(&with_left) - intercept * (self.sum.dot(&left) - intercept * self.weight)
    }

    /// Takes values times the regressors from `from` on out of the only target.
    pub fn take_out(&mut self, from: usize, values: &[f64]) {
        self.flush();
        let target = self.regressors;
        for (k, value) in values.iter().enumerate() {
            let of_regressor = self.products.column(from + k).into_owned();
            let mut column = self.products.column_mut(target);
            column -= &of_regressor * *value;
            self.sum[target] -= value * self.sum[from + k];
        }
        for (k, value) in values.iter().enumerate() {
            self.products[(target, target)] -= value * self.products[(from + k, target)];
        }
        for i in 0..target {
            self.products[(target, i)] = self.products[(i, target)];
        }
    }

    /// Coefficients that these rows have for themselves where `common` holds for the first
    /// regressors and the only target, their covariance per noise of a row, and the sum of squares
    /// that is left. `None` as in [`Self::without_own`].
    #[must_use]
    pub fn own(
        &mut self,
        common: &Ridge,
        usual: &DMatrix<f64>,
    ) -> Option<(DVector<f64>, DMatrix<f64>, f64)> {
        self.flush();
        let keep = common.regressors;
        let (own, last) = (self.regressors - keep, self.regressors);
        let covariance = (self.products.view((keep, keep), (own, own)) + usual)
            .cholesky()?
            .inverse();
        // What the common ones leave of the target: products with it.
        let mut left = DVector::zeros(last + 1);
        for (i, weight) in common.weights(0).iter().enumerate() {
            left[i] = -weight;
        }
        left[last] = 1.0;
        let intercept = common.intercept[0];
        let with_left = &self.products * &left - &self.sum * intercept;
        let own_values = &covariance * with_left.rows(keep, own);
        let square =
            left.dot(&with_left) - intercept * (self.sum.dot(&left) - intercept * self.weight);
        let of_own = self.products.view((keep, keep), (own, own)) * &own_values;
        let square =
            square - 2.0 * own_values.dot(&with_left.rows(keep, own)) + own_values.dot(&of_own);
        Some((own_values, covariance, square.max(0.0)))
    }

    /// The fit; `None` with fewer rows than regressors.
    #[must_use]
    pub fn solve(mut self) -> Option<Ridge> {
        self.flush();
        let (n, k) = (self.regressors, self.targets);
        if self.rows <= n {
            return None;
        }
        let rows = self.weight;
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
    /// A map to zero.
    #[must_use]
    pub fn zero(regressors: usize) -> Self {
        Self {
            weights: vec![0.0; regressors],
            intercept: vec![0.0],
            regressors,
        }
    }

    /// The same map on rows of more regressors, with the place of each of its own there.
    #[must_use]
    pub fn placed(&self, places: &[usize], regressors: usize) -> Self {
        let mut out = Self::zero(regressors);
        for (place, weight) in places.iter().zip(self.weights(0)) {
            out.weights[*place] = *weight;
        }
        out.intercept[0] = self.intercept[0];
        out
    }

    /// The sum of both maps, which have the same regressors and targets.
    #[must_use]
    pub fn plus(mut self, other: &Self) -> Self {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
        add(&mut self.weights, &other.weights);
        add(&mut self.intercept, &other.intercept);
        self
    }

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

    /// Whether it is whole and has so many targets: one that was read may be neither.
    #[must_use]
    pub fn fits(&self, targets: usize) -> bool {
        self.targets() == targets && self.weights.len() == targets * self.regressors
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
        let [mut a, b] = parts;
        a.merge(b);
        let ridge = a.solve().unwrap();
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

    /// Two groups of rows with a slope in common and offsets of their own.
    fn groups(offsets: [f64; 2]) -> [Sums; 2] {
        let mut n = 0.0_f64;
        offsets.map(|offset| {
            let mut sums = Sums::new(2, 1);
            for _ in 0..400 {
                n += 1.0;
                // The groups have other means of `x`: what they have for themselves leans on it.
                let x = (n * 0.37).sin() + offset;
                sums.push(&[x, 1.0], &[3.0 + 2.0 * x + offset]);
            }
            sums
        })
    }

    #[test]
    fn what_groups_have_for_themselves_does_not_go_into_what_they_share() {
        let offsets = [0.4, -0.4];
        let usual = DMatrix::from_element(1, 1, 0.01);
        let [mut a, mut b] = groups(offsets);
        let parts = [&mut a, &mut b].map(|sums| sums.without_own(1, &usual).unwrap());
        let [mut first, second] = parts;
        first.merge(second);
        let common = first.solve().unwrap();
        assert!((common.weights(0)[0] - 2.0).abs() < 1e-3, "{common:?}");
        for (sums, offset) in [&mut a, &mut b].into_iter().zip(offsets) {
            let (own, covariance, left) = sums.own(&common, &usual).unwrap();
            assert!((own[0] - offset).abs() < 1e-2, "{own}");
            assert!((covariance[(0, 0)] - 1.0 / 400.01).abs() < 1e-9);
            assert!((0.0..0.05).contains(&left), "{left}");
        }
        // All rows together take the offsets for a slope.
        let [mut a, mut b] = groups(offsets);
        let never = DMatrix::from_element(1, 1, 1e12);
        let mut plain = a.without_own(1, &never).unwrap();
        plain.merge(b.without_own(1, &never).unwrap());
        assert!(plain.solve().unwrap().weights(0)[0] > 2.1);
        // What is taken out of the target is left to nobody.
        a.take_out(1, &[0.4]);
        let (own, ..) = a.own(&common, &usual).unwrap();
        assert!(own[0].abs() < 1e-2, "{own}");
    }

    #[test]
    fn regressors_that_are_forgotten_have_no_weight_and_what_is_left_is_told() {
        let rows = (0..1_000).map(|n| {
            let (x, y) = ((f64::from(n) * 0.37).sin(), (f64::from(n) * 0.11).cos());
            (x, y, 1.0 + 2.0 * x - 3.0 * y)
        });
        let (mut both, mut alone) = (Sums::new(2, 1), Sums::new(1, 1));
        for (x, y, target) in rows.clone() {
            both.push(&[x, y], &[target]);
            alone.push(&[x], &[target]);
        }
        let (mut forgotten, mut kept) = (both.clone(), both.clone());
        forgotten.forget(1..2);
        let [without, alone] = [forgotten, alone].map(|sums| sums.solve().unwrap());
        assert_eq!(without.weights(0)[1], 0.0);
        assert!((without.weights(0)[0] - alone.weights(0)[0]).abs() < 1e-9);
        for map in [without, both.solve().unwrap()] {
            let squares = rows
                .clone()
                .map(|(x, y, target)| (target - map.value(0, &[x, y])).powi(2));
            let (left, squares) = (kept.left(&map), squares.sum::<f64>());
            assert!((left - squares).abs() < 1e-6, "{left} {squares}");
        }
    }

    #[test]
    fn a_map_has_the_same_values_among_more_regressors() {
        let small = Ridge {
            weights: vec![2.0, -1.0],
            intercept: vec![0.5],
            regressors: 2,
        };
        let large = small.placed(&[3, 1], 4).plus(&Ridge::zero(4));
        let row = [9.0, 4.0, 9.0, 7.0];
        assert_eq!(large.value(0, &row), small.value(0, &[7.0, 4.0]));
        assert_eq!(large.clone().plus(&large).value(0, &row), 21.0);
    }

    #[test]
    fn too_few_rows_are_no_fit() {
        let mut sums = Sums::new(3, 1);
        sums.push(&[1.0, 2.0, 3.0], &[1.0]);
        assert!(sums.solve().is_none());
    }
}
