//! Columns that contradict each other, are made of each other, or have another unit in one file.

use super::motion::correlation;
use super::values;
use crate::finding::Findings;
use crate::spec::Roles;
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::stats;
use residual_columns::units::factor;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;
use std::path::PathBuf;

/// Name of the check that two columns contradict each other.
pub const SPEED_AGAINST_ANGLE: &str = "speed against angle";

/// Relative error of the speed column against the slope of the angle that is reported.
const SPEED_ERROR: f64 = 0.05;

/// Notes columns that contradict each other or are made of each other.
pub(super) fn note(frame: &Frame, roles: &Roles, files: &[PathBuf], log: &mut Findings) {
    speed_against_angle(frame, roles, files, log);
    other_unit(frame, roles, files, log);
    made_of_speed(frame, log);
    alike(frame, roles, log);
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

/// Factors between units of one quantity that are mistaken for each other: degrees in a radian and
/// in a turn, seconds in a minute, thousandths.
const MISTAKEN: [f64; 5] = [1000.0, 1e6, 360.0 / TAU, 360.0, 60.0];

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
    let stride = (frame.len() / COMPARED_ROWS).max(1);
    let (mut seen, mut rows): (Vec<String>, BTreeMap<usize, usize>) = Default::default();
    let measured = roles.all().into_iter();
    for (name, column) in measured.filter(|(n, _)| n != "time" && !roles.groups.contains_key(n)) {
        let Some(x) = frame.column(&name) else {
            continue;
        };
        let spread = |parts: &Vec<Range<usize>>| {
            let rows = parts.iter().flat_map(|r| r.clone().step_by(stride));
            let mut own: Vec<f64> = rows.map(|i| x[i]).filter(|v| v.is_finite()).collect();
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

/// Rows of which columns are compared.
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
