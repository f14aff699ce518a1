//! All models side by side, with tables and pictures: `docs/estimation/` is one run of this.
//!
//! Here is the sequence of trainings; `goals.rs` compares with what is asked for, `tables.rs`
//! writes Markdown, `draw.rs` the pictures. Tables are written after each model and each part, so a
//! report that is broken off leaves what it has found, marked as unfinished.

mod check;
mod draw;
mod goals;
mod tables;

pub use check::{probe, probe_file};

pub use goals::Goal;
pub use tables::tables;

use super::evaluate::{evaluate, Evaluation, Replay};
use super::load::Data;
use super::study::{Choice, Point, Study};
use estimator::estimator::{Estimator, Kind, NetworkLimits, Training};
use estimator::metrics::{by_trial, paired, Difference, Rows};
use estimator::model::Epochs;
use estimator::sequence::Sequence;
use estimator::trees::TreesConfig;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

/// Minutes of the learning curve.
const MINUTES: [usize; 6] = [5, 10, 20, 40, 80, 140];
/// Choice of minutes: 60 chosen against 60 and 160 random ones, three draws of each.
const CHOICE: Choice = Choice {
    first: 12,
    step: 16,
    last: 60,
    more: 160,
    draws: 3,
};

/// Data of a report.
#[derive(Debug)]
pub struct Inputs<'a> {
    /// The experiment that trains and tests.
    pub data: &'a Data,
    /// More trials of the same robot; all models are tested on them too.
    pub unseen: Option<&'a Data>,
    /// Other data on which the models are tried, by name.
    pub also: &'a [(String, Data)],
    /// Forces in three dimensions; the last trial is the test.
    pub three_axes: Option<&'a Data>,
}

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
    /// Minutes of training of the study of input groups at most.
    pub group_minutes: Option<f64>,
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
    /// How far the training of a network went.
    #[serde(default)]
    pub epochs: Option<Epochs>,
    /// Figures on the test trials.
    pub evaluation: Evaluation,
    /// Mean absolute error of each test trial, N.
    pub by_trial: Vec<f64>,
    /// Error less that of the shipped model.
    pub difference: Option<Difference>,
}

/// Models on other data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Elsewhere {
    /// Name of the data.
    pub name: String,
    /// No force, the physical model, the shipped one.
    pub models: Vec<(String, Evaluation)>,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Results {
    /// Whether the report came to its end.
    #[serde(default)]
    pub finished: bool,
    /// Data.
    pub data: String,
    /// Trials for training.
    pub training: Vec<usize>,
    /// Trials for testing.
    pub test: Vec<usize>,
    /// Data of more trials for testing, and their number.
    pub unseen: Option<(String, usize)>,
    /// Rows per second.
    pub rate_hz: f64,
    /// Models.
    pub models: Vec<ModelResult>,
    /// Without groups of inputs: the shipped model.
    pub ablation: Vec<Point>,
    /// Minutes drawn at random: the physical and the shipped model.
    pub learning: Vec<(String, Vec<Point>)>,
    /// Minutes chosen by predicted error, and random ones: the shipped model.
    pub choice: Vec<Point>,
    /// What the chosen minutes were tested on: fewer trials than the other models.
    #[serde(default)]
    pub choice_test: String,
    /// On other data, not trained anew.
    pub elsewhere: Vec<Elsewhere>,
    /// Forces in three dimensions.
    pub three_axes: Vec<ModelResult>,
    /// What was asked for and what was reached.
    pub goals: Vec<Goal>,
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
    /// A model can't be trained or tested.
    #[error(transparent)]
    Model(#[from] estimator::model::ModelError),
    /// The data do not suffice for all parts.
    #[error("{0}")]
    Data(String),
    /// A file can't be written.
    #[error("{path} cannot be written: {cause}")]
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

/// How a model is trained on these trials.
fn training(
    data: &Data,
    trials: &[usize],
    kind: Kind,
    seed: u64,
    intervals: bool,
) -> Result<Training, ReportError> {
    let base = data.base(trials);
    Ok(Training {
        kind,
        axes: data.axes.clone(),
        base: base.map_err(|error| ReportError::Data(error.to_string()))?,
        robot: data.robot.clone(),
        trees: TreesConfig {
            seed,
            ..TreesConfig::default()
        },
        networks: NetworkLimits::default(),
        intervals,
        absent: data.absent.clone(),
    })
}

/// A trained model on the test trials.
fn tested(
    estimator: &Estimator,
    training_s: f64,
    test: &[&Sequence],
) -> Result<(ModelResult, Vec<Rows>), ReportError> {
    let (evaluation, trials) = evaluate(estimator, test, &Replay::default())?;
    let result = ModelResult {
        model: estimator.kind.name().to_owned(),
        parameters: estimator.model().parameters(),
        training_s,
        epochs: estimator.epochs(),
        evaluation,
        by_trial: by_trial(&trials),
        difference: None,
    };
    Ok((result, trials))
}

/// Trains, and calibrates intervals apart from the time.
fn trained(settings: &Training, rows: &[&Sequence]) -> Result<(Estimator, f64), ReportError> {
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
    Ok((estimator, training_s))
}

/// Differences to the last model, the shipped one.
fn compare_with_last(models: &mut [ModelResult]) {
    let Some(reference) = models.last().map(|m| m.by_trial.clone()) else {
        return;
    };
    for model in models {
        model.difference = paired(&model.by_trial, &reference);
    }
}

/// A report under way.
struct Report<'a> {
    into: &'a Path,
    inputs: &'a Inputs<'a>,
    settings: &'a Settings,
    say: &'a mut dyn FnMut(&str),
    began: Instant,
    results: Results,
    /// Numbered anew: trials of other folders have the same numbers.
    more: Vec<Sequence>,
}

/// Trains and compares all models; writes tables and pictures to `into`.
///
/// # Errors
/// [`ReportError`]. What the data do not suffice for, and a folder that can't be written, are found
/// before anything is trained.
pub fn write(
    into: &Path,
    inputs: &Inputs<'_>,
    settings: &Settings,
    say: &mut dyn FnMut(&str),
) -> Result<Written, ReportError> {
    probe(into)?;
    check::data(inputs, settings)?;
    let last = inputs.data.trials().last().copied().unwrap_or(0);
    let more = inputs.unseen.map_or_else(Vec::new, |unseen| {
        let mut more = unseen.sequences.clone();
        more.iter_mut().for_each(|s| s.trial += last);
        more
    });
    let report = Report {
        into,
        inputs,
        settings,
        say,
        began: Instant::now(),
        results: Results {
            data: inputs.data.name.clone(),
            training: settings.training.clone(),
            test: settings.test.clone(),
            unseen: inputs.unseen.map(|u| (u.name.clone(), u.trials().len())),
            rate_hz: (inputs.data.sequences.first()).map_or(0.0, |s| 1.0 / s.step_s),
            ..Results::default()
        },
        more,
    };
    report.run()
}

impl Report<'_> {
    fn run(mut self) -> Result<Written, ReportError> {
        let more = std::mem::take(&mut self.more);
        let more: Vec<&Sequence> = more.iter().collect();
        let data = self.inputs.data;
        let rows = data.of(&self.settings.training);
        let seed = self.settings.seed;
        let mut test = data.of(&self.settings.test);
        test.extend(&more);
        let (shipped, physics) = self.models(&rows, &test)?;
        self.elsewhere(&shipped, &physics)?;
        self.three_axes()?;

        let trials = &self.settings.training;
        let hybrid = training(data, trials, Kind::Hybrid, seed, false)?;
        let quick = training(data, trials, Kind::Physics, seed, false)?;
        self.note("minutes of training");
        for settings in [&quick, &hybrid] {
            let points = self
                .study(settings, &rows, &test)
                .learning_curve(&MINUTES, seed)?;
            if !points.is_empty() {
                let name = settings.kind.name().to_owned();
                self.results.learning.push((name, points));
            }
            self.keep()?;
        }
        self.note("choice of minutes");
        // With more trials to test on, all trials of the data can be chosen from.
        let all: Vec<&Sequence> = data.sequences.iter().collect();
        let (pool, unseen) = if more.is_empty() {
            (&rows, &test)
        } else {
            (&all, &more)
        };
        self.results.choice_test = match &self.results.unseen {
            Some((name, _)) => name.clone(),
            None => "the test trials".to_owned(),
        };
        self.results.choice = self.study(&hybrid, pool, unseen).choice(&CHOICE, seed)?;
        self.keep()?;
        self.note("input groups");
        let minutes = self.settings.group_minutes;
        self.results.ablation = self.study(&hybrid, &rows, &test).ablation(minutes)?;
        self.results.finished = true;
        let text = self.keep()?;
        self.note("done");
        Ok(Written {
            results: self.results,
            text,
        })
    }

    fn note(&mut self, text: &str) {
        let minutes = self.began.elapsed().as_secs_f64() / 60.0;
        (self.say)(&format!("[{minutes:5.1} min] {text}"));
    }

    fn study<'a>(
        &'a mut self,
        settings: &'a Training,
        training: &'a [&'a Sequence],
        test: &'a [&'a Sequence],
    ) -> Study<'a> {
        Study {
            settings,
            training,
            test,
            say: &mut *self.say,
        }
    }

    /// All models on the test trials, with the pictures of them; the shipped and the physical one.
    fn models(
        &mut self,
        rows: &[&Sequence],
        test: &[&Sequence],
    ) -> Result<(Estimator, Estimator), ReportError> {
        let mut compared: Vec<(String, Vec<Rows>)> = Vec::new();
        for (estimator, training_s) in &self.settings.trained {
            self.note(&format!(
                "model `{}`, trained before",
                estimator.kind.name()
            ));
            let (result, trials) = tested(estimator, *training_s, test)?;
            self.found(result, trials, &mut compared)?;
        }
        let mut kept = Vec::new();
        for kind in Kind::ALL {
            self.note(&format!("model `{}`", kind.name()));
            let intervals = matches!(kind, Kind::Physics | Kind::Hybrid);
            let trials = &self.settings.training;
            let seed = self.settings.seed;
            let settings = training(self.inputs.data, trials, kind, seed, intervals)?;
            let (estimator, training_s) = trained(&settings, rows)?;
            let (result, trials) = tested(&estimator, training_s, test)?;
            self.found(result, trials, &mut compared)?;
            kept.push(estimator);
        }
        compare_with_last(&mut self.results.models);
        self.keep()?;
        draw::models(self.into, &self.results, &compared)?;
        // The last two of `Kind::ALL`.
        let (Some(shipped), Some(physics)) = (kept.pop(), kept.pop()) else {
            unreachable!("all kinds were trained")
        };
        Ok((shipped, physics))
    }

    fn found(
        &mut self,
        result: ModelResult,
        trials: Vec<Rows>,
        compared: &mut Vec<(String, Vec<Rows>)>,
    ) -> Result<(), ReportError> {
        let mae = result.evaluation.figures.mae_n;
        (self.say)(&format!("  `{}`: MAE {mae:.3} N", result.model));
        compared.push((result.model.clone(), trials));
        self.results.models.push(result);
        self.keep().map(|_| ())
    }

    fn elsewhere(&mut self, shipped: &Estimator, physics: &Estimator) -> Result<(), ReportError> {
        for (name, other) in self.inputs.also {
            self.note(&format!("other data: {name}"));
            let sequences: Vec<&Sequence> = other.sequences.iter().collect();
            let trials = &self.settings.training;
            let seed = self.settings.seed;
            let none = training(self.inputs.data, trials, Kind::Zero, seed, false)?;
            let none = Estimator::train(&none, &sequences, &mut |_| {})?;
            let mut models = Vec::new();
            for estimator in [&none, physics, shipped] {
                let evaluation = evaluate(estimator, &sequences, &Replay::default())?.0;
                models.push((estimator.kind.name().to_owned(), evaluation));
            }
            self.results.elsewhere.push(Elsewhere {
                name: name.clone(),
                models,
            });
            self.keep()?;
        }
        Ok(())
    }

    fn three_axes(&mut self) -> Result<(), ReportError> {
        let Some(other) = self.inputs.three_axes else {
            return Ok(());
        };
        let trials = other.trials();
        let last = trials.len().saturating_sub(1);
        let (rows, test) = (other.of(&trials[..last]), other.of(&trials[last..]));
        for kind in [Kind::Zero, Kind::Linear, Kind::Physics, Kind::Hybrid] {
            self.note(&format!("three-dimensional forces: `{}`", kind.name()));
            let seed = self.settings.seed;
            let settings = training(other, &trials[..last], kind, seed, false)?;
            let (estimator, training_s) = trained(&settings, &rows)?;
            let result = tested(&estimator, training_s, &test)?.0;
            self.results.three_axes.push(result);
            self.keep()?;
        }
        compare_with_last(&mut self.results.three_axes);
        self.keep().map(|_| ())
    }

    /// Writes what there is.
    fn keep(&mut self) -> Result<String, ReportError> {
        self.results.goals = goals::goals(&self.results);
        let text = tables(&self.results);
        save(&self.into.join("figures.md"), &text)?;
        let json = serde_json::to_string_pretty(&self.results)? + "\n";
        save(&self.into.join("figures.json"), &json)?;
        draw::learning(self.into, &self.results)?;
        Ok(text)
    }
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
