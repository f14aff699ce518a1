//! A complete MCAP file from one that ends in the middle: `forcectl recording export --mcap`.
//!
//! Readers that begin with the index at the end of a file (Python's `make_reader`, PlotJuggler)
//! refuse one that a killed run has left. The copy has index and statistics, and a topic for each
//! unit's samples also where the recording is an old one with a topic for all.

use super::error::{text_of, RecordError};
use super::format::{FORMAT, FORMATS, METADATA};
use super::read::{mcap_of, End, Reader};
use super::rows::SampleRow;
use super::table::Row;
use files::Part;
use mcap::records::{MessageHeader, Record};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Name of the copy, beside the recording or in another folder.
pub const REPAIRED_FILE: &str = "repaired.mcap";

/// What was copied.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repaired {
    /// Messages.
    pub messages: u64,
    /// How the file ends that was read.
    pub end: End,
}

/// Copies what can be read of a recording to a complete MCAP file. `recording` names the MCAP file
/// or its folder.
///
/// # Errors
/// The file can't be opened, or the copy can't be written; also where both are one.
pub fn repair(recording: &Path, to: &Path) -> Result<Repaired, RecordError> {
    let from = mcap_of(recording);
    let mut reader = Reader::open(&from)?;
    let place = |path: &Path| std::fs::canonicalize(path).ok();
    if place(to).is_some() && place(to) == place(&from) {
        return Err(RecordError::refused(
            to,
            "it is the recording itself",
            "give another folder with --out",
        ));
    }
    let failed = |error: &dyn std::fmt::Display| RecordError::new(to, error);
    let (part, file) = Part::begin(to).map_err(|error| failed(&error))?;
    let mcap = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Lz4))
        .library(format!("forcectl {}", env!("CARGO_PKG_VERSION")))
        .create(BufWriter::new(file));
    let mut copy = Copy {
        mcap: mcap.map_err(|error| failed(&text_of(&error)))?,
        schemas: HashMap::new(),
        channels: HashMap::new(),
        messages: 0,
    };
    while let Some(record) = reader.record() {
        copy.take(record)
            .map_err(|error| failed(&text_of(&error)))?;
    }
    (copy.mcap.finish()).map_err(|error| failed(&text_of(&error)))?;
    let file = copy.mcap.into_inner().into_inner();
    let file = file.map_err(|error| failed(error.error()))?;
    part.finish(file).map_err(|error| failed(&error))?;
    Ok(Repaired {
        messages: copy.messages,
        end: reader.end().clone(),
    })
}

/// The copy, and numbers of schemas and channels in it by those of the recording.
struct Copy {
    mcap: mcap::Writer<BufWriter<File>>,
    schemas: HashMap<u16, u16>,
    /// One number, or one for each unit where the recording has a topic for all.
    channels: HashMap<u16, Vec<u16>>,
    messages: u64,
}

impl Copy {
    fn take(&mut self, record: Record<'_>) -> mcap::McapResult<()> {
        match record {
            Record::Schema { header, data } => {
                let id = (self.mcap).add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let topic = channel.topic.as_str();
                let topics = if topic == SampleRow::TABLE.topic {
                    SampleRow::TABLE.topics
                } else {
                    &[topic]
                };
                let encoding = &channel.message_encoding;
                let ids: mcap::McapResult<Vec<u16>> = topics
                    .iter()
                    .map(|topic| {
                        (self.mcap).add_channel(schema, topic, encoding, &channel.metadata)
                    })
                    .collect();
                self.channels.insert(channel.id, ids?);
            }
            Record::Message { header, data } => self.message(&header, &data)?,
            Record::Metadata(mut metadata) => {
                if metadata.name == METADATA {
                    split(&mut metadata.metadata);
                }
                self.mcap.write_metadata(&metadata)?;
            }
            Record::Attachment { header, data, .. } => self.mcap.attach(&mcap::Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            _ => {}
        }
        Ok(())
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> mcap::McapResult<()> {
        let channel = match self.channels.get(&header.channel_id).map(Vec::as_slice) {
            Some([channel]) => *channel,
            Some(of_units) => {
                // A sample that can't be read stays with those of the first unit, as it is.
                let row = serde_json::from_slice::<SampleRow>(data);
                let topic = row.map_or(SampleRow::TABLE.topics[0], |row| row.topic());
                let topics = SampleRow::TABLE.topics.iter();
                let unit = topics.zip(of_units).find(|(name, _)| **name == topic);
                unit.map_or(of_units[0], |(_, channel)| *channel)
            }
            // A message without a channel before it: no reader could tell what it is.
            None => return Ok(()),
        };
        let header = MessageHeader {
            channel_id: channel,
            ..*header
        };
        self.messages += 1;
        self.mcap.write_to_known_channel(&header, data)
    }
}

/// The copy's samples have a topic a unit.
fn split(metadata: &mut BTreeMap<String, String>) {
    if let Some(format) = metadata
        .get_mut("format")
        .filter(|format| FORMATS.contains(&format.as_str()))
    {
        FORMAT.clone_into(format);
    }
}
