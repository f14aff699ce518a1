//! `forcectl estimate report`: all models side by side.

use super::{model, DataArgs};
use crate::cli::exit::{self, Failure, Reply, Result};
use crate::cli::Context;
use clap::Args;
use estimate::card::ModelCard;
use estimate::{load, report, Data};
use estimator::estimator::Estimator;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Entries of the rotation to the base may differ so much: it is found from other rows at another
/// rate.
const SAME_BASE: f64 = 1e-3;

/// Arguments of `estimate report`.
#[derive(Debug, Args)]
pub struct Report {
    /// Folder of an experiment
    data: PathBuf,
    /// Folder for tables and pictures
    #[arg(long, value_name = "DIR")]
    into: PathBuf,
    /// More trials of the same robot: all models are tested on them too
    #[arg(long, value_name = "DIR")]
    unseen: Option<PathBuf>,
    /// Other data on which the shipped model is tried, as NAME=FOLDER
    #[arg(long, value_name = "NAME=DIR")]
    also: Vec<report::Also>,
    /// Model files to show beside, for example of networks; trained on the same trials
    #[arg(long, value_name = "FILE")]
    with: Vec<PathBuf>,
    /// Data of three-dimensional forces
    #[arg(long, value_name = "DIR")]
    three_axes: Option<PathBuf>,
    /// Minutes of training of the study of input groups, from the beginnings of the trials
    /// [default: all]
    #[arg(long, value_name = "M", value_parser = clap::value_parser!(u32).range(1..))]
    group_minutes: Option<u32>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    #[command(flatten)]
    read: DataArgs,
}

impl From<report::ReportError> for Failure {
    fn from(error: report::ReportError) -> Self {
        let code = match &error {
            report::ReportError::File { .. } => exit::FILE,
            _ => exit::USAGE,
        };
        Self::new(code, error)
    }
}

impl Report {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        // First, because it is quick and the rest is not.
        report::probe(&self.into)?;
        let data = self.read.load(context, &self.data)?;
        let mut also = Vec::new();
        for set in &self.also {
            also.push((set.name.clone(), self.read.load(context, &set.folder)?));
        }
        let three_axes = self
            .three_axes
            .as_ref()
            .map(|dir| self.read.load(context, dir))
            .transpose()?;
        let (training, test) = data.split(&[])?;
        let mut trained = Vec::new();
        for path in &self.with {
            trained.push(beside(path, &data, &training)?);
        }
        let unseen = match &self.unseen {
            Some(dir) => Some(self.same_robot(context, dir, &data)?),
            None => None,
        };
        let settings = report::Settings {
            training,
            test,
            seed: self.seed,
            trained,
            group_minutes: self.group_minutes.map(f64::from),
        };
        let inputs = report::Inputs {
            data: &data,
            unseen: unseen.as_ref(),
            also: &also,
            three_axes: three_axes.as_ref(),
        };
        let written = report::write(&self.into, &inputs, &settings, &mut |text| {
            context.output.note(text)
        })?;
        Ok(Reply::new(written.text.clone(), json!(written.results)))
    }

    /// More trials of the robot of `data`, none of them the same.
    fn same_robot(&self, context: &Context, dir: &Path, data: &Data) -> Result<Data> {
        let more = self.read.load(context, dir)?;
        if more.robot != data.robot || more.axes != data.axes {
            return Err(Failure::usage(format!(
                "--unseen {}: it is of the robot `{}`, components {:?}; {} is of `{}`, components {:?}. Give other robots with --also",
                more.name, more.robot, more.axes, data.name, data.robot, data.axes
            )));
        }
        let known = |s: &load::Source| data.sources.iter().any(|k| k.sha256 == s.sha256);
        if let Some(same) = more.sources.iter().find(|s| known(s)) {
            return Err(Failure::usage(format!(
                "--unseen {}: {} is a file of {} too",
                more.name, same.file, data.name
            )));
        }
        Ok(more)
    }
}

/// A model that was trained before, and the time of its training. Its training must be that of the
/// report, or the table would compare models that know different trials.
fn beside(path: &Path, data: &Data, training: &[usize]) -> Result<(Estimator, f64)> {
    let estimator = model(path)?;
    load::check_robot(&estimator, &data.robot, false)?;
    let card = ModelCard::read(path)?;
    let differences = differences(&estimator, &card, data, training)?;
    if !differences.is_empty() {
        return Err(Failure::usage(format!(
            "--with {}: it was not trained as the report trains, so their figures cannot be compared. The model and the report differ in: {}. Train it again on {}",
            path.display(),
            differences.join("; "),
            data.name
        )));
    }
    Ok((estimator, card.training_s))
}

/// What of a model's training is not that of the report, for people.
fn differences(
    estimator: &Estimator,
    card: &ModelCard,
    data: &Data,
    training: &[usize],
) -> Result<Vec<String>> {
    let mut found = Vec::new();
    let mut differ = |differs: bool, what: String| {
        if differs {
            found.push(what);
        }
    };
    let step_s = data.sequences.first().map_or(0.0, |s| s.step_s);
    differ(
        (estimator.step_s - step_s).abs() > 1e-9,
        format!(
            "rate ({:.2} Hz, {:.2} Hz)",
            1.0 / estimator.step_s,
            1.0 / step_s
        ),
    );
    differ(
        estimator.axes != data.axes,
        format!(
            "components of the force ({:?}, {:?}; 0 is x)",
            estimator.axes, data.axes
        ),
    );
    let turned = estimator.base.distance(&data.base(training)?);
    differ(
        turned > SAME_BASE,
        format!("direction of the robot's base (by {turned:.4})"),
    );
    differ(
        estimator.absent != data.absent,
        format!("absent inputs ({:?}, {:?})", estimator.absent, data.absent),
    );
    differ(
        card.training_trials != training,
        format!("trials ({:?}, {training:?})", card.training_trials),
    );
    differ(
        card.sources != data.sources,
        format!("files ({}, {})", card.data, data.name),
    );
    Ok(found)
}
