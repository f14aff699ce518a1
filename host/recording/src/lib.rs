//! Recordings: every sample and every control cycle, with the three clocks, the phase and the configuration of each.
//!
//! A recording is a folder (docs/recordings.md):
//!
//! | file | what | when |
//! | --- | --- | --- |
//! | `run.mcap` | everything, for Foxglove and the mcap tools | a chunk twice a second, on the disk |
//! | `configuration.json` | rig file, configurations with their CRC, hashes, versions | at the start, and again at the end |
//! | `samples.parquet`, `cycles.parquet`, ... | a table for each topic | at the end, from `run.mcap` |
//! | `SHA256SUMS` | hashes of all of these | at the end |
//!
//! | question | file here |
//! | --- | --- |
//! | what a recording is fed with | `recorder` |
//! | rows, clocks, chunks | `writer`, `utc`, `sink` |
//! | the clocks as they are known afterwards | `times` |
//! | columns and schemas | `table`, `rows` |
//! | reading it, cut off or not | `read` |
//! | Parquet from it | `parquet` |
//! | what it holds and lacks | `check` |
//! | a robot's log beside it | `merge` |
//! | whether a folder may be used; hashes | `folder` |

pub mod check;
pub(crate) mod folder;
pub mod merge;
mod parquet;
pub mod read;
mod recorder;
pub mod rows;
mod sink;
pub mod table;
#[cfg(test)]
mod tests;
pub mod times;
mod utc;
mod writer;

pub use parquet::{export, Exported};
pub use recorder::{Finished, Metadata, Recorder};
pub use sink::Storage;
pub use writer::CHUNK_PERIOD;

use std::path::Path;
use table::{Row, Table};

/// The MCAP file.
pub const MCAP_FILE: &str = "run.mcap";
/// The configuration.
pub const JSON_FILE: &str = "configuration.json";
/// Hashes.
pub const SUMS_FILE: &str = "SHA256SUMS";
/// Version of all of this; another number where a reader of this one would be misled.
pub const FORMAT: &str = "force-rig-recording 2";
/// Name of the first metadata record.
pub const METADATA: &str = "recording";
/// Name of the metadata record of each configuration.
pub const CONFIGURATION_METADATA: &str = "configuration";
/// Name of the metadata record of the board.
pub const BOARD_METADATA: &str = "board";
/// Name of the attachment with the rig file.
pub const RIG_ATTACHMENT: &str = "rig.json";

/// All tables.
pub const TABLES: [Table; 5] = [
    rows::SampleRow::TABLE,
    rows::CycleRow::TABLE,
    rows::ClockRow::TABLE,
    rows::CounterRow::TABLE,
    rows::EventRow::TABLE,
];

/// Why a recording could not be written or read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("recording {path}: {cause}; {advice}")]
pub struct RecordError {
    /// File.
    pub path: String,
    /// What went wrong.
    pub cause: String,
    /// What to do.
    pub advice: &'static str,
}

impl RecordError {
    /// A file that can't be written.
    pub(crate) fn new(path: &Path, cause: &dyn std::fmt::Display) -> Self {
        Self {
            path: path.display().to_string(),
            cause: cause.to_string(),
            advice: "check the folder and the space on the disk",
        }
    }

    /// A file that can't be read.
    pub(crate) fn unreadable(path: &Path, cause: &dyn std::fmt::Display) -> Self {
        Self {
            path: path.display().to_string(),
            cause: cause.to_string(),
            advice: "give a run.mcap of `forcectl`, or the folder that holds it",
        }
    }
}
