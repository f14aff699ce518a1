//! The error of each log by itself, and logs whose error is unlike that of the others.

use residual_columns::format::num;
use residual_columns::nan;
use residual_columns::stats::{few_unlike, UNLIKE};
use residual_log::data::Data;
use residual_log::finding::Finding;
use residual_log::hygiene::UNLIKE_LOG;
use serde::{Deserialize, Serialize};

/// Held-out error of one log, in the target's unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogError {
    /// Name of the file.
    pub file: String,
    /// Its rows that were fitted.
    pub rows: usize,
    /// Held-out RMSE of the declared model.
    #[serde(deserialize_with = "nan::from_null")]
    pub declared_rmse: f64,
    /// Held-out RMSE of the final model.
    #[serde(deserialize_with = "nan::from_null")]
    pub final_rmse: f64,
}

/// The errors of each log, in the order of the files; empty for a single one. `declared` and `last`
/// are held-out errors of the rows that are fitted, in the target's unit.
pub fn by_log(declared: &[f64], last: &[f64], data: &Data) -> Vec<LogError> {
    let names = data.file_names();
    let rows = data.kept_rows();
    let Some(file_of) = data.frame().column("file") else {
        return vec![];
    };
    if names.len() < 2 || [declared.len(), last.len()] != [rows.len(); 2] {
        return vec![];
    }
    let mut sums = vec![(0, 0.0, 0.0); names.len()];
    for ((row, before), after) in rows.iter().zip(declared).zip(last) {
        if let Some(sum) = sums.get_mut(file_of[*row] as usize) {
            *sum = (sum.0 + 1, sum.1 + before * before, sum.2 + after * after);
        }
    }
    let logs = names.into_iter().zip(sums);
    logs.filter(|(_, (rows, ..))| *rows > 0)
        .map(|(file, (rows, before, after))| LogError {
            file,
            rows,
            declared_rmse: (before / rows as f64).sqrt(),
            final_rmse: (after / rows as f64).sqrt(),
        })
        .collect()
}

/// What is said of few logs whose error with the final model is far above that of the others.
pub fn unlike_logs(logs: &[LogError], unit: &str) -> Option<Finding> {
    let errors: Vec<f64> = logs.iter().map(|log| log.final_rmse).collect();
    let (unlike, of_others) = few_unlike(&errors)?;
    let unlike: Vec<&LogError> = unlike.into_iter().map(|i| &logs[i]).collect();
    let each = unlike
        .iter()
        .map(|log| format!("{}: {} {unit}", log.file, num(log.final_rmse)));
    let what = format!(
        "few logs are unlike the others: a held-out RMSE of more than {UNLIKE} times the median of the others, {} {unit} ({}). \
         Analyse them by themselves, and the others without them",
        num(of_others),
        each.collect::<Vec<_>>().join(", ")
    );
    Some(Finding {
        check: UNLIKE_LOG.into(),
        count: unlike.iter().map(|log| log.rows).sum(),
        first: unlike[0].file.clone(),
        what,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn logs(errors: &[f64]) -> Vec<LogError> {
        let of = |(i, error): (usize, &f64)| LogError {
            file: format!("{i}.csv"),
            rows: 100,
            declared_rmse: 1.0,
            final_rmse: *error,
        };
        errors.iter().enumerate().map(of).collect()
    }

    #[test]
    fn few_logs_above_the_others_are_named() {
        let said = |errors: &[f64]| unlike_logs(&logs(errors), "N");
        let found = said(&[0.1, 0.12, 0.5, 0.09, 0.1]).unwrap();
        assert_eq!((found.first.as_str(), found.count), ("2.csv", 100));
        assert!(found.what.contains("2.csv: 0.5000 N"), "{found:?}");
        assert_eq!(said(&[0.1, 0.19, 0.12, 0.1]), None);
    }

    #[test]
    fn a_single_log_has_no_table() {
        let rows: Vec<f64> = (0..40).map(f64::from).collect();
        let data = Data::from_columns(rows.clone(), [("target", rows.clone())])
            .groups((0..40).map(|i| i / 10).collect())
            .build()
            .unwrap();
        assert_eq!(by_log(&rows, &rows, &data), []);
    }
}
