//! Text logs: CSV and relatives, plain or gzip.

use super::Table;
use crate::error::Error;
use crate::spec::{Action, Input};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Opens a file, through gzip if its first bytes say so (a name may be wrong, the magic number is not).
pub(super) fn open(path: &Path) -> Result<Box<dyn BufRead>, Error> {
    let mut file =
        BufReader::with_capacity(1 << 16, File::open(path).map_err(|e| Error::io(path, e))?);
    let gzip = file
        .fill_buf()
        .map_err(|e| Error::io(path, e))?
        .starts_with(&[0x1f, 0x8b]);
    Ok(if gzip {
        Box::new(BufReader::with_capacity(
            1 << 16,
            flate2::bufread::MultiGzDecoder::new(file),
        ))
    } else {
        Box::new(file)
    })
}

/// Turns every run of blanks into one tab, so that one CSV reader serves both layouts, with commas as decimal marks too.
struct Blanks<R> {
    inner: R,
    /// Whether a value stands before the current blanks on this line.
    value: bool,
    /// Whether blanks are pending.
    blank: bool,
}

impl<R: Read> Read for Blanks<R> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        // Output never exceeds input, except for one pending tab: read one byte less than fits.
        if buf.len() < 2 {
            return Ok(0);
        }
        let mut raw = vec![0u8; buf.len() / 2];
        loop {
            let n = self.inner.read(&mut raw)?;
            if n == 0 {
                return Ok(0);
            }
            let mut out = 0;
            for &b in &raw[..n] {
                match b {
                    b' ' | b'\t' => self.blank = true,
                    b'\r' | b'\n' => {
                        buf[out] = b;
                        out += 1;
                        (self.value, self.blank) = (false, false);
                    }
                    _ => {
                        if self.blank && self.value {
                            buf[out] = b'\t';
                            out += 1;
                        }
                        buf[out] = b;
                        out += 1;
                        (self.value, self.blank) = (true, false);
                    }
                }
            }
            if out > 0 {
                return Ok(out);
            }
        }
    }
}

fn no_text(path: &Path, line: u64) -> Error {
    Error::io(
        path,
        format!(
            "line {line}: this is not text (UTF-8); convert the file, or leave it out of --data"
        ),
    )
}

/// Line of the file where the CSV reader stands: it does not see the lines that are skipped.
fn line(position: Option<&csv::Position>, input: &Input) -> u64 {
    position.map_or(1, csv::Position::line) + input.skip as u64
}

/// An error of the CSV reader, with what to do about it.
fn broken(path: &Path, input: &Input, e: &csv::Error) -> Error {
    let line = line(e.position(), input);
    match e.kind() {
        csv::ErrorKind::Utf8 { .. } => no_text(path, line),
        csv::ErrorKind::Io(why) => Error::io(
            path,
            format!("cannot be read to its end: {why}; if it is compressed it is cut off or damaged, so copy it again"),
        ),
        _ => Error::io(path, e),
    }
}

/// Opens a text log as CSV: separated by one character, or by runs of blanks.
fn open_csv(path: &Path, input: &Input) -> Result<csv::Reader<Box<dyn Read>>, Error> {
    let mut reader = open(path)?;
    for _ in 0..input.skip {
        let mut line = Vec::new();
        reader
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::io(path, e))?;
    }
    let comment = comment(&mut reader, input, path)?;
    let mut builder = csv::ReaderBuilder::new();
    builder
        .has_headers(input.header.is_empty())
        .trim(csv::Trim::All)
        .comment(Some(comment))
        // Lines of another length are this module's to judge: it knows the names.
        .flexible(true);
    let boxed: Box<dyn Read> = match input.separator.as_bytes() {
        b"blank" => {
            builder.delimiter(b'\t');
            Box::new(Blanks {
                inner: reader,
                value: false,
                blank: false,
            })
        }
        [one] => {
            builder.delimiter(*one);
            Box::new(reader)
        }
        _ => {
            return Err(Error::model(format!(
                "input.separator = \"{}\": one character, or \"blank\"",
                input.separator
            )))
        }
    };
    Ok(builder.from_reader(boxed))
}

/// What begins a comment line: what the model file says, else `%` where the first line begins with it, else `#`.
fn comment(reader: &mut dyn BufRead, input: &Input, path: &Path) -> Result<u8, Error> {
    match input.comment.as_bytes() {
        [one] => Ok(*one),
        [] => {
            let first = reader.fill_buf().map_err(|e| Error::io(path, e))?;
            Ok(if first.starts_with(b"%") { b'%' } else { b'#' })
        }
        _ => Err(Error::model(format!(
            "input.comment = \"{}\": one character",
            input.comment
        ))),
    }
}

/// Names of the columns: of the model file, else of the first line.
fn names(
    csv: &mut csv::Reader<Box<dyn Read>>,
    path: &Path,
    input: &Input,
) -> Result<Vec<String>, Error> {
    let names: Vec<String> = if input.header.is_empty() {
        csv.headers()
            .map_err(|e| broken(path, input, &e))?
            .iter()
            .map(str::to_string)
            .collect()
    } else {
        input.header.clone()
    };
    if names
        .iter()
        .any(|n| n.contains(|c: char| c.is_control() && c != '\t'))
    {
        return Err(no_text(path, line(None, input)));
    }
    if names.is_empty() || names.iter().all(String::is_empty) {
        return Err(Error::io(path, "the file is empty"));
    }
    let numbers = names
        .iter()
        .filter(|n| number(n, '.').is_some_and(f64::is_finite));
    if input.header.is_empty() && numbers.count() == names.len() {
        return Err(Error::io(
            path,
            format!(
                "line {} has {} numbers and no names: the file has no header. Name the columns in the model file: input.header = [\"time\", ...]",
                line(None, input),
                names.len()
            ),
        ));
    }
    if let [only] = names.as_slice() {
        let other = [(';', ";"), ('\t', "\\t"), (',', ","), (' ', "blank")]
            .into_iter()
            .find(|(c, _)| only.contains(*c));
        if let Some((_, name)) = other {
            return Err(Error::io(
                path,
                format!(
                    "line {} is one column, `{only}`: the separator seems to be another; set input.separator = \"{name}\" in the model file, or input.skip if the header is further down",
                    line(None, input)
                ),
            ));
        }
    }
    Ok(names)
}

/// The number in a cell: NaN if it is missing, `None` if it is another text.
pub(super) fn number(cell: &str, decimal: char) -> Option<f64> {
    if cell.is_empty() {
        return Some(f64::NAN);
    }
    let parsed = if decimal == '.' {
        cell.parse()
    } else {
        cell.replace(decimal, ".").parse()
    };
    if let Ok(x) = parsed {
        return Some(x);
    }
    match cell.to_ascii_lowercase().as_str() {
        "true" => Some(1.0),
        "false" => Some(0.0),
        "na" | "null" | "none" => Some(f64::NAN),
        _ => None,
    }
}

/// What stands on one line.
enum Line {
    /// One value for each column.
    Row,
    /// A message, a line that was cut off, or a damaged one.
    Broken(Error),
}

/// Reads one text log. Cells that are empty or `nan` are NaN; a column whose first cell is text is left out. A line with
/// another number of cells than there are names, or with other text in a column that is otherwise numeric, is an error, or is
/// left out and counted with `action` [`Action::Drop`].
pub(super) fn read(path: &Path, input: &Input, action: Action) -> Result<Table, Error> {
    let mut csv = open_csv(path, input)?;
    let names = names(&mut csv, path, input)?;
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let mut text: Vec<Option<(String, u64)>> = vec![None; names.len()];
    let mut record = csv::StringRecord::new();
    let mut values: Vec<f64> = Vec::with_capacity(names.len());
    let mut broken_lines = 0;
    let mut first_broken = None;
    let mut begin = csv.position().line();
    while csv
        .read_record(&mut record)
        .map_err(|e| broken(path, input, &e))?
    {
        let first = columns.first().is_none_or(Vec::is_empty);
        match row(&record, &names, input, first, &mut text, &mut values, path) {
            Line::Row => {
                for (column, value) in columns.iter_mut().zip(&values) {
                    column.push(*value);
                }
            }
            Line::Broken(why) if action != Action::Drop => return Err(why),
            Line::Broken(why) => {
                // A quotation mark that is not closed takes the lines behind it along.
                broken_lines += (csv.position().line() - begin).max(1) as usize;
                first_broken.get_or_insert(why);
            }
        }
        begin = csv.position().line();
    }
    if let Some(why) = first_broken.filter(|_| columns.first().is_none_or(Vec::is_empty)) {
        return Err(why);
    }
    let mut table = Table {
        broken: broken_lines,
        ..Table::default()
    };
    for ((name, column), text) in names.into_iter().zip(columns).zip(text) {
        match text {
            Some((cell, line)) => table.text.push((name, cell, line)),
            None => {
                table.names.push(name);
                table.columns.push(column);
            }
        }
    }
    Ok(table)
}

/// Reads the cells of one line into `values`. The `first` row says which columns are `text`.
fn row(
    record: &csv::StringRecord,
    names: &[String],
    input: &Input,
    first: bool,
    text: &mut [Option<(String, u64)>],
    values: &mut Vec<f64>,
    path: &Path,
) -> Line {
    let line = line(record.position(), input);
    let decimal = if input.decimal == "," { ',' } else { '.' };
    if record.len() != names.len() {
        return Line::Broken(Error::io(
            path,
            format!(
                "line {line}: {} cells where {} columns are named{}",
                record.len(),
                names.len(),
                if record.len() == 1 && first {
                    "; the separator seems to be another: set input.separator in the model file (\"blank\" for runs of blanks)"
                } else {
                    "; correct input.header or input.skip in the model file, or the line, or leave such lines out with hygiene.text = \"drop\""
                }
            ),
        ));
    }
    values.clear();
    for (c, cell) in record.iter().enumerate() {
        values.push(match number(cell, decimal) {
            Some(x) => x,
            None if text[c].is_some() => f64::NAN,
            None if first => {
                text[c] = Some((cell.to_string(), line));
                f64::NAN
            }
            None => {
                return Line::Broken(Error::BadCell {
                    path: path.to_path_buf(),
                    line,
                    column: names[c].clone(),
                    text: cell.to_string(),
                })
            }
        });
    }
    Line::Row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blanks_become_tabs() {
        let mut out = String::new();
        Blanks {
            inner: "  1  2\t3 \n4,5 5 6".as_bytes(),
            value: false,
            blank: false,
        }
        .read_to_string(&mut out)
        .unwrap();
        assert_eq!(out, "1\t2\t3\n4,5\t5\t6");
    }
}
