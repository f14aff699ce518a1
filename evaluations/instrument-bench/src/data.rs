//! Reads the runs of the public data set.
//!
//! A file is one run of 20 s at 1 kHz: lines that begin with `%`, then ten columns,
//! comma-separated: time (s), spindle encoder (8192 counts a turn), torque sensor at the spindle,
//! motor current (A), encoder at the jaw, torque sensor at the jaw (3.9811e-5 N·m a count), current
//! of the load's motor, command, motor encoder (4096 counts a turn, gear of 35), trajectory. Its
//! name is `XY.TXT`: X the speed of the sine in steps of 0.1 Hz from 0.1 Hz, Y the load in steps of
//! a tenth from a tenth.

use rayon::prelude::*;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Where the data are to be had.
pub const SOURCE: &str = "https://github.com/MRDLab/mis-tool-characterization";
/// Rows a second.
pub const RATE_HZ: f64 = 1000.0;
const COLUMNS: usize = 10;
const TORQUE_MNM: f64 = 0.039_811;
const SPINDLE_RAD: f64 = TAU / 8192.0;
const MOTOR_RAD: f64 = TAU / (4096.0 * 35.0);

/// Why the data can't be used.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// The clone isn't there or holds no such set.
    #[error(
        "{}: {what}; clone {SOURCE} (Open Database License) and name the clone's folder with --data DIR", path.display()
    )]
    Absent {
        /// The folder.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
    /// A file can't be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A line has another form.
    #[error("{}:{line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
}

/// What an instrument's drive knows at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Current of the drive's motor, A.
    pub current_a: f64,
    /// Angle of the spindle by its own encoder, rad.
    pub spindle_rad: f64,
    /// Angle of the motor divided by the gear's ratio, rad, from an arbitrary zero; the sign of the
    /// spindle.
    pub motor_rad: f64,
}

/// One run: a sine of one speed against one load.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Folder and name, for people.
    pub name: String,
    /// Step of the speed, 0 for 0.1 Hz.
    pub speed: u8,
    /// Step of the load, 0 for a tenth.
    pub level: u8,
    /// What the drive knows.
    pub rows: Vec<Row>,
    /// Torque at the jaw, mN·m: the truth.
    pub torque_mnm: Vec<f64>,
}

/// Folder of the data in a clone, or the folder itself.
fn data_folder(clone: &Path) -> PathBuf {
    let inside = clone.join("data");
    if inside.is_dir() {
        inside
    } else {
        clone.to_owned()
    }
}

/// Reads all runs of a set, in the order of their names.
///
/// # Errors
/// [`DataError`] where the set isn't in the clone or a file isn't of the form above.
pub fn read_set(clone: &Path, set: &str) -> Result<Vec<Run>, DataError> {
    let folder = data_folder(clone).join(set);
    let absent = |what: &str| DataError::Absent {
        path: folder.clone(),
        what: what.to_owned(),
    };
    let entries = std::fs::read_dir(&folder).map_err(|_| absent("there is no such set"))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "TXT"))
        .collect();
    files.sort();
    if files.is_empty() {
        return Err(absent("there is no .TXT file"));
    }
    files.par_iter().map(|file| read_run(file, set)).collect()
}

/// Reads one run.
///
/// # Errors
/// [`DataError`] with file and line.
pub fn read_run(path: &Path, set: &str) -> Result<Run, DataError> {
    let text = std::fs::read_to_string(path).map_err(|source| DataError::Read {
        path: path.to_owned(),
        source,
    })?;
    let wrong = |line: usize, what: String| DataError::Line {
        path: path.to_owned(),
        line,
        what,
    };
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
    let stem = stem.unwrap_or_default();
    let digits: Vec<u8> = stem.bytes().map(|b| b.wrapping_sub(b'0')).collect();
    let (speed, level) = match digits[..] {
        [.., speed, level] if digits.iter().all(|d| *d < 10) => (speed, level),
        _ => {
            return Err(wrong(
                1,
                format!("the name `{stem}` is not of two or three digits"),
            ))
        }
    };
    let mut run = Run {
        name: format!("{set}/{stem}"),
        speed,
        level,
        rows: Vec::with_capacity(20_000),
        torque_mnm: Vec::with_capacity(20_000),
    };
    let mut last_s = None;
    for (number, line) in text.lines().enumerate() {
        if line.starts_with('%') || line.trim().is_empty() {
            continue;
        }
        let cells = cells(line).map_err(|what| wrong(number + 1, what))?;
        // Rows a millisecond apart; the stamp has three digits.
        if last_s.is_some_and(|last: f64| ((cells[0] - last) * RATE_HZ - 1.0).abs() > 0.5) {
            return Err(wrong(
                number + 1,
                "the time is not 1 ms after the line before".to_owned(),
            ));
        }
        last_s = Some(cells[0]);
        run.rows.push(Row {
            current_a: cells[3],
            spindle_rad: cells[1] * SPINDLE_RAD,
            // The two encoders count in opposite directions.
            motor_rad: -cells[8] * MOTOR_RAD,
        });
        run.torque_mnm.push(cells[5] * TORQUE_MNM);
    }
    if run.rows.len() < 3 * RATE_HZ as usize {
        let rows = run.rows.len();
        return Err(wrong(
            1,
            format!("{rows} rows; at least 3 s at 1 kHz are needed"),
        ));
    }
    Ok(run)
}

/// The ten numbers of a line.
fn cells(line: &str) -> Result<[f64; COLUMNS], String> {
    let mut cells = [0.0; COLUMNS];
    let mut parts = line.split(',');
    for (column, cell) in cells.iter_mut().enumerate() {
        let text = parts
            .next()
            .ok_or_else(|| format!("{column} cells where {COLUMNS} columns are expected"))?;
        *cell = text
            .trim()
            .parse()
            .ok()
            .filter(|value: &f64| value.is_finite())
            .ok_or_else(|| format!("`{}` in column {} is not a number", text.trim(), column + 1))?;
    }
    match parts.count() {
        0 => Ok(cells),
        more => Err(format!(
            "{} cells where {COLUMNS} columns are expected",
            COLUMNS + more
        )),
    }
}
