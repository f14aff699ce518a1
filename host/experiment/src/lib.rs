//! An experiment: trials in which the robot moves, the rig applies a known force, and both become one dataset.
//!
//! | question | file |
//! | --- | --- |
//! | what is asked for | `file` |
//! | which path and force has a trial; can the rig do them | `plan`, `profile`, `pull` |
//! | both control paths: the loop on the host; a comparison | `raven`, `paths` |
//! | one trial | `trial`, with `feed` the robot's states |
//! | rows from states and samples | `dataset`, `table` |
//! | is a trial good | `figures` |
//! | all trials, shards, resuming; one process a trial | `sequence`, `folder`, `lock` |
//! | data card, report, pictures | `card`, `report`, `pictures` |
//!
//! docs/experiment.md tells how to run one, docs/dataset.md what a dataset holds.

pub mod card;
pub mod dataset;
pub mod feed;
pub mod figures;
pub mod file;
pub mod folder;
pub mod lock;
pub mod paths;
pub mod pictures;
pub mod plan;
pub mod profile;
pub mod pull;
pub mod raven;
pub mod report;
pub mod sequence;
pub mod table;
pub mod trial;

pub use file::{Experiment, FileError, THESIS, THESIS_NAME};
pub use folder::{Attempt, Folder, Status};
pub use plan::PlanError;
pub use sequence::{run, Options, Shard, Summary};
pub use trial::{NoopWatcher, Watcher};

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
    Table(#[from] table::TableError),
    /// The recording of the samples.
    #[error(transparent)]
    Record(#[from] recording::RecordError),
    /// The link can't be opened.
    #[error(transparent)]
    Link(#[from] session::link::LinkError),
}

#[cfg(test)]
mod tests;
