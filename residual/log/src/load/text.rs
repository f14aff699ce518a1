//! Text logs: CSV and relatives, and JSON, plain or gzip.

use super::brackets::{self, Brackets};
use super::cells::{number, Affix, Marks};
use super::{json, rows, Note, Table};
use crate::spec::{Action, Input};
use residual_columns::dates;
use residual_columns::error::Error;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::Path;

/// Opens a file, through gzip if its first bytes say so (a name may be wrong, the magic number is
/// not).
pub(super) fn open(path: &Path) -> Result<Box<dyn BufRead>, Error> {
    let mut file =
        BufReader::with_capacity(1 << 16, files::open(path).map_err(|e| Error::io(path, e))?);
    let head = file.fill_buf().map_err(|e| Error::io(path, e))?;
    if let Some(what) = other_format(head) {
        return Err(Error::io(
            path,
            format!("this is {what}, which is not read; write the log as CSV or Parquet"),
        ));
    }
    // As spreadsheets write "Unicode text".
    if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)
            .map_err(|e| Error::io(path, e))?;
        let text = from_utf16(&bytes).ok_or_else(|| {
            Error::io(
                path,
                "it begins as text in UTF-16 and is none; write the log as CSV or Parquet",
            )
        })?;
        return Ok(Box::new(Cursor::new(text.into_bytes())));
    }
    let gzip = head.starts_with(&[0x1f, 0x8b]);
    let is_end = |end: u8| head.contains(&end);
    // As old systems of Apple end lines.
    let carriages = !gzip && is_end(b'\r') && !is_end(b'\n');
    let mut reader: Box<dyn BufRead> = if carriages {
        Box::new(BufReader::with_capacity(1 << 16, Carriages(file)))
    } else if gzip {
        Box::new(BufReader::with_capacity(
            1 << 16,
            flate2::bufread::MultiGzDecoder::new(file),
        ))
    } else {
        Box::new(file)
    };
    // What is wrong with a file that can't be read further is told where its rows are read.
    let head = reader.fill_buf().unwrap_or_default();
    if brackets::is_stamped(head) {
        return Ok(Box::new(BufReader::new(Brackets::new(reader))));
    }
    if !json::is_json(head) {
        return Ok(reader);
    }
    let mut bytes = Vec::new();
    reader
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    let text = json::as_csv(&bytes).map_err(|why| Error::io(path, why))?;
    Ok(Box::new(Cursor::new(text.into_bytes())))
}

/// Turns carriage returns into line feeds.
struct Carriages<R>(R);

impl<R: Read> Read for Carriages<R> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        let read = self.0.read(buf)?;
        for byte in buf[..read].iter_mut().filter(|b| **b == b'\r') {
            *byte = b'\n';
        }
        Ok(read)
    }
}

/// A text in UTF-16 behind its byte order mark; `None` where it is none.
fn from_utf16(bytes: &[u8]) -> Option<String> {
    let (mark, rest) = bytes.split_at_checked(2)?;
    let order = match mark {
        b"\xff\xfe" => u16::from_le_bytes,
        _ => u16::from_be_bytes,
    };
    if !rest.len().is_multiple_of(2) {
        return None;
    }
    let units: Vec<u16> = rest.chunks_exact(2).map(|c| order([c[0], c[1]])).collect();
    String::from_utf16(&units).ok()
}

/// What a file is by its first bytes, where it is no text.
fn other_format(head: &[u8]) -> Option<&'static str> {
    const MAGIC: &[(&[u8], &str)] = &[
        (b"PK\x03\x04", "a zip archive, as .npz and .xlsx are"),
        (b"\x93NUMPY", "a NumPy array"),
        (b"MATLAB 5.0", "a MATLAB file"),
        (b"\x89HDF", "an HDF5 file, as .h5 and new .mat are"),
        (b"MATLAB 7", "an HDF5 file, as .h5 and new .mat are"),
        (b"PAR1", "Parquet without the extension .parquet"),
        (b"ARROW1", "an Arrow or Feather file"),
        (b"\x28\xb5\x2f\xfd", "compressed by zstd"),
        (b"\xfd7zXZ", "compressed by xz"),
        (b"BZh", "compressed by bzip2"),
        (
            b"SQLite format 3",
            "an SQLite database, as bags of ROS 2 are",
        ),
        (b"#ROSBAG", "a bag of ROS"),
        (b"\x89MCAP", "an MCAP recording"),
        (b"ULog\x01\x12\x35", "a ULog of PX4"),
        (b"TDSm", "a TDMS file"),
        (b"MDF ", "an MDF file"),
    ];
    let known = MAGIC.iter().find(|(magic, _)| head.starts_with(magic));
    known.map(|(_, what)| *what)
}

/// Turns every run of blanks into one tab, so that one CSV reader serves both layouts, with commas
/// as decimal marks too.
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

/// Gives bytes that are no UTF-8 as the letters that they are in the old code of Windows, in which
/// each is one: a `µ` of a unit, a blank between thousands. 0xFF is in no text, and stays.
pub(super) struct OldText<R> {
    inner: R,
    /// What has been read, but for what was given out.
    text: Vec<u8>,
    /// Bytes of `text` that were given out.
    given: usize,
    /// The beginning of a letter, whose end was not read yet.
    begun: Vec<u8>,
}

/// Such bytes as text; what is in no text is one character for all.
pub(super) fn decoded(bytes: &[u8]) -> String {
    let mut text = Vec::with_capacity(bytes.len());
    // A slice has no errors of reading.
    let _ = OldText::new(bytes).read_to_end(&mut text);
    String::from_utf8_lossy(&text).into_owned()
}

impl<R: Read> OldText<R> {
    pub(super) fn new(inner: R) -> Self {
        Self {
            inner,
            text: Vec::new(),
            given: 0,
            begun: Vec::new(),
        }
    }

    fn decode(&mut self, is_last: bool) {
        (self.given, self.text) = (0, Vec::with_capacity(self.begun.len()));
        let bytes = std::mem::take(&mut self.begun);
        let mut at = 0;
        for chunk in bytes.utf8_chunks() {
            self.text.extend_from_slice(chunk.valid().as_bytes());
            let bad = chunk.invalid();
            at += chunk.valid().len() + bad.len();
            let is_begun = at == bytes.len()
                && std::str::from_utf8(bad).is_err_and(|why| why.error_len().is_none());
            if is_begun && !is_last {
                self.begun = bad.to_vec();
                continue;
            }
            for &b in bad {
                match b {
                    0xFF => self.text.push(b),
                    _ => {
                        let mut letter = [0; 2];
                        let letter = char::from(b).encode_utf8(&mut letter);
                        self.text.extend_from_slice(letter.as_bytes());
                    }
                }
            }
        }
    }
}

impl<R: Read> Read for OldText<R> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        while self.given == self.text.len() {
            let before = self.begun.len();
            self.begun.resize(before + CHUNK, 0);
            let n = self.inner.read(&mut self.begun[before..])?;
            self.begun.truncate(before + n);
            self.decode(n == 0);
            if n == 0 && self.text.is_empty() {
                return Ok(0);
            }
        }
        let n = buf.len().min(self.text.len() - self.given);
        buf[..n].copy_from_slice(&self.text[self.given..self.given + n]);
        self.given += n;
        Ok(n)
    }
}

/// Bytes that are decoded at once.
const CHUNK: usize = 1 << 16;

/// Ends every line with one line feed alone, the last one too, so that the CSV reader counts lines
/// as an editor does.
struct LineFeeds<R> {
    inner: R,
    /// Whether a carriage return is pending.
    carriage: bool,
    /// Whether the last byte that was given out is a line feed, or none was.
    at_start: bool,
}

impl<R: Read> Read for LineFeeds<R> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        // At most one pending byte is added.
        if buf.len() < 2 {
            return Ok(0);
        }
        let mut raw = vec![0u8; buf.len() - 1];
        let n = self.inner.read(&mut raw)?;
        let mut out = 0;
        let mut give = |b: u8| {
            buf[out] = b;
            out += 1;
        };
        if n == 0 {
            if !self.at_start {
                give(b'\n');
            }
            (self.carriage, self.at_start) = (false, true);
            return Ok(out);
        }
        for &b in &raw[..n] {
            if std::mem::take(&mut self.carriage) && b != b'\n' {
                give(b'\r');
            }
            if b == b'\r' {
                self.carriage = true;
            } else {
                give(b);
            }
            self.at_start = b == b'\n';
        }
        if out == 0 {
            // A carriage return alone: what follows decides.
            return self.read(buf);
        }
        Ok(out)
    }
}

pub(super) fn no_text(path: &Path, line: u64) -> Error {
    Error::io(
        path,
        format!(
            "line {line}: this is not text (UTF-8); convert the file, or leave it out of --data"
        ),
    )
}

/// Line of the file at which the record begins that the CSV reader read last. Empty lines and
/// comments stand before it, and it does not see the lines that are skipped.
fn line(csv: &csv::Reader<Box<dyn Read>>, record: &csv::StringRecord, input: &Input) -> u64 {
    let end = csv.position().line() + input.skip as u64;
    end.saturating_sub(lines_of(record)).max(1)
}

/// Lines of a record: a quoted cell may have several.
fn lines_of(record: &csv::StringRecord) -> u64 {
    let feeds = |cell: &str| cell.bytes().filter(|b| *b == b'\n').count() as u64;
    1 + record.iter().map(feeds).sum::<u64>()
}

/// An error of the CSV reader, with what to do about it.
fn broken(path: &Path, input: &Input, e: &csv::Error) -> Error {
    let line = e.position().map_or(1, csv::Position::line) + input.skip as u64;
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
    let reader = LineFeeds {
        inner: OldText::new(reader),
        carriage: false,
        at_start: true,
    };
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

/// What begins a comment line: what the model file says, else `%` where the first line begins with
/// it, else `#`.
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
    if let Some(name) = names.iter().find(|n| n.contains('\n')) {
        return Err(Error::io(
            path,
            format!(
                "line {}: a quotation mark is not closed on its line (`{}`); where it begins a comment, set input.comment = \"\\\"\" in the \
                 model file, or input.skip",
                input.skip as u64 + 1,
                name.lines().next().unwrap_or("")
            ),
        ));
    }
    if names
        .iter()
        .any(|n| n.contains(|c: char| c.is_control() && c != '\t'))
    {
        return Err(no_text(path, input.skip as u64 + 1));
    }
    if names.is_empty() || names.iter().all(String::is_empty) {
        let what = match input.skip {
            0 => "the file is empty".into(),
            skip => format!("nothing is left after the {skip} lines of input.skip; correct it in the model file"),
        };
        return Err(Error::io(path, what));
    }
    let numbers = names
        .iter()
        .filter(|n| n.parse::<f64>().is_ok_and(f64::is_finite));
    if input.header.is_empty() && numbers.count() == names.len() {
        return Err(Error::io(
            path,
            format!(
                "line {} has {} numbers and no names: the file has no header. Name the columns in the model file: input.header = [\"time\", ...]",
                input.skip as u64 + 1,
                names.len()
            ),
        ));
    }
    if let [only] = names.as_slice() {
        let other = [
            (';', ";"),
            ('\t', "\\t"),
            ('|', "|"),
            (',', ","),
            (' ', "blank"),
        ]
        .into_iter()
        .find(|(c, _)| only.contains(*c));
        if let Some((_, name)) = other {
            return Err(Error::io(
                path,
                format!(
                    "line {} is one column, `{only}`: the separator seems to be another; set input.separator = \"{name}\" in the model file, or input.skip if the header is further down",
                    input.skip as u64 + 1
                ),
            ));
        }
    }
    Ok(names)
}

/// What stands on one line.
enum Line {
    /// One value for each column.
    Row,
    /// A message, a line that was cut off, or a damaged one.
    Broken(Error),
}

/// Reads one text log. Cells that are empty or `nan` are NaN; a column whose first cell is text is
/// left out. A line with another number of cells than there are names, that is no text, or with
/// text in a column that is otherwise numeric, is an error, or is left out and counted with
/// `action` [`Action::Drop`]; so is one with a value beyond the largest of a column that is `used`.
/// Text in a column that is not is a missing cell; `None`: all are used, and no value is too large.
pub(super) fn read(
    path: &Path,
    input: &Input,
    action: Action,
    used: Option<&BTreeMap<String, f64>>,
) -> Result<Table, Error> {
    let mut csv = open_csv(path, input)?;
    let names = names(&mut csv, path, input)?;
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let mut seen = vec![Seen::default(); names.len()];
    let mut record = csv::StringRecord::new();
    let mut values: Vec<f64> = Vec::with_capacity(names.len());
    let of_all = used.is_none();
    let used: Vec<Option<f64>> = names
        .iter()
        .map(|n| used.map_or(Some(f64::INFINITY), |used| used.get(n).copied()))
        .collect();
    let mut broken_lines = 0;
    let mut breaks: Vec<usize> = Vec::new();
    let mut first_broken = None;
    let mut lines: Option<(u64, u64)> = None;
    loop {
        let first = columns.first().is_none_or(Vec::is_empty);
        let more = csv.read_record(&mut record);
        let at = line(&csv, &record, input);
        let found = match more {
            Ok(false) => break,
            Ok(true) => row(
                &record,
                at,
                &Columns {
                    names: &names,
                    used: &used,
                    of_all,
                    input,
                    path,
                },
                first,
                &mut seen,
                &mut values,
            ),
            Err(e) if matches!(e.kind(), csv::ErrorKind::Utf8 { .. }) => {
                Line::Broken(broken(path, input, &e))
            }
            Err(e) => return Err(broken(path, input, &e)),
        };
        match found {
            Line::Row => {
                lines = Some((lines.map_or(at, |(from, _)| from), at));
                for (column, value) in columns.iter_mut().zip(&values) {
                    column.push(*value);
                }
            }
            Line::Broken(why) if action != Action::Drop => return Err(why),
            Line::Broken(why) => {
                // A quotation mark that is not closed takes the lines behind it along.
                broken_lines += lines_of(&record) as usize;
                let rows = columns.first().map_or(0, Vec::len);
                if rows > 0 && breaks.last() != Some(&rows) {
                    breaks.push(rows);
                }
                first_broken.get_or_insert(why);
            }
        }
    }
    if let Some(why) = first_broken.filter(|_| columns.first().is_none_or(Vec::is_empty)) {
        return Err(why);
    }
    let rows = columns.first().map_or(0, Vec::len) as u64;
    // Comments, empty lines and cells of several lines need more lines than there are rows.
    let even = lines.filter(|(from, to)| to - from + 1 == rows);
    let mut table = Table {
        broken: broken_lines,
        breaks,
        first_line: even.map(|(from, _)| from),
        ..Table::default()
    };
    for ((name, column), seen) in names.into_iter().zip(columns).zip(seen) {
        match seen.text {
            Some((cell, line)) => table.text.push((name, cell, line)),
            None => {
                let note = |cell: String| {
                    Note::new(
                    "dates",
                    1,
                    format!(
                        "column `{name}`: in `{cell}` day and month may be exchanged. The day was taken as the first, with AM and PM the \
                         month. It matters for steps over midnight only; with the year first it is sure"
                    ),
                )
                };
                table.notes.extend(seen.unsure.map(note));
                let words = seen.time.map(|kind| (name.clone(), kind.words()));
                table.times.extend(words);
                let unit = seen.affix.map(|affix| (name.clone(), affix.behind));
                table.units.extend(unit);
                table.names.push(name);
                table.columns.push(column);
            }
        }
    }
    Ok(table)
}

/// A cell whose value cannot be computed with.
pub(super) fn large(path: &Path, line: u64, column: &str, why: &str) -> Error {
    Error::io(
        path,
        format!("line {line}: column `{column}`: {why}; correct the value or the scale of the column, or leave such lines out with hygiene.text = \"drop\""),
    )
}

/// What the cells of a line are.
struct Columns<'a> {
    names: &'a [String],
    /// The largest magnitude of a cell, in columns that the model uses.
    used: &'a [Option<f64>],
    /// Whether all columns are read, since no model says which are used.
    of_all: bool,
    input: &'a Input,
    path: &'a Path,
}

/// What the first row shows of a column that is no plain number.
#[derive(Default, Clone)]
struct Seen {
    /// A text with its line: the column is left out.
    text: Option<(String, u64)>,
    /// Dates or times of day.
    time: Option<dates::Kind>,
    /// Whether a time with AM or PM stands in another cell of the row.
    half: bool,
    /// The first date whose day and month may be exchanged.
    unsure: Option<String>,
    /// A label or a unit around the number.
    affix: Option<Affix>,
}

impl Seen {
    /// The value of a cell that is no plain number.
    fn value(&mut self, cell: &str, first: bool, marks: Marks) -> Option<f64> {
        if self.text.is_some() {
            return None;
        }
        if first || self.time.is_some() {
            if let Some(stamp) = dates::stamp_in(cell, self.half) {
                self.time = Some(stamp.kind);
                if stamp.unsure {
                    self.unsure.get_or_insert_with(|| cell.to_string());
                }
                return Some(stamp.value());
            }
        }
        if first {
            self.affix = Affix::of(cell, marks);
        }
        self.affix.as_ref()?.number(cell, marks)
    }
}

/// Reads the cells of one line into `values`. The `first` row says which columns are `text`.
fn row(
    record: &csv::StringRecord,
    line: u64,
    columns: &Columns,
    first: bool,
    seen: &mut [Seen],
    values: &mut Vec<f64>,
) -> Line {
    let Columns {
        names,
        used,
        of_all,
        input,
        path,
    } = columns;
    let marks = Marks::of(input);
    if record.len() != names.len() {
        return Line::Broken(Error::io(
            path,
            format!(
                "line {line}: {} cells where {} columns are named{}",
                record.len(),
                names.len(),
                if input.decimal == input.separator {
                    "; input.decimal and input.separator are the same, so each number needs quotation marks: set input.separator = \";\" if that separates"
                } else if record.len() == 1 && first {
                    "; the separator seems to be another: set input.separator in the model file (\"blank\" for runs of blanks)"
                } else {
                    "; correct input.header or input.skip in the model file, or the line, or leave such lines out with hygiene.text = \"drop\""
                }
            ),
        ));
    }
    values.clear();
    if first && record.iter().any(dates::has_half) {
        seen.iter_mut().for_each(|seen| seen.half = true);
    }
    for (c, cell) in record.iter().enumerate() {
        let seen = &mut seen[c];
        values.push(
            match number(cell, marks).or_else(|| seen.value(cell, first, marks)) {
                Some(x) => match used[c].and_then(|largest| rows::too_large(x, largest)) {
                    None => x,
                    Some(why) => return Line::Broken(large(path, line, &names[c], &why)),
                },
                None if seen.text.is_some() => f64::NAN,
                None if first => {
                    seen.text = Some((cell.to_string(), line));
                    f64::NAN
                }
                // It may be prose that begins with a number.
                None if *of_all && seen.affix.is_some() => f64::NAN,
                None if used[c].is_none() => f64::NAN,
                None => {
                    return Line::Broken(Error::BadCell {
                        path: path.to_path_buf(),
                        line,
                        column: names[c].clone(),
                        text: cell.to_string(),
                    })
                }
            },
        );
    }
    Line::Row
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives at most so many bytes at a time.
    struct Slowly<'a>(&'a [u8], usize);

    impl Read for Slowly<'_> {
        fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
            let n = self.1.min(buf.len()).min(self.0.len());
            let (now, later) = self.0.split_at(n);
            buf[..n].copy_from_slice(now);
            self.0 = later;
            Ok(n)
        }
    }

    #[test]
    fn letters_of_an_old_code_become_utf_8_and_those_of_utf_8_stay() {
        let old = b"Kraft (\xb5N);\xe9\n13\xa0747,9;2\xb0\xff\n";
        for step in 1..6 {
            let decoded = |bytes: &[u8]| {
                let mut out = Vec::new();
                OldText::new(Slowly(bytes, step))
                    .read_to_end(&mut out)
                    .unwrap();
                out
            };
            let expected = "Kraft (\u{b5}N);\u{e9}\n13\u{a0}747,9;2\u{b0}".as_bytes();
            assert_eq!(decoded(old), [expected, b"\xff\n"].concat());
            // Letters of two, three and four bytes, whole and cut off at the end.
            let new = "\u{b5}\u{20ac}\u{1f600}\u{a0}x".as_bytes();
            assert_eq!(decoded(new), new);
            assert_eq!(decoded(&new[..2 + 3 + 2])[..5], new[..5]);
        }
    }

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
