//! How a text log is laid out: separator, decimal mark, comments, header.

use super::super::cells::{self, Affix, Marks};
use super::super::text;
use super::code;
use super::header;
use super::names::Name;
use crate::spec::Input;
use residual_columns::dates;
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
    /// The code of its names, where it is taken for one that is not UTF-8 nor that of Windows.
    pub(super) code: Option<&'static str>,
    /// Whether the log is text; else its columns have names and no layout.
    pub(super) is_text: bool,
    /// Cells of the second line of a header; none where it has one line.
    second: Vec<String>,
    /// Rows per second, where the file says so above its rows.
    pub(super) rate: Option<f64>,
    /// Place and words of a column in which words take turns, as the name of a variable does where
    /// each row has one.
    pub(super) turns: Option<(usize, Vec<String>)>,
}

impl Layout {
    /// The layout of a log that has columns of its own.
    pub(super) fn of_columns() -> Layout {
        Layout {
            input: Input::default(),
            origin: Origin::Header,
            code: None,
            is_text: false,
            second: vec![],
            rate: None,
            turns: None,
        }
    }

    pub(super) fn of(path: &Path) -> Result<Layout, Error> {
        let Head {
            text: head,
            is_utf8,
            code,
        } = Head::of(path)?;
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
        let shown = lines.iter().flat_map(|l| marks_in(l.1)).next();
        let (separator, cells) = separator(&lines, shown).ok_or_else(|| {
            failed("no separator splits this line and those below it into equal numbers of cells, two or more")
        })?;
        let row = lines[middle..]
            .iter()
            .find(|l| split(l.1, separator).len() == cells)
            .map_or("", |l| l.1);
        let row_cells = split(row, separator);
        let row_lines = &lines[middle..];
        let marks = shown.unwrap_or_else(|| decimal_of(&row_cells, row_lines, separator));
        let row = Row {
            is_number: row_cells.iter().map(|c| is_number(c, marks)).collect(),
            is_date: row_cells
                .iter()
                .map(|c| dates::stamp(c).is_some())
                .collect(),
            ends_empty: row_cells.last() == Some(&""),
            separator,
            marks,
        };
        let from = header_of_labview(&lines)
            .max(below_label_of_data(&lines))
            .max(below_stated_header(&lines));
        let fits = lines[from..]
            .iter()
            .position(|l| row.fits(l.1))
            .map(|at| from + at)
            .ok_or_else(|| failed("no cell is a number"))?;
        let worded = lines[from..fits].iter().rev();
        let data = fits - worded.take_while(|l| row.fits_but_for_words(l.1)).count();
        let mut layout = Layout {
            input: Input {
                separator: separator.into(),
                decimal: marks.decimal.into(),
                thousands: marks.thousands.map_or(String::new(), String::from),
                comment: comments
                    .first()
                    .map_or(String::new(), |c| c[..1].to_string()),
                ..Input::default()
            },
            origin: Origin::Nothing,
            code,
            is_text: true,
            second: vec![],
            rate: rate(&lines[..data], separator),
            turns: turns(&lines[data..], &row),
        };
        let above: Vec<Vec<&str>> = lines[..data].iter().map(|l| row.head(l.1)).collect();
        let marked = lines[..data].iter().map(|l| l.1);
        let marked = marked.filter(|l| MARKED.iter().any(|mark| l.starts_with(mark)));
        let comments = names_in_comments(marked.chain(comments).collect(), separator, cells);
        let longer = row.longer_header(&lines[..data]);
        let stated = below_kinds(&lines[..data], separator, cells)
            .or_else(|| after_word_for_names(&lines[..data], separator, cells));
        let names = if let Some((at, names)) = stated {
            layout.origin = Origin::Line(lines[at].0 + 1);
            names
        } else if let Some(names) = longer {
            layout.origin = Origin::Line(lines[data - 1].0 + 1);
            names
        } else if let Some(stated) = increment(&lines[..data], separator) {
            let line = &lines[stated.line];
            layout.origin = Origin::Line(line.0 + 1);
            layout.rate = Some(stated.rate);
            layout.second = row.first_cells(lines[stated.line + 1].1);
            let mut names = split(line.1, separator);
            names.resize(cells, "");
            names
        } else if let Some((at, names)) = in_pairs(&above) {
            layout.origin = Origin::Line(lines[at].0 + 1);
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
        } else if let Some(names) = row.shorter_header(&lines, data) {
            layout.origin = Origin::Line(lines[data - 1].0 + 1);
            names
        } else {
            let names = labels(&row_cells, marks);
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
    /// Which of its cells are dates or times of day.
    is_date: Vec<bool>,
    /// Whether its last cell is empty: a separator stands at its end.
    ends_empty: bool,
    separator: &'a str,
    marks: Marks,
}

impl Row<'_> {
    /// Whether a line is a row: no text where the others have a number or a date, and one number at
    /// least.
    fn fits(&self, line: &str) -> bool {
        let cells = split(line, self.separator);
        let mut columns = self.is_number.iter().zip(&cells).filter(|(n, _)| **n);
        cells.len() == self.is_number.len()
            && self.has_dates(&cells)
            && columns.clone().all(|(_, c)| value(c, self.marks).is_some())
            && columns.any(|(_, c)| is_number(c, self.marks))
    }

    fn has_dates(&self, cells: &[&str]) -> bool {
        let mut dates = self.is_date.iter().zip(cells).filter(|(d, _)| **d);
        dates.all(|(_, c)| c.is_empty() || dates::stamp(c).is_some())
    }

    /// Whether a line above the rows that fit is a row too, with words in a few cells, as of a
    /// sensor that is not ready: a number in the first column of numbers, and in half of them.
    fn fits_but_for_words(&self, line: &str) -> bool {
        let cells = split(line, self.separator);
        let columns = self.is_number.iter().zip(&cells).filter(|(n, _)| **n);
        let numbers: Vec<bool> = columns.map(|(_, c)| is_number(c, self.marks)).collect();
        cells.len() == self.is_number.len()
            && self.has_dates(&cells)
            && numbers.first() == Some(&true)
            && 2 * numbers.iter().filter(|n| **n).count() >= numbers.len()
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
        let is_text = |c: &&str| !c.is_empty() && !is_number(c, self.marks);
        let longer = cells.len() > count && cells.len() <= count + 2 && self.separator != "blank";
        let named = longer && cells.iter().all(is_text) && usable_as_they_are(&cells);
        named.then(|| cells[..count].to_vec())
    }

    /// The names above the rows where they begin with the name or the number of each row, which has
    /// no name, as those that R and pandas print.
    fn shorter_header<'a>(&self, lines: &[Line<'a>], data: usize) -> Option<Vec<&'a str>> {
        let names = split(lines[..data].last()?.1, self.separator);
        let is_text = |c: &&str| !c.is_empty() && !is_number(c, self.marks);
        let named = names.len() + 1 == self.is_number.len() && names.iter().all(is_text);
        let firsts: Vec<&str> = lines[data..]
            .iter()
            .take(3)
            .map(|l| split(l.1, self.separator)[0])
            .collect();
        let quoted = firsts.iter().all(|c| c.starts_with('"'));
        let numbers: Vec<i64> = firsts.iter().filter_map(|c| c.parse().ok()).collect();
        let counts = numbers.len() == 3 && numbers.windows(2).all(|w| w[1] == w[0] + 1);
        let usable = named && usable_as_they_are(&names) && (quoted || counts);
        usable.then(|| std::iter::once("row").chain(names).collect())
    }

    /// The cells of a line, as many as there are columns.
    fn first_cells(&self, line: &str) -> Vec<String> {
        let cells = split(line, self.separator).into_iter();
        let count = self.is_number.len();
        cells.take(count).map(str::to_string).collect()
    }

    /// Whether a line may name the columns: it has no number and no date where a row has a number.
    fn may_name(&self, cells: &[&str]) -> bool {
        let mut columns = self.is_number.iter().zip(cells);
        let is_value = |c: &str| is_number(c, self.marks) || dates::stamp(c).is_some();
        cells.len() == self.is_number.len() && !columns.any(|(n, c)| *n && is_value(c))
    }

    /// Place of a line further up than the last two with names that are understood, two or more,
    /// and more than in the last two: below it stand kinds, units and numbers of channels.
    fn known_names(&self, above: &[Vec<&str>]) -> Option<usize> {
        let known = |cells: &Vec<&str>| {
            let whole = cells.len() == self.is_number.len() && self.may_name(cells);
            let roles = cells.iter().filter(|c| Name::of(c).role().is_some());
            if whole {
                roles.count()
            } else {
                0
            }
        };
        let last = above.len().saturating_sub(2);
        let in_last = above[last..].iter().map(known).max().unwrap_or(0);
        let best = (0..last).max_by_key(|at| known(&above[*at]))?;
        (known(&above[best]) > in_last.max(1)).then_some(best)
    }

    /// Place and cells of the last line that names the columns, and the cells of the second line of
    /// the header below it.
    fn header<'a>(&self, above: &[Vec<&'a str>]) -> Option<(usize, Vec<&'a str>, Vec<String>)> {
        if let Some(at) = self.known_names(above) {
            let below = above
                .get(at + 1)
                .filter(|b| header::are_units(&above[at], b));
            let second = below.map_or_else(Vec::new, |b| b.iter().map(|c| c.to_string()).collect());
            return Some((at, above[at].clone(), second));
        }
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

/// What begins a line of comment in the files of other programs, beside `%` and `#`.
const MARKED: [&str; 4] = ["//", "!", "--", "*"];

/// The cells of comments that may name the columns: as many as there are columns, and one of them
/// says what it is, or it is the last comment. A sentence may have as many words.
fn names_in_comments<'a>(
    comments: Vec<&'a str>,
    separator: &str,
    columns: usize,
) -> Vec<Vec<&'a str>> {
    let last = comments.len().saturating_sub(1);
    let known = |n: &&str| Name::of(n).role().is_some() || n.starts_with(['[', '(']);
    let text = |c: &&'a str| c.trim_start_matches(['%', '#', ' ', '/', '!', '*', '-']);
    let own = |i: usize, text| {
        let names = split(text, separator);
        let fits = names.len() == columns && (i == last || names.iter().any(known));
        fits.then_some(names)
    };
    let other = |text| {
        let names = names_in(text, separator, columns)?;
        (names.iter().filter(|n| known(n)).count() > 1).then_some(names)
    };
    let all = comments.iter().map(text).enumerate();
    all.filter_map(|(i, text)| other(text).or_else(|| own(i, text)))
        .collect()
}

/// So many names in a comment, where they stand behind a word with a colon, as in `columns: t, x`,
/// or have another mark between them than the rows have.
fn names_in<'a>(text: &'a str, separator: &str, count: usize) -> Option<Vec<&'a str>> {
    let label = text.split_once(':').filter(|(label, names)| {
        let label = label.trim();
        let is_word = !label.is_empty() && label.chars().all(char::is_alphabetic);
        is_word && Name::of(label).role().is_none() && !names.contains(':')
    });
    let text = label.map_or(text, |(_, names)| names).trim();
    let marks = [",", ";", "\t", separator];
    let mut all = marks.into_iter().map(|s| split(text, s));
    let bare = |name: &'a str| name.trim_end_matches([',', ';']);
    let names = all.find(|names| names.len() == count)?;
    Some(names.into_iter().map(bare).collect())
}

/// The marks of a number with marks between its thousands, in any cell of a line.
fn marks_in(line: &str) -> Option<Marks> {
    let has = |mark: char| line.contains(mark);
    if !(has('.') || has(',')) {
        return None;
    }
    let cells = |separator| split(line, separator).into_iter();
    let mut all = [";", "\t", "|", ","].into_iter().flat_map(cells);
    all.find_map(|cell| Marks::seen_in(cell.trim_matches('"')))
}

/// The decimal mark of numbers without marks between thousands. A comma behind a unit is none, and
/// between quotation marks in a file of commas it is one where a number shows that it does not
/// stand between thousands.
fn decimal_of(row: &[&str], lines: &[Line], separator: &str) -> Marks {
    let plain = |decimal| Marks {
        decimal,
        thousands: None,
    };
    let (comma, point) = (plain(','), plain('.'));
    let with_comma = |c: &&str| is_number(c, comma) && !is_number(c, point);
    if !row.iter().any(with_comma) {
        return point;
    }
    if separator != "," {
        return comma;
    }
    let thousands = Marks {
        thousands: Some(','),
        ..point
    };
    let mut cells = lines.iter().flat_map(|l| split(l.1, separator));
    let is_decimal =
        |c: &str| c.starts_with("\"0,") || c.starts_with("\"-0,") || !is_number(c, thousands);
    if cells.any(|c| with_comma(&c) && is_decimal(c)) {
        comma
    } else {
        thousands
    }
}

/// A step that stands beside the names, as oscilloscopes write it.
struct Stated {
    /// Place of the line of the names.
    line: usize,
    /// Rows per second.
    rate: f64,
}

/// The step below a name `Increment`.
fn increment(above: &[Line], separator: &str) -> Option<Stated> {
    above.windows(2).enumerate().find_map(|(line, pair)| {
        let names = split(pair[0].1, separator);
        let at = names
            .iter()
            .position(|n| n.eq_ignore_ascii_case("increment"))?;
        let step: f64 = split(pair[1].1, separator).get(at)?.parse().ok()?;
        let rate = Some(1.0 / step).filter(|rate| rate.is_finite() && *rate > 0.0);
        Some(Stated { line, rate: rate? })
    })
}

/// Place and names of a line that names every second column, as one of channels that have a time
/// each: `Name;force;Name;speed`.
fn in_pairs<'a>(above: &[Vec<&'a str>]) -> Option<(usize, Vec<&'a str>)> {
    let at = above.iter().rposition(|cells| {
        let labels = cells.iter().step_by(2);
        cells.len() >= 4
            && cells.len().is_multiple_of(2)
            && labels.clone().all(|c| c.eq_ignore_ascii_case("name"))
    })?;
    let names = above[at].iter().enumerate();
    let names = names.map(|(i, name)| if i % 2 == 0 { "time" } else { name });
    Some((at, names.collect()))
}

/// Most words that take turns in a column.
const TURNS: usize = 20;

/// A column of text in which a few words take turns from row to row.
fn turns(rows: &[Line], row: &Row) -> Option<(usize, Vec<String>)> {
    let rows: Vec<Vec<&str>> = rows
        .iter()
        .map(|l| split(l.1, row.separator))
        .filter(|cells| cells.len() == row.is_number.len())
        .take(10 * TURNS)
        .collect();
    (0..row.is_number.len())
        .filter(|c| !row.is_number[*c])
        .find_map(|c| {
            let changes = rows.windows(2).filter(|w| w[0][c] != w[1][c]).count();
            let mut words: Vec<&str> = Vec::new();
            for cells in &rows {
                if !words.contains(&cells[c]) {
                    words.push(cells[c]);
                }
            }
            let few = (2..=TURNS).contains(&words.len()) && 5 * words.len() <= rows.len();
            (few && 2 * changes > rows.len()).then(|| {
                let bare = words.iter().map(|w| w.trim_matches('"').to_string());
                (c, bare.collect())
            })
        })
}

/// Place of the names of a LabVIEW measurement file, above which lines of numbers are no rows, as
/// its numbers of samples; 0 for every other file.
fn header_of_labview(lines: &[Line]) -> usize {
    let is_labview = lines.iter().any(|l| l.1.starts_with("***End_of_Header***"));
    let names = lines.iter().position(|l| l.1.starts_with("X_Value"));
    names.filter(|_| is_labview).unwrap_or(0)
}

/// Place of the line below one that has nothing but a label of the rows, as `data:` and `[DATA]`: a
/// line of numbers above it is no row. 0 for a file without one.
fn below_label_of_data(lines: &[Line]) -> usize {
    let is_label = |line: &str| {
        let line = line.trim().to_lowercase();
        ["data:", "[data]"].contains(&line.as_str())
    };
    let at = lines.iter().position(|l| is_label(l.1));
    at.filter(|at| at + 1 < lines.len()).map_or(0, |at| at + 1)
}

/// Words before the number of the lines above the rows.
const SIZES: [&str; 3] = ["header size", "header lines", "header length"];

/// Place of the line below as many as the first one says are a header: `"Header Size",16`.
fn below_stated_header(lines: &[Line]) -> usize {
    let stated = lines.first().and_then(|(_, line)| {
        let (label, rest) = line.split_once([':', '=', '\t', ',', ';'])?;
        let label = label.trim().trim_matches('"').to_lowercase();
        let count: usize = rest.trim_matches(['"', ' ', ',', ';', '\t']).parse().ok()?;
        SIZES.contains(&label.as_str()).then_some(count)
    });
    let at = stated.and_then(|count| lines.iter().position(|l| l.0 >= count));
    at.unwrap_or(0)
}

/// First cells of lines that name the columns, without marks.
const NAMES: [&str; 8] = [
    "tracename",
    "tracevalues",
    "channelname",
    "channelnames",
    "channeltitle",
    "signalname",
    "signalnames",
    "variablename",
];

/// Place and names of a line that begins with a word for names, with a name for each of the
/// `columns`, or for each but the first.
fn after_word_for_names<'a>(
    above: &[Line<'a>],
    separator: &str,
    columns: usize,
) -> Option<(usize, Vec<&'a str>)> {
    above.iter().enumerate().find_map(|(at, (_, line))| {
        let cells = split(line, separator);
        let word: String = cells[0].chars().filter(|c| c.is_alphabetic()).collect();
        let names = match cells.len() {
            n if n == columns + 1 => cells[1..].to_vec(),
            n if n == columns => std::iter::once("")
                .chain(cells[1..].iter().copied())
                .collect(),
            _ => return None,
        };
        (columns > 1 && NAMES.contains(&word.to_lowercase().as_str())).then_some((at, names))
    })
}

/// Kinds of numbers in a line of kinds.
const KINDS: [&str; 7] = [
    "double", "single", "float", "float64", "float32", "int", "int32",
];

/// Place and names of the line that names the columns of numbers below a line of kinds that names
/// the time alone: `type,time,double,double` above `trace_values,speed,force`.
fn below_kinds<'a>(
    above: &[Line<'a>],
    separator: &str,
    columns: usize,
) -> Option<(usize, Vec<&'a str>)> {
    let lines: Vec<Vec<&str>> = above.iter().map(|l| split(l.1, separator)).collect();
    let is_kind = |c: &str| KINDS.contains(&c.to_lowercase().as_str());
    let is_time = |c: &str| Name::of(c).role() == Some("time");
    let kinds = lines.iter().position(|cells| {
        let rest = || cells.iter().skip(1);
        cells.len() == columns
            && rest().filter(|c| is_time(c)).count() == 1
            && rest().all(|c| is_time(c) || is_kind(c))
    })?;
    let all = || lines[kinds].iter().enumerate().skip(1);
    let numbers = all().filter(|(_, c)| !is_time(c)).count();
    let at = (kinds + 1..lines.len()).find(|at| lines[*at].len() == numbers + 1)?;
    let mut own = lines[at].iter().skip(1);
    let of = |(_, kind): (usize, &&'a str)| {
        if is_time(kind) {
            Some(*kind)
        } else {
            own.next().copied()
        }
    };
    let names: Option<Vec<&str>> = std::iter::once(Some("")).chain(all().map(of)).collect();
    names.filter(|_| numbers > 0).map(|names| (at, names))
}

/// Rows per second, where the lines above them say so.
fn rate(above: &[Line], separator: &str) -> Option<f64> {
    rate_of_labview(above, separator)
        .or_else(|| stated_rate(above))
        .or_else(|| frame_rate(above, separator))
}

/// Rows per second by the step that a LabVIEW measurement file states above its rows.
fn rate_of_labview(above: &[Line], separator: &str) -> Option<f64> {
    let cells = above.iter().map(|l| split(l.1, separator));
    let mut steps = cells.filter(|c| c.first() == Some(&"Delta_X"));
    let step: f64 = steps.next()?.get(1)?.parse().ok()?;
    (step > 0.0 && step.is_finite()).then_some(1.0 / step)
}

/// Words before the step of the rows, and before their rate, in the lines above them.
const STEPS: [&str; 7] = [
    "dt",
    "delta t",
    "hresolution",
    "sample interval",
    "sampling interval",
    "sample period",
    "sampling period",
];
const RATES: [&str; 9] = [
    "frequency",
    "abtastrate",
    "data rate",
    "sample rate",
    "sampling rate",
    "sample frequency",
    "sampling frequency",
    "samplerate",
    "fs",
];

/// Rows per second by a line that begins with words for the step or the rate: `dt = 0,01`,
/// `Sample Rate: 100 Hz`. The number may stand in the line below.
fn stated_rate(above: &[Line]) -> Option<f64> {
    above.iter().enumerate().find_map(|(i, (_, line))| {
        let (label, rest) = line
            .split_once([':', '=', '\t', ',', ';'])
            .unwrap_or((line, ""));
        let label = label.trim().trim_matches('"');
        // A unit may stand in brackets behind the words.
        let (words, of_label) = label
            .strip_suffix([']', ')'])
            .and_then(|l| l.split_once(['[', '(']))
            .unwrap_or((label, ""));
        let words = words.trim().to_lowercase();
        let is_step = STEPS.contains(&words.as_str());
        if !is_step && !RATES.contains(&words.as_str()) {
            return None;
        }
        let below = above.get(i + 1).map_or("", |l| l.1);
        let (x, unit) = leading(if rest.trim().is_empty() { below } else { rest })?;
        let rate = match (is_step, if unit.is_empty() { of_label } else { unit }) {
            (true, "") => 1.0 / x,
            (true, unit) => 1.0 / (x * residual_columns::units::seconds(unit)?),
            (false, "kHz" | "kS/s") => 1e3 * x,
            (false, "" | "Hz" | "1/s" | "/s" | "S/s" | "Sa/s" | "SPS") => x,
            (false, "1/min" | "/min") => x / 60.0,
            _ => return None,
        };
        Some(rate).filter(|rate| rate.is_finite() && *rate > 0.0)
    })
}

/// The number at the head of a text, with a decimal point or comma, and the word behind it, which
/// may stand in the next cell.
fn leading(text: &str) -> Option<(f64, &str)> {
    let text = text.trim_start_matches(|c: char| "\",;".contains(c) || c.is_whitespace());
    let in_number = |c: char| c.is_ascii_digit() || "+-.,eE".contains(c);
    let end = text.find(|c| !in_number(c)).unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    let number = match number.split_once(',') {
        Some((before, _)) if before.contains('.') => before.to_string(),
        _ => number.trim_end_matches(',').replacen(',', ".", 1),
    };
    let unit = rest.trim_matches(|c: char| "\",;".contains(c) || c.is_whitespace());
    let unit = unit.split([' ', '\t', ',', ';', '"']).next().unwrap_or("");
    let is_number = |c: char| c.is_ascii_digit() || "+-.".contains(c);
    let is_unit = !unit.starts_with(is_number) || unit.starts_with("1/");
    Some((number.parse().ok()?, if is_unit { unit } else { "" }))
}

/// Frames per second, as a number alone in a line above names that begin with `Frame`.
fn frame_rate(above: &[Line], separator: &str) -> Option<f64> {
    let cells = || above.iter().map(|l| split(l.1, separator));
    let has_frames = cells().any(|c| c.first() == Some(&"Frame"));
    let alone = |c: Vec<&str>| {
        let mut filled = c.into_iter().filter(|c| !c.is_empty());
        let number = filled.next()?.parse::<f64>().ok()?;
        (filled.next().is_none() && number.is_finite() && number > 0.0).then_some(number)
    };
    cells().find_map(alone).filter(|_| has_frames)
}

/// Whether names can be used as the file has them: none is empty, none stands there twice.
fn usable_as_they_are(names: &[&str]) -> bool {
    let bare: Vec<&str> = names.iter().map(|n| n.trim_matches('"').trim()).collect();
    header::usable(names) == bare
}

/// The texts before the numbers of a row that end like a label, as `speed:` and `speed =` do, in
/// cells of their own or in that of the number.
fn labels<'a>(row: &[&'a str], marks: Marks) -> Vec<&'a str> {
    let mut before = "";
    let named = row.iter().map(|cell| {
        let label = std::mem::replace(&mut before, cell);
        if let Some(affix) = Affix::of(cell, marks) {
            return &cell[..affix.label().len()];
        }
        let label = label.strip_suffix([':', '=']).unwrap_or("").trim();
        if label.starts_with(char::is_alphabetic) {
            label
        } else {
            ""
        }
    });
    named.collect()
}

/// The first whole lines of a log.
struct Head {
    text: String,
    is_utf8: bool,
    /// The code of Japan or China that others are taken for; else that of an old Windows, in which
    /// a letter is a byte.
    code: Option<&'static str>,
}

impl Head {
    fn of(path: &Path) -> Result<Head, Error> {
        let mut bytes = Vec::new();
        text::open(path)?
            .take(LOOK)
            .read_to_end(&mut bytes)
            .map_err(|e| Error::io(path, e))?;
        // The last line may be cut off.
        if bytes.len() as u64 == LOOK {
            bytes.truncate(bytes.iter().rposition(|b| *b == b'\n').unwrap_or(0));
        }
        let is_utf8 = std::str::from_utf8(&bytes).is_ok();
        let other = (!is_utf8).then(|| code::decoded(&bytes)).flatten();
        let (head, code) = match other {
            Some((text, code)) => (text, Some(code)),
            None => (text::decoded(&bytes), None),
        };
        Ok(Head {
            text: head.trim_start_matches('\u{feff}').to_string(),
            is_utf8,
            code,
        })
    }
}

/// The separator that makes the most numbers of a line in the middle, and the number of cells.
/// `shown` are marks that a number shows.
fn separator(lines: &[Line], shown: Option<Marks>) -> Option<(&'static str, usize)> {
    let (_, middle) = lines.get(lines.len() / 2)?;
    let numbers = |s: &str| {
        let count = |marks| {
            let cells = split(middle, s);
            cells.iter().filter(|c| is_number(c, marks)).count()
        };
        let plain = |decimal| Marks {
            decimal,
            thousands: None,
        };
        // A comma cannot be both, but between quotation marks.
        let comma = s != "," || middle.contains('"');
        let of_comma = if comma { count(plain(',')) } else { 0 };
        count(shown.unwrap_or(plain('.'))).max(of_comma)
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
fn value(cell: &str, marks: Marks) -> Option<f64> {
    let cell = cell.trim_matches('"');
    let around = || Affix::of(cell, marks)?.number(cell, marks);
    cells::number(cell, marks).or_else(around)
}

fn is_number(cell: &str, marks: Marks) -> bool {
    value(cell, marks).is_some_and(f64::is_finite)
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
