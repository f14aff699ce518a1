//! A smaller problem for screening: windows spread over the data.

use super::Problem;
use crate::frame::Frame;
use std::ops::Range;

impl Problem {
    /// A smaller problem for screening: windows spread over the data, about `limit` rows in all.
    pub fn thin(&self, limit: usize) -> Option<Problem> {
        let n = self.frame.len();
        if n <= limit + limit / 2 {
            return None;
        }
        let windows: Vec<Range<usize>> = self
            .frame
            .sequences()
            .iter()
            .flat_map(|r| {
                let want = (r.len() as f64 * limit as f64 / n as f64) as usize;
                let count = (want / 4000).max(1);
                let len = want / count;
                (0..count).map(move |k| {
                    let start = r.start
                        + if count > 1 {
                            (r.len() - len) * k / (count - 1)
                        } else {
                            0
                        };
                    start..start + len
                })
            })
            .filter(|w| w.len() >= 16)
            .collect();
        let gather = |c: &[f64]| {
            windows
                .iter()
                .flat_map(|w| c[w.clone()].iter().copied())
                .collect::<Vec<f64>>()
        };
        let columns = self
            .frame
            .names()
            .iter()
            .filter(|c| *c != "time")
            .map(|c| (c.clone(), gather(self.frame.column(c).unwrap_or(&[]))))
            .collect();
        let mut at = 0;
        let sequences = windows
            .iter()
            .map(|w| {
                at += w.len();
                at - w.len()..at
            })
            .collect();
        let mut frame = Frame::new(columns, gather(self.frame.time()), sequences);
        // Time since the start of the whole sequence, not of the window.
        if let Some(e) = self.frame.column("elapsed") {
            frame.insert("elapsed", gather(e));
        }
        let mut keep_all = vec![true; n];
        let mut fold_all = vec![0u32; n];
        match &self.rows {
            None => fold_all.copy_from_slice(&self.fold_of_row),
            Some(rows) => {
                keep_all.fill(false);
                rows.iter().zip(&self.fold_of_row).for_each(|(&i, f)| {
                    keep_all[i] = true;
                    fold_all[i] = *f;
                });
            }
        }
        let keep: Vec<bool> = windows
            .iter()
            .flat_map(|w| keep_all[w.clone()].iter().copied())
            .collect();
        let fold: Vec<u32> = windows
            .iter()
            .flat_map(|w| fold_all[w.clone()].iter().copied())
            .collect();
        let present: std::collections::BTreeSet<u32> = fold
            .iter()
            .zip(&keep)
            .filter(|(_, k)| **k)
            .map(|(f, _)| *f)
            .collect();
        (present.len() >= 2).then(|| Problem {
            ticker: self.ticker.clone(),
            ..Problem::new(frame, &keep, &fold, self.flips.len(), self.seed)
        })
    }
}
