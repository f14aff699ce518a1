//! The thread that writes: turns what was received into rows, and brings a chunk to the disk twice
//! a second.

use crate::error::text_of;
use crate::format::{CONFIGURATION_METADATA, METADATA, RIG_ATTACHMENT, TABLES};
use crate::foxglove::{self, Arrow, Scene, TipPose, TipTransform};
use crate::metadata::{configuration_pairs, Metadata};
use crate::queue::{Item, Shared};
use crate::rows::{At, ClockRow, CounterRow, CycleRow, EventRow, SampleRow, FAULT, OBSERVING};
use crate::sink::{Sink, Storage};
use crate::table::{row, ColumnTable, Row, Times, Utc};
use crate::utc::UtcClock;
use control::cell::CellForce;
use force::metrics::Step;
use known::uncertainty::Running;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use serde::Serialize;
use session::clock::{Bin, BoardClock, Estimate, Reading};
use session::{LatchedFault, Received};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wire::message::UnitConfig;
use wire::UNITS;

/// Time between two chunks. What is received in it is lost where the process is killed.
pub const CHUNK_PERIOD: Duration = Duration::from_millis(500);
/// Bytes of messages after which a chunk is complete before its time: what a disk that gets full
/// costs at most.
const CHUNK_BYTES: usize = 1 << 20;
/// Bytes that are kept in memory while the disk takes none. More is dropped and counted.
const BACKLOG_MAX: u64 = 64 << 20;
/// Host time between two rows of counters, ns.
const COUNTERS_PERIOD_NS: u64 = 1_000_000_000;

/// Levels of `foxglove.Log`.
const INFORMATION: i32 = 2;
const WARNING: i32 = 3;
const ERROR: i32 = 4;

/// An error of the MCAP file.
pub(super) type McapError = Box<dyn std::error::Error + Send + Sync>;

struct Topic {
    channel: u16,
    sequence: u32,
}

/// The MCAP file and what rows need.
pub(super) struct Writer {
    mcap: mcap::Writer<NoSeek<Sink>>,
    topics: BTreeMap<&'static str, Topic>,
    columns: Vec<ColumnTable>,
    backlog: Arc<AtomicU64>,
    shared: Arc<Shared>,
    clock: BoardClock,
    estimate: Option<Estimate>,
    utc: UtcClock,
    configs: [UnitConfig; UNITS],
    /// Forces on the cells by these.
    cells: [CellForce; UNITS],
    configuration: i32,
    phase: &'static str,
    /// Host time of the newest of what was received, ns.
    host_ns: u64,
    /// The newest reading of the board's clock, us.
    board_us: u64,
    counters_due_ns: u64,
    board_counts: Option<(u64, u64, u64)>,
    dropped_before: (u64, u64),
    failing: bool,
    /// Bytes of messages since the last chunk.
    chunk_bytes: usize,
    /// Samples and cycles among the rows so far.
    rows: (u64, u64),
    /// What happened before anything told the time of the link: a service's began long before.
    early: Vec<Item>,
    timed: bool,
    /// The uncertainty of each cycle's estimate, where the rig has a calibration.
    uncertainty: Option<Running>,
}

impl Writer {
    /// Writes header, schemas and metadata.
    ///
    /// # Errors
    /// The storage takes nothing.
    pub(super) fn create(
        storage: Box<dyn Storage>,
        metadata: &Metadata,
        shared: Arc<Shared>,
    ) -> Result<Self, McapError> {
        let (sink, backlog) = Sink::new(storage);
        let mut mcap = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Lz4))
            .disable_seeking(true)
            .library(format!("forcectl {}", env!("CARGO_PKG_VERSION")))
            .create(NoSeek::new(sink))?;
        let mut topics = BTreeMap::new();
        let mut add = |topic: &'static str, name: &str, schema: &str| -> Result<(), McapError> {
            let schema = mcap.add_schema(name, "jsonschema", schema.as_bytes())?;
            let channel = mcap.add_channel(schema, topic, "json", &BTreeMap::new())?;
            topics.insert(
                topic,
                Topic {
                    channel,
                    sequence: 0,
                },
            );
            Ok(())
        };
        for table in TABLES {
            let schema = table.json_schema().to_string();
            for topic in table.topics {
                add(topic, table.schema_name, &schema)?;
            }
        }
        for table in &metadata.columns {
            let schema = table.json_schema().to_string();
            add(table.topic, table.schema_name, &schema)?;
        }
        for (topic, name, schema) in foxglove::topics() {
            add(topic, name, &schema.to_string())?;
        }
        mcap.write_metadata(&mcap::records::Metadata {
            name: METADATA.to_owned(),
            metadata: metadata.pairs(),
        })?;
        mcap.attach(&mcap::Attachment {
            log_time: metadata.utc_start.ns(),
            create_time: metadata.utc_start.ns(),
            name: RIG_ATTACHMENT.to_owned(),
            media_type: "application/json".to_owned(),
            data: metadata.rig_json().into(),
        })?;
        let configs = metadata.rig.units.map(|unit| unit.to_wire());
        let mut writer = Self {
            mcap,
            topics,
            columns: metadata.columns.clone(),
            backlog,
            shared,
            clock: BoardClock::live(),
            estimate: None,
            utc: UtcClock::new(metadata.emulated, metadata.utc_start.ns()),
            configs,
            cells: configs.each_ref().map(CellForce::new),
            configuration: -1,
            phase: OBSERVING,
            host_ns: 0,
            board_us: 0,
            counters_due_ns: 0,
            board_counts: None,
            dropped_before: (0, 0),
            failing: false,
            chunk_bytes: 0,
            rows: (0, 0),
            early: Vec::new(),
            timed: false,
            uncertainty: (metadata.rig.calibration.as_deref())
                .map(|record| Running::new(record, metadata.rig.pose_sd_m)),
        };
        writer.mcap.flush()?;
        Ok(writer)
    }

    /// Writes what comes until the other end is closed, then completes the file.
    pub(super) fn run(mut self, items: &Receiver<Item>) {
        let mut due = Instant::now() + CHUNK_PERIOD;
        loop {
            match items.recv_timeout(due.saturating_duration_since(Instant::now())) {
                Ok(item) => self.take(item),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if Instant::now() >= due || self.chunk_bytes >= CHUNK_BYTES {
                self.flush();
                due = Instant::now() + CHUNK_PERIOD;
            }
        }
        self.time_is_known();
        self.note_drops();
        if let Some(bin) = self.clock.open_bin() {
            self.write_clock(&bin);
        }
        let finished = self.mcap.finish();
        let mut sink = self.mcap.into_inner().into_inner();
        let stored = std::io::Write::flush(&mut sink).and_then(|()| sink.sync());
        match finished
            .map_err(McapError::from)
            .and(stored.map_err(Into::into))
        {
            Ok(()) => self.shared.stored(self.rows),
            Err(error) => {
                self.shared.never_stored(self.rows);
                self.shared.fail(&text_of(&*error));
            }
        }
    }

    /// Brings the chunk to the disk. Where that fails, it is tried again with the next one.
    fn flush(&mut self) {
        self.chunk_bytes = 0;
        match self.mcap.flush() {
            Ok(()) => {
                self.shared.stored(self.rows);
                if self.failing {
                    self.failing = false;
                    self.event(WARNING, "drops", "the disk takes data again");
                }
            }
            Err(error) => {
                self.failing = true;
                self.shared.trouble(&text_of(&error));
            }
        }
    }

    fn take(&mut self, item: Item) {
        match item {
            Item::Phase(_) | Item::Configured(_) | Item::Notice(_) if !self.timed => {
                self.early.push(item);
                return;
            }
            _ => self.note_drops(),
        }
        match item {
            Item::Received(received) => self.received(&received),
            Item::Cycle(step, host_ns) => {
                self.host_ns = self.host_ns.max(host_ns);
                self.time_is_known();
                self.cycle(&step);
            }
            Item::Phase(name) => {
                if self.phase != name {
                    self.phase = name;
                    self.event(INFORMATION, "phase", name);
                }
            }
            Item::Configured(configs) => self.configured(&configs),
            Item::Notice(text) => self.event(WARNING, "notice", &text),
            Item::Columns(topic, board_s, values) => self.columns(topic, board_s, &values),
            Item::Metadata(name, pairs) => self.metadata(&name, pairs),
        }
    }

    /// Takes what waited for a time.
    fn time_is_known(&mut self) {
        self.timed = true;
        for item in std::mem::take(&mut self.early) {
            self.take(item);
        }
    }

    fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) {
        let record = mcap::records::Metadata {
            name: name.to_owned(),
            metadata,
        };
        let written = self.mcap.write_metadata(&record);
        self.check(written.map_err(Into::into));
    }

    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        if self.configuration >= 0 && self.configs == *configs {
            return;
        }
        for ((cell, old), new) in self.cells.iter_mut().zip(&self.configs).zip(configs) {
            // The creep of a cell goes on where other settings change.
            if CellForce::new(old) != CellForce::new(new) {
                *cell = CellForce::new(new);
            }
        }
        self.configs = *configs;
        self.configuration += 1;
        let pairs = configuration_pairs(self.configuration, configs);
        let crc = pairs["board_config_crc32"].clone();
        self.metadata(CONFIGURATION_METADATA, pairs);
        let text = format!(
            "configuration {} is in force, CRC {crc}",
            self.configuration
        );
        self.event(INFORMATION, "configuration", &text);
    }

    fn received(&mut self, received: &Received) {
        self.host_ns = received.host_ns;
        if let Some(step_ns) = self.utc.push(received.host_ns, received.utc_ns) {
            let text = format!(
                "this machine's UTC was set by {:+.3} s",
                step_ns as f64 * 1e-9
            );
            self.event(WARNING, "clock", &text);
        }
        self.time_is_known();
        for reading in &received.readings {
            self.read_clock(reading);
        }
        if self.estimate.is_none() {
            if let Some(newest) = received.samples.last() {
                self.read_clock(&Reading {
                    board_us: newest.t_us,
                    sent_ns: None,
                    received_ns: received.host_ns,
                });
            }
        }
        for timed in &received.samples {
            let host_ns = self.host_of(timed.t_us);
            let cell = self.cells.get_mut(usize::from(timed.sample.unit));
            let load_cell_n = cell.map_or(0.0, |cell| cell.at(timed.sample.adc_code, timed.t_us));
            let row = SampleRow::new(
                self.at(host_ns, timed.t_us as f64 * 1e-6),
                timed,
                &self.configs,
                load_cell_n,
            );
            self.rows.0 += u64::from(self.write_row(&row));
        }
        for fault in &received.faults {
            let at = self.latched(fault.t_us);
            let text = LatchedFault::from(fault).to_string();
            self.event_at(at, ERROR, FAULT, &text);
        }
        if let Some(status) = &received.status {
            self.board_counts = Some((
                u64::from(status.frames_dropped),
                u64::from(status.frames_bad),
                status.units.iter().map(|unit| u64::from(unit.missed)).sum(),
            ));
        }
        if self.host_ns >= self.counters_due_ns {
            self.counters_due_ns = self.host_ns + COUNTERS_PERIOD_NS;
            self.write_counters(received);
        }
    }

    fn read_clock(&mut self, reading: &Reading) {
        self.board_us = reading.board_us;
        let completed = self.clock.push(reading);
        if let Some(bin) = completed {
            self.estimate = self.clock.at(reading.board_us);
            self.write_clock(&bin);
        } else if self
            .estimate
            .is_none_or(|estimate| estimate.uncertainty_ns.is_infinite())
        {
            self.estimate = self.clock.at(reading.board_us);
        }
    }

    fn write_clock(&mut self, bin: &Bin) {
        let Some(estimate) = self.estimate else {
            return;
        };
        let host_of = |bound: session::clock::Bound| {
            let host_ns = bound.offset_ns + bound.board_us as i64 * 1000;
            u64::try_from(host_ns).unwrap_or(0)
        };
        let finite = |ns: f64| ns.is_finite().then_some(ns * 1e-9);
        let at = self.at(
            self.host_of(estimate.board_us),
            estimate.board_us as f64 * 1e-6,
        );
        let row = row!(ClockRow, at, {
            offset_s: estimate.offset_ns * 1e-9,
            offset_uncertainty_s: finite(estimate.uncertainty_ns),
            drift_ppm: estimate.drift * 1e6,
            drift_uncertainty_ppm: estimate.drift_uncertainty * 1e6,
            contradiction_s: estimate.contradiction_ns * 1e-9,
            utc_offset_s: self.utc.offset_ns() as f64 * 1e-9,
            request_board_us: bin.lower.map(|bound| bound.board_us),
            request_host_ns: bin.lower.map(host_of),
            arrival_board_us: bin.upper.map(|bound| bound.board_us),
            arrival_host_ns: bin.upper.map(host_of),
        });
        self.write_row(&row);
    }

    fn write_counters(&mut self, received: &Received) {
        let (samples, cycles) = self.shared.dropped();
        let counters = received.counters;
        let row = row!(CounterRow, self.now(), {
            frames: counters.frames,
            frames_lost: counters.frames_lost,
            frames_bad: counters.frames_bad,
            retries: counters.retries,
            board_dropped: self.board_counts.map(|counts| counts.0),
            board_bad: self.board_counts.map(|counts| counts.1),
            conversions_missed: self.board_counts.map(|counts| counts.2),
            recorder_dropped_samples: samples,
            recorder_dropped_cycles: cycles,
        });
        self.write_row(&row);
    }

    fn cycle(&mut self, step: &Step) {
        let estimated_95_n = (self.uncertainty.as_mut()).and_then(|known| known.radius_95_n(step));
        let row = CycleRow::new(self.now(), step, estimated_95_n);
        self.rows.1 += u64::from(self.write_row(&row));
        let (utc, tip_m) = (row.utc, row.tip_m);
        let arrows = [
            Arrow::commanded(row.commanded_n),
            Arrow::measured(row.estimated_n),
        ];
        self.write(TipPose::TOPIC, utc, &TipPose::new(utc, tip_m));
        let transform = TipTransform::message(utc, tip_m);
        self.write(TipTransform::TOPIC, utc, &transform);
        self.write(Scene::TOPIC, utc, &Scene::message(utc, tip_m, &arrows));
    }

    fn columns(&mut self, topic: &'static str, board_s: f64, values: &[f64]) {
        let Some(table) = self.columns.iter().find(|table| table.topic == topic) else {
            return;
        };
        let host_ns = self.host_of((board_s * 1e6) as u64);
        let utc = self.at(host_ns, board_s).times.utc;
        let message = table.message(utc, values);
        self.write(topic, utc, &message);
    }

    fn event(&mut self, level: i32, name: &str, message: &str) {
        self.event_at(self.now(), level, name, message);
    }

    fn event_at(&mut self, at: At<'static>, level: i32, name: &str, message: &str) {
        let row = row!(EventRow, at, {
            timestamp: at.times.utc,
            level: level,
            name: name.to_owned(),
            message: message.to_owned(),
            file: String::new(),
            line: 0,
        });
        self.write_row(&row);
    }

    /// Records that something was dropped, where it happened.
    fn note_drops(&mut self) {
        let dropped = self.shared.dropped();
        if dropped == self.dropped_before || self.full() {
            return;
        }
        let (samples, cycles) = (
            dropped.0 - self.dropped_before.0,
            dropped.1 - self.dropped_before.1,
        );
        self.dropped_before = dropped;
        let text = format!("the recorder had no room for {samples} samples and {cycles} cycles before this: the disk was too slow or full");
        self.event(ERROR, "drops", &text);
    }

    /// Whether the disk has taken nothing for so long that nothing more is kept.
    fn full(&self) -> bool {
        self.backlog.load(Ordering::Relaxed) > BACKLOG_MAX
    }

    /// Host time of a board time, ns.
    fn host_of(&self, board_us: u64) -> f64 {
        self.estimate
            .map_or(self.host_ns as f64, |estimate| estimate.host_ns(board_us))
    }

    fn now(&self) -> At<'static> {
        let host_ns = self.host_ns as f64;
        let board_us = self
            .estimate
            .map_or(0.0, |estimate| estimate.board_us(host_ns));
        self.at(host_ns, board_us * 1e-6)
    }

    /// When the board latched a fault, by its clock of 32 bits.
    fn latched(&self, t_us: u32) -> At<'static> {
        if self.estimate.is_none() {
            return self.now();
        }
        let since_us = t_us.wrapping_sub(self.board_us as u32) as i32;
        let board_us = self.board_us.saturating_add_signed(i64::from(since_us));
        self.at(self.host_of(board_us), board_us as f64 * 1e-6)
    }

    fn at(&self, host_ns: f64, board_s: f64) -> At<'static> {
        At {
            times: Times {
                utc: Utc::from_ns(self.utc.of(host_ns)),
                host_s: host_ns * 1e-9,
                board_s,
            },
            phase: self.phase,
            configuration: self.configuration,
        }
    }

    /// Writes a row; `false` where there is no room.
    fn write_row<R: Row>(&mut self, row: &R) -> bool {
        self.write(row.topic(), row.times().utc, row)
    }

    fn write(&mut self, topic: &'static str, utc: Utc, message: &impl Serialize) -> bool {
        if self.full() {
            if SampleRow::TABLE.topics.contains(&topic) {
                self.shared.drop_samples(1);
            } else if topic == CycleRow::TABLE.topic {
                self.shared.drop_cycles(1);
            }
            return false;
        }
        let Some(topic) = self.topics.get_mut(topic) else {
            return false;
        };
        let header = MessageHeader {
            channel_id: topic.channel,
            sequence: topic.sequence,
            log_time: utc.ns(),
            publish_time: utc.ns(),
        };
        topic.sequence = topic.sequence.wrapping_add(1);
        let written = serde_json::to_vec(message)
            .map_err(McapError::from)
            .and_then(|bytes| {
                self.chunk_bytes += bytes.len();
                Ok(self.mcap.write_to_known_channel(&header, &bytes)?)
            });
        self.check(written);
        true
    }

    /// Errors here are not the disk's, which show in `flush`.
    fn check(&self, written: Result<(), McapError>) {
        if let Err(error) = written {
            self.shared.fail(&text_of(&*error));
        }
    }
}
