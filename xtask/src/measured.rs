//! The residual analysis on the measured data of the thesis rig: its report, and the comparison with
//! public Python tools.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::process;
use crate::report::{say, Failure, Result};
use crate::rig;
use crate::workspace::Workspace;

/// Python to make the comparison's environment with.
const PYTHON_VARIABLE: &str = "FORCE_PYTHON";
/// The comparison, below the root.
const SCRIPTS: &str = "evaluations/residual-bench/python";

/// The arguments of the program that writes the report, and where it looks for the data. Both are files of
/// that program without dependencies: xtask links no crate of this workspace, and still has to know
/// whether the data are there before it compiles for minutes.
#[path = "../../evaluations/measured-rig/src/arguments.rs"]
mod arguments;
#[allow(dead_code)] // xtask needs to know that there are data, not which.
#[path = "../../evaluations/measured-rig/src/data.rs"]
mod data;

/// Writes the report on the measured data into `docs/residual/rig.md` and its plots beside it.
///
/// # Errors
/// When there are no data, or the program can't be built or started.
pub fn report(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    match arguments::parse(arguments.iter().cloned()) {
        Ok(arguments::Request::Page { data, .. }) => {
            data::Data::locate(data, workspace.root()).map_err(Failure::new)?;
        }
        Ok(arguments::Request::Help) => {
            println!("{}", arguments::USAGE);
            return Ok(0);
        }
        Err(error) => {
            eprintln!("xtask: {error}\n{}", arguments::USAGE);
            return Ok(2);
        }
    }
    rig::evaluation(workspace, "measured-rig", arguments)
}

/// Compares the analysis with public Python tools on the same rows.
///
/// # Errors
/// When Python, its packages or the analysis can't be had.
pub fn compare(workspace: &Workspace, arguments: &[OsString]) -> Result<u8> {
    let python = environment(workspace)?;
    rig::build(workspace, &["forcectl"])?;
    let script = workspace.root().join(SCRIPTS).join("compare.py");
    let mut command = Command::new(python);
    command
        .current_dir(workspace.root())
        .arg("-B")
        .arg(script)
        .arg("--forcectl")
        .arg(workspace.program("forcectl"))
        .args(arguments);
    rig::hand_over(command)
}

/// Python with the packages of `requirements.txt`, in an environment of its own below the target
/// folder; made once, and anew when the requirements change.
fn environment(workspace: &Workspace) -> Result<PathBuf> {
    let requirements = workspace.root().join(SCRIPTS).join("requirements.txt");
    let required = fs::read_to_string(&requirements).map_err(|error| {
        Failure::new(format!("{} can't be read: {error}", requirements.display()))
    })?;
    let folder = workspace.target().join("residual-compare");
    let python = folder.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    });
    // Written last, so an environment that was interrupted is made again.
    let installed = folder.join("requirements.installed");
    if fs::read_to_string(&installed).is_ok_and(|text| text == required) {
        return Ok(python);
    }
    let base = env::var_os(PYTHON_VARIABLE).unwrap_or_else(|| "python3".into());
    say(format!(
        "residual-compare: installing pinned packages from PyPI into {}",
        folder.display()
    ));
    let no_python = |failure: Failure| {
        Failure::new(format!("no Python environment: {failure}")).remedy(format!(
            "Python 3.11 or later with venv is needed (Debian: python3-venv); {PYTHON_VARIABLE} may name another"
        ))
    };
    process::run(
        Command::new(base)
            .args(["-m", "venv", "--clear"])
            .arg(&folder),
    )
    .map_err(no_python)?;
    process::run(
        Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--requirement"])
            .arg(&requirements),
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
