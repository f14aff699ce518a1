//! How a text log is laid out: separator, decimal mark, comments, header.

use super::super::text;
use crate::error::Error;
use crate::spec::Input;
use std::io::Read;
use std::path::Path;

/// Bytes at the head of a log that are looked at for its layout.
const LOOK: u64 = 1 << 16;

/// How a text log is laid out.
pub(super) struct Layout {
    pub(super) input: Input,
    /// Names that a comment line has for the columns.
    pub(super) from_comment: bool,
}

impl Layout {
    pub(super) fn of(path: &Path) -> Result<Layout, Error> {
        let head = head(path)?;
        let is_comment = |l: &&str| l.starts_with(['%', '#']);
        let comments: Vec<&str> = head.lines().filter(is_comment).collect();
        let rows: Vec<&str> = head
            .lines()
            .filter(|l| !is_comment(l) && !l.trim().is_empty())
            .collect();
        let (separator, cells) = separator(&rows).ok_or_else(|| {
            Error::io(path, "no separator gives its first lines equal numbers of cells; write the model file by hand")
        })?;
        let first = rows
            .iter()
            .position(|l| split(l, separator).len() == cells)
            .unwrap_or(0);
        let middle = rows[rows.len() / 2];
        let decimal = if separator != "," && middle.contains(',') {
            ","
        } else {
            "."
        };
        let mut input = Input {
            separator: separator.into(),
            decimal: decimal.into(),
            comment: comments
                .first()
                .map_or(String::new(), |c| c[..1].to_string()),
            skip: if comments.is_empty() { first } else { 0 },
            ..Input::default()
        };
        let mut from_comment = false;
        if !has_names(rows[first], middle, separator, decimal) {
            let names = comments
                .iter()
                .rev()
                .map(|c| split(c.trim_start_matches(['%', '#', ' ']), separator))
                .find(|names| names.len() == cells);
            from_comment = names.is_some();
            input.header = match names {
                Some(names) => names.iter().map(|n| n.trim().to_string()).collect(),
                None => (1..=cells).map(|k| format!("column_{k}")).collect(),
            };
        }
        Ok(Layout {
            input,
            from_comment,
        })
    }

    /// Whether nothing names the columns.
    pub(super) fn is_nameless(&self) -> bool {
        !self.input.header.is_empty() && !self.from_comment
    }
}

/// The first whole lines of a log.
fn head(path: &Path) -> Result<String, Error> {
    let mut bytes = Vec::new();
    text::open(path)?
        .take(LOOK)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    let mut head = String::from_utf8_lossy(&bytes)
        .trim_start_matches('\u{feff}')
        .to_string();
    // The last line may be cut off.
    if bytes.len() as u64 == LOOK {
        head.truncate(head.rfind('\n').unwrap_or(0));
    }
    Ok(head)
}

/// The separator that makes the most numbers of a line in the middle, and the number of cells.
fn separator(rows: &[&str]) -> Option<(&'static str, usize)> {
    let middle = rows.get(rows.len() / 2)?;
    let numbers = |s: &str| {
        let count = |decimal| {
            let cells = split(middle, s);
            cells.iter().filter(|c| is_number(c, decimal)).count()
        };
        count(".").max(if s == "," { 0 } else { count(",") })
    };
    [";", "\t", ",", "blank"]
        .into_iter()
        .filter_map(|s| Some((s, usual(rows, s)?)))
        .filter(|(_, cells)| *cells > 1)
        // Of equals, the last of a reversed sequence is the first.
        .rev()
        .max_by_key(|(s, _)| numbers(s))
}

/// Whether a line names the columns: it has a text where the line in the middle has a number, or no number at all.
fn has_names(line: &str, middle: &str, separator: &str, decimal: &str) -> bool {
    let numbers = |line: &str| -> Vec<bool> {
        let cells = split(line, separator);
        cells.iter().map(|c| is_number(c, decimal)).collect()
    };
    let (first, other) = (numbers(line), numbers(middle));
    first.iter().zip(&other).any(|(a, b)| !a && *b) || !first.contains(&true)
}

fn is_number(cell: &str, decimal: &str) -> bool {
    let cell = cell.trim_matches('"');
    cell.replace(decimal, ".").parse::<f64>().is_ok()
}

fn split<'a>(line: &'a str, separator: &str) -> Vec<&'a str> {
    match separator {
        "blank" => line.split_whitespace().collect(),
        s => line.split(s).map(str::trim).collect(),
    }
}

/// The number of cells that nearly all lines have; `None` if they differ.
fn usual(rows: &[&str], separator: &str) -> Option<usize> {
    let counts: Vec<usize> = rows
        .iter()
        .take(60)
        .map(|l| split(l, separator).len())
        .collect();
    let last = *counts.last()?;
    let same = counts.iter().filter(|c| **c == last).count();
    (10 * same >= 7 * counts.len()).then_some(last)
}
