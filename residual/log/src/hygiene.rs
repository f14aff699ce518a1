//! Flaws of measured logs: time base, gaps, repeats, codes for missing values, spikes, clipping,
//! quantisation, a 256-fold scale, an angle that begins again after each turn. Each is reported,
//! and handled only as the model file asks.
//!
//! | file | concern |
//! |---|---|
//! | `values.rs` | values that are no measurement |
//! | `clock.rs` | stamps that are not those of the rows |

mod clock;
mod values;

use crate::finding::Findings;
use crate::spec::{Action, Roles, Spec};
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::stats;
use residual_columns::units::{factor, radians};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;
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

/// Shortest run in rows that is compared with others.
const COMPARED: usize = 50;

/// Correlation from which two runs are one motion.
const SAME_MOTION: f64 = 0.98;

/// Name of the check that two columns contradict each other.
pub const SPEED_AGAINST_ANGLE: &str = "speed against angle";

/// Name of the check that most runs are one motion.
pub const REPEATED_MOTION: &str = "repeated motion";

/// Relative error of the speed column against the slope of the angle that is reported.
const SPEED_ERROR: f64 = 0.05;

/// Notes columns that contradict each other or are made of each other, and runs that repeat one
/// motion.
pub fn relations(
    frame: &Frame,
    roles: &Roles,
    fold: &[u32],
    files: &[PathBuf],
    log: &mut Findings,
) {
    speed_against_angle(frame, roles, files, log);
    other_unit(frame, roles, files, log);
    made_of_speed(frame, log);
    alike(frame, roles, log);
    repeated_motion(frame, fold, log);
}

/// Rows of a file from which its velocity is compared with its angle.
const FEWEST_COMPARED: usize = 50;

/// Range of an angle over the RMS of its steps from which it moves: noise about one angle has 4 to
/// 6.
const MOVES: f64 = 20.0;

/// The sequences with rows, by the number of their file.
fn by_file(frame: &Frame) -> BTreeMap<usize, Vec<Range<usize>>> {
    let mut out: BTreeMap<usize, Vec<Range<usize>>> = BTreeMap::new();
    for r in frame.sequences().iter().filter(|r| !r.is_empty()) {
        let file = frame.column("file").map_or(0, |f| f[r.start] as usize);
        out.entry(file).or_default().push(r.clone());
    }
    out
}

/// Refuses a file whose velocity has one value all the time while its angle moves, or moves back: a
/// dead channel, which the search would explain by effects that need no velocity.
///
/// # Errors
/// [`Error::Data`] with the first such file.
pub fn refuse_dead_velocity(frame: &Frame, files: &[PathBuf]) -> Result<(), Error> {
    let (Some(x), Some(v)) = (frame.column("angle"), frame.column("velocity")) else {
        return Ok(());
    };
    for (file, parts) in by_file(frame) {
        let first = v[parts[0].start];
        let mut rows = parts.iter().flat_map(Range::clone);
        if !rows.all(|i| v[i] == first)
            || parts.iter().map(ExactSizeIterator::len).sum::<usize>() < FEWEST_COMPARED
        {
            continue;
        }
        let moves = parts.iter().any(|r| {
            let own = &x[r.clone()];
            let (low, high) = stats::range(own);
            let steps = own.windows(2).map(|w| (w[1] - w[0]).powi(2));
            let step = (steps.sum::<f64>() / own.len() as f64).sqrt();
            let net = (own[own.len() - 1] - own[0]).abs();
            // At a constant speed an angle grows all the way.
            let is_back = first == 0.0 || high - low > 1.5 * net;
            high - low > MOVES * step && is_back
        });
        if moves {
            let name = files
                .get(file)
                .map_or_else(String::new, |f| f.display().to_string());
            return Err(Error::data(
                format!(
                    "{name}: the velocity is {} in every row while the angle moves",
                    num(first)
                ),
                "Leave the file out of the data, or take roles.velocity out of the model file",
            ));
        }
    }
    Ok(())
}

/// Sums of products of a column with the slope of another, from row to row but one.
#[derive(Clone, Copy, Default)]
struct Slope {
    cc: f64,
    cs: f64,
    ss: f64,
    rows: usize,
}

impl Slope {
    /// Adds the rows of a sequence.
    fn add(&mut self, time: &[f64], column: &[f64], x: &[f64], r: &Range<usize>) {
        for i in r.start + 1..r.end.saturating_sub(1).max(r.start + 1) {
            let slope = (x[i + 1] - x[i - 1]) / (time[i + 1] - time[i - 1]);
            // A few bad values must not decide.
            if !(column[i].is_finite() && slope.is_finite()) {
                continue;
            }
            self.cc += column[i] * column[i];
            self.cs += column[i] * slope;
            self.ss += slope * slope;
        }
        self.rows += r.len();
    }

    /// The slope as a multiple of the column, where the two move alike.
    fn ratio(&self, agreement: f64) -> Option<f64> {
        let alike = self.cs / (self.cc * self.ss).sqrt();
        (self.cc > 0.0 && self.ss > 0.0 && alike.abs() > agreement).then(|| self.cs / self.cc)
    }
}

/// Files that are named in one finding.
const NAMED: usize = 5;

/// The speed must be the slope of the angle where the units say so, in each file.
fn speed_against_angle(frame: &Frame, roles: &Roles, files: &[PathBuf], log: &mut Findings) {
    let (Some(angle), Some(velocity)) = (&roles.angle, &roles.velocity) else {
        return;
    };
    // The slope of the angle in the unit of the speed.
    let per_second = format!("{}/s", angle.unit);
    let Some(scale) = (velocity.unit == per_second)
        .then_some(1.0)
        .or_else(|| factor(&per_second, &velocity.unit).ok())
    else {
        return;
    };
    let (Some(x), Some(v)) = (frame.column("angle"), frame.column("velocity")) else {
        return;
    };
    let (x, v) = (&values::usual(x), &values::usual(v));
    let of_file: BTreeMap<usize, Slope> = (by_file(frame).into_iter())
        .map(|(file, parts)| {
            let mut slope = Slope::default();
            (parts.iter()).for_each(|r| slope.add(frame.time(), v, x, r));
            (file, slope)
        })
        .collect();
    let wrong: Vec<(usize, Slope, f64)> = of_file
        .iter()
        .filter_map(|(file, slope)| Some((*file, *slope, scale * slope.ratio(0.9)?)))
        .filter(|(.., ratio)| (ratio - 1.0).abs() > SPEED_ERROR)
        .collect();
    if wrong.is_empty() {
        return;
    }
    let all = wrong.len() == of_file.len();
    let named: Vec<String> = wrong
        .iter()
        .take(NAMED)
        .filter_map(|(file, _, ratio)| {
            let name = files.get(*file)?.file_name()?;
            Some(format!("{} ({})", name.to_string_lossy(), num(*ratio)))
        })
        .collect();
    let which = match wrong.len() - named.len() {
        _ if all => String::new(),
        0 => format!(" in {} only", named.join(", ")),
        more => format!(" in {} and {more} more files", named.join(", ")),
    };
    let rows = wrong.iter().map(|(_, slope, _)| slope.rows).sum();
    let first = if all {
        "whole record"
    } else {
        "files named here"
    };
    let (lo, hi) = stats::range(&wrong.iter().map(|w| w.2).collect::<Vec<f64>>());
    let ratio = if hi - lo > SPEED_ERROR * hi.abs() {
        format!("{} to {}", num(lo), num(hi))
    } else {
        num(wrong[0].2)
    };
    log.count(
        SPEED_AGAINST_ANGLE,
        rows,
        first,
        &format!(
            "the slope of the angle is {ratio} times the velocity column{which}: the time stamps, a unit or a scale is wrong, and every \
             mass, damping and delay with it"
        ),
    );
}

/// Name of the check that a column of one file may have another unit than in the others.
pub const OTHER_UNIT: &str = "unit of a file";

/// Factors between units of one quantity that are mistaken for each other: degrees in a radian,
/// turns and seconds in minutes, newtons in a kilogram and a pound, thousandths.
const MISTAKEN: [f64; 8] = [
    1000.0,
    1e6,
    360.0 / TAU,
    TAU,
    360.0,
    60.0,
    9.806_65,
    4.448_222,
];

/// Difference of a factor between files, whose motions differ, from one of units, as a logarithm.
const ABOUT: f64 = 0.3;

/// Smallest factor that is told: by less the motions of two logs differ often.
const LEAST_FACTOR: f64 = 20.0;

/// Files that have a spread of about one size, the others' median, from which a file may be held
/// against them; and the ratio up to which they count as that.
const FEWEST_OTHERS: usize = 2;
const OF_ONE_SIZE: f64 = 3.0;

/// Notes a column that is smaller or larger in one file than in all others by the factor between
/// two units.
fn other_unit(frame: &Frame, roles: &Roles, files: &[PathBuf], log: &mut Findings) {
    let of_file = by_file(frame);
    if of_file.len() <= FEWEST_OTHERS {
        return;
    }
    let (mut seen, mut rows): (Vec<String>, BTreeMap<usize, usize>) = Default::default();
    let measured = roles.all().into_iter();
    for (name, column) in measured.filter(|(n, _)| n != "time" && !roles.groups.contains_key(n)) {
        let Some(x) = frame.column(&name) else {
            continue;
        };
        let spread = |parts: &Vec<Range<usize>>| {
            let mut own: Vec<f64> = parts.iter().flat_map(|r| x[r.clone()].to_vec()).collect();
            own.retain(|v| v.is_finite());
            own.sort_by(f64::total_cmp);
            stats::quantile_sorted(&own, 0.95) - stats::quantile_sorted(&own, 0.05)
        };
        let spreads: Vec<(usize, f64)> = of_file
            .iter()
            .map(|(file, parts)| (*file, spread(parts)))
            .collect();
        for (file, own) in &spreads {
            let mut others: Vec<f64> = spreads
                .iter()
                .filter(|(f, _)| f != file)
                .map(|(_, s)| *s)
                .collect();
            others.sort_by(f64::total_cmp);
            let usual = stats::quantile_sorted(&others, 0.5);
            let alike = |s: &f64| *s > usual / OF_ONE_SIZE && *s < usual * OF_ONE_SIZE;
            if !others.iter().all(alike) {
                continue;
            }
            let ratio = own / usual;
            let larger = ratio.max(1.0 / ratio);
            let off = |f: &f64| (larger / f).ln().abs();
            let near = MISTAKEN.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
            let is_factor = |f: &&f64| off(f) < ABOUT && larger >= LEAST_FACTOR;
            let Some(units) = near.filter(is_factor) else {
                continue;
            };
            let name_of_file = files.get(*file).and_then(|f| f.file_name());
            let place = name_of_file.map_or(String::new(), |n| n.to_string_lossy().into_owned());
            rows.insert(*file, of_file[file].iter().map(Range::len).sum());
            let which = if ratio > 1.0 { "larger" } else { "smaller" };
            seen.push(format!(
                "in {place} column `{}` spreads over {} {}, in the other files over {}: {} times {which}, about the {} between two units",
                column.column,
                num(*own),
                column.unit,
                num(usual),
                num(larger),
                num(*units)
            ));
        }
    }
    let what = "convert what has another unit there, or leave the file out";
    seen.truncate(NAMED);
    log.count(
        OTHER_UNIT,
        rows.values().sum(),
        "files named here",
        &format!("{}; {what}", seen.join("; ")),
    );
}

/// Correlation of the target with the slope of the velocity from which the one was computed from
/// the other.
const COMPUTED: f64 = 0.999;

/// A target that is the slope of the velocity, as an acceleration is: an inertia that is found is
/// then its definition.
fn made_of_speed(frame: &Frame, log: &mut Findings) {
    let (Some(y), Some(v)) = (frame.column("target"), frame.column("velocity")) else {
        return;
    };
    let (y, v) = (&values::usual(y), &values::usual(v));
    let mut slope = Slope::default();
    for r in frame.sequences() {
        slope.add(frame.time(), y, v, r);
    }
    if let Some(ratio) = slope.ratio(COMPUTED) {
        log.count(
            "target from velocity",
            slope.rows,
            "whole record",
            &format!(
                "the slope of the velocity is {} times the target: if the target was computed from it, an inertia that is found \
                 is its definition and no finding",
                num(ratio)
            ),
        );
    }
}

/// Correlation from which two columns are one: what is found in one of them is as well in the
/// other.
const ALIKE: f64 = 0.99999;

/// Rows of which two columns are compared.
const COMPARED_ROWS: usize = 20_000;

/// Notes inputs that are alike, in time, size and all but scale and offset.
fn alike(frame: &Frame, roles: &Roles, log: &mut Findings) {
    let is_input = |n: &str| !["time", "target"].contains(&n) && !roles.groups.contains_key(n);
    let stride = (frame.len() / COMPARED_ROWS).max(1);
    let columns: Vec<(String, &str, Vec<f64>)> = roles
        .all()
        .into_iter()
        .filter(|(n, _)| is_input(n))
        .filter_map(|(n, c)| {
            let values = values::tame(frame.column(&n)?);
            let some = values.into_iter().step_by(stride).collect();
            Some((n, c.column.as_str(), some))
        })
        .collect();
    for (i, (a, column, x)) in columns.iter().enumerate() {
        for (b, other, y) in &columns[i + 1..] {
            let same = correlation(x, y);
            if same.abs() >= ALIKE {
                log.count(
                    &format!("{a} like {b}"),
                    frame.len(),
                    "whole record",
                    &format!(
                        "columns `{column}` ({a}) and `{other}` ({b}) move alike (correlation {same:.6}): what acts with one cannot be \
                         distinguished from what acts with the other; leave one of the roles out"
                    ),
                );
            }
        }
    }
}

/// Runs of one motion do not confirm each other: what is special to that motion is in all of them.
fn repeated_motion(frame: &Frame, fold: &[u32], log: &mut Findings) {
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
