//! The summary of outcomes as text: a row for each category, pairs for themselves, and every hazard.

use crate::injection::Category;
use crate::outcome::Outcome;
use control::Fault;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Counts of a row.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    cases: usize,
    detected: usize,
    harmless: usize,
    late: usize,
    undetected: usize,
}

impl Row {
    fn of<'a>(outcomes: impl Iterator<Item = &'a Outcome>) -> (Self, Vec<u32>) {
        let mut row = Self::default();
        let mut times = Vec::new();
        for outcome in outcomes {
            row.cases += 1;
            row.detected += usize::from(outcome.fault != 0);
            row.harmless += usize::from(outcome.is_harmless());
            row.late += usize::from(outcome.is_late());
            row.undetected += usize::from(outcome.is_undetected());
            times.extend(outcome.safe_ms);
        }
        times.sort_unstable();
        (row, times)
    }
}

/// The table.
#[must_use]
pub fn summary(outcomes: &BTreeMap<u64, Outcome>) -> String {
    let mut text = String::from(
        "| injected | cases | detected | harmless | hazard despite a fault | hazard undetected | to safe, median ms | worst ms |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n",
    );
    for category in Category::ALL {
        let row = outcomes.values().filter(|outcome| {
            outcome.plan.second.is_none() && outcome.plan.first.category() == category
        });
        line(&mut text, &format!("{category:?}").to_lowercase(), row);
    }
    let pairs = outcomes
        .values()
        .filter(|outcome| outcome.plan.second.is_some());
    line(&mut text, "pairs", pairs);
    line(&mut text, "all", outcomes.values());
    text
}

fn line<'a>(text: &mut String, name: &str, outcomes: impl Iterator<Item = &'a Outcome>) {
    let (row, times) = Row::of(outcomes);
    let at = |part: usize, of: usize| {
        times
            .get((times.len() * part / of).min(times.len().saturating_sub(1)))
            .map_or("-".to_owned(), u32::to_string)
    };
    let _ = writeln!(
        text,
        "| {name} | {} | {} | {} | {} | {} | {} | {} |",
        row.cases,
        row.detected,
        row.harmless,
        row.late,
        row.undetected,
        at(1, 2),
        at(1, 1)
    );
}

/// Every case with a hazard, one a line.
#[must_use]
pub fn hazards(outcomes: &BTreeMap<u64, Outcome>) -> String {
    let mut text = String::new();
    for outcome in outcomes.values().filter(|o| !o.hazards.is_empty()) {
        let fault = Fault::from_code(outcome.fault).map_or("no fault", Fault::name);
        let _ = writeln!(
            text,
            "case {}: {:?}{}: {:?}, largest tension {:.1} N; {fault}{}",
            outcome.number,
            outcome.plan.first,
            outcome
                .plan
                .second
                .map_or(String::new(), |(what, ms)| format!(
                    " and {what:?} after {ms} ms"
                )),
            outcome.hazards,
            outcome.tension_n,
            outcome
                .detected_ms
                .map_or(String::new(), |ms| format!(" after {ms} ms")),
        );
    }
    text
}
