//! Licences of all packages, on any platform and with any feature, against the section `licenses`
//! of `deny.toml`. cargo-deny reads licence texts as well, but takes minutes to install; this runs
//! everywhere.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use spdx::{Expression, ParseMode};

/// SPDX as it is written, and `/` for `OR`, which old manifests have.
const MODE: ParseMode = ParseMode {
    allow_slash_as_or_operator: true,
    ..ParseMode::STRICT
};

/// Of `deny.toml`, what is read here.
#[derive(Deserialize)]
struct Deny {
    licenses: Policy,
}

#[derive(Clone, Deserialize)]
struct Policy {
    allow: Vec<String>,
    exceptions: Vec<Exception>,
}

/// Licences accepted from one package.
#[derive(Clone, Debug, Deserialize)]
struct Exception {
    #[serde(rename = "crate")]
    package: String,
    allow: Vec<String>,
}

/// A package as `cargo tree` prints it: `name v1.2.3 (anything)|licence`, with a mark where it was
/// listed before.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Package<'a> {
    name: &'a str,
    version: &'a str,
    licence: &'a str,
}

impl<'a> Package<'a> {
    fn parse(line: &'a str) -> Self {
        let parts = line.rsplit_once('|').and_then(|(package, licence)| {
            let mut words = package.split(' ');
            Some(Self {
                name: words.next()?,
                version: words.next()?.strip_prefix('v')?,
                licence: licence.trim_end_matches(" (*)"),
            })
        });
        parts.unwrap_or_else(|| panic!("`cargo tree` printed the unknown `{line}`"))
    }

    fn all(lines: &'a str) -> BTreeSet<Self> {
        let lines = lines.lines().filter(|line| !line.is_empty());
        lines.map(Self::parse).collect()
    }
}

impl Policy {
    /// Whether the accepted licences satisfy the package's whole expression. A package that names
    /// no licence has a file instead; its exception says what that file is.
    fn accepts(&self, package: &Package<'_>) -> bool {
        let own = || self.exceptions.iter().filter(|e| e.package == package.name);
        if package.licence.is_empty() {
            return own().next().is_some();
        }
        let known = |id: &String| self.allow.contains(id) || own().any(|e| e.allow.contains(id));
        Expression::parse_mode(package.licence, MODE)
            .is_ok_and(|parsed| parsed.evaluate(|required| known(&required.to_string())))
    }

    /// Packages that are not accepted, and exceptions without which nothing changes.
    fn faults(&self, packages: &BTreeSet<Package<'_>>) -> Vec<String> {
        let refused = packages.iter().filter(|package| !self.accepts(package));
        let idle = (0..self.exceptions.len()).filter(|&at| {
            let mut less = self.clone();
            less.exceptions.remove(at);
            (packages.iter()).all(|package| self.accepts(package) == less.accepts(package))
        });
        refused
            .map(|package| format!("{package:?} is refused"))
            .chain(idle.map(|at| format!("{:?} is not needed", self.exceptions[at])))
            .collect()
    }
}

/// What `cargo tree` prints of all packages of these targets.
fn tree(root: &Path, targets: &[&str]) -> Result<String, String> {
    let output = Command::new(env!("CARGO"))
        .current_dir(root)
        .args(["tree", "--locked", "--workspace", "--all-features"])
        .args(["--edges", "normal,build,dev", "--prefix", "none"])
        .args(["--format", "{p}|{l}"])
        .args(targets)
        .output()
        .map_err(|error| error.to_string())?;
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    if output.status.success() {
        Ok(text(&output.stdout))
    } else {
        Err(text(&output.stderr))
    }
}

#[test]
fn every_licence_is_accepted_and_every_exception_is_needed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let deny = fs::read_to_string(root.join("deny.toml")).unwrap();
    let policy = toml::from_str::<Deny>(&deny).unwrap().licenses;
    // Packages for other platforms than this computer and the board are downloaded for this check
    // alone.
    let lines = tree(&root, &["--target", "all"]).or_else(|reason| {
        eprintln!("without the packages of other platforms: {reason}");
        let board = "thumbv7em-none-eabihf";
        tree(
            &root,
            &["--offline", "--target", "host-tuple", "--target", board],
        )
    });
    let lines = lines.unwrap();
    let faults = policy.faults(&Package::all(&lines));
    assert!(
        faults.is_empty(),
        "replace these or accept their licence in deny.toml with the reason: {faults:#?}"
    );
}

/// One exception a word: `crate=licence`.
#[test]
fn the_policy_refuses_what_it_should() {
    for (exceptions, package, refused, idle) in [
        ("", "a v1.0.0|MIT", 0, 0),
        ("", "a v1.0.0 (/somewhere)|MIT (*)", 0, 0),
        ("", "a v1.0.0|GPL-3.0-only", 1, 0),
        ("", "a v1.0.0|MIT AND GPL-3.0-only", 1, 0),
        ("", "a v1.0.0|(GPL-3.0-only OR MIT) AND MIT", 0, 0),
        ("", "a v1.0.0|(GPL-3.0-only OR MIT) AND ISC", 1, 0),
        ("", "a v1.0.0|GPL-3.0-only/MIT", 0, 0),
        ("", "a v1.0.0|MIT License", 1, 0),
        ("", "a v1.0.0|MIT OR", 1, 0),
        ("", "a v1.0.0|Apache-2.0", 1, 0),
        ("", "a v1.0.0|Apache-2.0 WITH LLVM-exception", 0, 0),
        ("", "a v1.0.0|", 1, 0),
        ("a=ISC", "a v1.0.0|", 0, 0),
        ("a=ISC", "a v1.0.0|ISC", 0, 0),
        ("b=ISC", "a v1.0.0|ISC", 1, 1),
        ("b=ISC", "a v1.0.0|", 1, 1),
        ("a=ISC", "a v1.0.0|MIT", 0, 1),
        ("a=ISC", "a v1.0.0|MIT OR ISC", 0, 1),
        ("a=ISC a=Zlib", "a v1.0.0|ISC", 0, 1),
        ("a=ISC a=Zlib", "a v1.0.0|ISC AND Zlib", 0, 0),
    ] {
        let exceptions = exceptions.split_whitespace().map(|word| {
            let (package, licence) = word.split_once('=').unwrap();
            Exception {
                package: package.into(),
                allow: vec![licence.into()],
            }
        });
        let policy = Policy {
            allow: vec!["MIT".into(), "Apache-2.0 WITH LLVM-exception".into()],
            exceptions: exceptions.collect(),
        };
        let faults = policy.faults(&Package::all(package));
        let count = |what| faults.iter().filter(|text| text.ends_with(what)).count();
        assert_eq!(
            (count("refused"), count("not needed")),
            (refused, idle),
            "{package}: {faults:?}"
        );
    }
}

#[test]
#[should_panic(expected = "the unknown `a 1.0.0|MIT`")]
fn a_line_that_is_no_package_is_not_skipped() {
    let _ = Package::all("a 1.0.0|MIT");
}
