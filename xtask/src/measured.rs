//! The residual analysis on the measured data of the thesis rig: its report, and the comparison
//! with public Python tools.

use std::ffi::OsString;
use std::process::Command;

use crate::pypi;
use crate::report::{Failure, Result};
use crate::rig;
use crate::workspace::Workspace;

/// The comparison, below the root.
const SCRIPTS: &str = "evaluations/residual-bench/python";

/// The arguments of the program that writes the report, and where it looks for the data. Both are
/// files of that program without dependencies: xtask links no crate of this workspace, and still
/// has to know whether the data are there before it compiles for minutes.
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
    let requirements = workspace.root().join(SCRIPTS).join("requirements.txt");
    let python = pypi::environment(workspace, "residual-compare", &requirements, &["--quiet"])?;
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
