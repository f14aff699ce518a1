//! How a text log is laid out: separator, decimal mark, comments, header.

use super::super::text;
use super::header;
use crate::spec::Input;
use residual_columns::error::Error;
use std::io::Read;
use std::path::Path;

/// Bytes at the head of a log that are looked at for its layout.
const LOOK: u64 = 1 << 16;

/// A line of the file that is neither empty nor a comment, with the number of lines before it.
type Line<'a> = (usize, &'a str);

/// Where the names of the columns come from.
#[derive(PartialEq)]
pub(super) enum Origin {
    /// The line above the first row: the reader finds them itself.
    Header,
    /// Another line of the file, with this number. The line below it may have units.
    Line(usize),
    /// A comment.
    Comment,
    /// Texts before the numbers of each row.
    Labels,
    /// Nothing names the columns.
    Nothing,
}

/// How a text log is laid out.
pub(super) struct Layout {
    pub(super) input: Input,
    pub(super) origin: Origin,
    /// Whether the log is text; else its columns have names and no layout.
    pub(super) is_text: bool,
    /// Cells of the second line of a header; none where it has one line.
    second: Vec<String>,
    /// Rows per second, where the file says so above its rows.
    pub(super) rate: Option<f64>,
}

impl Layout {
    /// The layout of a log that has columns of its own.
    pub(super) fn of_columns() -> Layout {
        Layout {
            input: Input::default(),
            origin: Origin::Header,
            is_text: false,
            second: vec![],
            rate: None,
        }
    }

    pub(super) fn of(path: &Path) -> Result<Layout, Error> {
        let (head, is_utf8) = head(path)?;
        let is_comment = |l: &str| l.starts_with(['%', '#']);
        let comments: Vec<&str> = head.lines().filter(|l| is_comment(l)).collect();
        let lines: Vec<Line> = head
            .lines()
            .enumerate()
            .filter(|(_, l)| !is_comment(l) && !l.trim().is_empty())
            .collect();
        let middle = lines.len() / 2;
        let failed = |what: &str| {
            let line = lines.get(middle).map_or(1, |l| l.0 + 1);
            let keys = "write the model file by hand, with input.separator, with input.skip for the lines before the first row and with input.header for the names";
            let kinds = if has_kinds(&lines) {
                ". Lines of several kinds, each with its kind at its head, need one [[input.messages]] for each kind"
            } else {
                ""
            };
            Error::io(path, format!("line {line}: {what}; {keys}{kinds}"))
        };
        let (separator, cells) = separator(&lines).ok_or_else(|| {
            failed("no separator splits this line and those below it into equal numbers of cells, two or more")
        })?;
        let row = lines[middle..]
            .iter()
            .find(|l| split(l.1, separator).len() == cells)
            .map_or("", |l| l.1);
        let row_cells = split(row, separator);
        // A comma behind a unit is none.
        let with_comma = |c: &&str| is_number(c, ',') && !is_number(c, '.');
        let decimal = if separator != "," && row_cells.iter().any(with_comma) {
            ','
        } else {
            '.'
        };
        let row = Row {
            is_number: row_cells.iter().map(|c| is_number(c, decimal)).collect(),
            ends_empty: row_cells.last() == Some(&""),
            separator,
            decimal,
        };
        let from = header_of_labview(&lines);
        let data = lines[from..]
            .iter()
            .position(|l| row.fits(l.1))
            .map(|at| from + at)
            .ok_or_else(|| failed("no cell is a number"))?;
        let mut layout = Layout {
            input: Input {
                separator: separator.into(),
                decimal: decimal.into(),
                comment: comments
                    .first()
                    .map_or(String::new(), |c| c[..1].to_string()),
                ..Input::default()
            },
            origin: Origin::Nothing,
            is_text: true,
            second: vec![],
            rate: rate(&lines[..data], separator),
        };
        let above: Vec<Vec<&str>> = lines[..data].iter().map(|l| row.head(l.1)).collect();
        let comments: Vec<Vec<&str>> = comments
            .iter()
            .map(|c| split(c.trim_start_matches(['%', '#', ' ']), separator))
            .filter(|names| names.len() == cells)
            .collect();
        let longer = row.longer_header(&lines[..data]);
        let names = if let Some(names) = longer {
            layout.origin = Origin::Line(lines[data - 1].0 + 1);
            names
        } else if let Some((at, names, second)) = row.header(&above) {
            layout.second = second;
            let own = split(lines[at].1, separator);
            let as_they_are = own.len() == cells && is_utf8 && usable_as_they_are(&own);
            if at + 1 == data && as_they_are {
                layout.origin = Origin::Header;
                layout.input.skip = if at > 0 { lines[at].0 } else { 0 };
                return Ok(layout);
            }
            layout.origin = Origin::Line(lines[at].0 + 1);
            names
        } else if let Some((_, names, second)) = row.header(&comments) {
            layout.origin = Origin::Comment;
            layout.second = second;
            names
        } else {
            let names = labels(&row_cells);
            if names.iter().any(|n| !n.is_empty()) {
                layout.origin = Origin::Labels;
            }
            names
        };
        layout.input.header = header::usable(&names);
        layout.input.skip = if data > 0 { lines[data].0 } else { 0 };
        Ok(layout)
    }

    /// Whether nothing names the columns.
    pub(super) fn is_nameless(&self) -> bool {
        self.origin == Origin::Nothing
    }

    /// What the second line of the header says about a column.
    pub(super) fn second(&self, column: &str) -> &str {
        let at = self.input.header.iter().position(|n| n == column);
        at.and_then(|i| self.second.get(i))
            .map_or("", String::as_str)
    }
}

/// What a row of the log is like.
struct Row<'a> {
    /// Which of its cells are numbers.
    is_number: Vec<bool>,
    /// Whether its last cell is empty: a separator stands at its end.
    ends_empty: bool,
    separator: &'a str,
    decimal: char,
}

impl Row<'_> {
    /// Whether a line is a row: no text where the others have a number, and one number at least.
    fn fits(&self, line: &str) -> bool {
        let cells = split(line, self.separator);
        let mut columns = self.is_number.iter().zip(&cells).filter(|(n, _)| **n);
        cells.len() == self.is_number.len()
            && columns
                .clone()
                .all(|(_, c)| value(c, self.decimal).is_some())
            && columns.any(|(_, c)| is_number(c, self.decimal))
    }

    /// Cells of a line above the rows. A separator at the end of it, or of the rows only, makes no
    /// column.
    fn head<'a>(&self, line: &'a str) -> Vec<&'a str> {
        let count = self.is_number.len();
        let mut cells = split(line, self.separator);
        while cells.len() > count && cells.last() == Some(&"") {
            cells.pop();
        }
        if cells.len() + 1 == count && self.ends_empty {
            cells.push("");
        }
        cells
    }

    /// Names of the line just above the rows where it has more cells than they, as one for
    /// comments: none of it is a number, and the names are different.
    fn longer_header<'a>(&self, above: &[Line<'a>]) -> Option<Vec<&'a str>> {
        let cells = split(above.last()?.1, self.separator);
        let count = self.is_number.len();
        let is_text = |c: &&str| !c.is_empty() && !is_number(c, self.decimal);
        let longer = cells.len() > count && cells.len() <= count + 2 && self.separator != "blank";
        let named = longer && cells.iter().all(is_text) && usable_as_they_are(&cells);
        named.then(|| cells[..count].to_vec())
    }

    /// Whether a line may name the columns: it has no number where a row has one.
    fn may_name(&self, cells: &[&str]) -> bool {
        let mut columns = self.is_number.iter().zip(cells);
        cells.len() == self.is_number.len()
            && !columns.any(|(n, c)| *n && is_number(c, self.decimal))
    }

    /// Place and cells of the last line that names the columns, and the cells of the second line of
    /// the header below it.
    fn header<'a>(&self, above: &[Vec<&'a str>]) -> Option<(usize, Vec<&'a str>, Vec<String>)> {
        if let [.., names, second] = above {
            // Cells may be missing at the end, but not between blanks.
            let count = self.is_number.len();
            let is_whole =
                second.len() == count || (second.len() < count && self.separator != "blank");
            let is_header = self.may_name(names) && header::is_second(names, second);
            if is_whole && (is_header || header::are_units(names, second)) {
                let second = second.iter().map(|c| c.to_string()).collect();
                return Some((above.len() - 2, names.clone(), second));
            }
        }
        // Numbers may be names too, such as those of channels.
        let at = above
            .iter()
            .rposition(|l| self.may_name(l))
            .or_else(|| above.iter().rposition(|l| l.len() == self.is_number.len()))?;
        Some((at, above[at].clone(), vec![]))
    }
}

/// Place of the names of a LabVIEW measurement file, above which lines of numbers are no rows, as
/// its numbers of samples; 0 for every other file.
fn header_of_labview(lines: &[Line]) -> usize {
    let is_labview = lines.iter().any(|l| l.1.starts_with("***End_of_Header***"));
    let names = lines.iter().position(|l| l.1.starts_with("X_Value"));
    names.filter(|_| is_labview).unwrap_or(0)
}

/// Rows per second by the step that a LabVIEW measurement file states above its rows.
fn rate(above: &[Line], separator: &str) -> Option<f64> {
    let cells = above.iter().map(|l| split(l.1, separator));
    let mut steps = cells.filter(|c| c.first() == Some(&"Delta_X"));
    let step = value(steps.next()?.get(1)?, '.')?;
    (step > 0.0 && step.is_finite()).then_some(1.0 / step)
}

/// Whether names can be used as the file has them: none is empty, none stands there twice.
fn usable_as_they_are(names: &[&str]) -> bool {
    let bare: Vec<&str> = names.iter().map(|n| n.trim_matches('"').trim()).collect();
    header::usable(names) == bare
}

/// The texts before the numbers of a row that end like a label, as `speed:` and `speed =` do.
fn labels<'a>(row: &[&'a str]) -> Vec<&'a str> {
    let mut before = "";
    let named = row.iter().map(|cell| {
        let label = std::mem::replace(&mut before, cell);
        let label = label.strip_suffix([':', '=']).unwrap_or("").trim();
        if label.starts_with(char::is_alphabetic) {
            label
        } else {
            ""
        }
    });
    named.collect()
}

/// The first whole lines of a log, and whether they are UTF-8. Others are taken as those of an old
/// Windows, in which a letter is a byte.
fn head(path: &Path) -> Result<(String, bool), Error> {
    let mut bytes = Vec::new();
    text::open(path)?
        .take(LOOK)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    // The last line may be cut off.
    if bytes.len() as u64 == LOOK {
        bytes.truncate(bytes.iter().rposition(|b| *b == b'\n').unwrap_or(0));
    }
    let (head, is_utf8) = match std::str::from_utf8(&bytes) {
        Ok(text) => (text.to_string(), true),
        // Damaged bytes among text of another code are rare in a head.
        Err(_) => (bytes.iter().map(|b| char::from(*b)).collect(), false),
    };
    Ok((head.trim_start_matches('\u{feff}').to_string(), is_utf8))
}

/// The separator that makes the most numbers of a line in the middle, and the number of cells.
fn separator(lines: &[Line]) -> Option<(&'static str, usize)> {
    let (_, middle) = lines.get(lines.len() / 2)?;
    let numbers = |s: &str| {
        let count = |decimal| {
            let cells = split(middle, s);
            cells.iter().filter(|c| is_number(c, decimal)).count()
        };
        count('.').max(if s == "," { 0 } else { count(',') })
    };
    [";", "\t", "|", ",", "blank"]
        .into_iter()
        .filter_map(|s| Some((s, usual(lines, s)?)))
        .filter(|(_, cells)| *cells > 1)
        // Of equals, the last of a reversed sequence is the first.
        .rev()
        .max_by_key(|(s, _)| numbers(s))
}

/// The value of a cell as the reader takes it.
fn value(cell: &str, decimal: char) -> Option<f64> {
    text::number(cell.trim_matches('"'), decimal)
}

fn is_number(cell: &str, decimal: char) -> bool {
    value(cell, decimal).is_some_and(f64::is_finite)
}

fn split<'a>(line: &'a str, separator: &str) -> Vec<&'a str> {
    match separator {
        "blank" => line.split_whitespace().collect(),
        s => quoted(line, s).unwrap_or_else(|| line.split(s).map(str::trim).collect()),
    }
}

/// The cells of a line in which a separator may stand between quotation marks; `None` where there
/// are none, or one is not closed.
fn quoted<'a>(line: &'a str, separator: &str) -> Option<Vec<&'a str>> {
    if !line.contains('"') {
        return None;
    }
    let (mut cells, mut start, mut inside) = (Vec::new(), 0, false);
    for (at, c) in line.char_indices() {
        if c == '"' {
            inside = !inside;
        } else if !inside && separator.starts_with(c) {
            cells.push(line[start..at].trim());
            start = at + c.len_utf8();
        }
    }
    cells.push(line[start..].trim());
    (!inside).then_some(cells)
}

/// Whether the lines begin with one of a few words, each of them often.
fn has_kinds(lines: &[Line]) -> bool {
    let mut words: Vec<&str> = lines
        .iter()
        .filter_map(|l| l.1.split([',', ';', '\t', ' ', '|', ':']).next())
        .filter(|w| w.starts_with(|c: char| c.is_alphabetic() || c == '$'))
        .collect();
    let all = words.len();
    words.sort_unstable();
    words.dedup();
    10 * all >= 9 * lines.len() && words.len() > 1 && 5 * words.len() < all
}

/// The number of cells that nearly all lines have; `None` if they differ. The first half may be
/// prose.
fn usual(lines: &[Line], separator: &str) -> Option<usize> {
    let counts: Vec<usize> = lines[lines.len() / 2..]
        .iter()
        .take(60)
        .map(|l| split(l.1, separator).len())
        .collect();
    // One of these lines may be a message, or cut off.
    let same = |cells: usize| counts.iter().filter(|c| **c == cells).count();
    let most = *counts.iter().max_by_key(|c| same(**c))?;
    (10 * same(most) >= 7 * counts.len()).then_some(most)
}
