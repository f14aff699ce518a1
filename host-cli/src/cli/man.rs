//! `forcectl man`: manual pages, one for each command.

use super::exit::{Failure, Reply, Result};
use super::output::path_json;
use super::Cli;
use clap::{Args, CommandFactory};
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct Man {
    /// Folder for the pages; created where it does not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Man {
    /// Runs the command.
    pub fn run(&self) -> Result<Reply> {
        let out = &self.out;
        std::fs::create_dir_all(out)
            .and_then(|()| clap_mangen::generate_to(Cli::command(), out))
            .map_err(|error| Failure::file(out, error))?;
        Ok(Reply::new(
            format!(
                "manual pages: {}; read one with `man {}`\n",
                out.display(),
                out.join("forcectl.1").display()
            ),
            json!({ "folder": path_json(out) }),
        ))
    }
}
