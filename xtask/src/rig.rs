//! Builds the host programs of a run (embedded rig, forcectl, bench) and hands over to them.

use std::ffi::OsString;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::firmware;
use crate::help;
use crate::mutants;
use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::toolchain::setup;
use crate::workspace::Workspace;

/// Tells a program where the firmware image is.
pub const ELF_VARIABLE: &str = "FORCE_FIRMWARE_ELF";
/// Tells a program where the embedded rig is.
pub const RIG_VARIABLE: &str = "FORCE_RIG_BIN";
/// Tells the scenarios how many bytes of stack the image's machine code can take.
pub const STACK_VARIABLE: &str = "FORCE_STACK_BOUND";

/// A cargo command for the packages around the embedded rig.
///
/// Always the same packages, profile and options: cargo unites the features of the packages it is
/// given, so any other choice could compile the emulator a second time. `--ignore-rust-version`:
/// see docs/developing.md.
pub fn cargo(workspace: &Workspace, subcommand: &str) -> Command {
    let mut cargo = process::cargo(Sees::CompilerAndFlags);
    cargo
        .current_dir(workspace.root())
        .args([subcommand, "--release", "--ignore-rust-version"])
        .arg("--target-dir")
        .arg(workspace.target());
    cargo
}

/// The command that builds some of the programs.
pub fn build_command(workspace: &Workspace, programs: &[&str]) -> Command {
    let mut command = cargo(workspace, "build");
    // Always the same packages, whichever program is needed: other packages would mean other features of
    // their common dependencies, and a second build of them.
    for package in ["emulator", "host-cli", "bench", "closed-loop", "scenarios"] {
        command.args(["--package", package]);
    }
    for program in programs {
        command.args(["--bin", program]);
    }
    command
}

/// Builds some of the programs `rig`, `forcectl`, `bench` and `closed-loop` into `target/release`.
///
/// # Errors
/// When cargo fails.
pub fn build(workspace: &Workspace, programs: &[&str]) -> Result<()> {
    let first = if programs
        .iter()
        .all(|name| workspace.release_program(name).is_file())
    {
        ""
    } else {
        " (the first time takes two to five minutes)"
    };
    say(format!("{}: building{first}", programs.join(" and ")));
    process::run(&mut build_command(workspace, programs)).map_err(|failure| {
        Failure::new(format!("{} can't be built: {failure}", programs.join(", "))).remedy(
            "cargo's message is above; a failed download is retried by running the command again",
        )
    })
}

/// Whether a call of forcectl works on the embedded rig, and so needs firmware and rig built.
///
/// Errs on the side of building: only a call that clearly goes elsewhere is excepted.
pub fn needs_embedded_rig(arguments: &[OsString]) -> bool {
    // Those that never start an emulation are offline as well: `stop` must not wait for a compiler.
    const OFFLINE: [&str; 15] = [
        "arm",
        "check",
        "clear",
        "completions",
        "disarm",
        "experiment",
        "explain",
        "help",
        "init",
        "inject",
        "man",
        "residual",
        "serve",
        "stop",
        "zero",
    ];
    const ONLINE: [&str; 7] = [
        "hold",
        "identify",
        "monitor",
        "record",
        "rig",
        "set-force",
        "status",
    ];
    let words: Vec<&str> = arguments
        .iter()
        .filter_map(|argument| argument.to_str())
        .take_while(|word| *word != "--")
        .collect();
    if words.is_empty()
        || words
            .iter()
            .any(|word| ["-h", "--help", "-V", "--version"].contains(word))
    {
        return false;
    }
    let link = words.iter().enumerate().find_map(|(index, word)| {
        word.strip_prefix("--link=").or_else(|| {
            (*word == "--link")
                .then(|| words.get(index + 1).copied())
                .flatten()
        })
    });
    if link.is_some_and(|link| !link.starts_with("embedded")) {
        return false;
    }
    words
        .iter()
        .find(|word| OFFLINE.contains(word) || ONLINE.contains(word))
        .is_none_or(|word| ONLINE.contains(word))
}

/// Builds what a call of forcectl needs, then becomes forcectl: its exit code and Ctrl-C are the
/// caller's.
///
/// # Errors
/// When something can't be built or started; otherwise doesn't return.
pub fn forcectl(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    if needs_embedded_rig(arguments) {
        let arm = setup::ensure(workspace, setup::route_from_environment()?)?;
        firmware::build(workspace, &arm)?;
        build(workspace, &["rig", "forcectl"])?;
    } else {
        build(workspace, &["forcectl"])?;
    }
    let mut command = Command::new(workspace.release_program("forcectl"));
    command
        .args(arguments)
        .env(ELF_VARIABLE, workspace.firmware_elf())
        .env(RIG_VARIABLE, workspace.release_program("rig"));
    hand_over(command)
}

/// Builds an evaluation on the embedded rig, with firmware and rig, and prepares its call. Its help needs the program alone.
fn evaluation_on_rig(
    workspace: &Workspace,
    program: &str,
    arguments: &[OsString],
) -> Result<Command> {
    if help::is_requested(arguments) {
        build(workspace, &[program])?;
    } else {
        let arm = setup::ensure(workspace, setup::route_from_environment()?)?;
        firmware::build(workspace, &arm)?;
        build(workspace, &["rig", "forcectl", program])?;
    }
    let mut command = Command::new(workspace.release_program(program));
    command
        .current_dir(workspace.root())
        .env(ELF_VARIABLE, workspace.firmware_elf())
        .env(RIG_VARIABLE, workspace.release_program("rig"));
    Ok(command)
}

/// Makes a folder below `target/`.
fn folder(workspace: &Workspace, name: &str) -> Result<PathBuf> {
    let folder = workspace.target().join(name);
    fs::create_dir_all(&folder)
        .map_err(|error| Failure::new(format!("{} can't be made: {error}", folder.display())))?;
    Ok(folder)
}

/// Builds and runs the bench, which writes `target/bench/figures.json`.
///
/// # Errors
/// When something can't be built or started.
pub fn bench(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let mut command = evaluation_on_rig(workspace, "bench", arguments)?;
    let out = folder(workspace, "bench")?.join("figures.json");
    command.arg("--out").arg(out).args(arguments);
    hand_over(command)
}

/// Builds a program that needs nothing of the embedded rig, and says where it is.
///
/// # Errors
/// When cargo fails.
pub fn build_host_program(workspace: &Workspace, package: &str, program: &str) -> Result<PathBuf> {
    process::run(
        process::cargo(Sees::CompilerAndFlags)
            .current_dir(workspace.root())
            .args(["build", "--release", "--package", package, "--bin", program])
            .arg("--target-dir")
            .arg(workspace.target()),
    )?;
    Ok(workspace.release_program(program))
}

/// Builds and runs an evaluation that needs neither firmware nor embedded rig; package and program have one name.
///
/// # Errors
/// When it can't be built or started.
pub fn evaluation(workspace: &Workspace, name: &str, arguments: &[OsString]) -> Result<u8> {
    let mut command = Command::new(build_host_program(workspace, name, name)?);
    command.args(arguments);
    hand_over(command)
}

/// Builds and runs the fault campaign, into `target/faults`, or its mutants, which need neither firmware nor embedded rig; or the
/// flips of the running image, which need both.
///
/// # Errors
/// When it can't be built or started.
pub fn faults(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let words: Vec<String> = arguments
        .iter()
        .map(|argument| argument.to_string_lossy().into_owned())
        .collect();
    if let Some(at) = words.iter().position(|word| word == "--mutants") {
        let killed = mutants::run(workspace, &words[at + 1..])?;
        return Ok(u8::from(!killed));
    }
    if words.iter().any(|word| word == "--image") {
        let mut command = evaluation_on_rig(workspace, "image-faults", arguments)?;
        command.args(arguments);
        return hand_over(command);
    }
    let program = build_host_program(workspace, "faults", "faults")?;
    let mut command = Command::new(program);
    if !words.iter().any(|word| word.starts_with("--out")) {
        let seed = words
            .iter()
            .position(|word| word == "--seed")
            .and_then(|at| words.get(at + 1))
            .map_or("1", String::as_str);
        let file = folder(workspace, "faults")?.join(format!("seed-{seed}.jsonl"));
        command.arg("--out").arg(file);
    }
    command.args(arguments);
    hand_over(command)
}

/// Builds and runs the closed loop on rigs with undeclared effects, into `target/closed-loop`.
///
/// # Errors
/// When something can't be built or started.
pub fn closed_loop(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let mut command = evaluation_on_rig(workspace, "closed-loop", arguments)?;
    command
        .arg("--forcectl")
        .arg(workspace.release_program("forcectl"))
        .arg("--out")
        .arg(workspace.target().join("closed-loop"))
        .args(arguments);
    hand_over(command)
}

/// Replaces this process by another program.
#[cfg(unix)]
pub fn hand_over(mut command: Command) -> Result<u8> {
    use std::os::unix::process::CommandExt;
    let error = command.exec();
    Err(process::not_started(&command, &error))
}

/// Runs another program to its end and returns its exit code.
#[cfg(not(unix))]
pub fn hand_over(mut command: Command) -> Result<u8> {
    let status = command
        .status()
        .map_err(|error| process::not_started(&command, &error))?;
    Ok(status
        .code()
        .and_then(|code| u8::try_from(code).ok())
        .unwrap_or(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needs(line: &str) -> bool {
        let arguments: Vec<OsString> = line.split_whitespace().map(OsString::from).collect();
        needs_embedded_rig(&arguments)
    }

    #[test]
    fn commands_to_the_rig_need_it() {
        assert!(needs("set-force 0 2.5 0"));
        assert!(needs("set-force 0 -2.5 0 --link embedded"));
        assert!(needs("--json status --link=embedded"));
        assert!(needs("status --rig usb.toml"));
        assert!(needs("rig --seed 3"));
        assert!(needs("hold --duration 3"));
        assert!(needs("record data/check"));
        assert!(needs("identify --out out"));
        assert!(needs("monitor --duration 3"));
    }

    #[test]
    fn a_real_board_needs_none() {
        assert!(!needs("set-force 0 2.5 0 --link serial:/dev/ttyACM0"));
        assert!(!needs("status --link=usb"));
        assert!(!needs("monitor --rig my.toml --link serial:/dev/ttyUSB0"));
    }

    #[test]
    fn offline_commands_need_none() {
        for line in [
            "",
            "--help",
            "set-force --help",
            "help set-force",
            "explain 33",
            // These never start an emulation.
            "stop",
            "clear",
            "disarm",
            "check rig.toml",
            "init rig.toml",
            "--json check rig.toml",
            "completions bash",
            "man --out pages",
            "residual --data logs",
            "--version",
        ] {
            assert!(!needs(line), "`{line}` builds the firmware without need");
        }
    }

    #[test]
    fn in_doubt_it_is_built() {
        assert!(needs("some-later-command"));
        assert!(needs("status --link"));
    }
}
