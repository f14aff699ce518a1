//! The guide docs/calibration.md: every command of the page, in its order, on the rig without the emulated controller; and what
//! a session by hand does when it is broken off.
//!
//! `<!-- test: code 6 -->` before a block of code says its exit code.

use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn forcectl(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_forcectl"));
    command
        .current_dir(folder)
        .env("FORCECTL_RUNTIME_DIR", folder.join("run"))
        .env("FORCECTL_STATE_DIR", folder.join("state"))
        .stdin(Stdio::null());
    command
}

/// Calls with their exit codes.
fn calls(page: &str) -> Vec<(Vec<String>, i32)> {
    let mut found = Vec::new();
    let mut code = 0;
    let mut fenced = false;
    for line in page.lines() {
        if let Some(rest) = line.strip_prefix("<!-- test: code ") {
            code = rest.trim_end_matches(" -->").parse().expect("a code");
        } else if line.starts_with("```") {
            if fenced {
                code = 0;
            }
            fenced = !fenced;
        } else if fenced {
            let words = line.strip_prefix("forcectl ").expect("a call of forcectl");
            found.push((words.split_whitespace().map(str::to_owned).collect(), code));
        }
    }
    found
}

fn text(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

#[test]
fn every_command_of_the_guide_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/calibration.md");
    let page = std::fs::read_to_string(path).unwrap();
    let calls = calls(&page);
    assert!(calls.len() >= 14, "{}", calls.len());
    let mut all = String::new();
    for (words, code) in &calls {
        let output = forcectl(folder.path()).args(words).output().unwrap();
        let said = text(&output);
        assert_eq!(
            output.status.code(),
            Some(*code),
            "forcectl {}: {said}",
            words.join(" ")
        );
        all.push_str(&said);
    }
    for expected in [
        "station `B` moved by about",
        "went away when the cable was paid out",
        "SBA-0713",
        "times as long (",
        "entered 50 g, but the code is that of",
        "read back and compared",
        "in force on the board",
        "within ",
        "the rig stands where its calibration says",
        "over the rig as it is",
    ] {
        assert!(all.contains(expected), "`{expected}` is missing: {all}");
    }
    for word in page.split('`').filter(|w| w.starts_with("forcectl-out/")) {
        assert!(folder.path().join(word).exists(), "{word}");
    }
    // The run's uncertainty is in its figures.
    let figures = std::fs::read(folder.path().join("forcectl-out/set-force.json")).unwrap();
    let figures: Value = serde_json::from_slice(&figures).unwrap();
    let radius = figures["uncertainty"]["radius_95_n"].as_f64().unwrap();
    assert!((0.001..0.2).contains(&radius), "{radius}");
    assert_eq!(figures["uncertainty"]["nominal"], serde_json::json!([]));
}

#[test]
fn a_session_by_hand_goes_on_where_it_was_broken_off() {
    let folder = tempfile::tempdir().unwrap();
    let call = |input: &str, words: &[&str]| {
        let mut child = forcectl(folder.path())
            .args([
                "calibrate",
                "gain",
                "--link",
                "fast",
                "--unit",
                "2",
                "--rounds",
                "1",
            ])
            .args(["--weights", "100", "500", "1000"])
            .args(words)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdin = child.stdin.take().unwrap();
        stdin.write_all(input.as_bytes()).unwrap();
        drop(stdin);
        child.wait_with_output().unwrap()
    };
    // Two readings, one taken back, one more, then the end of the input.
    let output = call("\n\nu\n\n", &[]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(
        said.contains("reading 1 of 10: take all weights off"),
        "{said}"
    );
    assert!(said.contains("hang 100 g"), "{said}");
    assert!(said.contains("stopped after 2 of 10 readings"), "{said}");
    let output = call(&"\n".repeat(8), &[]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(
        said.contains("2 of 10 readings are kept from before"),
        "{said}"
    );
    assert!(said.contains("version 0001"), "{said}");
    // `--yes` alone is nothing for a table, and bad tables store nothing.
    let bad = folder.path().join("bad.csv");
    std::fs::write(&bad, "weight_g,code,standard_error\n10,1e3,30\n20,abc,30\n").unwrap();
    let output = call("", &["--readings", bad.to_str().unwrap()]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("bad.csv:3: `abc`") && said.contains("nothing was stored"),
        "{said}"
    );
    let versions = forcectl(folder.path())
        .args(["calibrate", "show", "--versions", "--link", "fast"])
        .output()
        .unwrap();
    assert_eq!(
        text(&versions).matches("sha256:").count(),
        1,
        "{}",
        text(&versions)
    );
}

#[test]
fn values_that_can_not_be_are_refused_and_nothing_is_stored() {
    let folder = tempfile::tempdir().unwrap();
    let latin = folder.path().join("latin.csv");
    std::fs::write(&latin, b"weight_g,code,standard_error\n10,1,3 \xb5\n").unwrap();
    let comma = folder.path().join("comma.csv");
    std::fs::write(&comma, "weight_g;code;standard_error\n10;1,5;3\n").unwrap();
    let readings = |path: &Path| {
        let path = path.to_str().unwrap().to_owned();
        ["gain", "--unit", "2", "--readings", &path].map(str::to_owned)
    };
    let words = |line: &str| -> Vec<String> { line.split(' ').map(str::to_owned).collect() };
    for (call, expected) in [
        (words("verify --duration 0.5"), "give at least 2 s"),
        (words("geometry --yes --digitizer-sd 0.0002"), "mm, not m?"),
        (words("gain --weights 0 --yes"), "`0` is not a weight"),
        (words("gain --weights nan --yes"), "`nan` is not a weight"),
        (words("zero --replace 9 --yes"), "no unit 9 is enabled"),
        (readings(&latin).to_vec(), "save it as CSV UTF-8"),
        (readings(&comma).to_vec(), "write a point"),
    ] {
        let mut command = forcectl(folder.path());
        command.arg("calibrate").args(&call);
        let output = command.args(["--link", "fast"]).output().unwrap();
        let said = text(&output);
        assert_eq!(output.status.code(), Some(2), "{call:?}: {said}");
        assert!(said.contains(expected), "{call:?}: {said}");
    }
    let use_none = forcectl(folder.path())
        .args(["calibrate", "use", "1", "--link", "fast"])
        .output()
        .unwrap();
    let said = text(&use_none);
    assert!(
        said.contains("0001.toml") && !use_none.status.success(),
        "{said}"
    );
}
