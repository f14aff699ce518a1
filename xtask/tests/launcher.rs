//! `cargo forcectl` in a checkout that does not compile.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// What stands for a forcectl: it says what it was given.
const PROGRAM: &str = "#!/bin/sh\necho \"$FORCE_RIG_BIN $@\"\nexit 4\n";

fn copy(name: &str, root: &Path) {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let to = root.join(name);
    fs::create_dir_all(to.parent().unwrap()).unwrap();
    fs::copy(repository.join(name), to).unwrap();
}

/// A checkout with nothing but the launcher, and a manifest that nobody can read.
fn broken() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    for name in [
        ".cargo/config.toml",
        "python/.cargo/config.toml",
        "xtask/launcher/Cargo.toml",
        "xtask/launcher/Cargo.lock",
        "xtask/launcher/main.rs",
    ] {
        copy(name, root);
    }
    fs::write(root.join("Cargo.toml"), "[[[").unwrap();
    fs::create_dir_all(root.join("target/debug")).unwrap();
    let program = root.join("target/debug/forcectl");
    fs::write(&program, PROGRAM).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    folder
}

fn forcectl(folder: &Path, line: &str) -> Output {
    let mut cargo = Command::new(env!("CARGO"));
    for name in [
        "CARGO_TARGET_DIR",
        "CARGO_BUILD_TARGET_DIR",
        "CARGO_MANIFEST_DIR",
    ] {
        cargo.env_remove(name);
    }
    cargo
        .current_dir(folder)
        .arg("forcectl")
        .args(line.split_whitespace());
    cargo.output().unwrap()
}

#[test]
fn a_stop_runs_the_program_that_there_is_whatever_does_not_compile() {
    let checkout = broken();
    let root = checkout.path();
    let rig = root.join("target/debug/rig");
    for folder in [root.to_owned(), root.join("python")] {
        for line in ["stop", "--json stop --link usb", "monitor --link usb"] {
            let output = forcectl(&folder, line);
            let err = String::from_utf8_lossy(&output.stderr);
            let said = format!("{} {line}\n", rig.display());
            assert_eq!(String::from_utf8_lossy(&output.stdout), said, "{err}");
            assert_eq!((output.status.code(), &*err), (Some(4), ""));
        }
    }
    // No cargo that builds the programs can be in the way: their folder's lock was never asked for.
    assert!(!root.join("target/debug/.cargo-lock").exists());
    // A source that changed after the program was built.
    fs::write(root.join("source.rs"), "").unwrap();
    let list = format!("forcectl: {}\n", root.join("source.rs").display());
    fs::write(root.join("target/debug/forcectl.d"), list).unwrap();
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    let source = fs::File::options().write(true).open(root.join("source.rs"));
    source.unwrap().set_modified(later).unwrap();
    let output = forcectl(root, "stop");
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(
        err.contains("is older than") && err.contains("source.rs"),
        "{err}"
    );
    assert_eq!(output.status.code(), Some(4));
}

#[test]
fn a_target_folder_of_cargos_configuration_is_found_by_its_note() {
    let checkout = broken();
    let root = checkout.path();
    fs::rename(root.join("target"), root.join("elsewhere")).unwrap();
    fs::create_dir_all(root.join("target/launcher")).unwrap();
    let note = root.join("elsewhere").display().to_string();
    fs::write(root.join("target/launcher/target"), note).unwrap();
    let output = forcectl(root, "stop");
    let err = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{err}");
}

#[test]
fn what_has_to_be_built_goes_to_cargo_and_says_so() {
    let checkout = broken();
    fs::remove_dir_all(checkout.path().join("target")).unwrap();
    let output = forcectl(checkout.path(), "stop");
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(err.contains("has no program to run"), "{err}");
    // Cargo's own words on the manifest.
    assert!(
        !output.status.success() && err.contains("Cargo.toml"),
        "{err}"
    );
}
