//! What several tests of the program need.
// Each test takes a part of it.
#![allow(dead_code)]

#[cfg(unix)]
pub mod fake;
#[cfg(feature = "estimate")]
pub mod logs;

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// A folder of its own for one test, removed at the end.
pub fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Splits a line at its spaces.
pub fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// `forcectl` in a folder, with services and stored values of its own there.
pub fn forcectl(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_forcectl"));
    command
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .env("FORCECTL_RUNTIME_DIR", folder.join("run"))
        .env("FORCECTL_STATE_DIR", folder.join("state"));
    command
}

/// What a call printed, and its exit code.
#[derive(Debug)]
pub struct Said {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

/// What a program printed; it did not panic.
pub fn said(output: &Output) -> Said {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = Said {
        code: output.status.code(),
        out: text(&output.stdout),
        err: text(&output.stderr),
    };
    assert!(!said.err.contains("panicked"), "{said:?}");
    said
}

/// Runs `forcectl` with the words of a line.
pub fn run(folder: &Path, line: &str) -> Said {
    said(
        &forcectl(folder, &words(line))
            .output()
            .expect("forcectl runs"),
    )
}

/// The same; the exit code has to be `code`, and all of `texts` printed: on the standard output
/// where there is a result (0, 6), else on standard error.
pub fn expect(folder: &Path, line: &str, code: i32, texts: &[&str]) -> Said {
    let said = run(folder, line);
    assert_eq!(said.code, Some(code), "{line}: {said:?}");
    let printed = match code {
        0 | 6 => &said.out,
        _ => &said.err,
    };
    for text in texts {
        assert!(printed.contains(text), "{line}: no `{text}` in: {said:?}");
    }
    said
}

/// Sends a signal.
pub fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill")
        .args(["-s", name, &child.id().to_string()])
        .status();
    assert!(sent.expect("kill runs").success());
}

/// The signals that end a command. Without SIGHUP where these tests run with SIGHUP ignored
/// (`nohup`): the command inherits that and keeps it.
pub fn signals() -> Vec<&'static str> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .unwrap_or(0);
    let mut out = vec!["INT", "TERM"];
    if ignored & 1 == 0 {
        out.push("HUP");
    }
    out
}
