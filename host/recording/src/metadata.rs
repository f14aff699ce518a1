//! What a recording says of itself.

use crate::format::FORMAT;
use crate::foxglove::FRAME;
use crate::table::{ColumnTable, Utc};
use rig::{board_crc, Rig};
use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};
use wire::message::UnitConfig;
use wire::UNITS;

/// What a recording says of itself from its first byte on.
#[derive(Debug, Clone)]
pub struct Metadata {
    /// The rig file.
    pub rig: Rig,
    /// Whether time is that of an emulation: UTC then begins at `utc_start` and passes with it.
    pub emulated: bool,
    /// Start of the recording.
    pub utc_start: Utc,
    /// Whether a run may wait for the disk where 40 s of rows wait already: where the rig's time is
    /// the run's own to stop.
    pub waits: bool,
    /// Whether load-cell samples and control cycles are recorded.
    pub samples: bool,
    /// Tables that the run adds.
    pub columns: Vec<ColumnTable>,
    /// Anything else: trial, seed, who, what for.
    pub notes: BTreeMap<String, String>,
}

impl Metadata {
    /// Of a recording that starts now.
    #[must_use]
    pub fn new(rig: &Rig, emulated: bool) -> Self {
        let now_ns = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |passed| u64::try_from(passed.as_nanos()).unwrap_or(0));
        Self {
            rig: rig.clone(),
            emulated,
            waits: emulated,
            samples: true,
            columns: Vec::new(),
            utc_start: Utc::from_ns(now_ns),
            notes: BTreeMap::new(),
        }
    }

    /// For a rig whose time does not wait: a real one, one that others share, one that is paced.
    #[must_use]
    pub fn never_waits(mut self) -> Self {
        self.waits = false;
        self
    }

    /// Records neither load-cell samples nor control cycles.
    #[must_use]
    pub fn without_samples(mut self) -> Self {
        self.samples = false;
        self
    }

    /// Adds tables of numbers.
    #[must_use]
    pub fn with_columns(mut self, tables: &[ColumnTable]) -> Self {
        self.columns.extend_from_slice(tables);
        self
    }

    /// Adds a note, for example a trial's seed.
    #[must_use]
    pub fn with(mut self, key: impl Into<String>, value: impl ToString) -> Self {
        self.notes.insert(key.into(), value.to_string());
        self
    }

    /// The rig file as it is hashed: SHA-256 of these bytes is [`Rig::hash`].
    #[must_use]
    pub fn rig_json(&self) -> Vec<u8> {
        // Plain numbers and strings to memory: cannot fail.
        serde_json::to_vec(&self.rig).unwrap_or_default()
    }

    /// As pairs of texts.
    #[must_use]
    pub fn pairs(&self) -> BTreeMap<String, String> {
        let start = UNIX_EPOCH + std::time::Duration::from_nanos(self.utc_start.ns());
        let own = [
            ("format", FORMAT.to_owned()),
            ("forcectl_version", env!("CARGO_PKG_VERSION").to_owned()),
            ("wire_abi", wire::ABI_VERSION.to_string()),
            ("rig_name", self.rig.name.clone()),
            ("rig_hash_sha256", self.rig.hash()),
            (
                "utc_start",
                humantime::format_rfc3339_nanos(start).to_string(),
            ),
            (
                "time_source",
                if self.emulated { "emulated" } else { "real" }.to_owned(),
            ),
            ("frame", FRAME.to_owned()),
            ("force_sign", "on the tool".to_owned()),
        ];
        let mut pairs = self.notes.clone();
        pairs.extend(own.map(|(key, value)| (key.to_owned(), value)));
        pairs
    }
}

/// Metadata of a configuration.
pub(super) fn configuration_pairs(
    index: i32,
    configs: &[UnitConfig; UNITS],
) -> BTreeMap<String, String> {
    let json = serde_json::to_string(configs).unwrap_or_default();
    BTreeMap::from([
        ("configuration".to_owned(), index.to_string()),
        (
            "board_config_crc32".to_owned(),
            format!("{:08x}", board_crc(configs)),
        ),
        ("board_config".to_owned(), json),
    ])
}
