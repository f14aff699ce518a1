//! Closed-loop recordings of the rig in their original JSON layout.
//!
//! One object per run. `load_cell_forces`, `load_cell_force_times`, `tor_cmds`, `p_terms`,
//! `i_terms`, `d_terms` and `setpoints` hold one list per unit (empty for idle units). Setpoints
//! are logged at their own rate; they are aligned by position in the run, because the recordings
//! have no better reference. The table has a column `unit` (from 1), which
//! `input.sequence = ["unit"]` splits it by.

use residual::load::Table;
use residual::Error;
use serde_json::Value;
use std::path::Path;

/// Key of the setpoints, which have a rate of their own.
const SETPOINTS: &str = "setpoints";

/// Keys of the lists, and the columns that they become.
const COLUMNS: [(&str, &str); 7] = [
    ("load_cell_force_times", "time_s"),
    ("load_cell_forces", "load_cell_n"),
    (SETPOINTS, "setpoint_n"),
    ("tor_cmds", "torque_cmd_mnm"),
    ("p_terms", "p_term"),
    ("i_terms", "i_term"),
    ("d_terms", "d_term"),
];

/// The list of unit `u` (from 0); a flat list of numbers holds for every unit.
fn list(root: &Value, key: &str, u: usize) -> Vec<f64> {
    let Some(outer) = root.get(key).and_then(Value::as_array) else {
        return vec![];
    };
    let inner = if outer.first().is_some_and(Value::is_array) {
        outer.get(u).and_then(Value::as_array)
    } else {
        Some(outer)
    };
    inner
        .map(|v| v.iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect())
        .unwrap_or_default()
}

/// Reads one recording.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read or is not a recording.
pub fn read(path: &Path) -> Result<Table, Error> {
    let fail = |why: String| Error::Io {
        path: path.to_path_buf(),
        why,
    };
    let text = std::fs::read_to_string(path).map_err(|e| fail(e.to_string()))?;
    let root: Value = serde_json::from_str(&text).map_err(|e| fail(e.to_string()))?;
    let units = root
        .get("load_cell_forces")
        .and_then(Value::as_array)
        .map_or(0, Vec::len);
    if units == 0 {
        return Err(fail(
            "not a closed-loop recording: no list `load_cell_forces`".into(),
        ));
    }
    let mut columns = vec![Vec::new(); COLUMNS.len()];
    let mut unit = Vec::new();
    for u in 0..units {
        let lists: Vec<Vec<f64>> = COLUMNS.iter().map(|(key, _)| list(&root, key, u)).collect();
        let n = lists[0].len().min(lists[1].len());
        for ((key, _), (column, values)) in COLUMNS.iter().zip(columns.iter_mut().zip(&lists)) {
            let m = values.len();
            column.extend((0..n).map(|i| match m {
                0 => 0.0,
                _ if *key == SETPOINTS => values[(i * m / n).min(m - 1)],
                _ => values.get(i).copied().unwrap_or(f64::NAN),
            }));
        }
        unit.extend(std::iter::repeat_n((u + 1) as f64, n));
    }
    let table = COLUMNS
        .iter()
        .zip(columns)
        .fold(Table::new(path), |table, ((_, name), values)| {
            table.with(*name, values)
        });
    Ok(table.with("unit", unit))
}
