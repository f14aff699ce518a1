//! Rates beside their targets, what was answered, and the closing summary. The text is Markdown, so
//! that the terminal and the page in `docs` show the same.

use crate::case::{Group, STRENGTHS};
use crate::evaluate::Outcome;
use crate::judge::{Class, EITHER};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A figure with its target.
#[derive(Debug, Clone)]
pub struct Rate {
    /// What is counted.
    pub what: String,
    /// Share, between 0 and 1, or a ratio.
    pub value: f64,
    /// Number of cases behind it.
    pub of: usize,
    /// The figure as text.
    pub text: String,
    /// The target as text; empty if there is none.
    pub target: String,
    /// Whether the target is reached; `None` without target or cases.
    pub reached: Option<bool>,
}

/// Whether a figure must be at least or at most its target.
enum Target {
    AtLeast(f64),
    AtMost(f64),
    None,
}

/// A share of cases with its target.
fn share<'a>(
    what: &str,
    cases: impl Iterator<Item = &'a Outcome>,
    hit: impl Fn(&Outcome) -> bool,
    target: Target,
) -> Rate {
    let (mut hits, mut of) = (0, 0);
    for case in cases {
        hits += usize::from(hit(case));
        of += 1;
    }
    let value = hits as f64 / of.max(1) as f64;
    Rate {
        what: what.into(),
        value,
        of,
        text: format!("{:.1} % ({hits} of {of})", 100.0 * value),
        target: match target {
            Target::AtLeast(x) => format!(">= {:.0} %", 100.0 * x),
            Target::AtMost(x) => format!("<= {:.0} %", 100.0 * x),
            Target::None => String::new(),
        },
        reached: match target {
            _ if of == 0 => None,
            Target::AtLeast(x) => Some(value >= x),
            Target::AtMost(x) => Some(value <= x),
            Target::None => None,
        },
    }
}

/// Quantile of unsorted values; 0 if there are none.
fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    if values.is_empty() {
        return 0.0;
    }
    values[((values.len() - 1) as f64 * q).round() as usize]
}

/// All rates.
#[must_use]
pub fn rates(all: &[Outcome]) -> Vec<Rate> {
    let group = |g: Group| all.iter().filter(move |o| o.case.group == g);
    let known = |low: f64, high: f64| {
        group(Group::Known).filter(move |o| o.case.strength >= low && o.case.strength < high)
    };
    let right = |o: &Outcome| o.class == Class::Right;
    let among = |o: &Outcome| o.class == Class::Among;
    let told = |o: &&Outcome| o.class != Class::Among;
    let mut out = vec![
        share(
            "right effect first, RMS at least the noise's",
            known(1.0, 99.0),
            right,
            Target::AtLeast(0.95),
        ),
        share(
            "... at 3 times the noise",
            known(3.0, 99.0),
            right,
            Target::None,
        ),
        share("... at the noise", known(1.0, 3.0), right, Target::None),
        share(
            "... *A or B*, the true effect among them",
            known(1.0, 99.0),
            among,
            Target::None,
        ),
        share(
            "... right among the rest",
            known(1.0, 99.0).filter(told),
            right,
            Target::None,
        ),
        share(
            "right effect first, RMS 0.3 of the noise's",
            known(0.0, 1.0),
            right,
            Target::AtLeast(0.80),
        ),
        share(
            "... *A or B*, the true effect among them",
            known(0.0, 1.0),
            among,
            Target::None,
        ),
        share(
            "... right among the rest",
            known(0.0, 1.0).filter(told),
            right,
            Target::None,
        ),
        share(
            "closed loop, RMS at the noise's: right effect first",
            group(Group::Closed),
            right,
            Target::None,
        ),
        share(
            "... *A or B*, the true effect among them",
            group(Group::Closed),
            among,
            Target::None,
        ),
        share(
            "... another effect first",
            group(Group::Closed),
            |o| o.class == Class::Wrong,
            Target::None,
        ),
        share(
            "one effect right and first, another named beside it",
            known(0.0, 99.0).filter(|o| right(o)),
            |o| o.extra > 0,
            Target::None,
        ),
        share(
            "two effects: one of them first",
            group(Group::Two),
            right,
            Target::AtLeast(0.95),
        ),
        share(
            "... both named, no other",
            group(Group::Two),
            |o| right(o) && o.hits == 2 && o.extra == 0,
            Target::None,
        ),
        share(
            "three effects: one of them first",
            group(Group::Three),
            right,
            Target::None,
        ),
        share(
            "... two of them or more named",
            group(Group::Three),
            |o| o.hits >= 2,
            Target::AtLeast(0.95),
        ),
        share(
            "... all three named",
            group(Group::Three),
            |o| o.hits == 3,
            Target::AtLeast(0.70),
        ),
        share(
            "unusual logs: right effect first",
            group(Group::Unusual),
            right,
            Target::None,
        ),
        share(
            "... another effect first",
            group(Group::Unusual),
            |o| o.class == Class::Wrong,
            Target::None,
        ),
        share(
            "an effect called found that is not there, all sets with effects of the catalogue",
            all.iter()
                .filter(|o| !matches!(o.case.group, Group::Impure | Group::Uncatalogued)),
            Outcome::finds_a_wrong_one,
            Target::AtMost(0.02),
        ),
        share(
            "... or in *A or B* with one that is",
            all.iter()
                .filter(|o| !matches!(o.case.group, Group::Impure | Group::Uncatalogued)),
            |o| o.grouped > 0 && !o.finds_a_wrong_one(),
            Target::None,
        ),
        share(
            "false alarms on empty sets",
            group(Group::Empty),
            |o| o.class != Class::Right,
            Target::AtMost(0.01),
        ),
        share(
            "... open loop",
            group(Group::Empty).filter(|o| !o.case.closed_loop),
            |o| o.class != Class::Right,
            Target::None,
        ),
        share(
            "... closed loop",
            group(Group::Empty).filter(|o| o.case.closed_loop),
            |o| o.class != Class::Right,
            Target::None,
        ),
        share(
            "effects outside the catalogue, RMS at least the noise's, called `unknown`",
            group(Group::Uncatalogued).filter(|o| o.case.strength >= 1.0),
            right,
            Target::AtLeast(0.95),
        ),
        share(
            "... RMS 0.3 of the noise's",
            group(Group::Uncatalogued).filter(|o| o.case.strength < 1.0),
            right,
            Target::AtLeast(0.85),
        ),
    ];
    let mut errors: Vec<f64> = known(1.0, 99.0)
        .filter(|o| right(o))
        .flat_map(|o| o.estimates.iter().map(|e| e.error()))
        .collect();
    let close = errors.iter().filter(|e| **e <= 0.1).count();
    let value = close as f64 / errors.len().max(1) as f64;
    out.push(Rate {
        what: "parameters within 10 % of the truth, RMS at least the noise's".into(),
        value,
        of: errors.len(),
        text: format!(
            "{:.1} % ({close} of {}); median error {:.1} %, 95 % quantile {:.1} %",
            100.0 * value,
            errors.len(),
            100.0 * quantile(&mut errors, 0.5),
            100.0 * quantile(&mut errors, 0.95)
        ),
        target: ">= 95 %".into(),
        reached: (!errors.is_empty()).then_some(value >= 0.95),
    });
    let mut over: Vec<f64> = all
        .iter()
        .filter(|o| matches!(o.case.group, Group::Known | Group::Closed | Group::Two))
        .map(Outcome::over_oracle)
        .collect();
    let within = over.iter().filter(|r| **r <= 1.05).count();
    let value = quantile(&mut over, 0.95);
    out.push(Rate {
        what: "held-out RMSE after over the oracle's, all known effects, 95 % quantile".into(),
        value,
        of: over.len(),
        text: format!(
            "{value:.4} (median {:.4}, worst {:.4}; {within} of {} within 1.05)",
            quantile(&mut over, 0.5),
            quantile(&mut over, 1.0),
            over.len()
        ),
        target: "<= 1.05".into(),
        reached: (!over.is_empty()).then_some(value <= 1.05),
    });
    out
}

/// What was answered in sets of one truth: what is right in each set is told in one line, the rest
/// in a table.
fn answers(title: &str, outcomes: &[&Outcome]) -> String {
    // In the order in which the sets were made.
    let mut rows: Vec<(String, Vec<&Outcome>)> = Vec::new();
    for outcome in outcomes {
        let truth = outcome.case.truth();
        match rows.iter_mut().find(|(row, _)| *row == truth) {
            Some((_, sets)) => sets.push(outcome),
            None => rows.push((truth, vec![outcome])),
        }
    }
    let named = |truth: &str, sets: &[&Outcome]| sets.iter().all(|o| o.answer == truth);
    let (always, others): (Vec<_>, Vec<_>) = rows.iter().partition(|(t, sets)| named(t, sets));
    let mut out = String::new();
    if !rows.is_empty() {
        let _ = write!(out, "### {title}\n\n");
    }
    if !always.is_empty() {
        let list: Vec<_> = always
            .iter()
            .map(|(truth, sets)| format!("{truth} {}", sets.len()))
            .collect();
        let _ = write!(out, "Right in every set: {}.\n\n", list.join(", "));
    }
    if !others.is_empty() {
        out += "| truth | right | named first, or the verdict |\n|---|---:|---|\n";
        for (truth, sets) in others {
            let right = sets.iter().filter(|o| o.class == Class::Right).count();
            let of = sets.len();
            let _ = writeln!(out, "| {truth} | {right}/{of} | {} |", counts(sets));
        }
        out.push('\n');
    }
    out
}

/// How often each effect was named first, or each verdict given; effects in the order of the
/// catalogue.
fn counts(sets: &[&Outcome]) -> String {
    let order = residual::names();
    let mut counts: BTreeMap<(usize, &str), usize> = BTreeMap::new();
    for o in sets {
        let place = order.iter().position(|name| *name == o.answer);
        *counts
            .entry((place.unwrap_or(usize::MAX), &o.answer))
            .or_default() += 1;
    }
    let among = sets.iter().filter(|o| o.class == Class::Among).count();
    let texts: Vec<_> = counts
        .into_iter()
        .map(|((_, answer), n)| match answer {
            EITHER => format!("{answer} {n}, with the truth among them {among}"),
            _ => format!("{answer} {n}"),
        })
        .collect();
    texts.join(", ")
}

/// The whole text: rates, answers, summary.
#[must_use]
pub fn text(all: &[Outcome]) -> String {
    let mut out = String::from("## Rates\n\n| what | figure | target | |\n|---|---|---|---|\n");
    let rates = rates(all);
    for rate in rates.iter().filter(|rate| rate.of > 0) {
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} |",
            rate.what,
            rate.text,
            rate.target,
            match rate.reached {
                Some(true) => "reached",
                Some(false) => "missed",
                None => "",
            }
        );
    }
    out += "\n## Answers\n\nThe truth is what is in the log. A number after a name is that of sets.\n\n";
    let mut table = |title: &str, of: &dyn Fn(&Outcome) -> bool| {
        let sets: Vec<_> = all.iter().filter(|o| of(o)).collect();
        out += &answers(title, &sets);
    };
    for strength in STRENGTHS {
        table(
            &format!("One effect, RMS {strength} times the noise's, open loop"),
            &|o| o.case.group == Group::Known && o.case.strength == strength,
        );
    }
    table("One effect, RMS as the noise's, closed loop", &|o| {
        o.case.group == Group::Closed
    });
    table("Two effects, each with the noise's RMS", &|o| {
        o.case.group == Group::Two
    });
    table("Three effects, each with the noise's RMS", &|o| {
        o.case.group == Group::Three
    });
    table("One effect with the noise's RMS in unusual logs", &|o| {
        o.case.group == Group::Unusual
    });
    table(
        "Effects of which the catalogue has the pure form, RMS as the noise's",
        &|o| o.case.group == Group::Impure,
    );
    table("No effect; half of the logs closed loop", &|o| {
        o.case.group == Group::Empty
    });
    table(
        "Effects in no catalogue, RMS 0.3, once and three times the noise's",
        &|o| o.case.group == Group::Uncatalogued,
    );
    let judged: Vec<bool> = rates.iter().filter_map(|rate| rate.reached).collect();
    let _ = writeln!(
        out,
        "{} sets: {} of {} targets reached, {} missed.",
        all.len(),
        judged.iter().filter(|r| **r).count(),
        judged.len(),
        judged.iter().filter(|r| !**r).count()
    );
    out
}

/// Every outcome and every rate as JSON.
#[must_use]
pub fn json(all: &[Outcome]) -> String {
    let sets: Vec<serde_json::Value> = all
        .iter()
        .map(|o| {
            serde_json::json!({
                "group": format!("{:?}", o.case.group).to_lowercase(),
                "truth": o.case.truth(),
                "strength": o.case.strength,
                "closed_loop": o.case.closed_loop,
                "seed": o.case.seed,
                "class": format!("{:?}", o.class).to_lowercase(),
                "verdict": o.verdict,
                "named": o.named,
                "others": o.others,
                "structure": o.structure,
                "estimates": o.estimates.iter().map(|e| serde_json::json!({
                    "name": e.name, "truth": e.truth, "found": e.found,
                })).collect::<Vec<_>>(),
                "heldout_rmse": o.rmse,
                "oracle_rmse": o.oracle,
                "rows": o.rows,
                "seconds": o.seconds,
            })
        })
        .collect();
    let rates: Vec<serde_json::Value> = rates(all)
        .iter()
        .filter(|rate| rate.of > 0)
        .map(|rate| {
            serde_json::json!({
                "what": rate.what, "value": rate.value, "of": rate.of,
                "target": rate.target, "reached": rate.reached,
            })
        })
        .collect();
    format!(
        "{:#}\n",
        serde_json::json!({ "rates": rates, "sets": sets })
    )
}
