//! The forward pass in plain Rust: one row in, one force out, no framework and no allocation.

use std::collections::VecDeque;

use super::{
    layer::{folded, Layer},
    Reads,
};

/// The layers and what they remember.
pub(super) struct Runner {
    layers: Vec<Layer>,
    reads: Reads,
    /// Number of rows of a window.
    window: usize,
    /// The last rows, normalised, of a network that reads windows.
    past: VecDeque<Vec<f32>>,
    /// What each layer keeps from row to row.
    memory: Vec<Vec<f32>>,
    /// The values between two layers.
    values: [Vec<f32>; 2],
    scratch: Vec<f32>,
}

impl Runner {
    /// A runner at the beginning of a sequence.
    pub(super) fn new(layers: &[Layer], reads: Reads, window: usize, inputs: usize) -> Self {
        let layers = folded(layers);
        let widest = layers
            .iter()
            .map(Layer::outputs)
            .max()
            .unwrap_or(0)
            .max(inputs)
            * window.max(1);
        let scratch = layers
            .iter()
            .map(|layer| 6 * layer.memory())
            .max()
            .unwrap_or(0);
        Self {
            memory: layers
                .iter()
                .map(|layer| vec![0.0; layer.memory()])
                .collect(),
            layers,
            reads,
            window,
            past: VecDeque::with_capacity(window + 1),
            values: [Vec::with_capacity(widest), Vec::with_capacity(widest)],
            scratch: vec![0.0; scratch],
        }
    }

    /// Forgets the past.
    pub(super) fn reset(&mut self) {
        self.past.clear();
        self.clear_memory();
    }

    fn clear_memory(&mut self) {
        self.memory.iter_mut().for_each(|memory| memory.fill(0.0));
    }

    /// Takes a normalised row; returns the normalised force.
    pub(super) fn step(&mut self, row: &[f32]) -> &[f32] {
        if self.reads == Reads::Window {
            return self.step_window(row);
        }
        self.values[0].clear();
        self.values[0].extend_from_slice(row);
        self.recurrent();
        self.rest()
    }

    /// A window begins anew at each row: the recurrent layers run over all of it.
    fn step_window(&mut self, row: &[f32]) -> &[f32] {
        // Before the first row there was none: it stands for those before it.
        let mut oldest = if self.past.len() == self.window {
            self.past.pop_front().unwrap_or_default()
        } else {
            Vec::new()
        };
        oldest.clear();
        oldest.extend_from_slice(row);
        self.past.push_back(oldest);
        while self.past.len() < self.window {
            self.past.push_front(row.to_vec());
        }
        if matches!(self.layers[0], Layer::Convolution(_)) {
            self.values[0].clear();
            for at in 0..self.window {
                self.values[0].extend_from_slice(&self.past[at]);
            }
        } else {
            self.clear_memory();
            for at in 0..self.window {
                self.values[0].clear();
                self.values[0].extend_from_slice(&self.past[at]);
                self.recurrent();
            }
        }
        self.rest()
    }

    /// Runs the recurrent layers, which come first, on the row in `values[0]`, and leaves their
    /// output there.
    fn recurrent(&mut self) {
        for (layer, memory) in self.layers.iter().zip(&mut self.memory) {
            match layer {
                Layer::Gru(gru) => gru.step(&self.values[0], memory, &mut self.scratch),
                Layer::Lstm(lstm) => lstm.step(&self.values[0], memory, &mut self.scratch),
                _ => return,
            }
            self.values[0].clear();
            self.values[0].extend_from_slice(&memory[..layer.outputs()]);
        }
    }

    /// Runs the layers after the recurrent ones on `values[0]`.
    fn rest(&mut self) -> &[f32] {
        for layer in &self.layers {
            let [input, output] = &mut self.values;
            match layer {
                Layer::Dense(dense) => {
                    output.resize(layer.outputs(), 0.0);
                    dense.step(input, output);
                }
                Layer::Convolution(convolution) => {
                    output.resize(input.len() / convolution.weight.rows * layer.outputs(), 0.0);
                    convolution.step(input, output);
                }
                // Recurrent layers are done, normalisations are folded.
                _ => continue,
            }
            self.values.swap(0, 1);
        }
        &self.values[0]
    }
}
