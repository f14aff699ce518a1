//! What an analysis found, and its written forms: `report.json`, `report.md`, `report.html` and the
//! extended model file.

use crate::effects::{EffectKind, Form};
use crate::error::Error;
use crate::hygiene::Finding;
use crate::spec::Spec;
use crate::stats::ResidualTest;
use crate::svg;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// The answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Verdict {
    /// One effect of the catalogue explains what the model lacks.
    Effect,
    /// Several effects do together.
    Several,
    /// Nothing material is missing.
    None,
    /// Structure remains that no effect of the catalogue explains.
    Unknown,
    /// Effects that these data cannot tell apart explain it equally well.
    NotIdentifiable,
}

impl Verdict {
    /// The word in `report.json`.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Effect => "effect",
            Verdict::Several => "several",
            Verdict::None => "none",
            Verdict::Unknown => "unknown",
            Verdict::NotIdentifiable => "not_identifiable",
        }
    }
}

/// Errors of a model, in the target's unit; intervals are 95 %, block bootstrap.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Figures {
    /// Root mean square error on held-out groups.
    pub heldout_rmse: f64,
    /// Its interval.
    pub heldout_rmse_ci: [f64; 2],
    /// Mean absolute error on held-out groups.
    pub heldout_mae: f64,
    /// Its interval.
    pub heldout_mae_ci: [f64; 2],
    /// Root mean square error on the rows it was fitted to.
    pub insample_rmse: f64,
}

/// The best other effect in the place of a named one.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Rival {
    /// Its name.
    pub name: EffectKind,
    /// Held-out RMSE with it instead.
    pub heldout_rmse: f64,
    /// How much larger that is than the final RMSE, as a fraction.
    pub behind: f64,
}

/// One effect found.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Effect {
    /// Name in the catalogue.
    pub name: EffectKind,
    /// In which form it shows, for readers.
    pub form: String,
    /// The form, where code must know it.
    pub form_kind: Form,
    /// What it is.
    pub meaning: String,
    /// Expressions added (`column -> expression` for replacements).
    pub terms: Vec<String>,
    /// Parameters by name.
    pub params: BTreeMap<String, f64>,
    /// Their units.
    pub units: BTreeMap<String, String>,
    /// Their 95 % intervals.
    pub ci: BTreeMap<String, [f64; 2]>,
    /// Held-out RMSE before it was added (effects in the order of this list).
    pub heldout_before: f64,
    /// Held-out RMSE after.
    pub heldout_after: f64,
    /// Nearest rival.
    pub rival: Option<Rival>,
    /// Residual against the variable that exposes the effect.
    #[serde(skip)]
    pub plot: Plot,
}

/// Effects that these data cannot tell apart.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Ambiguity {
    /// Their names; the one in `effects` first.
    pub effects: Vec<EffectKind>,
    /// The experiment that would tell them apart.
    pub experiment: String,
}

impl Ambiguity {
    /// Effects that cannot be told apart, and the experiment that would tell them apart.
    pub fn new(effects: Vec<EffectKind>, experiment: impl Into<String>) -> Ambiguity {
        Ambiguity {
            effects,
            experiment: experiment.into(),
        }
    }
}

/// Structure without a name.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Structure {
    /// Variables it depends on.
    pub depends_on: String,
    /// Relative fall of the held-out RMSE that a free curve in them reaches.
    pub gain: f64,
    /// Probability of that by chance.
    pub p: f64,
}

impl Structure {
    /// Structure that depends on variables, with the relative fall of the held-out RMSE that a free
    /// curve in them reaches and its p value.
    pub fn new(depends_on: impl Into<String>, gain: f64, p: f64) -> Structure {
        Structure {
            depends_on: depends_on.into(),
            gain,
            p,
        }
    }
}

/// An effect that is there but does not matter.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct NotMaterial {
    /// Name.
    pub name: EffectKind,
    /// Form.
    pub form: String,
    /// Relative fall of the held-out RMSE.
    pub gain: f64,
    /// Its nonlinear parameter.
    pub params: BTreeMap<String, f64>,
}

/// One line of the last scan of the catalogue.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Tested {
    /// Name.
    pub name: EffectKind,
    /// Form.
    pub form: String,
    /// Relative fall of the held-out RMSE on top of the final model.
    pub gain: f64,
    /// Probability of that by chance (decoys).
    pub p: f64,
    /// Mean fall of the squared error over blocks in standard errors.
    pub t_statistic: f64,
    /// Its nonlinear parameter.
    pub params: BTreeMap<String, f64>,
}

/// Data of a plot: thinned points, binned means (x, before, after) and RMS of all rows.
#[derive(Debug, Clone, Default)]
pub struct Plot {
    /// What is on the x axis, with its unit.
    pub against: String,
    /// What is on the y axis, without its unit.
    pub value: String,
    /// What the two panels show: before and after.
    pub names: [String; 2],
    /// x values.
    pub x: Vec<f64>,
    /// Residual of the model to compare with: the declared one, or the final one without an effect.
    pub before: Vec<f64>,
    /// Residual of the final model.
    pub after: Vec<f64>,
    /// Means over about 30 bins of about equal count, or of one value each.
    pub means: Vec<[f64; 3]>,
    /// RMS of all rows, before and after.
    pub rms: [f64; 2],
}

impl Plot {
    /// Points of the residual before and after against `x`, about a thousand of them, and the means
    /// of all rows. Empty if `x` is.
    pub fn new(against: &str, x: &[f64], before: &[f64], after: &[f64]) -> Plot {
        if x.is_empty() || before.len() != x.len() || after.len() != x.len() {
            return Plot::default();
        }
        let stride = x.len().div_ceil(1000);
        let pick = |v: &[f64]| v.iter().step_by(stride).copied().collect::<Vec<f64>>();
        let mut order: Vec<usize> = (0..x.len()).collect();
        order.sort_by(|a, b| x[*a].total_cmp(&x[*b]));
        // Equal values stay in one bin; many of them are a bin of their own.
        let mut means = Vec::new();
        let mut rest = order.as_slice();
        while !rest.is_empty() {
            let least = x.len().div_ceil(30).min(rest.len());
            let last = x[rest[least - 1]];
            let (from, to) = (
                rest.partition_point(|i| x[*i] < last),
                rest.partition_point(|i| x[*i] <= last),
            );
            let count = if to >= from + least && 8 * from >= least {
                from
            } else {
                to.max(least)
            };
            let (rows, tail) = rest.split_at(count);
            let mean = |v: &[f64]| rows.iter().map(|i| v[*i]).sum::<f64>() / rows.len() as f64;
            means.push([mean(x), mean(before), mean(after)]);
            rest = tail;
        }
        Plot {
            against: against.into(),
            value: "residual".into(),
            names: ["before".into(), "after".into()],
            x: pick(x),
            before: pick(before),
            after: pick(after),
            means,
            rms: [crate::stats::rms(before), crate::stats::rms(after)],
        }
    }

    /// The same with other names of its y axis and panels.
    #[must_use]
    pub fn named(mut self, value: &str, before: &str, after: &str) -> Plot {
        self.value = value.into();
        self.names = [before.into(), after.into()];
        self
    }

    /// The picture: before and after on one scale, and after once more on its own where it is
    /// much smaller. `unit` is the target's.
    pub fn svg(&self, unit: &str) -> String {
        svg::residuals(self, unit)
    }
}

/// Name of the panel of a model that lacks one effect of the final one.
pub(crate) const WITHOUT: &str = "without it";

/// Files of a report that hold its text.
const TEXTS: [&str; 3] = ["report.md", "report.html", "report.json"];

/// Makes sure that an analysis may write its reports to a folder, without making it, and takes away the
/// reports and plots of an earlier one, so that they are not taken for new ones when this one fails.
/// Model files stay: one of them may be the input. So does everything in a folder without a
/// `report.json` of ours.
///
/// # Errors
/// [`Error::Io`] if the folder is none or cannot be written to, if it holds a report that no analysis
/// wrote, or if an earlier report cannot be taken away.
pub fn clear(dir: &Path) -> Result<(), Error> {
    writable(dir)?;
    let Ok(entries) = std::fs::read_dir(dir) else {
        return Ok(());
    };
    let json = dir.join("report.json");
    let ours = std::fs::read_to_string(&json)
        .ok()
        .and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok())
        .is_some_and(|v| v.pointer("/baseline/heldout_rmse").is_some());
    if !ours {
        return match TEXTS.iter().map(|n| dir.join(n)).find(|p| p.exists()) {
            None => Ok(()),
            Some(foreign) => Err(Error::io(
                &foreign,
                "no analysis wrote this file, and a report would overwrite it: choose another folder for the reports, or move it away",
            )),
        };
    }
    for path in entries.filter_map(|e| e.ok().map(|e| e.path())) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let plot = name == "structure.svg" || name.starts_with("effect-") && name.ends_with(".svg");
        if plot || TEXTS.contains(&name.as_ref()) && path != json {
            std::fs::remove_file(&path).map_err(|e| Error::io(&path, e))?;
        }
    }
    // Last: what could not be taken away can be next time.
    std::fs::remove_file(&json).map_err(|e| Error::io(&json, e))
}

/// Whether a folder can be written to, or be made: known before an analysis rather than after it.
fn writable(dir: &Path) -> Result<(), Error> {
    let no = |path: &Path, why: String| {
        Err(Error::io(
            path,
            format!("{why}; reports need a folder that can be written to"),
        ))
    };
    // The folder, or the nearest above it that is there.
    for at in dir.ancestors() {
        let at = if at.as_os_str().is_empty() {
            Path::new(".")
        } else {
            at
        };
        match std::fs::metadata(at) {
            Ok(m) if !m.is_dir() => return no(at, "this is a file".into()),
            Ok(_) => {
                let probe = at.join(format!(".residual-{}", std::process::id()));
                return match std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe))
                {
                    Ok(()) => Ok(()),
                    Err(e) => no(at, format!("cannot be written to ({e})")),
                };
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            // Something above it is a file: the loop comes to it.
            Err(e) if e.kind() == std::io::ErrorKind::NotADirectory => {}
            Err(e) => return no(at, e.to_string()),
        }
    }
    Ok(())
}

/// Everything an analysis found.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Report {
    /// Title from the model file.
    pub title: String,
    /// Unit of the target.
    pub unit: String,
    /// Names of the files read.
    pub files: Vec<String>,
    /// Rows fitted.
    pub rows: usize,
    /// Sequences.
    pub sequences: usize,
    /// Groups for hold-out.
    pub groups: usize,
    /// Groups in each fold.
    pub folds: Vec<String>,
    /// Errors of the declared model.
    pub baseline: Figures,
    /// Errors of the final model.
    #[serde(rename = "final")]
    pub last: Figures,
    /// RMSE on folds that took no part in the selection, if `selection.nested` asks for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nested_rmse: Option<f64>,
    /// The answer.
    pub verdict: Verdict,
    /// Effects found, strongest first.
    pub effects: Vec<Effect>,
    /// Effects that these data cannot tell apart.
    pub not_identifiable: Vec<Ambiguity>,
    /// Structure that is left without a name.
    pub structure: Vec<Structure>,
    /// Effects that are there but do not matter.
    pub seen_not_material: Vec<NotMaterial>,
    /// The last scan of the catalogue, on top of the final model.
    pub tested: Vec<Tested>,
    /// Effects that were not looked for, as the data lack their columns.
    pub absent: Vec<EffectKind>,
    /// Flaws of the data.
    pub hygiene: Vec<Finding>,
    /// Whiteness and cross-correlation tests of the residual, `before` and `after`.
    pub residual_tests: Vec<(String, ResidualTest)>,
    /// The model file with the effects added.
    #[serde(skip)]
    pub extended: Spec,
    /// Declared terms: name, coefficient, unit, whether it was declared fixed.
    pub declared: Vec<(String, f64, String, bool)>,
    /// Residual against the variable of the largest structure left.
    #[serde(skip)]
    pub plot_unknown: Option<Plot>,
}

/// A number with four significant digits.
pub fn num(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    // Rounded first, as 0.009999999 is 0.01000.
    let exponent = exponent(x, 3);
    if !(-6..7).contains(&exponent) {
        format!("{x:.3e}")
    } else {
        format!("{x:.*}", (3 - exponent).max(0) as usize)
    }
}

/// Exponent of a number rounded to `decimals` places of its mantissa.
fn exponent(x: f64, decimals: usize) -> i32 {
    format!("{x:.decimals$e}")
        .rsplit_once('e')
        .and_then(|(_, e)| e.parse().ok())
        .unwrap_or(0)
}

/// A value and the ends of its interval, to two digits of half its width: more say nothing.
fn with_interval(x: f64, [lo, hi]: [f64; 2]) -> (String, String) {
    let half = 0.5 * (hi - lo);
    let reach = [x, lo, hi].into_iter().map(f64::abs).fold(0.0, f64::max);
    if !(half > 0.0 && half.is_finite() && reach.is_finite()) {
        return (num(x), format!("{} to {}", num(lo), num(hi)));
    }
    let last = exponent(half, 1) - 1;
    let show = |x: f64| {
        let text = if (1e-3..1e6).contains(&reach) {
            format!("{x:.*}", (-last).max(0) as usize)
        } else {
            let places = (exponent(reach, 3) - last).max(1);
            let shift = exponent(reach, 3) - exponent(x, 3);
            format!("{x:.*e}", (places - shift).max(0) as usize)
        };
        positive_zero(text)
    };
    (show(x), format!("{} to {}", show(lo), show(hi)))
}

/// `-0.00` without its sign.
fn positive_zero(text: String) -> String {
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.into(),
        _ => text,
    }
}

/// A share in per cent.
fn percent(x: f64) -> String {
    let decimals = if x.abs() < 0.1 { 2 } else { 1 };
    format!("{} %", positive_zero(format!("{:.decimals$}", 100.0 * x)))
}

/// A p value. Far out in the tail only the order of size means anything, and below 1e-12 not even that.
fn p_value(p: f64) -> String {
    if p.is_nan() {
        "-".into()
    } else if p < 1e-12 {
        "< 1e-12".into()
    } else if p < 1e-3 {
        format!("{p:.0e}")
    } else if p < 0.1 {
        format!("{p:.3}")
    } else {
        format!("{p:.2}")
    }
}

/// An expression with its numbers to at most five digits, for reading.
fn readable(expression: &str) -> String {
    let mut out = String::new();
    let mut rest = expression;
    while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
        let (head, tail) = rest.split_at(at);
        let part_of_name = head
            .chars()
            .next_back()
            .is_some_and(|c| c.is_alphanumeric() || c == '_');
        let mut end = tail
            .find(|c: char| !(c.is_ascii_digit() || c == '.'))
            .unwrap_or(tail.len());
        if !part_of_name && tail[end..].starts_with(['e', 'E']) {
            let exponent = tail[end + 1..].trim_start_matches(['+', '-']);
            let digits = exponent
                .find(|c: char| !c.is_ascii_digit())
                .unwrap_or(exponent.len());
            if digits > 0 {
                end = tail.len() - exponent.len() + digits;
            }
        }
        let number = &tail[..end];
        out.push_str(head);
        match number.parse::<f64>() {
            Ok(x) if !part_of_name && x != 0.0 => {
                let short: f64 = format!("{x:.4e}").parse().unwrap_or(x);
                out.push_str(&format!("{short}"));
            }
            _ => out.push_str(number),
        }
        rest = &tail[end..];
    }
    out + rest
}

/// Some of the names, and how many more there are.
fn some(names: &[String], most: usize) -> String {
    let mut text = names
        .iter()
        .take(most)
        .map(String::as_str)
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > most {
        let _ = write!(text, " and {} more", names.len() - most);
    }
    text
}

impl Report {
    /// The verdict in one or two sentences.
    pub fn summary(&self) -> String {
        let u = &self.unit;
        let (b, f) = (num(self.baseline.heldout_rmse), num(self.last.heldout_rmse));
        let names = self
            .effects
            .iter()
            .map(|e| e.name.to_string())
            .collect::<Vec<_>>()
            .join(", ");
        match self.verdict {
            Verdict::None => format!("Nothing material is missing: held-out RMSE {b} {u}."),
            Verdict::Effect => format!("The model lacks {names}: held-out RMSE {b} -> {f} {u}."),
            Verdict::Several => format!("The model lacks {names}: held-out RMSE {b} -> {f} {u}."),
            Verdict::NotIdentifiable => {
                let who = self
                    .not_identifiable
                    .first()
                    .map(|a| joined(&a.effects, " or "))
                    .unwrap_or_default();
                format!("The model lacks {who}; these data cannot tell which: held-out RMSE {b} -> {f} {u}.")
            }
            Verdict::Unknown => {
                let on = self
                    .structure
                    .first()
                    .map_or(String::new(), |s| s.depends_on.clone());
                let part = if names.is_empty() {
                    String::new()
                } else {
                    let stand = if self.effects.len() > 1 {
                        "stand"
                    } else {
                        "stands"
                    };
                    format!(" ({names} only {stand} in for part of it)")
                };
                format!("Structure is left that no effect of the catalogue explains: {on}{part}. Held-out RMSE {b} -> {f} {u}.")
            }
        }
    }

    /// `report.json`.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"))
    }

    /// `report.md`.
    pub fn markdown(&self) -> String {
        self.sections()
            .into_iter()
            .map(|s| match s {
                Part::Title(t) => format!("# {t}\n\n"),
                Part::Verdict(t) => format!("{t}\n\n"),
                Part::Heading(t) => format!("## {t}\n\n"),
                Part::Text(t) => format!("{t}\n\n"),
                Part::Table(head, rows) => {
                    let line = |cells: &[String]| {
                        format!(
                            "| {} |\n",
                            cells
                                .iter()
                                .map(|c| c.replace('|', "\\|"))
                                .collect::<Vec<_>>()
                                .join(" | ")
                        )
                    };
                    let mut t = line(&head);
                    let _ = writeln!(t, "|{}", "---|".repeat(head.len()));
                    rows.iter().for_each(|r| t.push_str(&line(r)));
                    t + "\n"
                }
                Part::Picture(name, plot) => {
                    format!("![residual]({name})\n\n{}\n\n", caption(&plot))
                }
            })
            .collect()
    }

    /// `report.html`, with the plots inside.
    pub fn html(&self) -> String {
        let mut out = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{}</title>\n<style>{STYLE}</style></head><body>\n",
            escape(&self.heading())
        );
        for part in self.sections() {
            match part {
                Part::Title(t) => {
                    let _ = writeln!(out, "<h1>{}</h1>", escape(&t));
                }
                Part::Verdict(t) => {
                    let word = self.verdict.word();
                    let _ = writeln!(out, "<p class=\"verdict {word}\">{}</p>", inline(&t));
                }
                Part::Heading(t) => {
                    let _ = writeln!(out, "<h2>{}</h2>", escape(&t));
                }
                Part::Text(t) => {
                    let _ = writeln!(out, "<p>{}</p>", inline(&t));
                }
                Part::Table(head, rows) => {
                    out.push_str("<div class=\"wide\"><table><thead><tr>");
                    for h in &head {
                        let _ = write!(out, "<th>{}</th>", inline(h));
                    }
                    out.push_str("</tr></thead>\n");
                    for r in rows {
                        out.push_str("<tr>");
                        for c in &r {
                            let _ = write!(out, "<td>{}</td>", inline(c));
                        }
                        out.push_str("</tr>\n");
                    }
                    out.push_str("</table></div>\n");
                }
                Part::Picture(_, plot) => {
                    let _ = writeln!(
                        out,
                        "<figure><div class=\"panels\">{}</div><figcaption>{} <span style=\"color:{}\">&#9679;</span> {}, <span style=\"color:{}\">&#9473;</span> {}.</figcaption></figure>",
                        svg::separate(&plot, &self.unit).concat(),
                        inline(&caption(&plot)),
                        svg::POINTS,
                        svg::POINTS_ARE,
                        svg::MEANS,
                        svg::MEANS_ARE
                    );
                }
            }
        }
        out + "</body></html>\n"
    }

    /// The extended model file: running it again on the same data reproduces the final fit.
    ///
    /// # Errors
    /// [`Error::Model`] if it cannot be written as TOML.
    pub fn model(&self) -> Result<String, Error> {
        toml::to_string(&self.extended).map_err(|e| Error::model(e.to_string()))
    }

    /// The extended model with every coefficient fixed at its fitted value: run on other data, its
    /// baseline is a test on rows that were never fitted. Terms with a coefficient for each
    /// sequence mean nothing elsewhere and are left out.
    ///
    /// # Errors
    /// [`Error::Model`] if it cannot be written as TOML.
    pub fn frozen(&self) -> Result<String, Error> {
        let mut spec = self.extended.clone();
        spec.terms.retain(|t| t.per.is_empty());
        for t in &mut spec.terms {
            t.fixed = t.fixed.or(t.fitted);
            t.fitted = None;
        }
        toml::to_string(&spec).map_err(|e| Error::model(e.to_string()))
    }

    /// Writes `report.json` (last, so where it is the others are), `report.md` with its plots, `report.html`, `MODEL.extended.toml` and
    /// `MODEL.frozen.toml`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, dir: &Path) -> Result<(), Error> {
        std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, e))?;
        let mut files: Vec<(String, String)> = self
            .sections()
            .into_iter()
            .filter_map(|part| match part {
                Part::Picture(name, plot) => Some((name, plot.svg(&self.unit))),
                _ => None,
            })
            .collect();
        files.push(("MODEL.extended.toml".into(), self.model()?));
        files.push(("MODEL.frozen.toml".into(), self.frozen()?));
        files.push(("report.md".into(), self.markdown()));
        files.push(("report.html".into(), self.html()));
        files.push(("report.json".into(), self.json()));
        for (i, (name, text)) in files.iter().enumerate() {
            let path = dir.join(name);
            if let Err(e) = std::fs::write(&path, text) {
                // A part of a report is none.
                for (name, _) in &files[..=i] {
                    let _ = std::fs::remove_file(dir.join(name));
                }
                return Err(Error::io(&path, e));
            }
        }
        Ok(())
    }

    fn heading(&self) -> String {
        if self.title.is_empty() {
            "Residual analysis".into()
        } else {
            self.title.clone()
        }
    }

    /// What is on an axis, in words and with its unit, from the expression that was evaluated for it.
    fn axis(&self, expression: &str) -> String {
        let (name, unit) = self.quantity(expression);
        if unit.is_empty() {
            name
        } else {
            format!("{name}, {unit}")
        }
    }

    /// Name and unit of an expression of the kind that effects are plotted against; any other is its own
    /// name.
    fn quantity(&self, expression: &str) -> (String, String) {
        let e = expression.trim();
        let inside = |function: &str| {
            e.strip_prefix(function)?
                .strip_prefix('(')?
                .strip_suffix(')')
                .filter(|inner| {
                    // The bracket that closes is the one that the function opened.
                    let mut depth = 0i32;
                    inner.chars().all(|c| {
                        depth += i32::from(c == '(') - i32::from(c == ')');
                        depth >= 0
                    })
                })
                .map(|inner| inner.rsplit_once(", ").unwrap_or((inner, "")).0)
        };
        let unit = |name: &str| self.extended.roles.unit(name);
        if e == "load" {
            return ("load".into(), self.unit.clone());
        }
        if e == "elapsed" {
            return ("time since the start of the run".into(), "s".into());
        }
        if let Some(x) = inside("deriv") {
            return match self.quantity(x) {
                (name, u) if u.is_empty() => (format!("rate of change of {name}"), u),
                (name, u) => (format!("rate of change of {name}"), format!("{u}/s")),
            };
        }
        if let Some(x) = inside("integ") {
            let (name, u) = self.quantity(x);
            let u = u.strip_suffix("/s").map_or(format!("{u} s"), String::from);
            return (format!("time integral of {name}"), u);
        }
        if let Some(x) = inside("held") {
            return (
                format!("direction held of {}", self.quantity(x).0),
                String::new(),
            );
        }
        if let Some((a, b)) = product(e) {
            // An angle turned into radians.
            if b.parse::<f64>().is_ok() {
                return (self.quantity(a).0, "rad".into());
            }
            let ((a, u), (b, v)) = (self.quantity(a), self.quantity(b));
            let unit = match (u.as_str(), v.strip_suffix("/s")) {
                ("", _) => v,
                ("s", Some(v)) => v.into(),
                _ if v.is_empty() => u,
                _ => format!("{u} {v}"),
            };
            return (format!("{a} times {b}"), unit);
        }
        if e.starts_with("(held(") && e.contains(" - sgn(") {
            return ("direction held at rest".into(), String::new());
        }
        (e.to_string(), unit(e))
    }

    fn sections(&self) -> Vec<Part> {
        let u = &self.unit;
        let material = format!(
            "{} %",
            (1e4 * self.extended.selection.material).round() / 100.0
        );
        let row = |cells: &[&str]| cells.iter().map(|c| c.to_string()).collect::<Vec<String>>();
        let mut out = vec![
            Part::Title(self.heading()),
            Part::Verdict(format!(
                "**Verdict: `{}`.** {}",
                self.verdict.word(),
                self.summary()
            )),
        ];
        let folds = if self.folds == self.files {
            "each file".into()
        } else if self.folds.iter().map(|f| f.len() + 2).sum::<usize>() < 160 {
            self.folds.join(", ")
        } else {
            format!("{} groups in {} folds", self.groups, self.folds.len())
        };
        out.push(Part::Text(format!(
            "{} rows in {} sequences from {} file(s): {}. Held out in turn: {folds}.",
            self.rows,
            self.sequences,
            self.files.len(),
            some(&self.files, 4)
        )));
        out.push(Part::Text(
            match self.verdict {
                Verdict::None => format!(
                    "No effect that the data can show lowers the held-out RMSE by {} or more and stands out from chance.",
                    material
                ),
                Verdict::Unknown if !self.effects.is_empty() => "What is named below stands in for something that has no name here: neither its names nor its numbers are findings. Look at \"Structure that has no name\" first.".into(),
                Verdict::Unknown => "No effect of the catalogue is named. Look at \"Structure that has no name\".".into(),
                Verdict::NotIdentifiable => "The section \"Not told apart\" says which experiment would tell.".into(),
                Verdict::Effect | Verdict::Several => "Each effect held its place against every other of the catalogue (nearest rivals below); friction coefficients multiply the sign of the velocity, so friction against the motion is negative.".into(),
            },
        ));
        out.push(Part::Heading("Error before and after".into()));
        out.push(self.errors());
        out.push(Part::Text(self.held_out()));
        for (i, e) in self.effects.iter().enumerate() {
            let kind = if self.verdict == Verdict::Unknown {
                "Stand-in"
            } else {
                "Effect"
            };
            let others = self
                .not_identifiable
                .iter()
                .filter(|a| a.effects.first() == Some(&e.name))
                .flat_map(|a| &a.effects[1..])
                .map(|n| format!(" or {n}"))
                .collect::<String>();
            out.push(Part::Heading(format!(
                "{kind} {}: {}{others}",
                i + 1,
                e.name
            )));
            let mut meaning = e.meaning.clone();
            if let Some(first) = meaning.get_mut(0..1) {
                first.make_ascii_uppercase();
            }
            out.push(Part::Text(format!(
                "{meaning}. Form: {}. Held-out RMSE {} -> {} {u}.",
                e.form,
                num(e.heldout_before),
                num(e.heldout_after)
            )));
            out.push(Part::Table(
                row(&["parameter", "value", "95 % interval", "unit"]),
                e.params
                    .iter()
                    .map(|(n, v)| {
                        let (value, ci) =
                            e.ci.get(n)
                                .map_or((num(*v), "-".into()), |ci| with_interval(*v, *ci));
                        vec![
                            n.clone(),
                            value,
                            ci,
                            e.units.get(n).cloned().unwrap_or_default(),
                        ]
                    })
                    .collect(),
            ));
            let terms: Vec<String> = e.terms.iter().map(|t| readable(t)).collect();
            out.push(Part::Text(format!("Terms: `{}`", terms.join("`, `"))));
            if let Some(r) = &e.rival {
                let than = if r.behind < 0.0 {
                    format!("{} less: too little to take its place", percent(-r.behind))
                } else {
                    format!("{} more", percent(r.behind))
                };
                out.push(Part::Text(format!(
                    "Nearest rival: {} in its place gives {} {u}, {than}.",
                    r.name,
                    num(r.heldout_rmse)
                )));
            }
            if !e.plot.x.is_empty() {
                out.push(Part::Picture(
                    format!("effect-{}-{}.svg", i + 1, e.name),
                    self.plot(&e.plot),
                ));
            }
        }
        for a in &self.not_identifiable {
            out.push(Part::Heading(format!(
                "Not told apart: {}",
                joined(&a.effects, ", ")
            )));
            out.push(Part::Text(format!(
                "These explain the data equally well. What would part them: {}.",
                a.experiment
            )));
        }
        if !self.structure.is_empty() {
            out.push(Part::Heading("Structure that has no name".into()));
            out.push(Part::Text(format!(
                "A free curve in these variables still lowers the held-out error; no effect of the catalogue does as much.{}",
                if self.verdict == Verdict::Unknown {
                    ""
                } else {
                    " It is too little beside what was named to put that in doubt."
                }
            )));
            out.push(Part::Table(
                row(&["depends on", "fall of held-out RMSE", "p value"]),
                self.structure
                    .iter()
                    .map(|s| vec![s.depends_on.clone(), percent(s.gain), p_value(s.p)])
                    .collect(),
            ));
            if let Some(p) = self.plot_unknown.as_ref().filter(|p| !p.x.is_empty()) {
                out.push(Part::Picture("structure.svg".into(), self.plot(p)));
            }
        }
        out.push(Part::Heading("Seen, not material".into()));
        if self.seen_not_material.is_empty() {
            out.push(Part::Text("Nothing else stands out from chance.".into()));
        } else {
            out.push(Part::Text(format!(
                "There, but below the {} of the held-out RMSE from which an effect counts.",
                material
            )));
            out.push(Part::Table(
                row(&["effect", "form", "fall of held-out RMSE"]),
                self.seen_not_material
                    .iter()
                    .map(|s| vec![s.name.to_string(), s.form.clone(), percent(s.gain)])
                    .collect(),
            ));
        }
        out.push(Part::Heading("Declared terms".into()));
        out.push(Part::Text(
            "As declared and fitted before anything was added.".into(),
        ));
        out.push(Part::Table(
            row(&["term", "coefficient", "unit", ""]),
            self.declared
                .iter()
                .map(|(name, value, unit, fixed)| {
                    let how = if *fixed { "fixed" } else { "fitted" };
                    vec![name.clone(), num(*value), unit.clone(), how.into()]
                })
                .collect(),
        ));
        out.push(Part::Heading(
            "Every effect on top of the final model".into(),
        ));
        out.push(Part::Text(
            "p value: probability that the residual with random signs block by block gains as much. t statistic: mean fall of the squared error over blocks of time, in standard errors.".into(),
        ));
        out.push(Part::Table(
            row(&[
                "effect",
                "form",
                "fall of held-out RMSE",
                "p value",
                "t statistic",
            ]),
            self.tested
                .iter()
                .map(|t| {
                    let at = t
                        .params
                        .iter()
                        .map(|(n, v)| format!(", {n} {}", num(*v)))
                        .collect::<String>();
                    vec![
                        t.name.to_string(),
                        format!("{}{at}", t.form),
                        percent(t.gain),
                        p_value(t.p),
                        positive_zero(format!("{:.1}", t.t_statistic)),
                    ]
                })
                .collect(),
        ));
        if !self.absent.is_empty() {
            out.push(Part::Text(format!(
                "Not looked for, as the data lack the columns or their variation: {}.",
                joined(&self.absent, ", ")
            )));
        }
        out.push(Part::Heading("Tests of the residual".into()));
        out.push(Part::Text(
            "The largest correlation of the residual with itself and with each input, over lags; before: declared model, after: with the effects.".into(),
        ));
        out.push(Part::Table(
            row(&["model", "against", "lag, rows", "correlation", "p value"]),
            self.residual_tests
                .iter()
                .map(|(w, t)| {
                    vec![
                        w.clone(),
                        t.against.clone(),
                        t.lag.to_string(),
                        positive_zero(format!("{:.3}", t.correlation)),
                        p_value(t.p),
                    ]
                })
                .collect(),
        ));
        out.push(Part::Heading("Hygiene of the data".into()));
        out.push(Part::Table(
            row(&["check", "rows", "first", "what"]),
            self.hygiene
                .iter()
                .map(|f| {
                    vec![
                        f.check.clone(),
                        f.count.to_string(),
                        f.first.clone(),
                        f.what.clone(),
                    ]
                })
                .collect(),
        ));
        out.push(Part::Heading("Files beside this one".into()));
        out.push(Part::Text(
            "`MODEL.extended.toml` is the model file with what was found; on the same data it gives the final fit again. `MODEL.frozen.toml` has every coefficient fixed: run it on other data to test it on rows that were never fitted. `report.json` has everything in full precision.".into(),
        ));
        out
    }

    /// What the held-out figures are, and the nested one.
    fn held_out(&self) -> String {
        let nested = match self.nested_rmse {
            Some(rmse) => format!(
                " With the whole selection repeated without each fold, the RMSE on the folds left out is {} {}.",
                num(rmse),
                self.unit
            ),
            None => String::new(),
        };
        format!(
            "Held out: the coefficients that predict a group are fitted to the other folds. Effects are selected by this \
             same error, and nonlinear parameters are refined on all rows, so the error on new data may be somewhat \
             larger.{nested} Intervals are 95 %, by bootstrap over blocks of time."
        )
    }

    /// Errors of the declared model, after each effect in turn, and of the final model.
    fn errors(&self) -> Part {
        let u = &self.unit;
        let full = |name: String, f: &Figures| {
            let (rmse, rmse_ci) = with_interval(f.heldout_rmse, f.heldout_rmse_ci);
            let (mae, mae_ci) = with_interval(f.heldout_mae, f.heldout_mae_ci);
            vec![
                name,
                format!("{rmse} ({rmse_ci})"),
                format!("{mae} ({mae_ci})"),
                num(f.insample_rmse),
            ]
        };
        let mut rows = vec![full("declared".into(), &self.baseline)];
        for (i, e) in self.effects.iter().enumerate() {
            let name = format!("{} {}", if i == 0 { "with" } else { "and" }, e.name);
            rows.push(if i + 1 == self.effects.len() {
                full(name, &self.last)
            } else {
                vec![name, num(e.heldout_after), String::new(), String::new()]
            });
        }
        Part::Table(
            vec![
                "model".into(),
                format!("held-out RMSE, {u}"),
                format!("held-out MAE, {u}"),
                format!("in-sample RMSE, {u}"),
            ],
            rows,
        )
    }

    /// A plot with its axis in words.
    fn plot(&self, p: &Plot) -> Plot {
        Plot {
            // What the analysis evaluated and knows a unit of has it already.
            against: if p.against.contains(['(', '*']) || p.against == "elapsed" {
                self.axis(&p.against)
            } else {
                p.against.clone()
            },
            ..p.clone()
        }
    }
}

/// Names of effects in one text.
fn joined(effects: &[EffectKind], between: &str) -> String {
    let names: Vec<&str> = effects.iter().map(|k| k.as_str()).collect();
    names.join(between)
}

/// Two factors of a product at the top level of an expression, brackets around it aside.
fn product(e: &str) -> Option<(&str, &str)> {
    let split = |e: &str| {
        let mut depth = 0i32;
        e.char_indices()
            .find(|(_, c)| {
                depth += i32::from(*c == '(') - i32::from(*c == ')');
                depth == 0 && *c == '*'
            })
            .map(|(i, _)| i)
    };
    let bare = match split(e) {
        Some(_) => e,
        None => e.strip_prefix('(')?.strip_suffix(')')?,
    };
    let at = split(bare)?;
    Some((bare[..at].trim(), bare[at + 1..].trim()))
}

/// What a picture shows.
fn caption(p: &Plot) -> String {
    format!(
        "Residual of the fit to all rows (in-sample) against {}, {} and {}{}.",
        p.against,
        p.names[0],
        p.names[1],
        if p.names[0] == WITHOUT {
            ", the other effects in place"
        } else {
            ""
        }
    )
}

fn escape(s: &str) -> String {
    s.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// Text as HTML, with pairs of backticks as code and pairs of double asterisks as bold.
fn inline(text: &str) -> String {
    let pairs = |text: &str, mark: &str, tag: &str| {
        let parts: Vec<&str> = text.split(mark).collect();
        let mut out = String::new();
        for (i, part) in parts.iter().enumerate() {
            match i {
                0 => {}
                // A mark without a partner is itself.
                _ if i % 2 == 1 && i + 1 == parts.len() => out.push_str(mark),
                _ if i % 2 == 1 => out.push_str(&format!("<{tag}>")),
                _ => out.push_str(&format!("</{tag}>")),
            }
            out.push_str(part);
        }
        out
    };
    pairs(&pairs(&escape(text), "**", "strong"), "`", "code")
        .replace(" -&gt; ", "&nbsp;&rarr;&nbsp;")
        .replace('\n', "<br>")
}

/// Style of `report.html`: readable at 360 px, on a wide screen, and on paper.
const STYLE: &str = "\
body{font:16px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.7em;line-height:1.25}h2{font-size:1.25em;margin-top:2em;overflow-wrap:anywhere}\
p,figcaption{max-width:52em;overflow-wrap:anywhere}\
.verdict{font-size:1.1em;border-left:.4em solid #888;background:#f4f4f4;padding:.6em .9em}\
.effect,.several{border-color:#2a7d46}.none{border-color:#4878a8}\
.unknown{border-color:#c03020}.not_identifiable{border-color:#c08a10}\
.wide{overflow-x:auto;margin:1em 0}table{border-collapse:collapse}\
td,th{border:1px solid #ccc;padding:.2em .6em;min-width:4em;text-align:left;vertical-align:top}\
code{font-size:.92em;background:#f4f4f4}\
figure{margin:1em 0}.panels{display:flex;flex-wrap:wrap;gap:.4em}\
.panels svg{flex:1 1 300px;min-width:0;max-width:400px;height:auto}\
figcaption{font-size:.9em;color:#444}\
@media print{body{font-size:10pt;margin:0;max-width:none}h2,thead{break-after:avoid}\
figure,tr{break-inside:avoid}.wide{overflow:visible}.panels svg{max-width:48%}}";

enum Part {
    Title(String),
    Verdict(String),
    Heading(String),
    Text(String),
    Table(Vec<String>, Vec<Vec<String>>),
    /// File name, data.
    Picture(String, Plot),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        assert_eq!(num(0.009_999_999), "0.01000");
        assert_eq!(num(-1234.56), "-1235");
        assert_eq!(num(99_999.7), "100000");
        let texts = |x, ci| {
            let (value, interval) = with_interval(x, ci);
            format!("{value} ({interval})")
        };
        assert_eq!(
            texts(0.211_61, [0.204_7, 0.216_6]),
            "0.2116 (0.2047 to 0.2166)"
        );
        assert_eq!(texts(0.687, [0.6302, 0.7456]), "0.687 (0.630 to 0.746)");
        assert_eq!(texts(-153.4, [-170.0, 2.0]), "-153 (-170 to 2)");
        assert_eq!(
            texts(-2.703e-5, [-3.08e-5, -0.228e-5]),
            "-2.7e-5 (-3.1e-5 to -2e-6)"
        );
        assert_eq!(texts(0.5, [0.5, 0.5]), "0.5000 (0.5000 to 0.5000)");
        assert_eq!(percent(-1e-6), "0.00 %");
        assert_eq!(p_value(0.0), "< 1e-12");
        assert_eq!(p_value(1.04e-5), "1e-5");
        assert_eq!(p_value(0.29), "0.29");
    }

    #[test]
    fn expressions_are_shortened_in_their_numbers_alone() {
        assert_eq!(
            readable("command -> delay(q2, 0.0629091530243523) + 1.23456789e-7 * v_1.5"),
            "command -> delay(q2, 0.062909) + 0.00000012346 * v_1.5"
        );
        assert_eq!(
            readable("sgn(velocity, 5) * (2 == x)"),
            "sgn(velocity, 5) * (2 == x)"
        );
        assert_eq!(readable("1e"), "1e");
    }

    #[test]
    fn rows_at_one_value_do_not_swallow_the_others() {
        let x: Vec<f64> = (0..3000)
            .map(|i| if i % 50 == 0 { -1.0 } else { 0.0 })
            .chain((0..3000).map(f64::from))
            .collect();
        let y: Vec<f64> = x.iter().map(|x| 2.0 * x).collect();
        let means = Plot::new("x", &x, &y, &y).means;
        assert!(means.iter().any(|m| *m == [-1.0, -2.0, -2.0]), "{means:?}");
        assert!(means.len() > 10 && means.len() < 34, "{means:?}");
        let nan = [f64::NAN; 40];
        assert!(!Plot::new("x", &nan, &nan, &nan).means.is_empty());
    }

    #[test]
    fn text_becomes_html_without_losing_a_mark() {
        assert_eq!(
            inline("**a** `b < c` d ` e\n1 -> 2"),
            "<strong>a</strong> <code>b &lt; c</code> d ` e<br>1&nbsp;&rarr;&nbsp;2"
        );
    }
}
