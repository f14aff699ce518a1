//! The measured data of the thesis rig: where they are looked for, and their two layouts.
//!
//! The data are public but not part of this project. They come as CSV with named columns
//! (`force_gauge/unitU_torqueT_compC.csv`) or as their author left them
//! (`force_gauge_records/motor_U/force_gauge_record_N_T_V_C.txt`, four columns without names, and
//! closed-loop runs as JSON).

use crate::error::Error;
use crate::spec::Spec;
use std::path::{Path, PathBuf};

/// Environment variable with the folder of data.
pub const DATA_VARIABLE: &str = "FORCE_DATA";
/// Where data are looked for when nothing says where, relative to the current folder.
pub const DATA_FOLDERS: [&str; 2] = ["data", "../shared/data"];
/// How to get the data.
pub const HOW_TO_GET_DATA: &str = "\
The measured data of the thesis rig are public. To get them:
  git clone https://github.com/TinNotTim/Ravn-II-testing-platform-torque-control data
  git -C data checkout 5e4966ee
and give the folder with --data, or in the environment variable FORCE_DATA. Your own logs need a model file \
that names their columns (docs/residual/model-toml.md)";

/// Records of one unit pulling a force gauge, all rows.
pub const GAUGE_ALL: &str = include_str!("../models/gauge-all.toml");
/// The same, rows in motion.
pub const GAUGE_MOVING: &str = include_str!("../models/gauge-moving.toml");
/// The same in the original layout.
pub const GAUGE_ORIGINAL: &str = include_str!("../models/gauge-original.toml");
/// Closed-loop runs.
pub const CLOSED_LOOP: &str = include_str!("../models/closed-loop.toml");

/// What is in a folder of the rig's data.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Data {
    /// Folder of force gauge records.
    pub gauge: Option<PathBuf>,
    /// Whether they are in the original layout.
    pub original: bool,
    /// Closed-loop runs: their folder, or the recordings where there is none.
    pub closed: Vec<PathBuf>,
}

impl Data {
    /// Looks for the folders `force_gauge` or `force_gauge_records`, and `closed_loop`, up to three
    /// levels below `root`; without the last, for closed-loop recordings in JSON.
    pub fn find(root: &Path) -> Data {
        let mut out = Data::default();
        let mut recordings = Vec::new();
        let mut level = vec![root.to_path_buf()];
        for _ in 0..4 {
            let mut next = Vec::new();
            for dir in level {
                match dir.file_name().and_then(|n| n.to_str()) {
                    Some("force_gauge") if out.gauge.is_none() || out.original => {
                        (out.gauge, out.original) = (Some(dir.clone()), false);
                    }
                    Some("force_gauge_records") if out.gauge.is_none() => {
                        (out.gauge, out.original) = (Some(dir.clone()), true);
                    }
                    Some("closed_loop") if out.closed.is_empty() => out.closed = vec![dir.clone()],
                    _ => {}
                }
                let Ok(entries) = std::fs::read_dir(&dir) else {
                    continue;
                };
                for path in entries.filter_map(|e| e.ok().map(|e| e.path())) {
                    if path.is_dir() {
                        next.push(path);
                    } else if path.extension().is_some_and(|e| e == "json") {
                        recordings.push(path);
                    }
                }
            }
            next.sort();
            level = next;
        }
        if out.closed.is_empty() {
            recordings.retain(|p| is_recording(p));
            recordings.sort();
            out.closed = recordings;
        }
        out
    }

    /// The folder to look in: as given, else the variable's, else the first default that has gauge
    /// records.
    ///
    /// # Errors
    /// [`Error::Data`] with the way to get the data.
    pub fn locate(given: Option<PathBuf>) -> Result<Data, Error> {
        let roots: Vec<PathBuf> =
            match given.or_else(|| std::env::var_os(DATA_VARIABLE).map(PathBuf::from)) {
                Some(root) => vec![root],
                None => DATA_FOLDERS.map(PathBuf::from).to_vec(),
            };
        roots
            .iter()
            .map(|r| Data::find(r))
            .find(|d| d.gauge.is_some())
            .ok_or_else(|| {
                let names: Vec<String> = roots.iter().map(|r| r.display().to_string()).collect();
                Error::data(
                    format!("no force gauge records in {}", names.join(" or ")),
                    HOW_TO_GET_DATA,
                )
            })
    }

    /// A gauge model for the layout found; `sequences` chooses the records by `comp`.
    ///
    /// # Errors
    /// [`Error::Model`].
    pub fn gauge_model(&self, text: &str, sequences: &str) -> Result<Spec, Error> {
        let mut spec = Spec::parse(text)?;
        spec.rows.sequences = sequences.into();
        if self.original {
            spec.input = Spec::parse(GAUGE_ORIGINAL)?.input;
            spec.rows.sequences = format!("({sequences}) && viscous == 0");
        }
        Ok(spec)
    }
}

/// Whether a JSON file is a closed-loop recording.
pub(crate) fn is_recording(path: &Path) -> bool {
    const KEY: &[u8] = b"\"load_cell_forces\"";
    std::fs::read(path).is_ok_and(|text| text.windows(KEY.len()).any(|w| w == KEY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_layouts_are_found_and_their_models_are_good() {
        let root = std::env::temp_dir().join(format!("residual-rig-{}", std::process::id()));
        std::fs::create_dir_all(root.join("clone/force_gauge_records/motor_1")).unwrap();
        std::fs::write(root.join("clone/other.json"), "{}").unwrap();
        std::fs::write(root.join("clone/run.json"), "{\"load_cell_forces\": []}").unwrap();
        let original = Data::find(&root);
        assert!(original.original && original.closed == [root.join("clone/run.json")]);
        std::fs::create_dir_all(root.join("rig/force_gauge")).unwrap();
        std::fs::create_dir_all(root.join("rig/closed_loop")).unwrap();
        let named = Data::find(&root);
        std::fs::remove_dir_all(&root).unwrap();
        assert!(!named.original && named.closed == [root.join("rig/closed_loop")]);
        for text in [GAUGE_ALL, GAUGE_MOVING] {
            let a = original.gauge_model(text, "comp == 0").unwrap();
            let b = named.gauge_model(text, "comp == 0").unwrap();
            assert_eq!(a.input.separator, "blank");
            assert_eq!(b.input.separator, ",");
        }
        Spec::parse(CLOSED_LOOP).unwrap();
        let error = Data::locate(Some(root)).unwrap_err().to_string();
        assert!(
            error.contains("git clone") && error.contains("5e4966ee"),
            "{error}"
        );
    }
}
