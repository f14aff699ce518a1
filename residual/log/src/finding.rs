//! Flaws of the data, for the report.

use serde::{Deserialize, Serialize};

/// One kind of flaw, summed over the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Name of the check.
    pub check: String,
    /// How many rows (or places) show it.
    pub count: usize,
    /// Where it was seen first.
    pub first: String,
    /// What was seen and what was done, in words.
    pub what: String,
}

/// Collects findings, one per check.
#[derive(Debug, Clone, Default)]
pub struct Findings(Vec<Finding>);

impl Findings {
    /// Adds `n` cases of `check`; nothing is noted for 0.
    pub fn count(&mut self, check: &str, n: usize, first: &str, what: &str) {
        if n == 0 {
            return;
        }
        match self.0.iter_mut().find(|f| f.check == check) {
            Some(f) => f.count += n,
            None => self.0.push(Finding {
                check: check.into(),
                count: n,
                first: first.into(),
                what: what.into(),
            }),
        }
    }

    /// What was collected.
    pub fn done(self) -> Vec<Finding> {
        self.0
    }
}
