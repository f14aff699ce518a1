//! Why a log can't be used: file, column, and what to do.

/// A line in words, behind a row.
fn in_line(line: Option<u64>) -> String {
    line.map_or_else(String::new, |line| format!(", line {line} of the file"))
}

/// Why a log can't be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DataError {
    /// A column is missing.
    #[error("{file}: there is no column `{column}` (for {role}); the file has {has}. Name the right column in a mapping file (--mapping){instead}")]
    Missing {
        /// File.
        file: String,
        /// Column.
        column: String,
        /// What it is for.
        role: String,
        /// Columns that are there.
        has: String,
        /// What else can be done, beginning with a comma; empty where there is nothing else.
        instead: &'static str,
    },
    /// A column has text in it.
    #[error("{file}: the column `{column}` (for {role}) is text, `{cell}` in line {line}. Write numbers there, or name another column in a mapping file (--mapping){instead}")]
    Text {
        /// File.
        file: String,
        /// Column.
        column: String,
        /// What it is for.
        role: String,
        /// Its first cell.
        cell: String,
        /// Line of the file.
        line: u64,
        /// What else can be done, beginning with a comma; empty where there is nothing else.
        instead: &'static str,
    },
    /// A mapping says that something is absent without which there is no model.
    #[error("{file}: the mapping file says that {role} is absent; {why}")]
    Needed {
        /// File.
        file: String,
        /// What it is for.
        role: String,
        /// Why it is needed, and what to do.
        why: String,
    },
    /// A mapping names no column.
    #[error("{file}: the mapping file names no column for {role}; give `column`, or `absent = true` for a velocity, an effort or a component of the force")]
    Unnamed {
        /// File.
        file: String,
        /// What it is for.
        role: String,
    },
    /// A column is in a unit that can't be converted.
    #[error("{file}: column `{column}` (for {role}): `{unit}` {why}; the model takes it in {si}. Correct `unit` in the mapping file, or leave it out and give `scale`, the factor to {si}")]
    Unit {
        /// File.
        file: String,
        /// What it is for.
        role: &'static str,
        /// Column.
        column: String,
        /// Unit in the mapping file.
        unit: String,
        /// Why not, in words that follow the unit.
        why: &'static str,
        /// Unit of the model.
        si: &'static str,
    },
    /// A value is not a number.
    #[error("{file}: column `{column}` is {value} in row {row}{} (t = {time_s} s), which is marked as usable; mark such rows unusable or leave them out", in_line(*.line))]
    NotANumber {
        /// File.
        file: String,
        /// Column.
        column: String,
        /// What is there.
        value: f64,
        /// Row from 1.
        row: usize,
        /// Line of a text file.
        line: Option<u64>,
        /// Time, s.
        time_s: f64,
    },
    /// A trial has no number.
    #[error("{file}: column `{column}` is {value} in row {row}{}, which is marked as usable; a trial's number is whole and 0 or more, text is read as NaN. Number the trials, or write `trial = \"\"` in a mapping file (--mapping): each file is then a trial", in_line(*.line))]
    Trial {
        /// File.
        file: String,
        /// Column of the trial.
        column: String,
        /// What is there.
        value: f64,
        /// Row from 1, without the header.
        row: usize,
        /// Line of a text file.
        line: Option<u64>,
    },
    /// Another rate.
    #[error("{file}: its rows are {found_hz:.2} Hz (column `{column}`), which is no multiple of the model's {wanted_hz:.2} Hz; record at such a rate, or train a model at this one (--rate)")]
    Rate {
        /// File.
        file: String,
        /// Column of the time.
        column: String,
        /// Rate of the file, Hz.
        found_hz: f64,
        /// Wanted, Hz.
        wanted_hz: f64,
    },
    /// Nothing usable.
    #[error("{file}: no stretch of usable rows is longer than a second")]
    Empty {
        /// File.
        file: String,
    },
    /// Time does not go on.
    #[error("{file}: the time in column `{column}` does not increase")]
    Time {
        /// File.
        file: String,
        /// Column.
        column: String,
    },
}
