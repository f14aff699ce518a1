//! The gated recurrent unit: layers of units whose state is kept or replaced row by row, then a
//! dense layer.
//!
//! The form of Keras (`reset_after`), of cuDNN and of ONNX (`linear_before_reset`), with `z`
//! update, `r` reset, `n` candidate:
//!
//! ```text
//! z = sigmoid(x Wz + h Uz + bz + cz)     r = sigmoid(x Wr + h Ur + br + cr)
//! n = tanh(x Wn + bn + r * (h Un + cn))  h' = z * h + (1 - z) * n
//! ```
//!
//! The thesis (4.2) has two layers of 100 units and a dense layer of 100, over windows of 50 rows,
//! and 182,531 parameters (table 4.1). All numbers of such a network but the output's are multiples
//! of 100, so the count ends in the number of outputs: 31. With 1 or 3 outputs no input width gives
//! that count, with or without `reset_after` or batch normalisation.

use burn::tensor::{
    activation::{sigmoid, tanh},
    Tensor,
};
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::matrix::{logistic, Matrix};

/// A layer of gated recurrent units. Columns of each matrix: update, reset, candidate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gru {
    /// Inputs times three times the units.
    pub input: Matrix,
    /// Units times three times the units.
    pub recurrent: Matrix,
    /// Offsets of the inputs' sums: one row.
    pub bias: Matrix,
    /// Offsets of the states' sums: one row.
    pub recurrent_bias: Matrix,
}

impl Gru {
    /// Initial weights.
    pub(super) fn new(inputs: usize, units: usize, random: &mut impl Rng) -> Self {
        // Drawn before the inputs' weights, or the same seed would give other networks.
        let recurrent = Matrix::orthogonal_gates::<3>(units, random);
        Self {
            input: Matrix::glorot(inputs, 3 * units, random),
            recurrent,
            bias: Matrix::filled(1, 3 * units, 0.0),
            recurrent_bias: Matrix::filled(1, 3 * units, 0.0),
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
        let [input_z, input_r, input_n, state_z, state_r, state_n, ..] = weights else {
            unreachable!("twelve parts")
        };
        let [offset_z, offset_r, offset_n, from_z, from_r, from_n] = &weights[6..] else {
            unreachable!("twelve parts")
        };
        let offset_z = offset_z.clone() + from_z.clone();
        let offset_r = offset_r.clone() + from_r.clone();
        let product = |input: &Tensor<2>, weight: &Tensor<2>| input.clone().matmul(weight.clone());
        let mut states = Vec::with_capacity(frames.len());
        for frame in frames {
            let update =
                sigmoid(product(&frame, input_z) + product(&state, state_z) + offset_z.clone());
            let reset =
                sigmoid(product(&frame, input_r) + product(&state, state_r) + offset_r.clone());
            let past = product(&state, state_n) + from_n.clone();
            let candidate = tanh(product(&frame, input_n) + offset_n.clone() + reset * past);
            state = candidate.clone() + update * (state - candidate);
            states.push(state.clone());
        }
        states
    }

    /// The parts of the matrices gate by gate, as training holds them: a slice of a product costs a
    /// copy on the way back.
    pub(super) fn parts(&self) -> Vec<Matrix> {
        [
            &self.input,
            &self.recurrent,
            &self.bias,
            &self.recurrent_bias,
        ]
        .into_iter()
        .flat_map(|matrix| matrix.gates(3))
        .collect()
    }

    /// The layer of these parts.
    pub(super) fn of_parts(parts: &[Matrix]) -> Self {
        let whole = |at: usize| Matrix::beside(&parts[at..at + 3]);
        Self {
            input: whole(0),
            recurrent: whole(3),
            bias: whole(6),
            recurrent_bias: whole(9),
        }
    }

    /// The layer on one row: changes the state. `scratch` holds six times the units or more.
    pub(super) fn step(&self, input: &[f32], state: &mut [f32], scratch: &mut [f32]) {
        let units = self.units();
        let (sum, rest) = scratch.split_at_mut(3 * units);
        let past = &mut rest[..3 * units];
        sum.copy_from_slice(&self.bias.values);
        past.copy_from_slice(&self.recurrent_bias.values);
        self.input.multiply_add(input, sum);
        self.recurrent.multiply_add(state, past);
        for unit in 0..units {
            let update = logistic(sum[unit] + past[unit]);
            let reset = logistic(sum[units + unit] + past[units + unit]);
            let candidate = (sum[2 * units + unit] + reset * past[2 * units + unit]).tanh();
            state[unit] = candidate + update * (state[unit] - candidate);
        }
    }
}
