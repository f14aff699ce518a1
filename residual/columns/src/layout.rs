//! How files of measured rows are laid out: what a model file of the analysis says under `[input]`,
//! and a mapping file of an estimator likewise.

use crate::error::Error;
use serde::{Deserialize, Serialize};

/// How files are read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Input {
    /// Names for the columns of text files without a header.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub header: Vec<String>,
    /// Column separator of text files: one character, or `blank` for runs of blanks.
    pub separator: String,
    /// What begins a comment line of text files: one character. Empty: `%` in a file that begins
    /// with it, else `#`.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub comment: String,
    /// Lines at the head of text files to leave out before anything else.
    #[serde(skip_serializing_if = "is_zero_usize")]
    pub skip: usize,
    /// Decimal mark of text files: `.` or `,`.
    pub decimal: String,
    /// Mark between thousands in the numbers of text files, as `.` in `1.234,5`: one character; a
    /// blank stands for those of typesetters too. Empty: none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub thousands: String,
    /// Rows per second of logs without a time column, in Hz: the column that `roles.time` names is
    /// then made from the row numbers. 0: the logs have it.
    #[serde(skip_serializing_if = "is_zero")]
    pub rate: f64,
    /// A pattern of the file name, such as `unit{unit}_torque{torque}_comp{comp}`: each `{name}`
    /// takes the number at its place and becomes a column. A pattern with a `/` is matched against
    /// the whole path.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub file_name: String,
    /// Kinds of message in text logs whose lines begin with their kind; empty: all lines are of one
    /// kind.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub messages: Vec<Message>,
    /// Columns that split a file into sequences, such as `unit`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sequence: Vec<String>,
}

impl Default for Input {
    fn default() -> Self {
        Input {
            header: vec![],
            separator: ",".into(),
            comment: String::new(),
            skip: 0,
            decimal: ".".into(),
            thousands: String::new(),
            rate: 0.0,
            file_name: String::new(),
            messages: vec![],
            sequence: vec![],
        }
    }
}

impl Input {
    /// Refuses values that would lead to numbers without meaning.
    ///
    /// # Errors
    /// [`Error::Model`] with the key and what to write.
    pub fn check(&self) -> Result<(), Error> {
        for (bad, what) in [
            (
                ![".", ","].contains(&self.decimal.as_str()),
                "input.decimal is \".\" or \",\"",
            ),
            (
                self.thousands.chars().count() > 1,
                "input.thousands is one character, or empty",
            ),
            (
                self.thousands == self.decimal,
                "input.thousands and input.decimal are the same",
            ),
            (
                !(self.rate.is_finite() && self.rate >= 0.0),
                "input.rate must be a number of rows per second, or 0",
            ),
        ] {
            if bad {
                return Err(Error::model(what));
            }
        }
        Ok(())
    }
}

/// One kind of message in a log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Message {
    /// What its lines begin with.
    pub begins: String,
    /// Names of its cells, the kind itself included; an empty name leaves a cell out.
    pub header: Vec<String>,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

fn is_zero_usize(x: &usize) -> bool {
    *x == 0
}

/// What to do with a flaw that was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Action {
    /// Only report it.
    #[default]
    Report,
    /// Leave the rows out of the fit.
    Drop,
    /// Correct the values (only for a 256-fold scale and a wrapped angle).
    Fix,
}
