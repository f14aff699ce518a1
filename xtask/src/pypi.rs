//! Python environments with packages from PyPI, below the target folder.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::process;
use crate::report::{say, Failure, Result};
use crate::workspace::Workspace;

/// Names the Python to make environments with.
pub const PYTHON_VARIABLE: &str = "FORCE_PYTHON";

/// The Python to make environments with.
pub fn base() -> OsString {
    env::var_os(PYTHON_VARIABLE).unwrap_or_else(|| "python3".into())
}

/// The Python of an environment.
pub fn interpreter(environment: &Path) -> PathBuf {
    environment.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    })
}

/// Python with the packages of a requirements file, in the folder `name` below the target folder;
/// made once, and anew when the requirements change. `pip`: options of `pip install`.
///
/// # Errors
/// When Python or the packages can't be had.
pub fn environment(
    workspace: &Workspace,
    name: &str,
    requirements: &Path,
    pip: &[&str],
) -> Result<PathBuf> {
    let required = fs::read_to_string(requirements).map_err(|error| {
        Failure::new(format!("{} can't be read: {error}", requirements.display()))
    })?;
    let folder = workspace.target().join(name);
    let python = interpreter(&folder);
    // Written last, so an environment that was interrupted is made again.
    let installed = folder.join("requirements.installed");
    if fs::read_to_string(&installed).is_ok_and(|text| text == required) {
        return Ok(python);
    }
    say(format!(
        "{name}: installing pinned packages from PyPI into {}",
        folder.display()
    ));
    let no_python = |failure: Failure| {
        Failure::new(format!("no Python environment: {failure}")).remedy(format!(
            "Python 3.11 or later with venv is needed (Debian: python3-venv); {PYTHON_VARIABLE} may name another"
        ))
    };
    process::run(
        Command::new(base())
            .args(["-m", "venv", "--clear"])
            .arg(&folder),
    )
    .map_err(no_python)?;
    process::run(
        Command::new(&python)
            .args(["-m", "pip", "install", "--disable-pip-version-check"])
            .args(pip)
            .arg("--requirement")
            .arg(requirements),
    )
    .map_err(|failure| {
        Failure::new(format!("the packages can't be installed: {failure}"))
            .remedy("pip's message is above; it needs the network, or an index of its own in pip's settings")
    })?;
    fs::write(&installed, required).map_err(|error| {
        Failure::new(format!("{} can't be written: {error}", installed.display()))
    })?;
    Ok(python)
}
