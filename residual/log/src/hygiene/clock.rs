//! Time stamps that are not those of the rows.

use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::stats;
use std::ops::Range;

/// A step of time this many times the usual one begins another bunch.
const LONG: f64 = 5.0;

/// Share of the bunches that must have the usual number of rows, and of the time between them that
/// must be the usual one within a quarter.
const REGULAR: f64 = 0.8;

/// Most rows of a bunch.
const MOST: usize = 200;

/// Rows that were stamped when they arrived, some at once: what a bunch is, in words, and the rows
/// per second on the whole. `None` where steps of time are even, or uneven without such a rule.
pub(super) fn bunches(frame: &Frame, step: f64) -> Option<(String, f64)> {
    let (mut sizes, mut periods) = (Vec::new(), Vec::new());
    let (mut within, mut between) = (Vec::new(), Vec::new());
    for r in runs(frame) {
        let time = &frame.time()[r];
        let mut starts = vec![0];
        for (i, pair) in time.windows(2).enumerate() {
            let dt = pair[1] - pair[0];
            if dt > LONG * step {
                starts.push(i + 1);
                between.push(dt);
            } else {
                within.push(dt);
            }
        }
        // The first and the last bunch may be cut.
        let whole = starts.get(1..).unwrap_or(&[]);
        sizes.extend(whole.windows(2).map(|w| (w[1] - w[0]) as f64));
        periods.extend(whole.windows(2).map(|w| time[w[1]] - time[w[0]]));
    }
    if sizes.len() < 10 {
        return None;
    }
    let usual = |values: &[f64], tolerance: f64| {
        let mid = stats::median(&mut values.to_vec())?;
        let near = values
            .iter()
            .filter(|v| (*v - mid).abs() <= tolerance * mid);
        (near.count() as f64 >= REGULAR * values.len() as f64).then_some(mid)
    };
    let size = usual(&sizes, 0.0)?;
    let period = usual(&periods, 0.25)?;
    if size < 2.0 || size > MOST as f64 {
        return None;
    }
    let (short, long) = (stats::median(&mut within)?, stats::median(&mut between)?);
    let rate = size / period;
    let what = format!(
        "{size} rows {} s apart, then {} s without one",
        num(short),
        num(long)
    );
    Some((what, rate))
}

/// Rows of one file in which the time grows: gaps between bunches have cut it into sequences.
fn runs(frame: &Frame) -> Vec<Range<usize>> {
    let time = frame.time();
    let file = frame.column("file");
    let mut out: Vec<Range<usize>> = Vec::new();
    for r in frame.sequences().iter().filter(|r| !r.is_empty()) {
        let goes_on = |last: &Range<usize>| {
            let same = file.is_none_or(|f| f[last.start] == f[r.start]);
            same && time[last.end - 1] < time[r.start]
        };
        match out.last_mut() {
            Some(last) if goes_on(last) => last.end = r.end,
            _ => out.push(r.clone()),
        }
    }
    out
}
