//! A small causal convolution: layers that each join a few neighbours in time, then a dense layer.
//!
//! Each layer joins `k` neighbouring results of the layer below, so `n` layers see `k` to the power
//! `n` rows. That is a causal convolution of kernel `k` and dilation 1, k, k^2, ..., computed for
//! the newest row alone: of the dilated form only these results enter the last row.

use burn::tensor::{activation::relu, Tensor};
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::{matrix::Matrix, Config};

/// A layer that joins groups of neighbours in time, oldest first, then ReLU.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Convolution {
    /// Kernel times inputs, times channels.
    pub weight: Matrix,
    /// One row.
    pub bias: Matrix,
    /// Number of neighbours.
    pub kernel: usize,
}

/// Kernel of the layers: the window is its power.
///
/// # Errors
///
/// If there is none.
pub(super) fn kernel(config: &Config) -> Result<usize, String> {
    let layers = config.layers.len().saturating_sub(1) as u32;
    (2..=config.window).find(|kernel: &usize| kernel.checked_pow(layers) == Some(config.window)).ok_or_else(|| {
        format!(
            "a convolution of {layers} layers and a dense one has no window of {} rows: a window is a whole number to the \
             power {layers}, such as {}",
            config.window,
            4usize.pow(layers.min(8)),
        )
    })
}

impl Convolution {
    /// Initial weights; no offset.
    pub(super) fn new(
        kernel: usize,
        inputs: usize,
        channels: usize,
        random: &mut impl Rng,
    ) -> Self {
        Self {
            weight: Matrix::glorot(kernel * inputs, channels, random),
            bias: Matrix::filled(1, channels, 0.0),
            kernel,
        }
    }

    /// The layer on a batch of windows, row after row: `[batch, rows * inputs]` to
    /// `[batch, rows / kernel * channels]`.
    pub(super) fn forward(&self, weights: &[Tensor<2>], input: Tensor<2>) -> Tensor<2> {
        let [batch, width] = input.dims();
        let groups = width / self.weight.rows;
        let joined = input
            .reshape([batch * groups, self.weight.rows])
            .matmul(weights[0].clone())
            + weights[1].clone();
        relu(joined).reshape([batch, groups * self.weight.columns])
    }

    /// The layer on one window.
    pub(super) fn step(&self, input: &[f32], output: &mut [f32]) {
        for (group, output) in input
            .chunks_exact(self.weight.rows)
            .zip(output.chunks_exact_mut(self.weight.columns))
        {
            output.copy_from_slice(&self.bias.values);
            self.weight.multiply_add(group, output);
            output.iter_mut().for_each(|value| *value = value.max(0.0));
        }
    }
}
