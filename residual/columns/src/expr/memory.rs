//! Operators with memory: they run along each sequence and start afresh at the next.

use crate::frame::Frame;
use crate::parallel;
use std::ops::Range;

/// Sign of `x`, 0 where its magnitude is up to `band`.
pub(super) fn sgn(x: f64, band: f64) -> f64 {
    if x > band {
        1.0
    } else if x < -band {
        -1.0
    } else {
        0.0
    }
}

/// Sequences that [`along`] runs side by side.
const LANES: usize = 4;

/// The rows of each sequence of a column, apart.
fn pieces<'a>(frame: &Frame, mut v: &'a mut [f64]) -> Vec<(Range<usize>, &'a mut [f64])> {
    let mut at = 0;
    let mut out = Vec::with_capacity(frame.sequences().len());
    for range in frame.sequences() {
        let (_, rest) = v.split_at_mut(range.start - at);
        let (own, rest) = rest.split_at_mut(range.len());
        out.push((range.clone(), own));
        (v, at) = (rest, range.end);
    }
    out
}

/// Runs an operator along each sequence: `first(x)` gives the state and the value of the first row,
/// `step(state, x, dt)` the value of each further one, `dt` after the one before.
///
/// Each step waits for the one before it, so a few sequences run side by side.
fn along<S: Copy + Send>(
    frame: &Frame,
    mut v: Vec<f64>,
    first: impl Fn(f64) -> (S, f64) + Send + Sync,
    step: impl Fn(&mut S, f64, f64) -> f64 + Send + Sync,
) -> Vec<f64> {
    let rows = v.len();
    let mut all = pieces(frame, &mut v);
    all.retain(|(range, _)| !range.is_empty());
    // Sequences of like length in one group.
    all.sort_by_key(|(range, _)| std::cmp::Reverse(range.len()));
    let groups: Vec<_> = all.chunks_mut(LANES).collect();
    let begin = |v: &mut [f64]| {
        let (state, value) = first(v[0]);
        v[0] = value;
        state
    };
    let row = |state: &mut S, t: &[f64], v: &mut [f64], i: usize| {
        v[i] = step(state, v[i], t[i] - t[i - 1]);
    };
    parallel::each(rows, groups, |group| match group {
        [a, b, c, d] => {
            let shortest = d.0.len();
            let mut lanes =
                [a, b, c, d].map(|(range, v)| (begin(v), &frame.time()[range.clone()], v));
            for i in 1..shortest {
                for (state, t, v) in &mut lanes {
                    row(state, t, v, i);
                }
            }
            for (state, t, v) in &mut lanes {
                (shortest..v.len()).for_each(|i| row(state, t, v, i));
            }
        }
        _ => {
            for (range, v) in group {
                let (mut state, t) = (begin(v), &frame.time()[range.clone()]);
                (1..v.len()).for_each(|i| row(&mut state, t, v, i));
            }
        }
    });
    v
}

/// Runs `step(values, time)` on each sequence.
fn each(
    frame: &Frame,
    mut v: Vec<f64>,
    step: impl Fn(&mut [f64], &[f64]) + Send + Sync,
) -> Vec<f64> {
    let rows = v.len();
    parallel::each(rows, pieces(frame, &mut v), |(range, v)| {
        step(v, &frame.time()[range]);
    });
    v
}

/// The last sign beyond `band`; 0 before the first.
pub(super) fn held(frame: &Frame, v: Vec<f64>, band: f64) -> Vec<f64> {
    let next = |last: f64, x| match sgn(x, band) {
        0.0 => last,
        s => s,
    };
    along(
        frame,
        v,
        |x| (next(0.0, x), next(0.0, x)),
        |last, x, _| {
            *last = next(*last, x);
            *last
        },
    )
}

/// At rest the next sign beyond `band`, times exp(-(time to it) / tau); 0 in motion.
pub(super) fn ahead(frame: &Frame, v: Vec<f64>, band: f64, tau: f64) -> Vec<f64> {
    each(frame, v, |v, t| {
        let mut next: Option<(f64, f64)> = None;
        for (x, t) in v.iter_mut().zip(t).rev() {
            let s = sgn(*x, band);
            *x = if s != 0.0 {
                next = Some((s, *t));
                0.0
            } else {
                next.map_or(0.0, |(s, at)| s * (-(at - t) / tau).exp())
            };
        }
    })
}

/// Time integral from the start of the sequence (trapezoid).
pub(super) fn integral(frame: &Frame, v: Vec<f64>) -> Vec<f64> {
    along(
        frame,
        v,
        |x| ((0.0, x), 0.0),
        |(sum, last), x, dt| {
            *sum += 0.5 * (x + *last) * dt;
            *last = x;
            *sum
        },
    )
}

/// First-order lag, from the first value if `settled`, else from zero. Exact for an input that is a
/// straight line between rows.
pub(super) fn lag(frame: &Frame, v: Vec<f64>, tau: f64, settled: bool) -> Vec<f64> {
    along(
        frame,
        v,
        |x| {
            let y = if settled { x } else { 0.0 };
            ((y, x), y)
        },
        |(y, last), x, dt| {
            let (a, mean) = decay(dt.max(0.0) / tau);
            *y = *y * a + *last * (mean - a) + x * (1.0 - mean);
            *last = x;
            *y
        },
    )
}

/// The part of values that is smooth from row to row: two lags of a row each, with what they lose
/// of a ramp put back. The rest is steps of single rows.
#[derive(Clone, Copy)]
struct Smooth {
    last: f64,
    once: f64,
    twice: f64,
}

impl Smooth {
    fn first(x: f64) -> Smooth {
        Smooth {
            last: x,
            once: x,
            twice: x,
        }
    }

    /// The smooth part of the next row.
    fn next(&mut self, x: f64) -> f64 {
        let (a, mean) = decay(1.0);
        let once = self.once * a + self.last * (mean - a) + x * (1.0 - mean);
        self.twice = self.twice * a + self.once * (mean - a) + once * (1.0 - mean);
        (self.last, self.once) = (x, once);
        2.0 * once - self.twice
    }
}

/// First-order lag from the first value. Exact for an input whose smooth part is a straight line
/// between rows, and whose steps act from one row up to the next, in which they are.
pub(super) fn lag_held(frame: &Frame, v: Vec<f64>, tau: f64) -> Vec<f64> {
    along(
        frame,
        v,
        |x| ((Smooth::first(x), x, [x, 0.0]), x),
        |(smooth, last, y), x, dt| {
            let (a, mean) = decay(dt.max(0.0) / tau);
            let slow = smooth.next(x);
            y[0] = y[0] * a + *last * (mean - a) + slow * (1.0 - mean);
            y[1] = y[1] * a + (x - slow) * (1.0 - a);
            *last = slow;
            y[0] + y[1]
        },
    )
}

/// `x` as it was `s` seconds ago, if its smooth part is a straight line between rows, and its steps
/// act from one row up to the next, in which they are; ends held.
pub(super) fn delay_held(frame: &Frame, x: &[f64], s: f64) -> Vec<f64> {
    let smooth = along(
        frame,
        x.to_vec(),
        |x| (Smooth::first(x), x),
        |smooth, x, _| smooth.next(x),
    );
    let late = resample(&smooth, frame, |t, _| t - s);
    let steps: Vec<f64> = x
        .iter()
        .zip(&smooth)
        .map(|(x, smooth)| x - smooth)
        .collect();
    let mut out = reached(&steps, frame, s);
    parallel::combine(&mut out, &late, |steps, late| *steps += late);
    out
}

/// Share of the usual step of time by which a stamp may be off its row.
const STAMP: f64 = 1e-6;

/// `x` of the first row that is not before the time `s` seconds ago; ends held.
fn reached(x: &[f64], frame: &Frame, s: f64) -> Vec<f64> {
    let t = frame.time();
    let early = s + STAMP * frame.step();
    let mut out = vec![0.0; x.len()];
    parallel::each(x.len(), pieces(frame, &mut out), |(range, out)| {
        let mut j = range.start;
        for (i, out) in range.clone().zip(out) {
            while j + 1 < range.end && t[j] < t[i] - early {
                j += 1;
            }
            *out = x[j];
        }
    });
    out
}

/// exp(-u) and its mean from 0 to `u`, for u >= 0. Rows are close beside most time constants and
/// distances, so u is small, and a series is much faster than the library's function: its first
/// term left out is below 1e-16.
fn decay(u: f64) -> (f64, f64) {
    /// 1 / (k + 1)!, with the sign of the term.
    const SERIES: [f64; 8] = [
        1.0,
        -1.0 / 2.0,
        1.0 / 6.0,
        -1.0 / 24.0,
        1.0 / 120.0,
        -1.0 / 720.0,
        1.0 / 5040.0,
        -1.0 / 40320.0,
    ];
    if u < 0.05 {
        let mean = SERIES.iter().rev().fold(0.0, |sum, k| sum * u + k);
        (1.0 - u * mean, mean)
    } else {
        let a = (-u).exp();
        (a, (1.0 - a) / u)
    }
}

/// Backlash operator of total width `2 half`.
pub(super) fn play(frame: &Frame, v: Vec<f64>, half: f64) -> Vec<f64> {
    along(
        frame,
        v,
        |x| (start(x), x),
        |play, x, _| {
            *play = follow(*play, x, half);
            *play
        },
    )
}

/// Elastic-plastic operator: the input less its play.
pub(super) fn stop(frame: &Frame, v: Vec<f64>, half: f64) -> Vec<f64> {
    along(
        frame,
        v,
        |x| (start(x), 0.0 * x),
        |play, x, _| {
            *play = follow(*play, x, half);
            x - *play
        },
    )
}

/// State of a play at the first input. One that is not a number has none, and the next one pushes.
fn start(x: f64) -> f64 {
    match x.is_nan() {
        true => f64::NEG_INFINITY,
        false => x,
    }
}

/// The state of a play moved so that it is at most `half` from the input. Comparisons in this order
/// are one instruction each, `clamp` is several; the state stays where an input is not a number.
fn follow(play: f64, x: f64, half: f64) -> f64 {
    let (low, high) = (x - half, x + half);
    let play = if low > play { low } else { play };
    if high < play {
        high
    } else {
        play
    }
}

/// `x` followed at no more than `rate` per second, from the first value. Exact for an input that is
/// a straight line between rows.
pub(super) fn slew(frame: &Frame, v: Vec<f64>, rate: f64) -> Vec<f64> {
    along(
        frame,
        v,
        |x| (x, x),
        |y, x, dt| {
            *y = follow(x, *y, rate * dt);
            *y
        },
    )
}

/// Dahl's friction state between -1 and 1 with sliding distance `d`.
pub(super) fn dahl(frame: &Frame, v: Vec<f64>, d: f64) -> Vec<f64> {
    along(
        frame,
        v,
        |x| ((0.0, x), 0.0),
        |(z, last), x, _| {
            let dx = x - *last;
            *last = x;
            if dx != 0.0 {
                let s = dx.signum();
                *z = s + (*z - s) * decay(dx.abs() / d).0;
            }
            *z
        },
    )
}

/// Mean over the sequence.
pub(super) fn sequence_mean(frame: &Frame, v: Vec<f64>) -> Vec<f64> {
    each(frame, v, |v, _| {
        let m = v.iter().sum::<f64>() / v.len().max(1) as f64;
        v.fill(m);
    })
}

/// Slope of the least-squares line over `2 half + 1` rows (fewer at the ends of a sequence).
pub(super) fn derivative(x: &[f64], frame: &Frame, half: usize) -> Vec<f64> {
    let t = frame.time();
    let mut out = vec![0.0; x.len()];
    parallel::each(x.len(), pieces(frame, &mut out), |(range, out)| {
        for (i, out) in range.clone().zip(out) {
            let lo = i.saturating_sub(half).max(range.start);
            let hi = (i + half + 1).min(range.end);
            let k = (hi - lo) as f64;
            let (mut st, mut sx, mut stt, mut stx) = (0.0, 0.0, 0.0, 0.0);
            for j in lo..hi {
                let dt = t[j] - t[i];
                st += dt;
                sx += x[j];
                stt += dt * dt;
                stx += dt * x[j];
            }
            let den = stt - st * st / k;
            *out = if den > 0.0 {
                (stx - st * sx / k) / den
            } else {
                0.0
            };
        }
    });
    out
}

/// `x` read at another time, linear between rows, ends held.
pub(super) fn resample(
    x: &[f64],
    frame: &Frame,
    at: impl Fn(f64, f64) -> f64 + Send + Sync,
) -> Vec<f64> {
    let t = frame.time();
    let mut out = vec![0.0; x.len()];
    parallel::each(x.len(), pieces(frame, &mut out), |(range, out)| {
        let first = range.start;
        let mut j = first;
        for (i, out) in range.clone().zip(out) {
            let want = at(t[i], t[first]);
            while j + 1 < range.end && t[j + 1] <= want {
                j += 1;
            }
            while j > first && t[j] > want {
                j -= 1;
            }
            *out = if want <= t[j] || j + 1 >= range.end {
                x[j]
            } else {
                let span = t[j + 1] - t[j];
                if span > 0.0 {
                    x[j] + (x[j + 1] - x[j]) * (want - t[j]) / span
                } else {
                    x[j]
                }
            };
        }
    });
    out
}
