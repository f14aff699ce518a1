//! The trials of an experiment one after another: which are left, attempts, shards, resuming.

use super::dataset::JOINTS;
use super::error::ExperimentError;
use super::feed::Tamper;
use super::figures::judge;
use super::file::Experiment;
use super::folder::{Attempt, AttemptFolder, Folder, Status};
use super::lock::TrialLock;
use super::plan::{self, derive, Trial};
use super::table::Table;
use super::trial::{run_trial, Ending, Setup, Shown, Watcher};
use rig::Rig;
use robot::source::SourceConfig;
use run::Zeroing;
use session::link::{fast::FastRig, RigLink};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

/// Every `of`-th trial, beginning with the `index`-th (from 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    pub index: usize,
    /// Number of shards.
    pub of: usize,
}

impl Shard {
    /// The trials of this shard.
    #[must_use]
    pub fn trials(&self, count: usize) -> Vec<usize> {
        (1..=count)
            .filter(|trial| (trial - 1) % self.of == self.index - 1)
            .collect()
    }
}

impl Default for Shard {
    fn default() -> Self {
        Self { index: 1, of: 1 }
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let number = |text: &str| text.parse::<usize>().ok();
        match parts.and_then(|(i, n)| Some((number(i)?, number(n)?))) {
            Some((index, of)) if (1..=of).contains(&index) => Ok(Self { index, of }),
            _ => Err(format!(
                "`{text}` is no share; give I/N with I from 1 to N, as 2/4"
            )),
        }
    }
}

/// Opens the link to a rig that is there, for a robot that is not virtual: the link, and where the
/// zeros come from.
pub type Open<'a> = dyn Fn() -> Result<(Box<dyn RigLink>, Zeroing), ExperimentError> + 'a;

/// What is said after the first good trial of a robot that tells its tip alone.
const WITHOUT_JOINTS: &str = "the robot reports no joints: the dataset has known forces at the tip, and `forcectl estimate train`, which \
     needs joints and efforts, cannot use it (docs/robot.md)";

/// How the trials are run.
#[derive(Clone, Default)]
pub struct Options<'a> {
    /// Which trials.
    pub shard: Shard,
    /// Go on where an earlier run has left trials.
    pub resume: bool,
    /// The rig for a robot that is not virtual, opened for each attempt.
    pub open: Option<&'a Open<'a>>,
    /// Set from outside to end.
    pub stop: Arc<AtomicBool>,
}

/// What was done.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Trials of this shard.
    pub trials: Vec<usize>,
    /// Those that are good.
    pub good: Vec<usize>,
    /// Attempts of this run.
    pub attempts: Vec<Attempt>,
    /// Trials of the whole experiment that are still to be done.
    pub left: Vec<usize>,
    /// Whether the user ended it.
    pub interrupted: bool,
    /// Who stopped the rig from elsewhere, in words: that ends an experiment, as a person wants it
    /// to stand still.
    pub stopped: Option<String>,
}

/// Runs the trials of a shard into a folder.
///
/// # Errors
/// [`ExperimentError`]; nothing was driven where files, plan or folder do not fit.
pub fn run(
    experiment: &Experiment,
    rig: &Rig,
    root: &Path,
    options: &Options<'_>,
    watcher: &mut dyn Watcher,
) -> Result<Summary, ExperimentError> {
    run_tampered(experiment, rig, root, options, watcher, &mut |_, _| None)
}

/// As [`run`], with something that goes wrong in an attempt (trial, attempt).
pub(crate) fn run_tampered(
    experiment: &Experiment,
    rig: &Rig,
    root: &Path,
    options: &Options<'_>,
    watcher: &mut dyn Watcher,
    tamper: &mut dyn FnMut(usize, u32) -> Option<Tamper>,
) -> Result<Summary, ExperimentError> {
    let trials = options.shard.trials(experiment.trials);
    let places = plan::examine(experiment, rig, &trials)?;
    watcher.notice(&format!(
        "{} of {} trials, {places} places examined: every force and pose is within reach",
        trials.len(),
        experiment.trials
    ));
    let used = (experiment.prepare_rig(rig)).map_err(plan::PlanError::Rig)?;
    let folder = Folder::create(root, experiment, rig)?;
    // All of them before anything is marked: whoever has a trial without a result may still be at
    // it.
    let _locks = (trials.iter())
        .map(|trial| TrialLock::take(&folder, *trial))
        .collect::<Result<Vec<_>, _>>()?;
    let mut before = BTreeMap::new();
    for trial in &trials {
        let attempts = folder.claim_attempts(experiment, *trial)?;
        if !attempts.is_empty() && !options.resume {
            return Err(ExperimentError::Folder(format!(
                "{} holds {} of trial {trial} already; add --resume to go on, or give another folder",
                root.display(),
                if attempts.len() == 1 { "an attempt" } else { "attempts" }
            )));
        }
        for good in attempts.iter().filter(|a| a.status == Status::Good) {
            folder.check_files(good)?;
        }
        before.insert(*trial, attempts);
    }
    let mut summary = Summary {
        trials: trials.clone(),
        good: Vec::new(),
        attempts: Vec::new(),
        left: Vec::new(),
        interrupted: false,
        stopped: None,
    };
    for number in trials {
        let mut sequence = Sequence {
            experiment,
            rig: &used,
            folder: &folder,
            options,
            watcher: &mut *watcher,
        };
        let earlier = before.remove(&number).unwrap_or_default();
        sequence.trial(number, &earlier, &mut summary, tamper)?;
        if summary.interrupted || summary.stopped.is_some() {
            break;
        }
    }
    let good = folder.good(experiment)?;
    summary.left = (1..=experiment.trials)
        .filter(|trial| !good.iter().any(|attempt| attempt.trial == *trial))
        .collect();
    Ok(summary)
}

struct Sequence<'a> {
    experiment: &'a Experiment,
    rig: &'a Rig,
    folder: &'a Folder,
    options: &'a Options<'a>,
    watcher: &'a mut dyn Watcher,
}

impl Sequence<'_> {
    /// Attempts at a trial until one is good, the attempts are used up, or the user ends it.
    fn trial(
        &mut self,
        number: usize,
        earlier: &[Attempt],
        summary: &mut Summary,
        tamper: &mut dyn FnMut(usize, u32) -> Option<Tamper>,
    ) -> Result<(), ExperimentError> {
        if earlier.iter().any(|attempt| attempt.status == Status::Good) {
            summary.good.push(number);
            return Ok(());
        }
        let trial = plan::trial(self.experiment, number)?;
        let first = earlier.len() as u32 + 1;
        for attempt in first..first + self.experiment.attempts {
            if self.options.stop.load(Ordering::Relaxed) {
                summary.interrupted = true;
                return Ok(());
            }
            let folder = self.folder.attempt(number, attempt);
            folder.begin()?;
            let done = match self.attempt(&trial, &folder, tamper(number, attempt)) {
                Err(ExperimentError::StoppedElsewhere(who)) => {
                    folder.withdraw();
                    summary.stopped = Some(who);
                    return Ok(());
                }
                done => done?,
            };
            let (status, reason) = (done.status, done.reason.clone().unwrap_or_default());
            summary.attempts.push(done);
            match status {
                Status::Good => {
                    if summary.good.is_empty() && !self.has_joints(number)? {
                        self.watcher.notice(WITHOUT_JOINTS);
                    }
                    summary.good.push(number);
                    return Ok(());
                }
                Status::BrokenOff => {
                    // Who did not end it here stopped the rig from elsewhere.
                    summary.interrupted = self.options.stop.load(Ordering::Relaxed);
                    summary.stopped = (!summary.interrupted).then_some(reason);
                    return Ok(());
                }
                Status::OutsideGates | Status::Stopped => self.watcher.notice(&format!(
                    "trial {number}, attempt {attempt} is marked as failed and kept: {reason}"
                )),
            }
        }
        Ok(())
    }

    /// Whether the robot has told where its joints are in a good trial.
    fn has_joints(&self, number: usize) -> Result<bool, ExperimentError> {
        let rows = Table::read(&self.folder.dataset(number))?;
        Ok((1..=JOINTS).any(|n| {
            let column = rows.column(&format!("joint_position_{n}"));
            column.is_some_and(|values| values.iter().any(|value| value.is_finite()))
        }))
    }

    fn attempt(
        &mut self,
        trial: &Trial,
        folder: &AttemptFolder,
        tamper: Option<Tamper>,
    ) -> Result<Attempt, ExperimentError> {
        let started_utc = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
        let began = Instant::now();
        let chips = derive(
            self.experiment.seed,
            "chips",
            (trial.number as u64) << 8 | u64::from(folder.attempt),
        );
        let (mut link, zeroing) = self.open(trial, chips)?;
        let setup = Setup {
            experiment: self.experiment,
            rig: self.rig,
            trial,
            folder,
            zeroing: &zeroing,
            stop: Arc::clone(&self.options.stop),
        };
        let name = link.name();
        // A file that fails ends the experiment: the next trial would have no place either.
        let shown = run_trial(link.as_mut(), &setup, tamper, self.watcher)?;
        let mut seeds = BTreeMap::from([
            ("experiment".to_owned(), self.experiment.seed),
            ("chips".to_owned(), chips),
        ]);
        if trial.trajectory.is_some() {
            let seed = derive(self.experiment.seed, "trajectory", trial.number as u64);
            seeds.insert("trajectory".to_owned(), seed);
        }
        let attempt = self.conclude(&shown, trial, folder, started_utc);
        folder.conclude(Attempt {
            wall_s: began.elapsed().as_secs_f64(),
            seeds,
            link: name,
            ..attempt
        })
    }

    fn conclude(
        &self,
        shown: &Shown,
        trial: &Trial,
        folder: &AttemptFolder,
        started_utc: String,
    ) -> Attempt {
        let figures = shown.counts.figures();
        let gates = judge(&figures, &self.experiment.gates);
        let missed: Vec<String> = (gates.iter().filter(|gate| !gate.kept))
            .map(|g| format!("{} is {:.4}, {} is allowed", g.name, g.value, g.limit))
            .collect();
        let (status, reason) = match &shown.ending {
            Ending::Interrupted => (
                Status::BrokenOff,
                Some("ended by the user; the rig was ramped down and disarmed".to_owned()),
            ),
            Ending::ByOther(who) => (Status::BrokenOff, Some(who.clone())),
            Ending::Stopped(why) => (Status::Stopped, Some(why.clone())),
            Ending::Complete if missed.is_empty() => (Status::Good, None),
            Ending::Complete => (Status::OutsideGates, Some(missed.join("; "))),
        };
        Attempt {
            trial: trial.number,
            attempt: folder.attempt,
            status,
            reason,
            experiment_hash: self.experiment.hash(),
            rig_hash: self.rig.hash(),
            figures,
            gates,
            disarmed: shown.disarmed,
            events: shown.events.clone(),
            started_utc,
            wall_s: 0.0,
            seeds: BTreeMap::new(),
            versions: BTreeMap::from([
                ("forcectl".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
                ("firmware".to_owned(), shown.firmware.clone()),
                ("wire".to_owned(), wire::ABI_VERSION.to_string()),
            ]),
            config_crc: format!("{:08x}", shown.config_crc),
            link: String::new(),
            effort_meaning: shown.effort_meaning.clone(),
            joint_names: shown.joint_names.clone(),
            robot_clock: shown.robot_clock.clone(),
            files: BTreeMap::new(),
        }
    }

    /// A virtual robot has its own rig for each attempt, at power-on, which measures its zeros; any
    /// other uses the rig that is there.
    fn open(
        &self,
        trial: &Trial,
        chips: u64,
    ) -> Result<(Box<dyn RigLink>, Zeroing), ExperimentError> {
        let SourceConfig::Virtual(config) = &self.experiment.robot else {
            let open = self.options.open.ok_or_else(|| {
                ExperimentError::Unreachable("the robot is not virtual, and no rig is named".into())
            })?;
            return open();
        };
        let start = (trial.trajectory.as_ref()).map_or(config.arm.start, |t| t.at(0.0).position);
        let seed = config.seed.unwrap_or(self.experiment.seed);
        let arm = robot::arm::ArmConfig {
            start,
            session: trial.number as u64,
            ..config.arm
        };
        let rig = FastRig::with(core_sim::Options {
            seed,
            chips_seed: Some(chips),
            robot: Some(arm),
            loose: self.rig.units.map(|unit| !unit.enabled),
            ..core_sim::Options::default()
        })?;
        Ok((Box::new(rig), Zeroing::Measure))
    }
}
