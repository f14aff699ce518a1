//! What an analysis works on: columns in memory, cut into sequences, with groups to hold out.

use crate::finding::Finding;
use crate::spec::FOLDS;
use residual_columns::error::Error;
use residual_columns::frame::Frame;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

/// Fewest rows that can be analysed.
pub const FEWEST_ROWS: usize = 30;

/// Largest magnitude of the value `name` of a model. The squares of a billion targets, and of a
/// billion products of two other values, have a sum that is finite.
pub fn largest(name: &str) -> f64 {
    if name == "target" {
        1e140
    } else {
        1e70
    }
}

/// Columns of numbers with what is held out of them.
///
/// The loader ([`load`](crate::load::load)) makes it from files. [`Data::from_columns`] makes it
/// from columns in memory; their names are those of the roles in the model (`target`, `command`,
/// `velocity` ...; names of pose, channels and groups as given there), in the units that the model
/// states. `[input]`, `[rows]`, `[holdout]` and `[hygiene]` of the model are the loader's; they
/// have no effect on columns in memory.
///
/// ```
/// use residual_log::data::Data;
///
/// // Two runs of 40 rows, 10 ms apart.
/// let time: Vec<f64> = (0..80).map(|i| f64::from(i % 40) * 0.01).collect();
/// let command: Vec<f64> = (0..80).map(|i| f64::from(i).sin()).collect();
/// let target: Vec<f64> = command.iter().map(|c| 0.9 * c).collect();
/// let data = Data::from_columns(time, [("command", command), ("target", target)])
///     .sequences([0..40, 40..80])
///     .build()?;
/// assert_eq!(data.groups(), 2);
/// assert_eq!(data.folds(), ["group 0", "group 1"]);
/// # Ok::<(), residual_columns::error::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Data {
    pub(crate) frame: Frame,
    pub(crate) keep: Vec<bool>,
    pub(crate) fold: Vec<u32>,
    pub(crate) fold_names: Vec<String>,
    pub(crate) groups: usize,
    /// For each row the part of a repeated motion that it belongs to, from 1; 0 where the motion
    /// does not repeat. Empty if it does nowhere.
    pub(crate) parts: Vec<u32>,
    pub(crate) files: Vec<PathBuf>,
    /// Rows that are fitted though their target is no measurement.
    pub(crate) suspects: Vec<usize>,
    /// Values per second of a target that is logged more often than it is measured.
    pub(crate) values_per_s: Option<f64>,
    pub(crate) hygiene: Vec<Finding>,
}

impl Data {
    /// Begins data from columns of equal length. `time` is in seconds and must grow within each
    /// sequence. Without [`sequences`](DataBuilder::sequences) all rows are one sequence; without
    /// [`groups`](DataBuilder::groups) each sequence is a group.
    pub fn from_columns<N: Into<String>>(
        time: Vec<f64>,
        columns: impl IntoIterator<Item = (N, Vec<f64>)>,
    ) -> DataBuilder {
        DataBuilder {
            time,
            columns: columns.into_iter().map(|(n, c)| (n.into(), c)).collect(),
            sequences: vec![],
            groups: vec![],
            keep: vec![],
            folds: FOLDS,
        }
    }

    /// The columns.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Whether each row is fitted.
    pub fn keep(&self) -> &[bool] {
        &self.keep
    }

    /// Fold of each row, from 0.
    pub fn fold(&self) -> &[u32] {
        &self.fold
    }

    /// Names of the groups in each fold.
    pub fn folds(&self) -> &[String] {
        &self.fold_names
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// Files that were read; empty for columns in memory.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Names of the files, without folders.
    pub fn file_names(&self) -> Vec<String> {
        let name = |f: &PathBuf| f.file_name().map(|n| n.to_string_lossy().into_owned());
        self.files
            .iter()
            .map(|f| name(f).unwrap_or_default())
            .collect()
    }

    /// For each row the part of a repeated motion that it belongs to, from 1; 0 where the motion
    /// does not repeat. Empty if it does nowhere.
    pub fn parts(&self) -> &[u32] {
        &self.parts
    }

    /// Rows that are fitted though their target is far from its neighbours or stands for a missing
    /// value: the model file did not ask to leave them out.
    pub fn suspects(&self) -> &[usize] {
        &self.suspects
    }

    /// Values per second of a target that is logged more often than it is measured; `None` where
    /// each row is a value of its own.
    pub fn values_per_s(&self) -> Option<f64> {
        self.values_per_s
    }

    /// Flaws of the data.
    pub fn findings(&self) -> &[Finding] {
        &self.hygiene
    }

    /// Indices of the rows that are fitted.
    pub fn kept_rows(&self) -> Vec<usize> {
        (0..self.keep.len()).filter(|i| self.keep[*i]).collect()
    }

    /// The same without rows whose target is one of `values`, and without `margin` rows before and
    /// after each.
    pub fn without_values(&self, values: &[f64], margin: usize) -> Data {
        let mut out = self.clone();
        let target = self.frame.column("target").unwrap_or(&[]);
        for i in (0..target.len()).filter(|i| values.contains(&target[*i])) {
            let last = (i + margin + 1).min(target.len());
            out.keep[i.saturating_sub(margin)..last].fill(false);
        }
        out
    }

    /// The same without the rows of one fold, which are not fitted and not held out; operators with
    /// memory still run over them.
    pub fn without_fold(&self, fold: u32) -> Data {
        let mut out = self.clone();
        out.keep
            .iter_mut()
            .zip(&self.fold)
            .for_each(|(k, f)| *k &= *f != fold);
        out.fold.iter_mut().for_each(|f| *f -= u32::from(*f > fold));
        out.fold_names.remove(fold as usize);
        out
    }
}

/// Columns in memory on the way to [`Data`]; [`Data::from_columns`] begins it.
#[derive(Debug, Clone)]
#[must_use = "build() makes the data"]
pub struct DataBuilder {
    time: Vec<f64>,
    columns: Vec<(String, Vec<f64>)>,
    sequences: Vec<Range<usize>>,
    groups: Vec<usize>,
    keep: Vec<bool>,
    folds: usize,
}

impl DataBuilder {
    /// Row ranges of unbroken runs, in order and without gaps. Operators with memory start afresh
    /// in each.
    pub fn sequences(mut self, ranges: impl IntoIterator<Item = Range<usize>>) -> DataBuilder {
        self.sequences = ranges.into_iter().collect();
        self
    }

    /// Group of each row. A group is held out as a whole; groups are dealt to the folds in turn, in
    /// the order in which they first appear.
    pub fn groups(mut self, group_of_row: Vec<usize>) -> DataBuilder {
        self.groups = group_of_row;
        self
    }

    /// Most folds (default 10).
    pub fn folds(mut self, most: usize) -> DataBuilder {
        self.folds = most;
        self
    }

    /// Whether each row is fitted; the others still carry the memory of operators.
    pub fn keep(mut self, rows: Vec<bool>) -> DataBuilder {
        self.keep = rows;
        self
    }

    /// Checks the columns and makes the data.
    ///
    /// # Errors
    /// [`Error::Data`]: columns of unequal length, no column `target`, a value that is not finite
    /// or too large to be squared and summed (beyond 1e140 in the target, 1e70 elsewhere),
    /// sequences that do not cover the rows, time that does not grow, fewer than 30 rows to fit,
    /// fewer than two groups.
    pub fn build(mut self) -> Result<Data, Error> {
        let rows = self.time.len();
        if self.sequences.is_empty() {
            self.sequences = std::iter::once(0..rows).collect();
        }
        if self.keep.is_empty() {
            self.keep = vec![true; rows];
        }
        self.check()?;
        if self.groups.is_empty() {
            self.groups = (0..self.sequences.len())
                .flat_map(|g| self.sequences[g].clone().map(move |_| g))
                .collect();
        }
        let (fold, fold_names, groups) = self.deal()?;
        Ok(Data {
            frame: Frame::new(self.columns, self.time, self.sequences),
            keep: self.keep,
            fold,
            fold_names,
            groups,
            parts: vec![],
            files: vec![],
            suspects: vec![],
            values_per_s: None,
            hygiene: vec![],
        })
    }

    fn check(&self) -> Result<(), Error> {
        let rows = self.time.len();
        let lengths = self.columns.iter().map(|(n, c)| (n.as_str(), c.len()));
        let groups = Some(("groups", self.groups.len())).filter(|(_, l)| *l > 0);
        let of_rows = groups.into_iter().chain([("keep", self.keep.len())]);
        if let Some((name, length)) = lengths.chain(of_rows).find(|(_, l)| *l != rows) {
            return Err(Error::data(
                format!("`{name}` has {length} rows, the time has {rows}"),
                "Give every column one value for each row",
            ));
        }
        if !self.columns.iter().any(|(n, _)| n == "target") {
            return Err(Error::data(
                "no column `target`",
                "Name the column that the model predicts `target`",
            ));
        }
        let columns = self.columns.iter().map(|(n, c)| (n.as_str(), c));
        for (name, values) in columns.chain([("time", &self.time)]) {
            if let Some(row) = values.iter().position(|x| !x.is_finite()) {
                return Err(Error::data(
                    format!("`{name}` is not finite in row {row}"),
                    "Leave such rows out and start a new sequence after them",
                ));
            }
            let largest = largest(name);
            if let Some(row) = values.iter().position(|x| x.abs() > largest) {
                return Err(Error::data(
                    format!(
                        "`{name}` is {:e} in row {row}, beyond {largest:e}: it cannot be squared and summed",
                        values[row]
                    ),
                    "Correct the value, or leave such rows out and start a new sequence after them",
                ));
            }
        }
        let mut end = 0;
        for r in &self.sequences {
            if r.start != end || r.end <= r.start || r.end > rows {
                return Err(Error::data(
                    format!("the sequence of rows {}..{} does not start at row {end}, or is empty, or ends after row {rows}", r.start, r.end),
                    "Give sequences in order that cover all rows",
                ));
            }
            end = r.end;
            if let Some(i) = (r.start + 1..r.end).find(|i| self.time[*i] <= self.time[i - 1]) {
                return Err(Error::data(
                    format!(
                        "time does not grow in row {i} ({} s after {} s)",
                        self.time[i],
                        self.time[i - 1]
                    ),
                    "Start a new sequence there",
                ));
            }
        }
        let kept = self.keep.iter().filter(|k| **k).count();
        if end != rows || kept < FEWEST_ROWS {
            return Err(Error::data(
                format!(
                    "the sequences cover {end} of {rows} rows, and {kept} rows are to be fitted"
                ),
                format!("Cover all rows, and keep at least {FEWEST_ROWS}"),
            ));
        }
        Ok(())
    }

    /// Deals the groups of kept rows to folds: fold of each row, names by fold, number of groups.
    fn deal(&self) -> Result<(Vec<u32>, Vec<String>, usize), Error> {
        let mut index: BTreeMap<usize, usize> = BTreeMap::new();
        let mut names: Vec<String> = Vec::new();
        for (g, _) in self.groups.iter().zip(&self.keep).filter(|(_, k)| **k) {
            index.entry(*g).or_insert_with(|| {
                names.push(format!("group {g}"));
                names.len() - 1
            });
        }
        let groups = names.len();
        if groups < 2 || self.folds < 2 {
            return Err(Error::data(
                format!(
                    "{groups} group(s) and at most {} fold(s) to hold out",
                    self.folds
                ),
                "Give at least two groups and two folds",
            ));
        }
        let count = groups.min(self.folds);
        let place = |g: &usize| index.get(g).map_or(0, |i| i % count);
        let mut fold_names = vec![Vec::new(); count];
        for (i, name) in names.into_iter().enumerate() {
            fold_names[i % count].push(name);
        }
        Ok((
            self.groups.iter().map(|g| place(g) as u32).collect(),
            fold_names.into_iter().map(|f| f.join("; ")).collect(),
            groups,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(rows: usize) -> DataBuilder {
        let time = (0..rows).map(|i| i as f64).collect();
        let values: Vec<f64> = (0..rows).map(|i| (i as f64).sin()).collect();
        Data::from_columns(time, [("target", values)])
    }

    #[test]
    fn groups_are_dealt_in_turn() {
        let data = columns(90)
            .groups((0..90).map(|i| 7 * (i / 30)).collect())
            .folds(2)
            .build()
            .unwrap();
        assert_eq!(data.groups(), 3);
        assert_eq!(data.folds(), ["group 0; group 14", "group 7"]);
        assert_eq!(
            (data.fold()[0], data.fold()[30], data.fold()[89]),
            (0, 1, 0)
        );
    }

    #[test]
    fn a_fold_can_be_taken_out() {
        let data = columns(120)
            .groups((0..120).map(|i| i / 30).collect())
            .build()
            .unwrap();
        let less = data.without_fold(1);
        assert_eq!(less.folds(), ["group 0", "group 2", "group 3"]);
        assert!(!less.keep()[30] && less.keep()[60]);
        assert_eq!(
            (less.fold()[0], less.fold()[60], less.fold()[119]),
            (0, 1, 2)
        );
    }

    #[test]
    fn what_is_wrong_with_columns_is_said() {
        let says = |b: DataBuilder, part: &str| {
            let text = b.build().unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        };
        says(columns(90), "1 group(s)");
        says(columns(90).groups(vec![0; 9]), "`groups` has 9 rows");
        says(
            columns(20).groups((0..20).collect()),
            "20 rows are to be fitted",
        );
        says(
            columns(90).sequences([0..30, 40..90]),
            "does not start at row 30",
        );
        says(columns(90).sequences([0..20, 20..30]), "cover 30 of 90");
        let mut nan = columns(90);
        nan.columns[0].1[5] = f64::NAN;
        says(nan, "`target` is not finite in row 5");
        let mut back = columns(90);
        back.time[5] = 3.0;
        says(back, "time does not grow in row 5");
        let mut other = columns(90);
        other.columns[0].0 = "y".into();
        says(other, "no column `target`");
    }
}
