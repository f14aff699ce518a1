//! All models side by side, with tables and pictures: `docs/estimation/` is one run of this.

use super::evaluate::{evaluate, Evaluation};
use super::load::Data;
use super::pictures::{self, Place};
use super::study::{self, Point};
use estimator::estimator::{Estimator, Kind, NetworkLimits, Training};
use estimator::metrics::Rows;
use estimator::sequence::Sequence;
use estimator::trees::TreesConfig;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

macro_rules! line {
    ($text:expr, $($arg:tt)*) => {{
        // A String takes every line.
        let _ = writeln!($text, $($arg)*);
    }};
}

/// Minutes of the learning curve.
const MINUTES: [usize; 6] = [5, 10, 20, 40, 80, 140];
/// Minutes of the active choice: at first, at a time, at last.
const CHOICE: [usize; 3] = [12, 16, 60];

/// Which trials, which seed, which models beside those that the report trains.
#[derive(Debug)]
pub struct Settings {
    /// Trials for training.
    pub training: Vec<usize>,
    /// Trials for testing.
    pub test: Vec<usize>,
    /// Seed of everything random.
    pub seed: u64,
    /// Models that were trained before, with the time of their training, s.
    pub trained: Vec<(Estimator, f64)>,
}

/// Other data with a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Also {
    /// Name in the table.
    pub name: String,
    /// Folder.
    pub folder: PathBuf,
}

impl FromStr for Also {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, folder) = text.split_once('=').ok_or("give NAME=FOLDER")?;
        Ok(Self {
            name: name.to_owned(),
            folder: folder.into(),
        })
    }
}

/// One model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelResult {
    /// Model.
    pub model: String,
    /// Trained parameters.
    pub parameters: usize,
    /// Time of the training without intervals, s.
    pub training_s: f64,
    /// Figures on the test trials.
    pub evaluation: Evaluation,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Data.
    pub data: String,
    /// Trials for training.
    pub training: Vec<usize>,
    /// Trials for testing.
    pub test: Vec<usize>,
    /// Rows per second.
    pub rate_hz: f64,
    /// Models.
    pub models: Vec<ModelResult>,
    /// Without groups of inputs: the shipped model.
    pub ablation: Vec<Point>,
    /// Minutes drawn at random: the physical and the shipped model.
    pub learning: Vec<(String, Vec<Point>)>,
    /// Minutes chosen by predicted error: the shipped model.
    pub chosen: Vec<Point>,
    /// The shipped model on other data, by name.
    pub elsewhere: Vec<(String, Evaluation)>,
    /// Forces in three dimensions: the physical and the shipped model.
    pub three_axes: Vec<ModelResult>,
}

/// What was written.
#[derive(Debug, Clone)]
pub struct Written {
    /// Figures.
    pub results: Results,
    /// Tables in Markdown.
    pub text: String,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A model can't be trained.
    #[error(transparent)]
    Model(#[from] estimator::model::ModelError),
    /// A file can't be written.
    #[error("{path}: {cause}")]
    File {
        /// File.
        path: String,
        /// Cause.
        cause: std::io::Error,
    },
    /// Figures can't be written as JSON.
    #[error("the figures cannot be written: {0}")]
    Json(#[from] serde_json::Error),
}

fn training(data: &Data, kind: Kind, seed: u64, intervals: bool) -> Training {
    Training {
        kind,
        axes: data.axes.clone(),
        base: data.base,
        robot: data.robot.clone(),
        trees: TreesConfig {
            seed,
            ..TreesConfig::default()
        },
        networks: NetworkLimits::default(),
        intervals,
        absent: data.absent.clone(),
    }
}

/// Trains with intervals, and once without for the time.
fn result(
    settings: &Training,
    rows: &[&Sequence],
    test: &[&Sequence],
) -> Result<(ModelResult, Vec<Rows>, Estimator), ReportError> {
    let began = Instant::now();
    let plain = Training {
        intervals: false,
        ..settings.clone()
    };
    let mut estimator = Estimator::train(&plain, rows, &mut |_| {})?;
    let training_s = began.elapsed().as_secs_f64();
    if settings.intervals {
        estimator.calibrate(settings, rows)?;
    }
    let (evaluation, trials) = evaluate(&estimator, test)?;
    let result = ModelResult {
        model: settings.kind.name().to_owned(),
        parameters: estimator.model().parameters(),
        training_s,
        evaluation,
    };
    Ok((result, trials, estimator))
}

/// Trains and compares all models; writes tables and pictures to `into`.
///
/// # Errors
/// [`ReportError`].
pub fn write(
    into: &Path,
    data: &Data,
    also: &[(String, Data)],
    three_axes: Option<&Data>,
    settings: &Settings,
    say: &mut dyn FnMut(&str),
) -> Result<Written, ReportError> {
    let (rows, test) = (data.of(&settings.training), data.of(&settings.test));
    let mut models = Vec::new();
    let mut compared: Vec<(String, Vec<Rows>)> = Vec::new();
    let mut shipped = None;
    for (estimator, training_s) in &settings.trained {
        let (evaluation, trials) = evaluate(estimator, &test)?;
        models.push(ModelResult {
            model: estimator.kind.name().to_owned(),
            parameters: estimator.model().parameters(),
            training_s: *training_s,
            evaluation,
        });
        compared.push((estimator.kind.name().to_owned(), trials));
    }
    for kind in Kind::ALL {
        say(&format!("model `{}`", kind.name()));
        let (result, trials, estimator) =
            result(&training(data, kind, settings.seed, true), &rows, &test)?;
        models.push(result);
        compared.push((kind.name().to_owned(), trials));
        shipped = Some(estimator);
    }
    let hybrid = training(data, Kind::Hybrid, settings.seed, false);
    let physics = training(data, Kind::Physics, settings.seed, false);
    say("input groups");
    let ablation = study::ablation(&hybrid, &rows, &test)?;
    say("minutes of data");
    let mut learning = Vec::new();
    for settings_of in [&physics, &hybrid] {
        let points = study::learning_curve(settings_of, &rows, &test, &MINUTES, settings.seed)?;
        learning.push((settings_of.kind.name().to_owned(), points));
    }
    say("choice of minutes");
    let mut chosen = vec![study::chosen(&hybrid, &rows, &test, CHOICE, settings.seed)?];
    chosen.extend(study::learning_curve(
        &hybrid,
        &rows,
        &test,
        &[CHOICE[2]],
        settings.seed + 1,
    )?);
    let mut elsewhere = Vec::new();
    if let Some(estimator) = &shipped {
        for (name, other) in also {
            say(&format!("other data: {name}"));
            let sequences: Vec<&Sequence> = other.sequences.iter().collect();
            elsewhere.push((name.clone(), evaluate(estimator, &sequences)?.0));
        }
    }
    let mut in_space = Vec::new();
    if let Some(other) = three_axes {
        say("three-dimensional forces");
        let trials = other.trials();
        let last = trials.len().saturating_sub(1);
        let (rows, test) = (other.of(&trials[..last]), other.of(&trials[last..]));
        for kind in [Kind::Zero, Kind::Linear, Kind::Physics, Kind::Hybrid] {
            in_space.push(result(&training(other, kind, settings.seed, false), &rows, &test)?.0);
        }
    }
    let results = Results {
        data: data.name.clone(),
        training: settings.training.clone(),
        test: settings.test.clone(),
        rate_hz: test.first().map_or(f64::NAN, |s| 1.0 / s.step_s),
        models,
        ablation,
        learning,
        chosen,
        elsewhere,
        three_axes: in_space,
    };
    draw(into, &results, &compared)?;
    let text = tables(&results);
    save(&into.join("figures.md"), &text)?;
    save(
        &into.join("figures.json"),
        &(serde_json::to_string_pretty(&results)? + "\n"),
    )?;
    Ok(Written { results, text })
}

fn save(path: &Path, text: &str) -> Result<(), ReportError> {
    let write = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        std::fs::write(path, text)
    };
    write().map_err(|cause| ReportError::File {
        path: path.display().to_string(),
        cause,
    })
}

/// Models that the pictures of errors show: those that try.
const SHOWN: [&str; 6] = ["mlp", "gru", "lstm", "linear", "physics", "hybrid"];

fn draw(
    into: &Path,
    results: &Results,
    compared: &[(String, Vec<Rows>)],
) -> Result<(), ReportError> {
    let shown = || {
        compared
            .iter()
            .filter(|(name, _)| SHOWN.contains(&name.as_str()))
    };
    let step_s = 1.0 / results.rate_hz;
    let first: Vec<(String, &Rows)> = shown()
        .filter(|(name, _)| name != "linear")
        .filter_map(|(name, trials)| Some((name.clone(), trials.first()?)))
        .collect();
    save(
        &into.join("prediction.svg"),
        &pictures::prediction(
            "Prediction against truth, an unseen trial",
            &first,
            step_s,
            100.0,
            240.0,
        )
        .to_svg(),
    )?;
    let boxes: Vec<(String, &[Rows])> = compared
        .iter()
        .map(|(name, trials)| (name.clone(), trials.as_slice()))
        .collect();
    save(
        &into.join("errors.svg"),
        &pictures::boxes("Errors of each model on unseen trials", &boxes).to_svg(),
    )?;
    let speeds: Vec<(String, Vec<f64>)> = (results.models.iter())
        .filter(|m| SHOWN.contains(&m.model.as_str()))
        .map(|m| {
            (
                m.model.clone(),
                m.evaluation.by_speed.iter().map(|b| b.mae_n).collect(),
            )
        })
        .collect();
    let below: Vec<f64> = results.models.first().map_or_else(Vec::new, |m| {
        m.evaluation
            .by_speed
            .iter()
            .map(|b| b.below_m_per_s)
            .collect()
    });
    save(
        &into.join("speed.svg"),
        &pictures::by_speed("Error by speed of the tip, unseen trials", &below, &speeds).to_svg(),
    )?;
    let mut curves: Vec<(String, Vec<(f64, f64)>)> = (results.learning.iter())
        .map(|(name, points)| {
            (
                name.clone(),
                points
                    .iter()
                    .map(|p| (p.minutes, p.figures.mae_n))
                    .collect(),
            )
        })
        .collect();
    if let Some(chosen) = results.chosen.first() {
        curves.push((
            "chosen".to_owned(),
            vec![(chosen.minutes, chosen.figures.mae_n)],
        ));
    }
    save(
        &into.join("learning.svg"),
        &pictures::curves(
            "Error against training data",
            "minutes of training",
            "mean absolute error, N",
            &curves,
        )
        .to_svg(),
    )?;
    let Some((_, shipped)) = compared.last() else {
        return Ok(());
    };
    let degrees = |v: f64| v.to_degrees();
    let places: [Place<'_>; 6] = [
        ("shoulder, degrees", "elbow, degrees", &|r, k| {
            (degrees(r.joints[k][0]), degrees(r.joints[k][1]))
        }),
        ("shoulder, degrees", "insertion, mm", &|r, k| {
            (degrees(r.joints[k][0]), 1e3 * r.joints[k][2])
        }),
        ("tip x0, mm", "tip y0, mm", &|r, k| {
            (1e3 * r.tips[k][0], 1e3 * r.tips[k][1])
        }),
        ("shoulder, degrees/s", "elbow, degrees/s", &|r, k| {
            (degrees(r.rates[k][0]), degrees(r.rates[k][1]))
        }),
        ("shoulder, degrees/s", "insertion, mm/s", &|r, k| {
            (degrees(r.rates[k][0]), 1e3 * r.rates[k][2])
        }),
        ("tip x0, mm", "tip z0, mm", &|r, k| {
            (1e3 * r.tips[k][0], 1e3 * r.tips[k][2])
        }),
    ];
    save(
        &into.join("maps.svg"),
        &pictures::error_maps(
            "Mean absolute error of the shipped model over joints, joint velocities and workspace",
            shipped,
            &places,
        )
        .to_svg(),
    )
}

fn interval(half: Option<f64>) -> String {
    half.map_or_else(String::new, |h| format!(" ± {h:.3}"))
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1}", 100.0 * s))
}

fn models_table(text: &mut String, models: &[ModelResult]) {
    line!(text, "| model | MAE, N | RMSE, N | NRMSE | parameters | training, s | step, us: median | p99 | 90 % interval covers, % |");
    line!(
        text,
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    for m in models {
        let (e, f) = (&m.evaluation, &m.evaluation.figures);
        line!(
            text,
            "| {} | {:.3}{} | {:.3} | {} | {} | {:.1} | {:.1} | {:.1} | {} |",
            m.model,
            f.mae_n,
            interval(f.mae_half_n),
            f.rmse_n,
            super::card::percent(f.nrmse),
            m.parameters,
            m.training_s,
            e.step.median_us,
            e.step.p99_us,
            percent(e.covered)
        );
    }
}

/// Tables in Markdown.
#[must_use]
pub fn tables(r: &Results) -> String {
    let mut text = String::new();
    line!(text, "# Figures of the estimators\n");
    line!(text, "`forcectl estimate report` has written this page. Training on the trials {:?}, test on the trials {:?}, {} rows per second.", r.training, r.test, r.rate_hz);
    line!(text, "MAE with the 95 % interval over test trials. Times are of the machine that wrote this page.\n");
    line!(text, "## Models\n");
    models_table(&mut text, &r.models);
    line!(text, "\n## By speed of the tip\n");
    if let Some(first) = r.models.first() {
        let heads: Vec<String> = first
            .evaluation
            .by_speed
            .iter()
            .map(|b| format!("below {:.1} mm/s", 1e3 * b.below_m_per_s))
            .collect();
        line!(
            text,
            "| model, MAE in N | {} | slowest per overall | turning round | sliding |",
            heads.join(" | ")
        );
        line!(text, "| --- |{}", " --- |".repeat(heads.len() + 3));
        let rows: Vec<String> = first
            .evaluation
            .by_speed
            .iter()
            .map(|b| b.rows.to_string())
            .collect();
        line!(text, "| rows | {} | | | |", rows.join(" | "));
    }
    for m in &r.models {
        let e = &m.evaluation;
        let bins: Vec<String> = e
            .by_speed
            .iter()
            .map(|b| format!("{:.3}", b.mae_n))
            .collect();
        let ratio = e.by_speed.first().map_or(f64::NAN, |b| b.mae_n) / e.figures.mae_n;
        line!(
            text,
            "| {} | {} | {ratio:.2} | {:.3} | {:.3} |",
            m.model,
            bins.join(" | "),
            e.mae_reversing_n,
            e.mae_sliding_n
        );
    }
    line!(
        text,
        "\n## Intervals: coverage of 90 % intervals, and mean half width\n"
    );
    for m in r
        .models
        .iter()
        .filter(|m| m.model == "physics" || m.model == "hybrid")
    {
        let by_trial: Vec<String> = m
            .evaluation
            .covered_by_trial
            .iter()
            .map(|c| format!("{:.1}", 100.0 * c))
            .collect();
        line!(
            text,
            "{}: {} % of all rows; by trial {} %.\n",
            m.model,
            percent(m.evaluation.covered),
            by_trial.join(", ")
        );
        line!(
            text,
            "| speed below, mm/s | covers, % | half width, N |\n| --- | --- | --- |"
        );
        for b in &m.evaluation.by_speed {
            line!(
                text,
                "| {:.1} | {} | {:.3} |",
                1e3 * b.below_m_per_s,
                percent(b.covered),
                b.half_width_n.unwrap_or(f64::NAN)
            );
        }
        line!(text, "");
    }
    studies(&mut text, r);
    text
}

fn studies(text: &mut String, r: &Results) {
    line!(
        text,
        "## Without a group of inputs: the shipped model, trained anew\n"
    );
    line!(text, "| held at its mean | MAE, N |\n| --- | --- |");
    for p in &r.ablation {
        line!(
            text,
            "| {} | {:.3}{} |",
            p.name,
            p.figures.mae_n,
            interval(p.figures.mae_half_n)
        );
    }
    line!(text, "\n## Minutes of training\n");
    line!(text, "| model | minutes | MAE, N |\n| --- | --- | --- |");
    for (name, points) in &r.learning {
        for p in points {
            line!(
                text,
                "| {name}, {} | {:.0} | {:.3}{} |",
                p.name,
                p.minutes,
                p.figures.mae_n,
                interval(p.figures.mae_half_n)
            );
        }
    }
    for p in &r.chosen {
        line!(
            text,
            "| hybrid, {} | {:.0} | {:.3}{} |",
            p.name,
            p.minutes,
            p.figures.mae_n,
            interval(p.figures.mae_half_n)
        );
    }
    if !r.elsewhere.is_empty() {
        line!(
            text,
            "\n## The shipped model on other data, not trained anew\n"
        );
        line!(text, "| data | MAE, N | RMSE, N | rows | 90 % interval covers, % |\n| --- | --- | --- | --- | --- |");
        for (name, e) in &r.elsewhere {
            line!(
                text,
                "| {name} | {:.3}{} | {:.3} | {} | {} |",
                e.figures.mae_n,
                interval(e.figures.mae_half_n),
                e.figures.rmse_n,
                e.figures.rows,
                percent(e.covered)
            );
        }
    }
    if !r.three_axes.is_empty() {
        line!(
            text,
            "\n## Three-dimensional forces: length of the error vector\n"
        );
        models_table(text, &r.three_axes);
    }
}
