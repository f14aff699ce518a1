//! Licences of all packages that are compiled on any platform, against the list in `deny.toml`.
//!
//! `Cargo.lock` has a few more: optional packages of dependencies that no feature here switches on.
//! cargo-deny knows more (it reads licence texts), but it is a tool of its own that takes minutes to
//! install. This check needs cargo only, so it is part of every test run.

use std::collections::BTreeSet;
use std::fs;

use crate::process::{self, Sees};
use crate::report::{Failure, Result};
use crate::toolchain::TARGET;
use crate::workspace::Workspace;

/// What `deny.toml` accepts.
#[derive(Debug, Default, PartialEq, Eq)]
struct Policy {
    /// Licences accepted from every package.
    allow: BTreeSet<String>,
    /// Package and licence, accepted from that package alone.
    exceptions: Vec<(String, String)>,
}

/// A package as `cargo tree` prints it.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Package {
    name: String,
    version: String,
    licence: String,
}

/// Checks every package and says how many there are.
///
/// Packages for other platforms than this computer and the board are downloaded for this check alone.
/// Where that is not possible they are left out, and the answer says so.
///
/// # Errors
/// Lists each package whose licence expression the policy does not satisfy, and each exception that no
/// package needs.
pub fn check(workspace: &Workspace) -> Result<String> {
    let policy = Policy::parse(&read(workspace, "deny.toml")?)?;
    let (packages, all) = match packages(workspace, &["--target", "all"]) {
        Ok(packages) => (packages, true),
        Err(reason) => (
            packages(
                workspace,
                &["--offline", "--target", "host-tuple", "--target", TARGET],
            )
            .map_err(|_| reason)?,
            false,
        ),
    };
    let faults = faults(&policy, &packages);
    if !faults.is_empty() {
        return Err(Failure::new(format!(
            "{} faults of licences:\n  {}",
            faults.len(),
            faults.join("\n  ")
        ))
        .remedy("replace the package, or accept its licence in deny.toml with the reason"));
    }
    let others = if all {
        ""
    } else {
        ", without those of other platforms: they could not be downloaded"
    };
    Ok(format!("{} packages{others}", packages.len()))
}

fn read(workspace: &Workspace, name: &str) -> Result<String> {
    fs::read_to_string(workspace.root().join(name))
        .map_err(|error| Failure::new(format!("{name} can't be read: {error}")))
}

/// The packages that `cargo tree` shows for some targets.
fn packages(workspace: &Workspace, options: &[&str]) -> Result<BTreeSet<Package>> {
    let mut command = process::cargo(Sees::CompilerAndFlags);
    command
        .current_dir(workspace.root())
        .args(["tree", "--locked", "--workspace", "--all-features"])
        // Each package's own dependencies once: with all repetitions burn alone makes 20 million lines.
        .args(["--edges", "normal,build,dev"])
        .args(["--prefix", "none", "--format", "{p}|{l}"])
        .args(options);
    let output = process::capture(&mut command)?;
    if !output.status.success() {
        return Err(Failure::new(format!(
            "`{}` failed:\n{}",
            process::line(&command),
            String::from_utf8_lossy(&output.stderr).trim_end()
        )));
    }
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter(|line| !line.is_empty())
        .map(|line| {
            Package::parse(line)
                .ok_or_else(|| Failure::new(format!("`cargo tree` printed the unknown `{line}`")))
        })
        .collect()
}

fn faults(policy: &Policy, packages: &BTreeSet<Package>) -> Vec<String> {
    let mut faults: Vec<String> = packages
        .iter()
        .filter(|package| !policy.accepts(package))
        .map(|package| {
            let licence = match package.licence.as_str() {
                "" => "no licence",
                text => text,
            };
            format!("{} {}: {licence}", package.name, package.version)
        })
        .collect();
    for (name, licence) in &policy.exceptions {
        let needed = packages.iter().any(|package| {
            package.name == *name && !satisfied(&package.licence, &|id| policy.allow.contains(id))
        });
        if !needed {
            faults.push(format!(
                "the exception of {licence} for {name} is not needed"
            ));
        }
    }
    faults
}

impl Package {
    /// From `name v1.2.3 (anything)|licence`, with a mark at the end where it was listed before.
    fn parse(line: &str) -> Option<Self> {
        let (package, licence) = line.rsplit_once('|')?;
        let licence = licence.trim_end_matches("(*)");
        let mut words = package.split_whitespace();
        Some(Self {
            name: words.next()?.to_string(),
            version: words.next()?.strip_prefix('v')?.to_string(),
            licence: licence.trim().to_string(),
        })
    }
}

impl Policy {
    /// Reads `allow` and `exceptions` of the section `licenses`. The file is the project's own, so
    /// this needs one form only: an array of strings, and an array of inline tables.
    fn parse(text: &str) -> Result<Self> {
        let mut policy = Self::default();
        let (mut inside, mut array) = (false, "");
        for line in text.lines().map(str::trim) {
            if line.starts_with('#') {
                continue;
            }
            if line.starts_with('[') {
                inside = line == "[licenses]";
            } else if inside && line == "allow = [" {
                array = "allow";
            } else if inside && line == "exceptions = [" {
                array = "exceptions";
            } else if line == "]" {
                array = "";
            } else if array == "allow" {
                policy.allow.extend(strings(line).map(str::to_string));
            } else if array == "exceptions" {
                let mut words = strings(line);
                if let Some(name) = words.next() {
                    policy
                        .exceptions
                        .extend(words.map(|licence| (name.to_string(), licence.to_string())));
                }
            }
        }
        if policy.allow.is_empty() {
            return Err(Failure::new(
                "deny.toml: no `allow = [` with one licence a line in section [licenses]",
            ));
        }
        Ok(policy)
    }

    /// Whether a package may be used. One that has a licence file and names no licence in its manifest needs an exception, which
    /// says what the file is.
    fn accepts(&self, package: &Package) -> bool {
        let mut exceptions = self
            .exceptions
            .iter()
            .filter(|(name, _)| *name == package.name);
        if package.licence.is_empty() {
            return exceptions.next().is_some();
        }
        satisfied(&package.licence, &|id| {
            self.allow.contains(id) || exceptions.clone().any(|(_, licence)| licence == id)
        })
    }
}

/// The texts between double quotes.
fn strings(line: &str) -> impl Iterator<Item = &str> {
    line.split('"').skip(1).step_by(2)
}

/// Whether a licence expression (SPDX 2.3, annex D; `/` is the old form of `OR`) holds for the accepted
/// licences. A text that is no expression does not hold.
fn satisfied(expression: &str, accepted: &dyn Fn(&str) -> bool) -> bool {
    let spaced = expression
        .replace('/', " OR ")
        .replace('(', " ( ")
        .replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    either(&mut rest, accepted).is_some_and(|holds| holds && rest.is_empty())
}

/// `A OR B ...`; `None` when the words are no expression.
fn either(rest: &mut &[&str], accepted: &dyn Fn(&str) -> bool) -> Option<bool> {
    let mut holds = both(rest, accepted)?;
    while let ["OR", tail @ ..] = *rest {
        *rest = tail;
        holds |= both(rest, accepted)?;
    }
    Some(holds)
}

/// `A AND B ...`, which binds tighter than OR.
fn both(rest: &mut &[&str], accepted: &dyn Fn(&str) -> bool) -> Option<bool> {
    let mut holds = single(rest, accepted)?;
    while let ["AND", tail @ ..] = *rest {
        *rest = tail;
        holds &= single(rest, accepted)?;
    }
    Some(holds)
}

/// A licence, a licence `WITH` an exception, or an expression in parentheses.
fn single(rest: &mut &[&str], accepted: &dyn Fn(&str) -> bool) -> Option<bool> {
    match *rest {
        ["(", tail @ ..] => {
            *rest = tail;
            let holds = either(rest, accepted)?;
            let [")", tail @ ..] = *rest else {
                return None;
            };
            *rest = tail;
            Some(holds)
        }
        [")" | "OR" | "AND" | "WITH", ..] | [] => None,
        [licence, "WITH", exception, tail @ ..] => {
            *rest = tail;
            Some(accepted(&format!("{licence} WITH {exception}")))
        }
        [licence, tail @ ..] => {
            *rest = tail;
            Some(accepted(licence))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DENY: &str = "\
[licenses]
# \"GPL-3.0\" in a comment is not accepted.
allow = [
    \"MIT\",
    \"Apache-2.0 WITH LLVM-exception\",
]
exceptions = [
    { crate = \"serialport\", allow = [\"MPL-2.0\"] },
]
[bans]
allow = [
    \"AGPL-3.0\",
]
";

    fn package(line: &str) -> Package {
        Package::parse(line).unwrap()
    }

    #[test]
    fn a_package_that_is_listed_again_is_the_same() {
        let again = package("ring v0.17.14|Apache-2.0 AND ISC (*)");
        assert_eq!(again, package("ring v0.17.14|Apache-2.0 AND ISC"));
    }

    #[test]
    fn the_policy_is_what_the_section_says() {
        let policy = Policy::parse(DENY).unwrap();
        let allow: Vec<_> = policy.allow.iter().map(String::as_str).collect();
        assert_eq!(allow, ["Apache-2.0 WITH LLVM-exception", "MIT"]);
        assert_eq!(
            policy.exceptions,
            [("serialport".to_string(), "MPL-2.0".to_string())]
        );
        assert!(Policy::parse("[licenses]\nallow = []\n").is_err());
    }

    #[test]
    fn expressions_follow_spdx() {
        let mit = |id: &str| id == "MIT";
        for good in [
            "MIT",
            "GPL-3.0 OR MIT",
            "MIT/Apache-2.0",
            "GPL-3.0 AND LGPL-3.0 OR MIT",
            "(GPL-3.0 OR MIT) AND (MIT)",
        ] {
            assert!(satisfied(good, &mit), "{good}");
        }
        for bad in [
            "",
            "GPL-3.0",
            "MIT AND GPL-3.0",
            "MIT WITH Some-exception",
            "(MIT",
            "MIT)",
            "MIT MIT",
            "MIT OR",
            "OR MIT",
            "(MIT OR GPL-3.0) AND GPL-3.0",
        ] {
            assert!(!satisfied(bad, &mit), "{bad}");
        }
    }

    #[test]
    fn an_exception_is_for_its_package_only_and_has_to_be_needed() {
        let policy = Policy::parse(DENY).unwrap();
        let mut packages = BTreeSet::from([
            package("serialport v4.10.1|MPL-2.0"),
            package("other v1.0.0 (proc-macro)|MPL-2.0"),
            package("board v0.1.0 (/somewhere)|MIT OR Apache-2.0"),
            package("unnamed v2.0.0|"),
        ]);
        assert_eq!(
            faults(&policy, &packages),
            ["other 1.0.0: MPL-2.0", "unnamed 2.0.0: no licence"]
        );
        packages.retain(|package| package.name == "board");
        assert_eq!(
            faults(&policy, &packages),
            ["the exception of MPL-2.0 for serialport is not needed"]
        );
    }
    #[test]
    fn a_package_with_a_licence_file_alone_needs_an_exception() {
        let text = DENY.replace("serialport", "unnamed");
        let policy = Policy::parse(&text).unwrap();
        let mut packages = BTreeSet::from([package("unnamed v2.0.0|")]);
        assert!(faults(&policy, &packages).is_empty());
        packages.insert(package("unknown v1.0.0|"));
        assert_eq!(faults(&policy, &packages), ["unknown 1.0.0: no licence"]);
    }
}
