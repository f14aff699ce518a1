//! Builds the firmware image and reports its size.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use crate::elf::Image;
use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::toolchain::{Arm, TARGET};
use crate::workspace::Workspace;

/// The package and, by the same name, the program cargo makes of it.
const PACKAGE: &str = "board";

/// The profile of the root `Cargo.toml` that images are built with.
pub const PROFILE: &str = "firmware";

/// Whether `Cargo.lock` fits the manifests, so that `--locked` can be used.
pub fn lock_is_current(workspace: &Workspace) -> bool {
    process::cargo(Sees::CompilerAndFlags)
        .current_dir(workspace.root())
        .args(["tree", "--locked", "--quiet", "--depth", "0", "--package"])
        .arg("xtask")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// A cargo command for the board, with the firmware's profile and target directory.
pub fn cargo(workspace: &Workspace, arm: &Arm, subcommand: &str) -> std::process::Command {
    let mut cargo = arm.cargo(subcommand);
    cargo
        .current_dir(workspace.root())
        .arg("--target-dir")
        .arg(workspace.firmware_target())
        .args(["--profile", PROFILE]);
    // Debian's cargo is another version than the one that keeps the lock file: it must not rewrite
    // it.
    if matches!(arm, Arm::Debian { .. }) && lock_is_current(workspace) {
        cargo.arg("--locked");
    }
    cargo
}

/// The command that builds the image.
pub fn build_command(workspace: &Workspace, arm: &Arm) -> std::process::Command {
    let mut command = cargo(workspace, arm, "build");
    command.args(["--package", PACKAGE]);
    command
}

/// Builds the image and puts it, as ELF and as raw flash contents, where everyone looks for it.
///
/// # Errors
/// When the build fails, or the image doesn't fit the board's memories.
pub fn build(workspace: &Workspace, arm: &Arm) -> Result<Image> {
    let elf = workspace.firmware_elf();
    let first = if elf.is_file() {
        ""
    } else {
        " (the first time takes one to three minutes)"
    };
    say(format!("firmware: building with {arm}{first}"));
    process::run(&mut build_command(workspace, arm)).map_err(|failure| {
        Failure::new(format!("the firmware can't be built: {failure}")).remedy(
            "the compiler's message is above; if it can't find `core`, run `cargo xtask setup`",
        )
    })?;
    let built = workspace
        .firmware_target()
        .join(TARGET)
        .join(PROFILE)
        .join(PACKAGE);
    let bytes = read(workspace, &built)?;
    let image = Image::parse(&bytes)?;
    write_if_changed(
        workspace,
        &workspace.firmware_bin(),
        &image.flash_contents()?,
    )?;
    write_if_changed(workspace, &elf, &bytes)?;
    Ok(image)
}

/// Prints the size report of an image on standard output.
pub fn print_size(workspace: &Workspace, image: &Image) {
    println!(
        "{}\n\n{}",
        workspace.show(&workspace.firmware_elf()),
        image.report()
    );
}

fn read(workspace: &Workspace, path: &Path) -> Result<Vec<u8>> {
    fs::read(path)
        .map_err(|error| Failure::new(format!("{} can't be read: {error}", workspace.show(path))))
}

/// Leaves an equal file alone, so that whatever depends on it sees no change.
fn write_if_changed(workspace: &Workspace, path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    fs::write(path, bytes).map_err(|error| {
        Failure::new(format!(
            "{} can't be written: {error}",
            workspace.show(path)
        ))
    })
}
