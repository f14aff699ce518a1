//! Why something that is known of a rig can't be read or kept.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Why something that is known of a rig can't be read or kept. Nothing was stored.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The content can't be used: the message names file and line.
    #[error("{0}\nnothing was stored")]
    Input(String),
    /// The content is sound and does not fit this rig.
    #[error("{0}\nnothing was stored")]
    Refused(String),
    /// A file or folder that can't be written.
    #[error("{path}: {cause}")]
    File {
        /// The file.
        path: String,
        /// What is wrong, and what to do.
        cause: String,
    },
    /// The file of the zeros.
    #[error(
        "the stored zeros {} can't be used: {cause}; correct or delete the file (then run `forcectl zero`)",
        path.display()
    )]
    Zeros {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        cause: String,
    },
}

impl StoreError {
    /// A file that can't be written.
    #[must_use]
    pub fn file(path: &Path, cause: impl Display) -> Self {
        Self::File {
            path: path.display().to_string(),
            cause: cause.to_string(),
        }
    }

    /// A file that can't be read.
    #[must_use]
    pub fn unreadable(path: &Path, cause: impl Display) -> Self {
        Self::Input(format!("{} can't be read: {cause}", path.display()))
    }

    /// Content that can't be used.
    #[must_use]
    pub fn input(why: impl Display) -> Self {
        Self::Input(why.to_string())
    }

    /// Sound content that does not fit.
    #[must_use]
    pub fn refused(why: impl Display) -> Self {
        Self::Refused(why.to_string())
    }
}

/// Result of reading or keeping.
pub type Result<T> = std::result::Result<T, StoreError>;
