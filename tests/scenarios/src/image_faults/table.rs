//! The summary of cases as text: a row for each place, and every hazard.

use super::{Outcome, Place};
use control::Fault;
use std::fmt::Write;

/// The table.
#[must_use]
pub fn summary(outcomes: &[Outcome]) -> String {
    let mut text = String::from(
        "| bit of | cases | fault | reset | silent, at 0 V | harmless | hazard despite a fault | hazard undetected |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n",
    );
    for place in Place::ALL {
        let of = outcomes.iter().filter(|o| o.flip.place == place);
        line(&mut text, place.name(), &of.collect::<Vec<_>>());
    }
    line(&mut text, "all", &outcomes.iter().collect::<Vec<_>>());
    text
}

fn line(text: &mut String, name: &str, of: &[&Outcome]) {
    let count = |which: fn(&Outcome) -> bool| of.iter().filter(|o| which(o)).count();
    let _ = writeln!(
        text,
        "| {name} | {} | {} | {} | {} | {} | {} | {} |",
        of.len(),
        count(|o| o.fault != 0 && !o.reset),
        count(|o| o.reset),
        count(|o| o.silent && o.off && o.fault == 0 && !o.reset),
        count(Outcome::is_harmless),
        count(|o| o.is_noticed() && !o.hazards.is_empty()),
        count(|o| !o.is_noticed() && !o.hazards.is_empty()),
    );
}

/// One case in words.
#[must_use]
pub fn words(outcome: &Outcome) -> String {
    let fault = Fault::from_code(outcome.fault).map_or("no fault", Fault::name);
    let mut text = format!(
        "case {}: {}, {}: {fault}",
        outcome.number,
        outcome.flip.place.name(),
        outcome.flip.what
    );
    if let Some(ms) = outcome.detected_ms {
        let _ = write!(text, " after {ms} ms");
    }
    for (yes, what) in [(outcome.reset, ", reset"), (outcome.silent, ", silent")] {
        if yes {
            text.push_str(what);
        }
    }
    let _ = write!(text, "; largest tension {:.1} N", outcome.tension_n);
    if !outcome.hazards.is_empty() {
        let _ = write!(text, "; HAZARD {:?}", outcome.hazards);
    }
    text
}
