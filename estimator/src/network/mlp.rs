//! The multi-layer perceptron: the current row alone, through dense layers with ReLU.
//!
//! The thesis (4.2) has hidden layers of 1200, 1000, 800, 600 and 400 units with 20 % dropout and
//! 2,777,203 parameters (table 4.1). That is the count of Keras for 30 inputs, 3 outputs and a
//! batch normalisation after each hidden layer, whose 4 numbers a unit (two trained, two running
//! statistics) are 16,000. Without it no width fits. So this model has it.

use burn::tensor::{activation::relu, module::batch_norm_train, Tensor};
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::matrix::Matrix;

/// Added to a variance before its root is taken: the value of Keras.
pub(super) const EPSILON: f64 = 1e-3;

/// A dense layer: `input * weight + bias`, then ReLU where it says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Dense {
    /// Inputs times outputs.
    pub weight: Matrix,
    /// One row.
    pub bias: Matrix,
    /// Whether negative outputs are zero.
    pub relu: bool,
}

/// Batch normalisation over units, then ReLU.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchNorm {
    /// Scale, trained: one row, as all below.
    pub gamma: Matrix,
    /// Offset, trained.
    pub beta: Matrix,
    /// Mean over training rows; see the module `normal`.
    pub mean: Matrix,
    /// Variance over training rows.
    pub variance: Matrix,
}

impl Dense {
    /// Initial weights; no offset.
    pub(super) fn new(inputs: usize, outputs: usize, relu: bool, random: &mut impl Rng) -> Self {
        Self {
            weight: Matrix::glorot(inputs, outputs, random),
            bias: Matrix::filled(1, outputs, 0.0),
            relu,
        }
    }

    /// The layer on a batch: `[batch, inputs]` to `[batch, outputs]`.
    pub(super) fn forward(&self, weights: &[Tensor<2>], input: Tensor<2>) -> Tensor<2> {
        let sum = input.matmul(weights[0].clone()) + weights[1].clone();
        if self.relu {
            relu(sum)
        } else {
            sum
        }
    }

    /// The layer on one row.
    pub(super) fn step(&self, input: &[f32], output: &mut [f32]) {
        output.copy_from_slice(&self.bias.values);
        self.weight.multiply_add(input, output);
        if self.relu {
            output.iter_mut().for_each(|value| *value = value.max(0.0));
        }
    }
}

impl BatchNorm {
    pub(super) fn new(units: usize) -> Self {
        let row = |value| Matrix::filled(1, units, value);
        Self {
            gamma: row(1.0),
            beta: row(0.0),
            mean: row(0.0),
            variance: row(1.0),
        }
    }

    /// The layer on a batch in training: normalised by the statistics of the batch.
    pub(super) fn train(weights: &[Tensor<2>], input: Tensor<2>) -> Tensor<2> {
        let row = |tensor: &Tensor<2>| tensor.clone().squeeze_dim::<1>(0);
        relu(batch_norm_train(input, row(&weights[0]), row(&weights[1]), EPSILON).output)
    }

    /// The dense layer before it with this normalisation inside: the same outputs with one layer
    /// less.
    pub(super) fn fold(&self, dense: &Dense) -> Dense {
        let scale: Vec<f32> = (self.gamma.values.iter().zip(&self.variance.values))
            .map(|(gamma, variance)| {
                (f64::from(*gamma) / (f64::from(*variance) + EPSILON).sqrt()) as f32
            })
            .collect();
        let mut weight = dense.weight.clone();
        for row in weight.values.chunks_exact_mut(weight.columns) {
            row.iter_mut()
                .zip(&scale)
                .for_each(|(weight, scale)| *weight *= scale);
        }
        let mut bias = dense.bias.clone();
        for (unit, bias) in bias.values.iter_mut().enumerate() {
            *bias = (*bias - self.mean.values[unit]) * scale[unit] + self.beta.values[unit];
        }
        Dense {
            weight,
            bias,
            relu: true,
        }
    }
}
