//! Runs the analysis on one set and compares the result with the truth.

use crate::case::Case;
use crate::judge::{self, Class, Estimate};
use residual::spec::Spec;
use residual::{Data, Report};
use serde::{Deserialize, Serialize};
use std::time::Instant;
use synthetic_sets::{Kind, Log, Set};

/// The declared model that the analysis gets: columns, units, and *force = command*. The speed has
/// a noise of 0.01 rad/s in motion, so three times that is standstill.
pub const MODEL: &str = r#"
title = "Undeclared effect"

[roles]
time        = { column = "time_s", unit = "s" }
target      = { column = "force_n", unit = "N" }
command     = { column = "command_n", unit = "N" }
velocity    = { column = "speed_rad_s", unit = "rad/s", deadband = 0.03 }
angle       = { column = "angle_rad", unit = "rad" }
temperature = { column = "temperature_c", unit = "K" }

[roles.channels]
neighbour = { column = "neighbour_n", unit = "N" }

[holdout]
block_s = 10.0

[[terms]]
name = "tension"
expr = "command"
unit = "N"
fixed = 1.0
"#;

/// What came out for one set.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outcome {
    /// The set.
    pub case: Case,
    /// How the result relates to the truth.
    pub class: Class,
    /// The verdict's word.
    pub verdict: String,
    /// The effect named first, or the verdict.
    pub answer: String,
    /// Effects named, strongest first.
    pub named: Vec<String>,
    /// What may stand for the effect that is named first.
    pub others: Vec<String>,
    /// Nameless structure left, strongest first.
    pub structure: Vec<String>,
    /// Parameters of each true effect that was named.
    pub estimates: Vec<Estimate>,
    /// How many of the true effects were named.
    pub hits: usize,
    /// How many effects were named that are not there, nor in a group with one that is.
    pub extra: usize,
    /// How many effects were named that are not there, in a group with one that is: *A or B*.
    pub grouped: usize,
    /// Held-out RMSE of the final model, in newtons.
    pub rmse: f64,
    /// RMSE with the true effects removed, in newtons.
    pub oracle: f64,
    /// RMS of the effects as a multiple of the noise's.
    pub ratio: f64,
    /// Rows analysed.
    pub rows: usize,
    /// Time of the analysis, in seconds.
    pub seconds: f64,
}

impl Outcome {
    /// Whether an effect is called found that is not there.
    #[must_use]
    pub fn finds_a_wrong_one(&self) -> bool {
        self.extra > 0 && ["effect", "several"].contains(&self.verdict.as_str())
    }

    /// Held-out RMSE of the final model over the oracle's.
    #[must_use]
    pub fn over_oracle(&self) -> f64 {
        self.rmse / self.oracle
    }
}

/// Seconds of a hold-out group, and the most folds: what [`MODEL`] asks for and the analysis's
/// default.
const BLOCK_S: f64 = 10.0;
const FOLDS: usize = 10;

/// The set as the analysis loads it from files with [`MODEL`]: values as a CSV file holds them,
/// blocks of time dealt to folds in turn.
///
/// # Errors
/// The analysis's own: no set should lead to one.
pub fn load(set: &Set) -> Result<Data, residual::Error> {
    // Roles' names, in the order of `Log::NAMES` without the time.
    const ROLES: [&str; 6] = [
        "target",
        "command",
        "velocity",
        "angle",
        "temperature",
        "neighbour",
    ];
    let mut columns: Vec<(String, Vec<f64>)> = ROLES
        .iter()
        .map(|name| ((*name).to_string(), Vec::new()))
        .collect();
    let (mut time, mut group, mut sequences) = (Vec::new(), Vec::new(), Vec::new());
    let mut groups = 0;
    let written = |x: &f64| (x * 1e6).round() / 1e6;
    for log in &set.logs {
        let start = time.len();
        let [first, rest @ ..] = log.columns();
        time.extend(first.iter().map(written));
        for ((_, column), values) in columns.iter_mut().zip(rest) {
            column.extend(values.iter().map(written));
        }
        let block = |t: &f64| ((t - time[start]) / BLOCK_S) as usize;
        group.extend(time[start..].iter().map(|t| groups + block(t)));
        groups = group.last().map_or(0, |last| last + 1);
        sequences.push(start..time.len());
    }
    Data::from_columns(time, columns)
        .sequences(sequences)
        .groups(group)
        .folds(FOLDS)
        .build()
}

/// Writes a set's logs and [`MODEL`] into a folder of its own under `folder`, to analyse it by
/// hand: `forcectl residual --data FOLDER --model FOLDER/model.toml --out OUT`.
///
/// # Errors
/// When a file can't be written.
pub fn write(case: &Case, folder: &std::path::Path) -> std::io::Result<()> {
    let folder = folder.join(format!(
        "{:?}-{}-x{}-seed{}",
        case.group,
        case.truth(),
        case.strength,
        case.recipe().seed
    ));
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join("model.toml"), MODEL)?;
    let set = synthetic_sets::generate(&case.recipe());
    for (k, log) in set.logs.iter().enumerate() {
        std::fs::write(folder.join(format!("log-{}.csv", k + 1)), log.to_csv())?;
    }
    std::fs::write(folder.join("truth"), format!("{:#?}\n", set.truth))
}

/// Analyses logs with the declared model.
///
/// # Errors
/// The analysis's own message: no set of the benchmark should lead to one.
pub fn analyse(set: &Set) -> Result<Report, String> {
    let spec = Spec::parse(MODEL).map_err(|error| error.to_string())?;
    load(set)
        .and_then(|data| residual::analyse(&spec, data, &mut ()))
        .map_err(|error| error.to_string())
}

/// Makes a set, has it analysed, and compares.
///
/// # Errors
/// As [`analyse`], with the set's name.
pub fn evaluate(case: &Case) -> Result<Outcome, String> {
    let set = synthetic_sets::generate(&case.recipe());
    let started = Instant::now();
    let report = analyse(&set).map_err(|error| {
        format!(
            "{} at {}, seed {}: {error}",
            case.truth(),
            case.strength,
            case.seed
        )
    })?;
    let seconds = started.elapsed().as_secs_f64();
    let uncatalogued = case
        .kinds
        .iter()
        .any(|kind| Kind::UNCATALOGUED.contains(kind) || Kind::IMPURE.contains(kind));
    let mut estimates = Vec::new();
    let mut hits = 0;
    for truth in &set.truth.effects {
        let found = report
            .effects
            .iter()
            .find(|effect| judge::is(truth.kind, effect.name, effect.form_kind));
        if let Some(found) = found {
            hits += 1;
            estimates.extend(judge::estimates(truth, found));
        }
    }
    let grouped = judge::grouped(&report, &case.kinds);
    Ok(Outcome {
        case: case.clone(),
        class: judge::class(&report, &case.kinds, uncatalogued),
        verdict: report.verdict.word().to_owned(),
        answer: judge::answer(&report),
        named: report
            .effects
            .iter()
            .map(|effect| effect.name.to_string())
            .collect(),
        others: report
            .effects
            .first()
            .map(|first| report.others(first.name).concat())
            .unwrap_or_default()
            .iter()
            .map(ToString::to_string)
            .collect(),
        structure: report
            .structure
            .iter()
            .map(|left| left.depends_on.clone())
            .collect(),
        estimates,
        hits,
        extra: report.effects.len() - hits - grouped,
        grouped,
        rmse: report.last.heldout_rmse,
        oracle: set.truth.noise_rms_n,
        ratio: set.truth.effect_rms_n / set.truth.noise_rms_n,
        rows: set.logs.iter().map(|log: &Log| log.time_s.len()).sum(),
        seconds,
    })
}
