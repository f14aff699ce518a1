//! The regression problem: kept rows in blocks, blocks in folds, and decoys of the residual.
//!
//! A *block* is a stretch of one sequence inside one fold, long against the correlation time of the
//! residual where the data allow it. Blocks are what the bootstrap draws and what decoys flip:
//! residual times a random sign per block keeps colour, amplitude and quantisation of the residual
//! and breaks every lasting relation to the signals. All sums of products are kept per block, so a
//! decoy costs a few additions per block instead of a pass over the rows.

mod ends;
mod evaluate;
mod scores;
mod sums;
mod thin;

pub use ends::half_step;
use evaluate::Cache;
pub use evaluate::{through_of, Replaced, View, EVERYTHING};
pub use scores::{profile, Scores};
pub use sums::{Known, Sums, RANK_TOL};

use residual_columns::expr::Expr;
use residual_columns::frame::Frame;
use residual_columns::progress::Ticker;
use residual_columns::stats::Rng;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// Values of an expression on the kept rows.
pub type Column = Arc<Vec<f64>>;

/// The values of columns.
pub fn slices(columns: &[Column]) -> Vec<&[f64]> {
    columns.iter().map(|c| c.as_slice()).collect()
}

/// A stretch of kept rows of one sequence and one fold.
#[derive(Debug, Clone)]
pub struct Block {
    /// Its rows.
    pub range: Range<usize>,
    /// The fold in which it is held out.
    pub fold: usize,
    /// The sequence that it is part of.
    pub sequence: usize,
}

/// Ranges of frame rows, in order; they may go over the end of a sequence.
type Ranges = Vec<Range<usize>>;

/// Ranges of the rows to keep.
fn ranges(keep: &[bool]) -> Ranges {
    let mut at = 0;
    let all = keep.chunk_by(|a, b| a == b).map(|part| {
        at += part.len();
        (part[0], at - part.len()..at)
    });
    all.filter(|(kept, _)| *kept)
        .map(|(_, rows)| rows)
        .collect()
}

/// Values on the rows that are kept; all of them for `None`. In place where nearly all are, as a
/// column of many rows takes long to allocate.
fn kept_values<T: Copy>(kept: Option<&Ranges>, mut values: Vec<T>) -> Vec<T> {
    let Some(kept) = kept else {
        return values;
    };
    let count: usize = kept.iter().map(|rows| rows.len()).sum();
    if count < values.len() - values.len() / 16 {
        let mut out = Vec::with_capacity(count);
        for rows in kept {
            out.extend_from_slice(&values[rows.clone()]);
        }
        return out;
    }
    let mut at = 0;
    for rows in kept {
        values.copy_within(rows.clone(), at);
        at += rows.len();
    }
    values.truncate(at);
    values
}

/// What shows the direction of a motion: the sign of an expression, and the band in which it has
/// none, which is rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// The expression: a velocity, or a slope of the angle.
    pub of: String,
    /// Its band of rest.
    pub band: f64,
}

impl Direction {
    /// Its sign, 0 at rest, as an expression.
    pub fn sign(&self) -> String {
        format!("sgn({}, {})", self.of, self.band)
    }

    /// The last sign before a rest, as an expression.
    pub fn held(&self) -> String {
        format!("held({}, {})", self.of, self.band)
    }
}

/// Kept rows with their hold-out structure.
pub struct Problem {
    /// The table with all rows.
    pub frame: Frame,
    /// The frame as it is.
    pub plain: Arc<View>,
    /// Frame rows that are fitted; `None` when all are.
    kept: Option<Ranges>,
    /// Target on kept rows.
    pub y: Column,
    /// Least and greatest value of the target where it visibly stops there.
    pub stops: [Option<f64>; 2],
    /// What the declared model, fitted where the target does not stop, predicts, as an expression;
    /// `None` where it stops nowhere.
    pub unlimited: Option<String>,
    /// What shows the direction of slow motion that the deadband of the velocity hides; `None`
    /// where the velocity shows it as well.
    pub direction: Option<Direction>,
    /// Values per second of a target that was logged more often; `None` where each row is a value.
    pub values_per_s: Option<f64>,
    /// The blocks, in the order of their rows.
    pub blocks: Vec<Block>,
    /// Number of folds.
    pub folds: usize,
    /// Signs by decoy and block.
    pub flips: Vec<Vec<f64>>,
    fold_of_row: Vec<u32>,
    /// For each row the part of a repeated motion that it belongs to, from 1; 0 where the motion
    /// does not repeat. Empty if it does nowhere.
    part_of_row: Vec<u32>,
    seed: u64,
    cache: Mutex<Cache>,
    /// Whether these are windows of a large log.
    windows: bool,
    /// Receives the progress of a scan.
    pub ticker: Option<Ticker>,
}

impl Problem {
    /// Builds the problem on the rows to `keep`, with the `fold` of each row, with blocks for a
    /// correlation time of ten rows.
    pub fn new(frame: Frame, keep: &[bool], fold: &[u32], decoys: usize, seed: u64) -> Problem {
        let all = keep.iter().all(|k| *k);
        let kept = (!all).then(|| ranges(keep));
        let target = Expr::Var("target".into());
        let y = frame.known(&target).cloned().unwrap_or_default();
        let y = if all {
            y
        } else {
            Arc::new(kept_values(kept.as_ref(), y.to_vec()))
        };
        let folds = fold
            .iter()
            .zip(keep)
            .filter(|(_, k)| **k)
            .map(|(f, _)| *f as usize + 1)
            .max()
            .unwrap_or(1);
        let fold_of_row = kept_values(kept.as_ref(), fold.to_vec());
        let mut p = Problem {
            plain: Arc::new(View::plain(frame.clone())),
            frame,
            kept,
            stops: ends::stops(&y),
            unlimited: None,
            direction: None,
            values_per_s: None,
            y,
            blocks: vec![],
            folds,
            flips: vec![],
            fold_of_row,
            part_of_row: vec![],
            seed,
            cache: Mutex::default(),
            windows: false,
            ticker: None,
        };
        p.cut_blocks(10.0, decoys);
        p
    }

    /// Tells which rows show the same part of a motion that repeats, see `Data::parts` of the logs.
    /// What is special to a part is in each pass, so the decoys of all passes have one sign.
    pub fn with_parts(mut self, parts: &[u32]) -> Problem {
        self.part_of_row = match parts {
            [] => vec![],
            parts => kept_values(self.kept.as_ref(), parts.to_vec()),
        };
        let decoys = self.flips.len();
        self.cut_blocks(10.0, decoys);
        self
    }

    /// Cuts blocks of about ten correlation times, between 32 and 256 blocks overall if the rows
    /// allow, and at least four in each long run of one fold where there are few runs.
    pub fn cut_blocks(&mut self, correlation: f64, decoys: usize) {
        let n = self.y.len();
        let block_rows = (10.0 * correlation)
            .clamp(n as f64 / 256.0, n as f64 / 40.0)
            .max(8.0) as usize;
        self.blocks.clear();
        let runs = 1 + self
            .fold_of_row
            .windows(2)
            .filter(|w| w[0] != w[1])
            .count()
            .max(self.frame.sequences().len());
        let least = if runs >= 32 { 1.0 } else { 4.0 };
        let mut at = 0;
        for (si, r) in self.frame.sequences().iter().enumerate() {
            let end = at + self.kept_of(r);
            while at < end {
                let fold = self.fold_of_row[at];
                let run = self.fold_of_row[at..end]
                    .iter()
                    .take_while(|f| **f == fold)
                    .count();
                let pieces = (run as f64 / block_rows as f64).round().max(if run >= 64 {
                    least
                } else {
                    1.0
                }) as usize;
                for k in 0..pieces {
                    let (a, b) = (at + run * k / pieces, at + run * (k + 1) / pieces);
                    if b > a {
                        self.blocks.push(Block {
                            range: a..b,
                            fold: fold as usize,
                            sequence: si,
                        });
                    }
                }
                at += run;
            }
        }
        let twins = self.twins();
        let mut rng = Rng::new(self.seed);
        self.flips = (0..decoys)
            .map(|_| {
                let mut signs: Vec<f64> = (0..self.blocks.len()).map(|_| rng.sign()).collect();
                for (k, first) in twins.iter().enumerate() {
                    signs[k] = signs[*first];
                }
                signs
            })
            .collect();
    }

    /// For each block the first one that shows the same part of a repeated motion, or itself.
    fn twins(&self) -> Vec<usize> {
        let mut first: HashMap<(u32, usize), usize> = HashMap::new();
        let (mut last, mut place) = (0, 0);
        self.blocks
            .iter()
            .enumerate()
            .map(|(k, block)| {
                let part = self.part_of_row.get(block.range.start).copied();
                let part = part.unwrap_or(0);
                place = if part == last { place + 1 } else { 0 };
                last = part;
                match part {
                    0 => k,
                    _ => *first.entry((part, place)).or_insert(k),
                }
            })
            .collect()
    }

    /// Blocks of each sequence.
    pub fn runs(&self) -> Vec<Range<usize>> {
        let mut out: Vec<Range<usize>> = Vec::new();
        for (k, block) in self.blocks.iter().enumerate() {
            match out.last_mut() {
                Some(run) if self.blocks[run.start].sequence == block.sequence => run.end = k + 1,
                _ => out.push(k..k + 1),
            }
        }
        out
    }

    /// Fitted rows of each sequence.
    pub fn rows_of_runs(&self) -> Vec<Range<usize>> {
        let rows = |run: Range<usize>| {
            self.blocks[run.start].range.start..self.blocks[run.end - 1].range.end
        };
        self.runs().into_iter().map(rows).collect()
    }

    /// Rows of a frame column that are fitted.
    pub fn gather(&self, column: Vec<f64>) -> Vec<f64> {
        kept_values(self.kept.as_ref(), column)
    }

    /// Number of rows that are fitted of some rows of the frame.
    fn kept_of(&self, rows: &Range<usize>) -> usize {
        let Some(kept) = &self.kept else {
            return rows.len();
        };
        let first = kept.partition_point(|k| k.end <= rows.start);
        let inside = kept[first..].iter().take_while(|k| k.start < rows.end);
        inside
            .map(|k| k.end.min(rows.end) - k.start.max(rows.start))
            .sum()
    }

    /// The kept rows as a frame of their own (sequences of kept runs), for tests of the residual.
    pub fn kept_frame(&self) -> Frame {
        let time = self.gather(self.frame.time().to_vec());
        let mut sequences: Vec<Range<usize>> = Vec::new();
        let mut last = usize::MAX;
        for b in &self.blocks {
            if b.sequence == last {
                if let Some(s) = sequences.last_mut() {
                    s.end = b.range.end;
                }
            } else {
                sequences.push(b.range.clone());
            }
            last = b.sequence;
        }
        Frame::new(vec![], time, sequences)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With shares of rows kept for which values are moved in place, and copied.
    #[test]
    fn rows_that_are_dropped_leave_the_others_in_order() {
        let mut rng = Rng::new(5);
        for rows in 0..120usize {
            let most = if rows % 2 == 0 { 0.0 } else { 1.5 };
            let keep: Vec<bool> = (0..rows).map(|_| rng.normal() < most).collect();
            let values: Vec<f64> = (0..rows).map(|_| rng.normal()).collect();
            let inside = |range: Range<usize>| range.filter(|i| keep[*i]).collect::<Vec<_>>();
            let kept = inside(0..rows);
            let expected: Vec<f64> = kept.iter().map(|i| values[*i]).collect();
            let sequences: Vec<Range<usize>> = [0..rows / 3, rows / 3..rows].into();
            let time = (0..rows).map(|i| i as f64).collect();
            let columns = vec![("target".to_string(), values.clone())];
            let frame = Frame::new(columns, time, sequences.clone());
            // Each row has a fold, and a part, of its own.
            let own: Vec<u32> = (0..rows as u32).collect();
            let problem = Problem::new(frame, &keep, &own, 2, 1).with_parts(&own);
            assert_eq!(*problem.y, expected, "{keep:?}");
            assert_eq!(problem.gather(values), expected);
            let known: Vec<u32> = kept.iter().map(|i| *i as u32).collect();
            assert_eq!(
                (&problem.fold_of_row, &problem.part_of_row),
                (&known, &known)
            );
            for own in sequences {
                assert_eq!(problem.kept_of(&own), inside(own).len(), "{keep:?}");
            }
            let (kept_rows, folds) = problem.rows_of_frame();
            assert_eq!(kept_rows, keep);
            assert!(kept.iter().all(|i| folds[*i] == *i as u32));
        }
    }

    #[test]
    fn decoys_have_one_sign_in_all_passes_of_a_motion() {
        // Two passes of three parts.
        let (part, passes, parts) = (200, 2, 3u32);
        let n = part * passes * parts as usize;
        let part_of = |i: usize| (i / part) as u32 % parts;
        let time: Vec<f64> = (0..n).map(|i| 0.01 * i as f64).collect();
        let columns = vec![("target".to_string(), vec![0.0; n])];
        let frame = Frame::new(columns, time, std::iter::once(0..n).collect());
        let fold: Vec<u32> = (0..n).map(part_of).collect();
        let known: Vec<u32> = (0..n).map(|i| part_of(i) + 1).collect();
        let plain = Problem::new(frame, &vec![true; n], &fold, 16, 1);
        let blocks = plain.blocks.len();
        let same = |p: &Problem| {
            let twins = p
                .flips
                .iter()
                .map(|signs| signs[..blocks / 2] == signs[blocks / 2..]);
            twins.filter(|same| *same).count()
        };
        assert_eq!(same(&plain), 0);
        let tied = plain.with_parts(&known);
        assert_eq!((tied.blocks.len(), same(&tied)), (blocks, 16));
        let ups = tied.flips.iter().flatten().filter(|s| **s > 0.0).count();
        assert!(ups > 0 && ups < 16 * blocks);
    }
}
