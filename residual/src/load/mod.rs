//! From logs to [`Data`]: files or columns in memory are read, cut into sequences, converted to the units of the
//! model, filtered, and assigned to folds.
//!
//! | file | concern |
//! |---|---|
//! | `files.rs` | which files are logs |
//! | `text.rs`, `parquet.rs` | one log of each format |
//! | `messages.rs` | text logs with several kinds of message |
//! | `guess/` | a first model file for logs that nobody has described |
//! | `rows.rs` | rows in units of the model, sequences |
//! | `folds.rs` | groups and folds for hold-out |

mod files;
mod folds;
mod guess;
mod messages;
#[cfg(feature = "parquet")]
mod parquet;
mod rows;
mod text;

#[cfg(test)]
mod tests;

pub use files::find_files;
pub use guess::guess;

use crate::data::{Data, FEWEST_ROWS};
use crate::error::Error;
use crate::expr::Expr;
use crate::hygiene;
use crate::spec::Spec;
use rayon::prelude::*;
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
    /// Lines of kinds of message that the model file does not list.
    others: usize,
    /// Lines that are no rows, left out by `hygiene.text`.
    broken: usize,
}

impl Table {
    /// A table without columns. The file name of `source` stands for it in reports and in `file` groups,
    /// and `input.file_name` of the model file is matched against it; the file need not exist.
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

    /// The same table with another source.
    fn of(mut self, path: &Path) -> Table {
        self.source = path.to_path_buf();
        self
    }

    /// The table with the numbers of its name as columns, and with every column that the model needs.
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
        if !spec.input.file_name.is_empty() {
            let keys = files::name_keys(&self.source, spec).ok_or_else(|| {
                Error::io(
                    &self.source,
                    format!(
                        "the file name does not fit input.file_name = \"{}\"",
                        spec.input.file_name
                    ),
                )
            })?;
            for (key, value) in keys {
                self.names.push(key);
                self.columns.push(vec![value; rows]);
            }
        }
        let time = &spec.roles.time.column;
        if spec.input.rate > 0.0 && self.column(time).is_none() {
            if self.broken > 0 {
                return Err(Error::data(
                    format!(
                        "{}: hygiene.text leaves out {} lines, and input.rate counts lines to know the time",
                        self.source.display(),
                        self.broken
                    ),
                    "Correct these lines, or log a time",
                ));
            }
            self.names.push(time.clone());
            let seconds = (0..rows).map(|i| i as f64 / spec.input.rate);
            self.columns.push(seconds.collect());
        }
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
        self.keep_only(&rows::used_columns(spec)?);
        Ok(self)
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

    /// Why a column that the model needs is not there.
    fn lacks(&self, column: &str, is_time: bool) -> Error {
        match self.text.iter().find(|(name, ..)| name == column) {
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
                    self.names.join(", ")
                ),
            ),
            None => Error::MissingColumn {
                column: column.into(),
                path: self.source.clone(),
                found: self.names.clone(),
            },
        }
    }

    fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.names
            .iter()
            .position(|n| n == name)
            .map(|i| self.columns[i].as_slice())
    }
}

/// Loads logs from files and folders.
///
/// # Errors
/// Any [`Error`]: files that cannot be read, missing columns, cells that are not numbers, time that does
/// not grow, too few rows or groups.
pub fn load(paths: &[PathBuf], spec: &Spec) -> Result<Data, Error> {
    let mut findings = hygiene::Log::default();
    let files = files::fitting(find_files(paths)?, paths, spec, &mut findings)?;
    // All results first: of several bad files it is always the first that is reported.
    let results: Vec<Result<Table, Error>> = files
        .par_iter()
        .map(|path| files::read(path, spec)?.checked(spec))
        .collect();
    assemble(
        results.into_iter().collect::<Result<_, _>>()?,
        spec,
        findings,
    )
}

/// Loads logs to check models on: as [`load`], but one group is enough, as nothing is fitted to them.
pub(crate) fn load_to_check(paths: &[PathBuf], spec: &Spec) -> Result<Data, Error> {
    let mut spec = spec.clone();
    // Blocks of any length make groups of any log.
    spec.holdout.block_s.get_or_insert(f64::MIN_POSITIVE);
    load(paths, &spec)
}

/// Loads logs whose columns are in memory already.
///
/// # Errors
/// As [`load`], for what is in the tables.
///
/// ```
/// use residual::{load, spec::Spec};
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
/// # Ok::<(), residual::Error>(())
/// ```
pub fn from_tables(tables: Vec<Table>, spec: &Spec) -> Result<Data, Error> {
    let tables = tables.into_iter().map(|t| t.checked(spec));
    assemble(
        tables.collect::<Result<_, _>>()?,
        spec,
        hygiene::Log::default(),
    )
}

/// From tables that have every column to data that are ready.
fn assemble(
    mut tables: Vec<Table>,
    spec: &Spec,
    mut findings: hygiene::Log,
) -> Result<Data, Error> {
    let mut frame = rows::frame(&mut tables, spec, &mut findings)?;
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
    hygiene::inspect(&mut frame, &mut keep, &spec.hygiene, &files, &mut findings);
    let kept = keep.iter().filter(|k| **k).count();
    if kept < FEWEST_ROWS {
        return Err(Error::data(
            format!("only {kept} rows are left to fit"),
            "Look at rows.keep and rows.sequences, or bring more data",
        ));
    }
    let folds = folds::folds(&frame, &keep, spec, &files)?;
    folds::refuse_copies(&frame, &folds.of_row, &files)?;
    hygiene::relations(&frame, &spec.roles, &folds.of_row, &mut findings);
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
        files: used,
        hygiene: findings.done(),
    })
}
