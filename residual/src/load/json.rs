//! The closed-loop recordings of the rig in their original JSON layout.
//!
//! One object per run. `load_cell_forces`, `load_cell_force_times`, `tor_cmds`, `p_terms`,
//! `i_terms`, `d_terms` and `setpoints` hold one list per unit (empty for idle units). Setpoints are
//! logged at their own rate; they are aligned by position in the run, as nothing better is on file.
//! The rows come out with a `unit` column (from 1): part them with `input.sequence = ["unit"]`.

use super::{text, Raw};
use crate::error::Error;
use serde_json::Value;
use std::path::Path;

const COLUMNS: [(&str, &str); 7] = [
    ("load_cell_force_times", "time_s"),
    ("load_cell_forces", "load_cell_n"),
    ("setpoints", "setpoint_n"),
    ("tor_cmds", "torque_cmd_mnm"),
    ("p_terms", "p_term"),
    ("i_terms", "i_term"),
    ("d_terms", "d_term"),
];

/// The list of unit `u`; a flat list of numbers serves every unit.
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

/// Reads one run.
pub(super) fn read(path: &Path) -> Result<Raw, Error> {
    let root: Value = serde_json::from_reader(text::open(path)?).map_err(|e| Error::io(path, e))?;
    let units = root
        .get("load_cell_forces")
        .and_then(Value::as_array)
        .map_or(0, Vec::len);
    if units == 0 {
        return Err(Error::io(
            path,
            "not a closed-loop recording: no list `load_cell_forces`",
        ));
    }
    let mut raw = Raw {
        names: COLUMNS
            .iter()
            .map(|c| c.1.to_string())
            .chain(["unit".to_string()])
            .collect(),
        columns: vec![Vec::new(); 8],
        ..Raw::default()
    };
    for u in 0..units {
        let lists: Vec<Vec<f64>> = COLUMNS.iter().map(|(key, _)| list(&root, key, u)).collect();
        let n = lists[0].len().min(lists[1].len());
        for (c, values) in lists.iter().enumerate() {
            let m = values.len();
            raw.columns[c].extend((0..n).map(|i| match m {
                0 => 0.0,
                _ if c == 2 => values[(i * m / n).min(m - 1)],
                _ => values.get(i).copied().unwrap_or(f64::NAN),
            }));
        }
        raw.columns[7].extend(std::iter::repeat_n((u + 1) as f64, n));
    }
    Ok(raw)
}
