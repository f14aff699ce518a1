//! A robot's log joined with a recording by time: one row for each row of the log, with the forces
//! interpolated to its time.
//!
//! The error of the join in each row is the largest error in time: that of the board's clock
//! against the host's, and of the log's own time where it is given. The force changes meanwhile by
//! less than `join_error_n`, which takes the steepest change of the force within that time from the
//! recording itself.

mod log;

use self::log::Log;
use super::error::RecordError;
use super::parquet::{Columns, Output};
use super::read::{mcap_of, End, Entry, Reader};
use super::rows::{CycleRow, SampleRow};
use super::table::{Cell, Kind, Row};
use super::times::Clocks;
use serde::Serialize;
use std::path::Path;
use wire::UNITS;

/// A recorded row further away than this, s, is not used for a row of the log.
const GAP_MAX_S: f64 = 0.05;

/// Share of the rows of a log that may have the time of the row before without a word.
const REPEATED_MAX: f64 = 0.1;

/// What to join.
#[derive(Debug)]
pub struct Merge<'a> {
    /// MCAP file or its folder.
    pub recording: &'a Path,
    /// The robot's log, CSV or Parquet.
    pub log: &'a Path,
    /// Its column with the time, or two with a plus between.
    pub time: &'a str,
    /// Added to the log's time, s, finite.
    pub shift_s: f64,
    /// Largest error of the log's time, s, finite and from 0.
    pub log_error_s: f64,
    /// Parquet file to write, neither the log nor a file of the recording.
    pub out: &'a Path,
}

/// What was joined.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Merged {
    /// Rows of the log.
    pub rows: u64,
    /// Rows with forces.
    pub joined: u64,
    /// Rows before or after the recording, or in a gap of it.
    pub outside: u64,
    /// Largest error in time of a joined row, s; `null` where the recording does not know its
    /// clocks.
    pub error_max_s: Option<f64>,
    /// Median of it, s.
    pub error_median_s: Option<f64>,
    /// Median of the force that this error may be worth, N.
    pub error_median_n: Option<f64>,
    /// Largest distance to a recorded cycle, s; `null` where no row was joined.
    pub distance_max_s: Option<f64>,
    /// First and last time of the log, with the shift, UTC; `null` where it has no row.
    pub log_utc: Option<[String; 2]>,
    /// First and last time of the recording, UTC; `null` where it has no cycle.
    pub recording_utc: Option<[String; 2]>,
    /// Whether the recording was read to its end.
    pub complete: bool,
    /// What to look at.
    pub warnings: Vec<String>,
}

impl std::fmt::Display for Merged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |s: Option<f64>| {
            s.map_or_else(|| "unknown".to_owned(), |s| format!("{:.3} ms", s * 1e3))
        };
        writeln!(
            f,
            "{} of {} rows joined, {} outside of the recording",
            self.joined, self.rows, self.outside
        )?;
        let span = |span: &Option<[String; 2]>| {
            span.as_ref().map_or_else(
                || "nothing".to_owned(),
                |[from, to]| format!("{from} to {to}"),
            )
        };
        if self.joined == 0 {
            return writeln!(
                f,
                "log: {}\nrecording: {}\nno file written: the two have no time in common",
                span(&self.log_utc),
                span(&self.recording_utc)
            );
        }
        writeln!(
            f,
            "error of the join: {} median, {} at most; worth {} N of force (median)",
            ms(self.error_median_s),
            ms(self.error_max_s),
            self.error_median_n
                .map_or_else(|| "unknown".to_owned(), |n| format!("{n:.4}"))
        )?;
        writeln!(
            f,
            "distance to the next recorded cycle: {} at most",
            ms(self.distance_max_s)
        )
    }
}

/// Values over time, in order of it.
#[derive(Debug, Default)]
struct Track<const N: usize> {
    utc_ns: Vec<u64>,
    values: Vec<[f64; N]>,
}

impl<const N: usize> Track<N> {
    fn push(&mut self, utc_ns: u64, values: [f64; N]) {
        // Better clocks may exchange two rows; time does not go back.
        let utc_ns = utc_ns.max(self.utc_ns.last().copied().unwrap_or(0));
        self.utc_ns.push(utc_ns);
        self.values.push(values);
    }

    /// Interpolated to a time, with the distance to the nearest row, s; `None` outside and in a
    /// gap.
    fn at(&self, utc_ns: u64) -> Option<([f64; N], f64)> {
        let after = self.utc_ns.partition_point(|at| *at <= utc_ns);
        let before = after.checked_sub(1)?;
        let (t0, v0) = (self.utc_ns[before], self.values[before]);
        let since_s = (utc_ns - t0) as f64 * 1e-9;
        let Some((t1, v1)) = self.utc_ns.get(after).zip(self.values.get(after)) else {
            // The very last row.
            return (since_s == 0.0).then_some((v0, 0.0));
        };
        let span_s = (t1 - t0) as f64 * 1e-9;
        if span_s > GAP_MAX_S {
            return None;
        }
        let share = since_s / span_s;
        let value = std::array::from_fn(|i| v0[i] + share * (v1[i] - v0[i]));
        Some((value, since_s.min(span_s - since_s)))
    }

    /// Steepest change of a part of the values around a time, 1/s.
    fn slope(&self, utc_ns: u64, part: std::ops::Range<usize>) -> f64 {
        let middle = self.utc_ns.partition_point(|at| *at <= utc_ns);
        let first = middle.saturating_sub(2);
        let last = (middle + 2).min(self.utc_ns.len());
        (first + 1..last)
            .map(|k| {
                let passed_s = (self.utc_ns[k] - self.utc_ns[k - 1]) as f64 * 1e-9;
                let change: f64 = part
                    .clone()
                    .map(|i| (self.values[k][i] - self.values[k - 1][i]).powi(2))
                    .sum();
                if passed_s > 0.0 {
                    change.sqrt() / passed_s
                } else {
                    0.0
                }
            })
            .fold(0.0, f64::max)
    }
}

/// Forces, tensions and phases of a recording over time.
struct Recorded {
    clocks: Clocks,
    /// How its file ends.
    end: End,
    /// Tip (3), commanded force (3), estimated force (3), applied force (3, NaN where it is not
    /// known).
    cycles: Track<12>,
    /// Tension and force of the load cell.
    units: [Track<2>; UNITS],
    phases: Vec<(u64, String)>,
}

impl Recorded {
    fn read(path: &Path) -> Result<Self, RecordError> {
        let (clocks, _) = Clocks::read(path)?;
        let mut recorded = Self {
            clocks,
            end: End::Unknown,
            cycles: Track::default(),
            units: Default::default(),
            phases: Vec::new(),
        };
        let mut reader = Reader::open(path)?;
        for entry in &mut reader {
            let Entry::Message { topic, data, .. } = entry else {
                continue;
            };
            if topic == CycleRow::TABLE.topic {
                if let Ok(row) = serde_json::from_slice::<CycleRow>(&data) {
                    recorded.cycle(&row);
                }
            } else if topic == SampleRow::TABLE.topic {
                if let Ok(row) = serde_json::from_slice::<SampleRow>(&data) {
                    let utc_ns = recorded.clocks.of_board(row.board_s).utc.ns();
                    if let Some(unit) = recorded.units.get_mut(row.unit as usize - 1) {
                        unit.push(utc_ns, [row.tension_n, row.load_cell_n]);
                    }
                }
            }
        }
        recorded.end = reader.end().clone();
        Ok(recorded)
    }

    fn cycle(&mut self, row: &CycleRow) {
        let utc_ns = self.clocks.of_host(row.host_s).utc.ns();
        let applied = row.applied_n.unwrap_or([f64::NAN; 3]);
        let mut values = [0.0; 12];
        let parts = [row.tip_m, row.commanded_n, row.estimated_n, applied];
        for (slot, value) in values.iter_mut().zip(parts.iter().flatten()) {
            *slot = *value;
        }
        self.cycles.push(utc_ns, values);
        if self
            .phases
            .last()
            .is_none_or(|(_, phase)| *phase != row.phase)
        {
            self.phases.push((utc_ns, row.phase.clone()));
        }
    }
}

/// Columns that the join adds.
const ADDED: [(&str, Kind); 29] = [
    ("rig_utc", Kind::Timestamp),
    ("rig_host_s", Kind::Double),
    ("rig_board_s", Kind::Double),
    ("rig_phase", Kind::Text),
    ("rig_tip_m_x", Kind::Double),
    ("rig_tip_m_y", Kind::Double),
    ("rig_tip_m_z", Kind::Double),
    ("rig_commanded_n_x", Kind::Double),
    ("rig_commanded_n_y", Kind::Double),
    ("rig_commanded_n_z", Kind::Double),
    ("rig_estimated_n_x", Kind::Double),
    ("rig_estimated_n_y", Kind::Double),
    ("rig_estimated_n_z", Kind::Double),
    ("rig_tension_n_1", Kind::Double),
    ("rig_tension_n_2", Kind::Double),
    ("rig_tension_n_3", Kind::Double),
    ("rig_tension_n_4", Kind::Double),
    ("rig_tension_n_5", Kind::Double),
    ("rig_tension_n_6", Kind::Double),
    ("rig_load_cell_n_1", Kind::Double),
    ("rig_load_cell_n_2", Kind::Double),
    ("rig_load_cell_n_3", Kind::Double),
    ("rig_load_cell_n_4", Kind::Double),
    ("rig_load_cell_n_5", Kind::Double),
    ("rig_load_cell_n_6", Kind::Double),
    ("join_distance_s", Kind::Double),
    ("join_error_s", Kind::Double),
    ("join_error_n", Kind::Double),
    ("log_utc", Kind::Timestamp),
];

/// Joins a log with a recording.
///
/// # Errors
/// A file can't be read or written, or the log has no such column of times, two columns of one name
/// or one with a name that the join adds. Where no row of the log is within the recording nothing
/// is written.
pub fn merge(options: &Merge<'_>) -> Result<Merged, RecordError> {
    let log = Log::read(options.log)?;
    log.check_names()?;
    let times = log.times(options)?;
    let recorded = Recorded::read(&mcap_of(options.recording))?;
    let mut merged = Merged {
        log_utc: span(times.iter().copied()),
        recording_utc: span(recorded.cycles.utc_ns.iter().copied()),
        complete: recorded.end == End::Complete,
        ..Merged::default()
    };
    if !merged.complete {
        merged.warnings.push(format!(
            "{} is cut off or damaged: rows of the log behind that place are not joined; `forcectl recording check` names the place",
            options.recording.display()
        ));
    }
    let repeated = times.windows(2).filter(|w| w[0] == w[1]).count();
    if repeated as f64 > REPEATED_MAX * times.len() as f64 {
        merged.warnings.push(format!(
            "{repeated} of {} rows of {} have the time of the row before: it was written with too few digits, or rows are held",
            times.len(),
            options.log.display()
        ));
    }
    let falls: Vec<usize> = (1..times.len())
        .filter(|n| times[*n] < times[n - 1])
        .collect();
    if let Some(first) = falls.first() {
        merged.warnings.push(format!(
            "the time of {} falls at {} of {} rows, first at row {}: rows are out of order, or its clock was set",
            options.log.display(),
            falls.len(),
            times.len(),
            first + 1
        ));
    }
    let coarse_s = coarse_s(&times);
    let is_joined = |at: &u64| joined(&recorded, *at, options.log_error_s).is_some();
    if !times.iter().any(is_joined) {
        merged.rows = times.len() as u64;
        merged.outside = merged.rows;
        merged.warnings.push(format!(
            "no row of {} is within the recording: check the time column and `--shift`",
            options.log.display()
        ));
        return Ok(merged);
    }
    let columns: Columns = log
        .names
        .iter()
        .map(|name| (name.clone(), Kind::Text, true))
        .zip(&log.numeric)
        .map(|((name, kind, optional), numeric)| {
            (name, if *numeric { Kind::Double } else { kind }, optional)
        })
        .chain(ADDED.map(|(name, kind)| (name.to_owned(), kind, true)))
        .collect();
    let mut output = Output::with_columns(options.out, columns)?;
    let (mut errors_s, mut errors_n) = (Vec::new(), Vec::new());
    for ((row, utc_ns), coarse_s) in log.rows.iter().zip(times).zip(coarse_s) {
        let mut cells: Vec<Cell> = row.clone();
        merged.rows += 1;
        match joined(&recorded, utc_ns, options.log_error_s + coarse_s) {
            None => {
                merged.outside += 1;
                cells.extend(ADDED[1..].iter().map(|_| Cell::Null));
            }
            Some(join) => {
                merged.joined += 1;
                let before = merged.distance_max_s.unwrap_or(0.0);
                merged.distance_max_s = Some(before.max(join.distance_s));
                errors_s.extend(join.error_s);
                errors_n.extend(join.error_n);
                cells.extend(join.cells);
            }
        }
        cells.push(Cell::Int64(utc_ns as i64));
        output.push(cells)?;
    }
    output.finish(&std::collections::BTreeMap::new())?;
    errors_s.sort_by(f64::total_cmp);
    errors_n.sort_by(f64::total_cmp);
    merged.error_max_s = errors_s.last().copied();
    merged.error_median_s = errors_s.get(errors_s.len() / 2).copied();
    merged.error_median_n = errors_n.get(errors_n.len() / 2).copied();
    Ok(merged)
}

/// By how much each time may be off, s, because others are written alike: rows of one time were
/// anywhere from it to the next one.
fn coarse_s(times: &[u64]) -> Vec<f64> {
    let mut out = Vec::with_capacity(times.len());
    let mut before_s = 0.0;
    for alike in times.chunk_by(|a, b| a == b) {
        let next = times.get(out.len() + alike.len());
        let step_s = next.map_or(before_s, |next| 1e-9 * next.abs_diff(alike[0]) as f64);
        let error_s = if alike.len() > 1 { step_s } else { 0.0 };
        out.extend(alike.iter().map(|_| error_s));
        before_s = step_s;
    }
    out
}

/// First and last of some times, ns since 1970, as UTC; `None` if there is none.
fn span(times: impl Iterator<Item = u64> + Clone) -> Option<[String; 2]> {
    let utc = |ns: u64| {
        let time = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(ns);
        humantime::format_rfc3339_millis(time).to_string()
    };
    Some([utc(times.clone().min()?), utc(times.max()?)])
}

/// What a row of the log gets.
struct Join {
    cells: Vec<Cell>,
    distance_s: f64,
    error_s: Option<f64>,
    error_n: Option<f64>,
}

fn joined(recorded: &Recorded, utc_ns: u64, log_error_s: f64) -> Option<Join> {
    let (cycle, distance_s) = recorded.cycles.at(utc_ns)?;
    let times = recorded.clocks.of_utc(utc_ns);
    let error_s = recorded
        .clocks
        .at(times.board_s * 1e6)
        .map(|estimate| estimate.uncertainty_ns * 1e-9 + log_error_s)
        .filter(|error| error.is_finite());
    let error_n = error_s.map(|error_s| error_s * recorded.cycles.slope(utc_ns, 6..9));
    let phase = recorded
        .phases
        .iter()
        .rfind(|(at, _)| *at <= utc_ns)
        .map_or(Cell::Null, |(_, phase)| Cell::Text(phase.clone()));
    let optional = |value: Option<f64>| value.map_or(Cell::Null, Cell::Double);
    let mut cells = vec![
        Cell::Int64(utc_ns as i64),
        Cell::Double(times.host_s),
        Cell::Double(times.board_s),
        phase,
    ];
    cells.extend(cycle[..9].iter().map(|value| Cell::Double(*value)));
    let units: Vec<_> = recorded.units.iter().map(|unit| unit.at(utc_ns)).collect();
    for part in 0..2 {
        cells.extend(
            units
                .iter()
                .map(|unit| optional(unit.map(|(values, _)| values[part]))),
        );
    }
    cells.extend([
        Cell::Double(distance_s),
        optional(error_s),
        optional(error_n),
    ]);
    // `log_utc` comes after these, also where nothing was joined.
    Some(Join {
        cells,
        distance_s,
        error_s,
        error_n,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_that_are_written_alike_may_be_off_by_as_much_as_the_next_one() {
        let s = 1_000_000_000;
        let times = [0, 1, 1, 1, 2, 3, 3].map(|t| t * s);
        assert_eq!(coarse_s(&times), [0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0]);
        assert_eq!(coarse_s(&[]), [0.0; 0]);
    }
}
