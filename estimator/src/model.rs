//! What every model of the contact force does: learn from sequences, then turn rows into forces,
//! one at a time and causally.

use crate::misfit::TIMES;
use crate::sequence::Sequence;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Why a model could not be trained, stored or read.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The training data can't be used; the text says why and what to do.
    #[error("{0}")]
    Data(String),
    /// A stored model can't be read; the text says where and why.
    #[error("{0}")]
    Stored(String),
}

/// How far the training of a network went.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Epochs {
    /// Passes through the training rows. The last one may be a part: 0.4 is a training that ended
    /// within its first pass.
    pub done: f64,
    /// Passes that were asked for.
    pub wanted: usize,
    /// Whether the time limit ended the training before them.
    pub cut: bool,
}

impl fmt::Display for Epochs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Two digits, and none after the point for whole passes.
        let done = (100.0 * self.done).round() / 100.0;
        write!(f, "{done} of {}", self.wanted)
    }
}

/// The file that keeps a network's training after each epoch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keep {
    /// File.
    pub file: std::path::PathBuf,
    /// Whether the training goes on from it.
    pub resume: bool,
}

/// What a training reports while it goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Share of the work that is done, 0 to 1.
    pub done: f64,
    /// One line for people: epoch, loss, time left.
    pub text: String,
}

/// A trained model.
pub trait Model: Send {
    /// Force of every row of a sequence, N: `rows * targets` values.
    ///
    /// Row `k` depends on the rows up to `k` alone. Rows before a model's window is full use what
    /// there is.
    fn predict(&self, sequence: &Sequence) -> Vec<f32>;

    /// Number of trained parameters.
    fn parameters(&self) -> usize;

    /// An estimator for a live stream: one row in, one force out.
    fn stepper(&self) -> Box<dyn Stepper + '_>;

    /// The same for the rows of a log with a measured force, from its first one on, by a model that
    /// knows what has changed of the robot in it: the measured force has told, of a robot that
    /// changes by all rows, of another one by those of the first minute. Gives the first row that
    /// has not told. Rows that are missing are those of a gap; a reset forgets the motion alone.
    /// `None`: the model knows no changes, or the log is too short.
    fn told_stepper(&self, sequence: &Sequence) -> Option<(Box<dyn Stepper + '_>, usize)> {
        let _ = sequence;
        None
    }
}

/// How a model fits its robot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Fit {
    /// How far the motors' balances are from what any force could do to them, in units of their
    /// noise: see [`crate::misfit`].
    pub misfit: [f64; TIMES],
    /// Standard deviation of the components of the force by what a recalibration has left unknown,
    /// N.
    pub unsure_n: [f64; 3],
}

impl Fit {
    /// Standard deviation of the length of these components of the force by what a recalibration
    /// has left unknown, N.
    #[must_use]
    pub fn unsure_n(&self, axes: &[usize]) -> f64 {
        axes.iter()
            .map(|a| self.unsure_n[*a].powi(2))
            .sum::<f64>()
            .sqrt()
    }
}

/// A model on a live stream.
pub trait Stepper {
    /// Takes the inputs of the next row, SI units, and writes the force, N.
    fn step(&mut self, input: &[f32], force: &mut [f32]);

    /// Forgets the past: the next row begins a sequence.
    fn reset(&mut self);

    /// The next row comes `elapsed_s` after the one before it, because rows are missing between
    /// them. A model that cannot go on over a gap forgets the past.
    fn gap(&mut self, elapsed_s: f64) {
        let _ = elapsed_s;
        self.reset();
    }

    /// How the model fits its robot at the last row; `None`: it cannot tell.
    fn fit(&self) -> Option<Fit> {
        None
    }
}

/// Forces of a sequence by steps from its start: `rows * targets` values.
pub fn by_steps(
    mut stepper: Box<dyn Stepper + '_>,
    sequence: &Sequence,
    targets: usize,
) -> Vec<f32> {
    let mut out = vec![0.0; sequence.rows() * targets];
    for (k, force) in out.chunks_exact_mut(targets).enumerate() {
        stepper.step(sequence.input_row(k), force);
    }
    out
}
