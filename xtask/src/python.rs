//! The Python package in a clean environment: installed by pip, its tests, its notebooks.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::process::{self, Sees};
use crate::pypi::{self, PYTHON_VARIABLE};
use crate::report::{Failure, Result};
use crate::workspace::Workspace;

/// The package, below the root.
const PACKAGE: &str = "python";
/// The environment, below the target folder.
const FOLDER: &str = "python-test";
/// Builds the package. The rest that the tests need comes with it.
const BUILDER: &str = "maturin";

/// An environment with the package.
pub enum Environment {
    /// Its Python.
    Ready(PathBuf),
    /// What this computer lacks.
    Missing(String),
}

/// Makes an environment, and installs the package as a user does: `pip install ./python`, with what
/// its tests need.
///
/// # Errors
/// The package can't be built or installed.
pub fn environment(workspace: &Workspace) -> Result<Environment> {
    let base = pypi::base();
    let folder = workspace.target().join(FOLDER);
    let made = process::command(&base, Sees::CompilerAndFlags)
        .args(["-m", "venv", "--clear"])
        .arg(&folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    if !made.is_ok_and(|status| status.success()) {
        return Ok(Environment::Missing(format!(
            "{} makes no environment (Debian: python3-venv; {PYTHON_VARIABLE} names another Python)",
            base.to_string_lossy()
        )));
    }
    let python = pypi::interpreter(&folder);
    // Whether packages can be had is no matter of this one.
    let reached = pip(&python)
        .args(["--upgrade", "pip", BUILDER])
        .stderr(Stdio::null())
        .status();
    if !reached.is_ok_and(|status| status.success()) {
        return Ok(Environment::Missing(format!(
            "pip can't install {BUILDER}; often there is no way to PyPI (its message: pip install {BUILDER})"
        )));
    }
    let mut install = pip(&python);
    install
        .current_dir(workspace.root())
        .arg(format!("./{PACKAGE}[test]"))
        .env("CARGO_TARGET_DIR", workspace.target())
        // What the workspace has compiled is taken over; the emulator's engine wants the option
        // (docs/developing.md).
        .env(
            "MATURIN_PEP517_ARGS",
            "--features shared --ignore-rust-version",
        );
    process::run(&mut install).map_err(|failure| {
        Failure::new(format!("the Python package can't be installed: {failure}"))
            .remedy("pip's message is above")
    })?;
    Ok(Environment::Ready(python))
}

fn pip(python: &PathBuf) -> Command {
    let mut command = process::command(python, Sees::CompilerAndFlags);
    command.args([
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
    ]);
    command
}

/// Its tests, with the programs that they compare with.
pub fn tests(workspace: &Workspace, python: &PathBuf) -> Command {
    let mut command = process::command(python, Sees::CompilerAndFlags);
    command
        // From elsewhere, so that the installed package is tested and not the sources.
        .current_dir(workspace.target().join(FOLDER))
        .args(["-m", "pytest", "-p", "no:cacheprovider", "--color=no"])
        .args(["--tb=short", "-rfEs"])
        .arg(workspace.root().join(PACKAGE).join("tests"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("FORCECTL", workspace.program("forcectl"));
    command
}
