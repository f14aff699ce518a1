//! The weights of a layer as plain numbers: what is stored, exported and run without a framework.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// A matrix of weights, row after row. A bias is a matrix of one row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Matrix {
    /// Number of rows: inputs of the product.
    pub rows: usize,
    /// Number of columns: outputs of the product.
    pub columns: usize,
    /// `rows * columns` values.
    pub values: Vec<f32>,
}

impl Matrix {
    /// A matrix of one value.
    #[must_use]
    pub fn filled(rows: usize, columns: usize, value: f32) -> Self {
        Self {
            rows,
            columns,
            values: vec![value; rows * columns],
        }
    }

    /// Uniform values within +-sqrt(6 / (rows + columns)) (Glorot and Bengio, 2010): the initial
    /// weights of Keras.
    #[must_use]
    pub fn glorot(rows: usize, columns: usize, random: &mut impl Rng) -> Self {
        let limit = (6.0 / (rows + columns) as f64).sqrt();
        let values = (0..rows * columns)
            .map(|_| (random.random_range(-limit..limit)) as f32)
            .collect();
        Self {
            rows,
            columns,
            values,
        }
    }

    /// A random orthogonal square matrix: the initial recurrent weights of a gate, which keep the
    /// length of the state.
    #[must_use]
    pub fn orthogonal(size: usize, random: &mut impl Rng) -> Self {
        let mut done: Vec<Vec<f64>> = Vec::with_capacity(size);
        while done.len() < size {
            // A sum of twelve uniform values is normal enough to have no preferred direction.
            let mut row: Vec<f64> = (0..size)
                .map(|_| (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>())
                .collect();
            // Twice: once leaves rounding errors of the earlier directions.
            for _ in 0..2 {
                for other in &done {
                    let along: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                    row.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
                }
            }
            let length = row.iter().map(|a| a * a).sum::<f64>().sqrt();
            if length > 1e-3 {
                row.iter_mut().for_each(|a| *a /= length);
                done.push(row);
            }
        }
        let values = done
            .into_iter()
            .flatten()
            .map(|value| value as f32)
            .collect();
        Self {
            rows: size,
            columns: size,
            values,
        }
    }

    /// The recurrent weights of a layer of gates: one orthogonal matrix each.
    pub(super) fn orthogonal_gates<const GATES: usize>(
        units: usize,
        random: &mut impl Rng,
    ) -> Self {
        Self::beside(&[(); GATES].map(|()| Self::orthogonal(units, random)))
    }

    /// Adds `input * self` to `sum`.
    ///
    /// Four rows at a time: the sums stay in registers four times as long.
    ///
    /// # Panics
    ///
    /// If the input has not `rows` values or the sum not `columns`.
    pub fn multiply_add(&self, input: &[f32], sum: &mut [f32]) {
        assert_eq!(
            input.len(),
            self.rows,
            "values into a matrix of {} rows",
            self.rows
        );
        assert_eq!(
            sum.len(),
            self.columns,
            "values out of a matrix of {} columns",
            self.columns
        );
        let mut inputs = input.chunks_exact(4);
        let mut rows = self.values.chunks_exact(4 * self.columns);
        for (input, rows) in inputs.by_ref().zip(rows.by_ref()) {
            let (first, rest) = rows.split_at(self.columns);
            let (second, rest) = rest.split_at(self.columns);
            let (third, fourth) = rest.split_at(self.columns);
            for ((((sum, a), b), c), d) in
                sum.iter_mut().zip(first).zip(second).zip(third).zip(fourth)
            {
                *sum += (input[0] * a + input[1] * b) + (input[2] * c + input[3] * d);
            }
        }
        for (&input, row) in inputs
            .remainder()
            .iter()
            .zip(rows.remainder().chunks_exact(self.columns))
        {
            sum.iter_mut()
                .zip(row)
                .for_each(|(sum, weight)| *sum += input * weight);
        }
    }

    /// The columns `from` to `from + count` as a matrix of their own.
    #[must_use]
    pub fn slice(&self, from: usize, count: usize) -> Self {
        let values = self
            .values
            .chunks_exact(self.columns)
            .flat_map(|row| row[from..from + count].iter().copied())
            .collect();
        Self {
            rows: self.rows,
            columns: count,
            values,
        }
    }

    /// The columns of each of so many gates.
    pub(super) fn gates(&self, count: usize) -> impl Iterator<Item = Self> + '_ {
        let units = self.columns / count;
        (0..count).map(move |gate| self.slice(gate * units, units))
    }

    /// Matrices of as many rows side by side.
    ///
    /// # Panics
    ///
    /// If there is none.
    #[must_use]
    pub fn beside(parts: &[Self]) -> Self {
        let rows = parts[0].rows;
        let columns = parts.iter().map(|part| part.columns).sum();
        let mut values = Vec::with_capacity(rows * columns);
        for row in 0..rows {
            for part in parts {
                values
                    .extend_from_slice(&part.values[row * part.columns..(row + 1) * part.columns]);
            }
        }
        Self {
            rows,
            columns,
            values,
        }
    }

    /// Rows and columns exchanged.
    #[must_use]
    pub fn transposed(&self) -> Self {
        let mut values = Vec::with_capacity(self.values.len());
        for column in 0..self.columns {
            values.extend(self.values.iter().skip(column).step_by(self.columns));
        }
        Self {
            rows: self.columns,
            columns: self.rows,
            values,
        }
    }
}

/// The logistic function.
pub(super) fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Every count of rows, also those that four does not divide, gives the sum that the definition
    /// gives.
    #[test]
    fn a_product_is_the_sum_of_its_rows() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for rows in 1..10 {
            let matrix = Matrix::glorot(rows, 5, &mut random);
            let input: Vec<f32> = (0..rows).map(|row| row as f32 - 2.0).collect();
            let mut sum = vec![0.5; 5];
            matrix.multiply_add(&input, &mut sum);
            for (column, sum) in sum.iter().enumerate() {
                let expected: f32 = (0..rows)
                    .map(|row| input[row] * matrix.values[row * 5 + column])
                    .sum();
                assert!(
                    (sum - 0.5 - expected).abs() < 1e-5,
                    "{rows} rows, column {column}: {sum} of {expected}"
                );
            }
        }
    }

    #[test]
    fn the_rows_of_an_orthogonal_matrix_are_of_length_one_and_at_right_angles() {
        let matrix = Matrix::orthogonal(20, &mut ChaCha8Rng::seed_from_u64(2));
        for a in 0..20 {
            for b in 0..20 {
                let product: f32 = (0..20)
                    .map(|k| matrix.values[a * 20 + k] * matrix.values[b * 20 + k])
                    .sum();
                let expected = f32::from(u8::from(a == b));
                assert!(
                    (product - expected).abs() < 1e-5,
                    "rows {a} and {b}: {product}"
                );
            }
        }
    }

    #[test]
    fn slices_side_by_side_give_the_whole() {
        let whole = Matrix::glorot(3, 7, &mut ChaCha8Rng::seed_from_u64(3));
        assert_eq!(
            Matrix::beside(&[whole.slice(0, 2), whole.slice(2, 5)]),
            whole
        );
        assert_eq!(whole.transposed().transposed(), whole);
        assert_eq!(whole.transposed().values[1], whole.values[7]);
    }
}
