//! Zeros that were measured on a rig, with their time: what later zeros are compared with.

use crate::{Result, StoreError};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use wire::message::UnitConfig;
use wire::UNITS;

/// Zeros kept of each rig.
const MAX_ENTRIES: usize = 200;
/// Variable with the folder of the stored zeros.
pub const FOLDER_VARIABLE: &str = "FORCECTL_STATE_DIR";

/// The stored zeros of one rig, a TOML file; or none, for a rig that forgets (an emulated one).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ZeroStore {
    path: Option<PathBuf>,
}

/// The file.
#[derive(Debug, Default, Serialize, Deserialize)]
struct File {
    /// Name of the rig, as in its rig file.
    rig: String,
    /// Oldest first.
    #[serde(default)]
    zero: Vec<Entry>,
}

/// One measurement of the zeros.
#[derive(Debug, Serialize, Deserialize)]
struct Entry {
    /// When, UTC.
    measured_at: String,
    /// Zeros of units 1 to 6, ADC codes; 0: the unit was disabled or out of order.
    zero_code: [i32; UNITS],
    /// Whether the user had them accepted whatever the former ones were (`forcectl zero --replace`).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    accepted: bool,
    /// Temperature in degrees Celsius, where a sensor gives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    temperature_c: Option<f64>,
}

/// The user's folder for what is known of rigs: [`FOLDER_VARIABLE`], else `forcectl` in `XDG_STATE_HOME` or
/// `~/.local/state`.
#[must_use]
pub fn state_folder() -> Option<PathBuf> {
    let set = |variable: &str| std::env::var_os(variable).filter(|value| !value.is_empty());
    match (set(FOLDER_VARIABLE), set("XDG_STATE_HOME"), set("HOME")) {
        (Some(folder), _, _) => Some(PathBuf::from(folder)),
        (None, Some(state), _) => Some(Path::new(&state).join("forcectl")),
        (None, None, Some(home)) => Some(Path::new(&home).join(".local/state/forcectl")),
        (None, None, None) => None,
    }
}

impl ZeroStore {
    /// A store that keeps nothing.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// A store in this file.
    #[must_use]
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self {
            path: Some(path.into()),
        }
    }

    /// The store of a rig in the user's folder: [`FOLDER_VARIABLE`], else `forcectl` in `XDG_STATE_HOME` or
    /// `~/.local/state`.
    #[must_use]
    pub fn of_rig(name: &str) -> Self {
        let Some(folder) = state_folder() else {
            return Self::none();
        };
        let safe: String = name
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
            .collect();
        Self::at(folder.join(format!("zeros-{safe}.toml")))
    }

    fn read(&self) -> Result<File> {
        let Some(path) = &self.path else {
            return Ok(File::default());
        };
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(File::default()),
            Err(error) => return Err(unusable(path, &error)),
        };
        toml::from_str(&text).map_err(|error| unusable(path, &error))
    }

    /// What zeros are compared with: the last ones, and those that the user last accepted as they are (else the first). Each
    /// accepted zero may lie a step from the last one; the second keeps such steps from adding up. Empty where none are stored.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn references(&self) -> Result<Vec<[i32; UNITS]>> {
        let zeros = self.read()?.zero;
        let both = zeros.last().into_iter().chain(zeros.get(base_of(&zeros)));
        Ok(both.map(|entry| entry.zero_code).collect())
    }

    /// The last zeros, ADC codes; `None` where none are stored.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn last(&self) -> Result<Option<[i32; UNITS]>> {
        Ok(self.read()?.zero.last().map(|entry| entry.zero_code))
    }

    /// Adds zeros. A unit that is disabled keeps its last one. `accepted`: the user had them accepted whatever the former ones were.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn add(&self, rig: &str, configs: &[UnitConfig; UNITS], accepted: bool) -> Result<()> {
        let Some(path) = &self.path else {
            return Ok(());
        };
        let mut file = self.read()?;
        let last = file.zero.last().map_or([0; UNITS], |entry| entry.zero_code);
        rig.clone_into(&mut file.rig);
        file.zero.push(Entry {
            measured_at: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            zero_code: std::array::from_fn(|i| {
                if configs[i].enabled {
                    configs[i].zero_code
                } else {
                    last[i]
                }
            }),
            accepted,
            temperature_c: None,
        });
        // The oldest go, but not those that later ones are compared with.
        while file.zero.len() > MAX_ENTRIES {
            let base = base_of(&file.zero);
            file.zero.remove(usize::from(base == 0));
        }
        toml::to_string(&file)
            .map_err(std::io::Error::other)
            .and_then(|text| files::replace(path, text))
            .map_err(|error| unusable(path, &error))
    }
}

/// Index of the entry that all later ones are compared with: the last that the user had accepted, else the first.
fn base_of(zeros: &[Entry]) -> usize {
    zeros.iter().rposition(|entry| entry.accepted).unwrap_or(0)
}

fn unusable(path: &Path, error: &dyn std::fmt::Display) -> StoreError {
    StoreError::Zeros {
        path: path.to_owned(),
        cause: error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::RigFile;

    #[test]
    fn zeros_are_kept_with_their_time_and_a_disabled_unit_keeps_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/zeros.toml");
        let store = ZeroStore::at(&path);
        assert_eq!(store.last().unwrap(), None);
        let mut configs = RigFile::built_in()
            .unwrap()
            .units
            .map(|unit| unit.to_wire());
        for (i, config) in configs.iter_mut().enumerate() {
            config.zero_code = 100 * (i as i32 + 1);
        }
        store.add("a rig", &configs, false).unwrap();
        let first = store.last().unwrap().unwrap();
        configs[2].enabled = false;
        configs[2].zero_code = 0;
        configs[0].zero_code = 111;
        for _ in 0..MAX_ENTRIES {
            store.add("a rig", &configs, false).unwrap();
        }
        assert_eq!(store.references().unwrap()[1], first);
        assert_eq!(store.last().unwrap(), Some([111, 200, 300, 400, 500, 600]));
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text.matches("measured_at = \"20").count(), MAX_ENTRIES);
        store.add("a rig", &configs, true).unwrap();
        assert_eq!(
            store.references().unwrap(),
            [store.last().unwrap().unwrap(); 2]
        );
        std::fs::write(&path, "zero = 3").unwrap();
        let error = store.last().unwrap_err().to_string();
        assert!(error.contains("zeros.toml"), "{error}");
        assert_eq!(ZeroStore::none().last().unwrap(), None);
    }
}
