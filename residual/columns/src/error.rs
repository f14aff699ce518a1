//! Errors of the library: what happened, what to do, and the exit code for a command.

use std::fmt;
use std::path::PathBuf;

/// A failure of an analysis. No report is written when one is returned.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    Io {
        /// The path concerned.
        path: PathBuf,
        /// What the operating system or the decoder said.
        why: String,
    },
    /// `MODEL.toml` is not valid.
    Model {
        /// What is wrong, with the key.
        what: String,
    },
    /// An expression of the model could not be parsed or evaluated.
    Expression {
        /// The expression text.
        text: String,
        /// What is wrong.
        why: String,
    },
    /// A column that the model names is not in a log.
    MissingColumn {
        /// The column's name in `MODEL.toml`.
        column: String,
        /// The file that lacks it.
        path: PathBuf,
        /// The columns that the file has.
        found: Vec<String>,
    },
    /// A cell of a log is not a number.
    BadCell {
        /// The file.
        path: PathBuf,
        /// Line (text files) or row (Parquet), from 1.
        line: u64,
        /// Column name.
        column: String,
        /// The text found.
        text: String,
    },
    /// The data cannot answer the question: too few rows, one group, nothing finite, no excitation.
    Data {
        /// What is wrong.
        what: String,
        /// What to do.
        hint: String,
    },
    /// Declared terms are linear combinations of other terms on these data.
    RankDeficient {
        /// Names of the terms that depend linearly on the terms before them.
        terms: Vec<String>,
    },
}

impl Error {
    /// Suggested process exit code: 2 usage or model, 3 input that cannot be read, 4 data that
    /// cannot be analysed. (0 is success, 1 is left to panics and unexpected failures.)
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Model { .. } | Error::Expression { .. } => 2,
            Error::Io { .. } | Error::MissingColumn { .. } | Error::BadCell { .. } => 3,
            Error::Data { .. } | Error::RankDeficient { .. } => 4,
        }
    }

    /// [`Error::Data`].
    pub fn data(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Error::Data {
            what: what.into(),
            hint: hint.into(),
        }
    }

    /// [`Error::Model`].
    pub fn model(what: impl Into<String>) -> Self {
        Error::Model { what: what.into() }
    }

    /// [`Error::Io`].
    pub fn io(path: &std::path::Path, why: impl fmt::Display) -> Self {
        Error::Io {
            path: path.to_path_buf(),
            why: why.to_string(),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Io { path, why } => write!(f, "{}: {why}", path.display()),
            Error::Model { what } => write!(f, "model file: {what}"),
            Error::Expression { text, why } => write!(f, "expression `{text}`: {why}"),
            Error::MissingColumn { column, path, found } => write!(
                f,
                "{}: no column `{column}`; the file has {}. Correct `column = ...` in the model file",
                path.display(),
                found.join(", ")
            ),
            Error::BadCell { path, line, column, text } => write!(
                f,
                "{}:{line}: column `{column}`: `{text}` is not a number (empty cells and `nan` are allowed). Correct the line; or, in the model file, set input.skip and input.header if the first row is further down, or leave such lines out with hygiene.text = \"drop\"",
                path.display()
            ),
            Error::Data { what, hint } => write!(f, "{what}. {hint}"),
            Error::RankDeficient { terms } => write!(
                f,
                "declared term(s) {} are linear combinations of the terms before them on these data. \
                 Remove them, fix their coefficient, or record an experiment that distinguishes them",
                terms.join(", ")
            ),
        }
    }
}

impl std::error::Error for Error {}
