//! Neural networks of the contact force, trained with burn, run with burn in batches and in plain
//! Rust row by row.
//!
//! | file | what |
//! | --- | --- |
//! | [`mlp`], [`gru`], [`lstm`], [`convolution`] | the models, one a file: weights, batch form, row form |
//! | [`layer`], [`matrix`] | what the layers have in common; plain weights |
//! | `data` | normalised sequences, windows and streams |
//! | `batch`, `training` | rows and weights as tensors, predictions; the training loop |
//! | `normal` | statistics of batch normalisations |
//! | `runner` | the forward pass in plain Rust |
//! | `store`, `onnx` | the model file and the ONNX export |
//! | `checkpoint` | the file from which a broken-off training goes on |
//!
//! A network normalises its inputs and targets itself, by the mean and deviation of the training
//! rows, which are part of it.

mod batch;
mod checkpoint;
pub mod convolution;
mod data;
pub mod gru;
pub mod layer;
pub mod lstm;
pub mod matrix;
pub mod mlp;
mod normal;
mod onnx;
mod runner;
mod store;
mod training;

use std::path::Path;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

pub use data::Scaling;
pub use store::load;
pub use training::{train, train_kept};

use crate::{
    model::{Epochs, Model, ModelError, Stepper},
    sequence::Sequence,
};
use layer::Layer;
use runner::Runner;

/// Which network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Dense layers on the current row.
    Mlp,
    /// Gated recurrent units, begun anew for the window of each row, as in the thesis.
    Gru,
    /// Long short-term memory, begun anew for the window of each row, as in the thesis.
    Lstm,
    /// Causal convolution over a window.
    Convolution,
    /// Gated recurrent units whose state goes on from row to row: one step a row, memory without an
    /// end.
    CarriedGru,
}

/// What an optimiser makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Mean of the squared errors.
    Squared,
    /// Mean of the absolute errors: what is scored, and less ruled by a few large ones.
    Absolute,
}

/// What computes the training and the predictions of whole sequences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// This machine's processor: burn's Flex, all cores, or as many as the variable
    /// `RAYON_NUM_THREADS` says.
    Cpu,
    /// An NVIDIA GPU, the first one. Needs the feature `cuda` of this crate, and CUDA 12 or newer
    /// at run time.
    Cuda,
}

/// How a network is built and trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Which network.
    pub kind: Kind,
    /// Widths of the hidden layers, from the input on. The last one is dense, those before it are
    /// of the kind.
    pub layers: Vec<usize>,
    /// Whether a batch normalisation follows each hidden layer. [`Kind::Mlp`] only.
    pub batch_norm: bool,
    /// Share of the outputs of hidden layers set to zero in training, 0 to below 1. In recurrent
    /// networks: of recurrent layers.
    pub dropout: f64,
    /// Rows, windows or streams of one update.
    pub batch: usize,
    /// Learning rate of Adam.
    pub rate: f64,
    /// Learning rate at the end as a share of the first, 0 to 1. Between them half a cosine.
    pub final_rate: f64,
    /// Number of passes through the training rows.
    pub epochs: usize,
    /// Rows that the network reads; [`Kind::CarriedGru`]: rows through which an error is traced
    /// back.
    pub window: usize,
    /// What is made small.
    pub loss: Loss,
    /// Whether the weights of the epoch with the smallest validation error are kept, rather than
    /// the last ones.
    pub keep_best: bool,
    /// Time after which no update begins, s. A run that reaches it isn't repeatable to the byte.
    pub limit_s: Option<f64>,
    /// Seed of the initial weights, the order of the rows and the zeros of the dropout.
    pub seed: u64,
    /// What computes it.
    pub backend: Backend,
}

/// How a network reads rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reads {
    /// Each row alone.
    Row,
    /// The last rows, anew at each row.
    Window,
    /// One row after the other, with a memory.
    Carried,
}

impl Config {
    /// The networks of the thesis (4.2), and its training: Adam, 50 epochs, squared errors.
    ///
    /// The thesis doesn't name the loss nor the activations; squared errors and ReLU are the usual
    /// ones. For [`Kind::Convolution`] and [`Kind::CarriedGru`], which it has not, the settings of
    /// [`Self::small`].
    #[must_use]
    pub fn thesis(kind: Kind) -> Self {
        let recurrent = Self {
            kind,
            layers: vec![100, 100, 100],
            batch_norm: false,
            dropout: 0.1,
            batch: 128,
            rate: 0.0005,
            final_rate: 1.0,
            epochs: 50,
            window: 50,
            loss: Loss::Squared,
            keep_best: false,
            limit_s: None,
            seed: 1,
            backend: Backend::Cpu,
        };
        match kind {
            Kind::Gru | Kind::Lstm => recurrent,
            Kind::Mlp => Self {
                layers: vec![1200, 1000, 800, 600, 400],
                batch_norm: true,
                dropout: 0.2,
                batch: 1024,
                rate: 0.001,
                window: 1,
                ..recurrent
            },
            Kind::Convolution | Kind::CarriedGru => Self::small(kind),
        }
    }

    /// Small networks that a processor trains in minutes and runs in microseconds.
    #[must_use]
    pub fn small(kind: Kind) -> Self {
        let base = Self {
            layers: vec![64, 64],
            dropout: 0.0,
            batch: 256,
            rate: 0.002,
            final_rate: 0.01,
            epochs: 20,
            loss: Loss::Absolute,
            ..Self::thesis(Kind::Gru)
        };
        match kind {
            Kind::Mlp => Self {
                kind,
                window: 1,
                ..base
            },
            Kind::Gru | Kind::Lstm => Self {
                kind,
                layers: vec![32, 32],
                ..base
            },
            Kind::Convolution => Self {
                kind,
                layers: vec![32, 32, 32, 32],
                window: 64,
                ..base
            },
            Kind::CarriedGru => Self {
                kind,
                layers: vec![48, 32],
                batch: 32,
                window: 64,
                epochs: 60,
                ..base
            },
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    ///
    /// The first one that can't be used, with what it must be.
    pub fn check(&self) -> Result<(), ModelError> {
        let refuse = |text: String| Err(ModelError::Data(format!("network settings: {text}")));
        let recurrent = !matches!(self.kind, Kind::Mlp);
        if self.layers.len() < 1 + usize::from(recurrent) || self.layers.contains(&0) {
            return refuse(format!(
                "`layers` is {:?}; it needs {} or more widths above 0, the last of a dense layer",
                self.layers,
                1 + usize::from(recurrent)
            ));
        }
        if self.batch == 0 || self.epochs == 0 || self.window == 0 {
            return refuse(format!(
                "`batch` {}, `epochs` {} and `window` {} must be above 0",
                self.batch, self.epochs, self.window
            ));
        }
        if self.kind == Kind::Mlp && self.window != 1 {
            return refuse(format!(
                "`window` is {}; a perceptron reads 1 row",
                self.window
            ));
        }
        if self.batch_norm && self.kind != Kind::Mlp {
            return refuse("`batch_norm` is for the kind `mlp` alone".into());
        }
        if !(0.0..1.0).contains(&self.dropout) || !(0.0..=1.0).contains(&self.final_rate) {
            return refuse(format!(
                "`dropout` is {} and `final_rate` {}; they are shares, 0 to 1, the first below 1",
                self.dropout, self.final_rate
            ));
        }
        if !(self.rate > 0.0 && self.rate.is_finite())
            || self
                .limit_s
                .is_some_and(|limit| limit.is_nan() || limit <= 0.0)
        {
            return refuse(format!(
                "`rate` {} and `limit_s` {:?} must be above 0",
                self.rate, self.limit_s
            ));
        }
        if self.kind == Kind::Convolution {
            convolution::kernel(self).or_else(|text| refuse(text).map(|()| 0))?;
        }
        Ok(())
    }

    /// How the network reads rows.
    pub(crate) const fn reads(&self) -> Reads {
        match self.kind {
            Kind::Mlp => Reads::Row,
            Kind::Gru | Kind::Lstm | Kind::Convolution => Reads::Window,
            Kind::CarriedGru => Reads::Carried,
        }
    }
}

impl Backend {
    /// Burn's device.
    ///
    /// # Errors
    ///
    /// If this program was built without it.
    fn device(self) -> Result<Device, ModelError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "cuda")]
            Self::Cuda => Ok(Device::cuda(0)),
            #[cfg(not(feature = "cuda"))]
            Self::Cuda => Err(ModelError::Data(
                "this program was built without CUDA; build it with `--features cuda`, or take the backend `cpu`".into(),
            )),
        }
    }
}

/// What a training reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Number of the epoch, from 1.
    pub epoch: usize,
    /// Mean loss of its updates, in squares or units of the targets' deviation.
    pub loss: f64,
    /// Mean absolute error on the validation rows that were tried, N. Missing where there are none.
    pub validation_mae_n: Option<f64>,
    /// Share of its updates that were made, where the time limit ended the training in it or after
    /// it. Files of before have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<f64>,
}

/// A trained network.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    config: Config,
    inputs: usize,
    targets: usize,
    /// Time between the rows of the training data, s.
    step_s: f64,
    scaling: Scaling,
    layers: Vec<Layer>,
    epochs: Vec<Epoch>,
}

impl Network {
    /// How it was built and trained.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// What the training reached, epoch by epoch.
    #[must_use]
    pub fn epochs(&self) -> &[Epoch] {
        &self.epochs
    }

    /// How far the training went.
    #[must_use]
    pub fn trained(&self) -> Epochs {
        let wanted = self.config.epochs;
        let few = self.epochs.len() < wanted;
        let part = self.epochs.last().and_then(|e| e.part);
        // A file of before does not tell how far the last one went: only those before it were whole
        // for certain.
        let last = part.unwrap_or(if few { 0.0 } else { 1.0 });
        let whole = self.epochs.len().saturating_sub(1) as f64;
        Epochs {
            done: if self.epochs.is_empty() {
                0.0
            } else {
                whole + last
            },
            wanted,
            cut: few || part.is_some(),
        }
    }

    /// Number of inputs of a row.
    #[must_use]
    pub const fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of forces of a row.
    #[must_use]
    pub const fn targets(&self) -> usize {
        self.targets
    }

    /// Time between rows, s: data at another rate can't be used.
    #[must_use]
    pub const fn step_s(&self) -> f64 {
        self.step_s
    }

    /// The layers with their weights.
    #[must_use]
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Refuses data that the network was not trained for.
    ///
    /// # Errors
    ///
    /// Another number of inputs or targets, another time between rows, or a value that is not
    /// finite.
    pub fn check(&self, sequence: &Sequence) -> Result<(), ModelError> {
        data::check(
            std::slice::from_ref(sequence),
            self.inputs,
            self.targets,
            self.step_s,
        )
    }

    /// Writes the model file; see [`load`].
    ///
    /// # Errors
    ///
    /// If the file can't be written.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        std::fs::write(path, self.to_bytes()).map_err(|error| {
            ModelError::Stored(format!("{}: can't be written: {error}", path.display()))
        })
    }

    /// Writes an ONNX file (opset 17), inputs and outputs in SI units, the normalisation inside.
    ///
    /// Inputs and outputs by kind: [`Kind::Mlp`] `input [batch, inputs]`; windowed networks
    /// `input [batch, window, inputs]`, oldest row first; [`Kind::CarriedGru`]
    /// `input [rows, batch, inputs]` with `state_k [1, batch, units]` in and `next_state_k` out for
    /// each recurrent layer. The output is `force [batch, targets]`, N, of the newest row; of
    /// [`Kind::CarriedGru`] `force [rows, batch, targets]`.
    ///
    /// # Errors
    ///
    /// If the file can't be written.
    pub fn write_onnx(&self, path: &Path) -> Result<(), ModelError> {
        std::fs::write(path, onnx::encode(self)).map_err(|error| {
            ModelError::Stored(format!("{}: can't be written: {error}", path.display()))
        })
    }

    fn runner(&self) -> Runner {
        Runner::new(
            &self.layers,
            self.config.reads(),
            self.config.window,
            self.inputs,
        )
    }
}

impl Model for Network {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        match self.config.reads() {
            Reads::Carried => {
                let mut stepper = self.stepper();
                let mut forces = vec![0.0; sequence.rows() * self.targets];
                for (row, force) in forces.chunks_exact_mut(self.targets).enumerate() {
                    stepper.step(sequence.input_row(row), force);
                }
                forces
            }
            Reads::Row | Reads::Window => batch::predict(self, sequence),
        }
    }

    fn parameters(&self) -> usize {
        self.layers.iter().map(Layer::parameters).sum()
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(NetworkStepper {
            network: self,
            runner: self.runner(),
            row: vec![0.0; self.inputs],
        })
    }
}

/// A network on a live stream, in plain Rust.
struct NetworkStepper<'a> {
    network: &'a Network,
    runner: Runner,
    row: Vec<f32>,
}

impl Stepper for NetworkStepper<'_> {
    fn step(&mut self, input: &[f32], force: &mut [f32]) {
        self.network.scaling.input(input, &mut self.row);
        let normal = self.runner.step(&self.row);
        self.network.scaling.force(normal, force);
    }

    fn reset(&mut self) {
        self.runner.reset();
    }
}
