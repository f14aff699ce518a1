//! From facts to the next step: pure, so that any machine's state can be tested.

use std::path::PathBuf;

use super::{Arm, Version, OLDEST_RUST};

/// What is known about this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Facts {
    /// Which route the user allows.
    pub route: Route,
    /// The compiler that builds host programs, when its version could be read.
    pub host: Option<Version>,
    /// Whether that compiler has the target's library.
    pub host_has_target: bool,
    /// Whether rustup manages that compiler.
    pub rustup: bool,
    /// How an earlier `rustup target add` failed.
    pub target_add_failed: Option<String>,
    /// The older one of Debian's installed rustc and cargo.
    pub debian_rust: Option<Version>,
    /// Whether the library's source is installed beside Debian's rustc.
    pub debian_source: bool,
    /// A linker for ELF on ARM that Debian's rustc can use.
    pub linker: Option<PathBuf>,
    /// Debian's package manager, when there is one.
    pub apt: Option<Apt>,
}

/// Which route to a compiler the user allows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Route {
    /// Whichever is ready or gets ready first.
    #[default]
    Any,
    /// The host's compiler only.
    Host,
    /// Debian's compiler only.
    Debian,
}

/// What apt can do here.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Apt {
    /// How installing gets the rights.
    pub rights: Rights,
    /// The Rust that apt would install, newest of the known package sets.
    pub candidate: Option<Candidate>,
    /// Whether the package lists were fetched by this run.
    pub lists_fetched: bool,
    /// How an attempt of this run failed.
    pub failed: Option<String>,
}

/// How commands that need root get it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rights {
    /// Already root.
    Root,
    /// `sudo` without a password.
    Sudo,
    /// Not without a password.
    None,
}

/// A set of Debian packages that together make a compiler.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidate {
    /// Compiler, cargo and the library's source.
    pub packages: [&'static str; 3],
    /// Version of the compiler.
    pub version: Version,
}

/// Debian's names, in the order in which they are preferred. `-web` is the newer Rust that stable
/// releases carry for their browsers; later releases may have a new enough plain `rustc`.
pub const PACKAGE_SETS: [[&str; 3]; 2] = [
    ["rustc-web", "cargo-web", "rust-web-src"],
    ["rustc", "cargo", "rust-src"],
];

/// What to do next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// Nothing: build with this.
    Ready(Arm),
    /// `rustup target add`.
    AddTarget,
    /// `apt-get update`.
    FetchLists,
    /// `apt-get install` these.
    Install(Vec<&'static str>),
    /// No way left; each line says why one route is closed.
    Stuck(Vec<String>),
}

/// The next step towards a compiler for the board. What is ready wins over what needs a network;
/// then rustup, whose compiler is the one everything else is built with; then Debian.
pub fn next(facts: &Facts) -> Step {
    let host_allowed = facts.route != Route::Debian;
    let debian_allowed = facts.route != Route::Host;
    let mut closed = Vec::new();

    if host_allowed {
        if let Some(version) = facts.host.filter(|_| facts.host_has_target) {
            return Step::Ready(Arm::Host { version });
        }
    }
    let debian_rust = facts.debian_rust.filter(|version| *version >= OLDEST_RUST);
    if debian_allowed && facts.debian_source {
        if let (Some(version), Some(linker)) = (debian_rust, facts.linker.clone()) {
            return Step::Ready(Arm::Debian { version, linker });
        }
    }

    if host_allowed {
        match (&facts.target_add_failed, facts.rustup) {
            (None, true) => return Step::AddTarget,
            (Some(reason), true) => closed.push(format!("rustup: {reason}")),
            (_, false) => closed.push("rustup: not installed".to_string()),
        }
    } else {
        closed.push("rustup: ruled out by the choice of toolchain".to_string());
    }

    if !debian_allowed {
        closed.push("Debian's packages: ruled out by the choice of toolchain".to_string());
        return Step::Stuck(closed);
    }
    match &facts.apt {
        None => closed.push("Debian's packages: this system has no apt-get".to_string()),
        Some(apt) => match debian_step(facts, apt, debian_rust.is_some()) {
            Ok(step) => return step,
            Err(reason) => closed.push(format!("Debian's packages: {reason}")),
        },
    }
    Step::Stuck(closed)
}

/// What apt can do about the missing parts, or why it can't.
fn debian_step(facts: &Facts, apt: &Apt, rust_installed: bool) -> Result<Step, String> {
    if let Some(reason) = &apt.failed {
        return Err(reason.clone());
    }
    let candidate = apt
        .candidate
        .filter(|candidate| candidate.version >= OLDEST_RUST);
    let mut packages: Vec<&'static str> = Vec::new();
    if !(rust_installed && facts.debian_source) {
        match candidate {
            Some(candidate) => packages.extend(candidate.packages),
            None if apt.lists_fetched => {
                let found = apt.candidate.map_or_else(
                    || "none".to_string(),
                    |candidate| candidate.version.to_string(),
                );
                return Err(format!(
                    "rustc-web or rustc {OLDEST_RUST} or newer is needed, apt offers {found} (an older release, or no network)"
                ));
            }
            None if apt.rights == Rights::None => packages.extend(PACKAGE_SETS[0]),
            None => return Ok(Step::FetchLists),
        }
    }
    if facts.linker.is_none() {
        packages.push("lld");
    }
    if apt.rights == Rights::None {
        return Err(format!(
            "installing {} needs root, and there is no sudo without a password",
            packages.join(" ")
        ));
    }
    Ok(Step::Install(packages))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEW: Version = Version(1, 96, 0);
    const OLD: Version = Version(1, 85, 0);

    fn bare() -> Facts {
        Facts {
            route: Route::Any,
            host: Some(OLDEST_RUST),
            host_has_target: false,
            rustup: false,
            target_add_failed: None,
            debian_rust: None,
            debian_source: false,
            linker: None,
            apt: None,
        }
    }

    fn apt(candidate: Option<Version>) -> Option<Apt> {
        Some(Apt {
            rights: Rights::Root,
            candidate: candidate.map(|version| Candidate {
                packages: PACKAGE_SETS[0],
                version,
            }),
            lists_fetched: false,
            failed: None,
        })
    }

    fn debian_ready() -> Facts {
        Facts {
            debian_rust: Some(NEW),
            debian_source: true,
            linker: Some("/usr/bin/ld.lld".into()),
            ..bare()
        }
    }

    #[test]
    fn an_installed_target_needs_nothing() {
        let facts = Facts {
            host_has_target: true,
            ..debian_ready()
        };
        assert_eq!(
            next(&facts),
            Step::Ready(Arm::Host {
                version: OLDEST_RUST
            })
        );
    }

    #[test]
    fn installed_packages_win_over_the_network() {
        let facts = Facts {
            rustup: true,
            ..debian_ready()
        };
        assert!(matches!(next(&facts), Step::Ready(Arm::Debian { .. })));
    }

    #[test]
    fn a_chosen_route_overrides_what_is_ready() {
        let facts = Facts {
            route: Route::Debian,
            host_has_target: true,
            ..debian_ready()
        };
        assert!(matches!(next(&facts), Step::Ready(Arm::Debian { .. })));
        let facts = Facts {
            route: Route::Host,
            rustup: true,
            ..debian_ready()
        };
        assert_eq!(next(&facts), Step::AddTarget);
    }

    #[test]
    fn rustup_is_asked_before_apt_and_only_once() {
        let facts = Facts {
            rustup: true,
            apt: apt(Some(NEW)),
            ..bare()
        };
        assert_eq!(next(&facts), Step::AddTarget);
        let facts = Facts {
            target_add_failed: Some("no network".into()),
            ..facts
        };
        assert_eq!(
            next(&facts),
            Step::Install(vec!["rustc-web", "cargo-web", "rust-web-src", "lld"])
        );
    }

    #[test]
    fn only_what_is_missing_is_installed() {
        let facts = Facts {
            linker: None,
            apt: apt(Some(NEW)),
            ..debian_ready()
        };
        assert_eq!(next(&facts), Step::Install(vec!["lld"]));
        let facts = Facts {
            debian_source: false,
            apt: apt(Some(NEW)),
            ..debian_ready()
        };
        assert_eq!(
            next(&facts),
            Step::Install(vec!["rustc-web", "cargo-web", "rust-web-src"])
        );
    }

    #[test]
    fn empty_or_stale_lists_are_fetched_once() {
        for candidate in [None, Some(OLD)] {
            let mut facts = Facts {
                apt: apt(candidate),
                ..bare()
            };
            assert_eq!(next(&facts), Step::FetchLists);
            if let Some(apt) = &mut facts.apt {
                apt.lists_fetched = true;
            }
            let Step::Stuck(closed) = next(&facts) else {
                panic!("a second fetch brings nothing new");
            };
            assert!(closed.iter().any(|line| line.contains("apt offers")));
        }
    }

    #[test]
    fn an_old_debian_compiler_is_not_taken() {
        let facts = Facts {
            debian_rust: Some(OLD),
            ..debian_ready()
        };
        assert!(matches!(next(&facts), Step::Stuck(_)));
    }

    #[test]
    fn without_rights_nothing_is_installed() {
        for candidate in [None, Some(NEW)] {
            let mut facts = Facts {
                apt: apt(candidate),
                ..bare()
            };
            if let Some(apt) = &mut facts.apt {
                apt.rights = Rights::None;
            }
            let Step::Stuck(closed) = next(&facts) else {
                panic!("installing without rights");
            };
            assert!(closed
                .iter()
                .any(|line| line.contains("rustc-web") && line.contains("root")));
        }
    }

    #[test]
    fn every_closed_route_is_named() {
        let facts = Facts {
            rustup: true,
            target_add_failed: Some("no network".into()),
            ..bare()
        };
        let Step::Stuck(closed) = next(&facts) else {
            panic!("no route is open");
        };
        assert_eq!(closed.len(), 2);
        assert!(closed[0].contains("no network"));
        assert!(closed[1].contains("apt-get"));
    }

    #[test]
    fn a_failed_installation_is_not_repeated() {
        let mut facts = Facts {
            apt: apt(Some(NEW)),
            ..bare()
        };
        if let Some(apt) = &mut facts.apt {
            apt.failed = Some("apt-get failed".into());
        }
        assert!(matches!(next(&facts), Step::Stuck(_)));
    }
}
