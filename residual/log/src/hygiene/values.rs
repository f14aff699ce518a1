//! Values that are no measurement: codes that stand for a missing value or for a converter at its
//! end, single values far from all others, a target at the end of its range, one that is logged
//! more often than it is measured.

use crate::spec::Column;
use residual_columns::frame::Frame;
use residual_columns::stats;

/// Fewest other values, and the share of the rows that they must have, beside which a value is
/// judged.
const OTHERS: usize = 8;
const OTHER_ROWS: f64 = 0.5;

/// Distance to the next value from which a value is far from all others, as a share of the range of
/// the others: a known code, and any other value that repeats itself.
const FAR_CODE: f64 = 0.5;
const FAR: f64 = 1.0;

/// Rows from which an unknown value is one that stands for another: within the range of the others
/// and outside of it. The first is also so many times as frequent as any other value.
const REPEATS_WITHIN: usize = 8;
const REPEATS_OUTSIDE: usize = 3;
const MORE_OFTEN: usize = 8;

/// Largest share of rows that hold the value before, of a column whose values repeat themselves by
/// chance only.
const HELD_BY_CHANCE: f64 = 0.2;

/// Robust sizes of a step from which the signal did not go there.
const JUMP: f64 = 12.0;

/// The same for a value among the others, and the share of its rows' edges that must be such jumps:
/// the signal is near that value at times.
const JUMP_WITHIN: f64 = 5.0;
const JUMPS: f64 = 0.6;

/// Most codes that are named in a column.
const CODES: usize = 4;

/// A value that stands for a missing one, and the rows that have it.
pub(super) struct Code {
    pub value: f64,
    pub rows: Vec<usize>,
}

/// Values of a column, in the unit of the model, that stand for a missing one: by their distance
/// from all others, and by their repetition or as a number that converters and programs use for it.
pub(super) fn codes(
    x: &[f64],
    frame: &Frame,
    column: Option<&Column>,
    is_target: bool,
) -> Vec<Code> {
    let counted = counts(x);
    let mut found: Vec<f64> = outside(&counted, x.len(), column, held_share(x, frame));
    if is_target && found.is_empty() {
        found.extend(within(x, frame, &counted));
    }
    found
        .into_iter()
        .map(|value| Code {
            value,
            rows: (0..x.len()).filter(|i| x[*i] == value).collect(),
        })
        .collect()
}

/// The distinct values in their order, with how often each stands there.
fn counts(x: &[f64]) -> Vec<(f64, usize)> {
    let mut sorted = x.to_vec();
    residual_columns::parallel::sort(&mut sorted, f64::total_cmp);
    let same = sorted.chunk_by(|a, b| a == b);
    same.map(|run| (run[0], run.len())).collect()
}

/// Share of the rows that have the value of the row before.
fn held_share(x: &[f64], frame: &Frame) -> f64 {
    let rows = frame.sequences().iter();
    let held = rows
        .flat_map(|r| x[r.clone()].windows(2))
        .filter(|w| w[0] == w[1]);
    held.count() as f64 / x.len().max(1) as f64
}

/// Codes beyond the other values: the farthest first, as long as what is left is most of the rows.
fn outside(counted: &[(f64, usize)], rows: usize, column: Option<&Column>, held: f64) -> Vec<f64> {
    let (mut lo, mut hi) = (0, counted.len());
    let mut left = rows;
    let mut found = Vec::new();
    while hi - lo > OTHERS && found.len() < CODES {
        let below = counted[lo + 1].0 - counted[lo].0;
        let above = counted[hi - 1].0 - counted[hi - 2].0;
        let (at, gap) = if below > above {
            (lo, below)
        } else {
            (hi - 1, above)
        };
        let (value, count) = counted[at];
        let others = if at == lo {
            counted[hi - 1].0 - counted[lo + 1].0
        } else {
            counted[hi - 2].0 - counted[lo].0
        };
        let known = is_code(column.map_or(value, |c| (value - c.offset) / c.scale));
        let repeats = count >= REPEATS_OUTSIDE && held <= HELD_BY_CHANCE;
        let far = (known && gap > FAR_CODE * others) || (repeats && gap > FAR * others);
        left -= count;
        if !far || (left as f64) < OTHER_ROWS * rows as f64 {
            break;
        }
        found.push(value);
        if at == lo {
            lo += 1;
        } else {
            hi -= 1;
        }
    }
    found
}

/// A value among the others that is far more frequent than any of them, and to which the target
/// jumps: the code of a reading that failed.
fn within(x: &[f64], frame: &Frame, counted: &[(f64, usize)]) -> Option<f64> {
    let mut by_count: Vec<(f64, usize)> = counted.to_vec();
    by_count.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let (value, count) = *by_count.first()?;
    let next = by_count.get(1)?.1;
    if count < REPEATS_WITHIN || count < MORE_OFTEN * next || by_count.len() <= OTHERS {
        return None;
    }
    let limit = JUMP_WITHIN * step_size(x, frame);
    let (mut edges, mut jumps, mut runs) = (0usize, 0usize, 0usize);
    for r in frame.sequences() {
        for pair in x[r.clone()].windows(2) {
            if (pair[0] == value) != (pair[1] == value) {
                edges += 1;
                jumps += usize::from((pair[0] - pair[1]).abs() > limit);
                runs += usize::from(pair[1] == value);
            }
        }
    }
    // Three rows at a time at most: a force that is gone for long is a rest.
    let short = count <= 3 * runs.max(1);
    (limit > 0.0 && short && jumps as f64 > JUMPS * edges as f64).then_some(value)
}

/// Median size of what is left of a row after the line through its neighbours.
fn step_size(y: &[f64], frame: &Frame) -> f64 {
    let bends = frame
        .sequences()
        .iter()
        .flat_map(|r| y[r.clone()].windows(3));
    let mut sizes: Vec<f64> = bends.map(|w| (w[1] - 0.5 * (w[0] + w[2])).abs()).collect();
    1.4826 * stats::median(&mut sizes).unwrap_or(0.0)
}

/// Size of deviations: their median, or a fifth of what few exceed.
fn robust_size(sizes: &mut [f64]) -> f64 {
    let median = stats::median(sizes).unwrap_or(0.0);
    (1.4826 * median).max(0.2 * stats::quantile_sorted(sizes, 0.95))
}

/// Whether a cell has a number that stands for "no value" or for the end of a converter: all bits
/// of a word or all but the sign, nothing but nines, or beyond what is measured.
fn is_code(cell: f64) -> bool {
    let size = cell.abs();
    let nearly = |a: f64| (size - a).abs() <= 1e-9 * a;
    // 2^n - 1 and -2^n, of words of 8 bits and more.
    let word = (8..=63)
        .map(|n| 2f64.powi(n))
        .any(|end| nearly(end - 1.0) || nearly(end));
    let nines = (3..=9).map(|n| 10f64.powi(n) - 1.0).any(nearly);
    // SCPI: 9.9e37 is infinity, 9.91e37 no number; the largest single is 3.4e38.
    word || nines || size >= 9.9e19
}

/// The column with the values of these rows replaced by the line between the rows beside them.
pub(super) fn bridged(x: &[f64], rows: &[usize], frame: &Frame) -> Vec<f64> {
    let mut out = x.to_vec();
    let mut bad = vec![false; x.len()];
    rows.iter().for_each(|&i| bad[i] = true);
    for r in frame.sequences() {
        let mut at = r.start;
        for part in bad[r.clone()].chunk_by(|a, b| a == b) {
            let own = at..at + part.len();
            at = own.end;
            if !part[0] {
                continue;
            }
            let before = (own.start > r.start).then(|| x[own.start - 1]);
            let after = (own.end < r.end).then(|| x[own.end]);
            let (Some(a), Some(b)) = (before.or(after), after.or(before)) else {
                continue;
            };
            let steps = (own.len() + 1) as f64;
            for (k, i) in own.enumerate() {
                out[i] = a + (b - a) * (k + 1) as f64 / steps;
            }
        }
    }
    out
}

/// Rows of the longest stretch of bad readings.
const STRETCH: usize = 5;

/// Rows whose target is far from both neighbours, on the same side; and stretches of a few rows,
/// also at the ends of a sequence, that are far outside of nearly all other values too.
pub(super) fn spikes(y: &[f64], frame: &Frame) -> Vec<usize> {
    let mut sorted = y.to_vec();
    residual_columns::parallel::sort(&mut sorted, f64::total_cmp);
    let lo = stats::quantile_sorted(&sorted, 0.005);
    let hi = stats::quantile_sorted(&sorted, 0.995);
    let margin = 0.5 * (hi - lo);
    let side = |v: f64| i8::from(v > hi + margin) - i8::from(v < lo - margin);
    let mut out = Vec::new();
    for r in frame.sequences().iter().filter(|r| r.len() >= 20) {
        let bend = |i: usize| y[i] - 0.5 * (y[i - 1] + y[i + 1]);
        let mut sizes: Vec<f64> = (r.start + 1..r.end - 1).map(|i| bend(i).abs()).collect();
        let limit = JUMP * robust_size(&mut sizes);
        if limit == 0.0 {
            continue;
        }
        for i in r.start + 1..r.end - 1 {
            let (a, b) = (y[i] - y[i - 1], y[i] - y[i + 1]);
            if a * b > 0.0 && a.abs().min(b.abs()) > limit {
                out.push(i);
            }
        }
        let mut at = r.start;
        for part in y[r.clone()].chunk_by(|a, b| side(*a) == side(*b)) {
            let own = at..at + part.len();
            at = own.end;
            let enters = own.start == r.start || (y[own.start] - y[own.start - 1]).abs() > limit;
            let leaves = own.end == r.end || (y[own.end - 1] - y[own.end]).abs() > limit;
            if side(part[0]) != 0 && part.len() <= STRETCH && enters && leaves {
                out.extend(own);
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Rows in runs of five or more at the largest or smallest value of the record.
pub(super) fn clipped(y: &[f64], frame: &Frame) -> Vec<usize> {
    let (lo, hi) = stats::range(y);
    if hi <= lo {
        return vec![];
    }
    let mut out = Vec::new();
    for end in [hi, lo] {
        let mut at_end = Vec::new();
        for r in frame.sequences() {
            let mut at = r.start;
            for run in y[r.clone()].chunk_by(|a, b| a == b) {
                if run[0] == end && run.len() >= 5 {
                    at_end.extend(at..at + run.len());
                }
                at += run.len();
            }
        }
        if at_end.len() * 200 >= y.len() {
            out.extend(at_end);
        }
    }
    out
}

/// Longest run of one value, in rows, in a target that is logged more often than it is measured.
const HELD_ROWS: usize = 10;

/// Share of the rows that repeat the value before from which a target has a lower rate than its
/// log.
const HELD_ROW_SHARE: f64 = 0.2;

/// Change of such a target from value to value, in its smallest changes: a signal that moves by a
/// step or two of its display repeats itself by chance.
const CHANGE: f64 = 4.0;

/// A target that is logged more often than it is measured.
pub(super) struct Held {
    /// Rows that repeat the value before.
    pub rows: Vec<usize>,
    /// Rows for which most values are held: nine of ten runs are between these.
    pub lengths: [usize; 2],
    /// Values per second.
    pub rate: f64,
}

/// Whether the target holds each of its values for some rows.
pub(super) fn held(y: &[f64], frame: &Frame) -> Option<Held> {
    let (mut rows, mut lengths, mut changes) = (Vec::new(), Vec::new(), Vec::new());
    let (mut seconds, mut values) = (0.0, 0usize);
    for r in frame.sequences().iter().filter(|r| r.len() >= 20) {
        let mut at = r.start;
        for run in y[r.clone()].chunk_by(|a, b| a == b) {
            if run.len() <= HELD_ROWS {
                rows.extend(at + 1..at + run.len());
                lengths.push(run.len());
            }
            at += run.len();
            values += 1;
            if at < r.end {
                changes.push((y[at] - y[at - 1]).abs());
            }
        }
        seconds += frame.time()[r.end - 1] - frame.time()[r.start];
    }
    let typical = stats::median(&mut changes)?;
    let smallest = changes.first().copied()?;
    let often = rows.len() as f64 >= HELD_ROW_SHARE * y.len() as f64;
    if !often || typical < CHANGE * smallest || seconds <= 0.0 {
        return None;
    }
    lengths.sort_unstable();
    let at = |share: f64| lengths[(share * (lengths.len() - 1) as f64).round() as usize];
    Some(Held {
        rows,
        lengths: [at(0.05), at(0.95)],
        rate: values as f64 / seconds,
    })
}

/// A column without the values that [`tame`] cuts, NaN in their place.
pub(super) fn usual(x: &[f64]) -> Vec<f64> {
    let cut = tame(x).into_iter().zip(x);
    cut.map(|(tame, raw)| if tame == *raw { tame } else { f64::NAN })
        .collect()
}

/// A column whose values beyond the usual ones by more than their whole range are cut there: a few
/// bad values must not decide how alike two columns are.
pub(super) fn tame(x: &[f64]) -> Vec<f64> {
    let mut sorted = x.to_vec();
    residual_columns::parallel::sort(&mut sorted, f64::total_cmp);
    let lo = stats::quantile_sorted(&sorted, 0.01);
    let hi = stats::quantile_sorted(&sorted, 0.99);
    let span = hi - lo;
    if span > 0.0 {
        x.iter().map(|v| v.clamp(lo - span, hi + span)).collect()
    } else {
        x.to_vec()
    }
}
