//! What all layers of the networks have in common: their matrices by name, their widths, and the
//! batch form in training.

use burn::tensor::Tensor;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    convolution::{kernel, Convolution},
    gru::Gru,
    lstm::Lstm,
    matrix::Matrix,
    mlp::{BatchNorm, Dense},
    Config, Kind,
};

/// A layer with its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Layer {
    /// See [`Dense`].
    Dense(Dense),
    /// See [`BatchNorm`].
    BatchNorm(BatchNorm),
    /// See [`Gru`].
    Gru(Gru),
    /// See [`Lstm`].
    Lstm(Lstm),
    /// See [`Convolution`].
    Convolution(Convolution),
}

/// Layers with their initial weights: those of the kind, a dense one where they are not dense, the
/// output.
///
/// # Errors
///
/// As [`kernel`].
pub(super) fn build(
    config: &Config,
    inputs: usize,
    targets: usize,
    random: &mut impl Rng,
) -> Result<Vec<Layer>, String> {
    let normalised = config.batch_norm && config.kind == Kind::Mlp;
    let mut layers = Vec::new();
    let mut width = inputs;
    for (at, &units) in config.layers.iter().enumerate() {
        // The last one is dense in every kind.
        let kind = match config.kind {
            _ if at + 1 == config.layers.len() => Kind::Mlp,
            kind => kind,
        };
        layers.push(match kind {
            Kind::Mlp => Layer::Dense(Dense::new(width, units, !normalised, random)),
            Kind::Gru | Kind::CarriedGru => Layer::Gru(Gru::new(width, units, random)),
            Kind::Lstm => Layer::Lstm(Lstm::new(width, units, random)),
            Kind::Convolution => {
                Layer::Convolution(Convolution::new(kernel(config)?, width, units, random))
            }
        });
        if normalised {
            layers.push(Layer::BatchNorm(BatchNorm::new(units)));
        }
        width = units;
    }
    layers.push(Layer::Dense(Dense::new(width, targets, false, random)));
    Ok(layers)
}

impl Layer {
    /// The matrices with their names.
    #[must_use]
    pub fn matrices(&self) -> Vec<(&'static str, &Matrix)> {
        match self {
            Self::Dense(dense) => vec![("weight", &dense.weight), ("bias", &dense.bias)],
            Self::BatchNorm(norm) => {
                vec![
                    ("gamma", &norm.gamma),
                    ("beta", &norm.beta),
                    ("mean", &norm.mean),
                    ("variance", &norm.variance),
                ]
            }
            Self::Gru(gru) => vec![
                ("input", &gru.input),
                ("recurrent", &gru.recurrent),
                ("bias", &gru.bias),
                ("recurrent_bias", &gru.recurrent_bias),
            ],
            Self::Lstm(lstm) => vec![
                ("input", &lstm.input),
                ("recurrent", &lstm.recurrent),
                ("bias", &lstm.bias),
            ],
            Self::Convolution(layer) => vec![("weight", &layer.weight), ("bias", &layer.bias)],
        }
    }

    /// The matrices, to be written; in the order of [`Self::matrices`].
    pub(super) fn matrices_mut(&mut self) -> Vec<&mut Matrix> {
        match self {
            Self::Dense(dense) => vec![&mut dense.weight, &mut dense.bias],
            Self::BatchNorm(norm) => vec![
                &mut norm.gamma,
                &mut norm.beta,
                &mut norm.mean,
                &mut norm.variance,
            ],
            Self::Gru(gru) => vec![
                &mut gru.input,
                &mut gru.recurrent,
                &mut gru.bias,
                &mut gru.recurrent_bias,
            ],
            Self::Lstm(lstm) => vec![&mut lstm.input, &mut lstm.recurrent, &mut lstm.bias],
            Self::Convolution(layer) => vec![&mut layer.weight, &mut layer.bias],
        }
    }

    /// Number of values, counted as Keras counts them: with the running statistics of a
    /// normalisation.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.matrices()
            .iter()
            .map(|(_, matrix)| matrix.values.len())
            .sum()
    }

    /// Number of values of a row that the layer writes. A convolution: of a group of rows.
    pub(super) fn outputs(&self) -> usize {
        match self {
            Self::Dense(dense) => dense.weight.columns,
            Self::BatchNorm(norm) => norm.gamma.columns,
            Self::Gru(gru) => gru.units(),
            Self::Lstm(lstm) => lstm.units(),
            Self::Convolution(layer) => layer.weight.columns,
        }
    }

    /// Number of values that the layer keeps from row to row.
    pub(super) fn memory(&self) -> usize {
        match self {
            Self::Gru(gru) => gru.units(),
            Self::Lstm(lstm) => 2 * lstm.units(),
            Self::Dense(_) | Self::BatchNorm(_) | Self::Convolution(_) => 0,
        }
    }

    /// What training changes, in the form in which it holds it.
    pub(super) fn parts(&self) -> Vec<Matrix> {
        match self {
            Self::Dense(dense) => vec![dense.weight.clone(), dense.bias.clone()],
            Self::BatchNorm(norm) => vec![norm.gamma.clone(), norm.beta.clone()],
            Self::Gru(gru) => gru.parts(),
            Self::Lstm(lstm) => lstm.parts(),
            Self::Convolution(layer) => vec![layer.weight.clone(), layer.bias.clone()],
        }
    }

    /// Takes over what training changed.
    pub(super) fn set_parts(&mut self, parts: &[Matrix]) {
        match self {
            Self::Gru(gru) => *gru = Gru::of_parts(parts),
            Self::Lstm(lstm) => *lstm = Lstm::of_parts(parts),
            other => other
                .matrices_mut()
                .into_iter()
                .zip(parts)
                .for_each(|(matrix, part)| *matrix = part.clone()),
        }
    }
}

/// The layers without normalisations: each is put into the dense layer before it.
pub(super) fn folded(layers: &[Layer]) -> Vec<Layer> {
    let mut folded: Vec<Layer> = Vec::with_capacity(layers.len());
    for layer in layers {
        match (layer, folded.last_mut()) {
            (Layer::BatchNorm(norm), Some(Layer::Dense(dense))) => *dense = norm.fold(dense),
            _ => folded.push(layer.clone()),
        }
    }
    folded
}

/// Sets a share of the values to zero in training and scales the rest up, with random numbers of
/// its own: the backend's generator is one for the whole process, so two trainings at a time would
/// disturb each other.
pub(super) struct Dropout {
    /// The share, below 1. Zero outside of training.
    pub share: f64,
    /// Where the numbers come from.
    pub random: ChaCha8Rng,
}

impl Dropout {
    /// The tensor with its share of zeros.
    pub(super) fn apply(&mut self, tensor: Tensor<2>) -> Tensor<2> {
        if self.share <= 0.0 {
            return tensor;
        }
        let shape = tensor.dims();
        let kept = (1.0 / (1.0 - self.share)) as f32;
        // Four decisions a number: 16 bits resolve the share to 0.002 %.
        let below = (self.share * 65_536.0).round() as u64;
        let mut mask = Vec::with_capacity(shape[0] * shape[1] + 3);
        while mask.len() < shape[0] * shape[1] {
            let bits = self.random.next_u64();
            mask.extend((0..4).map(|at| {
                if (bits >> (16 * at)) & 0xffff < below {
                    0.0
                } else {
                    kept
                }
            }));
        }
        mask.truncate(shape[0] * shape[1]);
        let mask = Tensor::from_data(burn::tensor::TensorData::new(mask, shape), &tensor.device());
        tensor * mask
    }
}

/// What a batch form of the layers needs besides the weights.
pub(super) struct Run<'a> {
    /// Zeros in training.
    pub dropout: &'a mut Dropout,
    /// State of each recurrent layer before the first frame, `[batch, units]`; after the run that
    /// after the last one.
    pub states: &'a mut [Tensor<2>],
    /// Whether every frame has an output, or the last one alone.
    pub all: bool,
}

/// The layers on a batch in training.
///
/// `frames`: a tensor `[batch, inputs]` for each row in time, for a convolution one tensor
/// `[batch, rows * inputs]`. Returns `[batch, targets]`, with [`Run::all`]
/// `[rows * batch, targets]`, the first row's batch first.
pub(super) fn forward(
    layers: &[Layer],
    weights: &[Vec<Tensor<2>>],
    mut frames: Vec<Tensor<2>>,
    run: &mut Run,
) -> Tensor<2> {
    let mut recurrent = 0;
    let last = layers.len() - 1;
    for (at, (layer, weights)) in layers.iter().zip(weights).enumerate() {
        if layer.memory() > 0 {
            let state = run.states[recurrent].clone();
            frames = match layer {
                Layer::Lstm(_) => Lstm::forward(weights, frames, state),
                _ => Gru::forward(weights, frames, state),
            };
            run.states[recurrent] = frames.last().expect("a window has rows").clone();
            recurrent += 1;
            // The rows of a window that no layer above reads need no zeros.
            if layers[at + 1].memory() == 0 && !run.all {
                frames.drain(..frames.len() - 1);
            }
            frames = frames
                .into_iter()
                .map(|frame| run.dropout.apply(frame))
                .collect();
            continue;
        }
        let input = if frames.len() == 1 {
            frames.remove(0)
        } else {
            Tensor::cat(std::mem::take(&mut frames), 0)
        };
        let output = match layer {
            Layer::Dense(dense) => dense.forward(weights, input),
            Layer::Convolution(layer) => layer.forward(weights, input),
            _ => BatchNorm::train(weights, input),
        };
        // After a recurrent layer the thesis has none; a normalised layer has it after the
        // normalisation.
        let normalised_next = matches!(layers.get(at + 1), Some(Layer::BatchNorm(_)));
        let drop = at < last && recurrent == 0 && !normalised_next;
        frames = vec![if drop {
            run.dropout.apply(output)
        } else {
            output
        }];
    }
    frames.remove(0)
}
