//! Hold-out: which group each row belongs to, and which fold each group.

use crate::hygiene;
use crate::spec::Spec;
use residual_columns::error::Error;
use residual_columns::frame::Frame;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Folds of the rows.
pub(super) struct Folds {
    /// Fold of each row.
    pub(super) of_row: Vec<u32>,
    /// Names of the groups in each fold.
    pub(super) names: Vec<String>,
    /// Number of groups.
    pub(super) groups: usize,
    /// For each row of a sequence whose motion repeats its group, from 1, which is a block of one
    /// period; 0 for other rows. Empty if no motion repeats.
    pub(super) parts: Vec<u32>,
}

/// Assigns groups to folds in turn; rows that are not kept belong to fold 0.
///
/// # Errors
/// [`Error::Model`] if the hold-out names an unknown column, [`Error::Data`] if there is one group
/// only.
pub(super) fn folds(
    frame: &Frame,
    keep: &[bool],
    spec: &Spec,
    files: &[PathBuf],
) -> Result<Folds, Error> {
    let n = frame.len();
    let limit = if spec.holdout.folds == 0 {
        10
    } else {
        spec.holdout.folds
    };
    let by: Vec<String> = if spec.holdout.by.is_empty() && spec.holdout.block_s.is_none() {
        vec!["file".into()]
    } else {
        spec.holdout.by.clone()
    };
    let cols: Vec<&[f64]> = by
        .iter()
        .map(|b| {
            frame.column(b).ok_or_else(|| {
                Error::model(format!(
                    "holdout.by names `{b}`, which is no column of every file"
                ))
            })
        })
        .collect::<Result<_, _>>()?;
    let mut group_of_row = vec![0usize; n];
    let mut names: Vec<String> = Vec::new();
    let mut index: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
    let mut parts = vec![0; n];
    for (si, range) in frame.sequences().iter().enumerate() {
        let period = spec
            .holdout
            .block_s
            .and_then(|block| hygiene::period(frame, range, &spec.roles, block));
        for i in range.clone() {
            let mut key: Vec<u64> = cols.iter().map(|c| c[i].to_bits()).collect();
            if let Some(b) = spec.holdout.block_s {
                key.push(si as u64);
                let since = frame.time()[i] - frame.time()[range.start];
                // A period has a whole number of blocks: what is left over would be a group of few
                // rows.
                let block = period.map_or(since / b, |p| {
                    let blocks = (p / b).round();
                    (since % p / p * blocks).min(blocks - 1.0)
                });
                key.push(block as u64);
            }
            if !keep[i] {
                continue;
            }
            group_of_row[i] = *index.entry(key.clone()).or_insert_with(|| {
                let mut label: Vec<String> = by
                    .iter()
                    .zip(&cols)
                    .map(|(b, c)| label(b, c[i], files))
                    .collect();
                if spec.holdout.block_s.is_some() {
                    label.push(format!("block {}", key[key.len() - 1]));
                }
                names.push(label.join(", "));
                names.len() - 1
            });
            if period.is_some() {
                parts[i] = group_of_row[i] as u32 + 1;
            }
        }
    }
    let groups = names.len();
    if groups < 2 {
        return Err(Error::data(
            format!("only one group ({}) to hold out", names.join("")),
            "Bring data of a second file or unit, or set holdout.block_s to hold out blocks of time",
        ));
    }
    if parts.iter().all(|part| *part == 0) {
        parts.clear();
    }
    let count = groups.min(limit);
    let fold: Vec<u32> = group_of_row.iter().map(|g| (g % count) as u32).collect();
    let mut fold_names = vec![Vec::new(); count];
    for (g, name) in names.into_iter().enumerate() {
        fold_names[g % count].push(name);
    }
    Ok(Folds {
        of_row: fold,
        names: fold_names.into_iter().map(|f| f.join("; ")).collect(),
        groups,
        parts,
    })
}

/// Name of a group by one of its columns.
fn label(column: &str, value: f64, files: &[PathBuf]) -> String {
    if column == "file" {
        files
            .get(value as usize)
            .and_then(|f| f.file_name())
            .map_or("file".into(), |f| f.to_string_lossy().into_owned())
    } else {
        format!("{column} {value}")
    }
}

/// Refuses logs that are copies of each other: they would count as independent groups.
///
/// # Errors
/// [`Error::Data`] with the names of the files.
pub(super) fn refuse_copies(frame: &Frame, fold: &[u32], files: &[PathBuf]) -> Result<(), Error> {
    let target = frame.column("target").unwrap_or(&[]);
    let mut first: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
    for range in frame
        .sequences()
        .iter()
        .filter(|r| r.len() >= SHORTEST_COPY)
    {
        let values = &target[range.clone()];
        if values.iter().all(|v| *v == values[0]) {
            continue;
        }
        let key: Vec<u64> = values.iter().map(|v| v.to_bits()).collect();
        let Some(&other) = first.get(&key) else {
            first.insert(key, range.start);
            continue;
        };
        if fold[other] != fold[range.start] {
            let name = |row: usize| match frame.column("file") {
                Some(f) => label("file", f[row], files),
                None => "a sequence".into(),
            };
            return Err(Error::data(
                format!(
                    "{} and {} have the same {} target values: the log was copied, or the target was computed and not measured. They would count as independent groups",
                    name(other),
                    name(range.start),
                    range.len()
                ),
                "Leave one of them out of --data",
            ));
        }
    }
    Ok(())
}

/// Rows from which equal values are a copy.
const SHORTEST_COPY: usize = 30;
