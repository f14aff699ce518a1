//! Recordings of the program itself: killed, terminated, on a full disk, read by others.
#![cfg(all(feature = "record", unix))]

mod common;
#[path = "../../estimator/tests/python/mod.rs"]
mod python;

use common::{expect, folder, forcectl, run, said, signal, signals, words};
use python::python;
use recording::check::check;
use recording::read::{End, Entry, Reader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

/// A run that lasts, once its recording holds some chunks.
fn recording(folder: &Path) -> Child {
    let line = "set-force 0 1 0 --link fast --duration 3600 --record rec";
    let child = forcectl(folder, &words(line))
        .spawn()
        .expect("forcectl runs");
    let mcap = folder.join("rec/run.mcap");
    while std::fs::metadata(&mcap).map_or(0, |file| file.len()) < 100_000 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    child
}

/// Samples in a file, and how it ends.
fn read(path: &Path) -> (u64, End) {
    let mut reader = Reader::open(path).expect("opens");
    let samples = reader
        .by_ref()
        .filter(|entry| matches!(entry, Entry::Message { topic, .. } if topic == "/sample"))
        .count();
    (samples as u64, reader.end().clone())
}

#[test]
fn a_killed_run_leaves_all_but_its_last_chunk_to_every_reader() {
    let folder = folder();
    let mut child = recording(folder.path());
    let mcap = folder.path().join("rec/run.mcap");
    let (before, _) = read(&mcap);
    child.kill().expect("killed");
    child.wait().expect("ends");
    let (samples, end) = read(&mcap);
    assert_eq!(end, End::CutOff);
    assert!(samples >= before && before > 0, "{samples} {before}");
    assert!(folder.path().join("rec/configuration.json").is_file());
    // The public reader of the crate `mcap`: all of it, then the error of the missing end.
    let bytes = std::fs::read(&mcap).expect("is there");
    let messages: Vec<_> = mcap::MessageStream::new(&bytes).expect("opens").collect();
    let good = messages
        .iter()
        .flatten()
        .filter(|message| message.channel.topic.starts_with("/sample/"))
        .count();
    assert_eq!(good as u64, samples);
    // That of PyPI.
    if let Some(python) = python("mcap, lz4") {
        let script = "
import sys
from mcap.stream_reader import StreamReader
from mcap.records import Channel, Message
topics, samples = {}, 0
try:
    for record in StreamReader(open(sys.argv[1], 'rb')).records:
        if isinstance(record, Channel): topics[record.id] = record.topic
        if isinstance(record, Message): samples += topics[record.channel_id].startswith('/sample/')
except Exception as error:
    print(type(error).__name__, file=sys.stderr)
print(samples)
";
        let output = Command::new(python)
            .args(["-c", script])
            .arg(&mcap)
            .output()
            .expect("python runs");
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(said.trim(), samples.to_string(), "{output:?}");
    }
    // Parquet afterwards, and what the check says.
    let rows = format!("samples.parquet: {samples} rows");
    expect(folder.path(), "recording export rec", 6, &[&rows]);
    let repaired = folder.path().join("rec").join(recording::REPAIRED_FILE);
    assert!(!repaired.exists());
    a_copy_is_read_by_those_who_refuse_the_file(folder.path(), &mcap, &repaired, samples);
    let checked = check(&folder.path().join("rec")).expect("reads");
    assert_eq!(checked.end, "cut off");
    expect(folder.path(), "recording check rec", 6, &["cut off"]);
    // The folder holds rows: it is not used again.
    let again = "set-force 0 1 0 --link fast --duration 1 --record rec";
    expect(folder.path(), again, 7, &["another folder"]);
}

/// `recording export --mcap` of a file without an end, and readers that begin with the index at the
/// end.
fn a_copy_is_read_by_those_who_refuse_the_file(
    folder: &Path,
    mcap: &Path,
    repaired: &Path,
    samples: u64,
) {
    let bytes = std::fs::read(mcap).expect("is there");
    assert!(mcap::Summary::read(&bytes).is_err(), "no end, no summary");
    let lists = ["repaired.mcap: ", "messages"];
    expect(folder, "recording export rec --mcap", 6, &lists);
    assert_eq!(read(repaired), (samples, End::Complete));
    let bytes = std::fs::read(repaired).expect("is there");
    let summary = mcap::Summary::read(&bytes).expect("reads");
    let stats = summary.and_then(|summary| summary.stats).expect("counts");
    let messages = mcap::MessageStream::new(&bytes).expect("opens");
    let messages: Vec<_> = messages.map(|message| message.expect("is whole")).collect();
    assert_eq!(stats.message_count, messages.len() as u64);
    if let Some(python) = python("mcap, lz4") {
        let script = "
import sys
from mcap.reader import make_reader
try:
    print(sum(c.topic.startswith('/sample/') for _, c, _ in make_reader(open(sys.argv[1], 'rb')).iter_messages()))
except Exception as error:
    print('refused:', type(error).__name__)
";
        let said = |path: &Path| {
            let mut python = Command::new(&python);
            let output = python.args(["-c", script]).arg(path).output();
            let output = output.expect("python runs");
            String::from_utf8_lossy(&output.stdout).trim().to_owned()
        };
        // What it takes for the end is the middle of a record: which error that is depends on its
        // bytes.
        let refused = said(mcap);
        assert!(
            refused.starts_with("refused: "),
            "as docs/recordings.md says: {refused}"
        );
        assert_eq!(said(repaired), samples.to_string());
    }
}

#[test]
fn a_signal_completes_every_file_and_a_second_one_keeps_the_chunks() {
    let each = signals().into_iter().map(|name| vec![name]);
    for names in each.chain([vec!["TERM", "TERM"]]) {
        let folder = folder();
        let mut child = recording(folder.path());
        for name in &names {
            signal(&child, name);
        }
        child.wait().expect("ends");
        let (samples, end) = read(&folder.path().join("rec/run.mcap"));
        assert!(samples > 0, "{names:?}");
        if names.len() == 1 {
            assert_eq!(end, End::Complete, "{names:?}");
            let whole = ["Nothing is missing"];
            expect(folder.path(), "recording check rec", 0, &whole);
        }
    }
}

#[test]
fn a_full_disk_ends_neither_the_run_nor_what_was_recorded() {
    let folder = folder();
    // A limit on the size of a file that acts as a full disk does: the write is refused.
    let line = format!(
        "ulimit -f 600; exec {} set-force 0 1 0 --link fast --duration 60 --out out --record rec",
        env!("CARGO_BIN_EXE_forcectl")
    );
    let output = Command::new("bash")
        .args(["-c", &line])
        .current_dir(folder.path())
        .env("FORCECTL_RUNTIME_DIR", folder.path().join("run"))
        .env("FORCECTL_STATE_DIR", folder.path().join("state"))
        .output()
        .expect("bash runs");
    let said = said(&output);
    assert_eq!(said.code, Some(7), "{said:?}");
    let went_on = said.out.contains("force at the tip, N");
    assert!(went_on && said.err.contains("run.mcap"), "{said:?}");
    assert!(folder.path().join("out/set-force.json").is_file());
    let (samples, end) = read(&folder.path().join("rec/run.mcap"));
    assert_eq!(end, End::CutOff);
    assert!(samples > 0);
    // Where there is room, the Parquet files can be written later.
    expect(folder.path(), "recording export rec --out later", 6, &[]);
    assert!(folder.path().join("later/samples.parquet").is_file());
}

/// A number of a message with its name, as PlotJuggler names it: `/` before a key, `[n]` behind a
/// list.
fn flatten(name: &str, value: &serde_json::Value, out: &mut Vec<(String, f64)>) {
    match value {
        serde_json::Value::Object(fields) => {
            for (key, value) in fields {
                flatten(&format!("{name}/{key}"), value, out);
            }
        }
        serde_json::Value::Array(items) => {
            for (index, value) in items.iter().enumerate() {
                flatten(&format!("{name}[{index}]"), value, out);
            }
        }
        serde_json::Value::Number(number) => {
            out.push((name.to_owned(), number.as_f64().expect("is finite")));
        }
        serde_json::Value::Bool(flag) => out.push((name.to_owned(), f64::from(u8::from(*flag)))),
        // Text and null make no curve.
        serde_json::Value::String(_) | serde_json::Value::Null => {}
    }
}

/// The rules by which PlotJuggler 3 reads MCAP and Parquet, from its sources: it is in neither
/// Debian nor PyPI.
#[test]
fn a_recording_by_plotjugglers_rules_has_a_curve_a_unit_and_all_of_the_layout() {
    use std::collections::BTreeMap;
    let folder = folder();
    let line = "set-force 0 1.5 0 --link fast --duration 2 --record rec";
    let said = run(folder.path(), line);
    assert!(matches!(said.code, Some(0 | 6)), "{said:?}");
    let bytes = std::fs::read(folder.path().join("rec/run.mcap")).expect("is there");

    // The quick way in: channels, schemas and counts by the offsets of the summary.
    let footer = mcap::read::footer(&bytes).expect("has an end");
    assert!(footer.summary_start > 0 && footer.summary_offset_start > footer.summary_start);
    let summary = mcap::Summary::read(&bytes)
        .expect("reads")
        .expect("is there");
    assert!(summary.stats.is_some());
    // A parser by the encoding of the channel: JSON is known. The time is that of the log; a stamp
    // in the message counts only where it is a number.
    let mut curves: BTreeMap<String, Vec<(u64, f64)>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).expect("opens") {
        let message = message.expect("is whole");
        assert_eq!(message.channel.message_encoding, "json");
        assert!(
            message.channel.schema.is_some(),
            "without one it is skipped"
        );
        let value = serde_json::from_slice(&message.data).expect("JSON");
        let mut numbers = Vec::new();
        flatten(&message.channel.topic, &value, &mut numbers);
        for (name, value) in numbers {
            let curve = curves.entry(name).or_default();
            curve.push((message.log_time, value));
        }
    }
    for unit in 1..=6 {
        let numbers = &curves[&format!("/sample/unit{unit}/unit")];
        assert!(numbers.iter().all(|(_, number)| *number == f64::from(unit)));
    }
    // A line through the points in their sequence: none goes back.
    for (name, curve) in &curves {
        let forward = |pair: &[(u64, f64)]| pair[0].0 <= pair[1].0;
        assert!(curve.windows(2).all(forward), "{name} zigzags");
        if name.starts_with("/sample/") {
            assert!(curve.windows(2).all(|pair| pair[0].0 < pair[1].0), "{name}");
        }
    }
    let layout = include_str!("../examples/plotjuggler-layout.xml");
    let shown: Vec<&str> = layout
        .split("<curve name=\"")
        .skip(1)
        .map(|rest| rest.split('"').next().expect("a quote"))
        .collect();
    assert!(shown.len() >= 40);
    for name in shown {
        assert!(curves.contains_key(name), "the layout shows {name}");
    }

    // Parquet: columns without parts, each of a number, a time or a text, and `utc` as the axis.
    use parquet::basic::Type;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    for table in recording::TABLES {
        let file = std::fs::File::open(folder.path().join("rec").join(table.file)).expect("opens");
        let reader = SerializedFileReader::new(file).expect("Parquet");
        let schema = reader.metadata().file_metadata().schema_descr_ptr();
        for column in schema.columns() {
            assert_eq!(column.path().parts().len(), 1, "{}", column.path());
            let kinds = [Type::DOUBLE, Type::INT32, Type::INT64, Type::BYTE_ARRAY];
            assert!(kinds.contains(&column.physical_type()), "{}", column.path());
        }
        assert_eq!(schema.column(0).name(), "utc");
        let rows = reader.get_row_iter(None).expect("rows");
        let utc: Vec<i64> = rows
            .map(|row| row.expect("a row").get_long(0).expect("a time"))
            .collect();
        assert!(!utc.is_empty(), "{}", table.file);
    }
}

#[test]
fn a_log_is_joined_by_time_with_the_error_of_the_join() {
    let folder = folder();
    let line = "set-force 0 1.5 0 --link fast --duration 4 --record rec";
    let said = run(folder.path(), line);
    assert!(matches!(said.code, Some(0 | 6)), "{said:?}");
    let checked = check(&folder.path().join("rec")).expect("reads");
    // The emulated board's clock is off by at most 100 ppm.
    let clock = (checked.clock.drift_ppm, checked.clock.drift_uncertainty_ppm);
    let (Some(ppm), Some(error_ppm)) = clock else {
        panic!("no drift: {clock:?}")
    };
    assert!(ppm.abs() < 100.0 + error_ppm, "{clock:?}");
    let holding = checked
        .phases
        .iter()
        .find(|phase| phase.phase == "holding")
        .expect("was held");
    // A robot's log at 50 Hz: half of it before the recording.
    let mut log = "secs,nsecs,q1,note\n".to_owned();
    for n in 0..200 {
        let t_s = holding.start_utc_s + 0.02 * f64::from(n) - 2.0;
        let before = if n < 100 { 3600.0 } else { 0.0 };
        let secs = (t_s - before).floor();
        let nsecs = ((t_s - before - secs) * 1e9).floor();
        log += &format!("{secs},{nsecs},{},x\n", 0.1 * f64::from(n));
    }
    std::fs::write(folder.path().join("robot.csv"), log).expect("written");
    let merge = "recording merge rec --log robot.csv --out joined.parquet --time";
    let line = format!("{merge} secs+nsecs --json");
    let out = expect(folder.path(), &line, 0, &[]).out;
    let merged: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(merged["joined"], 100, "{out}");
    assert_eq!(merged["outside"], 100, "{out}");
    let error_s = merged["error_max_s"].as_f64().expect("is known");
    assert!(error_s > 0.0 && error_s < 2e-3, "{error_s}");
    // A log of another day: nothing is written, and both spans are printed.
    let other = "time,q1\n2020-01-01T01:00:00+01:00,0\n2020-01-01T01:00:01+01:00,1\n";
    std::fs::write(folder.path().join("other.csv"), other).expect("written");
    let line = "recording merge rec --log other.csv --out none.parquet --time time";
    let said = expect(folder.path(), line, 6, &["no file written"]);
    assert!(
        said.err
            .contains("no row of other.csv is within the recording"),
        "{said:?}"
    );
    assert!(
        said.out
            .contains("log: 2020-01-01T00:00:00.000Z to 2020-01-01T00:00:01.000Z"),
        "{said:?}"
    );
    assert!(!said.out.contains("0.000 ms"), "{said:?}");
    assert!(!folder.path().join("none.parquet").exists());
    std::fs::write(folder.path().join("other.csv"), other.replace("+01:00", "")).expect("written");
    expect(folder.path(), line, 2, &["row 1 has a time without a zone"]);
    // Another column of time.
    let line = format!("{merge} q1");
    expect(folder.path(), &line, 2, &["row 1 has no time"]);
}

/// What every file below a folder holds, by its path.
fn content(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("is there") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(content(&path));
        } else if path.is_file() {
            found.push((path.clone(), std::fs::read(&path).expect("is read")));
        }
    }
    found.sort();
    found
}

#[test]
fn an_output_of_a_recording_never_replaces_what_is_read_or_another_recording() {
    let folder = folder();
    for name in ["rec", "other"] {
        let line = format!("set-force 0 1 0 --link fast --duration 1 --record {name}");
        let said = run(folder.path(), &line);
        assert!(matches!(said.code, Some(0 | 6)), "{said:?}");
    }
    let checked = check(&folder.path().join("rec")).expect("reads");
    let start_s = checked.phases.last().expect("has phases").start_utc_s;
    let log = format!("time,q\n{start_s},1\n");
    std::fs::write(folder.path().join("log.csv"), log).expect("written");
    std::fs::copy(
        folder.path().join("rec/run.mcap"),
        folder.path().join("repaired.mcap"),
    )
    .expect("copied");
    std::os::unix::fs::symlink("log.csv", folder.path().join("link")).expect("made");
    let made = Command::new("mkfifo")
        .arg(folder.path().join("fifo"))
        .status();
    assert!(made.expect("mkfifo runs").success());
    let before = content(folder.path());
    for (out, words) in [
        ("log.csv", "would be lost"),
        ("./rec/../log.csv", "would be lost"),
        ("link", "would be lost"),
        ("rec/run.mcap", "it would lie in rec"),
        ("rec/samples.parquet", "it would lie in rec"),
        ("rec/new/joined.parquet", "it would lie in rec"),
        ("fifo", "no regular file"),
        ("rec", "no regular file"),
    ] {
        for recording in ["rec", "rec/run.mcap"] {
            let line = format!("recording merge {recording} --log log.csv --time time --out {out}");
            expect(folder.path(), &line, 2, &[out, words, "name another file"]);
        }
    }
    for (line, words) in [
        ("rec --out other", "another recording is there"),
        ("repaired.mcap --mcap", "would be lost"),
    ] {
        expect(
            folder.path(),
            &format!("recording export {line}"),
            2,
            &[words],
        );
    }
    assert!(content(folder.path()) == before, "a file was changed");
    // Over another file, and beside the recording, all is as before.
    let line = "recording merge rec --log log.csv --time time --out joined.parquet";
    for _ in 0..2 {
        expect(folder.path(), line, 0, &["1 of 1 rows joined"]);
    }
    // Joined once more, it would have each of our columns twice.
    let line = "recording merge rec --log joined.parquet --time time --out twice.parquet";
    let words = [
        "joined.parquet: it has columns that the join adds",
        "`log_utc`",
    ];
    expect(folder.path(), line, 2, &words);
    std::fs::write(folder.path().join("twice.csv"), "time,q,q\n1,2,3\n").expect("written");
    let line = "recording merge rec --log twice.csv --time time --out twice.parquet";
    let said = expect(
        folder.path(),
        line,
        2,
        &["more than one column of the name `q`"],
    );
    assert!(said.err.starts_with("forcectl: twice.csv: "), "{said:?}");
    assert!(!folder.path().join("twice.parquet").exists());
    // A recording without its end: what is in it is joined, and that it was cut off is said.
    let recorded = folder.path().join("rec/run.mcap");
    let whole = std::fs::read(&recorded).expect("there");
    std::fs::write(&recorded, &whole[..whole.len() - 20]).expect("written");
    let line = "recording merge rec --log log.csv --time time --out part.parquet";
    let said = expect(folder.path(), line, 6, &["1 of 1 rows joined"]);
    assert!(said.err.contains("rec is cut off or damaged"), "{said:?}");
}

#[test]
fn a_shift_or_an_error_that_is_no_time_is_refused() {
    let folder = folder();
    let merge = "recording merge rec --log log.csv --time time --out out.parquet";
    for shift in ["inf", "-inf", "nan", "1e300", "-1e300"] {
        let line = format!("{merge} --shift {shift}");
        expect(
            folder.path(),
            &line,
            2,
            &[shift, "no difference of two clocks"],
        );
    }
    for error in ["nan", "inf", "-1"] {
        let line = format!("{merge} --log-error {error}");
        expect(folder.path(), &line, 2, &[error, "0 to 86400 seconds"]);
    }
}

#[test]
fn a_recording_without_a_sample_is_no_success() {
    let folder = folder();
    let line = "record rec --link fast --duration 0.1";
    let said = expect(folder.path(), line, 6, &["0 samples in rec"]);
    assert!(said.err.contains("no sample came in this time"), "{said:?}");
    let said = expect(
        folder.path(),
        "recording check rec",
        6,
        &["it holds no samples"],
    );
    assert!(said.out.contains("drift unknown"), "{said:?}");
}

/// A page of the documents.
fn page(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../docs")
        .join(name);
    std::fs::read_to_string(path).expect("the page is there")
}

/// The commands of a fence of docs/recordings.md after a marker.
fn fenced(marker: &str) -> String {
    let page = page("recordings.md");
    let after = page.split_once(marker).expect("the marker is there").1;
    let code = after.split_once("```python\n").expect("a fence").1;
    code.split_once("```").expect("its end").0.to_owned()
}

#[test]
fn the_ten_lines_of_pandas_in_the_documents_plot_a_run() {
    let script = fenced("<!-- test: plot -->");
    assert!(script.trim().lines().count() <= 10, "{script}");
    let Some(python) = python("pandas, pyarrow, matplotlib") else {
        return;
    };
    let folder = folder();
    let line = "set-force 0 1.5 0 --link fast --duration 2 --record recording";
    let said = run(folder.path(), line);
    assert!(matches!(said.code, Some(0 | 6)), "{said:?}");
    let output = Command::new(python)
        .args(["-c", &script])
        .current_dir(folder.path())
        .env("MPLBACKEND", "Agg")
        .env("MPLCONFIGDIR", folder.path().join("matplotlib"))
        .output()
        .expect("python runs");
    assert!(output.status.success(), "{output:?}");
    let picture = std::fs::read(folder.path().join("run.png")).expect("is there");
    assert!(picture.starts_with(b"\x89PNG"));
}

#[test]
fn the_documents_list_every_column_with_its_unit() {
    let page = page("recording-columns.md");
    let page: Vec<&str> = page.lines().collect();
    let mut rows = 0;
    for table in recording::TABLES {
        let title = match table.topics {
            [topic] => format!("## `{}`, topic `{topic}`", table.file),
            [first, .., last] => format!("## `{}`, topics `{first}` to `{last}`", table.file),
            [] => unreachable!("a table has a topic"),
        };
        let start = page.iter().position(|line| *line == title);
        let start = start.unwrap_or_else(|| panic!("docs/recording-columns.md lacks: {title}"));
        for field in table.fields {
            let names: Vec<String> = field.columns().map(|name| format!("`{name}`")).collect();
            let name = match names.as_slice() {
                [one] => one.clone(),
                several => format!("{} to {}", several[0], several[several.len() - 1]),
            };
            let missing = if field.optional {
                "; may be missing"
            } else {
                ""
            };
            let row = format!(
                "| {name} | {} | {} | {}{missing} |",
                field.unit,
                field.kind.name(),
                field.meaning
            );
            assert!(
                page[start..].contains(&row.as_str()),
                "docs/recording-columns.md lacks, below {title}:\n{row}"
            );
            rows += 1;
        }
    }
    let in_page = page
        .iter()
        .filter(|line| line.starts_with("| `") && line.matches(" | ").count() == 3);
    assert_eq!(in_page.count(), rows, "rows of columns that are not there");
}
