//! A model with all that belongs to it: what it was trained on, rate, axes, robot, intervals.
//! Trained, stored, read, run.

use crate::baseline::{Constant, Linear};
use crate::geometry::Base;
use crate::interval::{error_n, HeldOut, Interval, Started};
pub use crate::kind::Kind;
use crate::misfit::TIMES;
pub use crate::model::Keep;
use crate::model::{Epochs, Model, ModelError, Progress, Stepper};
use crate::motion::{Motion, INPUTS, INPUT_NAMES};
use crate::physics::{Balance, Physics};
use crate::recalibration::Change;
use crate::sequence::Sequence;
use crate::stream::{Before, Breaks, Stream};
use crate::trees::{Boosted, StoredBoosted, TreesConfig, NO_BALANCE};
use robot::random::Random;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Layout of the file. Another one is refused, but see `KEPT`.
pub const SCHEMA: u32 = 3;
/// Older layouts, in which models without the physical one are the same.
const KEPT: core::ops::RangeInclusive<u32> = 1..=2;

/// What a training needs beside its rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Training {
    /// Model.
    pub kind: Kind,
    /// Components of the force that are estimated: 0 x, 1 y, 2 z.
    pub axes: Vec<usize>,
    /// Where the robot's base stands.
    pub base: Base,
    /// Name of the robot.
    pub robot: String,
    /// Trees.
    pub trees: TreesConfig,
    /// Networks.
    pub networks: NetworkLimits,
    /// Whether intervals are calibrated: the model is trained once more for each fold of trials.
    pub intervals: bool,
    /// Inputs that the log lacks, by their place in [`crate::motion::INPUT_NAMES`]; they are 0 in
    /// the sequences.
    pub absent: Vec<usize>,
}

/// How long networks are trained. Their layers, rates and batches are those of the thesis, or of
/// the small networks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NetworkLimits {
    /// Passes through the training rows; `None`: those of the settings (50 in the thesis).
    pub epochs: Option<usize>,
    /// Time after which no update begins, s.
    pub limit_s: Option<f64>,
    /// Whether an NVIDIA GPU trains them. Needs the feature `cuda`.
    pub gpu: bool,
    /// Where the training is kept after each epoch, if it is. Those of the folds for intervals are
    /// not.
    pub keep: Option<Keep>,
}

/// What a recalibration on free motion has found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Recalibration {
    /// RMS of the estimated force before it, N: there was none.
    pub before_n: f64,
    /// The same after it.
    pub after_n: f64,
    /// Mean half width of the interval in this log before it and after it, N; `None`: the model has
    /// no intervals.
    pub half_widths_n: Option<[f64; 2]>,
    /// What has changed, by motor.
    pub changes: [Change; 3],
    /// A constant force on the tool that explains what the changes do not, N; `None`: it shows
    /// none. Another tool has another weight, which looks the same.
    pub force_n: Option<[f64; 3]>,
}

/// Most folds of trials for intervals: with up to this many trials each is held out alone, so that
/// a fold's model has nearly the training of the whole one.
const FOLDS: usize = 8;

/// See the module's page.
#[derive(Debug)]
pub struct Estimator {
    /// Model.
    pub kind: Kind,
    /// Robot.
    pub robot: String,
    /// Components.
    pub axes: Vec<usize>,
    /// Time between rows, s.
    pub step_s: f64,
    /// Robot's base.
    pub base: Base,
    /// Intervals, where they were calibrated.
    pub interval: Option<Interval>,
    /// Intervals of a model that knows what has changed of its robot: what is left beside
    /// what a recalibration has left unknown.
    pub told: Option<Interval>,
    /// Inputs without which it was trained, by their place in [`crate::motion::INPUT_NAMES`].
    pub absent: Vec<usize>,
    model: Body,
}

/// Inputs that a model does not know. See [`Estimator::fit_inputs`].
#[derive(Debug, Clone)]
pub struct Hold(Vec<usize>);

impl Hold {
    /// Sets them to 0 in rows of [`INPUTS`] values.
    pub fn apply(&self, rows: &mut [f32]) {
        for row in rows.chunks_exact_mut(INPUTS) {
            for input in &self.0 {
                row[*input] = 0.0;
            }
        }
    }
}

enum Body {
    Constant(Constant),
    Linear(Linear),
    Physics(Box<Physics>),
    Boosted(Box<Boosted>),
    #[cfg(feature = "networks")]
    Neural(Box<crate::neural::Neural>),
}

impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Body")
    }
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StoredBody {
    Constant(Constant),
    Linear(Linear),
    Physics(Box<Physics>),
    Boosted(Box<StoredBoosted>),
    Neural(serde_json::Value),
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    schema: u32,
    kind: Kind,
    robot: String,
    axes: Vec<usize>,
    step_s: f64,
    base: Base,
    interval: Option<Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    told: Option<Interval>,
    #[serde(default)]
    absent: Vec<usize>,
    model: StoredBody,
}

/// Sequences whose targets are these components alone.
fn selected(sequences: &[&Sequence], axes: &[usize]) -> Vec<Sequence> {
    sequences.iter().map(|s| s.with_axes(axes)).collect()
}

#[cfg(feature = "networks")]
fn neural(
    training: &Training,
    sequences: &[&Sequence],
    keep: Option<&Keep>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Body, ModelError> {
    use crate::network::{Backend, Config, Kind as Net};
    let kind = match training.kind {
        Kind::Gru => Net::Gru,
        Kind::Lstm => Net::Lstm,
        Kind::Convolution => Net::Convolution,
        Kind::CarriedGru => Net::CarriedGru,
        _ => Net::Mlp,
    };
    let thesis = Config::thesis(kind);
    let limits = &training.networks;
    let config = Config {
        epochs: limits.epochs.unwrap_or(thesis.epochs),
        limit_s: limits.limit_s,
        seed: training.trees.seed,
        backend: if limits.gpu {
            Backend::Cuda
        } else {
            Backend::Cpu
        },
        ..thesis
    };
    let (base, axes) = (training.base, &training.axes);
    let neural = crate::neural::Neural::train(&config, base, axes, sequences, keep, progress)?;
    Ok(Body::Neural(Box::new(neural)))
}

#[cfg(not(feature = "networks"))]
fn neural(
    _: &Training,
    _: &[&Sequence],
    _: Option<&Keep>,
    _: &mut dyn FnMut(&Progress),
) -> Result<Body, ModelError> {
    Err(ModelError::Data(NOT_BUILT.to_owned()))
}

/// What to do without the feature.
#[cfg(not(feature = "networks"))]
const NOT_BUILT: &str =
    "this program was built without neural networks: build it with `--features networks`";

fn body(
    training: &Training,
    sequences: &[&Sequence],
    keep: Option<&Keep>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Body, ModelError> {
    let physics = || Physics::train(training.base, sequences, &training.axes);
    Ok(match training.kind {
        Kind::Zero => Body::Constant(Constant::zero(training.axes.len())),
        Kind::Mean | Kind::Linear => {
            let selected = selected(sequences, &training.axes);
            let refs: Vec<&Sequence> = selected.iter().collect();
            if training.kind == Kind::Mean {
                Body::Constant(Constant::mean(&refs)?)
            } else {
                Body::Linear(Linear::train(&refs)?)
            }
        }
        Kind::Physics => Body::Physics(Box::new(physics()?)),
        Kind::Trees => Body::Boosted(Box::new(Boosted::train(
            physics()?,
            false,
            &training.trees,
            sequences,
        )?)),
        Kind::Hybrid => Body::Boosted(Box::new(Boosted::train(
            physics()?,
            true,
            &training.trees,
            sequences,
        )?)),
        Kind::Mlp | Kind::Gru | Kind::Lstm | Kind::Convolution | Kind::CarriedGru => {
            neural(training, sequences, keep, progress)?
        }
    })
}

impl Body {
    fn model(&self) -> &dyn Model {
        match self {
            Self::Constant(m) => m,
            Self::Linear(m) => m,
            Self::Physics(m) => m.as_ref(),
            Self::Boosted(m) => m.as_ref(),
            #[cfg(feature = "networks")]
            Self::Neural(m) => m.as_ref(),
        }
    }
}

impl Estimator {
    /// Trains on sequences with the force's three components as targets.
    ///
    /// # Errors
    /// [`ModelError::Data`]: too few rows or trials, an axis that does not exist.
    pub fn train(
        training: &Training,
        sequences: &[&Sequence],
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Self, ModelError> {
        let Some(first) = sequences.first() else {
            return Err(ModelError::Data("no training rows".to_owned()));
        };
        if training.axes.is_empty() || training.axes.iter().any(|a| *a > 2) {
            return Err(ModelError::Data(
                "axes of the force are 0 (x), 1 (y), 2 (z)".to_owned(),
            ));
        }
        if training.intervals {
            // Now, and not after the minutes of the first training.
            folds(sequences)?;
        }
        progress(&Progress {
            done: 0.0,
            text: format!(
                "training `{}` on {} stretches",
                training.kind.name(),
                sequences.len()
            ),
        });
        let keep = training.networks.keep.as_ref();
        let model = body(training, sequences, keep, progress)?;
        let mut estimator = Self {
            kind: training.kind,
            robot: training.robot.clone(),
            axes: training.axes.clone(),
            step_s: first.step_s,
            base: training.base,
            interval: None,
            told: None,
            absent: training.absent.clone(),
            model,
        };
        if training.intervals {
            (estimator.interval, estimator.told) = calibrated(training, sequences, progress)?;
        }
        Ok(estimator)
    }

    /// Calibrates intervals on folds of the training: the model is trained once more for each.
    ///
    /// # Errors
    /// Fewer than two trials.
    pub fn calibrate(
        &mut self,
        training: &Training,
        sequences: &[&Sequence],
    ) -> Result<(), ModelError> {
        (self.interval, self.told) = calibrated(training, sequences, &mut |_| {})?;
        Ok(())
    }

    /// Adapts the model to what has changed of its robot, on a log of free motion: no force is on
    /// the tool.
    ///
    /// # Errors
    /// The model has no torque balance, the log does not tell the state of the friction, or its
    /// changes are none of a robot.
    pub fn recalibrate(&mut self, free: &[&Sequence]) -> Result<Recalibration, ModelError> {
        let (before_n, half_before) = self.without_force(free);
        let (changes, force_n) = match &mut self.model {
            Body::Physics(physics) => physics.recalibrate(free)?,
            Body::Boosted(boosted) => boosted.recalibrate(free)?,
            _ => return Err(ModelError::Data(NO_BALANCE.to_owned())),
        };
        let (after_n, half_after) = self.without_force(free);
        Ok(Recalibration {
            before_n,
            after_n,
            half_widths_n: half_before.zip(half_after).map(<[f64; 2]>::from),
            changes,
            force_n,
        })
    }

    /// See [`Physics::balances`].
    ///
    /// # Errors
    /// The model has no balance.
    pub fn balances(&self, sequence: &Sequence) -> Result<Vec<[Balance; 3]>, ModelError> {
        match &self.model {
            Body::Physics(physics) => Ok(physics.balances(sequence)),
            Body::Boosted(boosted) => boosted.balances(sequence),
            _ => Err(ModelError::Data(NO_BALANCE.to_owned())),
        }
    }

    /// RMS of the valid estimates and mean half width of their intervals, N.
    fn without_force(&self, sequences: &[&Sequence]) -> (f64, Option<f64>) {
        let mut stream = Stream::new(self);
        let (mut square, mut half, mut rows) = (0.0, Some(0.0), 0_usize);
        for sequence in sequences {
            stream.reset();
            for k in 0..sequence.rows() {
                let sure = stream.step(sequence.input_row(k));
                if sure.valid {
                    let force = stream.force().iter();
                    square += force.map(|f| f64::from(*f).powi(2)).sum::<f64>();
                    half = half.zip(sure.half_n).map(|(sum, half)| sum + half);
                    rows += 1;
                }
            }
        }
        let rows = rows.max(1) as f64;
        ((square / rows).sqrt(), half.map(|half| half / rows))
    }

    /// The intervals that hold now: a recalibration has told what has changed of the robot, or none
    /// has.
    #[must_use]
    pub fn interval_now(&self) -> Option<&Interval> {
        let recalibrated = match &self.model {
            Body::Physics(physics) => physics.recalibrated(),
            Body::Boosted(boosted) => boosted.recalibrated(),
            _ => false,
        };
        let told = self.told.as_ref().filter(|_| recalibrated);
        told.or(self.interval.as_ref())
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &dyn Model {
        self.model.model()
    }

    /// How far the training of a network went; `None` for the other models.
    #[must_use]
    pub fn epochs(&self) -> Option<Epochs> {
        match &self.model {
            #[cfg(feature = "networks")]
            Body::Neural(neural) => Some(neural.network().trained()),
            _ => None,
        }
    }

    /// Brings rows of inputs to those of the training: what the model was trained without is 0.
    /// `absent`: inputs that the rows lack.
    ///
    /// # Errors
    /// [`ModelError::Data`]: the rows lack an input that the model was trained with.
    pub fn fit_inputs(&self, absent: &[usize]) -> Result<Hold, ModelError> {
        let missing: Vec<&str> = absent
            .iter()
            .filter(|input| !self.absent.contains(input))
            .map(|input| INPUT_NAMES[*input])
            .collect();
        if missing.is_empty() {
            return Ok(Hold(self.absent.clone()));
        }
        Err(ModelError::Data(format!(
            "the model was trained with {}, which these data lack: train a model without (the same `absent = true` in the mapping file of the training)",
            missing.join(", ")
        )))
    }

    /// Writes a network as ONNX: its own inputs (see the module `neural`) to forces, both in SI
    /// units.
    ///
    /// # Errors
    /// It is no network, or the file can't be written.
    pub fn write_onnx(&self, path: &std::path::Path) -> Result<(), ModelError> {
        #[cfg(feature = "networks")]
        if let Body::Neural(neural) = &self.model {
            return neural.network().write_onnx(path);
        }
        Err(ModelError::Data(format!(
            "{}: the model `{}` is no neural network; ONNX is for networks alone",
            path.display(),
            self.kind.name()
        )))
    }

    /// What the file of [`Self::write_onnx`] reads and gives, as JSON for a file beside it. The
    /// hashes are those of both files.
    ///
    /// # Errors
    /// It is no network.
    pub fn onnx_card(&self, model_sha256: &str, onnx_sha256: &str) -> Result<String, ModelError> {
        #[cfg(feature = "networks")]
        if let Body::Neural(neural) = &self.model {
            let card = crate::neural::OnnxCard {
                model: self.kind.name().to_owned(),
                model_sha256: model_sha256.to_owned(),
                onnx_sha256: onnx_sha256.to_owned(),
                robot: self.robot.clone(),
                ..neural.onnx_card(&self.axes)
            };
            return serde_json::to_string_pretty(&card)
                .map_err(|error| ModelError::Stored(error.to_string()));
        }
        let _ = (model_sha256, onnx_sha256);
        Err(ModelError::Data(format!(
            "the model `{}` is no neural network; ONNX is for networks alone",
            self.kind.name()
        )))
    }

    /// As JSON.
    ///
    /// # Errors
    /// [`ModelError::Stored`].
    pub fn to_json(&self) -> Result<String, ModelError> {
        let model = match &self.model {
            Body::Constant(m) => StoredBody::Constant(m.clone()),
            Body::Linear(m) => StoredBody::Linear(m.clone()),
            Body::Physics(m) => StoredBody::Physics(m.clone()),
            Body::Boosted(m) => StoredBody::Boosted(Box::new(m.stored()?)),
            #[cfg(feature = "networks")]
            Body::Neural(m) => StoredBody::Neural(serde_json::json!(m.stored())),
        };
        let stored = Stored {
            schema: SCHEMA,
            kind: self.kind,
            robot: self.robot.clone(),
            axes: self.axes.clone(),
            step_s: self.step_s,
            base: self.base,
            interval: self.interval.clone(),
            told: self.told.clone(),
            absent: self.absent.clone(),
            model,
        };
        serde_json::to_string(&stored)
            .map_err(|error| ModelError::Stored(format!("the model cannot be written: {error}")))
    }

    /// From JSON.
    ///
    /// # Errors
    /// [`ModelError::Stored`]: no such file, or of another version.
    pub fn from_json(text: &str) -> Result<Self, ModelError> {
        #[derive(Deserialize)]
        struct Schema {
            schema: u32,
            #[serde(default)]
            kind: String,
        }
        let bad = |error: serde_json::Error| {
            ModelError::Stored(format!(
                "this is no model file of `forcectl estimate train`: {error}"
            ))
        };
        let Schema { schema, kind } = serde_json::from_str(text).map_err(bad)?;
        let physical = [Kind::Physics, Kind::Trees, Kind::Hybrid]
            .iter()
            .any(|k| k.name() == kind);
        if schema != SCHEMA && (physical || !KEPT.contains(&schema)) {
            return Err(ModelError::Stored(format!(
                "the model file has layout {schema}, this program reads layout {SCHEMA}: train the model again"
            )));
        }
        let stored: Stored = serde_json::from_str(text).map_err(bad)?;
        if !(1e-4..=1.0).contains(&stored.step_s)
            || stored.axes.is_empty()
            || stored.axes.iter().any(|a| *a > 2)
            || stored.absent.iter().any(|i| *i >= INPUTS)
        {
            return Err(ModelError::Stored(
                "the model file's rate, axes or inputs are impossible: train the model again"
                    .to_owned(),
            ));
        }
        let model = match stored.model {
            StoredBody::Constant(m) => Body::Constant(m),
            StoredBody::Linear(m) => Body::Linear(m),
            StoredBody::Physics(m) => Body::Physics(m),
            StoredBody::Boosted(m) => Body::Boosted(Box::new(Boosted::read(&m)?)),
            #[cfg(feature = "networks")]
            StoredBody::Neural(value) => {
                let inner = serde_json::from_value(value).map_err(bad)?;
                let neural = crate::neural::Neural::read(&inner, stored.base, stored.step_s)?;
                Body::Neural(Box::new(neural))
            }
            #[cfg(not(feature = "networks"))]
            StoredBody::Neural(_) => return Err(ModelError::Stored(NOT_BUILT.to_owned())),
        };
        Ok(Self {
            kind: stored.kind,
            robot: stored.robot,
            axes: stored.axes,
            step_s: stored.step_s,
            base: stored.base,
            interval: stored.interval,
            told: stored.told,
            absent: stored.absent,
            model,
        })
    }
}

/// Trials in order, and the number of folds for intervals.
fn folds(sequences: &[&Sequence]) -> Result<(Vec<usize>, usize), ModelError> {
    let trials: BTreeSet<usize> = sequences.iter().map(|s| s.trial).collect();
    let trials: Vec<usize> = trials.into_iter().collect();
    let folds = trials.len().min(FOLDS);
    if folds < 2 {
        return Err(ModelError::Data(format!(
            "intervals need at least two training trials, because one is held out at a time, and there is {trials:?} alone; give more trials or --no-intervals"
        )));
    }
    Ok((trials, folds))
}

/// Intervals from folds of trials, each estimated by a model that has not seen it; then those of
/// models that know what has changed of the robot in it, where they can.
fn calibrated(
    training: &Training,
    sequences: &[&Sequence],
    progress: &mut dyn FnMut(&Progress),
) -> Result<(Option<Interval>, Option<Interval>), ModelError> {
    let (trials, folds) = folds(sequences)?;
    let mut held_out = [Vec::new(), Vec::new()];
    let mut started = [Started::default(), Started::default()];
    for fold in 0..folds {
        progress(&Progress {
            done: (fold + 1) as f64 / (folds + 1) as f64,
            text: format!("intervals: fold {} of {folds}", fold + 1),
        });
        let held = |s: &Sequence| {
            trials
                .iter()
                .position(|t| *t == s.trial)
                .is_some_and(|p| p % folds == fold)
        };
        let rest: Vec<&Sequence> = sequences.iter().copied().filter(|s| !held(s)).collect();
        let body = body(training, &rest, None, progress)?;
        let model = body.model();
        for sequence in sequences.iter().filter(|s| held(s)) {
            for k in 0..2 {
                let stepper = || match k {
                    0 => Some((model.stepper(), 0)),
                    _ => model.told_stepper(sequence),
                };
                let (Some((whole, from)), Some((broken, _))) = (stepper(), stepper()) else {
                    continue;
                };
                held_out[k].push(held_out_of(model, whole, sequence, &training.axes, from));
                after_breaks(training, broken, sequence, from, &mut started[k]);
            }
        }
    }
    let fit = |k: usize| Interval::fit(&held_out[k], &started[k], training.base, &training.axes);
    // Where logs are too short to tell, the intervals are those of the others.
    Ok((Some(fit(0)?), fit(1).ok()))
}

/// Estimates of a model that has not seen the sequence, and its largest misfit.
fn held_out_of<'a>(
    model: &dyn Model,
    mut stepper: Box<dyn Stepper + '_>,
    sequence: &'a Sequence,
    axes: &[usize],
    from: usize,
) -> HeldOut<'a> {
    let mut predicted = vec![0.0; sequence.rows() * axes.len()];
    let mut unsure_n = Vec::new();
    let mut misfit: Option<[f64; TIMES]> = None;
    for (k, force) in predicted.chunks_exact_mut(axes.len()).enumerate() {
        stepper.step(sequence.input_row(k), force);
        let Some(fit) = stepper.fit() else {
            // It tells nothing of its fit, and many rows at once are faster for some.
            predicted = model.predict(sequence);
            break;
        };
        unsure_n.push(fit.unsure_n(axes));
        let most = misfit.unwrap_or_default();
        misfit = Some(core::array::from_fn(|k| most[k].max(fit.misfit[k])));
    }
    HeldOut {
        sequence,
        predicted,
        unsure_n,
        from,
        misfit,
    }
}

/// Rows of a sequence that are replayed with breaks at most: enough for a hundred of them, and slow
/// networks end in minutes.
const BROKEN_ROWS: usize = 15_000;

/// Rows after starts and gaps of a replay of a held-out sequence.
fn after_breaks(
    training: &Training,
    mut stepper: Box<dyn Stepper + '_>,
    sequence: &Sequence,
    from: usize,
    started: &mut Started,
) {
    let step_s = sequence.step_s;
    let rows = sequence.rows().min(BROKEN_ROWS);
    let mut random = Random::stream(training.trees.seed, "breaks", sequence.trial as u64);
    let breaks = Breaks::dense(rows, step_s, &mut random);
    let mut motion = Motion::new(step_s);
    let mut force = vec![0.0; training.axes.len()];
    for (k, before) in breaks.rows(rows, step_s, Before::Start) {
        match before {
            Before::Row => {}
            Before::Start => {
                stepper.reset();
                motion.reset();
            }
            Before::Gap(elapsed_s) => {
                stepper.gap(elapsed_s);
                motion.gap(elapsed_s);
            }
        }
        let input = sequence.input_row(k);
        stepper.step(input, &mut force);
        let moment = motion.step(input);
        if !moment.settled() && k >= from {
            let error_n = error_n(&force, sequence.target_row(k), &training.axes);
            let unsure_n = stepper
                .fit()
                .map_or(0.0, |fit| fit.unsure_n(&training.axes));
            started.push(moment, &training.base, error_n, unsure_n);
        }
    }
}
