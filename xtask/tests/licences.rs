//! Licences of all packages, on any platform and with any feature, against the section `licenses` of
//! `deny.toml`. cargo-deny reads licence texts as well, but takes minutes to install; this runs everywhere.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use spdx::{Expression, ParseMode};

/// Of `deny.toml`, what is read here.
#[derive(Deserialize)]
struct Deny {
    licenses: Policy,
}

#[derive(Deserialize)]
struct Policy {
    allow: Vec<String>,
    exceptions: Vec<Exception>,
}

/// Licences accepted from one package.
#[derive(Deserialize)]
struct Exception {
    #[serde(rename = "crate")]
    package: String,
    allow: Vec<String>,
}

/// A package as `cargo tree` prints it: `name v1.2.3 (anything)|licence`, with a mark where it was listed
/// before.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Package<'a> {
    name: &'a str,
    licence: &'a str,
}

impl<'a> Package<'a> {
    fn parse(line: &'a str) -> Option<Self> {
        let (package, licence) = line.rsplit_once('|')?;
        Some(Self {
            name: package.split(' ').next()?,
            licence: licence.trim_end_matches(" (*)"),
        })
    }

    /// Whether the licences that `accepts` knows satisfy the package's whole expression.
    fn satisfied(&self, accepts: impl Fn(&str) -> bool) -> bool {
        Expression::parse_mode(self.licence, ParseMode::LAX)
            .is_ok_and(|parsed| parsed.evaluate(|required| accepts(&required.to_string())))
    }
}

impl Policy {
    /// A package that names no licence has a file instead; its exception says what that file is.
    fn accepts(&self, package: &Package<'_>) -> bool {
        let exception = self.exceptions.iter().find(|e| e.package == package.name);
        let more = exception.map_or(&[][..], |exception| &exception.allow);
        let file = package.licence.is_empty() && exception.is_some();
        file || package.satisfied(|id| self.allow.iter().chain(more).any(|known| known == id))
    }

    fn needs(&self, exception: &Exception, packages: &BTreeSet<Package<'_>>) -> bool {
        packages.iter().any(|package| {
            package.name == exception.package
                && !package.satisfied(|id| self.allow.iter().any(|known| known == id))
        })
    }
}

#[test]
fn every_licence_is_accepted_and_every_exception_is_needed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let deny = fs::read_to_string(root.join("deny.toml")).unwrap();
    let policy = toml::from_str::<Deny>(&deny).unwrap().licenses;
    let output = Command::new(env!("CARGO"))
        .current_dir(&root)
        .args([
            "tree",
            "--locked",
            "--workspace",
            "--all-features",
            "--target",
            "all",
        ])
        .args([
            "--edges",
            "normal,build,dev",
            "--prefix",
            "none",
            "--format",
            "{p}|{l}",
        ])
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8_lossy(&output.stdout);
    let packages: BTreeSet<Package<'_>> = text.lines().filter_map(Package::parse).collect();
    let refused: Vec<&Package<'_>> = packages
        .iter()
        .filter(|package| !policy.accepts(package))
        .collect();
    let idle: Vec<&str> = policy
        .exceptions
        .iter()
        .filter(|exception| !policy.needs(exception, &packages))
        .map(|exception| exception.package.as_str())
        .collect();
    assert!(
        refused.is_empty() && idle.is_empty(),
        "replace these or accept their licence in deny.toml with the reason: {refused:#?}\n\
         exceptions that no package needs: {idle:?}"
    );
}
