//! Statistics of batch normalisations: mean and variance of what reaches each of them, with the
//! weights as they are.
//!
//! Running averages over the updates, as Keras keeps them, lag behind the weights by about 1 / (1 -
//! momentum) = 100 updates, and are taken with dropout. A training of a few hundred updates ends
//! with statistics of weights that are no more, and its network is worse than none. So they are
//! computed anew with the final weights and without dropout, layer by layer: what a layer reads is
//! normalised by the statistics that the network will use (the "precise" normalisation of Wu and
//! Johnson, arXiv 2105.07576, 3).

use burn::tensor::{activation::relu, module::batch_norm_train, Device, Tensor};

use super::{
    batch::{frames, matrix, tensor},
    data::{At, Rows},
    layer::Layer,
    mlp::EPSILON,
    Config,
};

/// Most rows that are taken, evenly spaced over all trials. The mean of 16384 rows is known to 1 %
/// of the deviation.
const ROWS: usize = 16_384;

/// Puts the statistics of the training rows into every normalisation. Other networks stay as they
/// are.
pub(super) fn settle(
    layers: &mut [Layer],
    rows: &Rows,
    config: &Config,
    inputs: usize,
    device: &Device,
) {
    if !config.batch_norm {
        return;
    }
    let ends = rows.ends(config.window);
    let taken: Vec<At> = ends
        .iter()
        .step_by(ends.len().div_ceil(ROWS).max(1))
        .copied()
        .collect();
    // One row has no variance.
    if taken.len() < 2 {
        return;
    }
    let mut frames = frames(rows, config, inputs, &taken, device);
    let mut values = frames.remove(0);
    for layer in layers {
        let parts = layer.parts();
        let parts: Vec<Tensor<2>> = parts.iter().map(|part| tensor(part, device)).collect();
        values = match layer {
            Layer::Dense(dense) => dense.forward(&parts, values),
            Layer::BatchNorm(norm) => {
                let row = |tensor: &Tensor<2>| tensor.clone().squeeze_dim::<1>(0);
                let normal = batch_norm_train(values, row(&parts[0]), row(&parts[1]), EPSILON);
                norm.mean = matrix(normal.mean.unsqueeze::<2>());
                norm.variance = matrix(normal.variance.unsqueeze::<2>());
                relu(normal.output)
            }
            // Only perceptrons are normalised.
            Layer::Gru(_) | Layer::Lstm(_) | Layer::Convolution(_) => return,
        };
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        network::{layer::Layer, train, Config, Kind, Network},
        sequence::Sequence,
    };

    /// Two inputs, and a force that is their product.
    fn sequence(trial: usize, rows: usize) -> Sequence {
        let value =
            |row: usize, k: usize| ((row * 7 + trial * 31) as f32 * [0.013, 0.029][k]).sin();
        Sequence {
            trial,
            start_s: 0.0,
            step_s: 0.02,
            input: (0..rows)
                .flat_map(|row| [3.0 + value(row, 0), value(row, 1)])
                .collect(),
            inputs: 2,
            target: (0..rows)
                .map(|row| 2.0 * value(row, 0) * value(row, 1))
                .collect(),
            targets: 1,
        }
    }

    /// Three trials and sixty updates: running averages would still hold half of their first
    /// values.
    fn briefly_trained() -> (Network, Vec<Sequence>) {
        let training: Vec<Sequence> = (1..4).map(|trial| sequence(trial, 640)).collect();
        let config = Config {
            layers: vec![24, 16],
            batch_norm: true,
            dropout: 0.2,
            batch: 64,
            rate: 0.01,
            epochs: 2,
            ..Config::small(Kind::Mlp)
        };
        let network = train(&config, &training, &[], &mut |_| {}).expect("good data");
        (network, training)
    }

    #[test]
    fn statistics_are_those_of_the_final_weights() {
        let (network, training) = briefly_trained();
        // All rows through the layers, one at a time; each normalisation must find what it says.
        let mut rows: Vec<Vec<f32>> = (training.iter())
            .flat_map(|one| one.input.chunks_exact(2))
            .map(|row| {
                let mut normal = vec![0.0; 2];
                network.scaling.input(row, &mut normal);
                normal
            })
            .collect();
        let mut normalisations = 0;
        for layer in network.layers() {
            match layer {
                Layer::Dense(dense) => {
                    for row in &mut rows {
                        let mut out = vec![0.0; dense.weight.columns];
                        dense.step(row, &mut out);
                        *row = out;
                    }
                }
                Layer::BatchNorm(norm) => {
                    normalisations += 1;
                    for unit in 0..norm.mean.columns {
                        let values = || rows.iter().map(|row| f64::from(row[unit]));
                        let mean = values().sum::<f64>() / rows.len() as f64;
                        let variance =
                            values().map(|v| (v - mean).powi(2)).sum::<f64>() / rows.len() as f64;
                        let said = (
                            f64::from(norm.mean.values[unit]),
                            f64::from(norm.variance.values[unit]),
                        );
                        assert!(
                            (said.0 - mean).abs() < 1e-3 * (1.0 + variance.sqrt())
                                && (said.1 - variance).abs() < 2e-3 * (1e-3 + variance),
                            "unit {unit}: says {said:?}, has {mean} and {variance}"
                        );
                        let scale =
                            f64::from(norm.gamma.values[unit]) / (said.1 + super::EPSILON).sqrt();
                        for row in &mut rows {
                            let value = (f64::from(row[unit]) - said.0) * scale
                                + f64::from(norm.beta.values[unit]);
                            row[unit] = value.max(0.0) as f32;
                        }
                    }
                }
                _ => unreachable!("a perceptron"),
            }
        }
        assert_eq!(normalisations, 2);
    }
}
