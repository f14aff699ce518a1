//! The training loop.

use std::{path::Path, time::Instant};

use burn::{
    grad_clipping::GradientClippingConfig,
    module::{Module, Param, ParamId},
    optim::{AdamConfig, GradientsParams, ModuleOptimizer},
    tensor::{Device, Tensor},
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{
    batch::{frames, matrix, predict_rows, tensor, values},
    checkpoint::{generator, Standing as Stored},
    data::{self, At, Rows, Scaling},
    layer::{self, forward, Dropout, Layer, Run},
    normal, Config, Epoch, Loss, Network, Reads,
};
use crate::{
    model::{Keep, Model, ModelError, Progress},
    sequence::Sequence,
};

/// Most validation rows that are tried after an epoch, evenly spaced: enough for the trend, cheap
/// beside an epoch.
const VALIDATION_ROWS: usize = 4096;
/// Longest gradient of a part of a recurrent network, beyond which it is shortened: it can grow
/// over a window.
const LONGEST_GRADIENT: f32 = 1.0;

/// What the optimiser changes: the parts of all layers, one after the other.
#[derive(Module, Debug)]
struct Parameters {
    values: Vec<Param<Tensor<2>>>,
}

/// Trains a network.
///
/// The normalisation is that of `training`. `validation` gives the error after each epoch and, with
/// [`Config::keep_best`], chooses the weights; it may be empty. On one machine the same data and
/// settings give the same weights to the byte.
///
/// # Errors
///
/// Settings that can't be used; no training row; sequences of different widths or rates; a value
/// that is not finite; no sequence as long as a window; losses that are not finite (a smaller rate
/// helps).
pub fn train(
    config: &Config,
    training: &[Sequence],
    validation: &[Sequence],
    progress: &mut dyn FnMut(&Progress),
) -> Result<Network, ModelError> {
    train_kept(config, training, validation, None, progress)
}

/// The same with a file after each epoch, from which a training that was broken off goes on. It
/// gives the same weights, to the byte, as one that was not.
///
/// # Errors
///
/// As [`train`]; the file can't be written, or is to be gone on from and is not of this training.
pub fn train_kept(
    config: &Config,
    training: &[Sequence],
    validation: &[Sequence],
    keep: Option<&Keep>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Network, ModelError> {
    config.check()?;
    let first = training
        .iter()
        .find(|one| one.inputs > 0 && one.rows() > 0)
        .ok_or_else(|| {
            ModelError::Data(
                "no training row: give at least one trial with rows that can be used".to_owned(),
            )
        })?;
    let (inputs, targets, step_s) = (first.inputs, first.targets, first.step_s);
    data::check(training, inputs, targets, step_s)?;
    data::check(validation, inputs, targets, step_s)?;
    if !training.iter().any(|one| one.rows() >= config.window) {
        return Err(ModelError::Data(format!(
            "no training sequence has {} rows, the network's window: give longer trials or a shorter window",
            config.window
        )));
    }
    let mut random = ChaCha8Rng::seed_from_u64(config.seed);
    let layers = layer::build(config, inputs, targets, &mut random).map_err(ModelError::Data)?;
    let scaling = Scaling::of(training);
    let rows = Rows::new(training, &scaling);
    let network = Network {
        config: config.clone(),
        inputs,
        targets,
        step_s,
        scaling,
        layers,
        epochs: Vec::new(),
    };
    let count = training.iter().map(Sequence::rows).sum();
    let mut trainer = Trainer::new(network, rows, random)?;
    let best = match keep {
        Some(keep) if keep.resume => trainer.go_on(&keep.file, count)?,
        _ => None,
    };
    trainer.run(validation, best, keep.map(|keep| (keep, count)), progress)
}

/// A training under way.
struct Trainer {
    network: Network,
    rows: Rows,
    device: Device,
    parameters: Option<Parameters>,
    optimiser: ModuleOptimizer,
    dropout: Dropout,
    random: ChaCha8Rng,
    begun: Instant,
    /// Share of the training that was done when it began, or went on.
    done_before: f64,
}

/// Validation error, N, and layers of the best epoch.
type Best = Option<(f64, Vec<Layer>)>;

/// The weights as what the optimiser changes. Their numbers are always the same: its state in a
/// file is by them.
fn parameters(layers: &[Layer], device: &Device) -> Parameters {
    let parts = layers.iter().flat_map(Layer::parts);
    let values = (1_u64..)
        .zip(parts)
        .map(|(id, part)| {
            let mut value = Param::from_tensor(tensor(&part, device));
            value.id = ParamId::from(id);
            value
        })
        .collect();
    Parameters { values }
}

/// Seed of the zeros of the dropout.
const fn dropout_seed(config: &Config) -> u64 {
    config.seed ^ 0x6472_6f70
}

/// Where a training stands: for the rate and the time left.
struct Standing {
    epoch: usize,
    update: usize,
    updates: usize,
}

impl Trainer {
    fn new(network: Network, rows: Rows, random: ChaCha8Rng) -> Result<Self, ModelError> {
        let config = &network.config;
        let device = config.backend.device()?.autodiff();
        let parameters = parameters(&network.layers, &device);
        let recurrent = network.layers.iter().any(|layer| layer.memory() > 0);
        let optimiser = AdamConfig::new()
            // The value of Keras.
            .with_epsilon(1e-7)
            .with_grad_clipping(recurrent.then_some(GradientClippingConfig::Norm(LONGEST_GRADIENT)))
            .init();
        let dropout = Dropout {
            share: config.dropout,
            random: ChaCha8Rng::seed_from_u64(dropout_seed(config)),
        };
        Ok(Self {
            rows,
            device,
            parameters: Some(parameters),
            optimiser,
            dropout,
            random,
            begun: Instant::now(),
            done_before: 0.0,
            network,
        })
    }

    /// Takes up the training of a file. Returns its best epoch.
    fn go_on(&mut self, file: &Path, rows: usize) -> Result<Best, ModelError> {
        let (stored, optimiser) = Stored::read(file, &self.network, rows)?;
        let config = &self.network.config;
        self.random = generator(config.seed, stored.drawn);
        self.dropout.random = generator(dropout_seed(config), stored.drawn_dropout);
        self.optimiser = (self.optimiser.clone())
            .from_bytes(optimiser)
            .map_err(|error| ModelError::Data(format!("{}: {error}", file.display())))?;
        self.parameters = Some(parameters(&stored.network.layers, &self.device));
        self.network.layers = stored.network.layers;
        self.network.epochs = stored.network.epochs;
        self.done_before = self.network.epochs.len() as f64 / config.epochs as f64;
        Ok(stored.best.map(|(mae_n, best)| (mae_n, best.layers)))
    }

    /// Writes the file from which the training goes on.
    fn keep(&self, file: &Path, rows: usize, best: &Best) -> Result<(), ModelError> {
        let with = |layers: &Vec<Layer>| Network {
            layers: layers.clone(),
            ..self.network.clone()
        };
        let stored = Stored {
            network: self.network.clone(),
            best: best.as_ref().map(|(mae_n, layers)| (*mae_n, with(layers))),
            rows,
            drawn: self.random.get_word_pos(),
            drawn_dropout: self.dropout.random.get_word_pos(),
        };
        stored.write(&self.optimiser, file)
    }

    fn run(
        mut self,
        validation: &[Sequence],
        mut best: Best,
        keep: Option<(&Keep, usize)>,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Network, ModelError> {
        let epochs = self.network.config.epochs;
        for epoch in self.network.epochs.len() + 1..=epochs {
            let whole = match self.network.config.reads() {
                Reads::Carried => self.carried_epoch(epoch, progress)?,
                Reads::Row | Reads::Window => self.windowed_epoch(epoch, progress)?,
            };
            self.take_weights();
            let Some(loss) = whole.loss else {
                // The time was over between two passes: the last one was whole, and says so.
                if let Some(last) = self.network.epochs.last_mut() {
                    last.part = Some(1.0);
                }
                break;
            };
            let validation_mae_n = self.validate(validation);
            self.network.epochs.push(Epoch {
                epoch,
                loss,
                validation_mae_n,
                part: whole.cut.then(|| whole.share()),
            });
            self.report(
                &Standing {
                    epoch,
                    update: 1,
                    updates: 1,
                },
                loss,
                validation_mae_n,
                progress,
            );
            if let (true, Some(error)) = (self.network.config.keep_best, validation_mae_n) {
                if best.as_ref().is_none_or(|(least, _)| error < *least) {
                    best = Some((error, self.network.layers.clone()));
                }
            }
            if whole.cut {
                break;
            }
            if let Some((keep, rows)) = keep {
                self.keep(&keep.file, rows, &best)?;
            }
        }
        if let Some((_, layers)) = best {
            self.network.layers = layers;
        }
        Ok(self.network)
    }

    /// One pass through the windows in a random order.
    fn windowed_epoch(
        &mut self,
        epoch: usize,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Pass, ModelError> {
        let config = self.network.config.clone();
        let ends = self.rows.shuffled(config.window, &mut self.random);
        let updates = ends.len().div_ceil(config.batch);
        let mut pass = Pass::new(&self.device, updates);
        for (update, batch) in ends.chunks(config.batch).enumerate() {
            // A normalisation over one row has no variance.
            if config.batch_norm && batch.len() < 2 {
                continue;
            }
            let standing = Standing {
                epoch,
                update,
                updates,
            };
            if self.late() {
                return pass.end(true);
            }
            let frames = frames(
                &self.rows,
                &config,
                self.network.inputs,
                batch,
                &self.device,
            );
            let mut targets = Vec::with_capacity(batch.len() * self.network.targets);
            self.rows.targets(batch, &mut targets);
            let targets = values(targets, batch.len(), &self.device);
            let mut states = self.zero_states(batch.len());
            let loss = self.update(
                &standing,
                frames,
                &mut states,
                |output| error(config.loss, output - targets).mean(),
                false,
            );
            self.count(&mut pass, loss, &standing, progress)?;
        }
        pass.end(false)
    }

    /// One pass through the streams: each piece begins with the state at the end of the piece
    /// before it.
    ///
    /// A stream that begins inside of a trial knows nothing of what was before: its first piece
    /// isn't scored.
    fn carried_epoch(
        &mut self,
        epoch: usize,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Pass, ModelError> {
        let config = self.network.config.clone();
        let streams = self
            .rows
            .streams(config.batch, config.window, &mut self.random);
        let updates = streams[0].len();
        let mut states = self.zero_states(streams.len());
        let mut pass = Pass::new(&self.device, updates);
        for update in 0..updates {
            let standing = Standing {
                epoch,
                update,
                updates,
            };
            if self.late() {
                return pass.end(true);
            }
            let piece = Piece::of(&streams, update, config.window);
            let goes_on = values(piece.goes_on, streams.len(), &self.device);
            states
                .iter_mut()
                .for_each(|state| *state = state.clone().detach() * goes_on.clone());
            let (mut frames, mut targets) = (Vec::with_capacity(config.window), Vec::new());
            for rows in &piece.rows {
                let mut inputs = Vec::with_capacity(rows.len() * self.network.inputs);
                self.rows.inputs_before(rows, 0, &mut inputs);
                frames.push(values(inputs, rows.len(), &self.device));
                self.rows.targets(rows, &mut targets);
            }
            let scored = piece.scored.iter().filter(|&&scored| scored > 0.0).count();
            if scored == 0 {
                // Nothing to learn from, but the states must go on.
                self.states_only(frames, &mut states);
                continue;
            }
            let count = (scored * config.window * self.network.targets) as f64;
            let targets = values(targets, streams.len() * config.window, &self.device);
            let weights = values(
                piece.scored.repeat(config.window),
                streams.len() * config.window,
                &self.device,
            );
            let loss = |output: Tensor<2>| {
                (error(config.loss, output - targets) * weights)
                    .sum()
                    .div_scalar(count)
            };
            let loss = self.update(&standing, frames, &mut states, loss, true);
            self.count(&mut pass, loss, &standing, progress)?;
        }
        pass.end(false)
    }

    /// One step of the optimiser. Returns the loss before it.
    fn update(
        &mut self,
        standing: &Standing,
        frames: Vec<Tensor<2>>,
        states: &mut [Tensor<2>],
        loss: impl FnOnce(Tensor<2>) -> Tensor<1>,
        all: bool,
    ) -> Tensor<1> {
        let parameters = self.parameters.take().expect("put back below");
        let weights = self.weights(&parameters);
        let mut run = Run {
            dropout: &mut self.dropout,
            states,
            all,
        };
        let loss = loss(forward(&self.network.layers, &weights, frames, &mut run));
        let gradients = GradientsParams::from_grads(loss.backward(), &parameters);
        let rate = rate(&self.network.config, standing);
        self.parameters = Some(self.optimiser.step(rate, parameters, gradients));
        loss.inner()
    }

    /// Runs the layers without learning.
    fn states_only(&mut self, frames: Vec<Tensor<2>>, states: &mut [Tensor<2>]) {
        let parameters = self.parameters.take().expect("put back below");
        let weights = self.weights(&parameters);
        let mut run = Run {
            dropout: &mut self.dropout,
            states,
            all: false,
        };
        let _ = forward(&self.network.layers, &weights, frames, &mut run);
        self.parameters = Some(parameters);
    }

    /// The tensors of each layer.
    fn weights(&self, parameters: &Parameters) -> Vec<Vec<Tensor<2>>> {
        let mut values = parameters.values.iter().map(Param::val);
        self.network
            .layers
            .iter()
            .map(|layer| values.by_ref().take(layer.parts().len()).collect())
            .collect()
    }

    fn zero_states(&self, batch: usize) -> Vec<Tensor<2>> {
        let layers = self
            .network
            .layers
            .iter()
            .filter(|layer| layer.memory() > 0);
        layers
            .map(|layer| Tensor::zeros([batch, layer.outputs()], &self.device))
            .collect()
    }

    /// Brings the weights from the device into the network, with the statistics that belong to
    /// them.
    fn take_weights(&mut self) {
        let parameters = self
            .parameters
            .as_ref()
            .expect("put back after each update");
        let mut values = parameters.values.iter().map(|value| matrix(value.val()));
        for layer in &mut self.network.layers {
            let count = layer.parts().len();
            layer.set_parts(&values.by_ref().take(count).collect::<Vec<_>>());
        }
        let Network {
            layers,
            config,
            inputs,
            ..
        } = &mut self.network;
        let device = self.device.clone().inner();
        normal::settle(layers, &self.rows, config, *inputs, &device);
    }

    /// Mean absolute error on the validation rows, N.
    fn validate(&self, validation: &[Sequence]) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0usize);
        let mut add = |forces: &[f32], truth: &[f32]| {
            sum += forces
                .iter()
                .zip(truth)
                .map(|(force, truth)| f64::from((force - truth).abs()))
                .sum::<f64>();
            count += forces.len();
        };
        if self.network.config.reads() == Reads::Carried {
            validation
                .iter()
                .for_each(|one| add(&self.network.predict(one), &one.target));
        } else {
            let rows = Rows::new(validation, &self.network.scaling);
            let ends = rows.ends(self.network.config.window);
            let ends: Vec<At> = ends
                .iter()
                .step_by(ends.len().div_ceil(VALIDATION_ROWS).max(1))
                .copied()
                .collect();
            let mut truth = Vec::new();
            for &(sequence, row) in &ends {
                truth.extend_from_slice(validation[sequence as usize].target_row(row as usize));
            }
            add(&predict_rows(&self.network, &rows, &ends), &truth);
        }
        (count > 0).then(|| sum / count as f64)
    }

    fn late(&self) -> bool {
        self.network
            .config
            .limit_s
            .is_some_and(|limit| self.begun.elapsed().as_secs_f64() > limit)
    }

    /// Adds a loss. Looks at it, and reports, now and then: that waits for the device.
    fn count(
        &self,
        pass: &mut Pass,
        loss: Tensor<1>,
        standing: &Standing,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<(), ModelError> {
        pass.add(loss);
        if standing
            .update
            .is_multiple_of((standing.updates / 20).max(1))
        {
            let mean = pass.mean()?;
            self.report(standing, mean, None, progress);
        }
        Ok(())
    }

    fn report(
        &self,
        standing: &Standing,
        loss: f64,
        mae: Option<f64>,
        progress: &mut dyn FnMut(&Progress),
    ) {
        let config = &self.network.config;
        let spent = self.begun.elapsed().as_secs_f64();
        let done = standing.done(config.epochs);
        let mut left = spent / (done - self.done_before).max(1e-9) * (1.0 - done);
        if let Some(limit) = config.limit_s {
            left = left.min((limit - spent).max(0.0));
        }
        let mae = mae.map_or_else(String::new, |mae| format!(", validation error {mae:.4} N"));
        let left = if left < 90.0 {
            format!("{left:.0} s")
        } else {
            format!("{:.0} min", left / 60.0)
        };
        let text = format!(
            "epoch {} of {}: loss {loss:.5}{mae}, {left} left",
            standing.epoch, config.epochs
        );
        progress(&Progress { done, text });
    }
}

impl Standing {
    /// Share of the training that is done.
    fn done(&self, epochs: usize) -> f64 {
        ((self.epoch - 1) as f64 + self.update as f64 / self.updates as f64) / epochs as f64
    }
}

/// The losses of a pass.
struct Pass {
    sum: Tensor<1>,
    updates: usize,
    /// Updates of a whole pass.
    of: usize,
    /// Mean loss, when the pass is over. None where no update was made.
    loss: Option<f64>,
    /// Whether the time was over before the data.
    cut: bool,
}

impl Pass {
    fn new(device: &Device, of: usize) -> Self {
        Self {
            sum: Tensor::zeros([1], &device.clone().inner()),
            updates: 0,
            of,
            loss: None,
            cut: false,
        }
    }

    fn add(&mut self, loss: Tensor<1>) {
        self.sum = self.sum.clone() + loss;
        self.updates += 1;
    }

    /// Share of the pass that was made.
    fn share(&self) -> f64 {
        self.updates as f64 / self.of.max(1) as f64
    }

    fn mean(&self) -> Result<f64, ModelError> {
        let mean = f64::from(self.sum.clone().into_scalar::<f32>()) / self.updates.max(1) as f64;
        if mean.is_finite() {
            return Ok(mean);
        }
        Err(ModelError::Data(format!(
            "the loss is {mean} after {} updates: the training has diverged; take a smaller `rate`",
            self.updates
        )))
    }

    fn end(mut self, cut: bool) -> Result<Self, ModelError> {
        self.cut = cut;
        if self.updates > 0 {
            self.loss = Some(self.mean()?);
        }
        Ok(self)
    }
}

/// A piece of every stream.
struct Piece {
    /// For each row in time the rows of the streams.
    rows: Vec<Vec<At>>,
    /// For each stream: 1 where it goes on from the piece before, 0 where it begins.
    goes_on: Vec<f32>,
    /// For each stream: 1 where its errors count.
    scored: Vec<f32>,
}

impl Piece {
    fn of(streams: &[Vec<At>], update: usize, length: usize) -> Self {
        let begins = |stream: &Vec<At>| {
            update.checked_sub(1).is_none_or(|before| {
                let (sequence, row) = stream[before];
                stream[update] != (sequence, row + length as u32)
            })
        };
        let number = |yes: bool| f32::from(u8::from(yes));
        Self {
            rows: (0..length as u32)
                .map(|at| {
                    streams
                        .iter()
                        .map(|stream| (stream[update].0, stream[update].1 + at))
                        .collect()
                })
                .collect(),
            goes_on: streams
                .iter()
                .map(|stream| number(!begins(stream)))
                .collect(),
            // Less than a piece after the beginning of a sequence little was missed.
            scored: streams
                .iter()
                .map(|stream| number(!begins(stream) || stream[update].1 < length as u32))
                .collect(),
        }
    }
}

/// Learning rate of an update: from the first to the last along half a cosine.
fn rate(config: &Config, standing: &Standing) -> f64 {
    let high = (1.0 + (std::f64::consts::PI * standing.done(config.epochs)).cos()) / 2.0;
    config.rate * (config.final_rate + (1.0 - config.final_rate) * high)
}

fn error(loss: Loss, difference: Tensor<2>) -> Tensor<2> {
    match loss {
        Loss::Squared => difference.clone() * difference,
        Loss::Absolute => difference.abs(),
    }
}
