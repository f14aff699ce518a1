//! Baselines: a constant force, and a linear map of filtered inputs. What a model adds is what it
//! adds to these.

use crate::model::{by_steps, Model, ModelError, Stepper};
use crate::motion::{LowPass, FILTER_S};
use crate::ridge::{Ridge, Sums};
use crate::sequence::Sequence;
use serde::{Deserialize, Serialize};

/// The same force always: 0, or the mean of the training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Constant {
    force_n: Vec<f32>,
    trained: bool,
}

impl Constant {
    /// No force.
    #[must_use]
    pub fn zero(targets: usize) -> Self {
        Self {
            force_n: vec![0.0; targets],
            trained: false,
        }
    }

    /// The mean force of the sequences.
    ///
    /// # Errors
    /// No rows.
    pub fn mean(sequences: &[&Sequence]) -> Result<Self, ModelError> {
        let targets = sequences.first().map_or(1, |s| s.targets);
        let rows: usize = sequences.iter().map(|s| s.rows()).sum();
        if rows == 0 {
            return Err(ModelError::Data("no training rows".to_owned()));
        }
        let mut sum = vec![0.0_f64; targets];
        for value in sequences
            .iter()
            .flat_map(|s| s.target.chunks_exact(targets))
        {
            for (sum, v) in sum.iter_mut().zip(value) {
                *sum += f64::from(*v);
            }
        }
        Ok(Self {
            force_n: sum.iter().map(|s| (s / rows as f64) as f32).collect(),
            trained: true,
        })
    }
}

impl Model for Constant {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        self.force_n.repeat(sequence.rows())
    }

    fn parameters(&self) -> usize {
        if self.trained {
            self.force_n.len()
        } else {
            0
        }
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(ConstantStepper(&self.force_n))
    }
}

struct ConstantStepper<'a>(&'a [f32]);

impl Stepper for ConstantStepper<'_> {
    fn step(&mut self, _: &[f32], force: &mut [f32]) {
        force.copy_from_slice(self.0);
    }

    fn reset(&mut self) {}
}

/// A linear map of the filtered inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Linear {
    step_s: f64,
    map: Ridge,
}

/// First-order filters of all inputs.
#[derive(Debug, Clone)]
pub struct Smooth {
    filters: Vec<LowPass>,
    step_s: f64,
    row: Vec<f64>,
}

impl Smooth {
    /// Filters with the time constant of [`FILTER_S`] for rows of `inputs` values.
    #[must_use]
    pub fn new(inputs: usize, step_s: f64) -> Self {
        Self {
            filters: vec![LowPass::new(FILTER_S, step_s); inputs],
            step_s,
            row: vec![0.0; inputs],
        }
    }

    /// Takes a row, gives the filtered one.
    pub fn step(&mut self, input: &[f32]) -> &[f64] {
        for ((out, filter), x) in self.row.iter_mut().zip(&mut self.filters).zip(input) {
            *out = filter.step(f64::from(*x));
        }
        &self.row
    }

    fn reset(&mut self) {
        *self = Self::new(self.filters.len(), self.step_s);
    }
}

impl Linear {
    /// Least squares.
    ///
    /// # Errors
    /// Too few rows.
    pub fn train(sequences: &[&Sequence]) -> Result<Self, ModelError> {
        let Some(first) = sequences.first() else {
            return Err(ModelError::Data("no training rows".to_owned()));
        };
        let mut sums = Sums::new(first.inputs, first.targets);
        let mut target = vec![0.0; first.targets];
        for sequence in sequences {
            let mut smooth = Smooth::new(sequence.inputs, sequence.step_s);
            for k in 0..sequence.rows() {
                for (to, from) in target.iter_mut().zip(sequence.target_row(k)) {
                    *to = f64::from(*from);
                }
                sums.push(smooth.step(sequence.input_row(k)), &target);
            }
        }
        let map = sums.solve().ok_or_else(|| {
            ModelError::Data(format!(
                "too few rows for the linear model: it needs more than {}",
                first.inputs
            ))
        })?;
        Ok(Self {
            step_s: first.step_s,
            map,
        })
    }
}

impl Model for Linear {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        by_steps(self.stepper(), sequence, self.map.targets())
    }

    fn parameters(&self) -> usize {
        self.map.parameters()
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(LinearStepper {
            model: self,
            smooth: Smooth::new(self.map.regressors(), self.step_s),
        })
    }
}

struct LinearStepper<'a> {
    model: &'a Linear,
    smooth: Smooth,
}

impl Stepper for LinearStepper<'_> {
    fn step(&mut self, input: &[f32], force: &mut [f32]) {
        let row = self.smooth.step(input);
        for (k, out) in force.iter_mut().enumerate() {
            *out = self.model.map.value(k, row) as f32;
        }
    }

    fn reset(&mut self) {
        self.smooth.reset();
    }
}
