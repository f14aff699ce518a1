//! Operators with memory: they run along each sequence and start afresh at the next.

use crate::frame::Frame;
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

/// Runs `step(state, x)` along each sequence from a state of `start`.
fn along(
    frame: &Frame,
    mut v: Vec<f64>,
    start: f64,
    step: impl Fn(&mut f64, f64) -> f64,
) -> Vec<f64> {
    for range in frame.sequences() {
        let mut state = start;
        for x in &mut v[range.clone()] {
            *x = step(&mut state, *x);
        }
    }
    v
}

/// Runs `step(values, time)` on each sequence.
fn each(frame: &Frame, mut v: Vec<f64>, step: impl Fn(&mut [f64], &[f64])) -> Vec<f64> {
    for range in frame.sequences() {
        let range: Range<usize> = range.clone();
        step(&mut v[range.clone()], &frame.time()[range]);
    }
    v
}

/// The last sign beyond `band`; 0 before the first.
pub(super) fn held(frame: &Frame, v: Vec<f64>, band: f64) -> Vec<f64> {
    along(frame, v, 0.0, |last, x| {
        let s = sgn(x, band);
        if s != 0.0 {
            *last = s;
        }
        *last
    })
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
    each(frame, v, |v, t| {
        let (mut sum, mut last) = (0.0, None);
        for (v, t) in v.iter_mut().zip(t) {
            let x = *v;
            if let Some((px, pt)) = last {
                sum += 0.5 * (x + px) * (t - pt);
            }
            last = Some((x, *t));
            *v = sum;
        }
    })
}

/// First-order lag, from the first value if `settled`, else from zero. Exact for an input that is a
/// straight line between rows.
pub(super) fn lag(frame: &Frame, v: Vec<f64>, tau: f64, settled: bool) -> Vec<f64> {
    each(frame, v, |v, t| {
        let Some(first) = v.first().copied() else {
            return;
        };
        let mut y = if settled { first } else { 0.0 };
        let mut px = first;
        v[0] = y;
        let steps = t.windows(2).map(|t| (t[1] - t[0]).max(0.0) / tau);
        for (v, step) in v[1..].iter_mut().zip(steps) {
            let (a, mean) = decay(step);
            y = y * a + px * (mean - a) + *v * (1.0 - mean);
            px = *v;
            *v = y;
        }
    })
}

/// exp(-u) and its mean from 0 to `u`, for u >= 0. Rows are close beside most time constants and distances, so u is small, and a
/// series is much faster than the library's function: its first term left out is below 1e-16.
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
    along(frame, v, f64::NAN, |play, x| follow(play, x, half))
}

/// Elastic-plastic operator: the input less its play.
pub(super) fn stop(frame: &Frame, v: Vec<f64>, half: f64) -> Vec<f64> {
    along(frame, v, f64::NAN, |play, x| x - follow(play, x, half))
}

/// Moves the play's state so that it is at most `half` from the input.
fn follow(play: &mut f64, x: f64, half: f64) -> f64 {
    // Also from a state that is not a number yet. Comparisons: `clamp` is several times slower in a chain of states.
    let (low, high) = (x - half, x + half);
    if play.is_nan() {
        *play = x;
    }
    if *play < low {
        *play = low;
    }
    if *play > high {
        *play = high;
    }
    *play
}

/// Dahl's friction state between -1 and 1 with sliding distance `d`.
pub(super) fn dahl(frame: &Frame, v: Vec<f64>, d: f64) -> Vec<f64> {
    each(frame, v, |v, _| {
        let Some(mut last) = v.first().copied() else {
            return;
        };
        let mut z = 0.0;
        for v in v {
            let dx: f64 = *v - last;
            last = *v;
            if dx != 0.0 {
                let s = dx.signum();
                z = s + (z - s) * decay(dx.abs() / d).0;
            }
            *v = z;
        }
    })
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
    for range in frame.sequences() {
        for i in range.clone() {
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
            out[i] = if den > 0.0 {
                (stx - st * sx / k) / den
            } else {
                0.0
            };
        }
    }
    out
}

/// `x` read at another time, linear between rows, ends held.
pub(super) fn resample(x: &[f64], frame: &Frame, at: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let t = frame.time();
    let mut out = vec![0.0; x.len()];
    for range in frame.sequences() {
        let Some(first) = range.clone().next() else {
            continue;
        };
        let mut j = first;
        for i in range.clone() {
            let want = at(t[i], t[first]);
            while j + 1 < range.end && t[j + 1] <= want {
                j += 1;
            }
            while j > first && t[j] > want {
                j -= 1;
            }
            out[i] = if want <= t[j] || j + 1 >= range.end {
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
    }
    out
}
