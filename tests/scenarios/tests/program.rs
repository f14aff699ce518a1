//! The program `forcectl` with the real firmware image: exit codes, files, closed pipes and signals
//! of whole runs.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// `forcectl` beside the rig that the environment names; both are built together.
fn forcectl(folder: &Path, line: &str) -> Command {
    let rig = PathBuf::from(std::env::var_os("FORCE_RIG_BIN").expect("FORCE_RIG_BIN is set"));
    let name = format!("forcectl{}", std::env::consts::EXE_SUFFIX);
    let mut command = Command::new(rig.with_file_name(name));
    command
        .args(line.split_whitespace())
        .current_dir(folder)
        .stdin(Stdio::null());
    command
}

fn run(folder: &Path, line: &str) -> (Option<i32>, String, String) {
    let output: Output = forcectl(folder, line).output().expect("forcectl runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert!(!err.contains("panicked"), "{line}: {err}");
    (output.status.code(), out, err)
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Rows of a recording are complete where its footer is there.
fn is_recording(folder: &Path) -> bool {
    ["samples.parquet", "cycles.parquet"].iter().all(|name| {
        let bytes = std::fs::read(folder.join(name)).unwrap_or_default();
        bytes.len() > 1000 && bytes.ends_with(b"PAR1")
    }) && folder.join("configuration.json").is_file()
}

#[test]
fn a_force_that_is_not_held_ends_with_6_and_the_reason() {
    let folder = folder();
    let plant = "[[effects]]\nkind = \"amplifier_gain\"\nunits = [2]\nrelative_error = -0.6\n";
    std::fs::write(folder.path().join("weak.toml"), plant).expect("written");
    for (line, words) in [
        (
            "set-force 0 2.5 0 --duration 4 --inject freeze-encoder=4@1s",
            "cable 4",
        ),
        (
            "set-force 0 2.5 0 --duration 2 --inject pull=2:3@start",
            "more than unit 2 measures",
        ),
        (
            "set-force 0 9 0 --duration 2 --plant weak.toml",
            "unit 3's command was at its limit",
        ),
        (
            "set-force 0 2.5 0 --duration 2 --inject unplug=3@9s",
            "unplug=3@9s was not injected",
        ),
    ] {
        let (code, out, err) = run(folder.path(), line);
        // Where the board itself has noticed, its fault is the reason.
        if code == Some(5) {
            let doubts = ["fault 44", "fault 45", "fault 46"];
            assert!(
                doubts.iter().any(|fault| out.contains(fault)),
                "{line}: {out}{err}"
            );
            continue;
        }
        assert_eq!(code, Some(6), "{line}: {out}{err}");
        let reason = out
            .lines()
            .find(|line| line.starts_with("not as commanded"));
        assert!(
            reason.is_some_and(|reason| reason.contains(words)),
            "{line}: {out}"
        );
    }
}

#[test]
fn a_lost_unit_ramps_down_and_leaves_its_own_files() {
    let folder = folder();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).expect("made");
    for name in ["set-force.svg", "set-force.json"] {
        std::fs::write(out.join(name), "of a run before").expect("written");
    }
    let line = "set-force 0 2.5 0 --json --out out --record rec --inject unplug=3@2s";
    let (code, object, err) = run(folder.path(), line);
    assert_eq!(code, Some(5), "{object}{err}");
    assert!(
        object.contains("\"ended\":\"stopped\"") && object.contains("unit 3 dropped out"),
        "{object}"
    );
    let read = |name: &str| std::fs::read_to_string(out.join(name)).expect("is there");
    assert!(read("set-force.svg").contains("</svg>"));
    assert!(read("set-force.json").contains("\"stopped\""));
    assert!(is_recording(&folder.path().join("rec")));
    // A run that is refused leaves none.
    let line = "set-force 0 2.5 0 --out out --inject unplug=2@start";
    let (code, _, err) = run(folder.path(), line);
    assert_eq!(code, Some(5), "{err}");
    assert!(err.contains("zero force is out of reach"), "{err}");
    assert_eq!(std::fs::read_dir(&out).expect("is there").count(), 0);
}

#[test]
fn readers_that_leave_cost_neither_the_run_nor_its_recording() {
    let folder = folder();
    // As `2>&1 | head -c 1`: both outputs are one pipe, which closes in the middle of the run.
    let (mut reader, writer) = std::io::pipe().expect("a pipe");
    let mut child = forcectl(folder.path(), "set-force 0 1 0 --duration 2 --record rec")
        .stdout(writer.try_clone().expect("a second end"))
        .stderr(writer)
        .spawn()
        .expect("forcectl runs");
    reader.read_exact(&mut [0]).expect("it says something");
    drop(reader);
    let status = child.wait().expect("ends");
    assert_eq!(status.code(), Some(0));
    assert!(is_recording(&folder.path().join("rec")));
    assert!(folder.path().join("forcectl-out/set-force.svg").is_file());
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_that_cannot_be_written_costs_only_itself() {
    let folder = folder();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).expect("made");
    let line = "set-force 0 1 0 --duration 2 --out out --record rec";
    let mut child = forcectl(folder.path(), line)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("forcectl runs");
    // The earlier files are removed before the run begins; this one appears while it goes on. Every
    // write to it fails.
    let mut err = child.stderr.take().expect("is piped");
    let mut said = String::new();
    let mut byte = [0];
    while !said.contains("holding the force") {
        err.read_exact(&mut byte).expect("it goes on");
        said.push(char::from(byte[0]));
    }
    std::os::unix::fs::symlink("/dev/full", out.join("set-force.svg")).expect("linked");
    err.read_to_string(&mut said).expect("is text");
    let output = child.wait_with_output().expect("ends");
    assert_eq!(output.status.code(), Some(7), "{said}");
    let table = String::from_utf8_lossy(&output.stdout);
    assert!(table.contains("force at the tip, N"), "{table}");
    assert!(table.contains("figures  "), "{table}");
    assert!(said.contains("set-force.svg cannot be written"), "{said}");
    assert!(out.join("set-force.json").is_file());
    assert!(is_recording(&folder.path().join("rec")));
}

#[cfg(unix)]
#[test]
fn termination_ramps_down_and_keeps_the_results() {
    for name in ["INT", "TERM"] {
        let folder = folder();
        let line = "set-force 0 1 0 --duration 600 --json -v --record rec";
        let mut child = forcectl(folder.path(), line)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("forcectl runs");
        let mut err = child.stderr.take().expect("is piped");
        let mut said = String::new();
        let mut byte = [0];
        while !said.contains("holding the force") {
            err.read_exact(&mut byte).expect("it goes on");
            said.push(char::from(byte[0]));
        }
        let sent = Command::new("kill")
            .args(["-s", name, &child.id().to_string()])
            .status();
        assert!(sent.expect("kill runs").success());
        err.read_to_string(&mut said).expect("is text");
        let output = child.wait_with_output().expect("ends");
        assert_eq!(output.status.code(), Some(130), "{name}: {said}");
        let object = String::from_utf8_lossy(&output.stdout);
        assert_eq!(object.lines().count(), 1, "{object}");
        assert!(object.contains("\"ended\":\"interrupted\""), "{object}");
        assert!(is_recording(&folder.path().join("rec")));
    }
}
