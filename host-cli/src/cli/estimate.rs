//! `forcectl estimate`: contact force from the state of a robot, without a force sensor.

mod explain;
pub mod live;
mod report;
pub mod robot;

use super::exit::{self, Failure, Reply, Result};
use super::output::path_json;
use super::values::AXES;
use super::Context;
use clap::{Args, Subcommand};
use estimate::card::{newtons, percent, ModelCard, Run};
use estimate::evaluate::{Replay, Streamed};
use estimate::explain::JOINTS;
use estimate::{self, evaluate, load, Data};
use estimator::data::{Label, Mapping};
use estimator::estimator::{Estimator, Keep, Kind, NetworkLimits, Training};
use estimator::model::Progress;
use estimator::sequence::Sequence;
use estimator::trees::TreesConfig;
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Below the help of the command.
pub const HELP: &str = "\
Examples:
  forcectl estimate train lab-day --model hybrid --out arm.model    trains, tests on the last trials, writes model and card
  forcectl estimate eval arm.model other-day                        figures on trials that the model has not seen
  forcectl estimate run arm.model --replay log.parquet              force of each row of a log
  forcectl estimate run arm.model --robot my.toml                   live, from the source that [robot] of the file names
  forcectl estimate recalibrate arm.model free.parquet --out today.model    adapts a model to its robot of today
  forcectl estimate explain arm.model other-day                     what has changed of each motor, in words
  forcectl estimate report lab-day --into docs                      all models, tables and pictures

A file that is written (--out, --plot) may not be one that is read, nor lie in a folder of data that are read.

docs/estimation.md explains the models and what they reach.

Exit codes: 0 done; 2 arguments, data or model are refused, with file and column; 4 the robot's source cannot be opened;
6 `run` had no row with a valid estimate; 7 a file cannot be written.";

/// Arguments of `estimate`.
#[derive(Debug, Args)]
pub struct Estimate {
    #[command(subcommand)]
    command: Sub,
}

#[derive(Debug, Subcommand)]
enum Sub {
    /// Train a model and write it with its card
    Train(Train),
    /// Figures of a model on data
    Eval(Eval),
    /// Estimate live, or row by row from a log
    Run(live::Live),
    /// Adapt a model to its robot of today, from a minute of free motion
    Recalibrate(Recalibrate),
    /// Say in words what has changed of each motor, from trials with or without a force
    Explain(explain::Explain),
    /// Write a network as ONNX, with a card of its inputs and outputs
    Export(Export),
    /// Train and compare all models, and write the tables and pictures
    Report(report::Report),
}

/// How data are read.
#[derive(Debug, Args)]
struct DataArgs {
    /// Rows per second; the data's rate is a multiple of it, to 2 %
    #[arg(long, value_name = "HZ", default_value = "50")]
    rate: f64,
    /// Mapping file (TOML) for logs other than an experiment's dataset: columns and
    /// their units
    #[arg(long, value_name = "FILE")]
    mapping: Option<PathBuf>,
}

/// Arguments of `estimate train`.
#[derive(Debug, Args)]
struct Train {
    /// Folder of an experiment or of logs, or a log
    data: PathBuf,
    /// Model: zero, mean, linear, trees, physics or hybrid; with `--features networks` also mlp,
    /// gru, lstm, convolution, carried-gru
    #[arg(long, value_name = "NAME", default_value = "hybrid", value_parser = kind)]
    model: Kind,
    /// Model file to write; its card lies beside it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Trials for testing, as in 8,9 [default: the last two of nine, as in the thesis]
    #[arg(long, value_name = "N,N", value_delimiter = ',')]
    test: Vec<usize>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// Passes of a network through the training rows [default: 50, as in the thesis]
    #[arg(long, value_name = "N")]
    epochs: Option<usize>,
    /// Time after which a network's training ends, s
    #[arg(long, value_name = "SECONDS", value_parser = crate::cli::values::seconds)]
    limit: Option<f64>,
    /// Go on with a network's training that was broken off or ended by --limit, from the last
    /// whole pass in FILE.training beside the model file
    #[arg(long)]
    resume: bool,
    /// Train a network on an NVIDIA GPU (built with `--features cuda`)
    #[arg(long)]
    gpu: bool,
    /// No intervals: the model is trained once, not once more for each trial
    #[arg(long)]
    no_intervals: bool,
    /// Estimate all three components, also where the experiment pulls along one axis
    #[arg(long)]
    all_axes: bool,
    #[command(flatten)]
    read: DataArgs,
}

/// Arguments of `estimate eval`.
#[derive(Debug, Args)]
struct Eval {
    /// Model file
    model: PathBuf,
    /// Folder of an experiment or of logs, or a log
    data: PathBuf,
    /// Trials [default: those that the model was not trained on]
    #[arg(long, value_name = "N,N", value_delimiter = ',')]
    trials: Vec<usize>,
    /// Let the replay of each trial begin anew at so many more places
    #[arg(long, value_name = "N", default_value = "0")]
    starts: usize,
    /// Let so many gaps of 0.06 to 3 s be in the replay of each trial
    #[arg(long, value_name = "N", default_value = "0")]
    gaps: usize,
    /// Seed of the places of starts and gaps
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// Use the model although it was trained on another robot
    #[arg(long)]
    any_robot: bool,
    /// Mapping file (TOML)
    #[arg(long, value_name = "FILE")]
    mapping: Option<PathBuf>,
}

/// Arguments of `estimate recalibrate`.
#[derive(Debug, Args)]
struct Recalibrate {
    /// Model file: physics or hybrid
    model: PathBuf,
    /// Log of a minute in which all three joints move and nothing touches the tool
    log: PathBuf,
    /// Model file to write; its card lies beside it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Use the log although it is of another robot
    #[arg(long)]
    any_robot: bool,
    /// Mapping file (TOML) of the log
    #[arg(long, value_name = "FILE")]
    mapping: Option<PathBuf>,
}

/// Measured force above which a log is not of free motion, N RMS: some times the noise of the load
/// cells.
const FREE_N: f64 = 0.2;
/// Force that a minute of free motion may leave, per RMS error of the test trials. In the guide's
/// hour 0.18 N are left by a model with an MAE of 0.14 N; 4 N on the tool that nobody measured left
/// 0.87 N by one with 0.24 N.
const LEFT: f64 = 2.0;
/// Widths of the intervals after it, per those before, from which a log tells little. A choice: at
/// the usual speeds they were 0.8 to 1.1 times as wide on an arm that had not changed, at a quarter
/// of these up to 1.9 times (`--example robots`' arms, seeds 11 to 13).
const WIDER: f64 = 1.5;

impl Recalibrate {
    fn run(&self, context: &Context) -> Result<Reply> {
        let inputs = inputs(&[&self.model, &self.log], self.mapping.as_deref());
        check_model(&self.out, &inputs)?;
        let mut estimator = model(&self.model)?;
        let card = ModelCard::read(&self.model)?;
        // Free motion needs no measured force. One that is there tells whether it was free.
        let mut data = read(
            context,
            &self.log,
            self.mapping.as_ref(),
            1.0 / estimator.step_s,
            Label::WhereThere,
        )?;
        self.check_free(&data)?;
        load::check_robot(&estimator, &data.robot, self.any_robot)?;
        data.fit_inputs(&estimator).map_err(Failure::usage)?;
        let free: Vec<&Sequence> = data.sequences.iter().collect();
        let found = estimator.recalibrate(&free).map_err(Failure::usage)?;
        write_model(&estimator, &self.out)?;
        let usual_n = card.evaluation.as_ref().map(|e| e.figures.rmse_n);
        let written = card
            .recalibrated(sha256(&self.out)?, &data.name)
            .write(&self.out)
            .map_err(|error| Failure::file(&self.out, &error))?;
        let mut text = format!(
            "estimated force where there is none: {:.3} N RMS before, {:.3} N after\n",
            found.before_n, found.after_n
        );
        if found.after_n >= found.before_n {
            row!(
                text,
                "this log shows no change that the recalibration makes better: the model from before fits it as well"
            );
        }
        if let Some([before_n, after_n]) = found.half_widths_n {
            row!(
                text,
                "intervals in this log: +-{before_n:.3} N before, +-{after_n:.3} N after"
            );
            if after_n > WIDER * before_n {
                row!(
                    text,
                    "this log leaves much unknown: move the joints faster, or for longer"
                );
            }
        }
        row!(
            text,
            "joint        offset            friction, %     gain, %        ripple, %   asymmetry, %"
        );
        for (i, c) in found.changes.iter().enumerate() {
            let [offset, friction, gain, asymmetry] = c.deviation;
            row!(
                text,
                "{:<9} {:>7.3} +- {offset:.3} {:<3} {:>6.1} +- {:.1}   {:>5.1} +- {:.1}   {:>8.1}   {:>6.1} +- {:.1}",
                JOINTS[i].0,
                c.offset,
                JOINTS[i].1,
                100.0 * c.friction,
                100.0 * friction,
                100.0 * c.gain,
                100.0 * gain,
                100.0 * c.ripple,
                100.0 * c.asymmetry,
                100.0 * asymmetry
            );
        }
        for (i, change) in found.changes.iter().enumerate() {
            let (joint, unit) = JOINTS[i];
            let sure = change.surely(unit);
            if !sure.is_empty() {
                row!(text, "{joint}: {}", sure.join("; "));
            }
        }
        row!(
            text,
            "model {}, card {}",
            self.out.display(),
            written.display()
        );
        let reply = Reply::new(text, json!(found));
        let mut doubts = Vec::new();
        if let Some([x, y, z]) = found.force_n {
            doubts.push(format!(
                "a constant force of ({x:.1}, {y:.1}, {z:.1}) N on the tool explains this log better than changes of the robot alone: something touched the tool, or it is another tool, of another weight, or the joints were where the training was not"
            ));
        }
        if let Some(usual_n) = usual_n.filter(|usual_n| found.after_n > LEFT * usual_n) {
            doubts.push(format!(
                "{:.3} N are left where there is no force, more than {LEFT} times the error of the test trials ({usual_n:.3} N RMS): something touched the tool, or the robot changed in another way than a recalibration knows",
                found.after_n
            ));
        }
        for doubt in &doubts {
            context.output.note(&format!(
                "{doubt}; the model is written, and is not to be trusted"
            ));
        }
        Ok(match doubts.is_empty() {
            true => reply,
            false => reply.with_code(exit::DEGRADED),
        })
    }

    /// Refuses a log with a force on the tool.
    fn check_free(&self, data: &Data) -> Result<()> {
        let forces = data.sequences.iter().flat_map(|s| s.target.chunks_exact(3));
        let (mut square, mut rows) = (0.0, 0_usize);
        for force in forces.filter(|force| force.iter().any(|f| f.is_finite())) {
            let measured = force.iter().filter(|f| f.is_finite());
            square += measured.map(|f| f64::from(*f).powi(2)).sum::<f64>();
            rows += 1;
        }
        let rms_n = (square / rows.max(1) as f64).sqrt();
        if rms_n <= FREE_N {
            return Ok(());
        }
        Err(Failure::usage(format!(
            "{}: there was a force of {rms_n:.2} N RMS on the tool, and a recalibration takes every torque for the robot's own: move all three joints back and forth for a minute with nothing at the tool",
            self.log.display()
        )))
    }
}

/// Arguments of `estimate export`.
#[derive(Debug, Args)]
struct Export {
    /// Model file of a network
    model: PathBuf,
    /// ONNX file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Export {
    fn run(&self) -> Result<Reply> {
        let estimator = model(&self.model)?;
        let card = beside_onnx(&self.out);
        for out in [&self.out, &card] {
            files::check_output(out, &[&self.model])?;
        }
        estimator.write_onnx(&self.out).map_err(Failure::usage)?;
        let text = estimator
            .onnx_card(&sha256(&self.model)?, &sha256(&self.out)?)
            .map_err(Failure::usage)?;
        std::fs::write(&card, text + "\n").map_err(|error| Failure::file(&card, &error))?;
        let text = format!(
            "{} written, inputs and outputs in {}\n",
            self.out.display(),
            card.display()
        );
        Ok(Reply::new(
            text,
            json!({"file": path_json(&self.out), "card": card}),
        ))
    }
}

/// The card of an ONNX file: `.card.json` after its whole name.
fn beside_onnx(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".card.json");
    out.with_file_name(name)
}

fn kind(name: &str) -> std::result::Result<Kind, String> {
    Kind::of(name).ok_or_else(|| {
        let names: Vec<&str> = Kind::ALL
            .iter()
            .chain(&Kind::NETWORKS)
            .map(|k| k.name())
            .collect();
        format!("there is no model `{name}`; there are {}", names.join(", "))
    })
}

impl From<estimate::LoadError> for Failure {
    fn from(error: estimate::LoadError) -> Self {
        Self::new(exit::USAGE, error)
    }
}

/// What a command reads: its files and folders, and a mapping file. A file of a dataset stands for
/// the folder with its data card: another file there is a trial, or would be taken for one.
fn inputs<'a>(read: &[&'a Path], mapping: Option<&'a Path>) -> Vec<&'a Path> {
    let whole = |path: &&'a Path| -> &'a Path {
        let folder = files::folder_of(path);
        let dataset = path.is_file() && folder.join("card.json").is_file();
        if dataset {
            folder
        } else {
            path
        }
    };
    read.iter().map(whole).chain(mapping).collect()
}

/// Refuses a model file that, with its card, would replace an input.
fn check_model(out: &Path, inputs: &[&Path]) -> Result<()> {
    for file in [out.to_owned()].into_iter().chain(ModelCard::files(out)) {
        files::check_output(&file, inputs)?;
    }
    Ok(())
}

/// Writes a model file, which is there whole or as it was before.
fn write_model(model: &Estimator, out: &Path) -> Result<()> {
    let text = model
        .to_json()
        .map_err(|error| Failure::new(exit::FILE, error))?;
    files::replace(out, text).map_err(|error| Failure::file(out, &error))
}

/// The mapping file, or the dataset's columns.
fn mapping(file: Option<&PathBuf>) -> Result<Mapping> {
    Ok(match file {
        Some(file) => load::mapping(file)?,
        None => Mapping::default(),
    })
}

/// Reads a model file.
///
/// # Errors
/// It can't be read, or is no model of this version.
pub fn model(path: &Path) -> Result<Estimator> {
    let text = files::open(path)
        .and_then(std::io::read_to_string)
        .map_err(|error| Failure::usage(format!("{}: {error}", path.display())))?;
    Estimator::from_json(&text)
        .map_err(|error| Failure::usage(format!("{}: {error}", path.display())))
}

impl Estimate {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        match &self.command {
            Sub::Train(command) => command.run(context),
            Sub::Eval(command) => command.run(context),
            Sub::Run(command) => command.run(context),
            Sub::Recalibrate(command) => command.run(context),
            Sub::Explain(command) => command.run(context),
            Sub::Export(command) => command.run(),
            Sub::Report(command) => command.run(context),
        }
    }
}

/// Reads logs, and says what was left out of them.
fn read(
    context: &Context,
    path: &Path,
    words: Option<&PathBuf>,
    rate_hz: f64,
    label: Label,
) -> Result<Data> {
    let data = load::load(path, &mapping(words)?, rate_hz, label)?;
    data.losses().iter().for_each(|l| context.output.note(l));
    Ok(data)
}

impl DataArgs {
    fn load(&self, context: &Context, path: &Path) -> Result<Data> {
        if !(1.0..=1000.0).contains(&self.rate) {
            return Err(Failure::usage(format!(
                "--rate {}: allowed are 1 to 1000 Hz",
                self.rate
            )));
        }
        read(
            context,
            path,
            self.mapping.as_ref(),
            self.rate,
            Label::Needed,
        )
    }
}

impl Train {
    fn run(&self, context: &Context) -> Result<Reply> {
        check_model(
            &self.out,
            &inputs(&[&self.data], self.read.mapping.as_deref()),
        )?;
        let data = self.read.load(context, &self.data)?;
        let (training, test) = data.split(&self.test)?;
        let rows: Vec<&Sequence> = data.of(&training);
        // Now, and not after the minutes of a training that would be lost.
        evaluate::testable(&data.of(&test)).map_err(Failure::usage)?;
        estimate::report::probe_file(&self.out)?;
        let keep = self.keep()?;
        let settings = Training {
            kind: self.model,
            axes: if self.all_axes {
                vec![0, 1, 2]
            } else {
                data.axes.clone()
            },
            base: data.base(&training)?,
            robot: data.robot.clone(),
            trees: TreesConfig {
                seed: self.seed,
                ..TreesConfig::default()
            },
            networks: NetworkLimits {
                epochs: self.epochs,
                limit_s: self.limit,
                gpu: self.gpu,
                keep: keep.clone(),
            },
            intervals: !self.no_intervals,
            absent: data.absent.clone(),
        };
        if data.robot == load::UNNAMED {
            context.output.note(NO_NAME);
        }
        let began = Instant::now();
        let trained = Estimator::train(&settings, &rows, &mut |p: &Progress| {
            context.output.note(&p.text)
        })
        .map_err(Failure::usage)?;
        let run = Run {
            training,
            test,
            seed: self.seed,
            training_s: began.elapsed().as_secs_f64(),
        };
        let unseen = data.of(&run.test);
        let evaluation = evaluate::evaluate(&trained, &unseen, &Replay::default())
            .map_err(Failure::usage)?
            .0;
        // From here on Ctrl-C must not leave a model without its card.
        let _controlled_stop = context.interrupt.controlled_stop();
        write_model(&trained, &self.out)?;
        // A training that the limit ended can go on.
        if let (Some(keep), Some(false)) = (keep, trained.epochs().map(|epochs| epochs.cut)) {
            std::fs::remove_file(&keep.file).map_err(|error| Failure::file(&keep.file, &error))?;
        }
        let sha = sha256(&self.out)?;
        let card = ModelCard::new(&trained, sha, &data, &run, Some(evaluation));
        let written = card
            .write(&self.out)
            .map_err(|error| Failure::file(&self.out, &error))?;
        let mut text = card
            .markdown()
            .lines()
            .take_while(|l| !l.starts_with("## "))
            .collect::<Vec<_>>()
            .join("\n");
        row!(
            text,
            "\nmodel {}, card {}",
            self.out.display(),
            written.display()
        );
        Ok(Reply::new(text, json!(card)))
    }
}

impl Train {
    /// Where a network's training is kept.
    fn keep(&self) -> Result<Option<Keep>> {
        if !self.model.is_network() {
            return if self.resume {
                Err(Failure::usage(format!(
                    "--resume: `{}` is no network and trains in one go; leave it out",
                    self.model.name()
                )))
            } else {
                Ok(None)
            };
        }
        let mut file = self.out.clone().into_os_string();
        file.push(".training");
        let (file, resume) = (PathBuf::from(file), self.resume);
        if !resume && file.exists() {
            return Err(Failure::usage(format!(
                "{}: a training was broken off there: --resume goes on with it; remove the file to begin anew",
                file.display()
            )));
        }
        Ok(Some(Keep { file, resume }))
    }
}

impl Eval {
    fn run(&self, context: &Context) -> Result<Reply> {
        let estimator = model(&self.model)?;
        let mut data = read(
            context,
            &self.data,
            self.mapping.as_ref(),
            1.0 / estimator.step_s,
            Label::Needed,
        )?;
        load::check_robot(&estimator, &data.robot, self.any_robot)?;
        data.fit_inputs(&estimator).map_err(Failure::usage)?;
        let trials = if self.trials.is_empty() {
            self.unseen(&data)?
        } else {
            self.warn_of_trained(context, &data);
            self.trials.clone()
        };
        let sequences = data.of(&trials);
        if sequences.is_empty() {
            return Err(Failure::usage(format!(
                "{}: no trial is left to evaluate (it has {:?}); name some with --trials",
                data.name,
                data.trials()
            )));
        }
        let replay = Replay {
            starts: self.starts,
            gaps: self.gaps,
            seed: self.seed,
        };
        let (evaluation, _) =
            evaluate::evaluate(&estimator, &sequences, &replay).map_err(Failure::usage)?;
        let mut text = String::new();
        let f = &evaluation.figures;
        // One trial has no interval over trials.
        let mae = match f.mae_half_n {
            Some(half_n) => format!("{:.3} +- {half_n:.3} N (95 % over trials)", f.mae_n),
            None => format!("{:.3} N", f.mae_n),
        };
        row!(
            text,
            "model {} on {}, trials {:?}, {} rows",
            estimator.kind.name(),
            data.name,
            evaluation.trials,
            f.rows
        );
        row!(text, "MAE            {mae}");
        row!(
            text,
            "RMSE           {:.3} N, NRMSE {}",
            f.rmse_n,
            percent(f.nrmse)
        );
        row!(
            text,
            "turning round  {} N, sliding {} N",
            newtons(evaluation.mae_reversing_n),
            newtons(evaluation.mae_sliding_n)
        );
        if evaluation.mae_by_component_n.len() > 1 {
            let by: Vec<String> = (estimator.axes.iter())
                .zip(&evaluation.mae_by_component_n)
                .map(|(axis, mae_n)| format!("{} {mae_n:.3} N", AXES[*axis]))
                .collect();
            row!(text, "MAE by axis    {}", by.join(", "));
        }
        if let Some(covered) = evaluation.covered {
            row!(text, "90 % interval  covers {:.1} %", 100.0 * covered);
        }
        row!(
            text,
            "step           {:.1} us median, {:.1} us p99",
            evaluation.step.median_us,
            evaluation.step.p99_us
        );
        row!(text, "speed below, mm/s   MAE, N   rows   covered, %");
        for bin in &evaluation.by_speed {
            let covered = bin
                .covered
                .map_or_else(|| "-".to_owned(), |c| format!("{:.1}", 100.0 * c));
            row!(
                text,
                "{:>17.1}   {:>6}   {:>6}   {covered}",
                bin.below_m_per_s * 1e3,
                newtons(bin.mae_n),
                bin.rows
            );
        }
        if let Some(streamed) = &evaluation.stream {
            text += &stream_lines(streamed);
        }
        Ok(Reply::new(text, json!(evaluation)))
    }

    /// Warns where a trial that is named was in the training. Without a card nothing tells.
    fn warn_of_trained(&self, context: &Context, data: &Data) {
        let Ok(card) = ModelCard::read(&self.model) else {
            return;
        };
        let trained: Vec<String> = (self.trials.iter())
            .filter(|trial| {
                let of_trial = |s: &&load::Source| s.trials.contains(trial);
                (data.sources.iter().filter(of_trial)).any(|s| is_trained(&card, s, Some(**trial)))
            })
            .map(ToString::to_string)
            .collect();
        if !trained.is_empty() {
            context.output.note(&format!(
                "the model was trained on trial {} of these data: the figures tell how well it repeats what it has seen, and not how well it estimates",
                trained.join(", ")
            ));
        }
    }

    /// Trials that the model's card does not list as training of these same files.
    fn unseen(&self, data: &Data) -> Result<Vec<usize>> {
        let card = ModelCard::read(&self.model).map_err(|error| {
            Failure::usage(format!("{error}, or name unseen trials with --trials"))
        })?;
        let fresh = (data.sources.iter()).filter(|s| !is_trained(&card, s, None));
        let mut trials: Vec<usize> = fresh.flat_map(|s| s.trials.iter().copied()).collect();
        trials.sort_unstable();
        trials.dedup();
        Ok(trials)
    }
}

/// Whether a model was trained on this trial of a file, or on any (`None`), as its card tells. The
/// file is the same by its hash; its trials may be numbered anew.
fn is_trained(card: &ModelCard, source: &load::Source, trial: Option<usize>) -> bool {
    let in_training = |trial: &usize| card.training_trials.contains(trial);
    (card.sources.iter())
        .filter(|known| known.sha256 == source.sha256)
        .any(|known| match trial {
            Some(trial) if known.trials == source.trials => in_training(&trial),
            _ => known.trials.iter().any(in_training),
        })
}

/// The replay row by row, from the first row of each stretch.
fn stream_lines(s: &Streamed) -> String {
    let mut text = String::new();
    row!(
        text,
        "row by row, {} starts and {} gaps: valid {:.1} % of the time",
        s.starts,
        s.gaps,
        100.0 * s.valid_share
    );
    if let Some([half, most]) = s.until_valid_s {
        row!(
            text,
            "valid          after {half:.2} s (median), {most:.2} s (95 %) from a start or a gap; {} ended before",
            s.never_valid
        );
    }
    let alarms: Vec<f64> = s.misfits_s.iter().copied().flatten().collect();
    if !alarms.is_empty() {
        let first_s = alarms.iter().copied().fold(f64::INFINITY, f64::min);
        row!(
            text,
            "the model no longer fits this robot in {} of {} trials, at the earliest from {first_s:.0} s: see `forcectl estimate recalibrate`",
            alarms.len(),
            s.misfits_s.len()
        );
    }
    row!(
        text,
        "                     rows   MAE, N   covered, %   half width, N"
    );
    for (name, rows) in [
        ("all rows", &s.all),
        ("valid rows", &s.valid),
        ("of these in 1 s", &s.early),
    ] {
        let covered = rows
            .covered
            .map_or_else(|| "-".to_owned(), |c| format!("{:.1}", 100.0 * c));
        row!(
            text,
            "{name:<15}   {:>7}   {:>6}   {covered:>10}   {:>13}",
            rows.rows,
            newtons(rows.mae_n),
            newtons(rows.half_width_n)
        );
    }
    text
}

/// Told where nothing names the robot of the training.
const NO_NAME: &str = "neither [robot] of the experiment nor a mapping file names this robot: nothing will tell a model of it from that of another one. Give `name` in [robot], or `robot` in the mapping file";

fn sha256(path: &Path) -> Result<String> {
    files::sha256(path).map_err(|error| Failure::usage(format!("{}: {error}", path.display())))
}
