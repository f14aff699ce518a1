//! The recorder: takes what a run produces without ever waiting for a disk, and hands it to the
//! thread that writes.

use crate::error::{text_of, RecordError};
use crate::format::{BOARD_METADATA, JSON_FILE, MCAP_FILE};
use crate::metadata::{configuration_pairs, Metadata};
use crate::queue::{Item, Shared};
use crate::rows::phase_name;
use crate::sink::Storage;
use crate::writer::Writer;
use crate::{folder, parquet};
use force::metrics::Step;
use known::uncertainty::Steady;
use run::Phase;
use session::Received;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{sync_channel, SyncSender, TrySendError};
use std::sync::{Arc, PoisonError};
use wire::message::UnitConfig;
use wire::UNITS;

/// Items that wait for the writer at most: two a control cycle, 40 s.
const QUEUE: usize = 8192;

/// What a recording holds when it is complete.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Finished {
    /// Samples in the file.
    pub samples: u64,
    /// Cycles of the host's controller in the file.
    pub cycles: u64,
    /// Samples that are not in it, because the disk was too slow or full.
    pub dropped_samples: u64,
    /// Cycles that are not in it.
    pub dropped_cycles: u64,
    /// Files that are not complete, with the reason.
    #[serde(skip)]
    pub failures: Vec<RecordError>,
}

impl Finished {
    /// An error where a file is not complete or something was dropped.
    ///
    /// # Errors
    /// [`RecordError`] with all reasons.
    pub fn complete(self) -> Result<Self, RecordError> {
        let mut failures = self.failures.iter();
        if let Some(first) = failures.next() {
            let mut first = first.clone();
            for other in failures {
                first.cause += &format!("\n{other}");
            }
            return Err(first);
        }
        Ok(self)
    }
}

/// An open recording.
///
/// Every method returns at once: rows wait in memory, and where 40 s of them wait, newer ones are
/// dropped and counted. Only a rig in emulated time of its own is held up instead
/// ([`Metadata::waits`]). [`Recorder::finish`] completes the files. A recorder that is dropped
/// completes the MCAP file only.
pub struct Recorder {
    folder: PathBuf,
    metadata: Metadata,
    items: Option<SyncSender<Item>>,
    /// What may not be dropped and waits for room.
    waiting: VecDeque<Item>,
    thread: Option<std::thread::JoinHandle<()>>,
    shared: Arc<Shared>,
    configurations: Vec<[UnitConfig; UNITS]>,
    /// For the uncertainty of the force that was held.
    steady: Steady,
    failures: Vec<RecordError>,
    phase: Option<&'static str>,
    told_drops: bool,
    told_trouble: Option<String>,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recorder")
            .field("folder", &self.folder)
            .field("shared", &self.shared)
            .finish_non_exhaustive()
    }
}

impl Recorder {
    /// Begins a recording in a folder, which is made where it isn't there. Header, schemas, rig
    /// file and metadata are on the disk when this returns.
    ///
    /// # Errors
    /// [`RecordError`]; also where the folder holds a recording already, which is never
    /// overwritten. Files of a start that failed before anything was recorded are no recording.
    pub fn create(folder: &Path, metadata: &Metadata) -> Result<Self, RecordError> {
        folder::prepare(folder)?;
        let path = folder.join(MCAP_FILE);
        let file = File::create(&path).map_err(|error| RecordError::new(&path, &error))?;
        let recorder = Self::create_on(folder, metadata, Box::new(file));
        if recorder.is_err() {
            // Nothing is in it.
            let _ = std::fs::remove_file(&path);
        }
        recorder
    }

    /// The same on any storage for the MCAP file.
    ///
    /// # Errors
    /// As [`Recorder::create`].
    pub fn create_on(
        folder: &Path,
        metadata: &Metadata,
        storage: Box<dyn Storage>,
    ) -> Result<Self, RecordError> {
        let shared = Arc::<Shared>::default();
        let path = folder.join(MCAP_FILE);
        let writer = Writer::create(storage, metadata, Arc::clone(&shared))
            .map_err(|error| RecordError::new(&path, &text_of(&*error)))?;
        let (items, received) = sync_channel(QUEUE);
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || writer.run(&received))
            .map_err(|error| RecordError::new(&path, &error))?;
        let mut recorder = Self {
            folder: folder.to_owned(),
            metadata: metadata.clone(),
            items: Some(items),
            waiting: VecDeque::new(),
            thread: Some(thread),
            shared,
            configurations: Vec::new(),
            steady: Steady::default(),
            failures: Vec::new(),
            phase: None,
            told_drops: false,
            told_trouble: None,
        };
        recorder.write_configuration();
        if let Some(warning) = known::base::expiry(&recorder.metadata.rig) {
            recorder.notice(&warning);
        }
        Ok(recorder)
    }

    /// A phase of the run begins. What is received from now on belongs to it.
    pub fn phase(&mut self, phase: Phase) {
        let name = phase_name(phase);
        if self.phase != Some(name) {
            self.phase = Some(name);
            self.must(Item::Phase(name));
        }
    }

    /// The configuration in force, zeros included; samples from now on are converted with it.
    pub fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        if self.configurations.last() != Some(configs) {
            self.configurations.push(*configs);
            self.must(Item::Configured(Box::new(*configs)));
        }
    }

    /// A message for the user.
    pub fn notice(&mut self, text: &str) {
        self.must(Item::Notice(text.to_owned()));
    }

    /// Adds a record to the MCAP file's metadata, for example what was known only after the start.
    pub fn describe(&mut self, name: &str, pairs: BTreeMap<String, String>) {
        self.must(Item::Metadata(name.to_owned(), pairs));
    }

    /// The board that answered.
    pub fn board(&mut self, board: &wire::message::BoardInfo) {
        let pairs = [
            ("firmware_version", board.version.as_str().to_owned()),
            ("board_abi", board.abi.to_string()),
            ("core_hz", board.core_hz.to_string()),
            (
                "clock_source",
                if board.hse { "HSE" } else { "HSI" }.to_owned(),
            ),
            ("silicon", format!("{:#06x}", board.silicon)),
        ];
        let pairs = pairs.map(|(key, value)| (key.to_owned(), value));
        self.describe(BOARD_METADATA, BTreeMap::from(pairs));
    }

    /// What arrived: samples, faults, readings of the clock.
    pub fn received(&mut self, received: &Received) {
        // The truth is a thousand rows a second that cycles hold at their own rate.
        let samples = if self.metadata.samples {
            received.samples.clone()
        } else {
            Vec::new()
        };
        let received = Received {
            samples,
            truth: Vec::new(),
            faults: received.faults.clone(),
            readings: received.readings.clone(),
            status: received.status.clone(),
            ..*received
        };
        let samples = received.samples.len() as u64;
        if !self.may(Item::Received(Box::new(received))) {
            self.shared.drop_samples(samples);
        }
    }

    /// A cycle of the host's controller, after what arrived in it.
    pub fn cycle(&mut self, step: &Step) {
        self.cycle_at(step, 0);
    }

    /// The same before what arrived in it was handed over, with its host time, ns.
    pub fn cycle_at(&mut self, step: &Step, host_ns: u64) {
        self.steady.add(step);
        if !self.metadata.samples {
            return;
        }
        if !self.may(Item::Cycle(Box::new(*step), host_ns)) {
            self.shared.drop_cycles(1);
        }
    }

    /// A row of a table of [`Metadata::columns`] that was at a board time, s.
    pub fn columns(&mut self, topic: &'static str, board_s: f64, values: Vec<f64>) {
        if !self.may(Item::Columns(topic, board_s, values)) {
            self.shared.drop_cycles(1);
        }
    }

    /// What the user should know since the last call: a disk that takes nothing, rows that were
    /// dropped.
    pub fn trouble(&mut self) -> Option<String> {
        let trouble = self
            .shared
            .trouble
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        let new = trouble.filter(|why| self.told_trouble.as_ref() != Some(why));
        if let Some(why) = new {
            self.told_trouble = Some(why.clone());
            return Some(format!(
                "the recording in {} cannot be written at the moment: {why}; it waits in memory and is tried again, the run continues",
                self.folder.display()
            ));
        }
        let (samples, cycles) = self.shared.dropped();
        if samples + cycles > 0 && !self.told_drops {
            self.told_drops = true;
            return Some(format!(
                "the disk is too slow or full: the recording in {} lacks samples from now on; the run continues",
                self.folder.display()
            ));
        }
        None
    }

    /// Sends what may be dropped; `false` where there is no room.
    fn may(&mut self, item: Item) -> bool {
        if !self.send_waiting() {
            return false;
        }
        let waits = self.metadata.waits;
        self.items.as_ref().is_some_and(|items| {
            if waits {
                items.send(item).is_ok()
            } else {
                items.try_send(item).is_ok()
            }
        })
    }

    /// Sends what may not be dropped, now or with the next room.
    fn must(&mut self, item: Item) {
        self.waiting.push_back(item);
        self.send_waiting();
    }

    /// Sends what waits; `true` where nothing waits any more.
    fn send_waiting(&mut self) -> bool {
        let Some(items) = &self.items else {
            return false;
        };
        while let Some(item) = self.waiting.pop_front() {
            match items.try_send(item) {
                Ok(()) => {}
                Err(TrySendError::Full(item)) => {
                    self.waiting.push_front(item);
                    return false;
                }
                Err(TrySendError::Disconnected(_)) => return false,
            }
        }
        true
    }

    /// Ends the thread: the MCAP file is complete then, or `shared` says why not.
    fn close(&mut self) {
        if let Some(items) = self.items.take() {
            for item in self.waiting.drain(..) {
                // The end may wait for the disk.
                if items.send(item).is_err() {
                    break;
                }
            }
        }
        if let Some(thread) = self.thread.take() {
            if thread.join().is_err() {
                self.shared.fail("the thread that writes it panicked");
            }
        }
    }

    /// Completes the recording. Every file is finished on its own; one that can't be written costs
    /// only itself.
    #[must_use]
    pub fn finish(mut self) -> Finished {
        self.close();
        let mcap = self.folder.join(MCAP_FILE);
        let failure = self
            .shared
            .failure
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        let mut failures = std::mem::take(&mut self.failures);
        if let Some(why) = failure {
            failures.push(RecordError::new(&mcap, &why));
        }
        self.write_configuration();
        failures.append(&mut self.failures);
        failures.extend(parquet::export(&mcap, &self.folder).failures);
        failures.extend(folder::write_sums(&self.folder).err());
        let (dropped_samples, dropped_cycles) = self.shared.dropped();
        let (samples, cycles) = self.shared.in_file();
        Finished {
            samples,
            cycles,
            dropped_samples,
            dropped_cycles,
            failures,
        }
    }

    /// Ends the recording and removes it: what it held is safe elsewhere.
    ///
    /// # Errors
    /// A file can't be removed.
    pub fn discard(mut self) -> Result<(), RecordError> {
        self.close();
        std::fs::remove_dir_all(&self.folder)
            .map_err(|error| RecordError::new(&self.folder, &error))
    }

    /// Writes `configuration.json`: at the start, so that it is there whatever happens, and with
    /// the zeros at the end.
    fn write_configuration(&mut self) {
        let mut json: serde_json::Map<String, serde_json::Value> = self
            .metadata
            .pairs()
            .into_iter()
            .map(|(key, value)| (key, value.into()))
            .collect();
        json.insert(
            "rig".to_owned(),
            serde_json::to_value(&self.metadata.rig).unwrap_or_default(),
        );
        if let Some(record) = self.metadata.rig.calibration.as_deref() {
            // As it was in force, with covariances, and what it says of the force that was held.
            let uncertainty = (self.steady).uncertainty(record, self.metadata.rig.pose_sd_m);
            for (key, value) in [
                ("calibration", serde_json::to_value(record)),
                ("force_uncertainty", serde_json::to_value(uncertainty)),
            ] {
                json.insert(key.to_owned(), value.unwrap_or_default());
            }
        }
        let list: Vec<_> = self
            .configurations
            .iter()
            .enumerate()
            .map(|(index, configs)| {
                serde_json::json!({
                    "configuration": index,
                    "board_config_crc32": configuration_pairs(0, configs)["board_config_crc32"],
                    "board_config": configs,
                })
            })
            .collect();
        if let Some(last) = list.last() {
            json.insert("board_config".to_owned(), last["board_config"].clone());
            json.insert(
                "board_config_crc32".to_owned(),
                last["board_config_crc32"].clone(),
            );
        }
        json.insert("configurations".to_owned(), list.into());
        let text = serde_json::to_string_pretty(&json).unwrap_or_default();
        if let Err(error) = folder::replace(&self.folder.join(JSON_FILE), text.as_bytes()) {
            self.failures.push(error);
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}
