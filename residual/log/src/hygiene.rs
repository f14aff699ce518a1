//! Flaws of measured logs: time base, gaps, repeats, codes for missing values, spikes, clipping,
//! quantisation, a 256-fold scale, an angle that begins again after each turn. Each is reported,
//! and handled only as the model file asks.
//!
//! | file | concern |
//! |---|---|
//! | `values.rs` | values that are no measurement |
//! | `clock.rs` | stamps that are not those of the rows |
//! | `columns.rs` | columns that contradict each other, or have another unit in one file |
//! | `motion.rs` | runs that repeat a motion |

mod clock;
mod columns;
mod motion;
mod values;

pub use columns::{refuse_dead_velocity, OTHER_UNIT, SPEED_AGAINST_ANGLE};
pub use motion::{period, repeated_rows, REPEATED_MOTION};

use crate::finding::Findings;
use crate::spec::{Action, Roles, Spec};
use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::stats;
use residual_columns::units::radians;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// What is said of a flaw that was left as it is.
pub const REPORTED_ONLY: &str = "reported only";

/// What was done about a flaw.
fn done(action: Action) -> &'static str {
    match action {
        Action::Report => REPORTED_ONLY,
        Action::Drop => "left out of the fit",
        Action::Fix => "corrected",
    }
}

/// Name of the check that few rows carry most of the squared error.
pub const FEW_ROWS: &str = "few rows";

/// Name of the finding on few logs whose error is far above that of the others.
pub const UNLIKE_LOG: &str = "unlike log";

/// Name of the check that the rows are stamped in bunches.
pub const BUNCHED: &str = "stamps in bunches";

/// Name of the check that the target stops at the end of its range.
pub const CLIPPING: &str = "clipping";

/// Name of the check that the target is logged more often than it is measured.
pub const HELD: &str = "held target";

/// Looks for flaws in the target and the columns; corrects or masks rows as the model file says.
/// `files` are those that the frame's `file` column counts. Gives the rows whose target is no
/// measurement and that are still fitted, and the values per second of a target that is logged more
/// often than it is measured.
pub fn inspect(
    frame: &mut Frame,
    keep: &mut [bool],
    spec: &Spec,
    files: &[PathBuf],
    log: &mut Findings,
) -> (Vec<usize>, Option<f64>) {
    let mut suspects = stand_ins(frame, keep, spec, files, log);
    time_base(frame, log);
    wrapped_angle(frame, spec, files, log);
    let spec = &spec.hygiene;
    let mut y = frame.column("target").unwrap_or(&[]).to_vec();
    let mut found = |check: &str, rows: &[usize], action: Action, what: &str, frame: &Frame| {
        left_out(check, rows, action, what, (frame, files), keep, log);
    };

    // What stands for a missing value says nothing about the others.
    let measured = values::bridged(&y, &suspects, frame);
    let scaled = scaled256(&measured);
    let what = "target values 256 times too large (a 24-bit value left-justified in 32 bits)";
    found("scale256", &scaled, spec.scale256, what, frame);
    let mut measured = measured;
    if spec.scale256 == Action::Fix && !scaled.is_empty() {
        for &i in &scaled {
            y[i] /= 256.0;
            measured[i] /= 256.0;
        }
        frame.insert("target", y.clone());
    }

    let what = "isolated target values far from their neighbours";
    let spikes = values::spikes(&measured, frame);
    found("spike", &spikes, spec.spikes, what, frame);
    let measured = values::bridged(&measured, &spikes, frame);

    let clipped = values::clipped(&measured, frame);
    if let Some(&first) = clipped.first() {
        let what = format!("target stuck at {}, the end of its range", num(y[first]));
        found(CLIPPING, &clipped, spec.clipping, &what, frame);
    }

    let mut values_per_s = None;
    let repeated = repeats(frame);
    let held = values::held(&measured, frame);
    // Rows at rest repeat all that they have; where most that repeat the target do not, it is the
    // target alone that is held.
    let of_rows = |h: &values::Held| repeated.len() * 2 > h.rows.len();
    if repeated.len() * 100 > frame.len() && held.as_ref().is_none_or(of_rows) {
        let what = "rows that repeat every value of the row before";
        found("repeat", &repeated, spec.repeats, what, frame);
    } else if let Some(held) = held {
        let [least, most] = held.lengths;
        let rows = if least == most {
            format!("{least}")
        } else {
            format!("{least} to {most}")
        };
        let what = format!(
            "the target holds each value for {rows} rows: it has about {} values/s and was logged more often. Rows that repeat it \
             count as measurements that they are not; hygiene.repeats = \"drop\" keeps the first row of each value",
            num(held.rate)
        );
        found(HELD, &held.rows, spec.repeats, &what, frame);
        values_per_s = Some(held.rate);
    }
    quantised(frame, log);
    suspects.extend(spikes);
    suspects.extend(scaled.iter().filter(|_| spec.scale256 == Action::Report));
    suspects.sort_unstable();
    suspects.dedup();
    suspects.retain(|i| keep[*i]);
    (suspects, values_per_s)
}

/// Notes the rows of a check, and leaves them out of the fit where the model file asks for it.
fn left_out(
    check: &str,
    rows: &[usize],
    action: Action,
    what: &str,
    (frame, files): (&Frame, &[PathBuf]),
    keep: &mut [bool],
    log: &mut Findings,
) {
    let Some(&first) = rows.first() else {
        return;
    };
    let place = place(first, frame, files);
    let said = format!("{what}: {}", done(action));
    log.count(check, rows.len(), &place, &said);
    if action == Action::Drop {
        let fitted = rows.iter().filter(|i| keep[**i]).count();
        // The cause alone; the check says what to do about it.
        let cause = what.split([':', ';']).next().unwrap_or(what);
        log.lose(cause, fitted, &place);
        rows.iter().for_each(|&i| keep[i] = false);
    }
}

/// Notes values that stand for a missing one, in each column; leaves their rows out where the model
/// file asks for it. Operators with memory then see the line between the rows beside them. Gives
/// the rows of the target that have such a value.
fn stand_ins(
    frame: &mut Frame,
    keep: &mut [bool],
    spec: &Spec,
    files: &[PathBuf],
    log: &mut Findings,
) -> Vec<usize> {
    let roles = spec.roles.all();
    let action = spec.hygiene.spikes;
    let mut of_target = Vec::new();
    let names = frame.names().to_vec();
    let groups = &spec.roles.groups;
    let is_made = |n: &str| crate::spec::MADE.contains(&n) || groups.contains_key(n);
    for name in names.iter().filter(|n| !is_made(n)) {
        let role = roles.iter().find(|(role, _)| role == name).map(|(_, c)| *c);
        let x = frame.column(name).unwrap_or(&[]);
        let codes = values::codes(x, frame, role, name == "target");
        let mut rows: Vec<usize> = codes.iter().flat_map(|c| c.rows.iter().copied()).collect();
        rows.sort_unstable();
        let said: Vec<String> = codes
            .iter()
            .map(|c| format!("{} in {} row(s)", num(c.value), c.rows.len()))
            .collect();
        let column = role.map_or(name.as_str(), |c| c.column.as_str());
        let what = format!(
            "column `{column}` has {}: a value that stands for a missing one or for the end of a converter's range",
            said.join(", ")
        );
        let check = format!("code in {name}");
        left_out(&check, &rows, action, &what, (frame, files), keep, log);
        if name == "target" {
            of_target = rows;
        } else if action == Action::Drop && !rows.is_empty() {
            let bridged = values::bridged(x, &rows, frame);
            frame.insert(name, bridged);
        }
    }
    of_target
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

/// Shares of a turn: up to the first a step from row to row is a motion, from the second on the
/// angle began again.
const STEP: f64 = 0.25;
const JUMP: f64 = 0.75;

/// Notes an angle that begins again after each turn, or makes it go on. Where the velocity has a
/// column of its own, a spring and ripples that are no whole number a turn need it.
fn wrapped_angle(frame: &mut Frame, spec: &Spec, files: &[PathBuf], log: &mut Findings) {
    let Some(angle) = &spec.roles.angle else {
        return;
    };
    let (Some(radians), Some(x)) = (radians(&angle.unit), frame.column("angle")) else {
        return;
    };
    let turn = TAU / radians;
    let mut x = x.to_vec();
    let mut jumps = Vec::new();
    for r in frame.sequences() {
        for i in r.start + 1..r.end {
            let share = (x[i] - x[i - 1]).abs() / turn;
            if share >= JUMP {
                jumps.push(i);
            } else if share > STEP {
                // Steps of every size: what is a jump cannot be told.
                return;
            }
        }
    }
    let (lo, hi) = stats::range(&x);
    let Some(&first) = jumps.first().filter(|_| hi - lo <= turn * (1.0 + 1e-6)) else {
        return;
    };
    let fix = spec.hygiene.wraps == Action::Fix;
    let what = if fix {
        "places where the angle begins again after a turn: it was made to go on"
    } else if spec.roles.velocity.is_some() {
        "places where the angle begins again after a turn: springs, gaps and ripples that are no whole number a turn are not seen. \
         Set hygiene.wraps = \"fix\" to make the angle go on"
    } else {
        "places where the angle begins again after a turn. The velocity is its slope and jumps there: set hygiene.wraps = \"fix\" to \
         make the angle go on, or name a column in roles.velocity"
    };
    log.count(
        "wrapped angle",
        jumps.len(),
        &place(first, frame, files),
        what,
    );
    if fix {
        let mut next = jumps.iter().peekable();
        for r in frame.sequences() {
            let mut turns = 0.0;
            let mut before = x[r.start];
            for i in r.clone() {
                if next.next_if(|j| **j == i).is_some() {
                    turns += if x[i] < before { turn } else { -turn };
                }
                before = x[i];
                x[i] += turns;
            }
        }
        frame.insert("angle", x);
    }
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
fn quantised(frame: &Frame, log: &mut Findings) {
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
fn time_base(frame: &Frame, log: &mut Findings) {
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
    let bunches = clock::bunches(frame, mid);
    let rate = bunches.as_ref().map_or(1.0 / mid, |(_, rate)| *rate);
    log.count(
        "time base",
        frame.len(),
        "whole record",
        &format!(
            "median step {} s ({} rows/s); 5 % to 95 %: {} to {} s; {} sequences",
            num(mid),
            num(rate),
            num(lo),
            num(hi),
            frame.sequences().len()
        ),
    );
    if let Some((bunch, rate)) = bunches {
        log.count(
            BUNCHED,
            frame.len(),
            "whole record",
            &format!(
                "the stamps come in bunches: {bunch}. They are the times at which the rows arrived and not those of the measurement, so \
                 every slope, mass and delay is wrong; on the whole there are {} rows/s. Log the time of the measurement, or write even \
                 stamps: input.rate = {} and roles.time with a name that is no column",
                num(rate),
                num(rate)
            ),
        );
    }
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

/// Notes columns that contradict each other or are made of each other, and runs that repeat one
/// motion.
pub fn relations(
    frame: &Frame,
    roles: &Roles,
    fold: &[u32],
    files: &[PathBuf],
    log: &mut Findings,
) {
    columns::note(frame, roles, files, log);
    motion::note_repeated(frame, fold, log);
}
