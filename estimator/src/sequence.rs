//! Rows of trials in the form in which models read them: dense, in SI units, split into unbroken
//! pieces.

/// An unbroken stretch of one trial: rows at a constant rate without a gap.
///
/// Windows of a model never cross its ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// Which trial the rows are of. The unit of splits, of intervals and of conformal calibration.
    pub trial: usize,
    /// Time of the first row since the trial's start, s.
    pub start_s: f64,
    /// Time between rows, s.
    pub step_s: f64,
    /// Inputs, row after row: `rows() * inputs` values in SI units, all finite.
    pub input: Vec<f32>,
    /// Number of inputs in a row.
    pub inputs: usize,
    /// Targets, row after row: `rows() * targets` values, N, all finite.
    pub target: Vec<f32>,
    /// Number of targets in a row: 1 for a force along an axis, 3 for a vector.
    pub targets: usize,
}

impl Sequence {
    /// Number of rows.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.input.len() / self.inputs
    }

    /// The rows of the first `duration_s`; all where it has no more.
    #[must_use]
    pub fn beginning(&self, duration_s: f64) -> Self {
        let rows = ((duration_s / self.step_s).round() as usize).min(self.rows());
        Self {
            input: self.input[..rows * self.inputs].to_vec(),
            target: self.target[..rows * self.targets].to_vec(),
            ..*self
        }
    }

    /// Inputs of a row.
    ///
    /// # Panics
    ///
    /// If there is no such row.
    #[must_use]
    pub fn input_row(&self, row: usize) -> &[f32] {
        &self.input[row * self.inputs..(row + 1) * self.inputs]
    }

    /// Targets of a row, N.
    ///
    /// # Panics
    ///
    /// If there is no such row.
    #[must_use]
    pub fn target_row(&self, row: usize) -> &[f32] {
        &self.target[row * self.targets..(row + 1) * self.targets]
    }

    /// The same rows with these components of the target alone.
    ///
    /// # Panics
    ///
    /// If there is no such component.
    #[must_use]
    pub fn with_axes(&self, axes: &[usize]) -> Self {
        let target = self
            .target
            .chunks_exact(self.targets)
            .flat_map(|row| axes.iter().map(|a| row[*a]))
            .collect();
        Self {
            target,
            targets: axes.len(),
            ..self.clone()
        }
    }
}
