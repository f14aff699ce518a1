//! Terms with a coefficient for each sequence, taken out of everything else (Frisch and Waugh
//! 1933): what is left of a column cannot be explained by them, whatever their coefficients.

use residual_columns::linalg::{dot, Cholesky};
use residual_fit::problem::{Column, Problem};
use std::ops::Range;
use std::sync::Arc;

/// Relative pivot below which a column repeats others in a sequence.
const RANK_TOL: f64 = 1e-9;

/// One sequence: its rows, and the factors of the terms' products.
struct Part {
    rows: Range<usize>,
    factors: Cholesky,
}

/// Takes terms with a coefficient for each sequence out of columns.
pub struct Projector {
    columns: Vec<Column>,
    parts: Vec<Part>,
}

impl Projector {
    /// For these terms; `None` if there are none.
    pub fn new(p: &Problem, columns: Vec<Column>) -> Option<Projector> {
        if columns.is_empty() {
            return None;
        }
        let q = columns.len();
        let mut parts: Vec<Part> = Vec::new();
        for rows in p.rows_of_runs() {
            let mut g = vec![0.0; q * q];
            for i in 0..q {
                for j in 0..q {
                    g[i * q + j] = dot(&columns[i][rows.clone()], &columns[j][rows.clone()]);
                }
            }
            parts.push(Part {
                rows,
                factors: Cholesky::new(&g, q, RANK_TOL),
            });
        }
        Some(Projector { columns, parts })
    }

    /// Takes the terms out of values on the kept rows.
    pub fn take_out(&self, values: &mut [f64]) {
        for part in &self.parts {
            let own = part.rows.clone();
            let b: Vec<f64> = self
                .columns
                .iter()
                .map(|c| dot(&c[own.clone()], &values[own.clone()]))
                .collect();
            for (c, k) in self.columns.iter().zip(part.factors.solve(&b)) {
                values[own.clone()]
                    .iter_mut()
                    .zip(&c[own.clone()])
                    .for_each(|(v, c)| *v -= k * c);
            }
        }
    }

    /// A column without what the terms explain of it.
    pub fn rest(&self, column: &Column) -> Column {
        let mut values = column.to_vec();
        let before = dot(&values, &values);
        self.take_out(&mut values);
        // Rounding is no column.
        if dot(&values, &values) < 1e-18 * before {
            values.fill(0.0);
        }
        Arc::new(values)
    }
}
