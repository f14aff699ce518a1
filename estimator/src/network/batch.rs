//! Rows and weights as tensors, and predictions of whole sequences in batches.

use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{
    data::{At, Rows},
    layer::{folded, forward, Dropout, Run},
    matrix::Matrix,
    Config, Kind, Network,
};
use crate::sequence::Sequence;

/// Rows of a batch of predictions.
const PREDICTION_BATCH: usize = 1024;

/// The windows that end at these rows, as [`forward`] takes them.
pub(super) fn frames(
    rows: &Rows,
    config: &Config,
    inputs: usize,
    ends: &[At],
    device: &Device,
) -> Vec<Tensor<2>> {
    if config.kind == Kind::Convolution {
        let mut windows = Vec::with_capacity(ends.len() * config.window * inputs);
        rows.windows(ends, config.window, &mut windows);
        return vec![values(windows, ends.len(), device)];
    }
    (0..config.window)
        .rev()
        .map(|back| {
            let mut frame = Vec::with_capacity(ends.len() * inputs);
            rows.inputs_before(ends, back, &mut frame);
            values(frame, ends.len(), device)
        })
        .collect()
}

/// Forces of a sequence, N, in batches on the device of the configuration, or on the processor
/// where there is no such device.
pub(super) fn predict(network: &Network, sequence: &Sequence) -> Vec<f32> {
    let rows = Rows::new(std::slice::from_ref(sequence), &network.scaling);
    predict_rows(network, &rows, &rows.ends(1))
}

pub(super) fn predict_rows(network: &Network, rows: &Rows, ends: &[At]) -> Vec<f32> {
    let device = network
        .config
        .backend
        .device()
        .unwrap_or_else(|_| Device::flex());
    let layers = folded(&network.layers);
    let weights: Vec<Vec<Tensor<2>>> = layers
        .iter()
        .map(|layer| {
            layer
                .parts()
                .iter()
                .map(|part| tensor(part, &device))
                .collect()
        })
        .collect();
    let mut dropout = Dropout {
        share: 0.0,
        random: ChaCha8Rng::seed_from_u64(0),
    };
    let mut forces = Vec::with_capacity(ends.len() * network.targets);
    for ends in ends.chunks(PREDICTION_BATCH) {
        let frames = frames(rows, &network.config, network.inputs, ends, &device);
        let recurrent = layers.iter().filter(|layer| layer.memory() > 0);
        let mut states: Vec<_> = recurrent
            .map(|layer| Tensor::zeros([ends.len(), layer.outputs()], &device))
            .collect();
        let mut run = Run {
            dropout: &mut dropout,
            states: &mut states,
            all: false,
        };
        let normal = matrix(forward(&layers, &weights, frames, &mut run)).values;
        let at = forces.len();
        forces.resize(at + normal.len(), 0.0);
        let out = forces[at..].chunks_exact_mut(network.targets);
        normal
            .chunks_exact(network.targets)
            .zip(out)
            .for_each(|(normal, force)| network.scaling.force(normal, force));
    }
    forces
}

/// Values as rows of a tensor.
pub(super) fn values(values: Vec<f32>, rows: usize, device: &Device) -> Tensor<2> {
    let columns = values.len() / rows;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

pub(super) fn tensor(matrix: &Matrix, device: &Device) -> Tensor<2> {
    Tensor::from_data(
        TensorData::new(matrix.values.clone(), [matrix.rows, matrix.columns]),
        device,
    )
}

pub(super) fn matrix(tensor: Tensor<2>) -> Matrix {
    let [rows, columns] = tensor.dims();
    let values = tensor
        .into_data()
        .try_into_vec()
        .expect("the tensors of this crate hold f32");
    Matrix {
        rows,
        columns,
        values,
    }
}
