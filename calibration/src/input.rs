//! Reading tables of text: CSV, or cells pasted from a spreadsheet, with the line of everything
//! that is wrong.
//!
//! A table has a header line. Cells are parted by comma, semicolon or tab, whichever the header
//! has. Empty lines and lines that start with `#` are skipped. A cell may stand in quotes, but not
//! hold a line break, so that a line number is always that of the text.

use std::fmt;
use std::sync::Arc;

/// A place in an input text.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Location {
    /// Name of the file as the caller gave it.
    pub file: Arc<str>,
    /// Line, counted from 1.
    pub line: usize,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file, self.line)
    }
}

/// What is wrong with a table of text.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InputError {
    /// There is no header line.
    #[error("{file}: the file is empty; it needs a header line and at least one row")]
    Empty {
        /// Name of the file.
        file: Arc<str>,
    },
    /// There is a header, and no row.
    #[error("{file}: there is no row below the header")]
    NoRows {
        /// Name of the file.
        file: Arc<str>,
    },
    /// A column that is needed is missing.
    #[error("{at}: there is no column `{column}`; the header has {found}")]
    MissingColumn {
        /// The header line.
        at: Location,
        /// The column.
        column: String,
        /// The columns that are there.
        found: String,
    },
    /// Neither standard errors nor enough repeats to tell them.
    #[error("{at}: there is no column `standard_error`, and {why}; enter the standard error of each code, or weigh again")]
    NoScatter {
        /// The header line.
        at: Location,
        /// What the repeats are.
        why: String,
    },
    /// A column that nothing reads, or one that is there twice.
    #[error("{at}: column `{column}` is {problem}; known columns are {known}")]
    BadColumn {
        /// The header line.
        at: Location,
        /// The column.
        column: String,
        /// "not known" or "given twice".
        problem: &'static str,
        /// The columns that may be there.
        known: String,
    },
    /// A row with more or fewer cells than the header.
    #[error("{at}: the row has {got} cells and the header has {want}; a decimal comma splits a number into two cells: write a point")]
    CellCount {
        /// The row.
        at: Location,
        /// Cells in the row.
        got: usize,
        /// Cells in the header.
        want: usize,
    },
    /// A cell that has to hold a finite number and doesn't.
    #[error("{at}: `{text}` in column `{column}` is not a finite number{}", decimal_comma(.text))]
    NotANumber {
        /// The row.
        at: Location,
        /// The column.
        column: String,
        /// The cell.
        text: String,
    },
    /// A cell whose content is not allowed there.
    #[error("{at}: `{text}` in column `{column}`: {problem}")]
    BadValue {
        /// The row.
        at: Location,
        /// The column.
        column: String,
        /// The cell.
        text: String,
        /// What is wrong, and what is allowed.
        problem: String,
    },
    /// A row that can't be split into cells.
    #[error("{at}: the row can't be read: {problem}")]
    BadRow {
        /// The row.
        at: Location,
        /// What is wrong.
        problem: String,
    },
}

/// What to do about a number with a decimal comma; empty for any other text.
fn decimal_comma(text: &str) -> &'static str {
    let is_number = |text: String| text.parse::<f64>().is_ok_and(f64::is_finite);
    if text.contains(',') && is_number(text.replacen(',', ".", 1)) {
        "; write a point for the decimal comma"
    } else {
        ""
    }
}

/// A table of text cells with the line of each row.
#[derive(Debug, Clone)]
pub struct Table {
    header_at: Location,
    header: Vec<String>,
    rows: Vec<Row>,
}

/// One row of a [`Table`].
#[derive(Debug, Clone)]
pub struct Row {
    /// Where the row stands.
    pub at: Location,
    cells: Vec<String>,
}

impl Table {
    /// Splits `text` into a header and rows. `file` is the name that errors give.
    ///
    /// # Errors
    /// [`InputError`] for an empty text, no rows, a row that has another number of cells than the
    /// header or that can't be split.
    pub fn parse(file: &str, text: &str) -> Result<Self, InputError> {
        let file: Arc<str> = file.into();
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text
            .lines()
            .enumerate()
            .map(|(i, line)| (i + 1, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let Some((line, first)) = lines.next() else {
            return Err(InputError::Empty { file });
        };
        let delimiter = [b'\t', b';', b',']
            .into_iter()
            .find(|d| first.as_bytes().contains(d))
            .unwrap_or(b',');
        let header_at = Location {
            file: file.clone(),
            line,
        };
        let header: Vec<String> = split(&header_at, first, delimiter)?
            .into_iter()
            .map(|name| name.to_lowercase())
            .collect();
        let mut rows = Vec::new();
        for (line, content) in lines {
            let at = Location {
                file: file.clone(),
                line,
            };
            let cells = split(&at, content, delimiter)?;
            if cells.len() != header.len() {
                return Err(InputError::CellCount {
                    at,
                    got: cells.len(),
                    want: header.len(),
                });
            }
            rows.push(Row { at, cells });
        }
        if rows.is_empty() {
            return Err(InputError::NoRows { file });
        }
        Ok(Self {
            header_at,
            header,
            rows,
        })
    }

    /// The rows in the order of the text.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Where the header stands.
    #[must_use]
    pub fn header_at(&self) -> &Location {
        &self.header_at
    }

    /// Checks that every column is one of `known` and there once.
    ///
    /// # Errors
    /// [`InputError::BadColumn`].
    pub fn check_columns(&self, known: &[&str]) -> Result<(), InputError> {
        for (i, name) in self.header.iter().enumerate() {
            let problem = if !known.contains(&name.as_str()) {
                "not known"
            } else if self.header[..i].contains(name) {
                "given twice"
            } else {
                continue;
            };
            return Err(InputError::BadColumn {
                at: self.header_at.clone(),
                column: name.clone(),
                problem,
                known: known.join(", "),
            });
        }
        Ok(())
    }

    /// Index of a column, where it is there.
    #[must_use]
    pub fn find(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|name| name == column)
    }

    /// Index of a column that has to be there.
    ///
    /// # Errors
    /// [`InputError::MissingColumn`].
    pub fn column(&self, column: &str) -> Result<usize, InputError> {
        self.find(column).ok_or_else(|| InputError::MissingColumn {
            at: self.header_at.clone(),
            column: column.to_owned(),
            found: self.header.join(", "),
        })
    }

    /// The error of a table that tells no scatter of its codes.
    pub(crate) fn no_scatter(&self, why: String) -> InputError {
        InputError::NoScatter {
            at: self.header_at.clone(),
            why,
        }
    }

    /// The text of a cell.
    #[must_use]
    pub fn text<'t>(&self, row: &'t Row, column: usize) -> &'t str {
        row.cells.get(column).map_or("", String::as_str)
    }

    /// The finite number in a cell.
    ///
    /// # Errors
    /// [`InputError::NotANumber`].
    pub fn number(&self, row: &Row, column: usize) -> Result<f64, InputError> {
        let text = self.text(row, column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(InputError::NotANumber {
                at: row.at.clone(),
                column: self.header[column].clone(),
                text: text.to_owned(),
            }),
        }
    }

    /// The finite number in a cell of a column that may be missing or empty.
    ///
    /// # Errors
    /// [`InputError::NotANumber`].
    pub fn optional_number(
        &self,
        row: &Row,
        column: Option<usize>,
    ) -> Result<Option<f64>, InputError> {
        match column {
            Some(c) if !self.text(row, c).is_empty() => self.number(row, c).map(Some),
            _ => Ok(None),
        }
    }

    /// A [`InputError::BadValue`] for a cell.
    #[must_use]
    pub fn bad_value(&self, row: &Row, column: usize, problem: impl Into<String>) -> InputError {
        InputError::BadValue {
            at: row.at.clone(),
            column: self.header[column].clone(),
            text: self.text(row, column).to_owned(),
            problem: problem.into(),
        }
    }
}

fn split(at: &Location, line: &str, delimiter: u8) -> Result<Vec<String>, InputError> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .from_reader(line.as_bytes());
    let mut records = reader.records();
    let bad = |problem: String| InputError::BadRow {
        at: at.clone(),
        problem,
    };
    match records.next() {
        Some(Ok(record)) => Ok(record.iter().map(str::to_owned).collect()),
        Some(Err(error)) => Err(bad(error.to_string())),
        None => Err(bad("it has no cell".to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_those_of_the_text() {
        let table = Table::parse("p.csv", "\u{feff}# points\n\nA;b\n\n1;2\n#x\n3;oops\n").unwrap();
        let column = table.column("b").unwrap();
        assert_eq!(table.rows()[0].at.line, 5);
        let error = table.number(&table.rows()[1], column).unwrap_err();
        assert_eq!(
            error.to_string(),
            "p.csv:7: `oops` in column `b` is not a finite number"
        );
    }

    #[test]
    fn empty_texts_and_bad_rows_are_named() {
        let table = Table::parse("f", "a;b\n1,5;1,2,3\n").unwrap();
        let told = |column| {
            table
                .number(&table.rows()[0], column)
                .unwrap_err()
                .to_string()
        };
        assert!(
            told(0).ends_with("write a point for the decimal comma"),
            "{}",
            told(0)
        );
        assert!(told(1).ends_with("is not a finite number"), "{}", told(1));
        assert!(matches!(
            Table::parse("f", "\n# only\n"),
            Err(InputError::Empty { .. })
        ));
        assert!(matches!(
            Table::parse("f", "a,b\n"),
            Err(InputError::NoRows { .. })
        ));
        let error = Table::parse("f", "a,b\n1,2,3\n").unwrap_err();
        assert!(error.to_string().starts_with("f:2: the row has 3 cells"));
        let table = Table::parse("f", "a\nNaN\n").unwrap();
        assert!(table.number(&table.rows()[0], 0).is_err());
        assert!(table.column("z").is_err());
        let twice = Table::parse("f", "a,a\n1,2\n").unwrap();
        assert!(twice.check_columns(&["a"]).is_err());
    }
}
