//! Recordings: read back, on a slow disk, on a full one. Killed processes are in
//! `host-cli/tests/recording.rs`.

use super::read::{End, Entry, Reader};
use super::rows::{CycleRow, EventRow, SampleRow, FAULT, PHASES, SAMPLE_TOPICS};
use super::table::{Row, Table};
use super::*;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::record::RowAccessor;
use rig::{board_crc, Rig};
use run::{Observer, Options, Phase};
use session::clock::Reading;
use session::link::fake::{Behavior, FakeBoard};
use session::{Received, TimedSample};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use wire::message::{CellCorrection, Sample, UnitConfig};
use wire::UNITS;

/// Feeds a recorder as the command line does.
struct Recording(Recorder);

impl Observer for Recording {
    fn progress(&mut self, phase: Phase, _: f64) {
        self.0.phase(phase);
    }
    fn notice(&mut self, text: &str) {
        self.0.notice(text);
    }
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        self.0.configured(configs);
    }
    fn received(&mut self, received: &Received) {
        self.0.received(received);
    }
    fn step(&mut self, step: &force::metrics::Step) {
        self.0.cycle(step);
    }
}

/// What arrives in the nth 10 ms: 20 samples.
fn received(n: u64) -> Received {
    let host_ns = 3_000_000_000 + n * 10_000_000;
    let samples = (0..20u64)
        .map(|k| TimedSample {
            t_us: 1_000_000 + n * 10_000 + k * 500,
            sample: Sample {
                unit: (k % 6) as u8,
                adc_code: (n * 20 + k) as i32,
                ..Sample::default()
            },
        })
        .collect();
    Received {
        samples,
        readings: vec![Reading {
            board_us: 1_000_000 + n * 10_000 + 9_500,
            sent_ns: Some(host_ns - 1_000_000),
            received_ns: host_ns,
        }],
        host_ns,
        utc_ns: 1_790_000_000_000_000_000 + host_ns,
        ..Received::default()
    }
}

fn metadata() -> Metadata {
    Metadata::new(&Rig::built_in().unwrap(), true).with("trial", 3)
}

/// All entries of a file, and how it ends.
fn entries(path: &std::path::Path) -> (Vec<Entry>, End) {
    let mut reader = Reader::open(path).unwrap();
    let entries = reader.by_ref().collect();
    (entries, reader.end().clone())
}

fn rows<R: Row>(entries: &[Entry]) -> Vec<R> {
    entries
        .iter()
        .filter_map(|entry| match entry {
            Entry::Message { topic, data, .. } if topic == R::TABLE.topic => {
                Some(serde_json::from_slice(data).unwrap())
            }
            _ => None,
        })
        .collect()
}

/// A run on the board in memory.
fn run_into(folder: &std::path::Path) -> Finished {
    let rig = Rig::built_in().unwrap();
    let mut recording = Recording(Recorder::create(folder, &metadata()).unwrap());
    let mut board = FakeBoard::new(Behavior::Good);
    let options = Options::new([0.0, 1.0, 0.0], 1.5);
    run::set_force(&mut board, &rig, &options, &mut recording).unwrap();
    recording.0.finish()
}

#[test]
fn a_run_reads_back_with_phases_configurations_and_clocks() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("rec");
    let finished = run_into(&folder).complete().unwrap();
    assert_eq!((finished.dropped_samples, finished.dropped_cycles), (0, 0));
    let (entries, end) = entries(&folder.join(MCAP_FILE));
    assert_eq!(end, End::Complete);
    let samples: Vec<SampleRow> = rows(&entries);
    let cycles: Vec<CycleRow> = rows(&entries);
    assert_eq!(samples.len() as u64, finished.samples);
    assert_eq!(cycles.len() as u64, finished.cycles);
    assert_eq!(cycles.len(), 400);

    // Each row is converted with the configuration that it names.
    let mut configs: BTreeMap<i32, [UnitConfig; UNITS]> = BTreeMap::new();
    for entry in &entries {
        if let Entry::Metadata { name, pairs } = entry {
            if name == CONFIGURATION_METADATA {
                let list: [UnitConfig; UNITS] =
                    serde_json::from_str(&pairs["board_config"]).unwrap();
                assert_eq!(
                    pairs["board_config_crc32"],
                    format!("{:08x}", board_crc(&list))
                );
                configs.insert(pairs["configuration"].parse().unwrap(), list);
            }
        }
    }
    // The board's at first, the rig file's, with zeros, calibrated.
    assert!(configs.len() >= 4, "{:?}", configs.keys());
    for row in &samples {
        let config = &configs[&row.configuration][row.unit as usize - 1];
        let force_n = (f64::from(row.adc_code) - f64::from(config.zero_code))
            * f64::from(config.scale_pn_per_count)
            * 1e-12;
        assert!((row.load_cell_n - force_n).abs() < 1e-9, "{row:?}");
    }
    // While a force is held, the board's tension is that of the row's configuration.
    let held = samples.iter().rfind(|row| row.phase == "holding").unwrap();
    assert_eq!(held.configuration, *configs.keys().next_back().unwrap());

    // The phases come in their order, in both tables.
    let order = |phases: Vec<&str>| {
        let mut order: Vec<String> = Vec::new();
        for phase in phases {
            assert!(PHASES.contains(&phase), "{phase}");
            if order.last().is_none_or(|last| last != phase) {
                order.push(phase.to_owned());
            }
        }
        order
    };
    let of_samples = order(samples.iter().map(|row| row.phase.as_str()).collect());
    assert_eq!(
        of_samples,
        [
            "preparing",
            "zeroing",
            "calibrating",
            "arming",
            "moving",
            "holding",
            "ramping"
        ]
    );
    let of_cycles = order(cycles.iter().map(|row| row.phase.as_str()).collect());
    assert_eq!(of_cycles, ["arming", "moving", "holding"]);
    assert!(cycles
        .iter()
        .all(|row| (row.phase == "holding") == (row.since_command_s > 1e-6)));

    // The three clocks agree: the board in memory has the host's clock.
    for times in samples
        .iter()
        .map(Row::times)
        .chain(cycles.iter().map(Row::times))
    {
        assert!((times.host_s - times.board_s).abs() < 5e-3, "{times:?}");
    }
    for pair in cycles.windows(2) {
        let passed_s = (pair[1].utc.ns() - pair[0].utc.ns()) as f64 * 1e-9;
        assert!((passed_s - 0.01).abs() < 1e-6, "{passed_s}");
    }
}

#[test]
fn parquet_files_hold_the_same_rows_with_metadata_and_better_clocks() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("rec");
    let finished = run_into(&folder).complete().unwrap();
    let (entries, _) = entries(&folder.join(MCAP_FILE));
    let samples: Vec<SampleRow> = rows(&entries);
    let reader =
        SerializedFileReader::new(File::open(folder.join("samples.parquet")).unwrap()).unwrap();
    let file = reader.metadata().file_metadata();
    assert_eq!(file.num_rows() as u64, finished.samples);
    let pairs = file.key_value_metadata().unwrap();
    let value = |key: &str| {
        let found = pairs.iter().find(|pair| pair.key == key);
        found.and_then(|pair| pair.value.clone()).unwrap()
    };
    assert_eq!(value("trial"), "3");
    assert_eq!(value("format"), FORMAT);
    assert_eq!(value("rig_hash_sha256"), Rig::built_in().unwrap().hash());
    let last = samples.last().unwrap().configuration;
    assert_eq!(
        value("board_config"),
        value(&format!("board_config.{last}"))
    );
    let mut checked = 0;
    for (row, sample) in reader.get_row_iter(None).unwrap().zip(&samples) {
        let row = row.unwrap();
        let column = |name: &str| row.get_column_iter().position(|(n, _)| n == name).unwrap();
        let double = |name: &str| row.get_double(column(name)).unwrap();
        assert_eq!(row.get_string(column("phase")).unwrap(), &sample.phase);
        assert_eq!(row.get_int(column("unit")).unwrap(), sample.unit);
        assert_eq!(double("board_s"), sample.board_s);
        assert_eq!(double("load_cell_n"), sample.load_cell_n);
        // The board in memory has the host's clock, and half a cycle of delay is all that is not
        // known.
        assert!(
            (double("host_s") - sample.board_s).abs() < 1.1e-3,
            "{sample:?}"
        );
        checked += 1;
    }
    assert_eq!(checked, samples.len());
    let reader =
        SerializedFileReader::new(File::open(folder.join("cycles.parquet")).unwrap()).unwrap();
    let row = reader.get_row_iter(None).unwrap().next().unwrap().unwrap();
    let column = |name: &str| row.get_column_iter().position(|(n, _)| n == name).unwrap();
    assert!(row.get_double(column("true_tension_n_6")).is_ok());
    assert!(row.get_double(column("since_command_s")).unwrap() < -2.0);
}

#[test]
fn every_message_has_the_form_of_its_schema_and_no_more() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("rec");
    let _ = run_into(&folder);
    let bytes = std::fs::read(folder.join(MCAP_FILE)).unwrap();
    let mut validators = BTreeMap::new();
    let mut topics = BTreeSet::new();
    // As any reader of MCAP files sees it.
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        assert_eq!(schema.encoding, "jsonschema");
        let validator = validators.entry(schema.id).or_insert_with(|| {
            let schema: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
            for (name, field) in schema["properties"].as_object().unwrap() {
                assert!(
                    field["type"].is_string(),
                    "{name}: one type, which viewers want"
                );
            }
            jsonschema::validator_for(&schema).unwrap()
        });
        let data: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        let mistakes: Vec<String> = validator
            .iter_errors(&data)
            .map(|e| e.to_string())
            .collect();
        assert!(
            mistakes.is_empty(),
            "{}: {mistakes:?}: {data}",
            message.channel.topic
        );
        topics.insert(message.channel.topic.clone());
    }
    let of_tables = TABLES.iter().flat_map(|table| table.topics).copied();
    let drawn = foxglove::topics().into_iter().map(|(topic, ..)| topic);
    let expected: BTreeSet<String> = of_tables.chain(drawn).map(str::to_owned).collect();
    assert_eq!(topics, expected);
}

#[test]
fn a_message_that_lacks_a_field_or_has_one_more_is_not_of_the_schema() {
    let row = SampleRow::new(
        super::rows::At {
            times: table::Times {
                utc: table::Utc::from_ns(5),
                host_s: 1.0,
                board_s: 1.0,
            },
            phase: "holding",
            configuration: 0,
        },
        &TimedSample {
            t_us: 0,
            sample: Sample::default(),
        },
        &Rig::built_in().unwrap().units.map(|unit| unit.to_wire()),
        0.0,
    );
    let table: Table = SampleRow::TABLE;
    let validator = jsonschema::validator_for(&table.json_schema()).unwrap();
    let good = serde_json::to_value(&row).unwrap();
    assert!(validator.is_valid(&good));
    for (key, value) in [
        ("unit", serde_json::json!("3")),
        ("tension_n", serde_json::Value::Null),
        ("more", serde_json::json!(1)),
    ] {
        let mut wrong = good.clone();
        wrong[key] = value;
        assert!(!validator.is_valid(&wrong), "{key}");
    }
}

#[test]
fn a_fault_has_the_time_at_which_the_board_latched_it() {
    // Also where the board's 32 bits have wrapped since.
    for wraps in [0, 1 << 32] {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let mut recorder = on(&disk, folder.path());
        let mut first = received(0);
        let shift = |received: &mut Received| {
            let by_us = if wraps == 0 { 0 } else { wraps - 1_012_000 };
            received.samples.iter_mut().for_each(|s| s.t_us += by_us);
            received
                .readings
                .iter_mut()
                .for_each(|r| r.board_us += by_us);
        };
        shift(&mut first);
        recorder.received(&first);
        let mut second = received(1);
        shift(&mut second);
        // Latched with the third sample, which is 6.5 ms older than the newest reading.
        let latched = second.samples[6].t_us;
        second.faults.push(wire::message::FaultReport {
            t_us: latched as u32,
            unit: 2,
            code: 33,
            detail: 0,
        });
        recorder.received(&second);
        assert!(
            recorder.finish().complete().is_err(),
            "the file is elsewhere"
        );
        std::fs::write(folder.path().join(MCAP_FILE), &*disk.bytes.lock().unwrap()).unwrap();
        let (entries, _) = entries(&folder.path().join(MCAP_FILE));
        let samples: Vec<SampleRow> = rows(&entries);
        let events: Vec<EventRow> = rows(&entries);
        let fault = events.iter().find(|event| event.name == FAULT).unwrap();
        let with = &samples[20 + 6];
        assert_eq!(fault.board_s, with.board_s, "{wraps}");
        assert_eq!((fault.utc, fault.host_s), (with.utc, with.host_s));
        // Parquet has the better clocks, and the same moment.
        let exported = export(folder.path(), folder.path());
        assert!(exported.failures.is_empty(), "{:?}", exported.failures);
        let column = |file: &str, name: &str| -> Vec<f64> {
            let file = File::open(folder.path().join(file)).unwrap();
            let reader = SerializedFileReader::new(file).unwrap();
            let rows = reader.get_row_iter(None).unwrap().map(Result::unwrap);
            rows.map(|row| {
                let at = row.get_column_iter().position(|(n, _)| n == name).unwrap();
                row.get_double(at).unwrap()
            })
            .collect()
        };
        let host_s = column("events.parquet", "host_s");
        assert!(host_s.contains(&column("samples.parquet", "host_s")[26]));
    }
}

#[test]
fn a_folder_without_its_tables_or_hashes_is_not_whole() {
    use std::fs;
    use std::path::Path;
    let temporary = tempfile::tempdir().unwrap();
    let whole = temporary.path().join("rec");
    run_into(&whole).complete().unwrap();
    let found = |folder: &Path| check::check(folder).unwrap().problems;
    // What the fake board lacks, in a folder with all of its files.
    let usual = found(&whole);
    let none = |problems: &[String]| !problems.iter().any(|text| text.contains(SUMS_FILE));
    assert!(none(&usual), "{usual:?}");
    let remove = |folder: &Path, ends: &str| {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.to_str().unwrap().ends_with(ends) {
                fs::remove_file(path).unwrap();
            }
        }
    };
    // What was done, and words of each problem that it makes.
    type Case<'a> = (&'a str, &'a dyn Fn(&Path), &'a [&'a str]);
    let cases: [Case<'_>; 8] = [
        (
            "no tables, no hashes",
            &|folder| {
                remove(folder, ".parquet");
                remove(folder, SUMS_FILE);
            },
            &[
                "missing: samples.parquet, cycles.parquet",
                "missing: SHA256SUMS",
            ],
        ),
        (
            "a table that was cut",
            &|folder| {
                remove(folder, SUMS_FILE);
                let file = File::options()
                    .write(true)
                    .open(folder.join("samples.parquet"));
                file.unwrap().set_len(1000).unwrap();
            },
            &["samples.parquet can't be read", "missing: SHA256SUMS"],
        ),
        (
            "hashes of nothing",
            &|folder| fs::write(folder.join(SUMS_FILE), "").unwrap(),
            &["SHA256SUMS does not list all files; whether run.mcap, configuration.json, samples"],
        ),
        (
            "no hash of one file",
            &|folder| {
                let text = fs::read_to_string(folder.join(SUMS_FILE)).unwrap();
                let lines = text.lines().filter(|line| !line.ends_with(JSON_FILE));
                let text: String = lines.map(|line| format!("{line}\n")).collect();
                fs::write(folder.join(SUMS_FILE), text).unwrap();
            },
            &["SHA256SUMS does not list all files; whether configuration.json changed"],
        ),
        (
            "a changed configuration",
            &|folder| {
                remove(folder, SUMS_FILE);
                fs::write(folder.join(JSON_FILE), "{}").unwrap();
            },
            &["missing: SHA256SUMS; whether run.mcap, configuration.json"],
        ),
        (
            "a recorder that was killed while it wrote",
            &|folder| {
                remove(folder, SUMS_FILE);
                for table in TABLES {
                    let path = folder.join(table.file);
                    if path.is_file() {
                        fs::rename(&path, path.with_extension("parquet.part")).unwrap();
                    }
                }
            },
            &["(a .part is there", "missing: SHA256SUMS"],
        ),
        (
            "one table, told once",
            &|folder| fs::remove_file(folder.join("cycles.parquet")).unwrap(),
            &["missing: cycles.parquet; `forcectl recording export "],
        ),
        (
            "no configuration",
            &|folder| fs::remove_file(folder.join(JSON_FILE)).unwrap(),
            &[
                "missing: configuration.json;",
                "configuration.json is missing, which",
            ],
        ),
    ];
    for (n, (what, change, words)) in cases.iter().enumerate() {
        let folder = temporary.path().join(n.to_string());
        fs::create_dir(&folder).unwrap();
        for entry in fs::read_dir(&whole).unwrap() {
            let entry = entry.unwrap();
            fs::copy(entry.path(), folder.join(entry.file_name())).unwrap();
        }
        change(&folder);
        let mut problems = found(&folder);
        problems.retain(|problem| !usual.contains(problem));
        assert_eq!(problems.len(), words.len(), "{what}: {problems:#?}");
        for (problem, words) in problems.iter().zip(*words) {
            assert!(problem.contains(words), "{what}: {problem}");
        }
        // The command that it names makes the tables, which are the same then.
        assert!(export(&folder, &folder).failures.is_empty());
        let problems = found(&folder);
        let left = |problem: &String| problem.contains(".parquet") && problem.contains("export");
        assert!(!problems.iter().any(left), "{what}: {problems:#?}");
    }
    // The MCAP file alone, by its name.
    let alone = temporary.path().join("alone.mcap");
    fs::copy(whole.join(MCAP_FILE), &alone).unwrap();
    assert_eq!(found(&alone), usual);
}

/// The same recording as version 2 had it: the samples of all units on one topic.
fn as_version_2(bytes: &[u8]) -> Vec<u8> {
    let mut old = mcap::Writer::new(io::Cursor::new(Vec::new())).unwrap();
    let mut pairs = metadata().pairs();
    pairs.insert("format".to_owned(), FORMATS[0].to_owned());
    let record = mcap::records::Metadata {
        name: METADATA.to_owned(),
        metadata: pairs,
    };
    old.write_metadata(&record).unwrap();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        let schema = (old.add_schema(&schema.name, &schema.encoding, &schema.data)).unwrap();
        let topic = match message.channel.topic.as_str() {
            topic if topic.starts_with("/sample/") => "/sample",
            topic => topic,
        };
        let channel = old.add_channel(schema, topic, "json", &BTreeMap::new());
        let header = mcap::records::MessageHeader {
            channel_id: channel.unwrap(),
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        old.write_to_known_channel(&header, &message.data).unwrap();
    }
    old.finish().unwrap();
    old.into_inner().into_inner()
}

#[test]
fn a_recording_of_version_2_reads_the_same_and_its_copy_has_a_topic_a_unit() {
    let temporary = tempfile::tempdir().unwrap();
    let new = temporary.path().join("new");
    let finished = run_into(&new).complete().unwrap();
    let old = temporary.path().join("old");
    std::fs::create_dir(&old).unwrap();
    let bytes = std::fs::read(new.join(MCAP_FILE)).unwrap();
    std::fs::write(old.join(MCAP_FILE), as_version_2(&bytes)).unwrap();

    let messages = |folder: &std::path::Path| -> Vec<Entry> {
        let (entries, end) = entries(&folder.join(MCAP_FILE));
        assert_eq!(end, End::Complete);
        let messages = entries.into_iter();
        messages
            .filter(|entry| matches!(entry, Entry::Message { .. }))
            .collect()
    };
    assert!(messages(&new) == messages(&old), "the same messages");
    let checked = check::check(&old).unwrap();
    assert_eq!(checked.messages["/sample"], finished.samples);
    assert_eq!(checked.units.len(), UNITS);
    assert!(!checked.problems.iter().any(|p| p.contains("the format")));

    let copy = old.join(REPAIRED_FILE);
    let repaired = repair(&old, &copy).unwrap();
    assert_eq!(repaired.end, End::Complete);
    let bytes = std::fs::read(&copy).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, repaired.messages);
    let mut of_units = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.topic.starts_with("/sample") {
            let row: SampleRow = serde_json::from_slice(&message.data).unwrap();
            assert_eq!(message.channel.topic, SAMPLE_TOPICS[row.unit as usize - 1]);
            *of_units.entry(row.unit).or_insert(0) += 1;
        }
    }
    assert_eq!(of_units.len(), UNITS);
    assert_eq!(of_units.values().sum::<u64>(), finished.samples);
    let (entries, _) = entries(&copy);
    assert!(entries.iter().any(|entry| matches!(entry,
        Entry::Metadata { name, pairs } if name == METADATA && pairs["format"] == FORMAT)));
    // A copy is not written over what it is made from.
    let error = repair(&copy, &copy).unwrap_err().to_string();
    assert!(error.contains("another folder"), "{error}");
    assert_eq!(std::fs::read(&copy).unwrap(), bytes);
}

#[test]
fn a_copy_of_a_recording_that_is_cut_anywhere_is_whole_and_has_what_can_be_read() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("rec");
    run_into(&folder).complete().unwrap();
    let bytes = std::fs::read(folder.join(MCAP_FILE)).unwrap();
    let cut = temporary.path().join("cut.mcap");
    let copy = temporary.path().join(REPAIRED_FILE);
    for share in 1..10 {
        std::fs::write(&cut, &bytes[..bytes.len() * share / 10]).unwrap();
        let repaired = repair(&cut, &copy).unwrap();
        assert_eq!(repaired.end, End::CutOff);
        let (of_cut, _) = entries(&cut);
        let (of_copy, end) = entries(&copy);
        assert_eq!(end, End::Complete);
        assert!(of_cut == of_copy, "{share}");
        let copied = std::fs::read(&copy).unwrap();
        let summary = mcap::Summary::read(&copied).unwrap().unwrap();
        let there = of_copy.iter();
        let there = there.filter(|entry| matches!(entry, Entry::Message { .. }));
        let there = there.count() as u64;
        assert_eq!(summary.stats.unwrap().message_count, there);
        assert_eq!((repaired.messages, there > 0), (there, true));
    }
}

#[test]
fn a_folder_with_a_recording_is_kept_and_one_of_a_failed_start_is_used_again() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("rec");
    // A start that failed: nothing was received. An older version left empty files too.
    let recorder = Recorder::create(&folder, &metadata()).unwrap();
    drop(recorder);
    std::fs::write(folder.join("samples.parquet"), "").unwrap();
    let mut recorder = Recorder::create(&folder, &metadata()).unwrap();
    assert!(
        folder.join(JSON_FILE).is_file(),
        "the configuration is there from the start"
    );
    recorder.received(&received(0));
    assert!(recorder.finish().failures.is_empty());
    let again = Recorder::create(&folder, &metadata())
        .unwrap_err()
        .to_string();
    assert!(again.contains("another folder"), "{again}");
    // Rows in the MCAP file are enough.
    std::fs::remove_file(folder.join("samples.parquet")).unwrap();
    assert!(Recorder::create(&folder, &metadata()).is_err());
}

#[test]
fn a_file_that_cannot_be_written_costs_only_itself() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("rec");
    let mut recorder = Recorder::create(&folder, &metadata()).unwrap();
    recorder.received(&received(0));
    recorder.phase(Phase::Hold);
    // A folder in its place.
    std::fs::create_dir(folder.join("events.parquet")).unwrap();
    let finished = recorder.finish();
    assert_eq!(finished.failures.len(), 1, "{:?}", finished.failures);
    assert!(finished.failures[0].path.ends_with("events.parquet"));
    let sums = std::fs::read_to_string(folder.join(SUMS_FILE)).unwrap();
    for name in [MCAP_FILE, JSON_FILE, "samples.parquet", "clock.parquet"] {
        assert!(sums.contains(name), "{sums}");
    }
    assert!(finished.complete().is_err());
}

/// A disk that can be stopped and filled.
#[derive(Clone, Default)]
struct Disk {
    /// Whether writes wait.
    stalled: Arc<(Mutex<bool>, Condvar)>,
    /// Whether writes fail half-way.
    full: Arc<AtomicBool>,
    bytes: Arc<Mutex<Vec<u8>>>,
}

impl Disk {
    fn stall(&self, stalled: bool) {
        *self.stalled.0.lock().unwrap() = stalled;
        self.stalled.1.notify_all();
    }
}

impl Storage for Disk {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let (stalled, changed) = &*self.stalled;
        let mut stalled = stalled.lock().unwrap();
        while *stalled {
            stalled = changed.wait(stalled).unwrap();
        }
        let full = self.full.load(Ordering::SeqCst);
        let mut all = self.bytes.lock().unwrap();
        all.truncate(offset as usize);
        all.extend_from_slice(&bytes[..if full { bytes.len() / 2 } else { bytes.len() }]);
        if full {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        Ok(())
    }
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.bytes.lock().unwrap().truncate(length as usize);
        Ok(())
    }
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn on(disk: &Disk, folder: &std::path::Path) -> Recorder {
    Recorder::create_on(folder, &metadata().never_waits(), Box::new(disk.clone())).unwrap()
}

/// The board takes a cell's curve and creep out; the unfiltered force lacks them as well.
#[test]
fn the_force_on_a_cell_is_that_of_the_board_s_conversion() {
    let folder = tempfile::tempdir().unwrap();
    let mut configs = Rig::built_in().unwrap().units.map(|unit| unit.to_wire());
    configs[1].cell = CellCorrection {
        curve_nn_per_n2: 10_000_000,
        creep_q16: 6_554,
        creep_ms: 1_000,
    };
    let mut recorder = Recorder::create(folder.path(), &metadata()).unwrap();
    recorder.configured(&configs);
    let newton_per_count = f64::from(configs[1].scale_pn_per_count) * 1e-12;
    let newton = |n: f64| (n / newton_per_count).round() as i32;
    // Slack, then a reading of 5 N: 5.25 N straightened, of which 0.1 / 1.1 is creep in the end.
    for n in 0..600 {
        let mut part = received(n);
        for sample in &mut part.samples {
            sample.sample.adc_code = if n < 10 { 0 } else { newton(5.0) };
        }
        recorder.received(&part);
    }
    // Another setting of the unit does not begin anew.
    configs[1].slew_un_per_s += 1;
    recorder.configured(&configs);
    let mut part = received(600);
    for sample in &mut part.samples {
        sample.sample.adc_code = newton(5.0);
    }
    recorder.received(&part);
    recorder.finish().complete().unwrap();
    let (entries, _) = entries(&folder.path().join(MCAP_FILE));
    let samples: Vec<SampleRow> = rows(&entries);
    let of = |unit: i32| samples.iter().filter(move |row| row.unit == unit);
    let first = of(2).find(|row| row.adc_code != 0).unwrap();
    assert!((first.load_cell_n - 5.25).abs() < 0.01, "{first:?}");
    let last = of(2).next_back().unwrap();
    assert!((last.load_cell_n - 5.25 / 1.1).abs() < 0.01, "{last:?}");
    let straight = of(1).next_back().unwrap();
    assert!((straight.load_cell_n - 5.0).abs() < 1e-5, "{straight:?}");
}

#[test]
fn a_disk_that_stalls_holds_nobody_up_and_what_is_dropped_is_counted_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let disk = Disk::default();
    let mut recorder = on(&disk, folder.path());
    disk.stall(true);
    // Until the queue is full and more: the disk goes on only after all of it was given, so a call
    // that waited for the disk would wait for ever.
    const CYCLES: u64 = 12_000;
    recorder.phase(Phase::Zero);
    for n in 0..CYCLES {
        recorder.received(&received(n));
        // Waits until the writer is in the stalled write: it takes what comes before that.
        if n == 0 {
            std::thread::sleep(2 * CHUNK_PERIOD);
        }
    }
    recorder.phase(Phase::Hold);
    assert!(recorder
        .trouble()
        .is_some_and(|text| text.contains("lacks samples")));
    assert_eq!(recorder.trouble(), None, "once");
    disk.stall(false);
    let finished = recorder.finish();
    assert!(finished.dropped_samples > 0);
    assert_eq!(finished.samples + finished.dropped_samples, CYCLES * 20);
    std::fs::write(folder.path().join(MCAP_FILE), &*disk.bytes.lock().unwrap()).unwrap();
    let (entries, end) = entries(&folder.path().join(MCAP_FILE));
    assert_eq!(end, End::Complete);
    assert_eq!(rows::<SampleRow>(&entries).len() as u64, finished.samples);
    let events: Vec<EventRow> = rows(&entries);
    let lost = format!("no room for {} samples", finished.dropped_samples);
    assert!(events
        .iter()
        .any(|event| event.name == "drops" && event.message.contains(&lost)));
    // A phase is never dropped.
    assert_eq!(events.last().unwrap().phase, "holding");
}

#[test]
fn a_full_disk_costs_nothing_where_room_comes_back_and_the_rest_where_it_does_not() {
    for room_comes_back in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let mut recorder = on(&disk, folder.path());
        let wait = || std::thread::sleep(2 * CHUNK_PERIOD);
        (0..100).for_each(|n| recorder.received(&received(n)));
        wait();
        recorder.received(&received(100));
        wait();
        let good = disk.bytes.lock().unwrap().len();
        disk.full.store(true, Ordering::SeqCst);
        (101..200).for_each(|n| recorder.received(&received(n)));
        wait();
        recorder.received(&received(200));
        wait();
        let text = recorder.trouble().unwrap();
        assert!(text.contains("tried again"), "{text}");
        // The system's words.
        let why = io::ErrorKind::StorageFull.to_string();
        assert!(text.contains(&why), "{text}");
        wait();
        assert_eq!(recorder.trouble(), None, "once");
        assert_eq!(disk.bytes.lock().unwrap().len(), good, "no part of a chunk");
        disk.full.store(!room_comes_back, Ordering::SeqCst);
        let finished = recorder.finish();
        std::fs::write(folder.path().join(MCAP_FILE), &*disk.bytes.lock().unwrap()).unwrap();
        let (entries, end) = entries(&folder.path().join(MCAP_FILE));
        let there = rows::<SampleRow>(&entries).len();
        if room_comes_back {
            assert_eq!((there, end), (201 * 20, End::Complete));
        } else {
            assert_eq!((there, end), (101 * 20, End::CutOff));
            let failure = finished.failures[0].to_string();
            let named = failure.contains(MCAP_FILE) && failure.contains(&why);
            assert!(named, "{failure}");
        }
        // What is told is what is in the file.
        assert_eq!(finished.samples, there as u64);
        assert_eq!(finished.samples + finished.dropped_samples, 201 * 20);
    }
}

#[test]
fn what_happens_before_the_first_sample_has_the_time_of_a_rig_that_was_there_before() {
    let folder = tempfile::tempdir().unwrap();
    let disk = Disk::default();
    let mut recorder = on(&disk, folder.path());
    recorder.phase(Phase::Zero);
    recorder.notice("something");
    // A service that has run for a while.
    let first = received(360_000);
    recorder.received(&first);
    let _ = recorder.finish();
    std::fs::write(folder.path().join(MCAP_FILE), &*disk.bytes.lock().unwrap()).unwrap();
    let (entries, _) = entries(&folder.path().join(MCAP_FILE));
    let events: Vec<EventRow> = rows(&entries);
    let named: Vec<&str> = events.iter().map(|event| event.name.as_str()).collect();
    assert_eq!(named, ["phase", "notice"]);
    let samples: Vec<SampleRow> = rows(&entries);
    for event in &events {
        assert_eq!(event.host_s, first.host_ns as f64 * 1e-9);
        // Within what arrived at once.
        assert!(event.timestamp.ns().abs_diff(samples[0].utc.ns()) < 20_000_000);
    }
}

#[test]
fn a_recording_of_a_calibrated_rig_has_calibration_and_uncertainty() {
    use known::base;
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("recording");
    let rig = Rig::built_in().unwrap();
    let rig = base::overlay(&rig, &base::nominal(&rig, "2026-11-22"));
    let mut recorder = Recorder::create(&folder, &Metadata::new(&rig, true)).unwrap();
    for t_s in [0.5, 2.0, 2.01] {
        recorder.cycle(&force::metrics::Step {
            t_s,
            tip_m: rig.workspace.center_m,
            commanded_n: [0.0, 2.5, 0.0].into(),
            estimated_n: [0.1; 3].into(),
            applied_n: None,
            tension_setpoint_n: [2.0; UNITS],
            measured_tension_n: [2.1; UNITS],
            true_tension_n: None,
            available: [true; UNITS],
        });
    }
    let _ = recorder.finish();
    let text = std::fs::read_to_string(folder.join(JSON_FILE)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["calibration"]["rig"], rig.name.as_str());
    let found = &json["force_uncertainty"];
    assert!(found["radius_95_n"].as_f64().unwrap() > 0.1, "{found}");
}
