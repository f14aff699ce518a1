//! The model: 120 weights on the regressors of [`crate::features`], also as a live estimator.

use crate::data::{Row, Run};
use crate::features::{Features, FEATURES};
use crate::protocol::{inputs, Inputs, Scored};
use crate::sums::Sums;
use estimator::model::{Model, Stepper};
use estimator::sequence::Sequence;
use nalgebra::DVector;

/// Torque at the jaw from current and positions.
///
/// Inputs of a sequence: current, A; spindle, rad; motor divided by the gear's ratio, rad; 1 kHz.
/// Target: torque, mN·m.
#[derive(Debug, Clone, PartialEq)]
pub struct Bilinear {
    weights: DVector<f64>,
}

impl Bilinear {
    /// A model with these weights.
    ///
    /// # Panics
    /// If there are not [`FEATURES`] of them.
    #[must_use]
    pub fn new(weights: DVector<f64>) -> Self {
        assert_eq!(weights.len(), FEATURES, "one weight per regressor");
        Self { weights }
    }

    /// Torque of a row of regressors, mN·m.
    #[must_use]
    pub fn value(&self, regressors: &[f64; FEATURES]) -> f64 {
        self.weights
            .iter()
            .zip(regressors)
            .map(|(w, x)| w * x)
            .sum()
    }

    /// Its weights.
    #[must_use]
    pub const fn weights(&self) -> &DVector<f64> {
        &self.weights
    }
}

/// Calls for each scored row with its regressors and its truth, mN·m.
pub fn for_each_row(run: &Run, scored: &Scored, how: Inputs, mut take: impl FnMut(&Features, f64)) {
    let mut features = Features::new();
    let mut next = scored.rows.iter().zip(&scored.truth_mnm).peekable();
    for (number, row) in inputs(run, how).into_iter().enumerate() {
        features.push(row);
        if let Some((_, truth)) = next.next_if(|(at, _)| **at == number) {
            take(&features, *truth);
        }
    }
}

/// Sums over the scored rows of a run.
#[must_use]
pub fn sums(run: &Run, scored: &Scored, how: Inputs) -> Sums {
    let mut regressors = Vec::with_capacity(scored.rows.len() * FEATURES);
    for_each_row(run, scored, how, |features, _| {
        regressors.extend(features.row())
    });
    Sums::of(FEATURES, &regressors, &scored.truth_mnm)
}

impl Model for Bilinear {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        let mut stepper = self.stepper();
        let mut out = vec![0.0; sequence.rows()];
        for (row, torque) in out.iter_mut().enumerate() {
            stepper.step(sequence.input_row(row), std::slice::from_mut(torque));
        }
        out
    }

    fn parameters(&self) -> usize {
        self.weights.len()
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(Live {
            model: self,
            features: Features::new(),
        })
    }
}

/// The model on a stream.
struct Live<'a> {
    model: &'a Bilinear,
    features: Features,
}

impl Stepper for Live<'_> {
    fn step(&mut self, input: &[f32], force: &mut [f32]) {
        self.features.push(Row {
            current_a: f64::from(input[0]),
            spindle_rad: f64::from(input[1]),
            motor_rad: f64::from(input[2]),
        });
        force[0] = self.model.value(&self.features.row()) as f32;
    }

    fn reset(&mut self) {
        self.features = Features::new();
    }
}
