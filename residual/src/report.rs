//! What an analysis found, and its written forms: `report.json`, `report.md`, `report.html` and the
//! extended model file.

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
pub struct Rival {
    /// Its name.
    pub name: String,
    /// Held-out RMSE with it instead.
    pub heldout_rmse: f64,
    /// How much larger that is than the final RMSE, as a fraction.
    pub behind: f64,
}

/// One effect found.
#[derive(Debug, Clone, Serialize)]
pub struct Effect {
    /// Name in the catalogue.
    pub name: String,
    /// In which form it shows.
    pub form: String,
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
pub struct Ambiguity {
    /// Their names; the one in `effects` first.
    pub effects: Vec<String>,
    /// The experiment that would tell them apart.
    pub experiment: String,
}

/// Structure without a name.
#[derive(Debug, Clone, Serialize)]
pub struct Structure {
    /// Variables it depends on.
    pub depends_on: String,
    /// Relative fall of the held-out RMSE that a free curve in them reaches.
    pub gain: f64,
    /// Probability of that by chance.
    pub p: f64,
}

/// An effect that is there but does not matter.
#[derive(Debug, Clone, Serialize)]
pub struct NotMaterial {
    /// Name.
    pub name: String,
    /// Form.
    pub form: String,
    /// Relative fall of the held-out RMSE.
    pub gain: f64,
    /// Its nonlinear parameter.
    pub params: BTreeMap<String, f64>,
}

/// One line of the last scan of the catalogue.
#[derive(Debug, Clone, Serialize)]
pub struct Tested {
    /// Name.
    pub name: String,
    /// Form.
    pub form: String,
    /// Relative fall of the held-out RMSE on top of the final model.
    pub gain: f64,
    /// Probability of that by chance (decoys).
    pub p: f64,
    /// Mean fall of the squared error over blocks in standard errors.
    pub steadiness: f64,
    /// Its nonlinear parameter.
    pub params: BTreeMap<String, f64>,
}

/// Data of a plot: thinned points, binned means (x, before, after) and RMS of all rows.
#[derive(Debug, Clone, Default)]
pub struct Plot {
    /// What is on the x axis, with its unit.
    pub against: String,
    /// x values.
    pub x: Vec<f64>,
    /// Residual of the declared model.
    pub before: Vec<f64>,
    /// Residual of the final model.
    pub after: Vec<f64>,
    /// Means over at most 30 bins of about equal count.
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
        // Equal values stay in one bin.
        let mut means = Vec::new();
        let mut rest = order.as_slice();
        while !rest.is_empty() {
            let least = x.len().div_ceil(30).min(rest.len());
            let last = x[rest[least - 1]];
            let count = least + rest[least..].iter().take_while(|i| x[**i] == last).count();
            let (rows, tail) = rest.split_at(count);
            let mean = |v: &[f64]| rows.iter().map(|i| v[*i]).sum::<f64>() / rows.len() as f64;
            means.push([mean(x), mean(before), mean(after)]);
            rest = tail;
        }
        Plot {
            against: against.into(),
            x: pick(x),
            before: pick(before),
            after: pick(after),
            means,
            rms: [crate::stats::rms(before), crate::stats::rms(after)],
        }
    }

    /// The picture: before and after on one scale, and after once more on its own where it is
    /// much smaller. `unit` is the target's.
    pub fn svg(&self, unit: &str) -> String {
        svg::residuals(self, unit)
    }
}

/// Takes away the reports and plots of an earlier analysis, so that they are not taken for new ones
/// when this one fails. Model files stay: one of them may be the input. So does everything in a folder
/// without a `report.json` of ours: a `report.md` there is somebody else's.
///
/// # Errors
/// [`Error::Io`] if one cannot be taken away.
pub fn clear(dir: &Path) -> Result<(), Error> {
    let json = dir.join("report.json");
    let ours = std::fs::read_to_string(&json)
        .ok()
        .and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok())
        .is_some_and(|v| v.pointer("/baseline/heldout_rmse").is_some());
    let Ok(entries) = std::fs::read_dir(dir) else {
        return Ok(());
    };
    if !ours {
        return Ok(());
    }
    for path in entries.filter_map(|e| e.ok().map(|e| e.path())) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let plot = name == "structure.svg" || name.starts_with("effect-") && name.ends_with(".svg");
        if plot || ["report.md", "report.html"].contains(&name.as_ref()) {
            std::fs::remove_file(&path).map_err(|e| Error::io(&path, e))?;
        }
    }
    // Last: what could not be taken away can be next time.
    std::fs::remove_file(&json).map_err(|e| Error::io(&json, e))
}

/// Everything an analysis found.
#[derive(Debug, Clone, Serialize)]
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
    pub absent: Vec<String>,
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
    let digits = (3 - x.abs().log10().floor() as i32).clamp(0, 12) as usize;
    if x.abs() < 1e-6 || x.abs() >= 1e7 {
        format!("{x:.3e}")
    } else {
        format!("{x:.digits$}")
    }
}

impl Report {
    /// The verdict in one or two sentences.
    pub fn summary(&self) -> String {
        let u = &self.unit;
        let (b, f) = (num(self.baseline.heldout_rmse), num(self.last.heldout_rmse));
        let names = self
            .effects
            .iter()
            .map(|e| e.name.as_str())
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
                    .map(|a| a.effects.join(" or "))
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
                    format!(" ({names} only stand in for part of it)")
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
                Part::Picture(name, alt, _) => format!("![{alt}]({name})\n\n"),
            })
            .collect()
    }

    /// `report.html`, with the plots inside.
    pub fn html(&self) -> String {
        let esc = |s: &str| {
            s.replace('&', "&amp;")
                .replace('<', "&lt;")
                .replace('>', "&gt;")
        };
        let mut out = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}</title>\n<style>body{{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}}table{{border-collapse:collapse;margin:1em 0}}td,th{{border:1px solid #ccc;padding:.2em .6em;text-align:left}}svg{{max-width:100%;height:auto}}</style></head><body>\n",
            esc(&self.heading())
        );
        for part in self.sections() {
            match part {
                Part::Title(t) => {
                    let _ = writeln!(out, "<h1>{}</h1>", esc(&t));
                }
                Part::Heading(t) => {
                    let _ = writeln!(out, "<h2>{}</h2>", esc(&t));
                }
                Part::Text(t) => {
                    let _ = writeln!(
                        out,
                        "<p>{}</p>",
                        esc(&t).replace("**", "").replace('\n', "<br>")
                    );
                }
                Part::Table(head, rows) => {
                    out.push_str("<table><tr>");
                    for h in &head {
                        let _ = write!(out, "<th>{}</th>", esc(h));
                    }
                    out.push_str("</tr>\n");
                    for r in rows {
                        out.push_str("<tr>");
                        for c in &r {
                            let _ = write!(out, "<td>{}</td>", esc(c));
                        }
                        out.push_str("</tr>\n");
                    }
                    out.push_str("</table>\n");
                }
                Part::Picture(_, _, svg) => {
                    let _ = writeln!(out, "{svg}");
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
        let put = |name: &str, text: &str| {
            let path = dir.join(name);
            std::fs::write(&path, text).map_err(|e| Error::io(&path, e))
        };
        for part in self.sections() {
            if let Part::Picture(name, _, svg) = part {
                put(&name, &svg)?;
            }
        }
        put("MODEL.extended.toml", &self.model()?)?;
        put("MODEL.frozen.toml", &self.frozen()?)?;
        put("report.md", &self.markdown())?;
        put("report.html", &self.html())?;
        put("report.json", &self.json())
    }

    fn heading(&self) -> String {
        if self.title.is_empty() {
            "Residual analysis".into()
        } else {
            self.title.clone()
        }
    }

    fn sections(&self) -> Vec<Part> {
        let u = &self.unit;
        let percent = |x: f64| format!("{:.2} %", 100.0 * x);
        let row = |cells: &[&str]| cells.iter().map(|c| c.to_string()).collect::<Vec<String>>();
        let mut out = vec![
            Part::Title(self.heading()),
            Part::Text(format!("**{}**", self.summary())),
        ];
        out.push(Part::Text(format!(
            "{} rows in {} sequences from {} file(s); {} groups held out in {} folds.",
            self.rows,
            self.sequences,
            self.files.len(),
            self.groups,
            self.folds.len()
        )));
        out.push(Part::Heading("Error before and after".into()));
        let line = |name: &str, f: &Figures| {
            vec![
                name.to_string(),
                format!(
                    "{} ({} to {})",
                    num(f.heldout_rmse),
                    num(f.heldout_rmse_ci[0]),
                    num(f.heldout_rmse_ci[1])
                ),
                format!(
                    "{} ({} to {})",
                    num(f.heldout_mae),
                    num(f.heldout_mae_ci[0]),
                    num(f.heldout_mae_ci[1])
                ),
                num(f.insample_rmse),
            ]
        };
        out.push(Part::Table(
            vec![
                "model".into(),
                format!("held-out RMSE, {u}"),
                format!("held-out MAE, {u}"),
                format!("in-sample RMSE, {u}"),
            ],
            vec![
                line("declared", &self.baseline),
                line("with effects", &self.last),
            ],
        ));
        out.push(Part::Text(
            "Intervals are 95 %, by bootstrap over blocks of time.".into(),
        ));
        for (i, e) in self.effects.iter().enumerate() {
            out.push(Part::Heading(format!("Effect {}: {}", i + 1, e.name)));
            out.push(Part::Text(format!(
                "{}. Form: {}. Held-out RMSE {} -> {} {u}.",
                e.meaning,
                e.form,
                num(e.heldout_before),
                num(e.heldout_after)
            )));
            out.push(Part::Table(
                row(&["parameter", "value", "95 % interval", "unit"]),
                e.params
                    .iter()
                    .map(|(n, v)| {
                        let ci =
                            e.ci.get(n)
                                .map_or("-".into(), |c| format!("{} to {}", num(c[0]), num(c[1])));
                        vec![
                            n.clone(),
                            num(*v),
                            ci,
                            e.units.get(n).cloned().unwrap_or_default(),
                        ]
                    })
                    .collect(),
            ));
            out.push(Part::Text(format!("Terms: `{}`", e.terms.join("`, `"))));
            if let Some(r) = &e.rival {
                out.push(Part::Text(format!(
                    "Nearest rival: {} in its place gives {} {u}, {} more.",
                    r.name,
                    num(r.heldout_rmse),
                    percent(r.behind)
                )));
            }
            if !e.plot.x.is_empty() {
                out.push(Part::Picture(
                    format!("effect-{}-{}.svg", i + 1, e.name),
                    format!("residual against {}", e.plot.against),
                    e.plot.svg(u),
                ));
            }
        }
        for a in &self.not_identifiable {
            out.push(Part::Heading(format!(
                "Not told apart: {}",
                a.effects.join(", ")
            )));
            out.push(Part::Text(format!(
                "These explain the data equally well. Experiments that would part them. {}.",
                a.experiment
            )));
        }
        if !self.structure.is_empty() {
            out.push(Part::Heading("Structure that has no name".into()));
            out.push(Part::Text("A free curve in these variables still lowers the held-out error; no effect of the catalogue does as much.".into()));
            out.push(Part::Table(
                row(&["depends on", "fall of held-out RMSE", "chance"]),
                self.structure
                    .iter()
                    .map(|s| {
                        vec![
                            s.depends_on.clone(),
                            percent(s.gain),
                            format!("{:.1e}", s.p),
                        ]
                    })
                    .collect(),
            ));
            if let Some(p) = self.plot_unknown.as_ref().filter(|p| !p.x.is_empty()) {
                out.push(Part::Picture(
                    "structure.svg".into(),
                    format!("residual against {}", p.against),
                    p.svg(u),
                ));
            }
        }
        out.push(Part::Heading("Seen, not material".into()));
        if self.seen_not_material.is_empty() {
            out.push(Part::Text("Nothing else stands out from chance.".into()));
        } else {
            out.push(Part::Table(
                row(&["effect", "form", "fall of held-out RMSE"]),
                self.seen_not_material
                    .iter()
                    .map(|s| vec![s.name.clone(), s.form.clone(), percent(s.gain)])
                    .collect(),
            ));
        }
        out.push(Part::Heading(
            "Every effect on top of the final model".into(),
        ));
        out.push(Part::Table(
            row(&[
                "effect",
                "form",
                "fall of held-out RMSE",
                "chance",
                "steadiness",
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
                        t.name.clone(),
                        format!("{}{at}", t.form),
                        percent(t.gain),
                        format!("{:.1e}", t.p),
                        format!("{:.1}", t.steadiness),
                    ]
                })
                .collect(),
        ));
        if !self.absent.is_empty() {
            out.push(Part::Text(format!(
                "Not looked for, as the data lack the columns or their variation: {}.",
                self.absent.join(", ")
            )));
        }
        out.push(Part::Heading("Tests of the residual".into()));
        out.push(Part::Table(
            row(&["model", "against", "lag, rows", "correlation", "chance"]),
            self.residual_tests
                .iter()
                .map(|(w, t)| {
                    vec![
                        w.clone(),
                        t.against.clone(),
                        t.lag.to_string(),
                        format!("{:.3}", t.correlation),
                        format!("{:.1e}", t.p),
                    ]
                })
                .collect(),
        ));
        out.push(Part::Heading("Hygiene of the data".into()));
        out.push(Part::Table(
            row(&["check", "count", "first", "what"]),
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
        out
    }
}

enum Part {
    Title(String),
    Heading(String),
    Text(String),
    Table(Vec<String>, Vec<Vec<String>>),
    Picture(String, String, String),
}
