//! Zeros that were measured on a rig, with their time: what later zeros are compared with,
//! whichever command took them.

use crate::{Result, StoreError};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use wire::message::UnitConfig;
use wire::UNITS;

/// How far a calibration of the converter misses the bridge's zero at most, N: the NAU7802
/// calibrates its offset at each power-up, to 0.5 to 1 % of the range of a 3 kg cell (29 N).
pub const POWER_UP_MISS_N: f64 = 0.3;
/// How far apart two zeros of a slack cable may lie, N, whichever command measured them: half again
/// [`POWER_UP_MISS_N`]. Friction leaves 0.7 N and more in a cable that pulls. Two calibrations that
/// miss to opposite sides lie up to 0.6 N apart: that slack cable is refused once (`--replace`
/// takes it), as a pulling one that is accepted makes every later force wrong.
pub const ZERO_TOLERANCE_N: f64 = 0.45;

/// Zeros kept of each rig.
const MAX_ENTRIES: usize = 200;
/// Variable with the folder of the stored zeros.
pub const FOLDER_VARIABLE: &str = "FORCECTL_STATE_DIR";

/// The stored zeros of one rig, a TOML file; or none, for runs of an emulated rig: its calibration
/// has one for each seed.
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
    /// Whether the user had those of all units accepted whatever the former ones were. Read only:
    /// files of before 0.2.0 have it.
    #[serde(default, skip_serializing)]
    accepted: bool,
    /// Units of which this was accepted whatever the former ones were (`--replace`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    replaced: Vec<u8>,
    /// Standard errors, ADC codes, and mounting parts, N, of units 1 to 6, where
    /// `forcectl calibrate zero` took them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    standard_error_codes: Option<[f64; UNITS]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mounting_n: Option<[f64; UNITS]>,
    /// Temperature in degrees Celsius, where a sensor gives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    temperature_c: Option<f64>,
}

/// A zero of one unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitZero {
    /// Unit, from 1.
    pub unit: u8,
    /// ADC code.
    pub code: i32,
    /// What `forcectl calibrate zero` knows of it beside: standard error, ADC codes, and mounting
    /// part, N.
    pub parts: Option<(f64, f64)>,
    /// Whether it was accepted whatever the former ones of the unit were.
    pub accepted: bool,
}

impl Entry {
    /// Whether the zero of a unit (index) was accepted whatever the former ones were.
    fn accepts(&self, i: usize) -> bool {
        self.accepted || self.replaced.iter().any(|unit| usize::from(*unit) == i + 1)
    }
}

/// The user's folder for what is known of rigs: [`FOLDER_VARIABLE`], else `forcectl` in
/// `XDG_STATE_HOME` or `~/.local/state`.
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

    /// The store of a rig in the user's folder: [`FOLDER_VARIABLE`], else `forcectl` in
    /// `XDG_STATE_HOME` or `~/.local/state`.
    #[must_use]
    pub fn of_rig(name: &str) -> Self {
        state_folder().map_or_else(Self::none, |folder| {
            Self::in_folder(&folder, &file_name(name, None))
        })
    }

    /// The store in the user's folder of a rig by its [`file_name`].
    pub(crate) fn in_folder(folder: &Path, name: &str) -> Self {
        Self::at(folder.join(format!("zeros-{name}.toml")))
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

    /// What zeros are compared with: the last ones, and of each unit the one that the user last
    /// accepted as it is (else the first). Each accepted zero may lie a step from the last one; the
    /// second keeps such steps from adding up. Empty where none are stored.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn references(&self) -> Result<Vec<[i32; UNITS]>> {
        let zeros = self.read()?.zero;
        let bases = bases_of(&zeros);
        let last = zeros.last().map(|entry| entry.zero_code);
        let base = |i: usize| zeros.get(bases[i]).map_or(0, |entry| entry.zero_code[i]);
        Ok(last
            .into_iter()
            .flat_map(|last| [last, std::array::from_fn(base)])
            .collect())
    }

    /// The last zeros, ADC codes; `None` where none are stored.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn last(&self) -> Result<Option<[i32; UNITS]>> {
        Ok(self.read()?.zero.last().map(|entry| entry.zero_code))
    }

    /// Every zero with its date, `YYYY-MM-DD`, oldest first; not those of units that were not
    /// measured: their code is 0 or the one before it.
    ///
    /// # Errors
    /// The file can't be read.
    pub fn all(&self) -> Result<Vec<(String, UnitZero)>> {
        let of = |entry: &Entry, i: usize| UnitZero {
            unit: i as u8 + 1,
            code: entry.zero_code[i],
            parts: (entry.standard_error_codes.zip(entry.mounting_n))
                .map(|(errors, mountings)| (errors[i], mountings[i]))
                .filter(|(error, _)| *error > 0.0),
            accepted: entry.accepts(i),
        };
        let zeros = self.read()?.zero;
        let mut all = Vec::new();
        let mut last = [0; UNITS];
        for entry in &zeros {
            let date: String = entry.measured_at.chars().take(10).collect();
            let measured = (0..UNITS)
                .filter(|i| entry.zero_code[*i] != 0)
                .map(|i| (i, of(entry, i)))
                .filter(|(i, zero)| zero.code != last[*i] || zero.parts.is_some() || zero.accepted);
            all.extend(measured.map(|(_, zero)| (date.clone(), zero)));
            last = entry.zero_code;
        }
        Ok(all)
    }

    /// Adds the zeros of a run. A unit that is disabled keeps its last one. `accepted`: the user
    /// had them accepted whatever the former ones were.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn add(&self, rig: &str, configs: &[UnitConfig; UNITS], accepted: bool) -> Result<()> {
        let enabled = configs.iter().zip(1..).filter(|(config, _)| config.enabled);
        let zeros = enabled.map(|(config, unit)| UnitZero {
            unit,
            code: config.zero_code,
            parts: None,
            accepted,
        });
        self.add_units(rig, &zeros.collect::<Vec<_>>())
    }

    /// Adds zeros of some units. The others keep their last ones.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn add_units(&self, rig: &str, zeros: &[UnitZero]) -> Result<()> {
        let Some(path) = &self.path else {
            return Ok(());
        };
        let mut file = self.read()?;
        let mut entry = Entry {
            measured_at: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            zero_code: file.zero.last().map_or([0; UNITS], |last| last.zero_code),
            accepted: false,
            temperature_c: None,
            replaced: Vec::new(),
            standard_error_codes: None,
            mounting_n: None,
        };
        for zero in zeros {
            let i = usize::from(zero.unit) - 1;
            entry.zero_code[i] = zero.code;
            if let Some((error, mounting)) = zero.parts {
                entry.standard_error_codes.get_or_insert_default()[i] = error;
                entry.mounting_n.get_or_insert_default()[i] = mounting;
            }
            if zero.accepted {
                entry.replaced.push(zero.unit);
            }
        }
        rig.clone_into(&mut file.rig);
        file.zero.push(entry);
        // The oldest go, but not those that later ones are compared with.
        while file.zero.len() > MAX_ENTRIES {
            let bases = bases_of(&file.zero);
            let oldest = (0..file.zero.len()).find(|n| !bases.contains(n));
            file.zero.remove(oldest.unwrap_or(0));
        }
        toml::to_string(&file)
            .map_err(std::io::Error::other)
            .and_then(|text| files::replace(path, text))
            .map_err(|error| unusable(path, &error))
    }
}

/// Index of the entry that all later ones of each unit are compared with: the last that the user
/// had accepted, else the first that has a zero of the unit.
fn bases_of(zeros: &[Entry]) -> [usize; UNITS] {
    std::array::from_fn(|i| {
        let accepted = zeros.iter().rposition(|entry| entry.accepts(i));
        let first = || zeros.iter().position(|entry| entry.zero_code[i] != 0);
        accepted.or_else(first).unwrap_or(0)
    })
}

/// A text as a part of the name of a file: letters and digits of ASCII as they are, others as the
/// number that Unicode gives them, so that rigs of two names are two; all else becomes `-`.
#[must_use]
pub fn file_name_part(text: &str) -> String {
    let safe = |c: char| match c {
        _ if c.is_ascii_alphanumeric() => c.to_string(),
        _ if c.is_alphanumeric() => format!("-{:x}", u32::from(c)),
        _ => "-".to_owned(),
    };
    text.chars().map(safe).collect()
}

/// A rig's part of the names of its files and folders. `seed`: that of an emulated rig, which is
/// another rig with each.
pub(crate) fn file_name(rig: &str, seed: Option<u64>) -> String {
    let safe = file_name_part(rig);
    seed.map_or(safe.clone(), |seed| format!("{safe}-seed{seed}"))
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
    use rig::Rig;

    #[test]
    fn names_in_other_letters_are_files_of_their_own() {
        assert_eq!(file_name_part("/dev/tty USB0"), "-dev-tty-USB0");
        assert_ne!(
            file_name_part("Labor \u{d6}"),
            file_name_part("Labor \u{c4}")
        );
        assert_eq!(file_name_part("Labor \u{d6}"), "Labor--d6");
    }

    #[test]
    fn zeros_are_kept_with_their_time_and_a_disabled_unit_keeps_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/zeros.toml");
        let store = ZeroStore::at(&path);
        assert_eq!(store.last().unwrap(), None);
        let mut configs = Rig::built_in().unwrap().units.map(|unit| unit.to_wire());
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

    #[test]
    fn units_are_accepted_one_by_one_and_old_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("zeros.toml");
        // As older versions wrote it.
        let old = "rig = \"a\"\n[[zero]]\nmeasured_at = \"2026-11-20T10:00:00Z\"\nzero_code = [1, 2, 3, 4, 5, 0]\n";
        std::fs::write(&path, old).unwrap();
        let store = ZeroStore::at(&path);
        let zero = |unit, code, accepted| UnitZero {
            unit,
            code,
            parts: Some((9.0, -0.5)),
            accepted,
        };
        store
            .add_units("a", &[zero(1, 10, false), zero(3, 30, true)])
            .unwrap();
        let last = [10, 2, 30, 4, 5, 0];
        let base = [1, 2, 30, 4, 5, 0];
        assert_eq!(store.references().unwrap(), [last, base]);
        let all = store.all().unwrap();
        // Five of the old file and the two that were measured, not what the others carry on.
        assert_eq!(all.len(), 7);
        assert_eq!((all[0].0.as_str(), all[0].1.parts), ("2026-11-20", None));
        assert_eq!(all[5].1, zero(1, 10, false));
        assert_eq!(all[6].1, zero(3, 30, true));
        // All that were measured are accepted, and the others still keep what they are compared
        // with.
        store
            .add_units("a", &[zero(1, 11, true), zero(2, 12, true)])
            .unwrap();
        store
            .add_units("a", &[zero(4, 44, false), zero(1, 99, true)])
            .unwrap();
        let base = [99, 12, 30, 4, 5, 0];
        assert_eq!(store.references().unwrap()[1], base);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(!text.contains("accepted"), "{text}");
    }
}
