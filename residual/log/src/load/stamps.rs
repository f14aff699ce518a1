//! Time stamps that do not grow: a clock that falls back, stamps printed too coarsely, rows out of
//! order.

use std::ops::Range;

/// Rows that the pieces of a log must have on average for its gaps to be gaps.
const SHORTEST_PIECE: usize = 20;

/// Whether so many gaps in so many rows are steps of a log that has no usual step.
pub(super) fn is_uneven(gaps: usize, rows: usize) -> bool {
    gaps * SHORTEST_PIECE > rows
}

/// Rows of a log, as far as their stamps tell.
#[derive(Debug)]
pub(super) struct Stamps {
    /// Rows from one fall of the clock to the next.
    pub runs: Vec<Range<usize>>,
    /// The time of each row: as stamped, or even where the stamps are a rounded even time.
    pub time: Vec<f64>,
    /// Rows to leave out, as their time is not above that of the row before, in order.
    pub repeated: Vec<usize>,
    /// Rows to leave out, as their time is below that of a row before, in order.
    pub early: Vec<usize>,
    /// Rows whose time is made from their number.
    pub even: usize,
}

/// Share of the steps that fall in a log whose newest row is the first.
const BACKWARDS: f64 = 0.99;

/// Whether the time falls from row to row: the newest row is the first.
pub(super) fn is_backwards(stamps: &[f64]) -> bool {
    let falls = stamps.windows(2).filter(|w| w[1] < w[0]).count() as f64;
    stamps.len() >= FEWEST && falls >= BACKWARDS * (stamps.len() - 1) as f64
}

/// Reads finite stamps, in s.
pub(super) fn read(stamps: &[f64]) -> Stamps {
    let falls = falls(stamps);
    let disordered = is_uneven(falls.len(), stamps.len());
    let edges = if disordered { vec![] } else { falls };
    let starts = std::iter::once(0).chain(edges.iter().copied());
    let ends = edges.iter().copied().chain([stamps.len()]);
    let mut out = Stamps {
        runs: starts.zip(ends).map(|(a, b)| a..b).collect(),
        time: stamps.to_vec(),
        repeated: vec![],
        early: vec![],
        even: 0,
    };
    for run in out.runs.clone() {
        let own = &stamps[run.clone()];
        if own.windows(2).all(|w| w[1] > w[0]) {
            continue;
        }
        if let Some(even) = evened(own) {
            out.even += even.len();
            out.time[run].copy_from_slice(&even);
            continue;
        }
        let mut last = f64::NEG_INFINITY;
        for i in run {
            if stamps[i] > last {
                last = stamps[i];
            } else if stamps[i] == last {
                out.repeated.push(i);
            } else {
                out.early.push(i);
            }
        }
    }
    out
}

/// Rows at which the clock falls back and goes on from there. A single row that is early is none.
fn falls(stamps: &[f64]) -> Vec<usize> {
    let is_fall = |i: &usize| {
        let before = stamps[i - 1];
        stamps[*i] < before && stamps.get(i + 1).is_none_or(|next| *next <= before)
    };
    (1..stamps.len()).filter(is_fall).collect()
}

/// Fewest rows that show what the steps of a print are.
const FEWEST: usize = 30;

/// Even times whose print in coarse steps gives these stamps; `None` where none does. Each stamp
/// may be off by one step of the print.
fn evened(stamps: &[f64]) -> Option<Vec<f64>> {
    let n = stamps.len();
    let (first, last) = (*stamps.first()?, *stamps.last()?);
    let coarsest = stamps.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    let falls = stamps.windows(2).any(|w| w[1] < w[0]);
    if n < FEWEST || last <= first || falls {
        return None;
    }
    // The rows that share the first and the last stamp are anywhere within it: the middle of each.
    let alike = |value: f64| stamps.iter().filter(|t| **t == value).count() as f64;
    let (head, tail) = (alike(first), alike(last));
    let step = (last - first) / (n as f64 - 0.5 * (head + tail));
    let start = first - 0.5 * (head - 1.0) * step;
    let even: Vec<f64> = (0..n).map(|i| start + i as f64 * step).collect();
    let fits = stamps
        .iter()
        .zip(&even)
        .all(|(a, b)| (a - b).abs() <= coarsest);
    // A gap, or stamps that are no even time, have steps longer than those of a print.
    let is_print = coarsest <= 0.02 * (last - first);
    (fits && is_print).then_some(even)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_time_is_seen_through_a_coarse_print() {
        let print = |t: f64| (t * 1e3).round() / 1e3;
        let stamps: Vec<f64> = (0..1000).map(|i| print(5.0 + 4e-4 * i as f64)).collect();
        let read = read(&stamps);
        assert_eq!(
            (read.even, read.repeated.len(), read.runs.len()),
            (1000, 0, 1)
        );
        for (i, t) in read.time.iter().enumerate() {
            assert!((t - (5.0 + 4e-4 * i as f64)).abs() < 1e-3, "{i}: {t}");
        }
        assert!(read.time.windows(2).all(|w| w[1] > w[0]));
    }

    #[test]
    fn repeated_rows_of_an_exact_clock_are_not_made_even() {
        let mut stamps: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).collect();
        stamps[500] = stamps[499];
        (0..40).for_each(|i| stamps.insert(200, 0.01 * f64::from(199 - i % 2)));
        stamps.sort_by(f64::total_cmp);
        let read = read(&stamps);
        assert_eq!((read.even, read.repeated.len()), (0, 41));
    }

    #[test]
    fn a_log_may_have_its_newest_row_first() {
        let grows: Vec<f64> = (0..40).map(f64::from).collect();
        let falls: Vec<f64> = grows.iter().rev().copied().collect();
        assert!(is_backwards(&falls) && !is_backwards(&grows));
        // A clock that was set back once, and a few rows.
        let mut once = grows.clone();
        once.extend(&grows);
        assert!(!is_backwards(&once) && !is_backwards(&falls[..10]));
    }

    #[test]
    fn a_clock_that_falls_begins_a_run_and_an_early_row_does_not() {
        let up = |n: usize| (0..n).map(|i| 0.01 * i as f64);
        let stamps: Vec<f64> = up(100).chain(up(60)).collect();
        let two = read(&stamps);
        assert_eq!(two.runs, [0..100, 100..160]);
        let mut stamps: Vec<f64> = up(100).collect();
        stamps[50] = 0.005;
        let one = read(&stamps);
        assert_eq!((one.runs.len(), one.early), (1, vec![50]));
        // Nothing but falls: no clock that was set back.
        let stamps: Vec<f64> = up(100).collect::<Vec<_>>().into_iter().rev().collect();
        let none = read(&stamps);
        assert_eq!((none.runs.len(), none.early.len()), (1, 99));
    }
}
