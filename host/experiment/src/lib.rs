//! An experiment: trials in which the robot moves, the rig applies a known force, and both become
//! one dataset.
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
mod error;
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

pub use error::ExperimentError;
pub use file::{Experiment, FileError, THESIS, THESIS_NAME};
pub use folder::{Attempt, Folder, Status};
pub use plan::PlanError;
pub use sequence::{run, Open, Options, Shard, Summary};
pub use trial::{NoopWatcher, Watcher};

#[cfg(test)]
mod tests;
