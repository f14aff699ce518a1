//! Checks by tools that a developer may have: cargo-deny and typos. Without the tool they are
//! skipped.

use crate::process::{self, Sees};
use crate::report::Result;
use crate::workspace::Workspace;

/// A tool and how it is called.
#[derive(Debug)]
pub struct Tool {
    /// Its program.
    program: &'static str,
    /// What to check, and how.
    arguments: &'static [&'static str],
    /// How one gets it.
    pub install: &'static str,
}

/// Licences, sources and duplicates of the dependencies, by `deny.toml`. The advisories are left
/// out: their database is a download of its own.
pub const DENY: Tool = Tool {
    program: "cargo-deny",
    arguments: &[
        "--locked",
        "--log-level",
        "error",
        "check",
        "--hide-inclusion-graph",
        "licenses",
        "bans",
        "sources",
    ],
    install: "cargo install cargo-deny --locked",
};

/// Spelling, by `.typos.toml`.
pub const TYPOS: Tool = Tool {
    program: "typos",
    arguments: &[],
    install: "cargo install typos-cli --locked",
};

/// Runs a tool in the workspace's root. `false` when it is not installed.
///
/// # Errors
/// When the tool has findings.
pub fn run(workspace: &Workspace, tool: &Tool) -> Result<bool> {
    let Some(program) = process::find_program(tool.program) else {
        return Ok(false);
    };
    process::run(
        process::command(program, Sees::CompilerAndFlags)
            .current_dir(workspace.root())
            .args(tool.arguments),
    )?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tool_that_is_missing_is_told_apart_from_findings() {
        let missing = Tool {
            program: "no-such-program-anywhere",
            arguments: &[],
            install: "",
        };
        assert!(!run(&Workspace::locate(), &missing).unwrap());
        // A tool that ends with exit code 1 and prints nothing.
        let findings = Tool {
            program: "git",
            arguments: &["diff", "--no-index", "--quiet", "Cargo.toml", "Cargo.lock"],
            install: "",
        };
        assert!(run(&Workspace::locate(), &findings).is_err());
    }
}
