//! A robot's log joined with a recording by time: one row for each row of the log, with the forces
//! interpolated to its time.
//!
//! The error of the join in each row is the largest error in time: that of the board's clock
//! against the host's, and of the log's own time where it is given. The force changes meanwhile by
//! less than `join_error_n`, which takes the steepest change of the force within that time from the
//! recording itself.

use super::error::RecordError;
use super::parquet::{Columns, Output};
use super::read::{mcap_of, Entry, Reader};
use super::rows::{CycleRow, SampleRow};
use super::table::{Cell, Kind, Row};
use super::times::Clocks;
use ::parquet::basic::{LogicalType, TimeUnit};
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::record::Field;
use ::parquet::schema::types::ColumnDescriptor;
use residual_columns::dates;
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
            cycles: Track::default(),
            units: Default::default(),
            phases: Vec::new(),
        };
        for entry in Reader::open(path)? {
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
        ..Merged::default()
    };
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

/// A robot's log.
struct Log {
    names: Vec<String>,
    /// Whether a column holds numbers.
    numeric: Vec<bool>,
    rows: Vec<Vec<Cell>>,
    path: String,
}

impl Log {
    fn read(path: &Path) -> Result<Self, RecordError> {
        let parquet = path.extension().is_some_and(|ext| ext == "parquet");
        let (names, texts) = if parquet {
            parquet_rows(path)?
        } else {
            csv_rows(path)?
        };
        let numeric: Vec<bool> = (0..names.len())
            .map(|k| {
                texts
                    .iter()
                    .all(|row| row[k].trim().is_empty() || row[k].trim().parse::<f64>().is_ok())
            })
            .collect();
        let rows = texts
            .into_iter()
            .map(|row| {
                row.into_iter()
                    .zip(&numeric)
                    .map(|(text, numeric)| match text.trim() {
                        "" => Cell::Null,
                        number if *numeric => number.parse().map_or(Cell::Null, Cell::Double),
                        _ => Cell::Text(text),
                    })
                    .collect()
            })
            .collect();
        Ok(Self {
            names,
            numeric,
            rows,
            path: path.display().to_string(),
        })
    }

    /// Refuses names with which a file would have two columns of one name: readers take one of
    /// them, or refuse the file.
    fn check_names(&self) -> Result<(), RecordError> {
        let refused = |cause, advice| {
            Err(RecordError {
                path: self.path.clone(),
                cause,
                advice,
            })
        };
        let ours = ADDED.map(|(name, _)| name);
        let list = |names: Vec<&String>| {
            let quoted: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
            quoted.join(", ")
        };
        let names = self.names.iter();
        let added: Vec<_> = names
            .clone()
            .filter(|name| ours.contains(&name.as_str()))
            .collect();
        if !added.is_empty() {
            return refused(
                format!("it has columns that the join adds: {}", list(added)),
                "give the log as it was before a join, or rename these columns",
            );
        }
        let twice: Vec<_> = names
            .enumerate()
            .filter(|(n, name)| self.names[..*n].contains(name))
            .map(|(_, name)| name)
            .collect();
        if !twice.is_empty() {
            return refused(
                format!("it has more than one column of the name {}", list(twice)),
                "give each column of the log its own name",
            );
        }
        Ok(())
    }

    fn column(&self, name: &str) -> Result<usize, RecordError> {
        self.names
            .iter()
            .position(|n| n == name)
            .ok_or_else(|| RecordError {
                path: self.path.clone(),
                cause: format!(
                    "it has no column `{name}`; its columns: {}",
                    self.names.join(", ")
                ),
                advice: "name the column with the time",
            })
    }

    /// UTC of each row, ns since 1970.
    fn times(&self, options: &Merge<'_>) -> Result<Vec<u64>, RecordError> {
        let shift_ns = (options.shift_s * 1e9) as i64;
        let columns: Vec<usize> = options
            .time
            .split('+')
            .map(|name| self.column(name.trim()))
            .collect::<Result<_, _>>()?;
        self.rows
            .iter()
            .enumerate()
            .map(|(n, row)| {
                let cells: Vec<&Cell> = columns.iter().map(|k| &row[*k]).collect();
                let time = utc_ns(&cells);
                let unclear = match time {
                    Err(NoTime::NoZone) => Some((
                        "a time without a zone",
                        "write the zone behind each time: Z for UTC, +01:00 for an hour more than UTC",
                    )),
                    Err(NoTime::Unsure) => Some((
                        "a date whose day and month may be exchanged",
                        "write the year first: 2026-03-04",
                    )),
                    _ => None,
                };
                if let Some((what, advice)) = unclear {
                    return Err(RecordError {
                        path: self.path.clone(),
                        cause: format!("row {} has {what} in `{}`: {cells:?}", n + 1, options.time),
                        advice,
                    });
                }
                time.ok()
                    .and_then(|ns| u64::try_from(ns.checked_add(shift_ns)?).ok())
                    .ok_or_else(|| RecordError {
                        path: self.path.clone(),
                        cause: format!(
                            "row {} has no time in `{}` that is a UTC of this century{}: {:?}",
                            n + 1,
                            options.time,
                            match options.shift_s {
                                0.0 => String::new(),
                                s => format!(" with a shift of {s} s"),
                            },
                            cells
                        ),
                        advice: "give UTC or ROS time (s, ms, us or ns since 1970, or RFC 3339); a time since the start of the log can't be joined",
                    })
            })
            .collect()
    }
}

/// Why cells are no time.
#[derive(Debug, PartialEq, Eq)]
enum NoTime {
    /// A date and a time of day, of a zone that is not told.
    NoZone,
    /// A date whose day and month may be exchanged.
    Unsure,
    Other,
}

/// 2000 and 2100, s since 1970.
const CENTURY: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;

/// UTC of a cell, or of seconds and nanoseconds, or of a date and a time of day, ns since 1970.
fn utc_ns(cells: &[&Cell]) -> Result<i64, NoTime> {
    match cells {
        [Cell::Double(secs), Cell::Double(nsecs)]
            if CENTURY.contains(secs) && (0.0..=1e9).contains(nsecs) =>
        {
            Ok(*secs as i64 * 1_000_000_000 + *nsecs as i64)
        }
        [Cell::Double(value)] => [1e9, 1e6, 1e3, 1.0]
            .iter()
            .find(|scale| CENTURY.contains(&(value * *scale * 1e-9)))
            .map(|scale| {
                // A double of seconds is good to 0.2 us: whole seconds and the rest apart.
                let per_second = 1e9 / scale;
                let whole = (value / per_second).floor();
                whole as i64 * 1_000_000_000 + ((value - whole * per_second) * scale).round() as i64
            })
            .ok_or(NoTime::Other),
        [Cell::Text(text)] => utc_of_text(text.trim()),
        [Cell::Text(date), Cell::Text(time)] => {
            utc_of_text(&format!("{} {}", date.trim(), time.trim()))
        }
        _ => Err(NoTime::Other),
    }
}

/// UTC of a date, a time of day and their zone, ns since 1970.
fn utc_of_text(text: &str) -> Result<i64, NoTime> {
    let stamp = dates::stamp(text).filter(|stamp| stamp.kind == dates::Kind::Both);
    match stamp.ok_or(NoTime::Other)? {
        stamp if stamp.unsure => Err(NoTime::Unsure),
        stamp if !CENTURY.contains(&(stamp.seconds as f64)) => Err(NoTime::Other),
        stamp if stamp.zoned => Ok(stamp.seconds * 1_000_000_000 + i64::from(stamp.nanoseconds)),
        _ => Err(NoTime::NoZone),
    }
}

type Texts = (Vec<String>, Vec<Vec<String>>);

fn csv_rows(path: &Path) -> Result<Texts, RecordError> {
    let unreadable = |error: csv::Error| RecordError {
        path: path.display().to_string(),
        cause: error.to_string(),
        advice: "give a CSV file with a header line, or Parquet",
    };
    let bytes = std::fs::read(path).map_err(|error| unreadable(error.into()))?;
    // The header has no number: a semicolon or a tab in it separates, and numbers then have a
    // decimal comma, or a point as well.
    let head = bytes.split(|b| *b == b'\n').next().unwrap_or(&[]);
    let has = |sign: u8| head.contains(&sign);
    let separator = [b';', b'\t']
        .into_iter()
        .find(|sign| has(*sign) && !has(b','));
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator.unwrap_or(b','))
        .from_reader(bytes.as_slice());
    let names = reader.headers().map_err(unreadable)?;
    let names = names
        .iter()
        .map(|name| name.trim().trim_start_matches('\u{feff}').to_owned());
    let names = names.collect();
    let cell = |text: &str| match separator {
        Some(_) => with_point(text),
        None => text.to_owned(),
    };
    let rows = reader
        .records()
        .map(|record| Ok(record?.iter().map(cell).collect()))
        .collect::<Result<_, csv::Error>>()
        .map_err(unreadable)?;
    Ok((names, rows))
}

/// A number with a decimal comma with a point; other text as it is.
fn with_point(text: &str) -> String {
    let point = text.trim().replacen(',', ".", 1);
    match point.parse::<f64>() {
        Ok(_) => point,
        Err(_) => text.to_owned(),
    }
}

fn parquet_rows(path: &Path) -> Result<Texts, RecordError> {
    let unreadable = |error: &dyn std::fmt::Display| RecordError {
        path: path.display().to_string(),
        cause: error.to_string(),
        advice: "give a Parquet file with flat columns, or CSV",
    };
    let file = std::fs::File::open(path).map_err(|error| unreadable(&error))?;
    let reader = SerializedFileReader::new(file).map_err(|error| unreadable(&error))?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let columns = schema.columns().iter();
    if let Some(nested) = columns
        .map(|c| c.path())
        .find(|path| path.parts().len() > 1)
    {
        return Err(unreadable(&format!(
            "the column `{}` has parts",
            nested.string()
        )));
    }
    let names = schema
        .columns()
        .iter()
        .map(|column| column.name().to_owned())
        .collect();
    let local: Vec<Option<u64>> = schema.columns().iter().map(|c| local_ns(c)).collect();
    let mut rows = Vec::new();
    for row in reader
        .get_row_iter(None)
        .map_err(|error| unreadable(&error))?
    {
        let row = row.map_err(|error| unreadable(&error))?;
        rows.push(
            row.get_column_iter()
                .zip(&local)
                .map(|((_, field), local)| match local {
                    Some(unit_ns) => text_of_local(field, *unit_ns),
                    None => text_of(field),
                })
                .collect(),
        );
    }
    Ok((names, rows))
}

/// Unit of a column of times without a zone, ns; `None` of any other column.
fn local_ns(column: &ColumnDescriptor) -> Option<u64> {
    match column.logical_type_ref()? {
        LogicalType::Timestamp(time) if !time.is_adjusted_to_u_t_c => Some(match time.unit {
            TimeUnit::MILLIS => 1_000_000,
            TimeUnit::MICROS => 1_000,
            TimeUnit::NANOS => 1,
        }),
        _ => None,
    }
}

/// A time without a zone, as CSV has one.
fn text_of_local(field: &Field, unit_ns: u64) -> String {
    let value = match field {
        Field::TimestampMillis(value) | Field::TimestampMicros(value) | Field::Long(value) => {
            *value
        }
        other => return text_of(other),
    };
    match u64::try_from(value)
        .ok()
        .and_then(|v| v.checked_mul(unit_ns))
    {
        Some(ns) => {
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(ns);
            let text = humantime::format_rfc3339_nanos(time).to_string();
            text.trim_end_matches('Z').to_owned()
        }
        None => text_of(field),
    }
}

/// A value as text; a number with all of its digits.
fn text_of(field: &Field) -> String {
    match field {
        Field::Null => String::new(),
        Field::Str(text) => text.clone(),
        Field::Double(value) => format!("{value:?}"),
        Field::Float(value) => format!("{value:?}"),
        Field::TimestampMillis(value) | Field::TimestampMicros(value) => value.to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utc(text: &str) -> Result<i64, NoTime> {
        utc_ns(&[&Cell::Text(text.into())])
    }

    #[test]
    fn a_time_of_another_zone_is_converted() {
        let ns = 1_795_640_363_877_021_589;
        for text in [
            "2026-11-25T20:59:23.877021589Z",
            "2026-11-25T21:59:23.877021589+01:00",
            "2026-11-25 21:59:23.877021589+0100",
            "2026-11-25T22:59:23.877021589 +02",
            "2026-11-25T17:29:23.877021589-03:30",
            "2026-11-25 20:59:23.877021589 UTC",
            "25.11.2026 21:59:23.877021589+01:00",
        ] {
            assert_eq!(utc(text), Ok(ns), "{text}");
        }
        // Midnight between the zones.
        assert_eq!(
            utc("2026-11-26T00:30:00+01:00"),
            utc("2026-11-25T23:30:00Z")
        );
        let date = Cell::Text("2026-11-25".into());
        let time = Cell::Text("21:59:23.877021589+01:00".into());
        assert_eq!(utc_ns(&[&date, &time]), Ok(ns));
    }

    #[test]
    fn a_time_without_a_zone_is_none() {
        for text in ["2026-11-25 20:59:23.877021", "2026-11-25T20:59:23"] {
            assert_eq!(utc(text), Err(NoTime::NoZone), "{text}");
        }
        for text in ["11/3/2026 20:59:23Z", "3/11/2026 8:59:23 PM"] {
            assert_eq!(utc(text), Err(NoTime::Unsure), "{text}");
        }
        assert!(utc("25/11/2026 20:59:23Z").is_ok());
        for text in [
            "",
            "12.5",
            "2026-11-25T20:59:23+",
            "2026-11-25T20:59:23+1",
            "2026-11-25T20:59:23 CET",
            "2026-11-25T20:59:23+25:00",
            "20:59:23",
            "2026-13-25T20:59:23Z",
            "9999-11-25T20:59:23Z",
        ] {
            assert_eq!(utc(text), Err(NoTime::Other), "{text}");
        }
    }

    #[test]
    fn numbers_beyond_all_times_are_refused() {
        let double = Cell::Double;
        for nsecs in [-1.0, 2e9, 1e300, f64::INFINITY, f64::NAN] {
            let cells = [&double(1.8e9), &double(nsecs)];
            assert_eq!(utc_ns(&cells), Err(NoTime::Other), "{nsecs}");
        }
        let cells = [&double(1.8e9), &double(5.0)];
        assert_eq!(utc_ns(&cells), Ok(1_800_000_000_000_000_005));
        // A shift beyond what a time holds.
        let log = Log {
            names: vec!["t".to_owned()],
            numeric: vec![true],
            rows: vec![vec![double(1.8e9)]],
            path: "log.csv".to_owned(),
        };
        let options = |shift_s| Merge {
            recording: Path::new(""),
            log: Path::new(""),
            time: "t",
            shift_s,
            log_error_s: 0.0,
            out: Path::new(""),
        };
        for shift_s in [1e300, f64::INFINITY, -1e300, -2e9] {
            let error = log.times(&options(shift_s)).unwrap_err().to_string();
            assert!(error.contains("with a shift of"), "{error}");
        }
        assert_eq!(
            log.times(&options(-1.5)),
            Ok(vec![1_799_999_998_500_000_000])
        );
    }

    #[test]
    fn names_of_columns_are_refused_where_a_file_would_have_one_twice() {
        let log = |names: &[&str]| Log {
            names: names.iter().map(|&name| name.to_owned()).collect(),
            numeric: vec![true; names.len()],
            rows: Vec::new(),
            path: "log.csv".to_owned(),
        };
        assert_eq!(log(&["t", "q", ""]).check_names(), Ok(()));
        let error = log(&["t", "q", "q", "f", "f"]).check_names().unwrap_err();
        assert!(error.to_string().contains("`q`, `f`;"), "{error}");
        let error = log(&["t", "log_utc", "rig_phase"]).check_names();
        let error = error.unwrap_err().to_string();
        assert!(error.starts_with("log.csv: "), "{error}");
        assert!(error.contains("`log_utc`, `rig_phase`;"), "{error}");
    }

    #[test]
    fn a_parquet_log_with_parts_is_refused() {
        use ::parquet::data_type::DoubleType;
        use ::parquet::file::writer::SerializedFileWriter;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.parquet");
        let schema =
            "message row { required group pose { required double x; required double y; } }";
        let schema = ::parquet::schema::parser::parse_message_type(schema).unwrap();
        let file = std::fs::File::create(&path).unwrap();
        let mut writer =
            SerializedFileWriter::new(file, schema.into(), Default::default()).unwrap();
        let mut group = writer.next_row_group().unwrap();
        while let Some(mut column) = group.next_column().unwrap() {
            let column_writer = column.typed::<DoubleType>();
            column_writer.write_batch(&[1.0], None, None).unwrap();
            column.close().unwrap();
        }
        group.close().unwrap();
        writer.close().unwrap();
        let error = Log::read(&path).err().unwrap().to_string();
        assert!(error.contains("`pose.x` has parts"), "{error}");
    }

    #[test]
    fn times_without_a_zone_in_parquet_are_no_utc() {
        use ::parquet::data_type::Int64Type;
        use ::parquet::file::writer::SerializedFileWriter;
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, kind: &str, value: i64| {
            let path = folder.path().join(name);
            let schema = format!("message row {{ required int64 t ({kind}); }}");
            let schema = ::parquet::schema::parser::parse_message_type(&schema).unwrap();
            let file = std::fs::File::create(&path).unwrap();
            let mut writer =
                SerializedFileWriter::new(file, schema.into(), Default::default()).unwrap();
            let mut group = writer.next_row_group().unwrap();
            let mut column = group.next_column().unwrap().unwrap();
            let column_writer = column.typed::<Int64Type>();
            column_writer.write_batch(&[value], None, None).unwrap();
            column.close().unwrap();
            group.close().unwrap();
            writer.close().unwrap();
            let log = Log::read(&path).unwrap();
            utc_ns(&[&log.rows[0][0]])
        };
        let us = 1_772_618_400_123_000;
        for (kind, value) in [
            ("TIMESTAMP(MILLIS,false)", us / 1_000),
            ("TIMESTAMP(MICROS,false)", us),
            ("TIMESTAMP(NANOS,false)", us * 1_000),
        ] {
            assert_eq!(
                read("local.parquet", kind, value),
                Err(NoTime::NoZone),
                "{kind}"
            );
        }
        let utc = read("utc.parquet", "TIMESTAMP(MICROS,true)", us);
        assert_eq!(utc, Ok(us * 1_000));
    }

    #[test]
    fn times_that_are_written_alike_may_be_off_by_as_much_as_the_next_one() {
        let s = 1_000_000_000;
        let times = [0, 1, 1, 1, 2, 3, 3].map(|t| t * s);
        assert_eq!(coarse_s(&times), [0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0]);
        assert_eq!(coarse_s(&[]), [0.0; 0]);
    }

    #[test]
    fn semicolons_and_decimal_commas_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(
            &path,
            "\u{feff}time;q;note\n1795640363,877022;-0,5;a, b\n1795640364;1.5;c\n",
        )
        .unwrap();
        let (names, rows) = csv_rows(&path).unwrap();
        assert_eq!(names, ["time", "q", "note"]);
        assert_eq!(rows[0], ["1795640363.877022", "-0.5", "a, b"]);
        assert_eq!(rows[1], ["1795640364", "1.5", "c"]);
    }
}
