//! Where the measured data of the thesis rig are, and in which layout. Depends on the standard
//! library alone, because `cargo xtask residual-report` includes this file to look for the data
//! before it builds anything.
//!
//! The data are public but not part of this project. They come as CSV with named columns
//! (`force_gauge/unitU_torqueT_compC.csv`) or as their author published them
//! (`force_gauge_records/motor_U/force_gauge_record_N_T_V_C.txt`, four columns without names, and
//! closed-loop recordings as JSON).

use std::path::{Path, PathBuf};

/// Environment variable with the folder of data.
pub const VARIABLE: &str = "FORCE_DATA";
/// Where data are looked for when neither an option nor the variable says where.
pub const FOLDERS: [&str; 2] = ["data", "../shared/data"];
/// How to get the data.
pub const HOW_TO_GET: &str = "\
The measured data of the thesis rig are public. To get them:
  git clone https://github.com/TinNotTim/Ravn-II-testing-platform-torque-control data
  git -C data checkout 5e4966ee
and give the folder with --data, or in the environment variable FORCE_DATA.";

/// What is in a folder of the rig's data.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Data {
    /// Folder of force gauge records.
    pub gauge: Option<PathBuf>,
    /// Whether they are in the original layout.
    pub original: bool,
    /// Folder of closed-loop runs as CSV.
    pub closed: Option<PathBuf>,
    /// Closed-loop recordings as JSON, where that folder does not exist.
    pub recordings: Vec<PathBuf>,
}

impl Data {
    /// Looks for the folders `force_gauge` or `force_gauge_records`, and `closed_loop`, up to three
    /// levels below `root`; without the last, for closed-loop recordings in JSON.
    pub fn find(root: &Path) -> Data {
        let mut out = Data::default();
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
                    Some("closed_loop") if out.closed.is_none() => out.closed = Some(dir.clone()),
                    _ => {}
                }
                let Ok(entries) = std::fs::read_dir(&dir) else {
                    continue;
                };
                for path in entries.filter_map(|e| e.ok().map(|e| e.path())) {
                    if path.is_dir() {
                        next.push(path);
                    } else if path.extension().is_some_and(|e| e == "json") {
                        out.recordings.push(path);
                    }
                }
            }
            next.sort();
            level = next;
        }
        if out.closed.is_some() {
            out.recordings.clear();
        }
        out.recordings.retain(|p| is_recording(p));
        out.recordings.sort();
        out
    }

    /// The data in the folder given, else in the variable's, else in the first of [`FOLDERS`] that
    /// has gauge records. Relative paths start at `base`.
    ///
    /// # Errors
    /// Where was looked, and how to get the data.
    pub fn locate(given: Option<PathBuf>, base: &Path) -> Result<Data, String> {
        let variable = || std::env::var_os(VARIABLE).map(PathBuf::from);
        let roots: Vec<PathBuf> = match given.or_else(variable) {
            Some(root) => vec![base.join(root)],
            None => FOLDERS.map(|folder| base.join(folder)).to_vec(),
        };
        let mut found = roots.iter().map(|root| Data::find(root));
        found.find(|data| data.gauge.is_some()).ok_or_else(|| {
            let names: Vec<String> = roots.iter().map(|r| r.display().to_string()).collect();
            format!(
                "no force gauge records in {}. {HOW_TO_GET}",
                names.join(" or ")
            )
        })
    }
}

/// Whether a JSON file is a closed-loop recording.
fn is_recording(path: &Path) -> bool {
    const KEY: &[u8] = b"\"load_cell_forces\"";
    std::fs::read(path).is_ok_and(|text| text.windows(KEY.len()).any(|w| w == KEY))
}
