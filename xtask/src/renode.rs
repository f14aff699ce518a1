//! Finds Renode, runs the suites in `renode/suites` on it, and compares it with the embedded rig.
//!
//! Renode's own exit code says nothing (it is 0 even after a script error), so the count comes from
//! the suites' result file.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::rig;
use crate::tally::Tally;
use crate::workspace::Workspace;

/// Names the `renode` program where it is in no usual place.
pub const RENODE_VARIABLE: &str = "RENODE";

/// The version that the suites are written for, and that `--install` fetches.
const VERSION: &str = "1.16.1";

/// A Renode with its test runner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Renode {
    /// The `renode` program.
    pub program: PathBuf,
    /// `renode-test`.
    pub tests: PathBuf,
    /// A Python environment with the Robot Framework that belongs to it, where `--install` made
    /// one.
    python: Option<PathBuf>,
}

/// Where the portable package is unpacked by `--install`.
fn own_folder(workspace: &Workspace) -> PathBuf {
    workspace.target().join("renode")
}

/// Looks where a Renode usually is: `RENODE`, `PATH`, what `--install` fetched, the portable
/// package's usual folders.
pub fn find(workspace: &Workspace) -> Option<Renode> {
    let home = env::var_os("HOME").map(PathBuf::from).unwrap_or_default();
    let own = own_folder(workspace);
    let candidates = [
        env::var_os(RENODE_VARIABLE).map(PathBuf::from),
        process::find_program("renode"),
        Some(own.join("renode")),
        Some(home.join("renode_portable/renode")),
        Some("/opt/renode/renode".into()),
        Some("/Applications/Renode.app/Contents/MacOS/renode".into()),
    ];
    candidates
        .into_iter()
        .flatten()
        .find_map(|program| with_tests(&program, &own))
}

/// A Renode at this path, when its test runner is beside it or on `PATH`.
fn with_tests(program: &Path, own: &Path) -> Option<Renode> {
    if !program.is_file() {
        return None;
    }
    let beside = |path: &Path| path.with_file_name("renode-test");
    let tests = [
        Some(beside(program)),
        program.canonicalize().ok().map(|real| beside(&real)),
        process::find_program("renode-test"),
    ]
    .into_iter()
    .flatten()
    .find(|path| path.is_file())?;
    let python = own.join("venv/bin");
    Some(Renode {
        program: program.to_path_buf(),
        tests,
        python: python.join("python3").is_file().then_some(python),
    })
}

/// How a person gets Renode on this system, in one line.
fn how_to_get() -> String {
    let package = match env::consts::OS {
        "linux" => {
            format!("`cargo xtask renode-test --install` fetches the portable package {VERSION}")
        }
        "macos" => format!("download renode-{VERSION}-dotnet.osx-arm64-portable.dmg"),
        _ => format!("download renode-{VERSION}.windows-portable-dotnet.zip"),
    };
    format!("{package} (https://github.com/renode/renode/releases/tag/v{VERSION}), or name an installed one in {RENODE_VARIABLE}")
}

/// Renode, or the two lines that say that it is missing.
///
/// # Errors
/// When there is none.
pub fn require(workspace: &Workspace) -> Result<Renode> {
    find(workspace).ok_or_else(|| {
        // Two lines: a person in front of a terminal needs no more.
        Failure::new(format!(
            "Renode is not installed (looked at {RENODE_VARIABLE}, PATH and the portable package's usual places)\n{}",
            how_to_get()
        ))
    })
}

/// Fetches the official portable package and what its test runner needs of Python.
///
/// # Errors
/// When the system has no such package, or a step fails: mostly a network that doesn't let it
/// through.
pub fn install(workspace: &Workspace) -> Result<()> {
    if env::consts::OS != "linux" || env::consts::ARCH != "x86_64" {
        return Err(
            Failure::new("--install knows the package for Linux on x86-64 only")
                .remedy(how_to_get()),
        );
    }
    let folder = own_folder(workspace);
    fs::create_dir_all(&folder)
        .map_err(|error| Failure::new(format!("{} can't be made: {error}", folder.display())))?;
    let archive = folder.join("package.tar.gz");
    let address = format!(
        "https://github.com/renode/renode/releases/download/v{VERSION}/renode-{VERSION}.linux-portable-dotnet.tar.gz"
    );
    say(format!("renode: fetching {address}"));
    let fetched = process::run(
        process::command("curl", Sees::CompilerAndFlags)
            .args(["--fail", "--location", "--silent", "--show-error"])
            .args([
                "--connect-timeout",
                "20",
                "--speed-time",
                "30",
                "--speed-limit",
                "1000",
            ])
            .arg("--output")
            .arg(&archive)
            .arg(&address),
    );
    fetched.map_err(|failure| {
        Failure::new(format!("the package can't be fetched: {failure}")).remedy(format!(
            "where the network doesn't allow it, {}",
            how_to_get()
        ))
    })?;
    process::run(
        process::command("tar", Sees::CompilerAndFlags)
            .args(["--extract", "--strip-components=1", "--file"])
            .arg(&archive)
            .arg("--directory")
            .arg(&folder),
    )?;
    say("renode: setting up Python for its tests");
    process::run(
        process::command("python3", Sees::CompilerAndFlags)
            .args(["-m", "venv"])
            .arg(folder.join("venv")),
    )?;
    process::run(
        process::command(folder.join("venv/bin/pip"), Sees::CompilerAndFlags)
            .args(["install", "--quiet", "--requirement"])
            .arg(folder.join("tests/requirements.txt")),
    )?;
    // A half-full disk shows here rather than in the first suite.
    require(workspace).map(|_| ())
}

/// Builds what the suites need beside the firmware image: plant library, `renode-rig`, forcectl.
fn build_programs(workspace: &Workspace) -> Result<()> {
    rig::build(workspace, &["forcectl"])?;
    process::run(rig::cargo_for(workspace, "build").args([
        "--package",
        "plant-abi",
        "--package",
        "renode-rig",
    ]))
}

fn plant_library(workspace: &Workspace) -> PathBuf {
    workspace.programs().join(format!(
        "{}plant_abi{}",
        env::consts::DLL_PREFIX,
        env::consts::DLL_SUFFIX
    ))
}

/// All suites, in the order of their names.
fn suites(workspace: &Workspace) -> Result<Vec<PathBuf>> {
    let folder = workspace.root().join("renode/suites");
    let entries = fs::read_dir(&folder)
        .map_err(|error| Failure::new(format!("{}: {error}", folder.display())))?;
    let mut found: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "robot"))
        .collect();
    found.sort();
    if found.is_empty() {
        return Err(Failure::new(format!("no suites in {}", folder.display())));
    }
    Ok(found)
}

/// A command with the Python environment of this Renode in front of `PATH`.
fn with_python(renode: &Renode, mut command: Command) -> Command {
    if let Some(python) = &renode.python {
        let path = env::var_os("PATH").unwrap_or_default();
        let all = std::iter::once(python.clone()).chain(env::split_paths(&path));
        if let Ok(joined) = env::join_paths(all) {
            command.env("PATH", joined);
        }
    }
    command
}

/// Runs the suites with the image that is built, and counts. Logs stay in `target/renode-test`.
///
/// # Errors
/// When something can't be built, or the runner leaves no result.
pub fn run(workspace: &Workspace, renode: &Renode, arguments: &[OsString]) -> Result<Tally> {
    run_image(workspace, renode, &workspace.firmware_elf(), arguments)
}

/// As [`run`], with this image.
///
/// # Errors
/// As [`run`].
pub fn run_image(
    workspace: &Workspace,
    renode: &Renode,
    elf: &Path,
    arguments: &[OsString],
) -> Result<Tally> {
    build_programs(workspace)?;
    let results = workspace.target().join("renode-test");
    // An old result must not be taken for this run's.
    let _ = fs::remove_dir_all(&results);
    fs::create_dir_all(&results)
        .map_err(|error| Failure::new(format!("{} can't be made: {error}", results.display())))?;
    let mut command = with_python(
        renode,
        process::command(&renode.tests, Sees::CompilerAndFlags),
    );
    let chosen = if arguments
        .iter()
        .any(|a| a.to_string_lossy().ends_with(".robot"))
    {
        Vec::new()
    } else {
        suites(workspace)?
    };
    let variable = |name: &str, value: &Path| {
        let mut text = OsString::from(format!("{name}:"));
        text.push(value);
        [OsString::from("--variable"), text]
    };
    command
        .current_dir(workspace.root())
        .args(&chosen)
        .arg("--results-dir")
        .arg(&results)
        .args(variable("ELF", elf))
        .args(variable("PLANT", &plant_library(workspace)))
        .args(variable("FORCECTL", &workspace.program("forcectl")))
        .args(variable("RENODE_RIG", &workspace.program("renode-rig")))
        // The models hold a native plant, which no snapshot can take along.
        .args(["--variable", "CREATE_SNAPSHOT_ON_FAIL:False"])
        // The keywords' compiled form has no place among the sources.
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .args(arguments);
    say(format!("renode: {}", renode.tests.display()));
    let status = command
        .status()
        .map_err(|error| process::not_started(&command, &error))?;
    let output = results.join("robot_output.xml");
    let text = fs::read_to_string(&output).map_err(|error| {
        Failure::new(format!("the runner left no result ({error}); it ended with {status}")).remedy(
            "its messages are above; a missing Robot Framework is installed with `pip install -r tests/requirements.txt` in Renode's folder",
        )
    })?;
    let tally = count(&text)
        .ok_or_else(|| Failure::new(format!("{} counts no tests", workspace.show(&output))))?;
    say(format!("renode: logs in {}", workspace.show(&results)));
    if tally.passed + tally.failed == 0 {
        return Err(Failure::new("no test ran at all"));
    }
    if tally.failed == 0 && !status.success() {
        return Err(Failure::new(format!(
            "all tests passed, but the runner ended with {status}"
        )));
    }
    Ok(tally)
}

/// Reads the total out of Robot Framework's result file:
/// `<stat pass="6" fail="0" skip="0">All Tests</stat>`.
fn count(xml: &str) -> Option<Tally> {
    let line = xml
        .lines()
        .find(|line| line.contains(">All Tests</stat>"))?;
    let number = |name: &str| -> Option<u64> {
        let (_, rest) = line.split_once(&format!("{name}=\""))?;
        rest.split('"').next()?.parse().ok()
    };
    Some(Tally {
        passed: number("pass")?,
        failed: number("fail")?,
        ignored: number("skip").unwrap_or(0),
    })
}

/// Runs the same scenario on the embedded rig and on Renode and prints what differs.
///
/// # Errors
/// When something can't be built or started.
pub fn agree(workspace: &Workspace, renode: &Renode, arguments: &[OsString]) -> Result<u8> {
    rig::build(workspace, &["rig"])?;
    build_programs(workspace)?;
    let mut command = process::command(workspace.program("agree"), Sees::CompilerAndFlags);
    command
        .current_dir(workspace.root())
        .arg("--elf")
        .arg(workspace.firmware_elf())
        .arg("--rig")
        .arg(workspace.program("rig"))
        .arg("--renode-rig")
        .arg(workspace.program("renode-rig"))
        .args(arguments)
        .env(RENODE_VARIABLE, &renode.program)
        .env("FORCE_RENODE_DIR", workspace.root().join("renode"))
        .env("FORCE_PLANT_LIBRARY", plant_library(workspace));
    let status = command
        .status()
        .map_err(|error| process::not_started(&command, &error))?;
    Ok(u8::from(!status.success()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_is_read_from_the_result_file() {
        let xml = "<statistics>\n<total>\n<stat pass=\"25\" fail=\"2\" skip=\"1\">All Tests</stat>\n</total>";
        let tally = count(xml).unwrap();
        assert_eq!((tally.passed, tally.failed, tally.ignored), (25, 2, 1));
    }

    #[test]
    fn a_file_without_a_total_counts_nothing() {
        assert_eq!(count("<robot></robot>"), None);
        assert_eq!(count("<stat pass=\"x\" fail=\"0\">All Tests</stat>"), None);
    }

    #[test]
    fn a_program_without_its_test_runner_is_no_renode() {
        let cargo = PathBuf::from(env!("CARGO"));
        let found = with_tests(&cargo, Path::new("/nonexistent"));
        assert_eq!(
            found.is_some(),
            process::find_program("renode-test").is_some()
        );
        assert_eq!(
            with_tests(Path::new("/nonexistent/renode"), Path::new("/")),
            None
        );
    }

    #[test]
    fn there_is_a_way_to_get_it_on_every_system() {
        assert!(how_to_get().contains(VERSION));
        assert!(how_to_get().contains(RENODE_VARIABLE));
    }
}
