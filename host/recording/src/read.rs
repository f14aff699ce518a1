//! Reading a recording's MCAP file from start to end, complete or cut off in the middle.

use super::error::{text_of, RecordError};
use super::format::{
    table_topic, BOARD_METADATA, CONFIGURATION_METADATA, MCAP_FILE, METADATA, RIG_ATTACHMENT,
};
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest record that is believed, bytes: a chunk is below 2 MB.
const RECORD_MAX: usize = 256 << 20;

/// Something in the file.
#[derive(Debug, Clone, PartialEq)]
pub enum Entry {
    /// A message.
    Message {
        /// Its table's topic: `/sample` for the samples of any unit.
        topic: String,
        /// UTC of the event, ns since 1970.
        log_time: u64,
        /// JSON.
        data: Vec<u8>,
    },
    /// A metadata record.
    Metadata {
        /// Name.
        name: String,
        /// Pairs.
        pairs: BTreeMap<String, String>,
    },
    /// An attachment.
    Attachment {
        /// Name.
        name: String,
        /// Bytes.
        data: Vec<u8>,
    },
}

/// How the file ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// It was not read to the end yet.
    Unknown,
    /// With its footer.
    Complete,
    /// In the middle: the recording was killed, or the disk was full. What came before was read.
    CutOff,
    /// It is damaged: why. What came before was read.
    Damaged(String),
}

/// Reads entries one after the other.
pub struct Reader {
    file: File,
    path: PathBuf,
    reader: LinearReader,
    topics: HashMap<u16, String>,
    end: End,
    footer: bool,
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader")
            .field("path", &self.path)
            .field("end", &self.end)
            .finish_non_exhaustive()
    }
}

/// The MCAP file of a recording that is named by file or folder.
#[must_use]
pub fn mcap_of(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join(MCAP_FILE)
    } else {
        path.to_owned()
    }
}

impl Reader {
    /// Opens a file.
    ///
    /// # Errors
    /// It can't be opened.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let file = files::open(path).map_err(|error| RecordError::unreadable(path, &error))?;
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_record_length_limit(RECORD_MAX);
        Ok(Self {
            file,
            path: path.to_owned(),
            reader: LinearReader::new_with_options(options),
            topics: HashMap::new(),
            end: End::Unknown,
            footer: false,
        })
    }

    /// How the file ends, once it was read.
    #[must_use]
    pub const fn end(&self) -> &End {
        &self.end
    }

    /// The next record.
    fn advance(&mut self) -> Result<Option<Record<'static>>, mcap::McapError> {
        while let Some(event) = self.reader.next_event() {
            match event? {
                LinearReadEvent::ReadRequest(need) => {
                    let read = loop {
                        match self.file.read(self.reader.insert(need)) {
                            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                            other => break other?,
                        }
                    };
                    self.reader.notify_read(read);
                }
                LinearReadEvent::Record { data, opcode } => {
                    let record = mcap::parse_record(opcode, data)?.into_owned();
                    self.footer |= matches!(record, Record::Footer(_));
                    return Ok(Some(record));
                }
            }
        }
        Ok(None)
    }

    /// The next record as it is in the file; `None` at the end, which [`Reader::end`] tells.
    pub(super) fn record(&mut self) -> Option<Record<'static>> {
        if self.end != End::Unknown {
            return None;
        }
        self.end = match self.advance() {
            Ok(Some(record)) => return Some(record),
            Ok(None) if self.footer => End::Complete,
            Ok(None) | Err(mcap::McapError::UnexpectedEof) => End::CutOff,
            Err(error) => End::Damaged(text_of(&error)),
        };
        None
    }

    /// What a record says, if anything.
    fn entry(&mut self, record: Record<'static>) -> Option<Entry> {
        match record {
            Record::Channel(channel) => {
                let topic = table_topic(&channel.topic).to_owned();
                self.topics.insert(channel.id, topic);
                None
            }
            Record::Message { header, data } => Some(Entry::Message {
                topic: (self.topics.get(&header.channel_id).cloned()).unwrap_or_default(),
                log_time: header.log_time,
                data: data.into_owned(),
            }),
            Record::Metadata(metadata) => Some(Entry::Metadata {
                name: metadata.name,
                pairs: metadata.metadata,
            }),
            Record::Attachment { header, data, .. } => Some(Entry::Attachment {
                name: header.name,
                data: data.into_owned(),
            }),
            _ => None,
        }
    }
}

impl Iterator for Reader {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        while let Some(record) = self.record() {
            let entry = self.entry(record);
            if entry.is_some() {
                return entry;
            }
        }
        None
    }
}

/// Metadata of an entry, as the Parquet files have it: that of the recording, the rig file, and the
/// newest configuration.
pub(super) fn metadata_pairs(entry: &Entry, pairs: &mut BTreeMap<String, String>) {
    match entry {
        Entry::Metadata { name, pairs: found } if name == METADATA || name == BOARD_METADATA => {
            pairs.extend(found.clone());
        }
        Entry::Metadata { name, pairs: found } if name == CONFIGURATION_METADATA => {
            let index = found.get("configuration").cloned().unwrap_or_default();
            for (key, value) in found {
                if key != "configuration" {
                    pairs.insert(key.clone(), value.clone());
                    pairs.insert(format!("{key}.{index}"), value.clone());
                }
            }
        }
        Entry::Attachment { name, data } if name == RIG_ATTACHMENT => {
            pairs.insert("rig".to_owned(), String::from_utf8_lossy(data).into_owned());
        }
        _ => {}
    }
}
