//! `forcectl check`: checks a rig file, or prints the built-in one.

use super::exit::{self, Failure, Reply, Result};
use super::Context;
use clap::Args;
use host_cli::rigfile::{self, RigFile};
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Rig file (TOML)
    #[arg(required_unless_present = "print", conflicts_with = "print")]
    file: Option<PathBuf>,
    /// Print the built-in rig file, as a start for your own
    #[arg(long)]
    print: bool,
}

impl Check {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let Some(file) = &self.file else {
            context.output.refuse_json("`check --print`")?;
            return Ok(Reply::text(rigfile::DEFAULT_TEXT));
        };
        let rig = RigFile::load(file).map_err(|error| Failure::new(exit::RIG_FILE, error))?;
        let enabled = rig.units.iter().filter(|unit| unit.enabled).count();
        Ok(Reply::new(
            format!(
                "{}: no mistakes found. Rig `{}`, {enabled} units enabled, hash {}\n",
                file.display(),
                rig.name,
                rig.hash()
            ),
            json!({"file": file, "name": rig.name, "hash": rig.hash(), "rig": rig}),
        ))
    }
}
