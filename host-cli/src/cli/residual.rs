//! `forcectl residual`: what a force model lacks, from logs, and what of it the board can use.

use super::exit::{self, Failure, Reply, Result};
use super::output::path_json;
use super::Context;
use clap::Args;
use identify::{Applied, BoardFile};
use residual::spec::Spec;
use residual::{Options, Report, Verdict};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The model file for recordings.
const RECORDING: &str = include_str!("../../models/recording.toml");
/// The table of a recording that it describes.
const SAMPLES: &str = "samples.parquet";

/// Below the help of the command.
pub const HELP: &str = "\
Without --out the verdict is printed and nothing is written.

--init on a recording of forcectl (its folder or its samples.parquet) writes the model file for recordings, which has no
open questions.

--apply changes friction, gain, offset, viscous friction (speed in m/s or mm/s) and, for a delay, the gains of the loop,
where they were found, in all units. It prints what it changed and what the board cannot use. Ripples need the board's
own angle; `forcectl identify` finds them. Nothing is changed where unnamed structure is left that would take more than
a tenth of what the findings took off the error. Read the changes before you arm.

`found` are effects whose names the data support; `A or B` are effects that the data cannot distinguish. `approximates`
stands there under the verdict `unknown`: such an effect describes part of a structure that the catalogue does not contain, so
do not use its name or its values. `holds` stands there for an effect beside which that structure is small. `improves` are effects that lower the error of these data under a name that the data do
not support; the line says why. --check gives logs that were never searched. Fit on A, freeze, run on B: analyse A, then
give MODEL.frozen.toml of that report as the model of B with selection.max_effects = 0.

Exit codes:
  0  the logs were analysed, whatever the verdict
  2  the arguments or the model file are wrong
  3  a log or the rig file cannot be read
  4  the logs do not allow an analysis: too few rows, one group, constant excitation, terms that repeat each other
  6  the logs were analysed, but the board can use nothing of the findings (--apply wrote no rig file)
  7  a report, a rig file or the standard output could not be written
130  Ctrl-C, SIGTERM or SIGHUP ended the command";

/// Arguments of `residual`.
#[derive(Debug, Args)]
pub struct Residual {
    /// Logs (CSV, gzip, Parquet) or folders of them
    #[arg(long, value_name = "PATH", num_args = 1.., required = true)]
    data: Vec<PathBuf>,
    /// Model file (TOML): columns, units, declared terms
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Look at the logs and write a first model file to --model, with guessed columns and open
    /// questions; analyse nothing
    #[arg(long, conflicts_with_all = ["out", "apply", "check"])]
    init: bool,
    /// Logs that take no part in the search: the models, frozen, are evaluated on them, and what
    /// was found must help there too
    #[arg(long, value_name = "PATH", num_args = 1..)]
    check: Vec<PathBuf>,
    /// Folder for the reports and the extended model; not that of an earlier report whose model
    /// --model names
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a copy of this rig file, with the findings that the board can use, to DIR as
    /// NAME.residual.toml
    #[arg(long, value_name = "RIG.toml", requires = "out")]
    apply: Option<PathBuf>,
    /// With --apply: the model declares the values of the rig file; add the findings to them
    #[arg(long, requires = "apply")]
    increment: bool,
}

/// Stages and the share of a scan done, on standard error; nothing where the answer is for programs
/// (`--json`).
pub(super) struct Stages(Option<residual::Console>);

impl Stages {
    /// Says nothing where `quiet`.
    pub(super) fn new(quiet: bool) -> Self {
        Self((!quiet).then(residual::Console::default))
    }
}

impl residual::Progress for Stages {
    fn stage(&mut self, text: &str) {
        if let Some(console) = &mut self.0 {
            console.stage(text);
        }
    }

    fn ticker(&mut self) -> Option<residual::Ticker> {
        self.0.as_mut().and_then(residual::Progress::ticker)
    }
}

impl Residual {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        if self.init {
            return init(self);
        }
        analyse(self, context)
    }
}

/// Writes a first model file for the logs.
fn init(arguments: &Residual) -> Result<Reply> {
    check_data("--data", &arguments.data)?;
    let path = &arguments.model;
    if path.exists() {
        return Err(Failure::usage(format!(
            "--init: {} exists; give --model the name of a new file",
            path.display()
        )));
    }
    if let Some(samples) = samples_of_recordings(&arguments.data) {
        std::fs::write(path, RECORDING).map_err(|error| Failure::file(path, &error))?;
        let data: Vec<_> = samples.iter().map(|path| path_json(path)).collect();
        let json = serde_json::json!({"model": path_json(path), "data": data});
        let samples: Vec<String> = samples.iter().map(|p| p.display().to_string()).collect();
        let answer = format!(
            "{} written, for recordings of forcectl; analyse them with --data {} --model {}\n",
            path.display(),
            samples.join(" "),
            path.display()
        );
        return Ok(Reply::new(answer, json));
    }
    let text = residual::load::guess(&arguments.data)
        .map_err(|error| Failure::new(error.exit_code(), error))?;
    std::fs::write(path, &text).map_err(|error| Failure::file(path, &error))?;
    let tried = tried(&text, &arguments.data);
    let (json, said) = match &tried {
        Ok(rows) => (
            serde_json::json!({"model": path_json(path), "rows": rows}),
            format!("tried on the data: {rows} rows are read with it"),
        ),
        Err(why) => (
            serde_json::json!({"model": path_json(path), "fails": why}),
            format!("tried on the data: it does not run yet: {why}"),
        ),
    };
    let answer = format!(
        "{} written; answer its questions (lines with `# ?`), then run the command without --init\n{said}\n",
        path.display()
    );
    Ok(Reply::new(answer, json))
}

/// Loads the data once with a new model file: the rows that are fitted, or what fails.
fn tried(model: &str, data: &[PathBuf]) -> std::result::Result<usize, String> {
    let model = Spec::parse(model).map_err(|error| error.to_string())?;
    let data = residual::load::load(data, &model).map_err(|error| error.to_string())?;
    Ok(data.kept_rows().len())
}

/// The tables of samples, where all data are recordings of forcectl: folders of recordings or the
/// tables themselves.
fn samples_of_recordings(data: &[PathBuf]) -> Option<Vec<PathBuf>> {
    let table = |path: &PathBuf| {
        let table = if path.is_dir() {
            path.join(SAMPLES)
        } else {
            path.clone()
        };
        let named = table.file_name().is_some_and(|name| name == SAMPLES);
        (named && table.is_file()).then_some(table)
    };
    data.iter().map(table).collect()
}

/// Runs the analysis, and writes a rig file with its findings on request.
fn analyse(arguments: &Residual, context: &Context) -> Result<Reply> {
    check_out(arguments)?;
    // Reports of an earlier analysis must not be taken for this one's, whatever fails from here on.
    if let Some(out) = &arguments.out {
        residual::clear(out).map_err(|error| Failure::new(7, error))?;
    }
    // Everything that may be wrong with the arguments comes before the analysis, which takes
    // longer.
    let model = Spec::load(&arguments.model).map_err(Failure::usage)?;
    let rig = (arguments.apply.as_ref())
        .map(|path| BoardFile::open(path, &model, arguments.increment))
        .transpose()?;
    check_data("--data", &arguments.data)?;
    check_data("--check", &arguments.check)?;
    let options = Options {
        data: arguments.data.clone(),
        model,
        out: None,
    };
    let mut stages = Stages::new(!context.output.shows_progress());
    let report = residual::run_checked(&options, &arguments.check, &mut stages)
        .map_err(|error| Failure::new(error.exit_code(), error))?;
    // From here on Ctrl-C must not leave half a report.
    let _controlled_stop = context.interrupt.controlled_stop();
    let mut applied = None;
    if let Some(out) = &arguments.out {
        report.write(out).map_err(|error| Failure::new(7, error))?;
        if let Some(rig) = &rig {
            applied = Some(rig.apply(&report, out)?);
        }
    }
    let changed = applied.as_ref().map(
        |a| serde_json::json!({"file": a.file, "changed": a.changed, "not_used": a.not_used, "earlier": a.earlier}),
    );
    let mut text = String::new();
    row!(text, "{}", report.summary());
    effects(&report, &mut text);
    if let Some(out) = &arguments.out {
        row!(text, "report: {}", out.join("report.html").display());
    }
    if let Some(applied) = &applied {
        describe(applied, &mut text);
    }
    let code = match &applied {
        Some(applied) if applied.file.is_none() => exit::DEGRADED,
        _ => exit::DONE,
    };
    let report = serde_json::to_value(&report).map_err(|error| Failure::new(7, error))?;
    let json = serde_json::json!({"report": report, "applied": changed});
    Ok(Reply::new(text, json).with_code(code))
}

/// Refuses a folder in which the models of the report would replace a file that is read.
fn check_out(arguments: &Residual) -> Result<()> {
    let Some(out) = &arguments.out else {
        return Ok(());
    };
    let files = [Some(&arguments.model), arguments.apply.as_ref()];
    let inputs: Vec<&Path> = (files.into_iter().flatten())
        .map(PathBuf::as_path)
        .collect();
    for name in residual::MODELS {
        files::check_output(&out.join(name), &inputs)?;
    }
    Ok(())
}

/// A line for each effect, under the name that the written report gives it.
fn effects(report: &Report, text: &mut String) {
    for effect in &report.effects {
        let label = match report.verdict {
            Verdict::Unknown if report.holds(effect) => "holds",
            Verdict::Unknown => "approximates",
            _ => "found",
        };
        row!(
            text,
            "  {label:<12} {} ({}): held-out RMSE {} without it",
            report.alternatives(effect),
            report.details(effect),
            residual::num(effect.heldout_without)
        );
    }
    for effect in &report.improves {
        row!(
            text,
            "  {:<12} {} ({}): {}",
            "improves",
            effect.name,
            report.details(effect),
            effect.unsupported
        );
    }
}

/// Checks that every file and folder of an option exists.
fn check_data(option: &str, paths: &[PathBuf]) -> Result<()> {
    match paths.iter().find(|path| !path.exists()) {
        None => Ok(()),
        Some(path) => Err(Failure::new(
            3,
            format!(
                "{option} {}: this file or folder does not exist; check the path",
                path.display()
            ),
        )),
    }
}

/// What became of the findings, in lines.
fn describe(applied: &Applied, text: &mut String) {
    match &applied.file {
        Some(file) => row!(text, "rig file: {}", file.display()),
        None => row!(
            text,
            "no rig file written: the board can use nothing of this"
        ),
    }
    if let Some(earlier) = &applied.earlier {
        row!(text, "  {} is of an earlier run", earlier.display());
    }
    for line in &applied.changed {
        row!(text, "  changed   {line}");
    }
    for line in &applied.not_used {
        row!(text, "  not used  {line}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Friction in a log, as the analysis reports it.
    fn analysed() -> Report {
        let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
             roles.target = { column = \"y\", unit = \"N\" }\n\
             roles.velocity = { column = \"v\", unit = \"m/s\" }\n\
             [selection]\nonly = [\"coulomb\"]\n\
             [[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
        let rows =
            |f: &dyn Fn(f64) -> f64| (0..600).map(|i| f(0.02 * f64::from(i % 150))).collect();
        let velocity = |t: f64| (2.6 * t).cos();
        let target = |t: f64| 0.01 * (1e4 * t).sin() - 0.4 * velocity(t).signum();
        let data = residual::Data::from_columns(
            rows(&|t| t),
            [("velocity", rows(&velocity)), ("target", rows(&target))],
        )
        .sequences((0..4).map(|run| 150 * run..150 * (run + 1)))
        .build()
        .expect("the columns fit");
        let model = Spec::parse(model).expect("a good model");
        residual::analyse(&model, data, &mut ()).expect("is analysed")
    }

    #[test]
    fn effects_are_called_what_the_report_calls_them() {
        let lines = |report: &Report| {
            let mut text = String::new();
            effects(report, &mut text);
            text
        };
        let mut report = analysed();
        let said = lines(&report);
        assert!(said.starts_with("  found        coulomb ("), "{said}");
        // Two of one kind are told apart.
        let mut two = report.clone();
        two.effects.push(two.effects[0].clone());
        two.effects
            .iter_mut()
            .zip([7.0, 14.0])
            .for_each(|(e, order)| {
                e.params.insert("order".to_owned(), order);
            });
        let said = lines(&two);
        for order in ["order 7.000)", "order 14.00)"] {
            assert!(said.contains(order), "{said}");
        }
        let both = vec![residual::EffectKind::Coulomb, residual::EffectKind::Viscous];
        report.not_identifiable = vec![residual::Ambiguity::new(both, "other speeds")];
        let said = lines(&report);
        assert!(said.contains("found        coulomb or viscous ("), "{said}");
        report.verdict = Verdict::Unknown;
        let said = lines(&report);
        assert!(
            said.starts_with("  approximates coulomb or viscous ("),
            "{said}"
        );
        assert!(!said.contains("found"), "{said}");
        assert!(report
            .markdown()
            .contains("Approximating effect 1: coulomb or viscous"));
    }
}
