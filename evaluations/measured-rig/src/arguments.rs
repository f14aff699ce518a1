//! The command line. Depends on the standard library alone, because `cargo xtask residual-report`
//! includes this file to check the arguments before it builds anything.

use std::ffi::OsString;
use std::path::PathBuf;

/// How to call the program.
pub const USAGE: &str = "\
usage: cargo xtask residual-report [--data DIR] [--page PAGE.md]

  --data DIR      folder with the rig's data, else FORCE_DATA, ./data, ../shared/data
  --page PAGE.md  page whose marked blocks are filled (default docs/residual/rig.md)
  --help          print this

Relative paths start at the root of the repository.";

/// What the program is to do.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// Print [`USAGE`].
    Help,
    /// Write the page.
    Page {
        /// Folder with the data, if given.
        data: Option<PathBuf>,
        /// The page.
        page: PathBuf,
    },
}

/// Reads the arguments after the program's name.
///
/// # Errors
/// What is wrong with them.
pub fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Request, String> {
    let (mut data, mut page) = (None, PathBuf::from("docs/residual/rig.md"));
    let mut arguments = arguments.into_iter();
    while let Some(name) = arguments.next() {
        let mut value = || {
            let value = arguments.next().map(PathBuf::from);
            value.ok_or(format!("{} needs a path", name.to_string_lossy()))
        };
        match name.to_str() {
            Some("--data") => data = Some(value()?),
            Some("--page") => page = value()?,
            Some("--help" | "-h") => return Ok(Request::Help),
            _ => return Err(format!("`{}` is not an option", name.to_string_lossy())),
        }
    }
    Ok(Request::Page { data, page })
}
