//! Why a recording could not be written or read.

use std::error::Error;
use std::path::Path;

/// What an error says. The crate `mcap` has one text for all failures of a file, and the system's
/// words, for example of a full disk, behind it.
pub(crate) fn text_of(error: &(dyn Error + 'static)) -> String {
    match error.downcast_ref() {
        Some(mcap::McapError::Io(cause)) => cause.to_string(),
        _ => error.to_string(),
    }
}

/// Why a recording, or a log beside it, could not be written or read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {cause}; {advice}")]
pub struct RecordError {
    /// File.
    pub path: String,
    /// What went wrong.
    pub cause: String,
    /// What to do.
    pub advice: &'static str,
    /// Whether it could not be read; else it could not be written.
    pub of_input: bool,
}

impl RecordError {
    /// A file that can't be written.
    pub(crate) fn new(path: &Path, cause: &dyn std::fmt::Display) -> Self {
        Self {
            path: path.display().to_string(),
            cause: cause.to_string(),
            advice: "check the folder and the space on the disk",
            of_input: false,
        }
    }

    /// A place that is not taken, whatever the disk says.
    pub(crate) fn refused(path: &Path, cause: &str, advice: &'static str) -> Self {
        Self {
            path: path.display().to_string(),
            cause: cause.to_owned(),
            advice,
            of_input: false,
        }
    }

    /// A file that can't be read.
    pub(crate) fn unreadable(path: &Path, cause: &dyn std::fmt::Display) -> Self {
        Self {
            path: path.display().to_string(),
            cause: cause.to_string(),
            advice: "give a run.mcap of `forcectl`, or the folder that holds it",
            of_input: true,
        }
    }
}
