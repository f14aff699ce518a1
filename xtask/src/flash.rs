//! Puts the firmware on a real board with probe-rs.

use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::workspace::Workspace;
use crate::{firmware, toolchain};

/// probe-rs's name for the board's chip.
pub const CHIP: &str = "STM32H753ZITx";

/// How to flash.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Stay attached and print defmt's log.
    pub run: bool,
    /// Hold the chip in reset while attaching.
    pub under_reset: bool,
}

/// Builds the firmware and writes it to the board's flash.
///
/// # Errors
/// Without probe-rs, without a probe, or when either the build or the transfer fails.
pub fn flash(workspace: &Workspace, options: Options) -> Result<()> {
    // Before the build, so that a missing probe is reported at once.
    let probe_rs = process::find_program("probe-rs").ok_or_else(|| {
        Failure::new("flashing needs probe-rs, which isn't on PATH").remedy(
            "install it, for example with `cargo install probe-rs-tools --locked`,\n\
             and on Linux its udev rules: https://probe.rs/docs/getting-started/probe-setup/",
        )
    })?;
    let listed = process::capture(process::command(&probe_rs, Sees::Compiler).arg("list"))?;
    if !lists_a_probe(&String::from_utf8_lossy(&listed.stdout)) {
        return Err(Failure::new("probe-rs finds no debug probe").remedy(
            "connect the board's ST-LINK connector (CN1) by USB, not the user USB connector;\n\
             on Linux check the udev rules: https://probe.rs/docs/getting-started/probe-setup/",
        ));
    }

    let arm = toolchain::setup::ensure(workspace, toolchain::setup::route_from_environment()?)?;
    firmware::build(workspace, &arm)?;

    let subcommand = if options.run { "run" } else { "download" };
    let mut transfer = process::command(&probe_rs, Sees::Compiler);
    transfer.args([subcommand, "--chip", CHIP]);
    let mut reset = process::command(&probe_rs, Sees::Compiler);
    reset.args(["reset", "--chip", CHIP]);
    if options.under_reset {
        transfer.arg("--connect-under-reset");
        reset.arg("--connect-under-reset");
    }
    transfer.arg("--verify").arg(workspace.firmware_elf());
    say(format!(
        "flashing {} to {CHIP}",
        workspace.show(&workspace.firmware_elf())
    ));
    let hint = |failure: Failure| {
        let text = format!("the board can't be flashed: {failure}");
        Failure::new(text).remedy(if options.under_reset {
            "check power, cable and the SWD jumpers of the ST-LINK, then power-cycle the board"
        } else {
            "a sleeping or crashed core refuses the probe: `cargo xtask flash --under-reset`"
        })
    };
    process::run(&mut transfer).map_err(hint)?;
    if !options.run {
        process::run(&mut reset).map_err(hint)?;
        say("flashed and restarted");
    }
    Ok(())
}

/// Whether `probe-rs list` names a probe: one numbered line each.
fn lists_a_probe(output: &str) -> bool {
    output
        .lines()
        .any(|line| line.trim_start().starts_with('['))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_are_recognised_in_the_list() {
        assert!(lists_a_probe(
            "The following debug probes were found:\n\
             [0]: STLink V2-1 -- 0483:374b:0667FF (ST-LINK)\n"
        ));
        assert!(!lists_a_probe("No debug probes were found.\n"));
        assert!(!lists_a_probe(""));
    }
}
