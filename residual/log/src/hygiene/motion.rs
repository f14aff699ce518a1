//! Runs that repeat a motion: what is special to it is in each of them.

use super::values;
use crate::finding::Findings;
use crate::spec::Roles;
use residual_columns::frame::Frame;
use residual_columns::stats;
use std::ops::Range;

/// Shortest run in rows that is compared with others.
const COMPARED: usize = 50;

/// Correlation from which two runs are one motion.
const SAME_MOTION: f64 = 0.98;

/// Name of the check that most runs are one motion.
pub const REPEATED_MOTION: &str = "repeated motion";

/// Runs of one motion do not confirm each other: what is special to that motion is in all of them.
pub(super) fn note_repeated(frame: &Frame, fold: &[u32], log: &mut Findings) {
    let Some(motion) = ["velocity", "angle", "command"]
        .iter()
        .find_map(|n| frame.column(n))
    else {
        return;
    };
    let motion = values::tame(motion);
    let runs = runs_to_compare(frame);
    let same = |a: &Range<usize>, b: &Range<usize>| {
        let n = a.len().min(b.len());
        let longer = a.len().max(b.len());
        10 * n >= 9 * longer
            && correlation(
                &without_line(&motion[a.start..a.start + n]),
                &without_line(&motion[b.start..b.start + n]),
            ) > SAME_MOTION
    };
    let repeats = runs
        .iter()
        .enumerate()
        .filter(|(k, a)| {
            runs.iter()
                .enumerate()
                .any(|(j, b)| j != *k && fold[a.start] != fold[b.start] && same(a, b))
        })
        .count();
    if repeats * 2 > runs.len() && repeats > 1 {
        log.count(
            REPEATED_MOTION,
            repeats,
            "whole record",
            "runs whose motion is that of another run that is held out: the held-out error does not show how the model does \
             on another motion; record one, and give it as check data",
        );
    }
}

/// Points of a run that are compared with those a period later.
const POINTS: usize = 1500;

/// Mean square difference of a motion from itself a period later, over twice its variance, up to
/// which it repeats: an RMS difference of 0.28 standard deviations.
const REPEATS: f64 = 0.04;

/// The same which it must have in between: a slow motion differs little from itself a moment later.
const DIFFERS: f64 = 0.3;

/// Shortest period in blocks of time: with fewer blocks there are too few groups to hold out.
const FEWEST_BLOCKS: f64 = 4.0;

/// Time in which the motion of a run repeats, if it does: whatever is special to that motion is in
/// each pass of it, so blocks of time of two passes do not confirm each other. `None` where it
/// repeats in less than a few blocks.
pub fn period(frame: &Frame, run: &Range<usize>, roles: &Roles, block: f64) -> Option<f64> {
    let time = frame.time();
    let span = time[run.end - 1] - time[run.start];
    if run.len() < COMPARED || span < 1.2 * FEWEST_BLOCKS * block {
        return None;
    }
    let names = ["angle", "velocity", "command"].into_iter();
    let names = names.chain(roles.pose.keys().map(String::as_str));
    let points = POINTS.min(run.len());
    let step = span / (points - 1) as f64;
    // Each column about its mean, in units of its deviation.
    let columns: Vec<Vec<f64>> = names
        .filter_map(|n| frame.column(n))
        .map(|c| at_times(frame, c, run, time[run.start], step, points))
        .map(|c| values::tame(&c))
        .filter_map(|mut c| {
            let (mean, size) = (stats::mean(&c), stats::deviation(&c));
            c.iter_mut().for_each(|x| *x = (*x - mean) / size);
            (size > 0.0).then_some(c)
        })
        .collect();
    let difference = |lag: usize| {
        let of = |c: &Vec<f64>| {
            let pairs = c.iter().zip(&c[lag..]);
            let sum: f64 = pairs.map(|(a, b)| (a - b).powi(2)).sum();
            sum / (2.0 * (points - lag) as f64)
        };
        // The column that repeats least.
        columns.iter().map(of).fold(0.0, f64::max)
    };
    // What is seen twice must be as long as a block or two.
    let most = points - ((2.0 * block / step) as usize).clamp(points / 10, points - 1);
    let (mut differed, mut best) = (false, None);
    for lag in 1..most {
        let d = difference(lag);
        differed |= d > DIFFERS;
        if differed && d < REPEATS && best.is_none_or(|(_, least)| d < least) {
            best = Some((lag, d));
        } else if best.is_some_and(|(at, _)| lag > at + points / 50) {
            break;
        }
    }
    let period = best?.0 as f64 * step;
    (!columns.is_empty() && period >= FEWEST_BLOCKS * block).then_some(period)
}

/// Correlation from which a stretch of other data is the same motion. It is compared in steps of
/// time, so less than [`SAME_MOTION`] is reached.
const SAME_STRETCH: f64 = 0.97;

/// Most relative difference of the size of one motion.
const SAME_SIZE: f64 = 0.1;

/// Values of a stretch that are compared.
const STRETCH: usize = 400;

/// Most runs that are compared with others.
const MOST_RUNS: usize = 64;

/// Number of rows of `other` in runs whose motion is also in `frame`, at any time of it.
pub fn repeated_rows(frame: &Frame, other: &Frame) -> usize {
    let names = ["velocity", "angle", "command"];
    let Some((here, there)) = names
        .iter()
        .find_map(|n| frame.column(n).zip(other.column(n)))
    else {
        return 0;
    };
    let (here, there) = (&values::tame(here), &values::tame(there));
    let all: Vec<Range<usize>> = runs_to_compare(frame);
    if all.is_empty() {
        return 0;
    }
    let duration = |f: &Frame, r: &Range<usize>| f.time()[r.end - 1] - f.time()[r.start];
    let longest = all.iter().map(|r| duration(frame, r)).fold(0.0, f64::max);
    let repeated = |r: &Range<usize>| {
        let span = duration(other, r);
        // A run that is longer than any of the data is compared in pieces.
        let pieces = (span / longest).ceil().max(1.0);
        let step = span / pieces / STRETCH as f64;
        let pieces = (0..pieces as usize).filter(|k| {
            let start = other.time()[r.start] + (*k as f64 * STRETCH as f64) * step;
            let own = at_times(other, there, r, start, step, STRETCH);
            all.iter().any(|a| {
                let count = (duration(frame, a) / step) as usize + 1;
                let data = at_times(frame, here, a, frame.time()[a.start], step, count);
                let count = own.len().min(data.len());
                10 * count >= 9 * own.len()
                    && data.windows(count).any(|w| same_stretch(&own[..count], w))
            })
        });
        pieces.count() as f64 >= 0.5 * (span / longest).ceil().max(1.0)
    };
    let runs = runs_to_compare(other);
    runs.iter().filter(|r| repeated(r)).map(Range::len).sum()
}

/// The runs that are long enough to compare, not more than [`MOST_RUNS`].
fn runs_to_compare(frame: &Frame) -> Vec<Range<usize>> {
    let runs = frame.sequences().iter().filter(|r| r.len() >= COMPARED);
    runs.take(MOST_RUNS).cloned().collect()
}

/// `count` values of a column in a run, in equal steps of time, linear between rows.
fn at_times(
    frame: &Frame,
    column: &[f64],
    run: &Range<usize>,
    start: f64,
    step: f64,
    count: usize,
) -> Vec<f64> {
    let time = frame.time();
    let mut i = run.start;
    let value = |k: usize| {
        let t = start + k as f64 * step;
        while i + 2 < run.end && time[i + 1] < t {
            i += 1;
        }
        let share = ((t - time[i]) / (time[i + 1] - time[i])).clamp(0.0, 1.0);
        column[i] + share * (column[i + 1] - column[i])
    };
    (0..count).map(value).collect()
}

/// Whether two stretches of equal length are one motion, of one size.
fn same_stretch(a: &[f64], b: &[f64]) -> bool {
    let (a, b) = (&without_line(a), &without_line(b));
    let size = stats::deviation(b) / stats::deviation(a);
    (size - 1.0).abs() < SAME_SIZE && correlation(a, b) > SAME_STRETCH
}

/// Values without the straight line through them: two screws that turn on are alike in that alone.
fn without_line(x: &[f64]) -> Vec<f64> {
    let middle = 0.5 * (x.len() as f64 - 1.0);
    let at = |i: usize| i as f64 - middle;
    let mean = stats::mean(x);
    let squares: f64 = (0..x.len()).map(|i| at(i).powi(2)).sum();
    let products: f64 = x.iter().enumerate().map(|(i, v)| at(i) * (v - mean)).sum();
    let slope = if squares > 0.0 {
        products / squares
    } else {
        0.0
    };
    let rest = x.iter().enumerate().map(|(i, v)| v - mean - slope * at(i));
    rest.collect()
}

/// Correlation of two lists of equal length; 0 if one is constant.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (stats::mean(a), stats::mean(b));
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
        ab += (x - ma) * (y - mb);
    }
    if aa > 0.0 && bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log of a motion from `start` on, at a pace, with a step of time.
    fn log(start: f64, pace: f64, step: f64, rows: usize) -> Frame {
        let time: Vec<f64> = (0..rows).map(|i| i as f64 * step).collect();
        let motion = |t: &f64| {
            let t = start + pace * t;
            (1.3 * t).sin() + 0.8 * (1.9 * t + 0.02 * t * t).sin() + 0.4 * (0.37 * t).cos()
        };
        let velocity = time.iter().map(motion).collect();
        Frame::new(
            vec![("velocity".into(), velocity)],
            time,
            std::iter::once(0..rows).collect(),
        )
    }

    #[test]
    fn a_motion_that_repeats_has_a_period() {
        let spec = "roles.time = { column = \"t\" }\nroles.target = { column = \"y\" }\n\
                    [[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let roles = crate::spec::Spec::parse(spec).unwrap().roles;
        let run = |motion: &dyn Fn(f64) -> f64, seconds: f64| {
            let time: Vec<f64> = (0..(seconds * 50.0) as usize)
                .map(|i| i as f64 * 0.02)
                .collect();
            let velocity = time.iter().map(|t| motion(*t)).collect();
            let rows = 0..time.len();
            let frame = Frame::new(
                vec![("velocity".into(), velocity)],
                time,
                std::iter::once(rows.clone()).collect(),
            );
            period(&frame, &rows, &roles, 2.0)
        };
        use std::f64::consts::TAU;
        let exciting = |t: f64| {
            (TAU * t / 12.0).sin() + 0.7 * (TAU * t / 4.0).cos() + 0.5 * (TAU * t / 2.4).sin()
        };
        for seconds in [20.0, 60.0] {
            let found = run(&exciting, seconds).unwrap();
            assert!((found - 12.0).abs() < 0.1, "{found}");
        }
        // A part of a second pass that is shorter than two blocks.
        assert_eq!(run(&exciting, 13.0), None);
        assert_eq!(run(&|t| exciting(t) + 0.6 * (0.83 * t).sin(), 60.0), None);
        // Of one second: blocks of two seconds each hold all of it.
        assert_eq!(run(&|t| (TAU * t).sin(), 60.0), None);
        assert_eq!(run(&|_| 1.0, 60.0), None);
    }

    #[test]
    fn a_motion_is_known_again_at_any_time_and_rate_of_rows() {
        let data = log(0.0, 1.0, 0.02, 3000);
        assert_eq!(repeated_rows(&data, &log(17.31, 1.0, 0.03, 700)), 700);
        assert_eq!(repeated_rows(&data, &log(17.31, 1.3, 0.03, 700)), 0);
        assert_eq!(repeated_rows(&data, &log(170.0, 1.0, 0.03, 700)), 0);
        // Longer than the data: their motion is a part of it only.
        assert_eq!(repeated_rows(&data, &log(-200.0, 1.0, 0.03, 9000)), 0);
        assert_eq!(repeated_rows(&data, &log(3.0, 1.0, 0.03, 20)), 0);
    }
}
