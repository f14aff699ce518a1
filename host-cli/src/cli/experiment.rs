//! `forcectl experiment`: trials with a moving robot and a known force, and the dataset that comes
//! out.

use super::connection::Connection;
use super::exit::{self, Failure, Reply, Result};
use super::output::{path_json, Output};
use super::{values, Context};
use clap::{Args, Subcommand};
use experiment::{
    self, paths, plan, report, Attempt, Experiment, ExperimentError, Folder, Open, Options, Shard,
    Status, Summary, Watcher, THESIS,
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rig::{LinkChoice, Rig};
use robot::source::SourceConfig;
use run::Phase;
use serde_json::json;
use std::cell::{Cell, RefCell};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Below the help of the command.
pub const HELP: &str = "\
Examples:
  forcectl experiment check --print > my.toml      the experiment of the thesis, as a start for your own
  forcectl experiment run my.toml --out lab-day    all trials; Ctrl-C ends it, --resume goes on
  forcectl experiment run my.toml --out lab-day --trial 2/4    the second quarter of the trials
  forcectl experiment report lab-day               data card and report of what is there

docs/experiment.md explains the file, docs/dataset.md the columns.";

/// Arguments of `experiment`.
#[derive(Debug, Args)]
pub struct ExperimentCommand {
    #[command(subcommand)]
    command: Sub,
}

#[derive(Debug, Subcommand)]
enum Sub {
    /// Run the trials of an experiment file
    Run(Run),
    /// Check an experiment file: nothing is driven
    Check(Check),
    /// Write data card, report and pictures of an experiment's folder
    Report(Report),
    /// Compare the board with control through the Raven's software, on one virtual rig
    Paths(Paths),
}

/// Arguments of `experiment paths`.
#[derive(Debug, Args)]
struct Paths {
    /// Time for which each path holds the force
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = values::seconds)]
    duration: f64,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value = "1", value_parser = values::seed)]
    seed: u64,
}

/// Arguments of `experiment run`.
#[derive(Debug, Args)]
struct Run {
    /// Experiment file (TOML); the experiment of the thesis where it is left out
    file: Option<PathBuf>,
    /// Folder for all results; created where it does not exist
    #[arg(long, value_name = "DIR", default_value = "experiment-out")]
    out: PathBuf,
    /// One trial of one minute
    #[arg(long)]
    quick: bool,
    /// Every N-th trial, beginning with the I-th
    #[arg(long, value_name = "I/N", default_value = "1/1")]
    trial: Shard,
    /// Go on after a break: trials that are done stay, one that was broken off is marked and
    /// repeated
    #[arg(long)]
    resume: bool,
    /// Connection to the rig where the robot is not virtual: usb, serial:PORT, or rig:NAME
    /// [default: the rig file's]
    #[arg(long, value_name = "LINK", value_parser = values::link)]
    link: Option<LinkChoice>,
    /// Open the port in this process instead of through a service; others can't watch or stop then
    #[arg(long)]
    direct: bool,
    /// Write data card, report and pictures to this folder as well, without any data
    #[arg(long, value_name = "DIR")]
    report_into: Option<PathBuf>,
}

/// Arguments of `experiment check`.
#[derive(Debug, Args)]
struct Check {
    /// Experiment file (TOML)
    #[arg(required_unless_present = "print", conflicts_with = "print")]
    file: Option<PathBuf>,
    /// Print the experiment of the thesis, as a start for your own
    #[arg(long)]
    print: bool,
}

/// Arguments of `experiment report`.
#[derive(Debug, Args)]
struct Report {
    /// Folder of the experiment
    dir: PathBuf,
    /// Write data card, report and pictures to this folder as well, without any data
    #[arg(long, value_name = "DIR")]
    report_into: Option<PathBuf>,
}

impl From<ExperimentError> for Failure {
    fn from(error: ExperimentError) -> Self {
        let code = match &error {
            ExperimentError::File(_) | ExperimentError::Plan(_) | ExperimentError::Folder(_) => {
                exit::USAGE
            }
            ExperimentError::Rig(_) => exit::RIG_FILE,
            ExperimentError::Table(_) | ExperimentError::Record(_) => exit::FILE,
            ExperimentError::Link(_) | ExperimentError::Unreachable(_) => exit::LINK,
            ExperimentError::StoppedElsewhere(_) => exit::BOARD,
        };
        Self::new(code, error)
    }
}

impl ExperimentCommand {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        match &self.command {
            Sub::Run(command) => command.run(context),
            Sub::Check(command) => command.run(context),
            Sub::Report(command) => command.run(),
            Sub::Paths(command) => command.run(),
        }
    }
}

impl Run {
    fn run(&self, context: &Context) -> Result<Reply> {
        check_into(&self.out, self.report_into.as_deref())?;
        let experiment = load(self.file.as_ref())?;
        let experiment = if self.quick {
            experiment.quick()
        } else {
            experiment
        };
        let rig = experiment.load_rig().map_err(ExperimentError::from)?;
        // A trial with a virtual robot has a rig of its own, of which nothing is stored.
        let connection = match experiment.robot {
            SourceConfig::Virtual(_) => {
                refuse_rig(self.link.as_ref(), self.direct)?;
                None
            }
            _ => Some(Connection::of_experiment(
                &experiment,
                &rig,
                self.link.clone(),
                self.direct,
            )),
        };
        let rig = match &connection {
            Some(connection) => {
                let rig = connection.load(context)?;
                connection.require_rig_file(&rig)?;
                connection.require_unchanged(context)?;
                connection.stay(context)?;
                connection.calibrated(rig, context)?
            }
            None => rig,
        };
        if self.resume && !self.out.join("experiment.toml").is_file() {
            context.output.note(&format!(
                "--resume: {} holds no experiment, so all trials begin anew",
                self.out.display()
            ));
        }
        let _controlled_stop = context.interrupt.controlled_stop();
        let (failure, count) = (RefCell::new(None), Cell::new(0));
        let open = connection.as_ref().map(|connection| {
            || {
                let link = connection.open_again(&rig, count.replace(count.get() + 1), context);
                let link = link.map_err(|why| {
                    let message = why.message.clone();
                    if why.code == exit::BOARD {
                        return ExperimentError::StoppedElsewhere(message);
                    }
                    *failure.borrow_mut() = Some(why);
                    ExperimentError::Unreachable(message)
                })?;
                Ok((link, connection.zeroing()))
            }
        });
        let options = Options {
            shard: self.trial,
            resume: self.resume,
            open: open.as_ref().map(|open| open as &Open<'_>),
            stop: context.interrupt.flag(),
        };
        let mut progress = Progress::new(
            &context.output,
            experiment.trial_s(),
            self.trial.trials(experiment.trials).len(),
        );
        let summary = experiment::run(&experiment, &rig, &self.out, &options, &mut progress);
        let summary = match failure.take() {
            Some(why) => return Err(why),
            None => summary?,
        };
        progress.done();
        let mut text = table(&summary, &experiment);
        if let Some(who) = &summary.stopped {
            row!(text, "ended               {who}");
        }
        let code = if summary.stopped.is_some() {
            exit::BOARD
        } else if summary.interrupted {
            exit::INTERRUPTED
        } else if summary.good.len() < summary.trials.len() {
            exit::DEGRADED
        } else {
            exit::DONE
        };
        if summary.left.is_empty() {
            let (folder, experiment) = Folder::open(&self.out)?;
            row!(
                text,
                "{}",
                written(&folder, &experiment, self.report_into.as_ref())?
            );
        } else {
            let left: Vec<String> = summary.left.iter().map(ToString::to_string).collect();
            row!(
                text,
                "left to do          trials {} (--resume)",
                left.join(", ")
            );
        }
        Ok(Reply::new(text, json!(summary)).with_code(code))
    }
}

/// Refuses a rig that exists for a virtual robot, which it would not be driven by.
fn refuse_rig(link: Option<&LinkChoice>, direct: bool) -> Result<()> {
    let option = match link {
        None | Some(LinkChoice::Embedded | LinkChoice::Fast) if !direct => return Ok(()),
        Some(link) => format!("--link {link}"),
        None => "--direct".to_owned(),
    };
    Err(Failure::usage(format!(
        "the robot is virtual, and its trials run on a rig of their own; leave {option} out, or name another kind in [robot]; nothing was driven"
    )))
}

impl Check {
    fn run(&self, context: &Context) -> Result<Reply> {
        let Some(file) = &self.file else {
            context.output.refuse_json("`experiment check --print`")?;
            return Ok(Reply::text(THESIS));
        };
        let experiment = load(Some(file))?;
        let rig = experiment.load_rig().map_err(ExperimentError::from)?;
        let trials: Vec<usize> = (1..=experiment.trials).collect();
        let places = plan::examine(&experiment, &rig, &trials).map_err(ExperimentError::from)?;
        let mut text = String::new();
        row!(
            text,
            "{}: no mistakes found. Experiment `{}`, {} trials of {} min, hash {}",
            file.display(),
            experiment.name,
            experiment.trials,
            experiment.minutes,
            experiment.hash()
        );
        row!(
            text,
            "every force and pose is within reach, at all {places} places examined"
        );
        let json = json!({
            "file": file, "name": experiment.name, "hash": experiment.hash(), "experiment": experiment,
            "rig_hash": rig.hash(), "places_examined": places
        });
        Ok(Reply::new(text, json))
    }
}

impl Report {
    fn run(&self) -> Result<Reply> {
        check_into(&self.dir, self.report_into.as_deref())?;
        let (folder, experiment) = Folder::open(&self.dir)?;
        let text = written(&folder, &experiment, self.report_into.as_ref())?;
        let json = json!({ "folder": path_json(&self.dir), "text": text });
        Ok(Reply::new(format!("{text}\n"), json))
    }
}

/// Force that both paths hold, N.
const PATHS_FORCE_N: [f64; 3] = [0.0, 2.5, 0.0];
/// Delays of ROS and USB that the Raven's path is tried with, ms.
const TRANSPORT_MS: [u32; 3] = [0, 1, 3];

impl Paths {
    fn run(&self) -> Result<Reply> {
        let rig = Rig::built_in().map_err(ExperimentError::from)?;
        let mut figures = Vec::new();
        let raven = TRANSPORT_MS.map(|transport_ms| paths::Path::Raven { transport_ms });
        for path in std::iter::once(paths::Path::Board).chain(raven) {
            let held = paths::hold(path, &rig, PATHS_FORCE_N.into(), self.duration, self.seed);
            figures.push(held?);
        }
        Ok(Reply::new(paths::table(&figures), json!(figures)))
    }
}

/// Refuses a second place of the report whose files would replace those of the dataset.
fn check_into(root: &Path, into: Option<&Path>) -> Result<()> {
    if let Some(into) = into {
        files::check_output(&into.join("card.json"), &[&root.join("dataset")])?;
    }
    Ok(())
}

/// Writes data card and report, and says where.
fn written(folder: &Folder, experiment: &Experiment, into: Option<&PathBuf>) -> Result<String> {
    let mut places = vec![report::write(folder, experiment)?];
    if let Some(into) = into {
        report::copy(folder, into)?;
        places.push(into.clone());
    }
    let places: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
    Ok(format!("report              {}", places.join(" and ")))
}

fn load(file: Option<&PathBuf>) -> Result<Experiment> {
    let experiment = match file {
        Some(path) => Experiment::load(path),
        None => Experiment::thesis(),
    };
    experiment.map_err(|error| ExperimentError::from(error).into())
}

fn table(summary: &Summary, experiment: &Experiment) -> String {
    let mut text = String::new();
    row!(
        text,
        "trial  attempt  result        rows  tracking N   lost samples  saturated  age ms"
    );
    for attempt in &summary.attempts {
        row!(text, "{}", line(attempt));
    }
    row!(
        text,
        "\n{} of {} trials of `{}` in this run are good",
        summary.good.len(),
        summary.trials.len(),
        experiment.name
    );
    text
}

fn line(attempt: &Attempt) -> String {
    let f = &attempt.figures;
    let mut line = format!(
        "{:>5}  {:>7}  {:<12} {:>6}  {:>10.3}  {:>13}  {:>9.4}  {:>6.2}",
        attempt.trial,
        attempt.attempt,
        match attempt.status {
            Status::Good => "good",
            Status::OutsideGates => "outside gate",
            Status::Stopped => "stopped",
            Status::BrokenOff => "broken off",
        },
        f.rows,
        f.tracking_rms_n,
        f.samples_lost,
        f.saturated,
        f.force_age_s * 1e3,
    );
    if let Some(reason) = &attempt.reason {
        let _ = write!(line, "\n       {reason}");
    }
    line
}

/// Progress with the time that is left.
struct Progress {
    output: Arc<Output>,
    bar: Option<ProgressBar>,
    trial_s: f64,
    trials: usize,
    /// Trials before the present one in this run.
    done: usize,
    trial: Option<usize>,
    began: Instant,
    /// Tenth of a trial that was printed last.
    tenth: Option<(usize, u32)>,
}

impl Progress {
    fn new(output: &Arc<Output>, trial_s: f64, trials: usize) -> Self {
        let bar = (output.shows_progress() && super::output::stderr_is_terminal()).then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(10_000), ProgressDrawTarget::stderr_with_hz(4));
            if let Ok(style) = ProgressStyle::with_template("{msg:60} {bar:24}") {
                bar.set_style(style);
            }
            bar
        });
        Self {
            output: Arc::clone(output),
            bar,
            trial_s,
            trials,
            done: 0,
            trial: None,
            began: Instant::now(),
            tenth: None,
        }
    }

    fn done(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Time left from the share that is done and the time that it took.
fn left(done: f64, passed: Duration) -> Option<Duration> {
    (done > 0.0)
        .then(|| passed.as_secs_f64() * (1.0 - done).max(0.0) / done)
        .and_then(|s| Duration::try_from_secs_f64(s.round()).ok())
}

impl Watcher for Progress {
    fn progress(&mut self, trial: usize, phase: Phase, t_s: f64) {
        if self.trial.is_some_and(|before| before != trial) {
            self.done += 1;
        }
        self.trial = Some(trial);
        let part = (t_s / self.trial_s).clamp(0.0, 1.0);
        let done = (self.done as f64 + part) / self.trials.max(1) as f64;
        let left = left(done, self.began.elapsed()).map_or_else(String::new, |left| {
            format!(", {} left", humantime::format_duration(left))
        });
        let text = format!(
            "trial {trial}: {}, {:.0} %{left}",
            phase.describe(),
            100.0 * part
        );
        match &self.bar {
            Some(bar) => {
                bar.set_position((done * 10_000.0) as u64);
                bar.set_message(text);
            }
            None => {
                let tenth = (trial, (part * 10.0) as u32);
                if self.tenth != Some(tenth) {
                    self.tenth = Some(tenth);
                    self.output.note(&text);
                }
            }
        }
    }

    fn notice(&mut self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.output.note(text)),
            None => self.output.note(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_from_what_is_done() {
        let passed = Duration::from_secs(60);
        assert_eq!(left(0.25, passed), Some(Duration::from_secs(180)));
        assert_eq!(left(0.0, passed), None);
        assert_eq!(left(1.0, passed), Some(Duration::ZERO));
    }
}
