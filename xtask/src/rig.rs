//! Builds the host programs (embedded rig, forcectl, evaluations) and hands over to them.

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

/// Commands of forcectl that may start an embedded rig, one a line.
const EMULATING: &str = include_str!("../../host-cli/emulating.txt");

/// Commands that take the forcectl that has been built before, for whoever calls
/// `cargo xtask forcectl`; `cargo forcectl` does not get here with them (launcher/main.rs).
const AT_ONCE: [&str; 3] = ["clear", "disarm", "stop"];

/// Commands that need nothing of recordings, experiments, estimation and analysis. The first build
/// for such a command leaves these out, and so takes minutes less.
const LIGHT: [&str; 5] = ["hold", "monitor", "rig", "set-force", "status"];

/// forcectl and what it starts without those crates. `features` makes the dependencies those of all
/// packages.
pub const LIGHT_BUILD: [&str; 6] = [
    "--package=emulator",
    "--package=host-cli",
    "--package=features",
    "--no-default-features",
    "--features=emulator/default",
    "--bin=forcectl",
];

/// A cargo command for all packages of this computer.
///
/// Always all of them, in the same profile: cargo unites the features of the packages that it is
/// given, so any other choice could compile dependencies a second time. `--ignore-rust-version`:
/// see docs/developing.md.
pub fn cargo(workspace: &Workspace, subcommand: &str) -> Command {
    let mut cargo = cargo_for(workspace, subcommand);
    cargo.args(["--workspace", "--exclude", "on-target"]);
    cargo
}

/// What selects the packages whose tests run the embedded rig; `features` makes their dependencies
/// those of all packages.
pub const EMULATED: [&str; 6] = [
    "--package",
    "emulator",
    "--package",
    "scenarios",
    "--package",
    "features",
];

/// Features with robots on ROS, which no program has by default. What the selection of [`cargo`]
/// compiles anyhow keeps its features (tests/features/Cargo.toml).
pub const ROS: [&str; 2] = [
    "robot-ros/ros1,host-cli/ros1",
    "robot-ros/ros2,host-cli/ros2",
];

/// A cargo command whose packages the caller names.
pub fn cargo_for(workspace: &Workspace, subcommand: &str) -> Command {
    let mut cargo = process::cargo(Sees::CompilerAndFlags);
    cargo
        .current_dir(workspace.root())
        .args([subcommand, "--ignore-rust-version", "--target-dir"])
        .arg(workspace.target());
    cargo
}

/// Builds some of the host programs.
///
/// # Errors
/// When cargo fails.
pub fn build(workspace: &Workspace, programs: &[&str]) -> Result<()> {
    let first = if (programs.iter()).all(|name| workspace.program(name).is_file()) {
        ""
    } else {
        " (the first time takes minutes, see Times in docs/developing.md)"
    };
    say(format!("{}: building{first}", programs.join(" and ")));
    let mut command = cargo(workspace, "build");
    for program in programs {
        command.args(["--bin", program]);
    }
    process::run(&mut command).map_err(not_built)
}

fn not_built(failure: Failure) -> Failure {
    Failure::new(format!("it can't be built: {failure}")).remedy(
        "cargo's message is above; a failed download is retried by running the command again",
    )
}

/// Builds forcectl, and the rig, with what a light command needs.
fn build_light(workspace: &Workspace, with_rig: bool) -> Result<()> {
    say("forcectl: building what this command needs (docs/developing.md, Times)");
    let mut command = cargo_for(workspace, "build");
    command.args(LIGHT_BUILD);
    if with_rig {
        command.arg("--bin=rig");
    }
    process::run(&mut command).map_err(not_built)?;
    fs::metadata(workspace.program("forcectl"))
        .and_then(|file| {
            fs::create_dir_all(workspace.notes())?;
            fs::write(light_note(workspace), file.len().to_string())
        })
        .map_err(|error| Failure::new(format!("target/xtask can't be written: {error}")))
}

/// A note of the last light build: the length of its forcectl.
fn light_note(workspace: &Workspace) -> PathBuf {
    workspace.notes().join("light-forcectl")
}

/// Whether a light build replaces no whole forcectl. One of any other build, by plain cargo too,
/// has another length than the note says.
fn may_be_light(workspace: &Workspace) -> bool {
    fs::metadata(workspace.program("forcectl")).map_or(true, |file| {
        fs::read_to_string(light_note(workspace)).is_ok_and(|note| note == file.len().to_string())
    })
}

/// Whether a call of forcectl does without the crates that the light build leaves out.
fn is_light(words: &[&str]) -> bool {
    let more = ["--record", "--foxglove", "--web", "--help", "-h"];
    let mut options = words
        .iter()
        .map(|word| word.split('=').next().unwrap_or(word));
    (command(words).first()).is_some_and(|word| LIGHT.contains(word))
        && !options.any(|option| more.contains(&option))
}

/// Builds the firmware image.
fn build_image(workspace: &Workspace) -> Result<()> {
    let arm = setup::ensure(workspace, setup::route_from_environment()?)?;
    firmware::build(workspace, &arm).map(|_| ())
}

/// A program, told where image and embedded rig are.
fn program(workspace: &Workspace, name: &str) -> Command {
    let mut command = Command::new(workspace.program(name));
    command
        .env(ELF_VARIABLE, workspace.firmware_elf())
        .env(RIG_VARIABLE, workspace.program("rig"));
    command
}

/// Whether a call of forcectl may start an embedded rig, and so needs firmware and rig built.
pub fn needs_embedded_rig(arguments: &[OsString]) -> bool {
    let words: Vec<&str> = arguments
        .iter()
        .filter_map(|argument| argument.to_str())
        .take_while(|word| *word != "--")
        .collect();
    if help::is_requested(arguments) || words.iter().any(|word| ["-V", "--version"].contains(word))
    {
        return false;
    }
    let link = words.iter().enumerate().find_map(|(index, word)| {
        let next = || words.get(index + 1).copied();
        word.strip_prefix("--link=")
            .or_else(|| next().filter(|_| *word == "--link"))
    });
    if let Some(link) = link {
        return link.starts_with("embedded");
    }
    let command = command(&words);
    EMULATING
        .lines()
        .any(|line| command.starts_with(&line.split(' ').collect::<Vec<_>>()))
}

/// The words that name a command of forcectl and the step below it. Options that may stand before
/// them take no value.
fn command<'a>(words: &[&'a str]) -> Vec<&'a str> {
    let plain = words.iter().filter(|word| !word.starts_with('-'));
    plain.copied().take(2).collect()
}

/// Builds what a call of forcectl needs, then becomes forcectl: its exit code and Ctrl-C are the
/// caller's.
///
/// # Errors
/// When something can't be built or started; otherwise doesn't return.
pub fn forcectl(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let words: Vec<&str> = arguments.iter().filter_map(|word| word.to_str()).collect();
    let light = is_light(&words) && may_be_light(workspace);
    let at_once = (command(&words).first()).is_some_and(|word| AT_ONCE.contains(word));
    let emulated = needs_embedded_rig(arguments);
    if emulated {
        build_image(workspace)?;
    }
    if at_once && workspace.program("forcectl").is_file() {
        // The program that there is.
    } else if light {
        build_light(workspace, emulated)?;
    } else if emulated {
        build(workspace, &["rig", "forcectl"])?;
    } else {
        build(workspace, &["forcectl"])?;
    }
    note_target(workspace)?;
    let mut command = program(workspace, "forcectl");
    command.args(arguments);
    hand_over(command)
}

/// Tells the launcher a target folder that cargo's configuration has chosen: it asks no cargo.
fn note_target(workspace: &Workspace) -> Result<()> {
    let usual = workspace.root().join("target");
    if workspace.target() == usual {
        return Ok(());
    }
    let note = usual.join("launcher");
    fs::create_dir_all(&note)
        .and_then(|()| {
            fs::write(
                note.join("target"),
                workspace.target().display().to_string(),
            )
        })
        .map_err(|error| Failure::new(format!("{} can't be written: {error}", note.display())))
}

/// Builds an evaluation on the embedded rig, with firmware and rig, and prepares its call. Its help
/// needs the program alone.
fn evaluation_on_rig(workspace: &Workspace, name: &str, arguments: &[OsString]) -> Result<Command> {
    if help::is_requested(arguments) {
        build(workspace, &[name])?;
    } else {
        build_image(workspace)?;
        build(workspace, &["rig", "forcectl", name])?;
    }
    let mut command = program(workspace, name);
    command.current_dir(workspace.root());
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

/// Builds and runs an evaluation that needs neither firmware nor embedded rig.
///
/// # Errors
/// When it can't be built or started.
pub fn evaluation(workspace: &Workspace, name: &str, arguments: &[OsString]) -> Result<u8> {
    build(workspace, &[name])?;
    let mut command = program(workspace, name);
    command.args(arguments);
    hand_over(command)
}

/// Builds and runs the fault campaign or its mutants, which need neither firmware nor embedded rig;
/// or the flips of the running image, which need both.
///
/// # Errors
/// When it can't be built or started.
pub fn faults(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let words: Vec<String> = arguments
        .iter()
        .map(|argument| argument.to_string_lossy().into_owned())
        .collect();
    if let Some(at) = words.iter().position(|word| word == "--mutants") {
        if help::is_requested(arguments) {
            return evaluation(workspace, "faults", &["--help".into()]);
        }
        let killed = mutants::run(workspace, &words[at + 1..])?;
        return Ok(u8::from(!killed));
    }
    if words.iter().any(|word| word == "--image") {
        let mut command = evaluation_on_rig(workspace, "image-faults", arguments)?;
        command.args(arguments);
        return hand_over(command);
    }
    evaluation(workspace, "faults", arguments)
}

/// Builds and runs the closed loop on rigs with undeclared effects, into `target/closed-loop`.
///
/// # Errors
/// When something can't be built or started.
pub fn closed_loop(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let mut command = evaluation_on_rig(workspace, "closed-loop", arguments)?;
    command
        .arg("--forcectl")
        .arg(workspace.program("forcectl"))
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
    use std::collections::BTreeSet;
    use std::path::Path;

    /// Cargo compiles a package again for each set of features: no smaller selection may ask for a
    /// set of its own. What this prints belongs into tests/features/Cargo.toml.
    #[test]
    fn smaller_selections_take_over_what_the_whole_workspace_compiles() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let compiled = |edges: &str, selection: &[&str]| -> BTreeSet<String> {
            let output = Command::new(env!("CARGO"))
                .current_dir(root)
                .args(["tree", "--locked", "--prefix=none", "--format={p} [{f}]"])
                .args(["--edges", edges])
                .args(selection)
                .output()
                .unwrap();
            let errors = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{errors}");
            // Packages of the workspace, which name a folder, may differ: that is what a smaller
            // selection leaves out.
            String::from_utf8_lossy(&output.stdout)
                .lines()
                .filter(|line| !line.contains(&root.display().to_string()))
                .map(|line| line.trim_end_matches(" (*)").to_owned())
                .collect()
        };
        let whole = ["--workspace", "--exclude=on-target"];
        let tests = [&whole[..], &["--features=estimator/networks"]].concat();
        let all = compiled("normal,build,dev", &tests);
        assert!(all.len() > 100);
        // With ROS, what the whole workspace has as well has the same features.
        let features = ROS.map(|feature| format!("--features={feature}"));
        let ros: Vec<&str> = (tests.iter().copied())
            .chain(features.iter().map(String::as_str))
            .collect();
        let ros = compiled("normal,build,dev", &ros);
        let lost: Vec<_> = all.difference(&ros).collect();
        assert!(lost.is_empty(), "with ROS: {lost:#?}");
        // `cargo tree` knows no programs.
        let light = LIGHT_BUILD.split(|word| word.starts_with("--bin")).next();
        for (edges, selection) in [
            ("normal,build", &whole[..]),
            ("normal,build", light.unwrap()),
            ("normal,build,dev", &EMULATED),
            ("normal,build", &["--package=xtask"]),
            ("normal,build", &["--package=forcerig", "--features=shared"]),
        ] {
            let others: Vec<_> = (compiled(edges, selection).difference(&all).cloned()).collect();
            assert!(others.is_empty(), "{selection:?}: {others:#?}");
        }
    }

    #[test]
    fn a_whole_forcectl_is_not_replaced_by_a_light_one() {
        let folder = tempfile::tempdir().unwrap();
        let workspace = Workspace::of_copy(folder.path().into(), folder.path().into());
        fs::create_dir_all(workspace.programs()).unwrap();
        fs::create_dir_all(workspace.notes()).unwrap();
        assert!(may_be_light(&workspace));
        fs::write(workspace.program("forcectl"), "by plain cargo").unwrap();
        assert!(!may_be_light(&workspace));
        fs::write(workspace.program("forcectl"), "light").unwrap();
        fs::write(light_note(&workspace), "5").unwrap();
        assert!(may_be_light(&workspace));
        fs::write(workspace.program("forcectl"), "whole again").unwrap();
        assert!(!may_be_light(&workspace));
    }

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
        assert!(needs("calibrate zero --yes"));
        assert!(needs("experiment run --link embedded"));
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
            "calibrate show",
            "estimate train",
            "recording check data",
            "workspace",
            "some-later-command",
            "--version",
        ] {
            assert!(!needs(line), "`{line}` builds the firmware without need");
        }
    }
}
