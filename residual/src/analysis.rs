//! The analysis: from logs, or columns in memory, and a declared model to a report.

use crate::assembly::{self, Found};
use crate::nested::{self, nested};
use residual_columns::error::Error;
use residual_columns::progress::Progress;
use residual_evidence::attribution::{attribute, Attributed};
use residual_evidence::check::Checked;
use residual_evidence::feedback;
use residual_log::data::Data;
use residual_log::load;
use residual_log::spec::Spec;
use residual_report::Report;
use residual_search::declared::check_selection;
use residual_search::Search;
use std::path::PathBuf;

/// What to analyse.
#[derive(Debug, Clone)]
pub struct Options {
    /// Log files and folders.
    pub data: Vec<PathBuf>,
    /// The model.
    pub model: Spec,
    /// Where reports go; nothing is written if `None`.
    pub out: Option<PathBuf>,
}

/// Runs an analysis of files and writes its reports.
///
/// # Errors
/// Any [`Error`]; then nothing is written, and an earlier report in the folder is gone.
pub fn run(options: &Options, progress: &mut dyn Progress) -> Result<Report, Error> {
    run_checked(options, &[], progress)
}

/// As [`run`], with logs to check the models on: they take no part in the search, and an effect
/// that does not help on them is not called found. Without a path nothing is checked.
///
/// # Errors
/// As [`run`].
pub fn run_checked(
    options: &Options,
    check: &[PathBuf],
    progress: &mut dyn Progress,
) -> Result<Report, Error> {
    check_selection(&options.model)?;
    if let Some(out) = &options.out {
        residual_report::clear(out)?;
    }
    progress.stage("reading data");
    let data = load::load(&options.data, &options.model)?;
    let check = match check {
        [] => None,
        paths => Some(load::load_to_check(paths, &options.model)?),
    };
    let report = analyse_checked(&options.model, data, check.as_ref(), progress)?;
    if let Some(out) = &options.out {
        progress.stage("writing reports");
        report.write(out)?;
    }
    Ok(report)
}

/// Analyses data in memory.
///
/// ```
/// use residual::{analyse, spec::Spec, Data, EffectKind, Verdict};
///
/// let model = Spec::parse(
///     r#"
/// [roles]
/// time = { column = "t", unit = "s" }
/// target = { column = "force", unit = "N" }
/// command = { column = "command", unit = "N" }
/// velocity = { column = "speed", unit = "m/s" }
///
/// [selection]
/// only = ["coulomb", "viscous", "gain"]
///
/// [[terms]]
/// name = "force"
/// expr = "command"
/// fixed = 1.0
/// "#,
/// )?;
/// // Four runs of 100 rows: dry friction of 0.4 N against motion, 1 % of ripple in the command.
/// let at = |i: usize| (i % 100) as f64 * 0.02;
/// let of = |f: &dyn Fn(f64) -> f64| (0..400).map(|i| f(at(i) + 0.3 * (i / 100) as f64)).collect();
/// let command: Vec<f64> = of(&|t| 3.0 + (5.0 * t).sin());
/// let velocity: Vec<f64> = of(&|t| (2.6 * t).cos());
/// let target = command
///     .iter()
///     .zip(&velocity)
///     .enumerate()
///     .map(|(i, (c, v))| c - 0.4 * v.signum() + 0.01 * (1e4 * at(i)).sin())
///     .collect();
/// let data = Data::from_columns(
///     (0..400).map(at).collect(),
///     [("command", command), ("velocity", velocity), ("target", target)],
/// )
/// .sequences((0..4).map(|run| 100 * run..100 * (run + 1)))
/// .build()?;
///
/// let report = analyse(&model, data, &mut ())?;
/// assert_eq!(report.verdict, Verdict::Effect);
/// assert_eq!(report.effects[0].name, EffectKind::Coulomb);
/// assert!((report.effects[0].params["friction"] + 0.4).abs() < 0.01);
///
/// // What a board can compensate: it adds the negative of this.
/// let compensation = report.compensation().expect("one effect is clear");
/// assert!((compensation.friction + 0.4).abs() < 0.01);
/// # Ok::<(), residual::Error>(())
/// ```
///
/// # Errors
/// [`Error::Data`], [`Error::RankDeficient`], [`Error::Model`] or [`Error::Expression`].
pub fn analyse(spec: &Spec, data: Data, progress: &mut dyn Progress) -> Result<Report, Error> {
    analyse_checked(spec, data, None, progress)
}

/// As [`analyse`], with data to check the models on; see [`run_checked`].
///
/// # Errors
/// As [`analyse`].
pub fn analyse_checked(
    spec: &Spec,
    data: Data,
    check: Option<&Data>,
    progress: &mut dyn Progress,
) -> Result<Report, Error> {
    check_selection(spec)?;
    if spec.selection.nested {
        nested::check_folds(&data)?;
    }
    let mut search = Search::new(spec, &data, progress)?;
    let outcome = search.run(progress)?;
    let outcome = search.other_paths(outcome, progress)?;
    let check = check.map(|data| Checked::new(data, spec));
    progress.stage("which names the data support");
    let Attributed {
        outcome,
        mut left,
        weights,
        parameters,
        improving,
        equal,
        not_judged,
    } = attribute(&mut search, outcome, check.as_ref())?;
    if let Some(doubt) = feedback::doubt(&search, &outcome.chosen, &weights, left.explained)? {
        left.doubt(doubt);
    }
    let found = Found {
        search: &search,
        outcome: &outcome,
        left,
        weights: &weights,
        parameters: &parameters,
        improving: improving.as_ref(),
        equal,
        not_judged,
        check: check.as_ref(),
    };
    let mut report = assembly::report(found, &data)?;
    if spec.selection.nested {
        // The report is finished: a fold that cannot be analysed alone costs this figure only.
        match nested(spec, &data, progress) {
            Ok(result) => report.nested_rmse = Some(result.rmse),
            Err(error) => progress.stage(&format!("no nested figure: {error}")),
        }
    }
    Ok(report)
}
