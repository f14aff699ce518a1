//! Names of the files, records and tables of a recording.

use crate::rows;
use crate::table::{Row, Table};

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
