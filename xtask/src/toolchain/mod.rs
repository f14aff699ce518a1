//! The compiler for the board: which ones there are, which one is taken, how it is called.
//!
//! Two routes lead to the same image:
//!
//! * rustup's standard library for the board's target, with the compiler that builds everything
//!   else;
//! * Debian's `rustc-web` packages, which carry the library's *source* for those who can't reach
//!   rustup's servers: cargo builds `core` from it (`-Z build-std=core`).
//!
//! [`plan`] decides from facts, without side effects; [`facts`] gathers them; [`setup`] acts.

pub mod facts;
pub mod plan;
pub mod setup;

use std::fmt;
use std::path::PathBuf;
use std::process::Command;

use crate::process::{self, Sees};

/// The board's target: Cortex-M7 with its double precision FPU.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// The oldest Rust that builds this workspace, as in the root `Cargo.toml`.
pub const OLDEST_RUST: Version = Version(1, 95, 0);

/// A release of Rust. Compares in order of release.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub u32, pub u32, pub u32);

impl Version {
    /// Reads the first `X.Y.Z` of a text such as `rustc 1.96.0 (ac68faa20 2026-05-25)` or
    /// `1.96.0+dfsg1-1~deb12u2`.
    pub fn find(text: &str) -> Option<Self> {
        text.split(|c: char| !(c.is_ascii_digit() || c == '.'))
            .find_map(|word| {
                let mut numbers = word.split('.').map(str::parse);
                let version = Self(
                    numbers.next()?.ok()?,
                    numbers.next()?.ok()?,
                    numbers.next()?.ok()?,
                );
                numbers.next().is_none().then_some(version)
            })
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.0, self.1, self.2)
    }
}

/// A compiler that is ready to build for the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Arm {
    /// The host's own compiler, with the target's standard library beside it.
    Host {
        /// Its version.
        version: Version,
    },
    /// Debian's compiler, which builds `core` from source.
    Debian {
        /// Its version.
        version: Version,
        /// The linker: Debian's compiler packages bring none for this target.
        linker: PathBuf,
    },
}

/// Where Debian puts its compiler. Absolute, since rustup's stands first on most `PATH`s.
pub const DEBIAN_CARGO: &str = "/usr/bin/cargo";
/// See [`DEBIAN_CARGO`].
pub const DEBIAN_RUSTC: &str = "/usr/bin/rustc";

impl Arm {
    /// `cargo SUBCOMMAND --target ...` with this compiler; the caller adds packages, profile and
    /// target directory.
    pub fn cargo(&self, subcommand: &str) -> Command {
        match self {
            Self::Host { .. } => {
                let mut cargo = process::cargo(Sees::Compiler);
                cargo.args([subcommand, "--target", TARGET]);
                cargo
            }
            Self::Debian { linker, .. } => {
                let mut cargo = process::command(DEBIAN_CARGO, Sees::Nothing);
                cargo.args([subcommand, "--target", TARGET, "-Z", "build-std=core"]);
                // Cargo looks for `rustc` on PATH, where rustup's may come first.
                cargo.env("RUSTC", DEBIAN_RUSTC);
                // build-std is an unstable option, which a release compiler accepts only with this.
                cargo.env("RUSTC_BOOTSTRAP", "1");
                cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
                cargo
            }
        }
    }
}

impl fmt::Display for Arm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Host { version } => write!(f, "Rust {version} with its library for {TARGET}"),
            Self::Debian { version, .. } => {
                write!(f, "Debian's Rust {version}, core built from source")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_found_in_what_programs_print() {
        assert_eq!(
            Version::find("rustc 1.96.0 (ac68faa20 2026-05-25) (built from a source tarball)"),
            Some(Version(1, 96, 0))
        );
        assert_eq!(
            Version::find("1.96.0+dfsg1-1~deb12u2"),
            Some(Version(1, 96, 0))
        );
        assert_eq!(
            Version::find("cargo 1.97.0-nightly"),
            Some(Version(1, 97, 0))
        );
        assert_eq!(Version::find("(none)"), None);
        assert_eq!(Version::find("1.2"), None);
    }

    #[test]
    fn versions_compare_as_numbers() {
        assert!(Version(1, 100, 0) > OLDEST_RUST);
        assert!(Version(1, 94, 9) < OLDEST_RUST);
    }

    #[test]
    fn debian_is_called_with_its_own_compiler() {
        let arm = Arm::Debian {
            version: Version(1, 96, 0),
            linker: "/usr/bin/ld.lld".into(),
        };
        let cargo = arm.cargo("build");
        assert_eq!(cargo.get_program(), DEBIAN_CARGO);
        let set = |name: &str| {
            cargo
                .get_envs()
                .find(|(key, _)| *key == name)
                .and_then(|(_, value)| value)
                .and_then(|value| value.to_str())
        };
        assert_eq!(set("RUSTC"), Some(DEBIAN_RUSTC));
        assert_eq!(set("RUSTC_BOOTSTRAP"), Some("1"));
        assert_eq!(
            set("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER"),
            Some("/usr/bin/ld.lld")
        );
        assert!(cargo
            .get_args()
            .any(|argument| argument == "build-std=core"));
    }
}
