//! The table that everything works on: columns of numbers, cut into sequences.
//!
//! A *sequence* is an unbroken run of rows of one thing (one unit in one file). Operators with
//! memory run along it. Hold-out groups are made of whole sequences or of blocks of time in them.

use crate::expr::Expr;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Columns of equal length, in sequences, with time.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    names: Vec<String>,
    index: HashMap<String, usize>,
    columns: Vec<Arc<Vec<f64>>>,
    time: Arc<Vec<f64>>,
    sequences: Vec<Range<usize>>,
    /// Values of expressions over the columns, by their text; see [`Frame::derive`].
    derived: HashMap<String, Arc<Vec<f64>>>,
    /// Median time between rows; see [`Frame::step`].
    step: OnceLock<f64>,
}

impl Frame {
    /// Builds a frame. `sequences` must cover the rows in order without overlap; `time` is in
    /// seconds and grows within a sequence. `time` and `elapsed` (since the start of the sequence)
    /// become columns.
    pub fn new(
        columns: Vec<(String, Vec<f64>)>,
        time: Vec<f64>,
        sequences: Vec<Range<usize>>,
    ) -> Frame {
        let mut elapsed = vec![0.0; time.len()];
        for r in &sequences {
            for i in r.clone() {
                elapsed[i] = time[i] - time[r.start];
            }
        }
        let time = Arc::new(time);
        let mut frame = Frame {
            time: time.clone(),
            sequences,
            ..Frame::default()
        };
        for (name, values) in columns {
            frame.insert(&name, values);
        }
        frame.share("time", time);
        frame.insert("elapsed", elapsed);
        frame
    }

    /// Adds or replaces a column.
    pub fn insert(&mut self, name: &str, values: Vec<f64>) {
        debug_assert_eq!(values.len(), self.time.len());
        self.share(name, Arc::new(values));
    }

    fn share(&mut self, name: &str, values: Arc<Vec<f64>>) {
        // What was computed from the old values is no longer true.
        self.derived.clear();
        match self.index.get(name) {
            Some(&i) => self.columns[i] = values,
            None => {
                self.index.insert(name.to_string(), self.columns.len());
                self.names.push(name.to_string());
                self.columns.push(values);
            }
        }
    }

    /// Keeps the values of an expression that many others contain, such as the slope of an angle.
    /// Any change of a column drops them.
    pub fn derive(&mut self, text: String, values: Vec<f64>) {
        debug_assert_eq!(values.len(), self.time.len());
        self.derived.insert(text, Arc::new(values));
    }

    /// Values of an expression that were kept, by its text.
    pub fn derived(&self, text: &dyn Fn() -> String) -> Option<&[f64]> {
        if self.derived.is_empty() {
            return None;
        }
        self.derived.get(&text()).map(|v| v.as_slice())
    }

    /// Time and sequences of at most `rows` rows: those of the longest sequences, in their order.
    pub fn longest(&self, rows: usize) -> Frame {
        let mut sequences = self.sequences.clone();
        sequences.sort_by_key(|r| std::cmp::Reverse(r.len()));
        let mut left = rows;
        sequences.retain_mut(|r| {
            r.end = r.end.min(r.start + left);
            left -= r.len();
            r.start < r.end
        });
        sequences.sort_by_key(|r| r.start);
        let (mut time, mut own) = (Vec::new(), Vec::new());
        for range in sequences {
            let start = time.len();
            time.extend_from_slice(&self.time[range]);
            own.push(start..time.len());
        }
        Frame::new(vec![], time, own)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// A column by name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.index.get(name).map(|&i| self.columns[i].as_slice())
    }

    /// The values of an expression that are there already, to be shared: those of a column, or of
    /// an expression that was kept.
    pub fn known(&self, e: &Expr) -> Option<&Arc<Vec<f64>>> {
        match e {
            Expr::Var(name) => self.index.get(name).map(|&i| &self.columns[i]),
            Expr::Call(..) if !self.derived.is_empty() => self.derived.get(&e.to_string()),
            _ => None,
        }
    }

    /// Names of all columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Time in seconds.
    pub fn time(&self) -> &[f64] {
        &self.time
    }

    /// Row ranges of the sequences.
    pub fn sequences(&self) -> &[Range<usize>] {
        &self.sequences
    }

    /// Median time between rows, in seconds.
    pub fn step(&self) -> f64 {
        *self.step.get_or_init(|| {
            let mut d: Vec<f64> = self
                .sequences
                .iter()
                .flat_map(|r| self.time[r.clone()].windows(2).map(|w| w[1] - w[0]))
                .filter(|d| *d > 0.0)
                .collect();
            crate::stats::median(&mut d).unwrap_or(1.0)
        })
    }
}
