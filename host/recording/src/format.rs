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
pub const FORMAT: &str = "force-rig-recording 3";
/// Versions that are read: 2 has the samples of all units on one topic.
pub const FORMATS: [&str; 2] = ["force-rig-recording 2", FORMAT];
/// Name of the first metadata record.
pub const METADATA: &str = "recording";
/// Name of the metadata record of each configuration.
pub const CONFIGURATION_METADATA: &str = "configuration";
/// Name of the metadata record of the board.
pub const BOARD_METADATA: &str = "board";
/// Name of the attachment with the rig file.
pub const RIG_ATTACHMENT: &str = "rig.json";

/// The table's topic of a topic of the MCAP file: `/sample` of each unit's. Others are what they
/// are.
#[must_use]
pub fn table_topic(topic: &str) -> &str {
    let table = TABLES.iter().find(|table| table.topics.contains(&topic));
    table.map_or(topic, |table| table.topic)
}

/// All tables.
pub const TABLES: [Table; 5] = [
    rows::SampleRow::TABLE,
    rows::CycleRow::TABLE,
    rows::ClockRow::TABLE,
    rows::CounterRow::TABLE,
    rows::EventRow::TABLE,
];
