//! The default experiment, whole: all trials in shards side by side, then its report and data card
//! for a release.

use std::ffi::OsString;
use std::process::Command;

use crate::process;
use crate::report::{say, Failure, Result};
use crate::rig;
use crate::workspace::Workspace;

/// Shards where the caller names no number.
const SHARDS: usize = 2;

/// Runs what is left of the default experiment into `target/experiment` and writes its report into
/// `target/experiment-report`.
///
/// # Errors
/// When forcectl can't be built or a shard fails.
pub fn report(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let Some(shards) = shards(arguments) else {
        eprintln!("xtask: usage: cargo xtask experiment-report [--shards N], N from 1 to 64");
        return Ok(2);
    };
    rig::build(workspace, &["forcectl"])?;
    let program = workspace.program("forcectl");
    let folder = workspace.target().join("experiment");
    let forcectl = || {
        let mut command = Command::new(&program);
        command.current_dir(workspace.root());
        command
    };
    say(format!(
        "running the default experiment in {shards} shards into {}",
        folder.display()
    ));
    let mut running = Vec::new();
    for index in 1..=shards {
        let mut command = forcectl();
        command
            .args(["experiment", "run", "--resume", "--out"])
            .arg(&folder)
            .args(["--trial", &format!("{index}/{shards}")]);
        let child = command
            .spawn()
            .map_err(|error| process::not_started(&command, &error))?;
        running.push((index, child));
    }
    let mut failed = Vec::new();
    for (index, mut child) in running {
        let status = child
            .wait()
            .map_err(|error| Failure::new(format!("shard {index} can't be waited for: {error}")))?;
        if !status.success() {
            failed.push(format!("shard {index}: {status}"));
        }
    }
    if !failed.is_empty() {
        return Err(Failure::new(format!(
            "not every trial is good: {}",
            failed.join(", ")
        ))
        .remedy("what each attempt failed of is above; running the command again repeats only what is left"));
    }
    let mut command = forcectl();
    command
        .args(["experiment", "report"])
        .arg(&folder)
        .arg("--report-into")
        .arg(workspace.target().join("experiment-report"));
    rig::hand_over(command)
}

/// The number of shards that the arguments ask for; `None` where they can't be.
fn shards(arguments: &[OsString]) -> Option<usize> {
    let words: Option<Vec<&str>> = arguments.iter().map(|argument| argument.to_str()).collect();
    match words?.as_slice() {
        [] => Some(SHARDS),
        ["--shards", number] => number.parse().ok().filter(|n| (1..=64).contains(n)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_a_number_from_1_to_64() {
        let of = |line: &str| {
            let words: Vec<OsString> = line.split_whitespace().map(OsString::from).collect();
            shards(&words)
        };
        assert_eq!(of(""), Some(SHARDS));
        assert_eq!(of("--shards 4"), Some(4));
        for wrong in ["--shards", "--shards 0", "--shards 65", "--shards x", "4"] {
            assert_eq!(of(wrong), None, "{wrong}");
        }
    }
}
