//! The long short-term memory: layers of units with a state and a cell, then a dense layer.
//!
//! The form of Keras, with `i` input, `f` forget, `c` candidate, `o` output:
//!
//! ```text
//! i, f, o = sigmoid(x W + h U + b)   c = tanh(x Wc + h Uc + bc)
//! cell' = f * cell + i * c           h' = o * tanh(cell')
//! ```
//!
//! The thesis (4.2) has two layers of 100 units and a dense layer of 100, over windows of 50 rows,
//! and 236,803 parameters (table 4.1). With 3 outputs that is the count for 264 inputs, and no
//! other structure found is as near to its text; the perceptron's count fits 30 inputs. So the
//! three counts of the table are not of one set of inputs.

use burn::tensor::{
    activation::{sigmoid, tanh},
    Tensor,
};
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::matrix::{logistic, Matrix};

/// A layer of long short-term memory. Columns of each matrix: input, forget, candidate, output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lstm {
    /// Inputs times four times the units.
    pub input: Matrix,
    /// Units times four times the units.
    pub recurrent: Matrix,
    /// One row.
    pub bias: Matrix,
}

impl Lstm {
    /// Initial weights.
    pub(super) fn new(inputs: usize, units: usize, random: &mut impl Rng) -> Self {
        // Drawn before the inputs' weights, or the same seed would give other networks.
        let recurrent = Matrix::orthogonal_gates::<4>(units, random);
        let mut bias = Matrix::filled(1, 4 * units, 0.0);
        // A cell that remembers at first learns long effects sooner (Keras: `unit_forget_bias`).
        bias.values[units..2 * units].fill(1.0);
        Self {
            input: Matrix::glorot(inputs, 4 * units, random),
            recurrent,
            bias,
        }
    }

    /// Number of units.
    pub(super) const fn units(&self) -> usize {
        self.recurrent.rows
    }

    /// The layer on a batch, one frame `[batch, inputs]` a row. Returns the state after each.
    ///
    /// `weights`: [`Layer::parts`](super::layer::Layer::parts) on the device.
    pub(super) fn forward(
        weights: &[Tensor<2>],
        frames: Vec<Tensor<2>>,
        mut state: Tensor<2>,
    ) -> Vec<Tensor<2>> {
        let mut cell = state.zeros_like();
        let mut states = Vec::with_capacity(frames.len());
        for frame in frames {
            let gate = |at: usize| {
                frame.clone().matmul(weights[at].clone())
                    + state.clone().matmul(weights[4 + at].clone())
                    + weights[8 + at].clone()
            };
            cell = sigmoid(gate(1)) * cell + sigmoid(gate(0)) * tanh(gate(2));
            state = sigmoid(gate(3)) * tanh(cell.clone());
            states.push(state.clone());
        }
        states
    }

    /// The parts of the matrices gate by gate, as training holds them.
    pub(super) fn parts(&self) -> Vec<Matrix> {
        [&self.input, &self.recurrent, &self.bias]
            .into_iter()
            .flat_map(|matrix| matrix.gates(4))
            .collect()
    }

    /// The layer of these parts.
    pub(super) fn of_parts(parts: &[Matrix]) -> Self {
        let whole = |at: usize| Matrix::beside(&parts[at..at + 4]);
        Self {
            input: whole(0),
            recurrent: whole(4),
            bias: whole(8),
        }
    }

    /// The layer on one row: changes the state, which is followed by the cell. `scratch` holds four
    /// times the units or more.
    pub(super) fn step(&self, input: &[f32], memory: &mut [f32], scratch: &mut [f32]) {
        let units = self.units();
        let (state, cell) = memory.split_at_mut(units);
        let sum = &mut scratch[..4 * units];
        sum.copy_from_slice(&self.bias.values);
        self.input.multiply_add(input, sum);
        self.recurrent.multiply_add(state, sum);
        for unit in 0..units {
            let gate = |at: usize| sum[at * units + unit];
            cell[unit] = logistic(gate(1)) * cell[unit] + logistic(gate(0)) * gate(2).tanh();
            state[unit] = logistic(gate(3)) * cell[unit].tanh();
        }
    }
}
