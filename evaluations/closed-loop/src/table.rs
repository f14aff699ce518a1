//! The table of results, a row for each seed, and the kinds of effect by result.

use crate::effect::{rms, Effect, Kind, Truth};
use crate::run::{Findings, NoFindings};
use std::fmt::Write as _;

/// Head of the table.
pub const HEAD: &str = "\
| seed | undeclared | named | true | found | worst cable, N | tip, N | without it, N | board |
|---|---|---|---|---|---|---|---|---|
";

/// What an effect did to the worst cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cost {
    /// Less than a tenth over the same rig without it.
    None,
    /// At least half of the cost is gone.
    WonBack,
    /// Less than half of the cost is gone.
    Left,
}

/// What the effect cost the worst cable; `None` without a control run.
pub fn cost(findings: &Findings) -> Option<Cost> {
    let (without, _) = findings.without?;
    let Some(before) = findings.worst.0 else {
        // Without the correction the force is not held at all, and with the settings that the run
        // names it may already be held as without the effect.
        let after = findings.told.as_ref().and(findings.worst.1);
        return Some(
            if findings.better || after.is_some_and(|n| n < 1.1 * without) {
                Cost::WonBack
            } else {
                Cost::Left
            },
        );
    };
    let cost = before - without;
    let won = findings.worst.1.map_or(0.0, |after| before - after);
    Some(if cost < 0.1 * without {
        Cost::None
    } else if findings.better && won >= 0.5 * cost {
        Cost::WonBack
    } else {
        Cost::Left
    })
}

/// A row of the table, and whether the effect was named in most units and the force held better
/// after.
pub fn row(seed: u64, truth: &Truth, findings: &Result<Findings, NoFindings>) -> (String, bool) {
    let findings = match findings {
        Ok(findings) => findings,
        Err(NoFindings::Stopped) => {
            let words = truth.words();
            let text =
                format!("| {seed} | {words} | - | - | - | - | - | - | stopped by fault 45 |\n");
            return (text, false);
        }
        Err(NoFindings::Failed(why)) => {
            return (
                format!(
                    "| {seed} | {} | failed: {why} | | | | | | |\n",
                    truth.words()
                ),
                false,
            );
        }
    };
    let units = findings.units;
    let is_true = |name: &str| truth.effects.iter().any(|e| e.names.contains(&name));
    let others: Vec<String> = findings
        .named
        .iter()
        .filter(|(name, count)| !is_true(name) && **count * 3 >= units)
        .map(|(name, count)| format!("{name} {count}/{units}"))
        .collect();
    // Units that have the effects.
    let having = truth.only.map_or(units, |_| 1);
    let mut named: Vec<String> = (truth.effects.iter().enumerate())
        .map(|(k, effect)| named_as(effect, k, findings, having))
        .collect();
    if named.is_empty() {
        named.push("-".to_owned());
    }
    if !others.is_empty() {
        named.push(format!("beside it {}", others.join(", ")));
    }
    let named = named.join("; ");
    let (true_value, found) = if truth.effects.is_empty() {
        ("-".to_owned(), "-".to_owned())
    } else {
        let values = (truth.effects.iter()).map(|e| {
            let change = |n| format!(", changing by {n:+.3}");
            format!(
                "{:.3} {}{}",
                e.value,
                e.unit,
                e.change_n.map_or(String::new(), change)
            )
        });
        let found = (truth.effects.iter().zip(&findings.found)).map(|(e, found)| match e.kind {
            Kind::Scatter => format!("{:.3}", rms(found, units)),
            Kind::Changing => {
                let (hits, change) = (findings.changes.len(), median_and_range(&findings.changes));
                format!(
                    "{}, changing by {change} in {hits}/{units}",
                    median_and_range(found)
                )
            }
            _ => median_and_range(found),
        });
        (
            values.collect::<Vec<_>>().join("; "),
            found.collect::<Vec<_>>().join("; "),
        )
    };
    let pair = |(before, after): (Option<f64>, Option<f64>)| {
        let stopped = || findings.stopped.unwrap_or("-").to_owned();
        let before = before.map_or_else(stopped, |before| format!("{before:.3}"));
        after.map_or(before.clone(), |after| format!("{before} -> {after:.3}"))
    };
    let broken_off = findings.broken_off.as_ref();
    let board = match (findings.changed, findings.better) {
        (0, _) => "nothing to use".to_owned(),
        (_, true) => "better".to_owned(),
        (_, false) => broken_off.map_or("no better, left as it was".to_owned(), |why| {
            format!("broken off by {why}, left as it was")
        }),
    };
    let surveyed = findings.surveyed.map_or(String::new(), |(worst, tip)| {
        format!("; after `calibrate geometry` {worst:.3}, {tip:.3}")
    });
    let told = findings
        .told
        .as_ref()
        .map_or(String::new(), |(told, before)| {
            let before = before.map_or("-".to_owned(), |before| format!("{before:.3}"));
            format!("with {told}, which the run names behind fault 15, {before}; ")
        });
    let text = format!(
        "| {seed} | {} | {named} | {true_value} | {found} | {} | {} | {} | {told}{board}{surveyed} |\n",
        truth.words(),
        pair(findings.worst),
        pair(findings.tip),
        findings
            .without
            .map_or("-".to_owned(), |(worst, tip)| format!(
                "{worst:.3}, {tip:.3}"
            ))
    );
    let all_named = findings.found.iter().all(|f| 2 * f.len() > having);
    let gained = findings.better && all_named && !truth.effects.is_empty();
    (text, gained)
}

/// By which names an effect was found, in how many of the units that have it, and in how many that
/// don't.
fn named_as(effect: &Effect, k: usize, findings: &Findings, having: usize) -> String {
    let hits = findings.found[k].len();
    let seen: Vec<&str> = (effect.names.iter().copied())
        .filter(|name| findings.named.contains_key(*name))
        .collect();
    let mut text = match hits {
        0 => format!("{} missed", effect.names[0]),
        _ => format!("{} {hits}/{having}", seen.join(" or ")),
    };
    if findings.elsewhere[k] > 0 {
        let _ = write!(text, ", in {} without it", findings.elsewhere[k]);
    }
    text
}

/// Median and range of sorted numbers.
fn median_and_range(found: &[f64]) -> String {
    match found {
        [] => "-".to_owned(),
        [first, .., last] => format!("{:.3} ({first:.3} to {last:.3})", found[found.len() / 2]),
        [one] => format!("{one:.3}"),
    }
}

/// Kinds of effect by result.
#[derive(Default)]
pub struct Kinds {
    /// Named in most units, and the force was held better after.
    pub better: Vec<Kind>,
    /// Of those: cost something, half of it won back.
    pub back: Vec<Kind>,
    /// Cost something, and most of it is still there.
    pub left: Vec<Kind>,
    /// Cost nothing.
    pub harmless: Vec<Kind>,
    /// The board gave up units.
    pub stopped: Vec<Kind>,
    /// The command ended without a result.
    pub failed: Vec<Kind>,
}

impl Kinds {
    /// Adds a seed's result.
    pub fn add(&mut self, kind: Kind, gained: bool, cost: Option<Cost>, end: Option<&NoFindings>) {
        let lists = [
            (&mut self.better, gained),
            (&mut self.back, gained && cost == Some(Cost::WonBack)),
            (&mut self.left, cost == Some(Cost::Left)),
            (&mut self.harmless, cost == Some(Cost::None)),
            (&mut self.stopped, matches!(end, Some(NoFindings::Stopped))),
            (&mut self.failed, matches!(end, Some(NoFindings::Failed(_)))),
        ];
        for (list, belongs) in lists {
            if belongs && !list.contains(&kind) {
                list.push(kind);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{kind_of, truth, Effects};
    use crate::run::read;
    use serde_json::json;

    #[test]
    fn a_report_is_held_against_the_truth() {
        let seed = (1..20).find(|s| kind_of(*s) == Kind::Gain).unwrap();
        let truth = truth(seed, 1.0, Effects::All);
        let unit = |name: &str, error: f64| json!({"effects": [{"name": name, "params": {"gain_error": error}}]});
        let report = json!({
            "units": [unit("gain", -0.2), unit("gain", -0.3), unit("tone", 0.0)],
            "changed": ["x"],
            "better": true,
            "before": {"worst_tension_rms_n": 0.2, "tip_rms_n": 0.1},
            "after": {"worst_tension_rms_n": 0.1, "tip_rms_n": 0.05},
        });
        let mut findings = read(&truth, &report).unwrap();
        assert_eq!(cost(&findings), None);
        findings.without = Some((0.11, 0.05));
        assert_eq!(cost(&findings), Some(Cost::WonBack));
        // It cost nothing, or little of it came back, or the board was left as it was.
        findings.without = Some((0.19, 0.05));
        assert_eq!(cost(&findings), Some(Cost::None));
        findings.without = Some((0.05, 0.05));
        findings.worst.1 = Some(0.15);
        assert_eq!(cost(&findings), Some(Cost::Left));
        findings.worst.1 = Some(0.1);
        assert_eq!(cost(&findings), Some(Cost::WonBack));
        // A fault ended the run before.
        let with_figure = findings.worst.0.take();
        assert_eq!(cost(&findings), Some(Cost::WonBack));
        findings.worst.0 = with_figure;
        findings.better = false;
        assert_eq!(cost(&findings), Some(Cost::Left));
        let mut broken_off = report.clone();
        broken_off["better"] = json!(false);
        broken_off["left"] =
            json!("the comparison was broken off: fault 15, 0 V has no effect. A motor");
        let (text, gained) = row(seed, &truth, &Ok(read(&truth, &broken_off).unwrap()));
        assert!(
            !gained && text.contains("broken off by fault 15, left"),
            "{text}"
        );
        findings.better = true;
        let (text, gained) = row(seed, &truth, &Ok(findings));
        assert!(gained);
        assert!(text.contains("gain 2/3; beside it tone 1/3"), "{text}");
        assert!(text.contains("-20.000 (-30.000 to -20.000)"), "{text}");
        assert!(text.contains("0.200 -> 0.100"), "{text}");
        let mut stopped = report.clone();
        stopped["before"] = json!(null);
        assert!(read(&truth, &stopped).is_err());
        stopped["before_fault"] = json!("fault 45 of unit 1");
        let findings = read(&truth, &stopped).unwrap();
        let (text, gained) = row(seed, &truth, &Ok(findings));
        assert!(gained && text.contains("fault 45 -> 0.100"), "{text}");
        // Settings that a run names may carry it by themselves.
        let mut told = read(&truth, &stopped).unwrap();
        told.better = false;
        told.without = Some((0.095, 0.05));
        assert_eq!(cost(&told), Some(Cost::Left));
        told.told = Some(("`coulomb_n = 1.35`".to_owned(), told.worst.1));
        assert_eq!(cost(&told), Some(Cost::WonBack));
        let (text, gained) = row(seed, &truth, &Ok(told));
        assert!(
            !gained && text.contains("| with `coulomb_n = 1.35`, which"),
            "{text}"
        );
        let (text, gained) = row(seed, &truth, &Err(NoFindings::Stopped));
        assert!(!gained && text.contains("stopped by fault 45"), "{text}");
        let (text, gained) = row(seed, &truth, &Err("no rig".to_owned().into()));
        assert!(!gained && text.contains("no rig"));
        assert!(read(&truth, &json!({"units": []})).is_err());
    }

    #[test]
    fn further_kinds_are_compared_by_what_they_are() {
        let unit = |n: f64, change: f64| {
            json!({
                "effects": [{"name": "coulomb", "params": {"friction": -n}}],
                "friction_change": {"change_n": change, "interval_n": [change - 0.1, change + 0.1]},
            })
        };
        let report = json!({
            "units": [unit(0.3, -0.2), unit(0.4, -0.3), unit(0.5, 0.05)],
            "changed": ["x"],
            "better": false,
            "before": {"worst_tension_rms_n": 0.2, "tip_rms_n": 0.1},
        });
        let text = |kind: Kind| {
            let of = |seed: &u64| truth(*seed, 1.0, Effects::More).kinds() == [kind];
            let truth = truth((1..5).find(of).unwrap(), 1.0, Effects::More);
            let mut findings = read(&truth, &report).unwrap();
            findings.surveyed = (kind == Kind::CellTilt).then_some((0.03, 0.06));
            row(1, &truth, &Ok(findings)).0
        };
        let changing = text(Kind::Changing);
        let due = "| 0.400 (0.300 to 0.500), changing by -0.200 (-0.300 to -0.200) in 2/3 |";
        assert!(changing.contains(due), "{changing}");
        assert!(
            changing.contains(" N in session 2, changing by "),
            "{changing}"
        );
        let scatter = text(Kind::Scatter);
        assert!(scatter.contains("| 0.408 |"), "{scatter}");
        let tilt = text(Kind::CellTilt);
        assert!(
            tilt.contains("; after `calibrate geometry` 0.030, 0.060 |"),
            "{tilt}"
        );
    }
}
