//! Another program's word: Python with what the test needs.

use std::{
    path::PathBuf,
    process::{Command, Stdio},
};

/// The Python of `FORCE_PYTHON`, else `python3`; `None`, and said so, where it has not all of
/// these modules.
pub fn python(modules: &str) -> Option<PathBuf> {
    let python = std::env::var_os("FORCE_PYTHON").map_or_else(|| "python3".into(), PathBuf::from);
    let found = Command::new(&python)
        .args(["-c", &format!("import {modules}")])
        .stderr(Stdio::null())
        .status();
    let there = found.is_ok_and(|status| status.success());
    if !there {
        println!("skipped: {} has not all of {modules}", python.display());
    }
    there.then_some(python)
}
