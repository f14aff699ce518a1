//! A first model file for logs that nobody has described yet: separator, header, roles and units as they seem to be, with the
//! questions that only a person can answer.
//!
//! | file | concern |
//! |---|---|
//! | `layout.rs` | separator, decimal mark, comments, header |
//! | `header.rs` | headers of two lines: names, then units |
//! | `names.rs` | role, unit and index by the name of a column |
//! | `columns.rs` | which column has which role |
//! | `time.rs` | the column of the time, and its unit |
//! | `units.rs` | units of angle and velocity by their values |
//! | `write.rs` | the text of the model file |

mod columns;
mod header;
mod layout;
mod names;
mod time;
mod units;
mod write;

use super::{files, text, Table};
use crate::error::Error;
use crate::spec::Action;
use layout::Layout;
use std::path::{Path, PathBuf};

/// Writes a model file for logs: what the first of them looks like, with open questions as comments.
///
/// # Errors
/// [`Error::Io`] if there is no text log, or if no layout fits its first lines.
pub fn guess(paths: &[PathBuf]) -> Result<String, Error> {
    let files = files::find_files(paths)?;
    let path = files
        .iter()
        .find(|p| {
            !matches!(
                p.extension().and_then(|e| e.to_str()),
                Some("parquet" | "pq")
            )
        })
        .ok_or_else(|| {
            Error::io(
                &files[0],
                "only text logs are looked at; write the model file by hand",
            )
        })?;
    let layout = Layout::of(path)?;
    let as_it_is = text::read(path, &layout.input, Action::Report, None);
    // A message or a line that was cut off need not keep the user from a model file.
    let (table, first_broken) = match as_it_is {
        Ok(table) => (table, None),
        Err(why) => match text::read(path, &layout.input, Action::Drop, None) {
            Ok(table) if 2 * table.broken < table.rows() => {
                (table, Some(without_path(&why.to_string(), path)))
            }
            _ => return Err(why),
        },
    };
    Ok(write::model(
        path,
        files.len(),
        &layout,
        &table,
        first_broken.as_deref(),
    ))
}

/// The text of an error without the folder of the file.
fn without_path(why: &str, path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    why.replace(&*path.display().to_string(), &name)
}

#[cfg(test)]
mod tests;
