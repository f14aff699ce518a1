//! Flaws of the data, for the report.

use residual_columns::format::percent;
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

/// Name of the check that more than `LOSS` of the rows were left out.
pub const LEFT_OUT: &str = "rows left out";

/// Share of the rows that may be left out without a word in the verdict.
const LOSS: f64 = 0.01;

/// Rows that were left out for one cause.
#[derive(Debug, Clone)]
struct Loss {
    /// The cause, in words.
    what: String,
    rows: usize,
    /// Where it was seen first.
    first: String,
}

/// Collects findings, one per check, and what was lost.
#[derive(Debug, Clone, Default)]
pub struct Findings {
    all: Vec<Finding>,
    losses: Vec<Loss>,
}

impl Findings {
    /// Adds `n` cases of `check`; nothing is noted for 0.
    pub fn count(&mut self, check: &str, n: usize, first: &str, what: &str) {
        if n == 0 {
            return;
        }
        match self.all.iter_mut().find(|f| f.check == check) {
            Some(f) => f.count += n,
            None => self.all.push(Finding {
                check: check.into(),
                count: n,
                first: first.into(),
                what: what.into(),
            }),
        }
    }

    /// Notes rows that were left out, with what was seen in them.
    pub fn lose(&mut self, what: &str, rows: usize, first: &str) {
        match self.losses.iter_mut().find(|l| l.what == what) {
            _ if rows == 0 => {}
            Some(loss) => loss.rows += rows,
            None => self.losses.push(Loss {
                what: what.into(),
                rows,
                first: first.into(),
            }),
        }
    }

    /// Adds cases of a check whose rows were left out.
    pub fn count_lost(&mut self, check: &str, n: usize, first: &str, what: &str) {
        self.count(check, n, first, what);
        self.lose(what, n, first);
    }

    /// Rows that were left out.
    pub fn lost(&self) -> usize {
        self.losses.iter().map(|l| l.rows).sum()
    }

    /// What was collected, of `read` rows in all.
    pub fn done(mut self, read: usize) -> Vec<Finding> {
        let lost = self.lost();
        if lost as f64 > LOSS * read as f64 {
            self.losses.sort_by_key(|l| std::cmp::Reverse(l.rows));
            let causes: Vec<String> = self
                .losses
                .iter()
                .map(|l| {
                    let what = l.what.replace(" were left out", "");
                    let file = l.first.rsplit('/').next().unwrap_or_default();
                    format!("{what} ({} rows, first in {file})", l.rows)
                })
                .collect();
            let share = percent(lost as f64 / read as f64);
            let what = format!(
                "{share} of {read} rows were left out: {}",
                causes.join("; ")
            );
            self.count(LEFT_OUT, lost, &self.losses[0].first.clone(), &what);
        }
        self.all
    }
}
