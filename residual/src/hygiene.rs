//! Flaws of measured logs: time base, gaps, repeats, spikes, clipping, quantisation, a 256-fold
//! scale. Each is reported, and handled only as the model file asks.

use crate::format::num;
use crate::frame::Frame;
use crate::spec::{Action, Hygiene, Roles};
use crate::stats;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// One kind of flaw, summed over the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Finding {
    /// Name of the check.
    pub check: String,
    /// How many rows (or places) show it.
    pub count: usize,
    /// Where it was seen first.
    pub first: String,
    /// What was seen and what was done, in words.
    pub what: String,
}

/// Collects findings, one per check.
#[derive(Debug, Clone, Default)]
pub(crate) struct Log(Vec<Finding>);

impl Log {
    /// Adds `n` cases of `check`; nothing is noted for 0.
    pub(crate) fn count(&mut self, check: &str, n: usize, first: &str, what: &str) {
        if n == 0 {
            return;
        }
        match self.0.iter_mut().find(|f| f.check == check) {
            Some(f) => f.count += n,
            None => self.0.push(Finding {
                check: check.into(),
                count: n,
                first: first.into(),
                what: what.into(),
            }),
        }
    }

    pub(crate) fn done(self) -> Vec<Finding> {
        self.0
    }
}

/// What was done about a flaw.
fn done(action: Action) -> &'static str {
    match action {
        Action::Report => "reported only",
        Action::Drop => "left out of the fit",
        Action::Fix => "corrected",
    }
}

/// Looks for flaws in the target and the columns; corrects or masks rows as the model file says.
/// `files` are those that the frame's `file` column counts.
pub(crate) fn inspect(
    frame: &mut Frame,
    keep: &mut [bool],
    spec: &Hygiene,
    files: &[PathBuf],
    log: &mut Log,
) {
    time_base(frame, log);
    let mut y = frame.column("target").unwrap_or(&[]).to_vec();
    let mut found = |check: &str, rows: &[usize], action: Action, what: &str, frame: &Frame| {
        let Some(&first) = rows.first() else {
            return;
        };
        log.count(
            check,
            rows.len(),
            &place(first, frame, files),
            &format!("{what}: {}", done(action)),
        );
        if action == Action::Drop {
            rows.iter().for_each(|&i| keep[i] = false);
        }
    };

    let scaled = scaled256(&y);
    let what = "target values 256 times too large (a 24-bit value left-justified in 32 bits)";
    found("scale256", &scaled, spec.scale256, what, frame);
    if spec.scale256 == Action::Fix && !scaled.is_empty() {
        scaled.iter().for_each(|&i| y[i] /= 256.0);
        frame.insert("target", y.clone());
    }

    let what = "isolated target values far from both neighbours";
    found("spike", &spikes(&y, frame), spec.spikes, what, frame);

    let clipped = clipped(&y, frame);
    if let Some(&first) = clipped.first() {
        let what = format!("target stuck at {}, the end of its range", num(y[first]));
        found("clipping", &clipped, spec.clipping, &what, frame);
    }

    let repeated = repeats(frame);
    if repeated.len() * 100 > frame.len() {
        let what = "rows that repeat every value of the row before";
        found("repeat", &repeated, spec.repeats, what, frame);
    }
    quantised(frame, log);
}

/// Where a row is: its file and time.
fn place(row: usize, frame: &Frame, files: &[PathBuf]) -> String {
    let file = frame
        .column("file")
        .and_then(|f| files.get(f[row] as usize))
        .and_then(|f| f.file_name())
        .map_or(String::new(), |f| format!("{}, ", f.to_string_lossy()));
    format!("{file}time {} s", num(frame.time()[row]))
}

/// Rows whose value is 256 times too large: a reading left-justified in 32 bits instead of 24.
fn scaled256(y: &[f64]) -> Vec<usize> {
    let mut sizes: Vec<f64> = y.iter().map(|v| v.abs()).filter(|v| *v > 0.0).collect();
    let Some(typical) = stats::median(&mut sizes) else {
        return vec![];
    };
    let lo = stats::quantile_sorted(&sizes, 0.05);
    let hi = stats::quantile_sorted(&sizes, 0.90) * 1.5;
    (0..y.len())
        .filter(|&i| {
            y[i].abs() > 60.0 * typical && y[i].abs() / 256.0 >= lo && y[i].abs() / 256.0 <= hi
        })
        .collect()
}

/// Notes the columns that move in steps.
fn quantised(frame: &Frame, log: &mut Log) {
    for name in frame.names() {
        if ["time", "elapsed", "file"].contains(&name.as_str()) {
            continue;
        }
        let c = frame.column(name).unwrap_or(&[]);
        if let Some(q) = stats::quantum(c) {
            log.count(
                &format!("quantised {name}"),
                c.len(),
                "whole record",
                &format!("column `{name}` moves in steps of {}", num(q)),
            );
        }
    }
}

/// Notes the time base.
fn time_base(frame: &Frame, log: &mut Log) {
    let mut steps: Vec<f64> = frame
        .sequences()
        .iter()
        .flat_map(|r| frame.time()[r.clone()].windows(2).map(|w| w[1] - w[0]))
        .collect();
    let Some(mid) = stats::median(&mut steps) else {
        return;
    };
    let (lo, hi) = (
        stats::quantile_sorted(&steps, 0.05),
        stats::quantile_sorted(&steps, 0.95),
    );
    log.count(
        "time base",
        frame.len(),
        "whole record",
        &format!(
            "median step {} s ({} rows/s); 5 % to 95 %: {} to {} s; {} sequences",
            num(mid),
            num(1.0 / mid),
            num(lo),
            num(hi),
            frame.sequences().len()
        ),
    );
}

/// Rows whose target is far from both neighbours, on the same side.
fn spikes(y: &[f64], frame: &Frame) -> Vec<usize> {
    let mut out = Vec::new();
    for r in frame.sequences() {
        if r.len() < 20 {
            continue;
        }
        let bend = |i: usize| y[i] - 0.5 * (y[i - 1] + y[i + 1]);
        let mut sizes: Vec<f64> = (r.start + 1..r.end - 1).map(|i| bend(i).abs()).collect();
        let mad = stats::median(&mut sizes).unwrap_or(0.0);
        let scale = (1.4826 * mad).max(0.2 * stats::quantile_sorted(&sizes, 0.95));
        if scale == 0.0 {
            continue;
        }
        for i in r.start + 1..r.end - 1 {
            let (a, b) = (y[i] - y[i - 1], y[i] - y[i + 1]);
            if a * b > 0.0 && a.abs().min(b.abs()) > 12.0 * scale {
                out.push(i);
            }
        }
    }
    out
}

/// Rows in runs of five or more at the largest or smallest value of the record.
fn clipped(y: &[f64], frame: &Frame) -> Vec<usize> {
    let hi = y.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let lo = y.iter().copied().fold(f64::INFINITY, f64::min);
    if hi == lo {
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

/// Rows that repeat every value of the row before, apart from the time.
fn repeats(frame: &Frame) -> Vec<usize> {
    let cols: Vec<&[f64]> = frame
        .names()
        .iter()
        .filter(|n| *n != "time" && *n != "elapsed")
        .filter_map(|n| frame.column(n))
        .collect();
    frame
        .sequences()
        .iter()
        .flat_map(|r| r.start + 1..r.end.max(r.start + 1))
        .filter(|&i| cols.iter().all(|c| c[i] == c[i - 1]))
        .collect()
}

/// Shortest run in rows that is compared with others.
const COMPARED: usize = 50;

/// Correlation from which two runs are one motion.
const SAME_MOTION: f64 = 0.98;

/// Relative error of the speed column against the slope of the angle that is reported.
const SPEED_ERROR: f64 = 0.05;

/// Notes columns that contradict each other, and runs that repeat one motion.
pub(crate) fn relations(frame: &Frame, roles: &Roles, fold: &[u32], log: &mut Log) {
    speed_against_angle(frame, roles, log);
    repeated_motion(frame, fold, log);
}

/// The speed must be the slope of the angle where the units say so.
fn speed_against_angle(frame: &Frame, roles: &Roles, log: &mut Log) {
    let (Some(angle), Some(velocity)) = (&roles.angle, &roles.velocity) else {
        return;
    };
    if velocity.unit != format!("{}/s", angle.unit) {
        return;
    }
    let (Some(x), Some(v)) = (frame.column("angle"), frame.column("velocity")) else {
        return;
    };
    let time = frame.time();
    let (mut vv, mut vs, mut ss) = (0.0, 0.0, 0.0);
    for r in frame.sequences() {
        for i in r.start + 1..r.end.saturating_sub(1).max(r.start + 1) {
            let slope = (x[i + 1] - x[i - 1]) / (time[i + 1] - time[i - 1]);
            vv += v[i] * v[i];
            vs += v[i] * slope;
            ss += slope * slope;
        }
    }
    if vv <= 0.0 || ss <= 0.0 {
        return;
    }
    let (ratio, agreement) = (vs / vv, vs / (vv * ss).sqrt());
    if agreement.abs() > 0.9 && (ratio - 1.0).abs() > SPEED_ERROR {
        log.count(
            "speed against angle",
            frame.len(),
            "whole record",
            &format!(
                "the slope of the angle is {} times the velocity column: the time stamps, a unit or a scale is wrong, and every \
                 mass, damping and delay with it",
                num(ratio)
            ),
        );
    }
}

/// Runs of one motion do not confirm each other: what is special to that motion is in all of them.
fn repeated_motion(frame: &Frame, fold: &[u32], log: &mut Log) {
    let Some(motion) = ["velocity", "angle", "command"]
        .iter()
        .find_map(|n| frame.column(n))
    else {
        return;
    };
    let runs: Vec<&std::ops::Range<usize>> = frame
        .sequences()
        .iter()
        .filter(|r| r.len() >= COMPARED)
        .take(64)
        .collect();
    let same = |a: &std::ops::Range<usize>, b: &std::ops::Range<usize>| {
        let n = a.len().min(b.len());
        let longer = a.len().max(b.len());
        10 * n >= 9 * longer
            && correlation(&motion[a.start..a.start + n], &motion[b.start..b.start + n])
                > SAME_MOTION
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
            "repeated motion",
            repeats,
            "whole record",
            "runs whose motion is that of another run that is held out: the held-out error does not show how the model does \
             on another motion; record one, and give it as check data",
        );
    }
}

/// Correlation of two lists of equal length; 0 if one is constant.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
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
