//! Gathers what [`super::plan`] wants to know, by asking the compilers and the package manager.

use std::fs;
use std::path::{Path, PathBuf};

use super::plan::{Apt, Candidate, Facts, Rights, Route, PACKAGE_SETS};
use super::{Version, DEBIAN_CARGO, DEBIAN_RUSTC, TARGET};
use crate::process::{self, Sees};
use crate::workspace::Workspace;

/// Looks at the machine. Costs a few calls of `rustc`; `apt` is asked only in [`apt`].
pub fn gather(workspace: &Workspace, route: Route) -> Facts {
    let host_sysroot = sysroot("rustc", Sees::CompilerAndFlags);
    let debian_sysroot = sysroot(DEBIAN_RUSTC, Sees::Nothing);
    Facts {
        route,
        host: version("rustc", Sees::CompilerAndFlags),
        host_has_target: host_sysroot.as_deref().is_some_and(has_target),
        rustup: process::find_program("rustup").is_some(),
        target_add_failed: fs::read_to_string(target_add_note(workspace)).ok(),
        // `None`, one of them missing, counts as older than any version.
        debian_rust: version(DEBIAN_RUSTC, Sees::Nothing).min(version(DEBIAN_CARGO, Sees::Nothing)),
        debian_source: debian_sysroot
            .as_deref()
            .is_some_and(|root| root.join("lib/rustlib/src/rust/library/core").is_dir()),
        linker: linker(host_sysroot.as_deref()),
        apt: None,
    }
}

/// Where a failed `rustup target add` is remembered.
pub fn target_add_note(workspace: &Workspace) -> PathBuf {
    workspace.notes().join("rustup-target-add-failed")
}

/// What a compiler or cargo answers to `--version`.
fn version(program: &str, sees: Sees) -> Option<Version> {
    let output = process::capture(process::command(program, sees).arg("--version")).ok()?;
    Version::find(&String::from_utf8_lossy(&output.stdout))
}

/// Where a compiler keeps its libraries.
fn sysroot(rustc: &str, sees: Sees) -> Option<PathBuf> {
    let output =
        process::capture(process::command(rustc, sees).args(["--print", "sysroot"])).ok()?;
    let path = String::from_utf8(output.stdout).ok()?;
    let path = path.trim();
    (output.status.success() && !path.is_empty()).then(|| PathBuf::from(path))
}

/// Whether the target's `core` is there, not only an empty folder.
fn has_target(sysroot: &Path) -> bool {
    let Ok(entries) = sysroot
        .join("lib/rustlib")
        .join(TARGET)
        .join("lib")
        .read_dir()
    else {
        return false;
    };
    entries.flatten().any(|entry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with("libcore-") && name.ends_with(".rlib")
    })
}

/// LLVM's linker, newest first: the one inside rustup's toolchain fits the compiler best.
fn linker(host_sysroot: Option<&Path>) -> Option<PathBuf> {
    let bundled = host_sysroot.and_then(|root| {
        let platforms = root.join("lib/rustlib").read_dir().ok()?;
        platforms
            .flatten()
            .map(|platform| platform.path().join("bin/rust-lld"))
            .find(|path| path.is_file())
    });
    bundled.or_else(|| {
        ["rust-lld", "ld.lld"]
            .into_iter()
            .find_map(process::find_program)
    })
}

/// What apt can do, where there is one.
pub fn apt() -> Option<Apt> {
    process::find_program("apt-get")?;
    let candidate = PACKAGE_SETS
        .into_iter()
        .filter_map(|packages| {
            let versions: Option<Vec<Version>> =
                packages.into_iter().map(candidate_version).collect();
            Some(Candidate {
                packages,
                version: versions?.into_iter().min()?,
            })
        })
        // The first of equals, so that the preferred names win.
        .reduce(|best, other| {
            if other.version > best.version {
                other
            } else {
                best
            }
        });
    Some(Apt {
        rights: rights(),
        candidate,
        lists_fetched: false,
        failed: None,
    })
}

/// The version of a package that apt would install.
fn candidate_version(package: &str) -> Option<Version> {
    let output = process::capture(
        process::command("apt-cache", Sees::Nothing)
            .args(["policy", package])
            .env("LC_ALL", "C"),
    )
    .ok()?;
    candidate_in(&String::from_utf8_lossy(&output.stdout))
}

/// The `Candidate:` line of `apt-cache policy`.
fn candidate_in(policy: &str) -> Option<Version> {
    policy
        .lines()
        .find_map(|line| line.trim().strip_prefix("Candidate:"))
        .and_then(Version::find)
}

/// How root's rights can be had without asking anybody.
fn rights() -> Rights {
    let asks = |program: &str, arguments: &[&str]| {
        process::capture(process::command(program, Sees::Nothing).args(arguments))
            .ok()
            .filter(|output| output.status.success())
    };
    if asks("id", &["-u"]).is_some_and(|output| output.stdout.trim_ascii() == b"0") {
        Rights::Root
    } else if asks("sudo", &["-n", "true"]).is_some() {
        Rights::Sudo
    } else {
        Rights::None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_candidate_is_read_from_apts_answer() {
        let policy = "rustc-web:\n  Installed: (none)\n  Candidate: 1.96.0+dfsg1-1~deb12u2\n  \
                      Version table:\n     1.85.0+dfsg3-1~deb12u3 500\n";
        assert_eq!(candidate_in(policy), Some(Version(1, 96, 0)));
        let absent = "lld:\n  Installed: (none)\n  Candidate: (none)\n";
        assert_eq!(candidate_in(absent), None);
        assert_eq!(candidate_in(""), None);
    }

    #[test]
    fn a_folder_without_core_is_no_target() {
        assert!(!has_target(Path::new("/no/such/sysroot")));
    }
}
