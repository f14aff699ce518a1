//! What Foxglove gets, read by a program that is neither ours nor the app: `foxglove_reader.py`
//! with PyPI's `mcap`, `websockets` and `jsonschema`.
//!
//! `cargo test -p host-cli --test foxglove`, with the environment variable FOXGLOVE_TEST_PYTHON
//! naming a Python that has the three packages (`python3` where it is not set). Without them the
//! tests say so and do nothing.
#![cfg(feature = "foxglove")]

mod common;

use common::{expect, folder, forcectl, words};
use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How long to wait for something that must come. It is no measure of anything.
const PATIENCE: Duration = Duration::from_secs(60);
const LAYOUT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/foxglove-layout.json");

/// A Python with the packages.
fn python() -> Option<String> {
    let python = std::env::var("FOXGLOVE_TEST_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let installed = (Command::new(&python).args(["-c", "import jsonschema, mcap, websockets"]))
        .stderr(Stdio::null())
        .status();
    if installed.is_ok_and(|status| status.success()) {
        return Some(python);
    }
    println!(
        "skipped: {python} has not jsonschema, mcap and websockets (FOXGLOVE_TEST_PYTHON names another Python)"
    );
    None
}

/// What the reader found: messages by topic, and the layout's paths that have a topic.
fn read(python: &str, kind: &str, source: &str) -> serde_json::Value {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/foxglove_reader.py");
    let output = Command::new(python)
        .args([script, kind, source, LAYOUT])
        .output()
        .expect("the reader runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    serde_json::from_slice(&output.stdout).expect("a line of JSON")
}

/// Whether the layout has paths of these topics, all of whose fields are there.
fn plots(found: &serde_json::Value, topics: &[&str]) {
    let paths = found["paths"].to_string();
    for topic in topics {
        assert!(paths.contains(topic), "{topic}: {paths}");
    }
}

#[test]
fn a_recording_keeps_its_schemas_and_the_layout_fits_it() {
    let Some(python) = python() else { return };
    let temporary = folder();
    let folder = temporary.path();
    let line = "set-force 0 2.5 0 --duration 2 --link fast --record recording";
    expect(folder, line, 0, &[]);
    let mcap = folder.join("recording/run.mcap");
    let found = read(&python, "recording", mcap.to_str().expect("a path"));
    let drawn = ["/tip", "/tf", "/force"];
    for topic in [
        "/sample/unit1",
        "/sample/unit6",
        "/cycle",
        "/clock",
        "/counters",
        "/log",
    ]
    .into_iter()
    .chain(drawn)
    {
        assert!(
            found["counts"][topic].as_u64() > Some(0),
            "{topic}: {found}"
        );
    }
    plots(
        &found,
        &["/sample/unit1", "/sample/unit6", "/cycle", "/clock"],
    );
}

/// Ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_live_stream_keeps_its_schemas_and_the_layout_fits_it() {
    let Some(python) = python() else { return };
    let temporary = folder();
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|socket| socket.local_addr())
        .expect("a free port")
        .port();
    let address = format!("127.0.0.1:{port}");
    let line = format!("monitor --plain --duration 36000 --link fast --foxglove {address}");
    let child = forcectl(temporary.path(), &words(&line))
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .spawn();
    let _running = Running(child.expect("forcectl runs"));
    let began = Instant::now();
    while std::net::TcpStream::connect(&address).is_err() {
        assert!(began.elapsed() < PATIENCE, "nothing listens on {address}");
        std::thread::sleep(Duration::from_millis(50));
    }
    let found = read(&python, "live", &format!("ws://{address}"));
    for topic in ["/unit1", "/unit6", "/rig", "/tip", "/tf", "/force"] {
        assert!(
            found["counts"][topic].as_u64() >= Some(10),
            "{topic}: {found}"
        );
    }
    plots(&found, &["/unit1", "/unit6", "/rig"]);
}
