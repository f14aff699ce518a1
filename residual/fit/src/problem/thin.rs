//! A smaller problem for screening: windows spread over the data.

use super::Problem;
use residual_columns::frame::Frame;
use std::ops::Range;

/// Rows of one window.
const WINDOW: usize = 4000;

/// Fewest rows that are worth a window.
const SHORTEST: usize = 16;

/// Values in windows, one window after the other.
fn gather<T: Copy>(values: &[T], windows: &[Range<usize>]) -> Vec<T> {
    windows
        .iter()
        .flat_map(|w| values[w.clone()].iter().copied())
        .collect()
}

/// Windows spread evenly over one sequence of `n` rows' share of `limit` rows.
fn spread(r: &Range<usize>, limit: usize, n: usize) -> impl Iterator<Item = Range<usize>> {
    let want = (r.len() as f64 * limit as f64 / n as f64) as usize;
    let count = (want / WINDOW).max(1);
    let len = want / count;
    let (first, free) = (r.start, r.len() - len);
    (0..count).map(move |k| {
        let start = first + if count > 1 { free * k / (count - 1) } else { 0 };
        start..start + len
    })
}

impl Problem {
    /// A smaller problem for screening: windows spread over the data, about `limit` rows in all.
    /// `None` if there are few rows, or too few folds in the windows.
    pub fn thin(&self, limit: usize) -> Option<Problem> {
        let n = self.frame.len();
        if n <= 2 * limit {
            return None;
        }
        let windows: Vec<Range<usize>> = self
            .frame
            .sequences()
            .iter()
            .flat_map(|r| spread(r, limit, n))
            .filter(|w| w.len() >= SHORTEST)
            .collect();
        let (keep, fold) = self.rows_of_frame();
        let (keep, fold) = (gather(&keep, &windows), gather(&fold, &windows));
        let mut present: Vec<u32> = fold
            .iter()
            .zip(&keep)
            .filter(|(_, k)| **k)
            .map(|(f, _)| *f)
            .collect();
        present.sort_unstable();
        present.dedup();
        (present.len() >= 2).then(|| Problem {
            ticker: self.ticker.clone(),
            stops: self.stops,
            unlimited: self.unlimited.clone(),
            direction: self.direction.clone(),
            values_per_s: self.values_per_s,
            windows: true,
            ..Problem::new(
                self.thin_frame(&windows),
                &keep,
                &fold,
                self.flips.len(),
                self.seed,
            )
        })
    }

    /// The columns in windows, each window a sequence.
    fn thin_frame(&self, windows: &[Range<usize>]) -> Frame {
        let columns = self
            .frame
            .names()
            .iter()
            .filter(|c| *c != "time")
            .map(|c| {
                (
                    c.clone(),
                    gather(self.frame.column(c).unwrap_or(&[]), windows),
                )
            })
            .collect();
        let mut at = 0;
        let sequences = windows
            .iter()
            .map(|w| {
                at += w.len();
                at - w.len()..at
            })
            .collect();
        let mut frame = Frame::new(columns, gather(self.frame.time(), windows), sequences);
        // Time since the start of the whole sequence, not of the window.
        if let Some(e) = self.frame.column("elapsed") {
            frame.insert("elapsed", gather(e, windows));
        }
        frame
    }

    /// Whether each row of the frame is fitted, and its fold.
    pub(super) fn rows_of_frame(&self) -> (Vec<bool>, Vec<u32>) {
        let n = self.frame.len();
        let Some(kept) = &self.kept else {
            return (vec![true; n], self.fold_of_row.clone());
        };
        let (mut keep, mut fold) = (vec![false; n], vec![0u32; n]);
        let mut folds = &self.fold_of_row[..];
        for rows in kept {
            let (own, rest) = folds.split_at(rows.len());
            keep[rows.clone()].fill(true);
            fold[rows.clone()].copy_from_slice(own);
            folds = rest;
        }
        (keep, fold)
    }
}
