//! Analysis, generator and plant must not depend on each other, directly or indirectly.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// Packages of the workspace and those that each depends on, of whatever sort (normal, build, dev).
type Graph = BTreeMap<String, BTreeSet<String>>;

/// Packages that must not reach each other.
const APART: [&str; 3] = ["residual", "synthetic-sets", "plant"];

/// The package that every other one of the analysis stands on.
const FLOOR: &str = "residual-columns";

fn workspace() -> Graph {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args([
            "metadata",
            "--no-deps",
            "--format-version",
            "1",
            "--offline",
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo starts");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
    let list = |value: &serde_json::Value| value.as_array().cloned().unwrap_or_default();
    let name = |value: &serde_json::Value| value["name"].as_str().unwrap_or_default().to_string();
    let packages = list(&metadata["packages"]);
    let own: BTreeSet<String> = packages.iter().map(name).collect();
    packages
        .iter()
        .map(|package| {
            let needs = list(&package["dependencies"]);
            let needs = needs.iter().map(name).filter(|n| own.contains(n));
            (name(package), needs.collect())
        })
        .collect()
}

/// Every package that `from` reaches, itself left out.
fn reach(graph: &Graph, from: &str) -> BTreeSet<String> {
    let mut out = BTreeSet::new();
    let mut open = vec![from.to_string()];
    while let Some(name) = open.pop() {
        for next in graph.get(&name).into_iter().flatten() {
            if out.insert(next.clone()) {
                open.push(next.clone());
            }
        }
    }
    out
}

/// Forbidden pairs, as text.
fn violations(graph: &Graph) -> Vec<String> {
    let mut out = Vec::new();
    for from in APART {
        let reached = reach(graph, from);
        let floor = (from != "residual").then_some(&FLOOR);
        out.extend(
            APART
                .iter()
                .chain(floor)
                .filter(|to| **to != from && reached.contains(**to))
                .map(|to| format!("{from} depends on {to}")),
        );
        // The generator depends on no package of the project, so that it shares no constant with
        // the analysis.
        if from == "synthetic-sets" {
            out.extend(reached.iter().map(|to| format!("synthetic-sets uses {to}")));
        }
    }
    out
}

#[test]
fn analysis_generator_and_plant_are_independent() {
    let graph = workspace();
    for name in APART.into_iter().chain([FLOOR]) {
        assert!(
            graph.contains_key(name),
            "{name} is no package of the workspace"
        );
    }
    assert!(
        graph["residual-bench"].contains("residual"),
        "the bench is where they meet"
    );
    assert_eq!(violations(&graph), Vec::<String>::new());
}

#[test]
fn a_dependency_through_a_third_package_is_noticed() {
    let mut graph = workspace();
    let mut edge = |from: &str, to: &str| {
        graph.entry(from.into()).or_default().insert(to.into());
    };
    edge("residual", "between");
    edge("between", "synthetic-sets");
    assert_eq!(violations(&graph), ["residual depends on synthetic-sets"]);
    graph.insert("plant".into(), ["residual-effects".into()].into());
    let last = violations(&graph).pop();
    assert_eq!(last.as_deref(), Some("plant depends on residual-columns"));
}
