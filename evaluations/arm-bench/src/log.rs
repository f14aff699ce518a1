//! Logs of an arm: numbers without a heading, one row an instant.

use std::path::{Path, PathBuf};

/// Why a log can't be used.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file can't be read.
    #[error("{}: {source}; clone {clone} and name the clone's folder", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
        /// Where the data are to be had.
        clone: &'static str,
    },
    /// Too little of it can be used.
    #[error("{}: {rows} rows can be used, at least {LEAST_ROWS} are needed; the first that can't is line {line}: {what}", path.display())]
    Short {
        /// The file.
        path: PathBuf,
        /// Rows.
        rows: usize,
        /// Line, from 1.
        line: usize,
        /// What is wrong with it.
        what: String,
    },
}

/// Rows that a log has at least.
const LEAST_ROWS: usize = 500;

/// What the columns of a log are.
#[derive(Debug, Clone, Copy)]
pub struct Columns {
    /// Columns of a row.
    pub count: usize,
    /// First column of the positions, rad or m.
    pub position: usize,
    /// First column of the velocities.
    pub rate: usize,
    /// First column of the currents or torques.
    pub effort: usize,
    /// Joints that are read.
    pub joints: usize,
    /// Absolute values from which a position, velocity or effort is no such thing: the row is
    /// dropped.
    pub beyond: [f64; 3],
    /// Where the data are to be had.
    pub clone: &'static str,
}

/// A log.
#[derive(Debug, Clone, Default)]
pub struct Log {
    /// Name, for people.
    pub name: String,
    /// Time between rows, s.
    pub step_s: f64,
    /// Positions.
    pub position: Vec<Vec<f64>>,
    /// Velocities.
    pub rate: Vec<Vec<f64>>,
    /// Currents or torques.
    pub effort: Vec<Vec<f64>>,
    /// All cells of the rows.
    pub cells: Vec<Vec<f64>>,
    /// Rows that were dropped: of another number of cells, or with an impossible value.
    pub dropped: usize,
}

/// The numbers of a line, or why it is none.
fn cells(line: &str, columns: &Columns) -> Result<Vec<f64>, String> {
    let cells: Vec<f64> = line
        .split(',')
        .map(|cell| cell.trim().parse().ok().filter(|v: &f64| v.is_finite()))
        .collect::<Option<_>>()
        .ok_or("not all cells are numbers")?;
    if cells.len() != columns.count {
        return Err(format!("{} cells, not {}", cells.len(), columns.count));
    }
    let starts = [columns.position, columns.rate, columns.effort];
    for (start, beyond) in starts.into_iter().zip(columns.beyond) {
        let of = &cells[start..start + columns.joints];
        if let Some(at) = of.iter().position(|value| value.abs() >= beyond) {
            return Err(format!("column {} is {}", start + at + 1, of[at]));
        }
    }
    Ok(cells)
}

/// Reads a log with `step_s` between its rows.
///
/// # Errors
/// [`LogError`]: the file can't be read, or few of its rows can be used.
pub fn read(folder: &Path, name: &str, step_s: f64, columns: &Columns) -> Result<Log, LogError> {
    let path = folder.join(name);
    let text = std::fs::read_to_string(&path).map_err(|source| LogError::Read {
        path: path.clone(),
        source,
        clone: columns.clone,
    })?;
    let mut log = Log {
        name: name.rsplit('/').next().unwrap_or(name).to_owned(),
        step_s,
        ..Log::default()
    };
    let mut wrong = None;
    for (number, line) in text.lines().enumerate() {
        match cells(line, columns) {
            Ok(cells) => {
                let part = |start: usize| cells[start..start + columns.joints].to_vec();
                log.position.push(part(columns.position));
                log.rate.push(part(columns.rate));
                log.effort.push(part(columns.effort));
                log.cells.push(cells);
            }
            Err(what) => {
                log.dropped += 1;
                wrong.get_or_insert((number + 1, what));
            }
        }
    }
    if log.cells.len() < LEAST_ROWS {
        let (line, what) = wrong.unwrap_or((log.cells.len() + 1, "there is none".to_owned()));
        return Err(LogError::Short {
            path,
            rows: log.cells.len(),
            line,
            what,
        });
    }
    Ok(log)
}
