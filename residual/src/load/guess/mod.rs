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
use std::path::PathBuf;

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
    let table = text::read(path, &layout.input, Action::Report)?;
    Ok(write::model(path, files.len(), &layout, &table))
}

#[cfg(test)]
mod tests;
