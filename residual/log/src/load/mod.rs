//! From logs to [`Data`]: files or columns in memory are read, cut into sequences, converted to the
//! units of the model, filtered, and assigned to folds.
//!
//! | file | concern |
//! |---|---|
//! | `files.rs` | which files are logs |
//! | `text.rs`, `parquet.rs` | one log of each format |
//! | `brackets.rs` | stamps in brackets before the lines of a text log |
//! | `json.rs` | JSON as the CSV text that it stands for |
//! | `cells.rs` | numbers as text |
//! | `arrow.rs` | which columns of a Parquet log are durations |
//! | `messages.rs` | text logs with several kinds of message |
//! | `guess/` | a first model file for logs that nobody has described |
//! | `rows.rs` | rows in units of the model, sequences |
//! | `stamps.rs` | time stamps that do not grow |
//! | `folds.rs` | groups and folds for hold-out |
//! | `copies.rs` | stretches that several groups have alike |

#[cfg(feature = "parquet")]
mod arrow;
mod brackets;
mod cells;
mod copies;
mod files;
mod folds;
mod guess;
mod json;
mod messages;
#[cfg(feature = "parquet")]
mod parquet;
mod rows;
mod stamps;
mod text;

#[cfg(test)]
mod tests;

pub use files::find_files;
pub use guess::guess;

use crate::data::{Data, FEWEST_ROWS};
use crate::finding::Findings;
use crate::hygiene;
use crate::spec::{Action, Input, Spec, MADE};
use rayon::prelude::*;
use residual_columns::error::Error;
use residual_columns::expr::Expr;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Columns of one log, as logged: the units are those of the log. Missing cells are NaN.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Where the log comes from; its file name stands for it in reports.
    source: PathBuf,
    /// Column names, in order.
    names: Vec<String>,
    /// Values by column, all of one length.
    columns: Vec<Vec<f64>>,
    /// Columns of text that were left out: name, first cell and its line.
    text: Vec<(String, String, u64)>,
    /// What was seen on reading, for the checks of the data.
    notes: Vec<Note>,
    /// Columns of a type of time, converted to s, and what they are.
    times: Vec<(String, &'static str)>,
    /// Columns whose cells have text around the number, and the unit in it, or an empty text.
    units: Vec<(String, String)>,
    /// Lines that are no rows, left out by `hygiene.text`.
    broken: usize,
    /// Rows before which such lines stood.
    breaks: Vec<usize>,
    /// Line of the first row of a text log whose rows are one line each, with nothing between them.
    first_line: Option<u64>,
}

/// Something that was seen on reading a log.
#[derive(Debug, Clone)]
struct Note {
    /// Name of the check.
    check: String,
    /// How many cases.
    count: usize,
    /// What was seen and what was done.
    what: String,
    /// Whether rows were left out.
    lost: bool,
}

impl Note {
    fn new(check: &str, count: usize, what: impl Into<String>) -> Note {
        Note {
            check: check.into(),
            count,
            what: what.into(),
            lost: false,
        }
    }

    /// Cases in which a row was left out.
    fn of_lost_rows(check: &str, count: usize, what: &str) -> Note {
        Note {
            lost: true,
            ..Note::new(check, count, what)
        }
    }
}

impl Table {
    /// A table without columns. The file name of `source` stands for it in reports and in `file`
    /// groups, and `input.file_name` of the model file is matched against it; the file need not
    /// exist.
    pub fn new(source: impl Into<PathBuf>) -> Table {
        Table {
            source: source.into(),
            ..Table::default()
        }
    }

    /// The table with one more column. All columns must have the same length.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, values: Vec<f64>) -> Table {
        self.names.push(name.into());
        self.columns.push(values);
        self
    }

    /// The table with one more column that is a time by its type, in seconds: the model file gives
    /// it no `scale`. `what` is the type in words, as "a timestamp". Missing values are NaN.
    #[must_use]
    pub fn with_time(
        mut self,
        name: impl Into<String>,
        values_s: Vec<f64>,
        what: &'static str,
    ) -> Table {
        let name = name.into();
        self.times.push((name.clone(), what));
        self.with(name, values_s)
    }

    /// The table with a column of text, which no analysis reads; errors quote its first cell.
    #[must_use]
    pub fn with_text(mut self, name: impl Into<String>, cell: impl Into<String>) -> Table {
        self.text.push((name.into(), cell.into(), 1));
        self
    }

    /// The same table with another source.
    fn of(mut self, path: &Path) -> Table {
        self.source = path.to_path_buf();
        self
    }

    /// The table with the numbers of its name as columns, and with every column that the model
    /// needs.
    fn checked(mut self, spec: &Spec) -> Result<Table, Error> {
        let rows = self.columns.first().map_or(0, Vec::len);
        if let Some(i) = self.columns.iter().position(|c| c.len() != rows) {
            return Err(Error::data(
                format!(
                    "{}: column `{}` has {} rows and column `{}` has {rows}",
                    self.source.display(),
                    self.names[i],
                    self.columns[i].len(),
                    self.names[0]
                ),
                "Give all columns of a table the same length",
            ));
        }
        let time = &spec.roles.time.column;
        self.add_made(&spec.input, time)?;
        self.note_shadowed(spec)?;
        let roles = spec.roles.all();
        let needed = roles.iter().map(|(_, c)| &c.column);
        for column in needed.chain(&spec.input.sequence) {
            match self.names.iter().filter(|n| *n == column).count() {
                0 => return Err(self.lacks(column, column == time)),
                1 => {}
                more => {
                    return Err(Error::data(
                        format!(
                            "{}: {more} columns are named `{column}`, and the model uses one of them",
                            self.source.display()
                        ),
                        "Give them names of their own: in the file, or with input.skip = 1 and input.header in the model file",
                    ))
                }
            }
        }
        for (role, column) in &roles {
            let time = self.times.iter().find(|(name, _)| *name == column.column);
            if let Some((name, words)) = time.filter(|_| column.scale != 1.0) {
                return Err(Error::io(
                    &self.source,
                    format!(
                        "column `{name}` is {words}, which is converted to seconds by its type; leave `scale` out of role `{role}` in \
                         the model file"
                    ),
                ));
            }
        }
        self.keep_only(&rows::used_columns(spec)?);
        Ok(self)
    }

    /// Makes what stands in no column: the numbers of the file's name, a time of row numbers or of
    /// two columns.
    fn add_made(&mut self, input: &Input, time: &str) -> Result<(), Error> {
        let rows = self.rows();
        if !input.file_name.is_empty() {
            let keys = files::name_keys(&self.source, input).ok_or_else(|| {
                Error::io(
                    &self.source,
                    format!(
                        "the file name does not fit input.file_name = \"{}\"",
                        input.file_name
                    ),
                )
            })?;
            for (key, value) in keys {
                self.names.push(key);
                self.columns.push(vec![value; rows]);
            }
        }
        if input.rate > 0.0 {
            if self.column(time).is_some() || self.text.iter().any(|(n, ..)| n == time) {
                return Err(Error::io(
                    &self.source,
                    format!(
                        "the file has a column `{time}`, and input.rate = {} says that no column is the time; leave input.rate out \
                         of the model file, or give roles.time the name of no column",
                        input.rate
                    ),
                ));
            }
            self.names.push(time.to_owned());
            // Nobody knows how long a line that was left out took: the clock begins again.
            let mut breaks = self.breaks.iter().copied().peekable();
            let mut start = 0;
            let seconds = (0..rows).map(|i| {
                while let Some(at) = breaks.next_if(|at| *at <= i) {
                    start = at;
                }
                (i - start) as f64 / input.rate
            });
            self.columns.push(seconds.collect());
        }
        self.add_time(time);
        Ok(())
    }

    /// Makes the column of the time where the model names two with a plus between: seconds and
    /// nanoseconds, a date and a time of day.
    fn add_time(&mut self, time: &str) {
        if self.column(time).is_some() {
            return;
        }
        let Some((a, b)) = time.split_once('+') else {
            return;
        };
        if let Some(sum) = self
            .column(a.trim())
            .zip(self.column(b.trim()))
            .map(|both| sum_of_times(both, is_milliseconds(b)))
        {
            self.names.push(time.into());
            self.columns.push(sum);
        }
    }

    /// Notes columns whose name means something else in the expressions of the model.
    fn note_shadowed(&mut self, spec: &Spec) -> Result<(), Error> {
        let used = rows::expression_names(spec)?;
        let roles = spec.roles.all();
        let hides = |name: &&String| {
            let means = roles.iter().find(|(role, _)| role == *name);
            match means {
                Some((_, column)) => column.column != **name,
                None => MADE.contains(&name.as_str()),
            }
        };
        for name in self
            .names
            .iter()
            .filter(|n| used.contains(*n))
            .filter(hides)
        {
            let what = match roles.iter().find(|(role, _)| role == name) {
                Some((_, column)) => format!("role (column `{}`)", column.column),
                None => "analysis's own value".into(),
            };
            self.notes.push(Note::new(
                "shadowed column",
                1,
                format!(
                    "`{name}` in an expression is the {what}, not the log's column `{name}`; to use that column, give it a name of its \
                     own under [roles.channels]"
                ),
            ));
        }
        Ok(())
    }

    /// Gives back the memory of columns that the model does not use.
    fn keep_only(&mut self, used: &BTreeSet<String>) {
        let names = std::mem::take(&mut self.names);
        let columns = std::mem::take(&mut self.columns);
        for (name, mut values) in names.into_iter().zip(columns) {
            if used.contains(&name) {
                values.shrink_to_fit();
                self.names.push(name);
                self.columns.push(values);
            }
        }
    }

    /// Lines that are no rows and were left out.
    #[must_use]
    pub fn lines_left_out(&self) -> usize {
        self.broken
    }

    /// Line of a row of a text log; `None` where it can't be told from the rows.
    #[must_use]
    pub fn line(&self, row: usize) -> Option<u64> {
        Some(self.first_line? + row as u64)
    }

    /// First cell of a column of text, and its line; `None` of any other.
    #[must_use]
    pub fn text(&self, column: &str) -> Option<(&str, u64)> {
        let (_, cell, line) = self.text.iter().find(|(name, ..)| name == column)?;
        Some((cell, *line))
    }

    /// Why a column that the model needs is not there.
    fn lacks(&self, column: &str, is_time: bool) -> Error {
        match self.text.iter().find(|(name, ..)| name == column) {
            Some((_, text, line)) if is_time && is_date(text) => Error::io(
                &self.source,
                format!(
                    "line {line}: column `{column}`: `{text}` is a date or a time of day, and the time is a number of seconds; write it so \
                     (in pandas: (t - t[0]).dt.total_seconds()), or set input.rate, the rows per second, and give roles.time the name of \
                     no column"
                ),
            ),
            Some((_, text, line)) => Error::BadCell {
                path: self.source.clone(),
                line: *line,
                column: column.into(),
                text: text.clone(),
            },
            None if is_time => Error::io(
                &self.source,
                format!(
                    "no column `{column}` for the time; the file has {}. Correct roles.time in the model file, or give \
                     input.rate, the rows per second, where no column is the time",
                    self.all_names().join(", ")
                ),
            ),
            None => Error::MissingColumn {
                column: column.into(),
                path: self.source.clone(),
                found: self.all_names(),
            },
        }
    }

    /// Names of the columns of numbers, then of those of text.
    pub fn all_names(&self) -> Vec<String> {
        let text = self.text.iter().map(|(n, ..)| format!("{n} (text)"));
        self.names.iter().cloned().chain(text).collect()
    }

    fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// Values of a column of numbers, as logged; `None` if there is none of this name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.names
            .iter()
            .position(|n| n == name)
            .map(|i| self.columns[i].as_slice())
    }
}

/// Whether a column has the name of milliseconds beside a time.
fn is_milliseconds(name: &str) -> bool {
    let name = name.trim().to_lowercase();
    ["ms", "msec", "msecs", "millisecond", "milliseconds"].contains(&name.as_str())
}

/// The sum of two columns of time. The second is in milliseconds where its name says so, and in
/// nanoseconds where its values are whole and more than the seconds of a day.
fn sum_of_times((a, b): (&[f64], &[f64]), milliseconds: bool) -> Vec<f64> {
    const DAY_S: f64 = 86_400.0;
    let (_, most) = residual_columns::stats::range(b);
    let whole = b.iter().all(|x| !x.is_finite() || *x == x.round());
    let unit = match (milliseconds, whole && most > DAY_S) {
        (true, _) => 1e-3,
        (_, true) => 1e-9,
        _ => 1.0,
    };
    a.iter().zip(b).map(|(a, b)| a + unit * b).collect()
}

/// Whether a cell is a date or a time of day: digits, with at least two of the marks that stand in
/// such.
fn is_date(cell: &str) -> bool {
    let marks = cell.matches(['-', '/', ':', '.', 'T']).count();
    let digits = cell.chars().filter(char::is_ascii_digit).count();
    marks >= 2 && digits >= 4 && cell.starts_with(|c: char| c.is_ascii_digit())
}

/// Reads one log as it is, with its `time` made where [`Input`] says how. Lines that are no rows
/// are refused, or left out with [`Action::Drop`], and so are those with text in a column of
/// numbers that is `used`; in another one it is NaN.
///
/// # Errors
/// The file can't be read, or its name does not fit.
pub fn read(
    path: &Path,
    input: &Input,
    lines: Action,
    time: &str,
    used: &[&str],
) -> Result<Table, Error> {
    let used = used.iter().map(|name| ((*name).to_owned(), f64::INFINITY));
    let mut table = files::read(path, input, lines, &used.collect())?;
    table.add_made(input, time)?;
    Ok(table)
}

/// Loads logs from files and folders.
///
/// # Errors
/// Any [`Error`]: files that cannot be read, missing columns, cells that are not numbers, time that
/// does not grow, too few rows or groups.
pub fn load(paths: &[PathBuf], spec: &Spec) -> Result<Data, Error> {
    let mut findings = Findings::default();
    let found = files::find(paths)?;
    if let Some(first) = found.passed.first() {
        findings.count(
            "no file",
            found.passed.len(),
            &first.display().to_string(),
            "pipes, sockets or devices in the folders were not read",
        );
    }
    let files = files::fitting(found.files, paths, spec, &mut findings)?;
    // All results first: of several bad files it is always the first that is reported.
    let results: Vec<Result<Table, Error>> = files
        .par_iter()
        .map(|path| files::read_of(path, spec)?.checked(spec))
        .collect();
    assemble(
        results.into_iter().collect::<Result<_, _>>()?,
        spec,
        findings,
    )
}

/// Loads logs to check models on: as [`load`], but one group is enough, as nothing is fitted to
/// them.
pub fn load_to_check(paths: &[PathBuf], spec: &Spec) -> Result<Data, Error> {
    load(paths, &of_one_group(spec))
}

/// As [`load_to_check`], for columns in memory.
///
/// # Errors
/// As [`load`], for what is in the tables.
pub fn from_tables_to_check(tables: Vec<Table>, spec: &Spec) -> Result<Data, Error> {
    from_tables(tables, &of_one_group(spec))
}

/// The model file with groups in any log.
fn of_one_group(spec: &Spec) -> Spec {
    let mut spec = spec.clone();
    // Blocks of any length make groups of any log.
    spec.holdout.block_s.get_or_insert(f64::MIN_POSITIVE);
    spec
}

/// Loads logs whose columns are in memory already.
///
/// # Errors
/// As [`load`], for what is in the tables.
///
/// ```
/// use residual_log::{load, spec::Spec};
///
/// let spec = Spec::parse(
///     r#"
///     roles.time = { column = "t", unit = "s" }
///     roles.target = { column = "force", unit = "N" }
///     [[terms]]
///     name = "offset"
///     expr = "1"
///     "#,
/// )?;
/// let run = |name: &str, phase: f64| {
///     let time: Vec<f64> = (0..100).map(|i| 0.01 * f64::from(i)).collect();
///     let force = time.iter().map(|t| (t + phase).sin()).collect();
///     load::Table::new(name).with("t", time).with("force", force)
/// };
/// let data = load::from_tables(vec![run("run 1", 0.0), run("run 2", 1.0)], &spec)?;
/// assert_eq!(data.folds(), ["run 1", "run 2"]);
/// # Ok::<(), residual_columns::error::Error>(())
/// ```
pub fn from_tables(tables: Vec<Table>, spec: &Spec) -> Result<Data, Error> {
    let tables = tables.into_iter().map(|t| t.checked(spec));
    assemble(tables.collect::<Result<_, _>>()?, spec, Findings::default())
}

/// From tables that have every column to data that are ready.
fn assemble(mut tables: Vec<Table>, spec: &Spec, mut findings: Findings) -> Result<Data, Error> {
    let mut frame = rows::frame(&mut tables, spec, &mut findings)?;
    let read = frame.len() + findings.lost();
    let files: Vec<PathBuf> = tables.into_iter().map(|t| t.source).collect();
    if !spec.rows.sequences.is_empty() {
        frame = rows::keep_sequences(&frame, &Expr::parse(&spec.rows.sequences)?)?;
    }
    let mut keep = vec![true; frame.len()];
    if !spec.rows.keep.is_empty() {
        let mask = Expr::parse(&spec.rows.keep)?.eval(&frame)?;
        keep.iter_mut()
            .zip(&mask)
            .for_each(|(k, m)| *k = *m != 0.0 && !m.is_nan());
    }
    let (suspects, values_per_s) =
        hygiene::inspect(&mut frame, &mut keep, spec, &files, &mut findings);
    let kept = keep.iter().filter(|k| **k).count();
    if kept < FEWEST_ROWS {
        return Err(Error::data(
            format!("only {kept} rows are left to fit"),
            "Look at rows.keep and rows.sequences, or bring more data",
        ));
    }
    let folds = folds::folds(&frame, &keep, spec, &files)?;
    folds::refuse_copies(&frame, &folds.of_row, &files)?;
    copies::note(&frame, &folds.of_row, &files, &mut findings);
    hygiene::refuse_dead_velocity(&frame, &files)?;
    hygiene::relations(&frame, &spec.roles, &folds.of_row, &files, &mut findings);
    if !folds.parts.is_empty() {
        findings.count(
            hygiene::REPEATED_MOTION,
            folds.parts.iter().filter(|part| **part > 0).count(),
            "whole record",
            "rows of runs whose motion repeats: blocks of time are those of one period, each held out in all passes at once; how the \
             model does on another motion these data do not show",
        );
    }
    let used: Vec<PathBuf> = {
        let mut ids: Vec<usize> = frame
            .column("file")
            .unwrap_or(&[])
            .iter()
            .map(|f| *f as usize)
            .collect();
        ids.dedup();
        ids.into_iter().map(|i| files[i].clone()).collect()
    };
    Ok(Data {
        frame,
        keep,
        fold: folds.of_row,
        fold_names: folds.names,
        groups: folds.groups,
        parts: folds.parts,
        files: used,
        suspects,
        values_per_s,
        hygiene: findings.done(read),
    })
}
