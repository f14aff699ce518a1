//! Results on public data sets as Markdown.

use super::Outcome;
use residual::num;
use std::fmt::Write as _;

/// The page: heading, cases, rates.
#[must_use]
pub fn page(all: &[Outcome], absent: usize) -> String {
    let mut out = String::from(
        "# The residual analysis on public measured data\n\n\
         Written by `cargo run -p residual-bench --bin real-bench -- --data DIR --markdown docs/residual/real-data.md`; don't edit.\n\n\
         `DIR` is a folder with clones of the repositories below. None of their data is part of this project. Which names are right \
         is written in `evaluations/residual-bench/models/cases.toml`, with the reason, from what is known about each machine. \
         *check* is other data of the same machine: errors of the declared model, with the effects found, and with everything \
         that improves the fit, all frozen.\n",
    );
    if absent > 0 {
        let _ = writeln!(
            out,
            "\nCases without data in the folder, left out: {absent}."
        );
    }
    out += "\n| case | rows | declared | after | found | improves, name not supported | verdict | check: declared | found | all |\n\
            |---|---:|---:|---:|---|---|---|---:|---:|---:|\n";
    for o in all {
        let r = &o.report;
        let list = |items: Vec<String>| match items.is_empty() {
            true => "-".to_string(),
            false => items.join(", "),
        };
        let found = o.found.iter().map(|f| match f.right {
            true => f.text.clone(),
            false => format!("**{}**", f.text),
        });
        let improves = r.improves.iter().map(|e| e.name.to_string());
        let check = match &r.check {
            None => "| | |".to_string(),
            Some(c) => format!(
                "{} | {} | {}",
                num(c.declared_rmse),
                num(c.found_rmse),
                num(c.all_rmse)
            ),
        };
        let _ = writeln!(
            out,
            "| {} | {} | {} {unit} | {} {unit} | {} | {} | {} | {check} |",
            o.case.name,
            r.rows,
            num(r.baseline.heldout_rmse),
            num(r.last.heldout_rmse),
            list(found.collect()),
            list(improves.collect()),
            r.verdict.word(),
            unit = r.unit
        );
    }
    out += "\nNames in bold are not right.\n";
    out += &rates(all);
    out += "\n## Why these names are right\n\n";
    for o in all {
        let _ = writeln!(
            out,
            "* {}: {} ({})",
            o.case.name,
            o.case.why,
            o.case.right.join(", ")
        );
    }
    out
}

/// Rates beside the goals.
fn rates(all: &[Outcome]) -> String {
    let named: Vec<bool> = all
        .iter()
        .flat_map(|o| o.found.iter().map(|f| f.right))
        .collect();
    let held: Vec<bool> = all.iter().filter_map(|o| o.holds).collect();
    let line = |what: &str, hits: &[bool], goal: f64| {
        let right = hits.iter().filter(|h| **h).count();
        let share = right as f64 / hits.len().max(1) as f64;
        format!(
            "| {what} | {:.1} % ({right} of {}) | >= {:.0} % | {} |\n",
            100.0 * share,
            hits.len(),
            100.0 * goal,
            if share >= goal { "reached" } else { "missed" }
        )
    };
    let mut out = String::from("\n## Rates\n\n| what | figure | goal | |\n|---|---|---|---|\n");
    out += &line(
        "names found that are right or honestly grouped",
        &named,
        0.95,
    );
    out += &line(
        "frozen models with the found effects not worse than declared on the check data",
        &held,
        1.0,
    );
    out
}
