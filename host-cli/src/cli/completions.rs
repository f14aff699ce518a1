//! `forcectl completions`: a completion script for a shell.

use super::exit::{Reply, Result};
use super::{Cli, Context};
use clap::{Args, CommandFactory};
use clap_complete::Shell;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        context.output.refuse_json("a completion script")?;
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "forcectl", &mut script);
        Ok(Reply::text(String::from_utf8_lossy(&script)))
    }
}
