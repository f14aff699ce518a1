//! Errors of many draws and how often the intervals stated with them hold.

/// Errors and whether the interval stated with each holds.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Size of each error.
    pub errors: Vec<f64>,
    /// Largest error of each draw.
    pub worst_of_draw: Vec<f64>,
    /// Intervals that hold the truth.
    pub hits: usize,
    /// Intervals stated.
    pub intervals: usize,
}

impl Tally {
    pub(crate) fn add(&mut self, error: f64) {
        self.errors.push(error);
        if let Some(worst) = self.worst_of_draw.last_mut() {
            *worst = worst.max(error);
        }
    }

    pub(crate) fn new_draw(&mut self) {
        self.worst_of_draw.push(0.0);
    }

    pub(crate) fn interval(&mut self, holds: bool) {
        self.hits += usize::from(holds);
        self.intervals += 1;
    }

    /// Part of the errors that are below a limit.
    pub fn within(&self, limit: f64) -> f64 {
        part(&self.errors, limit)
    }

    /// Part of the draws whose largest error is below a limit.
    pub fn draws_within(&self, limit: f64) -> f64 {
        part(&self.worst_of_draw, limit)
    }

    /// The error that 95 % stay below.
    pub fn p95(&self) -> f64 {
        let mut sorted = self.errors.clone();
        sorted.sort_by(f64::total_cmp);
        sorted
            .get(sorted.len() * 95 / 100)
            .copied()
            .unwrap_or(f64::NAN)
    }

    /// Root mean square.
    pub fn rms(&self) -> f64 {
        (self.errors.iter().map(|e| e * e).sum::<f64>() / self.errors.len() as f64).sqrt()
    }

    /// The draw gave no result: it is not within any limit.
    pub(crate) fn refused(&mut self) {
        if let Some(worst) = self.worst_of_draw.last_mut() {
            *worst = f64::INFINITY;
        }
    }

    /// Adds the errors of further draws.
    pub(crate) fn join(&mut self, more: Self) {
        self.errors.extend(more.errors);
        self.worst_of_draw.extend(more.worst_of_draw);
        self.hits += more.hits;
        self.intervals += more.intervals;
    }

    /// Part of the 95 % intervals that hold the truth.
    pub fn coverage(&self) -> f64 {
        self.hits as f64 / self.intervals as f64
    }
}

fn part(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|v| **v < limit).count() as f64 / values.len() as f64
}
