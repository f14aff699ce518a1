//! The folder of an experiment: what lies where, what is done, what is left to do.
//!
//! | path | what |
//! | --- | --- |
//! | `experiment.toml`, `rig.json` | what was asked for, in force for every trial |
//! | `trials/trial-01/lock` | which process runs the trial |
//! | `trials/trial-01/attempt-1/` | `result.json`; rows of an attempt that failed; recording of the samples |
//! | `dataset/trial-01.parquet` | rows of the good attempt; `card.json` and `README.md`: the data card |
//! | `truth/trial-01.parquet` | what the plant truly did, row by row; a virtual rig only. No estimator reads it |
//! | `report/` | `README.md` and pictures |
//!
//! An attempt without `result.json` was broken off: the rows in its recording become a file, it is
//! marked, and the trial is repeated. Trials share no file, so shards can run at the same time.

use super::dataset::{table, Column, Joiner, COLUMNS, ROWS, TRUTH, TRUTH_COLUMNS};
use super::error::ExperimentError;
use super::figures::{Figures, GateResult};
use super::file::Experiment;
use super::table::{failed, Table};
use recording::read::{mcap_of, Entry, Reader};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How an attempt ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The whole trial, and every gate kept.
    Good,
    /// The whole trial, with a gate that is not kept.
    OutsideGates,
    /// Ended early by a fault, the robot or a file.
    Stopped,
    /// Ended by the user, or the program was killed.
    BrokenOff,
}

/// What is kept of an attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// Trial, from 1.
    pub trial: usize,
    /// Attempt, from 1.
    pub attempt: u32,
    /// How it ended.
    pub status: Status,
    /// Why, where it is not good.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// SHA-256 of the experiment.
    pub experiment_hash: String,
    /// SHA-256 of the rig file.
    pub rig_hash: String,
    /// Figures.
    pub figures: Figures,
    /// Gates.
    pub gates: Vec<GateResult>,
    /// Whether the board was ramped down at the end and said that its motors are at 0 V.
    pub disarmed: bool,
    /// Events of the robot, with times.
    pub events: Vec<String>,
    /// Begin, UTC.
    pub started_utc: String,
    /// Time on the clock, s.
    pub wall_s: f64,
    /// Seeds by use.
    pub seeds: BTreeMap<String, u64>,
    /// Versions: forcectl, firmware, wire.
    pub versions: BTreeMap<String, String>,
    /// CRC-32 of the configurations in force.
    pub config_crc: String,
    /// Name of the link.
    pub link: String,
    /// Meaning of the joint efforts, as the robot declares it.
    #[serde(default)]
    pub effort_meaning: Option<String>,
    /// Names of the joints.
    #[serde(default)]
    pub joint_names: Vec<String>,
    /// The robot's clock.
    #[serde(default)]
    pub robot_clock: Option<String>,
    /// Files relative to the experiment's folder, with their SHA-256.
    pub files: BTreeMap<String, String>,
}

/// The folder of an experiment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Folder {
    root: PathBuf,
}

/// The folder of an attempt.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttemptFolder {
    root: PathBuf,
    path: PathBuf,
    /// Trial, from 1.
    pub trial: usize,
    /// Attempt, from 1.
    pub attempt: u32,
}

fn io(path: &Path, error: &std::io::Error) -> ExperimentError {
    failed(path, error).into()
}

/// A file of the folder that can't be read.
fn unreadable(path: &Path, error: &std::io::Error) -> ExperimentError {
    ExperimentError::Folder(failed(path, format!("cannot be read: {error}")).to_string())
}

/// Writes a text so that the file is there whole or as it was before.
fn write_whole(path: &Path, text: &str) -> Result<(), ExperimentError> {
    files::replace(path, text).map_err(|error| io(path, &error))
}

fn make(path: &Path) -> Result<(), ExperimentError> {
    std::fs::create_dir_all(path).map_err(|error| io(path, &error))
}

impl Folder {
    /// A folder that holds an experiment already.
    ///
    /// # Errors
    /// It holds none.
    pub fn open(root: &Path) -> Result<(Self, Experiment), ExperimentError> {
        let path = root.join("experiment.toml");
        if !path.is_file() {
            return Err(ExperimentError::Folder(format!(
                "{} holds no experiment (experiment.toml is not there)",
                root.display()
            )));
        }
        let experiment = Experiment::load(&path)?;
        Ok((
            Self {
                root: root.to_owned(),
            },
            experiment,
        ))
    }

    /// A folder for an experiment: a new one, or one that holds the same experiment.
    ///
    /// # Errors
    /// It holds another experiment, or can't be made.
    pub fn create(
        root: &Path,
        experiment: &Experiment,
        rig: &rig::Rig,
    ) -> Result<Self, ExperimentError> {
        let folder = Self {
            root: root.to_owned(),
        };
        let mut experiment = experiment.clone();
        if let Some(rig) = &mut experiment.rig {
            if let Ok(absolute) = std::path::absolute(&*rig) {
                *rig = absolute;
            }
        }
        let text = toml::to_string(&experiment)
            .map_err(|error| ExperimentError::Folder(format!("experiment.toml: {error}")))?;
        let path = root.join("experiment.toml");
        if path.exists() {
            let (_, before) = Self::open(root)?;
            if before.hash() != experiment.hash() {
                return Err(ExperimentError::Folder(format!(
                    "{} holds another experiment (`{}`); give another folder",
                    root.display(),
                    before.name
                )));
            }
            let rig_before = std::fs::read_to_string(root.join("rig.json")).unwrap_or_default();
            if !rig_before.contains(&rig.hash()) {
                return Err(ExperimentError::Folder(format!(
                    "{} was begun with another rig file; give another folder",
                    root.display()
                )));
            }
            return Ok(folder);
        }
        for part in ["trials", "dataset"] {
            make(&root.join(part))?;
        }
        let json = serde_json::json!({ "hash": rig.hash(), "rig": rig, "calibration": known::checks::standing(rig) });
        write_whole(&root.join("rig.json"), &format!("{json:#}\n"))?;
        write_whole(&path, &text)?;
        Ok(folder)
    }

    /// Its path.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Name of a trial's file.
    #[must_use]
    pub fn file_of(trial: usize) -> String {
        format!("trial-{trial:02}.parquet")
    }

    /// Rows of a trial that is done.
    #[must_use]
    pub fn dataset(&self, trial: usize) -> PathBuf {
        self.root.join("dataset").join(Self::file_of(trial))
    }

    /// Truth of a trial that is done.
    #[must_use]
    pub fn truth(&self, trial: usize) -> PathBuf {
        self.root.join("truth").join(Self::file_of(trial))
    }

    /// The attempts at a trial that have a result, in order. One without may be in progress in
    /// another process.
    ///
    /// # Errors
    /// A file can't be read.
    pub fn attempts(&self, trial: usize) -> Result<Vec<Attempt>, ExperimentError> {
        let mut found = Vec::new();
        for folder in self.attempt_folders(trial) {
            found.extend(folder.read()?);
        }
        Ok(found)
    }

    /// As [`Folder::attempts`], for whoever runs the trial: those that were broken off without a
    /// result are marked here.
    ///
    /// # Errors
    /// A file can't be read or written.
    pub fn claim_attempts(
        &self,
        experiment: &Experiment,
        trial: usize,
    ) -> Result<Vec<Attempt>, ExperimentError> {
        self.attempt_folders(trial)
            .map(|folder| match folder.read()? {
                Some(attempt) => Ok(attempt),
                None => folder.mark(experiment),
            })
            .collect()
    }

    /// The folders of a trial's attempts, in order.
    fn attempt_folders(&self, trial: usize) -> impl Iterator<Item = AttemptFolder> + '_ {
        (1..)
            .map(move |attempt| self.attempt(trial, attempt))
            .take_while(|folder| folder.path.is_dir())
    }

    /// The folder of a trial's attempts.
    #[must_use]
    pub fn trial(&self, trial: usize) -> PathBuf {
        self.root.join("trials").join(format!("trial-{trial:02}"))
    }

    /// The folder of an attempt.
    #[must_use]
    pub fn attempt(&self, trial: usize, attempt: u32) -> AttemptFolder {
        let path = self.trial(trial).join(format!("attempt-{attempt}"));
        AttemptFolder {
            root: self.root.clone(),
            path,
            trial,
            attempt,
        }
    }

    /// Whether the files of an attempt are those that it wrote. Its truth may be gone: no estimator
    /// may read it, so who passes a dataset on leaves it out.
    ///
    /// # Errors
    /// Another one is not there, or one can't be read, or has another SHA-256.
    pub fn check_files(&self, attempt: &Attempt) -> Result<(), ExperimentError> {
        for (name, written) in &attempt.files {
            let path = self.root.join(name);
            if path == self.truth(attempt.trial) && !path.exists() {
                continue;
            }
            let what = match files::sha256(&path) {
                Ok(hash) if hash == *written => continue,
                Ok(_) => "is not the file that the trial wrote (another SHA-256)".to_owned(),
                Err(error) => error.to_string(),
            };
            let folder = self.trial(attempt.trial);
            return Err(ExperimentError::Folder(format!(
                "{}: {what}; put the file back, or move {} away and do the trial again with \
                 `forcectl experiment run` and --resume. The other trials are not changed",
                path.display(),
                folder.display()
            )));
        }
        Ok(())
    }

    /// The good attempts, a trial after another.
    ///
    /// # Errors
    /// A file can't be read.
    pub fn good(&self, experiment: &Experiment) -> Result<Vec<Attempt>, ExperimentError> {
        let mut good = Vec::new();
        for trial in 1..=experiment.trials {
            let attempts = self.attempts(trial)?;
            good.extend(attempts.into_iter().filter(|a| a.status == Status::Good));
        }
        Ok(good)
    }
}

impl AttemptFolder {
    /// Makes the folder.
    ///
    /// # Errors
    /// It can't be made.
    pub fn begin(&self) -> Result<(), ExperimentError> {
        make(&self.path)
    }

    /// Removes the folder of an attempt that never began. One that holds something stays.
    pub fn withdraw(&self) {
        let _ = std::fs::remove_dir(&self.path);
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Folder of the samples' recording.
    #[must_use]
    pub fn recording(&self) -> PathBuf {
        self.path.join("recording")
    }

    fn whole(&self, what: &str) -> PathBuf {
        self.path.join(format!("{what}.parquet"))
    }

    /// Writes the rows and their truth as whole files.
    ///
    /// # Errors
    /// A file can't be written.
    pub fn write_rows(&self, joiner: &Joiner, has_truth: bool) -> Result<(), ExperimentError> {
        self.write_tables(&joiner.rows, has_truth.then_some(&joiner.truth))
    }

    fn write_tables(&self, rows: &Table, truth: Option<&Table>) -> Result<(), ExperimentError> {
        let describe = |columns: &[Column]| {
            let units: BTreeMap<&str, &str> = columns.iter().map(|c| (c.0, c.1)).collect();
            serde_json::to_string(&units).unwrap_or_default()
        };
        rows.write(
            &self.whole("rows"),
            &[
                ("units", describe(&COLUMNS)),
                ("page", "docs/dataset.md".to_owned()),
            ],
        )?;
        if let Some(truth) = truth {
            truth.write(
                &self.whole("truth"),
                &[
                    ("units", describe(&TRUTH_COLUMNS)),
                    (
                        "warning",
                        "what the plant truly did: no estimator may read it".to_owned(),
                    ),
                ],
            )?;
        }
        Ok(())
    }

    /// The rows and the truth that the recording of an attempt holds which was broken off.
    fn recorded(&self) -> (Table, Table) {
        let (mut rows, mut truth) = (table(&COLUMNS), table(&TRUTH_COLUMNS));
        // Killed before the recording began: there are none.
        let Ok(entries) = Reader::open(&mcap_of(&self.recording())) else {
            return (rows, truth);
        };
        for entry in entries {
            let Entry::Message { topic, data, .. } = entry else {
                continue;
            };
            for (kind, table) in [(ROWS, &mut rows), (TRUTH, &mut truth)] {
                if topic == kind.topic {
                    table.extend(kind.values(&data));
                }
            }
        }
        // The last chunk may end between a row and its truth.
        let common = if truth.rows() > 0 {
            rows.rows().min(truth.rows())
        } else {
            rows.rows()
        };
        rows.truncate(common);
        truth.truncate(common);
        (rows, truth)
    }

    /// The result, where there is one.
    fn read(&self) -> Result<Option<Attempt>, ExperimentError> {
        let path = self.path.join("result.json");
        if !path.is_file() {
            return Ok(None);
        }
        let text = files::read_text(&path).map_err(|error| unreadable(&path, &error))?;
        let attempt = serde_json::from_str(&text).map_err(|error| {
            let what = format!("is no result: {error}; move the attempt's folder away");
            ExperimentError::Folder(failed(&path, what).to_string())
        })?;
        Ok(Some(attempt))
    }

    /// Marks an attempt as broken off; what its recording holds becomes a file.
    fn mark(&self, experiment: &Experiment) -> Result<Attempt, ExperimentError> {
        let (rows, truth) = self.recorded();
        if rows.rows() > 0 {
            self.write_tables(&rows, (truth.rows() > 0).then_some(&truth))?;
        }
        let attempt = Attempt {
            trial: self.trial,
            attempt: self.attempt,
            status: Status::BrokenOff,
            reason: Some(
                "the program ended before the trial did; rows are kept up to 1 s before".to_owned(),
            ),
            experiment_hash: experiment.hash(),
            rig_hash: String::new(),
            figures: Figures {
                rows: rows.rows() as u64,
                rows_expected: (experiment.trial_s() * experiment.rate_hz) as u64,
                ..Figures::default()
            },
            gates: Vec::new(),
            disarmed: false,
            events: Vec::new(),
            started_utc: String::new(),
            wall_s: 0.0,
            seeds: BTreeMap::new(),
            versions: BTreeMap::new(),
            config_crc: String::new(),
            link: String::new(),
            effort_meaning: None,
            joint_names: Vec::new(),
            robot_clock: None,
            files: BTreeMap::new(),
        };
        self.conclude(attempt)
    }

    /// Writes the result. The rows of a good attempt go to the dataset, those of any other stay
    /// here.
    ///
    /// # Errors
    /// A file can't be moved, read or written.
    pub fn conclude(&self, mut attempt: Attempt) -> Result<Attempt, ExperimentError> {
        let folder = Folder {
            root: self.root.clone(),
        };
        let good = attempt.status == Status::Good;
        for (what, to) in [
            ("rows", folder.dataset(self.trial)),
            ("truth", folder.truth(self.trial)),
        ] {
            let mut path = self.whole(what);
            if !path.is_file() {
                continue;
            }
            if good {
                if let Some(parent) = to.parent() {
                    make(parent)?;
                }
                std::fs::rename(&path, &to).map_err(|error| io(&to, &error))?;
                path = to;
            }
            let name = path.strip_prefix(&self.root).unwrap_or(&path);
            let name = name.display().to_string();
            let hash = files::sha256(&path).map_err(|error| unreadable(&path, &error))?;
            attempt.files.insert(name, hash);
        }
        let text = serde_json::to_string_pretty(&attempt).unwrap_or_default();
        write_whole(&self.path.join("result.json"), &format!("{text}\n"))?;
        Ok(attempt)
    }
}
