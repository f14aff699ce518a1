//! Why an experiment could not go on.

use crate::file::FileError;
use crate::plan::PlanError;
use crate::table::TableError;

/// Why an experiment could not go on. Attempts that failed are no error: they are in the folder.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The experiment file; nothing was driven.
    #[error(transparent)]
    File(#[from] FileError),
    /// The rig file; nothing was driven.
    #[error(transparent)]
    Rig(#[from] rig::RigFileError),
    /// A trial can't be done; nothing was driven.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The folder does not fit.
    #[error("{0}")]
    Folder(String),
    /// A table or another file.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The recording of the samples.
    #[error(transparent)]
    Record(#[from] recording::RecordError),
    /// The link can't be opened.
    #[error(transparent)]
    Link(#[from] session::link::LinkError),
    /// The rig can't be reached; why, in words.
    #[error("{0}")]
    Unreachable(String),
    /// Somebody stopped the rig between two attempts; who, in words.
    #[error("{0}")]
    StoppedElsewhere(String),
}
