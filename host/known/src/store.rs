//! Where the calibrations of a rig are kept: the one in force, all older ones, and what a step that
//! was broken off has so far.
//!
//! ```text
//! calibration-RIG/current.toml               the calibration in force
//! calibration-RIG/versions/0003.toml         every calibration that was ever in force, in order
//! calibration-RIG/drafts/gain-unit3.csv      readings of a step that is not finished
//! calibration-RIG/readings/0003-gain-unit3.csv   readings of the step that made version 3
//! calibration-RIG/power-ups.csv              zeros that an older version kept there
//! calibration-RIG/checks.csv                 checks with a known weight ([`crate::checks`])
//! zeros-RIG.toml                             all zeros since, whichever command took them ([`ZeroStore`])
//! ```
//!
//! An emulated rig has a folder and a file of zeros for each seed: another seed is another rig.

use crate::zeros::{file_name, ZeroStore};
use crate::{state_folder, Result, StoreError};
use calibration::record::Record;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// The calibrations of one rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    folder: PathBuf,
    zeros: ZeroStore,
}

/// A calibration that was stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kept {
    /// Its number, `0003`.
    pub version: String,
    /// Its file.
    pub path: PathBuf,
}

impl Store {
    /// The store of a rig in the user's folder, beside its zeros. `seed`: that of an emulated rig.
    ///
    /// # Errors
    /// There is no folder to keep anything in.
    pub fn of_rig(name: &str, seed: Option<u64>) -> Result<Self> {
        let name = file_name(name, seed);
        let folder = state_folder().ok_or_else(|| StoreError::File {
            path: "calibrations".to_owned(),
            cause: "no folder is known to keep them in; set FORCECTL_STATE_DIR".to_owned(),
        })?;
        Ok(Self {
            folder: folder.join(format!("calibration-{name}")),
            zeros: ZeroStore::in_folder(&folder, &name),
        })
    }

    /// A store in this folder, with the zeros.
    #[must_use]
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        let folder = folder.into();
        Self {
            zeros: ZeroStore::at(folder.join("zeros.toml")),
            folder,
        }
    }

    /// The zeros of the rig.
    #[must_use]
    pub fn zeros(&self) -> &ZeroStore {
        &self.zeros
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The calibration in force; `None` where the rig has none.
    ///
    /// # Errors
    /// The file is there and can't be used; the message names the last version that can.
    pub fn current(&self) -> Result<Option<Record>> {
        let path = self.folder.join("current.toml");
        match std::fs::read_to_string(&path) {
            Ok(text) => match Record::read(&path.display().to_string(), &text) {
                Ok(record) => Ok(Some(record)),
                Err(error) => Err(StoreError::input(format!("{error}{}", self.way_out()))),
            },
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => {
                let cause = format!("{error}{}", self.way_out());
                Err(StoreError::unreadable(&path, cause))
            }
        }
    }

    /// What to do about a damaged `current.toml`.
    fn way_out(&self) -> String {
        let versions = self.versions().unwrap_or_default();
        let good = versions.iter().rev().find(|v| self.version(v).is_ok());
        let number = good.and_then(|version| version.parse::<u32>().ok());
        number.map_or_else(String::new, |number| {
            format!("; `forcectl calibrate use {number}` puts the last good version in force")
        })
    }

    /// Numbers of the calibrations that are kept, oldest first.
    ///
    /// # Errors
    /// The folder can't be read.
    pub fn versions(&self) -> Result<Vec<String>> {
        let folder = self.folder.join("versions");
        let entries = match std::fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(StoreError::unreadable(&folder, error)),
        };
        let mut found: Vec<String> = entries
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .filter_map(|name| Some(name.strip_suffix(".toml")?.to_owned()))
            .filter(|name| name.len() == 4 && name.bytes().all(|b| b.is_ascii_digit()))
            .collect();
        found.sort();
        Ok(found)
    }

    /// A calibration by its number (`3` or `0003`), `current`, or the path of a file.
    ///
    /// # Errors
    /// There is none, or it can't be used.
    pub fn version(&self, name: &str) -> Result<Record> {
        if name == "current" {
            return self.current()?.ok_or_else(|| {
                StoreError::input(format!(
                    "{}: this rig has no calibration yet; `forcectl calibrate gain` begins one",
                    self.folder.display()
                ))
            });
        }
        let path = match name.parse::<u32>() {
            Ok(number) => self.folder.join(format!("versions/{number:04}.toml")),
            Err(_) => PathBuf::from(name),
        };
        let text = files::read_text(&path).map_err(|error| {
            StoreError::unreadable(
                &path,
                format!("{error}; `forcectl calibrate show --versions` lists what is kept"),
            )
        })?;
        read(&path, &text)
    }

    /// Keeps a calibration as the next version and puts it in force. Each file is replaced as a
    /// whole: a full disk leaves the old one.
    ///
    /// # Errors
    /// A value that can't be, or a file that can't be written.
    pub fn keep(&self, record: &Record) -> Result<Kept> {
        let text = record.write().map_err(StoreError::refused)?;
        let last = self.versions()?.last().and_then(|v| v.parse::<u32>().ok());
        let version = format!("{:04}", last.unwrap_or(0) + 1);
        let path = self.folder.join(format!("versions/{version}.toml"));
        replace(&path, &text)?;
        replace(&self.folder.join("current.toml"), &text)?;
        Ok(Kept { version, path })
    }

    /// Puts an older version of the rig `rig` in force again, as a new version. It does not look at
    /// the one that is in force, which may be damaged.
    ///
    /// # Errors
    /// There is no such version, it can't be used or is of another rig, or a file can't be written.
    pub fn reinstate(&self, version: &str, rig: &str) -> Result<(Kept, Record)> {
        let record = self.version(version)?;
        if record.rig != rig {
            return Err(StoreError::refused(format!(
                "version {version} is of rig `{}`, and this rig is `{rig}`; `forcectl calibrate show --versions` lists what is kept",
                record.rig
            )));
        }
        Ok((self.keep(&record)?, record))
    }

    /// The draft of a step, `gain-unit3`.
    #[must_use]
    pub fn draft(&self, step: &str) -> Draft {
        Draft {
            path: self.folder.join(format!("drafts/{step}.csv")),
            readings: self.folder.join("readings"),
            step: step.to_owned(),
        }
    }

    /// The file in which an older version kept the zeros over the power-ups.
    #[must_use]
    pub fn power_ups(&self) -> PathBuf {
        self.folder.join("power-ups.csv")
    }
}

fn read(path: &Path, text: &str) -> Result<Record> {
    Record::read(&path.display().to_string(), text).map_err(StoreError::input)
}

/// Writes a file so that it is there whole or as it was before.
fn replace(path: &Path, text: &str) -> Result<()> {
    files::replace(path, text).map_err(|error| StoreError::file(path, error))
}

/// Readings of a step that is going on: kept line by line, so that a break loses nothing.
#[derive(Debug, Clone)]
pub struct Draft {
    path: PathBuf,
    readings: PathBuf,
    step: String,
}

impl Draft {
    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What is kept so far; `None` where nothing is.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn text(&self) -> Result<Option<String>> {
        match std::fs::read_to_string(&self.path) {
            Ok(text) => Ok(Some(text)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(StoreError::unreadable(&self.path, error)),
        }
    }

    /// Rows below the header.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn rows(&self) -> Result<usize> {
        Ok(self
            .text()?
            .map_or(0, |text| text.lines().count().saturating_sub(1)))
    }

    /// The number in a column (from 0) of the last row; `None` where there is none.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn last_number(&self, column: usize) -> Result<Option<f64>> {
        let text = self.text()?.unwrap_or_default();
        let last = text.lines().skip(1).last();
        Ok(last.and_then(|row| row.split(',').nth(column)?.trim().parse().ok()))
    }

    /// How long ago the last row was added, s; 0 for a draft that is empty.
    ///
    /// # Errors
    /// The file can't be looked at.
    pub fn age_s(&self) -> Result<f64> {
        match std::fs::metadata(&self.path).and_then(|data| data.modified()) {
            // A clock that was set back gives no age.
            Ok(written) => Ok(written.elapsed().map_or(0.0, |age| age.as_secs_f64())),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(0.0),
            Err(error) => Err(StoreError::unreadable(&self.path, error)),
        }
    }

    /// Adds a row; the file gets its header first.
    ///
    /// # Errors
    /// The file can't be written, or was begun with another header.
    pub fn add(&self, header: &str, row: &str) -> Result<()> {
        let kept = self.text()?.unwrap_or_default();
        if kept.lines().next().is_some_and(|line| line != header) {
            return Err(StoreError::refused(format!(
                "{} was begun by another version of forcectl and has other columns; --restart begins anew",
                self.path.display()
            )));
        }
        let write = || {
            if let Some(folder) = self.path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            let mut file = std::fs::OpenOptions::new()
                .create(true)
                .append(true)
                .open(&self.path)?;
            if file.metadata()?.len() == 0 {
                writeln!(file, "{header}")?;
            }
            writeln!(file, "{row}")?;
            file.sync_data()
        };
        write().map_err(|error: std::io::Error| StoreError::file(&self.path, error))
    }

    /// Takes the last row away: a mistake of the user.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn undo(&self) -> Result<()> {
        let Some(text) = self.text()? else {
            return Ok(());
        };
        let mut lines: Vec<&str> = text.lines().collect();
        if lines.len() > 1 {
            lines.pop();
        }
        replace(&self.path, &format!("{}\n", lines.join("\n")))
    }

    /// Removes what is kept: the step begins anew.
    ///
    /// # Errors
    /// The file can't be removed.
    pub fn discard(&self) -> Result<()> {
        match std::fs::remove_file(&self.path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(StoreError::file(&self.path, error))
            }
            _ => Ok(()),
        }
    }

    /// The step is finished: its readings stay beside the version that they made.
    ///
    /// # Errors
    /// The file can't be moved.
    pub fn finish(&self, version: &str) -> Result<PathBuf> {
        let to = self.readings.join(format!("{version}-{}.csv", self.step));
        std::fs::create_dir_all(&self.readings)
            .and_then(|()| std::fs::rename(&self.path, &to))
            .map_err(|error| StoreError::file(&to, error))?;
        Ok(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base;
    use rig::Rig;

    #[test]
    fn versions_stay_and_an_edit_by_hand_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path().join("deep/store"));
        assert_eq!(store.current().unwrap(), None);
        assert!(store.version("current").is_err());
        let rig = Rig::built_in().unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        assert_eq!(store.keep(&record).unwrap().version, "0001");
        record.units[0].n_per_code *= 1.01;
        record.units[0].gain_date = "2026-11-22".to_owned();
        let kept = store.keep(&record).unwrap();
        assert_eq!(kept.version, "0002");
        assert_eq!(store.versions().unwrap(), ["0001", "0002"]);
        let (old, new) = (store.version("1").unwrap(), store.version("0002").unwrap());
        assert_ne!(old, new);
        assert_eq!(store.current().unwrap().unwrap(), new);
        let current = store.folder().join("current.toml");
        let text = std::fs::read_to_string(&current).unwrap();
        std::fs::write(&current, text.replace("9.80665", "9.81")).unwrap();
        let error = store.current().unwrap_err().to_string();
        assert!(
            error.contains("current.toml:") && error.contains("hash"),
            "{error}"
        );
        // The damaged file is not needed to put a good version in force.
        assert!(error.contains("`forcectl calibrate use 2`"), "{error}");
        let second = store.folder().join("versions/0002.toml");
        let kept_text = std::fs::read_to_string(&second).unwrap();
        std::fs::write(&second, "no record").unwrap();
        let error = store.current().unwrap_err().to_string();
        assert!(error.contains("`forcectl calibrate use 1`"), "{error}");
        std::fs::write(&current, b"\xff\xfe").unwrap();
        let error = store.current().unwrap_err().to_string();
        assert!(error.contains("`forcectl calibrate use 1`"), "{error}");
        std::fs::write(&second, kept_text).unwrap();
        let again = store.reinstate("1", &rig.name).unwrap();
        assert_eq!(again.0.version, "0003");
        assert_eq!(store.current().unwrap().unwrap(), old);
        assert!(store.reinstate("7", &rig.name).is_err());
        let error = store.reinstate("1", "another").unwrap_err().to_string();
        assert!(error.contains("of rig `"), "{error}");
        let mut bad = new;
        bad.units[2].n_per_code = f64::NAN;
        assert!(store.keep(&bad).is_err());
        assert_eq!(store.versions().unwrap().len(), 3);
    }

    #[test]
    fn a_draft_survives_and_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let draft = store.draft("gain-unit3");
        assert_eq!(draft.rows().unwrap(), 0);
        draft.add("a,b", "1,2").unwrap();
        store.draft("gain-unit3").add("a,b", "3,4").unwrap();
        draft.add("a,b", "5,6").unwrap();
        draft.undo().unwrap();
        assert_eq!(draft.text().unwrap().unwrap(), "a,b\n1,2\n3,4\n");
        assert_eq!(draft.rows().unwrap(), 2);
        assert_eq!(draft.last_number(1).unwrap(), Some(4.0));
        assert_eq!(draft.last_number(7).unwrap(), None);
        let kept = draft.finish("0001").unwrap();
        assert!(kept.ends_with("readings/0001-gain-unit3.csv"));
        assert_eq!(draft.text().unwrap(), None);
        draft.discard().unwrap();
    }
}
