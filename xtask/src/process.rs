//! Starting other programs: a clean environment, failures that name the command, stall limits.

use std::env;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::report::{Failure, Result};

/// Which of the calling environment's build settings a command may see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sees {
    /// The user's choice of compiler and flags: builds for this computer.
    CompilerAndFlags,
    /// The choice of compiler only: flags meant for this computer would break code for the board.
    Compiler,
    /// Neither: another compiler than the one that built xtask.
    Nothing,
}

/// Whether a command with the given view has to lose an environment variable.
///
/// `cargo run` describes xtask's own build to xtask in variables, which would leak into every build
/// started from here: `CARGO_MANIFEST_DIR` and its like cause needless rebuilds, and with
/// `RUSTUP_TOOLCHAIN` or `RUSTC` Debian's cargo would call rustup's compiler. Settings for the
/// network, caches and number of jobs are the user's and always stay.
pub fn is_hidden(name: &str, sees: Sees) -> bool {
    const OWN_BUILD: [&str; 6] = [
        "CARGO_BIN_NAME",
        "CARGO_CRATE_NAME",
        "CARGO_PRIMARY_PACKAGE",
        "CARGO_TARGET_TMPDIR",
        "OUT_DIR",
        "RUST_RECURSION_COUNT",
    ];
    const OWN_BUILD_PREFIXES: [&str; 2] = ["CARGO_MANIFEST_", "CARGO_PKG_"];
    const FLAGS: [&str; 4] = [
        "CARGO_BUILD_RUSTFLAGS",
        "CARGO_BUILD_TARGET",
        "CARGO_ENCODED_RUSTFLAGS",
        "RUSTFLAGS",
    ];
    const COMPILER: [&str; 12] = [
        "CARGO",
        "CARGO_BUILD_RUSTC",
        "CARGO_BUILD_RUSTC_WORKSPACE_WRAPPER",
        "CARGO_BUILD_RUSTC_WRAPPER",
        "CARGO_BUILD_RUSTDOC",
        // `cargo run` puts its compiler's libraries on the loader path.
        "LD_LIBRARY_PATH",
        "RUSTC",
        "RUSTC_BOOTSTRAP",
        "RUSTC_WORKSPACE_WRAPPER",
        "RUSTC_WRAPPER",
        "RUSTDOC",
        "RUSTUP_TOOLCHAIN",
    ];
    OWN_BUILD.contains(&name)
        || OWN_BUILD_PREFIXES
            .iter()
            .any(|prefix| name.starts_with(prefix))
        || (sees != Sees::CompilerAndFlags && FLAGS.contains(&name))
        || (sees == Sees::Nothing && COMPILER.contains(&name))
}

/// A command without the variables that [`is_hidden`] names, and without standard input.
pub fn command(program: impl AsRef<OsStr>, sees: Sees) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::null());
    for (name, _) in env::vars_os() {
        if name.to_str().is_some_and(|name| is_hidden(name, sees)) {
            command.env_remove(&name);
        }
    }
    command
}

/// The cargo that started xtask.
pub fn cargo(sees: Sees) -> Command {
    command(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()), sees)
}

/// The command line as one would type it, for messages.
pub fn line(command: &Command) -> String {
    let program = command.get_program();
    // rustup hands down the whole path of its cargo, which a user does not type.
    let mut text = if env::var_os("CARGO").is_some_and(|cargo| cargo == program) {
        "cargo".to_string()
    } else {
        program.to_string_lossy().into_owned()
    };
    for argument in command.get_args() {
        text.push(' ');
        text.push_str(&argument.to_string_lossy());
    }
    text
}

/// Turns an I/O error of starting `command` into a failure.
pub fn not_started(command: &Command, error: &io::Error) -> Failure {
    Failure::new(format!("`{}` could not be started: {error}", line(command)))
}

/// Runs to the end; standard output and error go where xtask's go.
///
/// # Errors
/// When the program can't be started or doesn't end with exit code 0.
pub fn run(command: &mut Command) -> Result<()> {
    let status = command
        .status()
        .map_err(|error| not_started(command, &error))?;
    check(command, status)
}

/// Runs to the end and returns its standard output and error.
///
/// # Errors
/// When the program can't be started; the exit code is the caller's to judge.
pub fn capture(command: &mut Command) -> Result<Output> {
    command
        .output()
        .map_err(|error| not_started(command, &error))
}

/// A failure unless the exit code is 0.
///
/// # Errors
/// Names the command and how it ended.
pub fn check(command: &Command, status: ExitStatus) -> Result<()> {
    if status.success() {
        Ok(())
    } else {
        Err(Failure::new(format!(
            "`{}` failed ({status})",
            line(command)
        )))
    }
}

/// How a command with a stall limit ended.
#[derive(Debug)]
pub enum Ended {
    /// By itself.
    Itself(ExitStatus),
    /// Stopped by xtask: nothing moved for the given time.
    Stalled,
}

/// Runs a command and stops it when `progress` (any number that grows while work is being done,
/// such as bytes downloaded) stands still for `limit`.
///
/// # Errors
/// When the program can't be started or waited for.
pub fn run_unless_stalled(
    command: &mut Command,
    limit: Duration,
    mut progress: impl FnMut() -> u64,
) -> Result<Ended> {
    let mut child = command
        .spawn()
        .map_err(|error| not_started(command, &error))?;
    let mut last_seen = progress();
    let mut last_moved = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Ok(Ended::Itself(status)),
            Ok(None) => {}
            Err(error) => return Err(not_started(command, &error)),
        }
        let seen = progress();
        if seen != last_seen {
            last_seen = seen;
            last_moved = Instant::now();
        } else if last_moved.elapsed() >= limit {
            // It may have ended in this very moment; then there is nothing left to stop.
            let _ = child.kill();
            let _ = child.wait();
            return Ok(Ended::Stalled);
        }
        thread::sleep(Duration::from_millis(100));
    }
}

/// Bytes in a folder and everything below it; 0 where there is no such folder.
pub fn folder_bytes(folder: &Path) -> u64 {
    let Ok(entries) = folder.read_dir() else {
        return 0;
    };
    entries
        .flatten()
        .filter_map(|entry| {
            let metadata = entry.metadata().ok()?;
            Some(if metadata.is_dir() {
                folder_bytes(&entry.path())
            } else {
                metadata.len()
            })
        })
        .sum()
}

/// Finds a program on `PATH`.
pub fn find_program(name: &str) -> Option<PathBuf> {
    let file = format!("{name}{}", env::consts::EXE_SUFFIX);
    env::split_paths(&env::var_os("PATH")?)
        .map(|folder| folder.join(&file))
        .find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_xtasks_own_build_never_leak() {
        for name in ["CARGO_PKG_NAME", "CARGO_MANIFEST_DIR", "OUT_DIR"] {
            for sees in [Sees::CompilerAndFlags, Sees::Compiler, Sees::Nothing] {
                assert!(is_hidden(name, sees), "{name} leaks to {sees:?}");
            }
        }
    }

    #[test]
    fn flags_and_compiler_are_hidden_step_by_step() {
        assert!(!is_hidden("RUSTFLAGS", Sees::CompilerAndFlags));
        assert!(is_hidden("RUSTFLAGS", Sees::Compiler));
        assert!(is_hidden("RUSTFLAGS", Sees::Nothing));
        for name in ["RUSTC", "RUSTUP_TOOLCHAIN", "LD_LIBRARY_PATH"] {
            assert!(!is_hidden(name, Sees::CompilerAndFlags));
            assert!(!is_hidden(name, Sees::Compiler));
            assert!(is_hidden(name, Sees::Nothing), "{name} leaks");
        }
    }

    #[test]
    fn network_and_caches_stay_the_users() {
        for name in [
            "PATH",
            "CARGO_HOME",
            "RUSTUP_HOME",
            "CARGO_HTTP_PROXY",
            "CARGO_NET_OFFLINE",
            "CARGO_BUILD_JOBS",
        ] {
            assert!(!is_hidden(name, Sees::Nothing), "{name} is the user's");
        }
    }

    #[test]
    fn a_command_is_shown_as_typed() {
        let mut command = Command::new("cargo");
        command.args(["build", "-p", "board"]);
        assert_eq!(line(&command), "cargo build -p board");
    }

    #[test]
    fn a_missing_program_is_named() {
        let error = run(&mut Command::new("no-such-program-anywhere")).unwrap_err();
        assert!(error.to_string().contains("no-such-program-anywhere"));
    }

    #[cfg(unix)]
    #[test]
    fn a_command_that_makes_no_progress_is_stopped() {
        let ended = run_unless_stalled(
            Command::new("sleep").arg("600"),
            Duration::from_millis(1),
            || 7,
        );
        assert!(matches!(ended, Ok(Ended::Stalled)));
    }

    #[cfg(unix)]
    #[test]
    fn a_command_that_ends_is_not_stalled() {
        let ended = run_unless_stalled(&mut Command::new("true"), Duration::from_secs(600), || 7);
        assert!(matches!(ended, Ok(Ended::Itself(status)) if status.success()));
    }
}
