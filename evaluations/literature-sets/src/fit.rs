//! Least squares: what is left of a signal after the best fit of given columns.

/// An orthonormal basis of the columns of a declared model.
#[derive(Clone, Debug, Default)]
pub struct Basis(Vec<Vec<f64>>);

impl Basis {
    /// The basis of these columns, all of one length, by Gram-Schmidt with a second pass. A column
    /// that depends on the others (less than 1e-9 of it is new) is left out.
    pub fn new(columns: &[Vec<f64>]) -> Self {
        let mut basis = Self::default();
        columns.iter().for_each(|column| basis.add(column));
        basis
    }

    /// Adds a column.
    pub fn add(&mut self, column: &[f64]) {
        let mut new = column.to_vec();
        let before = dot(&new, &new).sqrt();
        self.remove_from(&mut new);
        self.remove_from(&mut new);
        let norm = dot(&new, &new).sqrt();
        if norm > 1e-9 * before {
            new.iter_mut().for_each(|x| *x /= norm);
            self.0.push(new);
        }
    }

    /// Takes the best fit of the columns away from a signal.
    pub fn remove_from(&self, signal: &mut [f64]) {
        for column in &self.0 {
            let along = dot(column, signal);
            signal
                .iter_mut()
                .zip(column)
                .for_each(|(x, c)| *x -= along * c);
        }
    }

    /// RMS of what the columns leave of a signal.
    pub fn rms_left(&self, signal: &[f64]) -> f64 {
        let mut left = signal.to_vec();
        self.remove_from(&mut left);
        rms(&left)
    }
}

/// Root of the mean square; 0 for an empty signal.
pub fn rms(signal: &[f64]) -> f64 {
    if signal.is_empty() {
        return 0.0;
    }
    (dot(signal, signal) / signal.len() as f64).sqrt()
}

/// Sum of the products.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
