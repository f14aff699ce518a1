//! A first model file for logs that nobody has described yet: separator, header, roles and units as
//! they seem to be, with the questions that only a person can answer.
//!
//! | file | concern |
//! |---|---|
//! | `layout.rs` | separator, decimal mark, comments, header |
//! | `header.rs` | headers of two lines: names, then units |
//! | `code.rs` | names in the old codes of Japan and China |
//! | `compound.rs` | units of several parts: torques, and what stays as it stands |
//! | `names.rs` | role, unit and index by the name of a column |
//! | `columns.rs` | which column has which role |
//! | `time.rs` | the column of the time, and its unit |
//! | `units.rs` | units of angle and velocity by their values |
//! | `write.rs` | the text of the model file |

mod code;
mod columns;
mod compound;
mod header;
mod layout;
mod names;
mod time;
mod units;
mod write;

pub(super) use header::is_symbol;

use super::{files, text, Table};
use crate::spec::Action;
use layout::Layout;
use residual_columns::dates;
use residual_columns::error::Error;
use std::path::{Path, PathBuf};

/// Logs that are looked at until one has rows.
const TRIES: usize = 20;

/// Writes a model file for logs: what the first of them that has rows looks like, with open
/// questions as comments.
///
/// # Errors
/// [`Error::Io`] if no layout fits the first lines of any log, or if none can be read: that of the
/// first one.
pub fn guess(paths: &[PathBuf]) -> Result<String, Error> {
    let files = files::find_files(paths)?;
    let mut first = None;
    for path in files.iter().take(TRIES) {
        match of_file(path, files.len()) {
            Ok(text) => return Ok(text),
            Err(why) => {
                first.get_or_insert(why);
            }
        }
    }
    Err(first.unwrap_or_else(|| Error::io(&files[0], "no log can be read")))
}

/// The model file for one of so many logs.
fn of_file(path: &Path, files: usize) -> Result<String, Error> {
    let parquet = files::parquet(path);
    let layout = if parquet.is_some() {
        Layout::of_columns()
    } else {
        Layout::of(path)?
    };
    let as_it_is = match parquet {
        Some(table) => table,
        None => text::read(path, &layout.input, Action::Report, None),
    };
    // A message or a line that was cut off need not keep the user from a model file.
    let (mut table, first_broken) = match as_it_is {
        Ok(table) => (table, None),
        Err(why) if layout.is_text => match text::read(path, &layout.input, Action::Drop, None) {
            Ok(table) if 2 * table.broken < table.rows() => {
                (table, Some(without_path(&why.to_string(), path)))
            }
            _ => return Err(why),
        },
        Err(why) => return Err(why),
    };
    if table.rows() == 0 {
        return Err(Error::io(
            path,
            "the file has no row; give another one in --data",
        ));
    }
    table.join_times();
    Ok(write::model(
        path,
        files,
        &layout,
        &table,
        first_broken.as_deref(),
    ))
}

/// Ends of the names of columns that are seconds, and of those that are the nanoseconds beside
/// them.
const SECONDS: [&str; 3] = ["secs", "sec", "s"];
const NANOSECONDS: [&str; 5] = ["nsecs", "nsec", "nanosec", "nanoseconds", "ns"];

impl Table {
    /// Puts one column in the place of a date and a time of day, or of seconds and nanoseconds.
    fn join_times(&mut self) {
        let of = |kind: dates::Kind| {
            let found = self.times.iter().find(|(_, words)| *words == kind.words());
            found.map(|(name, _)| name.clone())
        };
        let dated = of(dates::Kind::Date).zip(of(dates::Kind::TimeOfDay));
        let pairs = self
            .names
            .iter()
            .flat_map(|a| self.names.iter().map(move |b| (a, b)));
        let mut stamped = pairs
            .filter(|(a, b)| is_stamp(a, b))
            .map(|(a, b)| (a.clone(), b.clone()));
        let found = dated
            .or_else(|| self.with_milliseconds())
            .or_else(|| stamped.next_back());
        let Some((a, b)) = found.or_else(|| self.nameless_stamp()) else {
            return;
        };
        let name = format!("{a}+{b}");
        self.add_time(&name);
        self.times.push((name, "a sum of times"));
        for part in [a, b] {
            if let Some(at) = self.names.iter().position(|n| *n == part) {
                self.names.remove(at);
                self.columns.remove(at);
            }
            self.times.retain(|(n, _)| *n != part);
        }
    }
}

impl Table {
    /// A column of times of day, or of dates with one, and that of the milliseconds behind its
    /// seconds.
    fn with_milliseconds(&self) -> Option<(String, String)> {
        let within = |values: &[f64]| {
            let mut finite = values.iter().filter(|x| x.is_finite());
            finite.all(|x| *x == x.round() && (0.0..1000.0).contains(x))
        };
        let is_it =
            |(name, values): &(&String, &Vec<f64>)| super::is_milliseconds(name) && within(values);
        let (ms, _) = self.names.iter().zip(&self.columns).find(is_it)?;
        let clocks = [dates::Kind::Both.words(), dates::Kind::TimeOfDay.words()];
        let (time, _) = self
            .times
            .iter()
            .find(|(_, words)| clocks.contains(words))?;
        Some((time.clone(), ms.clone()))
    }

    /// The first two columns without a name of their own that are the seconds and the nanoseconds
    /// of a stamp, by their values: `ros2 topic echo --csv` writes no names.
    fn nameless_stamp(&self) -> Option<(String, String)> {
        let within = |values: &[f64], range: std::ops::Range<f64>| {
            let mut finite = values.iter().filter(|x| x.is_finite());
            finite.all(|x| *x == x.round() && range.contains(x))
        };
        let of = |i: usize| (&self.names[i], &self.columns[i]);
        (1..self.names.len()).find_map(|i| {
            let ((a, seconds), (b, nanoseconds)) = (of(i - 1), of(i));
            let nameless = a.starts_with("column_") && b.starts_with("column_");
            let (_, most) = residual_columns::stats::range(nanoseconds);
            let is_it = within(seconds, time::EPOCH) && within(nanoseconds, 0.0..1e9);
            (nameless && is_it && most >= 1e8).then(|| (a.clone(), b.clone()))
        })
    }
}

/// Whether two columns are the seconds and the nanoseconds of one stamp, by their names.
fn is_stamp(seconds: &str, nanoseconds: &str) -> bool {
    SECONDS.iter().any(|s| {
        let stem = seconds.strip_suffix(s);
        stem.is_some_and(|stem| {
            NANOSECONDS
                .iter()
                .any(|n| nanoseconds.strip_suffix(n) == Some(stem))
        })
    })
}

/// The text of an error without the folder of the file.
fn without_path(why: &str, path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    why.replace(&*path.display().to_string(), &name)
}

#[cfg(test)]
mod foreign;
#[cfg(test)]
mod tests;
