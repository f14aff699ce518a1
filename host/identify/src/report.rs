//! The report of a trial, for people and for programs.

use super::file::{self, FileError};
use super::{DoubtedCell, Figures, FrictionChange, Trial, UnitFinding};
use run::plot;
use serde_json::{json, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use wire::UNITS;

impl Trial {
    /// The report in JSON.
    #[must_use]
    pub fn record(&self, rig_name: &str) -> Value {
        let applied = self.applied.as_ref();
        json!({
            "rig": self.before.link,
            "firmware": self.before.firmware,
            "rig_file": rig_name,
            "units": self.findings.units.iter().map(unit).collect::<Vec<_>>(),
            "excitation_swing": self.swing,
            "changed": self.findings.rewritten.changed,
            "before": self.figures.0,
            "before_fault": self.stopped,
            "after": self.figures.1,
            "pairs": self.pairs,
            "gain": self.gain,
            "weighed": self.weighed,
            "better": match (&self.stopped, &self.gain) {
                (Some(_), _) => Some(self.left.is_none()),
                (None, gain) => gain.map(|gain| gain.is_better()),
            },
            "left": self.left.as_ref().map(ToString::to_string),
            "applied": applied.map(|(file, kept)| json!({"file": file, "kept": kept})),
        })
    }

    /// Writes the report, its JSON and a plot to a folder. A file that can't be written costs only
    /// itself. Returns what went wrong.
    #[must_use]
    pub fn write(&self, out: &Path, rig_name: &str) -> Vec<FileError> {
        let plot = self.after.as_ref().map(|after| {
            let svg = plot::compare(&self.before, after).to_svg();
            ("compare.svg", svg)
        });
        plot.into_iter()
            .chain([
                ("report.md", self.markdown(rig_name)),
                ("identify.json", format!("{:#}", self.record(rig_name))),
            ])
            .filter_map(|(name, text)| file::write(&out.join(name), &text).err())
            .collect()
    }

    /// The report in Markdown.
    #[must_use]
    pub fn markdown(&self, rig_name: &str) -> String {
        let mut lines = vec![
            format!("# What {rig_name} lacks\n"),
            format!("{}, firmware {}.\n", self.before.link, self.before.firmware),
        ];
        self.found(&mut lines);
        self.changed(&mut lines);
        self.before_and_after(&mut lines);
        if let Some(left) = &self.left {
            lines.push(format!("\nThe rig file is left as it is: {left}."));
        }
        if let Some((file, kept)) = &self.applied {
            lines.push(format!(
                "\nApplied to {}; the old one is {}.",
                file.display(),
                kept.display()
            ));
        }
        lines.join("\n") + "\n"
    }

    fn found(&self, lines: &mut Vec<String>) {
        let units = &self.findings.units;
        lines.push(
            "## Found\n\n\
             | unit | verdict | tension error of the model, N | found |\n\
             |---|---|---|---|"
                .to_owned(),
        );
        for UnitFinding { unit, report, .. } in units {
            let effects = report.effects.iter().map(|e| effect(report, e));
            let effects: Vec<String> = effects.collect();
            lines.push(format!(
                "| {unit} | {} | {:.3} -> {:.3} | {} |",
                report.verdict.word(),
                report.baseline.heldout_rmse,
                report.last.heldout_rmse,
                if effects.is_empty() {
                    "-".to_owned()
                } else {
                    effects.join("; ")
                }
            ));
        }
        lines.extend(over_units(units).map(|text| format!("\n{text}")));
        lines.extend(friction_changes(units).map(|text| format!("\n{text}")));
        let reports: Vec<String> = units
            .iter()
            .map(|u| format!("unit{}/report.md", u.unit))
            .collect();
        lines.push(format!(
            "\nEach unit's report with its plots, rivals and intervals is in its folder: {}.",
            reports.join(", ")
        ));
        if self.swing < 1.0 {
            lines.push(format!(
                "\nThe force at the tip came near `force_limit_n`, so the commands swung less from then on: {:.0} % at the end.",
                100.0 * self.swing
            ));
        }
    }

    fn changed(&self, lines: &mut Vec<String>) {
        if let Some(weighed) = &self.weighed {
            let cell = |cell: &DoubtedCell| format!("{} ({})", cell.unit, cell.effects.join(", "));
            let named = weighed.cells.iter().filter(|cell| !cell.effects.is_empty());
            let named: Vec<String> = named.map(cell).collect();
            let units = weighed.cells.iter().map(|cell| cell.unit.to_string());
            let units: Vec<String> = units.collect();
            lines.push(format!(
                "\n## Measured with weights\n\n\
                 The first analysis named an effect of the load cell in unit {}. The cells of unit {} were measured with weights, \
                 and what pays is taken out by the board; *Found* is what the rig lacks with that. The calibration is kept as \
                 version {}; `forcectl calibrate use` puts an older one in force.",
                named.join(", "),
                units.join(", "),
                weighed.gains["version"].as_str().unwrap_or("-"),
            ));
        }
        lines.push("\n## Changed in the rig file\n".to_owned());
        let changed = &self.findings.rewritten.changed;
        lines.extend(changed.iter().map(|change| format!("- {change}")));
        if changed.is_empty() {
            lines.push("Nothing.".to_owned());
        }
        for u in &self.findings.units {
            let not_used = u.not_used.iter();
            lines.extend(not_used.map(|why| format!("- unit {}, not used: {why}", u.unit)));
        }
    }

    fn before_and_after(&self, lines: &mut Vec<String>) {
        let (before, after) = self.figures;
        let source = if before.or(after).is_some_and(|f| f.from_truth) {
            "by the plant's truth"
        } else {
            "by the load cells"
        };
        lines.push(format!(
            "\n## Before and after\n\n\
             RMS errors while the force is held, N, {source}.\n\n\
             | | before | after |\n\
             |---|---|---|"
        ));
        let mut row = |name: &str, value: &dyn Fn(&Figures) -> f64| {
            let cell = |figures: Option<Figures>| {
                figures.map_or("-".to_owned(), |f| format!("{:.4}", value(&f)))
            };
            lines.push(format!("| {name} | {} | {} |", cell(before), cell(after)));
        };
        for i in 0..UNITS {
            row(&format!("tension of cable {}", i + 1), &|f| {
                f.tension_rms_n[i]
            });
        }
        row("worst cable", &|f| f.worst_tension_rms_n);
        row("force at the tip", &|f| f.tip_rms_n);
        if let Some(why) = &self.stopped {
            lines.push(format!(
                "\nWithout the findings the force was not held to the end: {why}."
            ));
        }
        if let Some(gain) = &self.gain {
            lines.push(format!(
                "\nReduction of the worst cable's error: {gain}. The table has the means of these runs."
            ));
        }
        if after.is_some() {
            lines.push("\n![Errors before and after](compare.svg)".to_owned());
        }
    }
}

/// Which effects most units have, and which only some; `None`: none of them has any.
pub(super) fn over_units(units: &[UnitFinding]) -> Option<String> {
    use residual::EffectKind::{Coulomb, LoadDependentCoulomb};
    let mut having: BTreeMap<String, BTreeSet<u8>> = BTreeMap::new();
    for u in units {
        for e in &u.report.effects {
            let name = match e.name {
                // Two forms of one friction.
                Coulomb | LoadDependentCoulomb => format!("{Coulomb} or {LoadDependentCoulomb}"),
                other => other.to_string(),
            };
            having.entry(name).or_default().insert(u.unit);
        }
    }
    let (most, few): (Vec<_>, Vec<_>) =
        (having.into_iter()).partition(|(_, of)| 2 * of.len() > units.len());
    let mut text = Vec::new();
    if !most.is_empty() {
        let names = most
            .iter()
            .map(|(name, of)| format!("{name} ({})", of.len()));
        let names: Vec<String> = names.collect();
        text.push(format!(
            "In most of the {} units: {}.",
            units.len(),
            names.join(", ")
        ));
    }
    if !few.is_empty() {
        let names = few.iter().map(|(name, of)| {
            let of: Vec<String> = of.iter().map(u8::to_string).collect();
            format!("{name} (unit {})", of.join(", "))
        });
        let names: Vec<String> = names.collect();
        text.push(format!(
            "Only in some: {}. That is these units' own, or a name for what one session does not tell apart: \
             see the rivals in their reports, and drive them once more before you act on it.",
            names.join(", ")
        ));
    }
    (!text.is_empty()).then(|| text.join(" "))
}

/// The units whose friction changed while they were recorded, in words; `None`: in none for sure.
pub(super) fn friction_changes(units: &[UnitFinding]) -> Option<String> {
    let of = units.iter().filter_map(|u| {
        let change = u.friction_change.filter(FrictionChange::counts)?;
        let [low, high] = change.interval_n;
        let n = change.change_n;
        Some(format!(
            "unit {} by {n:+.3} N (95 %: {low:+.3} to {high:+.3})",
            u.unit
        ))
    });
    let of: Vec<String> = of.collect();
    (!of.is_empty()).then(|| {
        format!(
            "Friction changed while session 2 ran: {}. What was found of it is a mean, and does not hold for a rig that goes on \
             changing: let the rig warm up, look for a reel that rubs or runs dry, and call the command again.",
            of.join(", ")
        )
    })
}

/// What was found of a unit, in JSON.
pub(super) fn unit(u: &UnitFinding) -> Value {
    json!({
        "unit": u.unit,
        "verdict": u.report.verdict,
        "heldout_rmse_before": u.report.baseline.heldout_rmse,
        "heldout_rmse_after": u.report.last.heldout_rmse,
        "effects": u.report.effects,
        "not_identifiable": u.report.not_identifiable,
        "equal_paths": u.report.equal_paths,
        "paths_not_judged": u.report.paths_not_judged,
        "structure": u.report.structure,
        "not_used": u.not_used,
        "friction_change": u.friction_change,
    })
}

/// An effect with its numbers, in a line, under all names that may stand for it.
pub(super) fn effect(report: &residual::Report, e: &residual::Effect) -> String {
    let numbers: Vec<String> = e
        .params
        .iter()
        .map(|(name, value)| {
            let unit = e.units.get(name).map_or("", String::as_str);
            let unit = if unit == "1" { "" } else { unit };
            format!("{} {value:.4} {unit}", name.replace('_', " "))
                .trim_end()
                .to_owned()
        })
        .collect();
    format!("{} ({})", report.alternatives(e), numbers.join(", "))
}
