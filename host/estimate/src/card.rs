//! The card of a model: what it was trained on, what it reached, what it is not for. It lies beside
//! the model file.

use super::evaluate::{unlike_trials, Evaluation};
use super::load::{Data, LoadError, Sampling, Source};
use estimator::estimator::Estimator;
use estimator::model::Epochs;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// See the module's page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelCard {
    /// Model.
    pub model: String,
    /// SHA-256 of the model file.
    pub model_sha256: String,
    /// Program.
    pub program: String,
    /// Robot.
    pub robot: String,
    /// Rows per second.
    pub rate_hz: f64,
    /// Inputs in order, with units.
    pub inputs: Vec<String>,
    /// Outputs in order, with units.
    pub outputs: Vec<String>,
    /// Frame of the force.
    pub frame: String,
    /// Sign of the force.
    pub sign: String,
    /// Where the data came from.
    pub data: String,
    /// Its files.
    pub sources: Vec<Source>,
    /// Time of the label.
    pub sampling: Option<Sampling>,
    /// Trials for training.
    pub training_trials: Vec<usize>,
    /// Minutes of training.
    pub training_minutes: f64,
    /// Trials for testing.
    pub test_trials: Vec<usize>,
    /// Seed of the training.
    pub seed: u64,
    /// Trained parameters.
    pub parameters: usize,
    /// Time of the training, s; with intervals it holds the trainings of the folds.
    pub training_s: f64,
    /// How far the training of a network went. Cards of before have none.
    #[serde(default)]
    pub epochs: Option<Epochs>,
    /// What is to be looked at before the figures are believed. Cards of before have none.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// Figures on the test trials.
    pub evaluation: Option<Evaluation>,
    /// Ranges of the inputs in training. Outside of them the model has seen nothing.
    pub ranges: Vec<[f32; 2]>,
    /// What it is not for.
    pub limits: Vec<String>,
}

const AXES: [&str; 3] = ["force_x_n", "force_y_n", "force_z_n"];
const UNITS: [&str; 9] = [
    "rad", "rad", "m", "rad/s", "rad/s", "m/s", "N·m", "N·m", "N",
];

/// A share in percent, or that there is none.
#[must_use]
pub fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.2} %", 100.0 * s))
}

/// A figure in N, or that there is none.
#[must_use]
pub fn newtons(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |n| format!("{n:.3}"))
}

/// A file beside a model's: `.model` is left out of its name, any other end stays, since it may be
/// all that tells models apart.
fn beside(model: &Path, end: &str) -> PathBuf {
    if model.extension().is_some_and(|e| e == "model") {
        return model.with_extension(end);
    }
    let mut name = model.file_name().unwrap_or_default().to_owned();
    name.push(".");
    name.push(end);
    model.with_file_name(name)
}

/// What a training was.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Trials for training.
    pub training: Vec<usize>,
    /// Trials for testing.
    pub test: Vec<usize>,
    /// Seed.
    pub seed: u64,
    /// Time, s.
    pub training_s: f64,
}

impl ModelCard {
    /// The card of a trained model.
    #[must_use]
    pub fn new(
        estimator: &Estimator,
        model_sha256: String,
        data: &Data,
        run: &Run,
        evaluation: Option<Evaluation>,
    ) -> Self {
        let training = data.of(&run.training);
        let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; UNITS.len()];
        for row in training.iter().flat_map(|s| s.input.chunks_exact(s.inputs)) {
            for (range, v) in ranges.iter_mut().zip(row) {
                *range = [range[0].min(*v), range[1].max(*v)];
            }
        }
        let with_unit = |(input, (name, unit)): (usize, (&&str, &&str))| {
            if estimator.absent.contains(&input) {
                format!("{name} (absent)")
            } else {
                format!("{name} ({unit})")
            }
        };
        Self {
            model: estimator.kind.name().to_owned(),
            model_sha256,
            program: format!("forcectl {}", env!("CARGO_PKG_VERSION")),
            robot: estimator.robot.clone(),
            rate_hz: 1.0 / estimator.step_s,
            inputs: estimator::motion::INPUT_NAMES.iter().zip(&UNITS).enumerate().map(with_unit).collect(),
            outputs: estimator.axes.iter().map(|a| format!("{} (N)", AXES[*a])).collect(),
            frame: "that of the training data's force: the rig's robot base frame for an experiment".to_owned(),
            sign: "force on the tool".to_owned(),
            data: data.name.clone(),
            sources: data.sources.clone(),
            sampling: data.sampling,
            training_trials: run.training.clone(),
            training_minutes: Data::minutes(&training),
            test_trials: run.test.clone(),
            seed: run.seed,
            parameters: estimator.model().parameters(),
            training_s: run.training_s,
            epochs: estimator.epochs(),
            warnings: unlike_trials(estimator, &training).into_iter().collect(),
            evaluation,
            ranges,
            limits: vec![
                format!("For the robot `{}` alone, with the tool and payload of the training data.", estimator.robot),
                "Within the ranges of the training inputs; outside of them the error grows without a sign of it.".to_owned(),
                "The force may change as fast as in training. The memory of the physical model is 0.2 s: faster changes come late.".to_owned(),
                "After a start or a gap, until each joint has moved a few mrad, the state of the friction is not known: such estimates are marked invalid. The figures by speed leave out the first 10 s of each stretch.".to_owned(),
                "It is a measurement with an error, not a safety device.".to_owned(),
            ],
        }
    }

    /// The card of a model that was recalibrated on a log. The figures of the training are not its
    /// own.
    #[must_use]
    pub fn recalibrated(mut self, model_sha256: String, log: &str) -> Self {
        self.limits.insert(
            0,
            format!("Recalibrated on {log}; made of the model file {}. Figures of it need data of the robot of that day.", self.model_sha256),
        );
        self.model_sha256 = model_sha256;
        self.evaluation = None;
        self
    }

    /// Where the card of a model file lies: JSON and Markdown.
    #[must_use]
    pub fn files(model: &Path) -> [PathBuf; 2] {
        ["card.json", "card.md"].map(|end| beside(model, end))
    }

    /// Writes the card beside the model, as JSON and as Markdown; returns the Markdown's path.
    ///
    /// # Errors
    /// A file can't be written, or a figure is no finite number: such a card could not be read
    /// back.
    pub fn write(&self, model: &Path) -> std::io::Result<PathBuf> {
        let json = serde_json::to_string_pretty(self).map_err(std::io::Error::other)?;
        serde_json::from_str::<Self>(&json).map_err(|error| {
            std::io::Error::other(format!(
                "a figure of the model card is no finite number ({error}); check the range of the data"
            ))
        })?;
        let [card, page] = Self::files(model);
        std::fs::write(card, json + "\n")?;
        std::fs::write(&page, self.markdown())?;
        Ok(page)
    }

    /// Reads the card beside a model file.
    ///
    /// # Errors
    /// There is none, it is no card of this program's version, or that of another model file; the
    /// text says what to do.
    pub fn read(model: &Path) -> Result<Self, LoadError> {
        let path = beside(model, "card.json");
        let bad = |cause: String| {
            LoadError(format!(
                "{}: {cause}; the card tells on which trials the model was trained. Put it beside the model, or train the model again",
                path.display()
            ))
        };
        let text = ::files::read_text(&path).map_err(|error| bad(error.to_string()))?;
        let card: Self = serde_json::from_str(&text)
            .map_err(|error| bad(format!("it cannot be read as a model card: {error}")))?;
        let sha = files::sha256(model).map_err(|error| bad(error.to_string()))?;
        if sha != card.model_sha256 {
            return Err(bad(format!(
                "it is the card of another model file (SHA-256 {}, {} has {sha})",
                card.model_sha256,
                model.display()
            )));
        }
        Ok(card)
    }

    /// As Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        let mut line = |l: String| {
            // A String takes every line.
            let _ = writeln!(text, "{l}");
        };
        let list = |trials: &[usize]| {
            trials
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        };
        line(format!("# Model card: {}\n", self.model));
        line(format!(
            "Written by {}. Model file SHA-256 {}.\n",
            self.program, self.model_sha256
        ));
        line(format!("- **Robot**: {}", self.robot));
        line(format!(
            "- **Inputs**, {} rows per second: {}",
            self.rate_hz,
            self.inputs.join(", ")
        ));
        line(format!(
            "- **Output**: {}; {}; frame: {}",
            self.outputs.join(", "),
            self.sign,
            self.frame
        ));
        line(format!(
            "- **Training**: trials {} ({:.1} min) of {}; seed {}; {} parameters; {:.1} s",
            list(&self.training_trials),
            self.training_minutes,
            self.data,
            self.seed,
            self.parameters,
            self.training_s
        ));
        if let Some(epochs) = self.epochs {
            let cut = if epochs.cut {
                "; --limit ended the training: a longer one may give another figure"
            } else {
                ""
            };
            line(format!("- **Epochs**: {epochs}{cut}"));
        }
        for warning in &self.warnings {
            line(format!("- **Look at this first**: {warning}"));
        }
        if let Some(s) = &self.sampling {
            line(format!(
                "- **Label**: sample age at most {:.2} ms, uncertainty of the time between robot and board at most {:.3} ms",
                s.force_age_s * 1e3,
                s.sync_error_s * 1e3
            ));
        }
        if let Some(e) = &self.evaluation {
            let half = e
                .figures
                .mae_half_n
                .map_or_else(String::new, |h| format!(" ± {h:.3} N (95 %, over trials)"));
            line(format!(
                "- **Test**, trials {}: MAE {:.3} N{half}, RMSE {:.3} N, NRMSE {}; step {:.1} us (median), {:.1} us (p99)",
                list(&self.test_trials),
                e.figures.mae_n,
                e.figures.rmse_n,
                percent(e.figures.nrmse),
                e.step.median_us,
                e.step.p99_us
            ));
            line("\n| tip speed below, mm/s | MAE, N | rows | covered | half width, N |\n| --- | --- | --- | --- | --- |".to_owned());
            for bin in &e.by_speed {
                let covered = bin
                    .covered
                    .map_or_else(|| "-".to_owned(), |c| format!("{:.1} %", 100.0 * c));
                let width = newtons(bin.half_width_n);
                line(format!(
                    "| {:.1} | {} | {} | {covered} | {width} |",
                    bin.below_m_per_s * 1e3,
                    newtons(bin.mae_n),
                    bin.rows
                ));
            }
        }
        line("\n## Limits\n".to_owned());
        for limit in &self.limits {
            line(format!("- {limit}"));
        }
        line(
            "\n## Ranges in training\n\n| input | smallest | largest |\n| --- | --- | --- |"
                .to_owned(),
        );
        for (name, range) in self.inputs.iter().zip(&self.ranges) {
            line(format!("| {name} | {:.4} | {:.4} |", range[0], range[1]));
        }
        line("\n## Files\n\n| file | trials | SHA-256 |\n| --- | --- | --- |".to_owned());
        for source in &self.sources {
            line(format!(
                "| {} | {} | {} |",
                source.file,
                list(&source.trials),
                source.sha256
            ));
        }
        for loss in self.sources.iter().filter_map(Source::loss) {
            line(format!("\n{loss}"));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_whose_names_differ_in_their_ends_have_cards_of_their_own() {
        let name = |model: &str| beside(Path::new(model), "card.json").display().to_string();
        assert_eq!(name("a/arm.model"), "a/arm.card.json");
        assert_eq!(name("a/m.1"), "a/m.1.card.json");
        assert_eq!(name("a/m.2"), "a/m.2.card.json");
        assert_eq!(name("arm"), "arm.card.json");
    }
}
