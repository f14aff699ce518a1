//! Training data as networks read it: normalised rows, the windows that end at them, the streams
//! through them.
//!
//! Neither windows nor streams cross the end of a sequence.

use rand::{seq::SliceRandom, RngExt};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::{model::ModelError, sequence::Sequence};

/// Mean and deviation of the training rows, by input and by target, in their units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scaling {
    /// Mean of each input.
    pub input_mean: Vec<f32>,
    /// Deviation of each input. 1 for an input that doesn't change.
    pub input_deviation: Vec<f32>,
    /// Mean of each target, N.
    pub target_mean: Vec<f32>,
    /// Deviation of each target, N. 1 for a target that doesn't change.
    pub target_deviation: Vec<f32>,
}

impl Scaling {
    /// Of these sequences, which have rows and the same numbers of inputs and targets.
    pub(super) fn of(sequences: &[Sequence]) -> Self {
        let (input_mean, input_deviation) = moments(sequences[0].inputs, || {
            sequences.iter().map(|one| &one.input[..])
        });
        let (target_mean, target_deviation) = moments(sequences[0].targets, || {
            sequences.iter().map(|one| &one.target[..])
        });
        Self {
            input_mean,
            input_deviation,
            target_mean,
            target_deviation,
        }
    }

    /// A row of inputs without unit.
    pub(super) fn input(&self, row: &[f32], normal: &mut [f32]) {
        assert_eq!(row.len(), self.input_mean.len(), "inputs of a row");
        for (at, normal) in normal.iter_mut().enumerate() {
            *normal = (row[at] - self.input_mean[at]) / self.input_deviation[at];
        }
    }

    /// Forces, N, of outputs without unit.
    pub(super) fn force(&self, normal: &[f32], force: &mut [f32]) {
        for (at, force) in force.iter_mut().enumerate() {
            *force = normal[at] * self.target_deviation[at] + self.target_mean[at];
        }
    }
}

/// Mean and deviation of each column.
fn moments<'a, I: Iterator<Item = &'a [f32]>>(
    columns: usize,
    values: impl Fn() -> I,
) -> (Vec<f32>, Vec<f32>) {
    let rows: usize = values().map(|values| values.len() / columns).sum();
    let column = |at: usize, of: &dyn Fn(f64) -> f64| -> f64 {
        values()
            .flat_map(|values| values.iter().skip(at).step_by(columns))
            .map(|&value| of(f64::from(value)))
            .sum::<f64>()
            / rows as f64
    };
    (0..columns)
        .map(|at| {
            let mean = column(at, &|value| value);
            let deviation = column(at, &|value| (value - mean).powi(2)).sqrt();
            // Rounding gives a constant a deviation of some 1e-8 of its value.
            let constant = deviation <= 1e-6 * mean.abs() || deviation == 0.0;
            (mean as f32, if constant { 1.0 } else { deviation as f32 })
        })
        .unzip()
}

/// Refuses sequences of other widths or another rate, and values that are not finite.
pub(super) fn check(
    sequences: &[Sequence],
    inputs: usize,
    targets: usize,
    step_s: f64,
) -> Result<(), ModelError> {
    for sequence in sequences {
        let refuse = |text: String| {
            Err(ModelError::Data(format!(
                "trial {} from {:.3} s on: {text}",
                sequence.trial, sequence.start_s
            )))
        };
        if sequence.inputs != inputs || sequence.targets != targets {
            return refuse(format!(
                "{} inputs and {} targets a row, not {inputs} and {targets}: give the columns of the training data",
                sequence.inputs, sequence.targets
            ));
        }
        if inputs == 0
            || targets == 0
            || sequence.input.len() % inputs != 0
            || sequence.target.len() != sequence.rows() * targets
        {
            return refuse(format!(
                "{} input and {} target values are not whole rows of {inputs} and {targets}",
                sequence.input.len(),
                sequence.target.len()
            ));
        }
        if (sequence.step_s / step_s - 1.0).abs() > 1e-3 {
            return refuse(format!(
                "rows every {} s, not every {step_s} s: resample them to the rate of the training data",
                sequence.step_s
            ));
        }
        let bad = |values: &[f32], width: usize| {
            values
                .iter()
                .position(|value| !value.is_finite())
                .map(|at| (at / width, at % width, values[at]))
        };
        if let Some((row, column, value)) = bad(&sequence.input, inputs) {
            return refuse(format!(
                "row {row}, input {column} is {value}: remove the row and split the sequence there"
            ));
        }
        if let Some((row, column, value)) = bad(&sequence.target, targets) {
            return refuse(format!("row {row}, target {column} is {value}: remove the row and split the sequence there"));
        }
    }
    Ok(())
}

/// Normalised sequences.
pub(super) struct Rows {
    sequences: Vec<(Vec<f32>, Vec<f32>)>,
    inputs: usize,
    targets: usize,
}

/// A row: number of the sequence, number of the row in it.
pub(super) type At = (u32, u32);

impl Rows {
    /// Normalises sequences.
    pub(super) fn new(sequences: &[Sequence], scaling: &Scaling) -> Self {
        let (inputs, targets) = (scaling.input_mean.len(), scaling.target_mean.len());
        let normal = |values: &[f32], mean: &[f32], deviation: &[f32]| -> Vec<f32> {
            let scale = mean.iter().zip(deviation).cycle();
            values
                .iter()
                .zip(scale)
                .map(|(value, (mean, deviation))| (value - mean) / deviation)
                .collect()
        };
        let sequences = (sequences.iter())
            .map(|one| {
                (
                    normal(&one.input, &scaling.input_mean, &scaling.input_deviation),
                    normal(&one.target, &scaling.target_mean, &scaling.target_deviation),
                )
            })
            .collect();
        Self {
            sequences,
            inputs,
            targets,
        }
    }

    /// Rows at which a whole window ends.
    pub(super) fn ends(&self, window: usize) -> Vec<At> {
        let rows = |inputs: &[f32]| inputs.len() / self.inputs;
        (self.sequences.iter().enumerate())
            .flat_map(|(at, (inputs, _))| {
                (window - 1..rows(inputs)).map(move |row| (at as u32, row as u32))
            })
            .collect()
    }

    /// Rows at which a whole window ends, in a random order.
    pub(super) fn shuffled(&self, window: usize, random: &mut ChaCha8Rng) -> Vec<At> {
        let mut ends = self.ends(window);
        ends.shuffle(random);
        ends
    }

    /// Inputs of these rows, one after the other. A row before the first of its sequence is the
    /// first.
    pub(super) fn inputs_before(&self, ends: &[At], back: usize, into: &mut Vec<f32>) {
        for &(sequence, row) in ends {
            let row = (row as usize).saturating_sub(back);
            into.extend_from_slice(
                &self.sequences[sequence as usize].0[row * self.inputs..(row + 1) * self.inputs],
            );
        }
    }

    /// Windows that end at these rows, one after the other, the oldest row first.
    pub(super) fn windows(&self, ends: &[At], window: usize, into: &mut Vec<f32>) {
        for end in ends {
            for back in (0..window).rev() {
                self.inputs_before(std::slice::from_ref(end), back, into);
            }
        }
    }

    /// Targets of these rows, one after the other.
    pub(super) fn targets(&self, rows: &[At], into: &mut Vec<f32>) {
        for &(sequence, row) in rows {
            let row = row as usize;
            into.extend_from_slice(
                &self.sequences[sequence as usize].1[row * self.targets..(row + 1) * self.targets],
            );
        }
    }

    /// Streams through all rows: pieces of `length` rows, in time's order within a stream.
    ///
    /// The pieces begin at a random row of each sequence, new at each call, so that they don't
    /// always end at the same rows. Fewer streams than asked for where there are fewer pieces. All
    /// streams have as many pieces; rows left over are not used.
    pub(super) fn streams(
        &self,
        streams: usize,
        length: usize,
        random: &mut ChaCha8Rng,
    ) -> Vec<Vec<At>> {
        let mut pieces = Vec::new();
        for (at, (inputs, _)) in self.sequences.iter().enumerate() {
            let rows = inputs.len() / self.inputs;
            let offset = random.random_range(0..=rows % length);
            pieces.extend(
                (0..(rows.saturating_sub(offset)) / length)
                    .map(|piece| (at as u32, (offset + piece * length) as u32)),
            );
        }
        let each = (pieces.len() / streams).max(1);
        pieces
            .chunks_exact(each)
            .take(streams)
            .map(<[At]>::to_vec)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn sequence(trial: usize, rows: usize) -> Sequence {
        Sequence {
            trial,
            start_s: 0.0,
            step_s: 0.02,
            input: (0..rows)
                .flat_map(|row| [(100 * trial + row) as f32, 7.0])
                .collect(),
            inputs: 2,
            target: (0..rows).map(|row| row as f32).collect(),
            targets: 1,
        }
    }

    fn plain() -> Scaling {
        Scaling {
            input_mean: vec![0.0; 2],
            input_deviation: vec![1.0; 2],
            target_mean: vec![0.0],
            target_deviation: vec![1.0],
        }
    }

    /// A window that crossed the end of a trial would hold values of two trials.
    #[test]
    fn windows_stay_in_their_trial() {
        let rows = Rows::new(
            &[sequence(1, 10), sequence(2, 3), sequence(3, 12)],
            &plain(),
        );
        let ends = rows.ends(4);
        assert_eq!(
            ends.len(),
            7 + 9,
            "the second trial is shorter than a window"
        );
        let mut windows = Vec::new();
        rows.windows(&ends, 4, &mut windows);
        for window in windows.chunks_exact(8) {
            let first = window[0];
            let values: Vec<f32> = window.iter().step_by(2).copied().collect();
            assert_eq!(values, [first, first + 1.0, first + 2.0, first + 3.0]);
        }
    }

    #[test]
    fn rows_before_the_first_are_the_first() {
        let rows = Rows::new(&[sequence(1, 10)], &plain());
        let mut window = Vec::new();
        rows.windows(&[(0, 1)], 4, &mut window);
        assert_eq!(
            window.iter().step_by(2).copied().collect::<Vec<_>>(),
            [100.0, 100.0, 100.0, 101.0]
        );
    }

    #[test]
    fn streams_go_on_in_time_and_stay_in_their_trial() {
        let rows = Rows::new(&[sequence(1, 107), sequence(2, 55)], &plain());
        let streams = rows.streams(3, 10, &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(streams.len(), 3);
        for stream in &streams {
            assert_eq!(stream.len(), 5);
            for pair in stream.windows(2) {
                assert!(
                    pair[1].0 != pair[0].0 || pair[1].1 == pair[0].1 + 10,
                    "{pair:?}"
                );
            }
            assert!(stream
                .iter()
                .all(|&(at, row)| row as usize + 10 <= [107, 55][at as usize]));
        }
    }

    #[test]
    fn a_constant_input_is_not_blown_up() {
        let scaling = Scaling::of(&[sequence(0, 50)]);
        assert_eq!(scaling.input_deviation[1].to_bits(), 1.0f32.to_bits());
        assert!((scaling.input_deviation[0] - 14.431).abs() < 1e-3);
        assert!((scaling.input_mean[0] - 24.5).abs() < 1e-3);
    }
}
