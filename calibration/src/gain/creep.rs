//! Creep of a cell from the time course of a series: weights that are put on, left for a while, and
//! taken off.
//!
//! A cell that creeps reads `F + s` under a load `F`, with `ds/dt = (share F - s) / tau`. For a
//! series of loads that is `s = share G(tau)`, where `G` follows from the loads and their times
//! alone: linear in the share, so that only the time constant has to be searched. Hysteresis looks
//! alike where each load is read once; a load that is read while it stays tells them apart, so
//! creep is looked for only in a series with such a hold.
//!
//! The time at which a load came on has an error. A change from `F0` to `F1` that comes by `e`
//! later moves `s` at a time `t` after it by `share e (F0 - F1)/tau exp(-t/tau)`: an error that the
//! readings after the change share.

use super::{Options, Reading};
use nalgebra::{DMatrix, DVector};

/// Readings of one load in a row that make a hold.
const HOLD: usize = 5;
/// How a cell creeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CreepTerm {
    /// Share of a lasting load by which the reading grows.
    pub share: f64,
    /// Its standard error.
    pub share_se: f64,
    /// Time constant, s.
    pub time_s: f64,
    /// 95 % interval of it, s.
    pub time_95_s: (f64, f64),
}

/// Whether these readings can tell creep: times, and a load that was read while it stayed.
pub(super) fn can_tell(used: &[Reading]) -> bool {
    let timed = used
        .windows(2)
        .all(|pair| match (pair[0].time_s, pair[1].time_s) {
            (Some(a), Some(b)) => b > a,
            _ => false,
        });
    let held = used
        .windows(HOLD)
        .any(|run| run[0].weight_g > 0.0 && run.iter().all(|r| r.weight_g == run[0].weight_g));
    timed && held
}

/// A change of the load within a series.
struct Change {
    /// The first reading after it.
    reading: usize,
    /// When, s, and the standard error of that, s.
    at: (f64, f64),
    /// Whether that was seen, and not guessed.
    seen: bool,
    /// The load before and after it, N.
    load: (f64, f64),
}

/// The changes of the load, in the order of the readings.
fn changes(used: &[Reading], options: &Options) -> Vec<Change> {
    let mut out = Vec::new();
    for (i, pair) in used.windows(2).enumerate() {
        let load = (
            options.force_n(pair[0].weight_g),
            options.force_n(pair[1].weight_g),
        );
        if load.0 == load.1 {
            continue;
        }
        let from = pair[0].time_s.unwrap_or(0.0);
        let to = pair[1].time_s.unwrap_or(from).max(from);
        let at = match pair[1].since_s {
            Some(since) => (
                since.clamp(from, to),
                pair[1].since_sd_s.unwrap_or(options.load_time_sd_s),
            ),
            // Where nothing else is known, any time between the two readings is as likely as
            // another.
            None => (0.5 * (from + to), (to - from) / 12f64.sqrt()),
        };
        out.push(Change {
            reading: i + 1,
            at,
            seen: pair[1].since_s.is_some(),
            load,
        });
    }
    out
}

/// `G(tau)` of each reading, N: the creep of a cell whose share is 1. The cell starts relaxed at
/// the first reading.
pub(super) fn course(used: &[Reading], options: &Options, tau_s: f64) -> Vec<f64> {
    let mut crept = 0.0;
    let mut at = used.first().and_then(|r| r.time_s).unwrap_or(0.0);
    let mut load = used.first().map_or(0.0, |r| options.force_n(r.weight_g));
    let mut changes = changes(used, options).into_iter().peekable();
    let mut out = Vec::with_capacity(used.len());
    for (i, reading) in used.iter().enumerate() {
        if let Some(change) = changes.next_if(|change| change.reading == i) {
            let when = change.at.0.max(at);
            crept = passed(crept, load, (when - at) / tau_s);
            (at, load) = (when, change.load.1);
        }
        let time = reading.time_s.unwrap_or(at).max(at);
        crept = passed(crept, load, (time - at) / tau_s);
        at = time;
        out.push(crept);
    }
    out
}

/// Covariance of the codes from the errors of the times at which the loads came on, codes^2. Times
/// that were seen have errors of their own. Guessed ones have one error in common: who hangs
/// weights does it at the same pace each time. `creep`: its share, and its time constant, s.
pub(super) fn time_covariance(
    used: &[Reading],
    options: &Options,
    creep: (f64, f64),
    codes_per_n: f64,
) -> DMatrix<f64> {
    let n = used.len();
    let mut out = DMatrix::zeros(n, n);
    let (share, tau_s) = creep;
    if share == 0.0 {
        // Not known yet, and neither is the time constant.
        return out;
    }
    let mut guessed = DVector::zeros(n);
    for change in changes(used, options) {
        let (at_s, sd_s) = change.at;
        let moved = share * codes_per_n * sd_s * (change.load.0 - change.load.1) / tau_s;
        let error = DVector::from_fn(n, |i, _| match used[i].time_s {
            Some(time_s) if i >= change.reading => {
                moved * (-(time_s - at_s).max(0.0) / tau_s).exp()
            }
            _ => 0.0,
        });
        if change.seen {
            out += &error * error.transpose();
        } else {
            guessed += error;
        }
    }
    out + &guessed * guessed.transpose()
}

/// What has crept after so many time constants under a load, N.
fn passed(crept: f64, load: f64, time_constants: f64) -> f64 {
    crept - (load - crept) * (-time_constants).exp_m1()
}

/// Derivative of [`course`] by the logarithm of the time constant, N.
pub(super) fn course_by_log_tau(used: &[Reading], options: &Options, tau_s: f64) -> Vec<f64> {
    const STEP: f64 = 1e-3;
    let above = course(used, options, tau_s * STEP.exp());
    let below = course(used, options, tau_s * (-STEP).exp());
    let pairs = above.iter().zip(&below);
    pairs.map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
}
