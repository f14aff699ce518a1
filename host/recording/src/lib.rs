//! Recordings: every sample and every control cycle, with the three clocks, the phase and the
//! configuration of each.
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
//! | what a recording is fed with; what it says of itself | `recorder`, `metadata` |
//! | what waits for the writer; rows, clocks, chunks | `queue`, `writer`, `utc`, `sink` |
//! | the clocks as they are known afterwards | `times` |
//! | names, columns and schemas | `format`, `table`, `rows` |
//! | what Foxglove's 3D view draws | `foxglove` |
//! | reading it, cut off or not; a complete copy of it | `read`, `repair` |
//! | Parquet from it | `parquet` |
//! | what it holds and lacks; which files lack | `check`, `whole` |
//! | a robot's log beside it | `merge` |
//! | whether a folder may be used; hashes | `folder` |

pub mod check;
mod error;
pub(crate) mod folder;
mod format;
pub mod foxglove;
pub mod merge;
mod metadata;
mod parquet;
mod queue;
pub mod read;
mod recorder;
mod repair;
pub mod rows;
mod sink;
pub mod table;
#[cfg(test)]
mod tests;
pub mod times;
mod utc;
mod whole;
mod writer;

pub use error::RecordError;
pub use format::{
    BOARD_METADATA, CONFIGURATION_METADATA, FORMAT, FORMATS, JSON_FILE, MCAP_FILE, METADATA,
    RIG_ATTACHMENT, SUMS_FILE, TABLES,
};
pub use metadata::Metadata;
pub use parquet::{export, Exported};
pub use recorder::{Finished, Recorder};
pub use repair::{repair, Repaired, REPAIRED_FILE};
pub use sink::Storage;
pub use writer::CHUNK_PERIOD;
