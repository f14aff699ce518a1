//! The oldest supported Rust: one number, and every text that repeats it.
//!
//! `rust-version` in the root `Cargo.toml` decides. Cargo refuses an older compiler by itself, and
//! refuses dependencies that declare a newer one. What cargo cannot see is checked here: packages
//! that do not take part, documents and scripts that name another version.

use std::fs;

use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::workspace::Workspace;

/// Files that must name the version, each as `Rust 1.N`.
const TEXTS: [&str; 5] = [
    ".ci/run",
    ".github/workflows/ci.yml",
    "CONTRIBUTING.md",
    "README.md",
    "docs/developing.md",
];

/// Checks every text and returns the version.
///
/// # Errors
/// Lists each file that names another version or none, and each package without
/// `rust-version.workspace = true`.
pub fn check(workspace: &Workspace) -> Result<String> {
    let manifest = read(workspace, "Cargo.toml")?;
    let declared = declared(&manifest)?;
    let mut faults = Vec::new();
    for name in TEXTS {
        faults.extend(faults_of_text(name, &read(workspace, name)?, declared));
    }
    for member in members(&manifest) {
        let name = format!("{member}/Cargo.toml");
        let inherits = read(workspace, &name)?
            .lines()
            .any(|line| line == "rust-version.workspace = true");
        if !inherits {
            faults.push(format!("{name}: no line `rust-version.workspace = true`"));
        }
    }
    if faults.is_empty() {
        return Ok(declared.to_string());
    }
    Err(Failure::new(format!(
        "Cargo.toml declares Rust {declared}, but:\n  {}",
        faults.join("\n  ")
    )))
}

/// Checks the texts, then compiles every package of this computer with the declared version.
///
/// The emulator's engine declares a newer version than it needs, so the packages above it take
/// `--ignore-rust-version`; all others are checked without that option.
///
/// # Errors
/// When a text disagrees, the version is not installed, or a package does not compile.
pub fn compile(workspace: &Workspace) -> Result<()> {
    let declared = check(workspace)?;
    let toolchain = toolchain(&declared)?;
    // Apart from other builds: another compiler would spoil their fingerprints.
    let target = workspace.target().join("msrv");
    let check = |options: &[&str]| {
        let mut command = match &toolchain {
            None => process::cargo(Sees::CompilerAndFlags),
            Some(name) => {
                let mut rustup = process::command("rustup", Sees::Nothing);
                rustup.args(["run", name, "cargo"]);
                rustup
            }
        };
        process::run(
            command
                .current_dir(workspace.root())
                .args(["check", "--locked", "--all-targets"])
                .args(options)
                .arg("--target-dir")
                .arg(&target),
        )
    };
    say(format!("Rust {declared}: packages that any host builds"));
    check(&[])?;
    say(format!(
        "Rust {declared}: emulator and scenarios, with --ignore-rust-version"
    ));
    check(&[
        "--ignore-rust-version",
        "--package",
        "emulator",
        "--package",
        "scenarios",
    ])
}

/// The toolchain to ask rustup for, or `None` where the present compiler has the declared version.
fn toolchain(declared: &str) -> Result<Option<String>> {
    let version = |command: &mut std::process::Command| {
        process::capture(command.arg("--version"))
            .ok()
            .filter(|output| output.status.success())
            .and_then(|output| minor(&String::from_utf8_lossy(&output.stdout)))
    };
    if version(&mut process::cargo(Sees::CompilerAndFlags)).as_deref() == Some(declared) {
        return Ok(None);
    }
    let mut rustup = process::command("rustup", Sees::Nothing);
    if version(rustup.args(["run", declared, "cargo"])).as_deref() == Some(declared) {
        return Ok(Some(declared.to_string()));
    }
    Err(
        Failure::new(format!("Rust {declared} is not installed")).remedy(format!(
            "run `rustup toolchain install {declared} --profile minimal`"
        )),
    )
}

/// `1.95` of `cargo 1.95.0 (f2d3ce0bd 2026-03-21)`.
fn minor(text: &str) -> Option<String> {
    let mut numbers = text.split_whitespace().nth(1)?.split('.');
    Some(format!("{}.{}", numbers.next()?, numbers.next()?))
}

fn read(workspace: &Workspace, name: &str) -> Result<String> {
    fs::read_to_string(workspace.root().join(name))
        .map_err(|error| Failure::new(format!("{name} can't be read: {error}")))
}

/// The workspace's `rust-version`.
fn declared(manifest: &str) -> Result<&str> {
    manifest
        .lines()
        .find_map(|line| {
            line.strip_prefix("rust-version = \"")?
                .strip_suffix('"')
                .filter(|version| version.split('.').count() == 2)
        })
        .ok_or_else(|| {
            Failure::new("Cargo.toml: no `rust-version = \"1.N\"` in [workspace.package]")
        })
}

/// The folders in `members = [...]`, one a line.
fn members(manifest: &str) -> impl Iterator<Item = &str> {
    manifest
        .lines()
        .skip_while(|line| *line != "members = [")
        .skip(1)
        .take_while(|line| *line != "]")
        .filter_map(|line| line.split('"').nth(1))
}

fn faults_of_text(name: &str, text: &str, declared: &str) -> Vec<String> {
    let mut faults = Vec::new();
    let mut named = false;
    for (index, line) in text.lines().enumerate() {
        for version in versions(line) {
            named = true;
            if version != declared {
                faults.push(format!("{name}:{}: Rust {version}", index + 1));
            }
        }
    }
    if !named {
        faults.push(format!("{name}: does not name `Rust {declared}`"));
    }
    faults
}

/// The versions in `Rust 1.N`, `older than 1.N` and in calls of rustup.
fn versions(line: &str) -> impl Iterator<Item = &str> {
    [
        "Rust ",
        "older than ",
        "toolchain install ",
        "rustup default ",
    ]
    .into_iter()
    .flat_map(|before| line.split(before).skip(1))
    .filter_map(|after| {
        let minor = after.strip_prefix("1.")?;
        let digits = minor
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(minor.len());
        (digits > 0).then(|| &after[..2 + digits])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANIFEST: &str = "\
[workspace]
members = [
    \"board\",
    \"emulator/link\",
]
default-members = [
    \"xtask\",
]

[workspace.package]
rust-version = \"1.95\"
";

    #[test]
    fn the_manifest_decides() {
        assert_eq!(declared(MANIFEST).unwrap(), "1.95");
        assert!(declared("rust-version = \"1.95.0\"\n").is_err());
        let members: Vec<_> = members(MANIFEST).collect();
        assert_eq!(members, ["board", "emulator/link"]);
    }

    #[test]
    fn texts_have_to_name_the_version_and_no_other() {
        assert!(faults_of_text("a", "Wants Rust 1.95.0 or newer.", "1.95").is_empty());
        assert_eq!(
            faults_of_text(
                "a",
                "Rust 1.95\nneeds Rust 1.94, Rust 1.100\nolder than 1.9.",
                "1.95"
            ),
            ["a:2: Rust 1.94", "a:2: Rust 1.100", "a:3: Rust 1.9"]
        );
        assert_eq!(
            faults_of_text("a", "# Rust 1.95\nrustup default 1.94", "1.95"),
            ["a:2: Rust 1.94"]
        );
        assert_eq!(
            faults_of_text("a", "Bare-metal Rust on an STM32H753", "1.95"),
            ["a: does not name `Rust 1.95`"]
        );
    }

    #[test]
    fn a_compiler_gives_its_minor_version() {
        assert_eq!(
            minor("cargo 1.95.0 (f2d3ce0bd 2026-03-21)").as_deref(),
            Some("1.95")
        );
        assert_eq!(minor("cargo"), None);
    }
}
