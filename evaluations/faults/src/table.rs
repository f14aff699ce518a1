//! The summary of outcomes as text: a row for each category, pairs for themselves, and every
//! hazard.

use crate::case::{HELD_N, SLACK_MM};
use crate::host::SWING_N;
use crate::injection::{Category, Phase, BASES};
use crate::outcome::{Hazard, Outcome};
use control::Fault;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// What is counted, and whether a case is one.
type Counted<'a> = (&'a str, &'a dyn Fn(&Outcome) -> bool);

/// Outcomes by seed and number.
pub type Outcomes = BTreeMap<(u64, u64), Outcome>;

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
pub fn summary(outcomes: &Outcomes) -> String {
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

/// What was drawn, and what the hazards say: seeds, range of tension, phases, the share of hazards
/// and its upper bound.
#[must_use]
pub fn drawn(outcomes: &Outcomes, current_limit_a: f64) -> String {
    let seeds: BTreeSet<u64> = outcomes.keys().map(|(seed, _)| *seed).collect();
    let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
    let count = |of: &dyn Fn(&Outcome) -> bool| outcomes.values().filter(|o| of(o)).count();
    let mut text = format!(
        "\nseeds {}; amplifiers limited to {current_limit_a} A\n",
        seeds.join(", ")
    );
    let (least, largest) = HELD_N;
    let _ = writeln!(
        text,
        "tensions of {:.1} to {:.1} N: {BASES} plants a seed hold {least} to {largest} N, and their setpoints swing by {SWING_N} N",
        least - SWING_N,
        largest + SWING_N
    );
    let _ = writeln!(
        text,
        "slack of the plants at power-on, in turn: {SLACK_MM:?} mm"
    );
    let phases = Phase::ALL.map(|(phase, _)| {
        let cases = count(&|outcome| outcome.plan.phase.0 == phase);
        let hazards =
            count(&|outcome| outcome.plan.phase.0 == phase && !outcome.hazards.is_empty());
        format!("{phase:?} {cases} ({hazards})")
    });
    let _ = writeln!(
        text,
        "cases in each phase (with a hazard): {}",
        phases.join(", ")
    );
    let cleared = |outcome: &Outcome| outcome.plan.clear_ms.is_some();
    let _ = writeln!(
        text,
        "cases that the host clears twice: {} ({})",
        count(&cleared),
        count(&|outcome| cleared(outcome) && !outcome.hazards.is_empty())
    );
    let taken_up = |outcome: &Outcome| {
        outcome.slack_before && matches!(outcome.hazards[..], [(Hazard::Slack, _)])
    };
    let kinds: [Counted; 5] = [
        ("hazards", &|outcome| !outcome.hazards.is_empty()),
        ("undetected", &Outcome::is_undetected),
        (
            "of an output that stands at the end of its range",
            &|outcome| !outcome.hazards.is_empty() && outcome.plan.has_full_output(),
        ),
        (
            "nothing but slack that an arming was taking up already",
            &taken_up,
        ),
        ("of those undetected", &|outcome| {
            outcome.is_undetected() && taken_up(outcome)
        }),
    ];
    for (name, of) in kinds {
        let found = count(of);
        let _ = writeln!(
            text,
            "{name}: {found} of {}, {:.3} %, at most {:.3} % (95 %)",
            outcomes.len(),
            100.0 * found as f64 / outcomes.len().max(1) as f64,
            100.0 * upper_bound(found) / outcomes.len().max(1) as f64
        );
    }
    text
}

/// The mean number of events whose count is this or less in one of twenty campaigns (Poisson;
/// Garwood's upper limit).
#[must_use]
pub fn upper_bound(found: usize) -> f64 {
    let degrees = 2.0 * (found as f64 + 1.0);
    let chi_squared = ChiSquared::new(degrees).expect("degrees of freedom above zero");
    0.5 * chi_squared.inverse_cdf(0.95)
}

/// Every case with a hazard, one a line.
#[must_use]
pub fn hazards(outcomes: &Outcomes) -> String {
    let mut text = String::new();
    for ((seed, _), outcome) in outcomes.iter().filter(|(_, o)| !o.hazards.is_empty()) {
        let fault = Fault::from_code(outcome.fault).map_or("no fault", Fault::name);
        let _ = writeln!(
            text,
            "case {seed}/{}, {:?} {} ms{}: {:?}{}: {:?}, largest tension {:.1} N; {fault}{}",
            outcome.number,
            outcome.plan.phase.0,
            outcome.plan.phase.1,
            outcome
                .plan
                .clear_ms
                .map_or(String::new(), |ms| format!(", cleared after {ms} ms")),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of the Poisson distribution: 3.00 for none, 4.74 for one, 16.96 for ten; many are
    /// nearly normal.
    #[test]
    fn the_upper_bound_is_that_of_the_tables() {
        for (found, bound) in [(0, 2.996), (1, 4.744), (10, 16.962)] {
            assert!((upper_bound(found) - bound).abs() < 1e-3, "{found}");
        }
        for found in [700_usize, 969, 40_000] {
            let mean = found as f64 + 1.0;
            let nearly = mean + 1.645 * mean.sqrt();
            let bound = upper_bound(found);
            assert!(
                (bound - nearly).abs() < 2.0,
                "{found}: {bound} and {nearly}"
            );
        }
    }
}
