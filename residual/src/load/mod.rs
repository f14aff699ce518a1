//! From paths to a [`Frame`]: finds files, reads them, cuts sequences, applies units.

mod json;
#[cfg(feature = "parquet")]
mod parquet;
mod text;

use crate::data::{Data, FEWEST_ROWS};
use crate::error::Error;
use crate::expr::Expr;
use crate::frame::Frame;
use crate::hygiene;
use crate::spec::{Action, Spec};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One file's columns, as read.
#[derive(Debug, Clone, Default)]
pub(crate) struct Raw {
    /// Column names, in order.
    pub names: Vec<String>,
    /// Values by column; missing cells are NaN.
    pub columns: Vec<Vec<f64>>,
    /// Columns of text that were left out: name, first cell and its line.
    pub text: Vec<(String, String, u64)>,
}

impl Raw {
    /// Why a wanted column is not there.
    fn lacks(&self, column: &str, path: &Path) -> Error {
        match self.text.iter().find(|(name, ..)| name == column) {
            Some((_, text, line)) => Error::BadCell {
                path: path.to_path_buf(),
                line: *line,
                column: column.into(),
                text: text.clone(),
            },
            None => Error::MissingColumn {
                column: column.into(),
                path: path.to_path_buf(),
                found: self.names.clone(),
            },
        }
    }

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.names
            .iter()
            .position(|n| n == name)
            .map(|i| self.columns[i].as_slice())
    }
}

/// Every data file under the paths, sorted, so that results do not depend on the file system.
pub fn find_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    fn walk(path: &Path, out: &mut Vec<PathBuf>, top: bool) -> Result<(), Error> {
        if path.is_dir() {
            let entries = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
            let mut inner: Vec<PathBuf> =
                entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
            inner.sort();
            inner.iter().try_for_each(|p| walk(p, out, false))
        } else if !path.exists() {
            Err(Error::io(path, "no such file or folder"))
        } else {
            if top || kind(path).is_some() {
                out.push(path.to_path_buf());
            }
            Ok(())
        }
    }
    let mut out = Vec::new();
    paths.iter().try_for_each(|p| walk(p, &mut out, true))?;
    if out.is_empty() {
        let first = paths.first().map_or(Path::new("."), PathBuf::as_path);
        return Err(Error::io(
            first,
            "no .csv, .txt, .json (each also as .gz) or .parquet file is in there; check the paths of the data",
        ));
    }
    Ok(out)
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Text,
    Json,
    Parquet,
}

fn kind(path: &Path) -> Option<Kind> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    match name.rsplit_once('.')?.1 {
        "csv" | "txt" | "tsv" | "dat" => Some(Kind::Text),
        "json" => Some(Kind::Json),
        "parquet" | "pq" => Some(Kind::Parquet),
        _ => None,
    }
}

/// Whether a file is plain JSON, but no closed-loop recording.
fn other_json(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("json"))
        && !crate::rig::is_recording(path)
}

fn read(path: &Path, spec: &Spec) -> Result<Raw, Error> {
    match kind(path).unwrap_or(Kind::Text) {
        Kind::Text => text::read(path, &spec.input),
        Kind::Json => json::read(path),
        #[cfg(feature = "parquet")]
        Kind::Parquet => parquet::read(path),
        #[cfg(not(feature = "parquet"))]
        Kind::Parquet => Err(Error::io(path, "built without the `parquet` feature")),
    }
}

/// Numbers at the places `{name}` of a file name pattern; `None` if the pattern does not fit.
fn file_keys(pattern: &str, name: &str) -> Option<Vec<(String, f64)>> {
    let mut out = Vec::new();
    let mut rest = name;
    let mut pattern = pattern;
    loop {
        match pattern.split_once('{') {
            None => return rest.starts_with(pattern).then_some(out),
            Some((literal, tail)) => {
                // A literal may stand anywhere ahead, so that a pattern can skip what it ignores.
                let at = rest.find(literal)?;
                rest = &rest[at + literal.len()..];
                let (key, tail) = tail.split_once('}')?;
                let mut n = rest
                    .find(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
                    .unwrap_or(rest.len());
                while n > 0 && rest[..n].parse::<f64>().is_err() {
                    n -= 1;
                }
                out.push((key.to_string(), rest[..n].parse().ok()?));
                rest = &rest[n..];
                pattern = tail;
            }
        }
    }
}

/// Numbers that the model's pattern finds in a path; `None` if it does not fit.
fn name_keys(path: &Path, spec: &Spec) -> Option<Vec<(String, f64)>> {
    let whole = path.to_string_lossy().replace('\\', "/");
    // A pattern with a slash speaks about the path, any other about the file's name.
    let name = if spec.input.file_name.contains('/') {
        whole.as_str()
    } else {
        whole.rsplit('/').next().unwrap_or("")
    };
    file_keys(&spec.input.file_name, name)
}

/// Loads everything that the model file asks for.
///
/// # Errors
/// Any [`Error`]: missing columns, cells that are not numbers, time that runs backwards, too few
/// rows or groups.
pub fn load(paths: &[PathBuf], spec: &Spec) -> Result<Data, Error> {
    let mut findings = hygiene::Log::default();
    let files = find_files(paths)?;
    // A folder may hold JSON of other kinds, such as a report; a file that was given by name is read.
    let (mut files, other): (Vec<PathBuf>, Vec<PathBuf>) = files
        .into_iter()
        .partition(|f| paths.contains(f) || !other_json(f));
    if let Some(first) = other.first() {
        if files.is_empty() {
            return Err(Error::io(
                first,
                "no closed-loop recording: no list `load_cell_forces`, and there is no other log in the folder",
            ));
        }
        findings.count(
            "other JSON",
            other.len(),
            &first.display().to_string(),
            "JSON files in the folders that are no recordings were not read",
        );
    }
    if !spec.input.file_name.is_empty() {
        // A folder may hold other things; a file that was given by name must fit.
        let (fit, other): (Vec<PathBuf>, Vec<PathBuf>) = files
            .into_iter()
            .partition(|f| paths.contains(f) || name_keys(f, spec).is_some());
        if let Some(first) = other.first() {
            if fit.is_empty() {
                return Err(Error::io(
                    first,
                    format!(
                        "this file's name does not fit input.file_name = \"{}\", nor does any other of the {} found; \
                         correct the pattern in the model file, or --data",
                        spec.input.file_name,
                        other.len()
                    ),
                ));
            }
            findings.count(
                "file name",
                other.len(),
                &first.display().to_string(),
                "files in the folders whose name does not fit input.file_name were not read",
            );
        }
        files = fit;
    }
    let roles = spec.roles.all();
    // All results first: of several bad files it is always the first that is told.
    let results: Vec<Result<Raw, Error>> = files
        .par_iter()
        .map(|path| {
            let mut raw = read(path, spec)?;
            if !spec.input.file_name.is_empty() {
                let keys = name_keys(path, spec).ok_or_else(|| {
                    Error::io(
                        path,
                        format!(
                            "the file name does not fit input.file_name = \"{}\"",
                            spec.input.file_name
                        ),
                    )
                })?;
                let n = raw.columns.first().map_or(0, Vec::len);
                for (key, value) in keys {
                    raw.names.push(key);
                    raw.columns.push(vec![value; n]);
                }
            }
            for (_, c) in &roles {
                if raw.column(&c.column).is_none() {
                    return Err(raw.lacks(&c.column, path));
                }
            }
            for s in &spec.input.sequence {
                if raw.column(s).is_none() {
                    return Err(raw.lacks(s, path));
                }
            }
            Ok(raw)
        })
        .collect();
    let raws = results.into_iter().collect::<Result<Vec<Raw>, Error>>()?;

    let names = wanted(spec, &raws)?;
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let mut time = Vec::new();
    let mut file_of_row: Vec<u32> = Vec::new();
    let mut sequences = Vec::new();
    for (fi, raw) in raws.iter().enumerate() {
        let label = files[fi].display().to_string();
        if raw.columns.first().is_none_or(Vec::is_empty) {
            findings.count("empty file", 1, &label, "files without a row");
        }
        for rows in split_by(raw, &spec.input.sequence) {
            let tc = &spec.roles.time;
            let source = raw.column(&tc.column).unwrap_or(&[]);
            let cells: Vec<(&[f64], f64, f64)> = names
                .iter()
                .map(|n| match roles.iter().find(|(role, _)| role == n) {
                    Some((_, c)) => (raw.column(&c.column).unwrap_or(&[]), c.scale, c.offset),
                    None => (raw.column(n).unwrap_or(&[]), 1.0, 0.0),
                })
                .collect();
            let begin = time.len();
            let mut bad = 0usize;
            let mut last = f64::NEG_INFINITY;
            let mut backwards = 0usize;
            for &i in &rows {
                let t = source[i] * tc.scale + tc.offset;
                if !t.is_finite() || cells.iter().any(|(c, ..)| !c[i].is_finite()) {
                    bad += 1;
                    continue;
                }
                if t <= last {
                    if spec.hygiene.time != Action::Drop {
                        return Err(Error::data(
                            format!("{label}: time does not grow at row {} ({t} s after {last} s)", i + 2),
                            "Part the file with input.sequence, or set hygiene.time = \"drop\" to leave such rows out",
                        ));
                    }
                    backwards += 1;
                    continue;
                }
                last = t;
                time.push(t);
                file_of_row.push(fi as u32);
                for (out, (c, k, o)) in columns.iter_mut().zip(&cells) {
                    out.push(c[i] * k + o);
                }
            }
            findings.count(
                "non-finite",
                bad,
                &label,
                "rows with an empty or non-finite cell in a mapped column were left out",
            );
            findings.count(
                "time",
                backwards,
                &label,
                "rows whose time did not grow were left out",
            );
            cut_at_gaps(
                &time,
                begin,
                spec.hygiene.gap_s,
                &mut sequences,
                &mut findings,
                &label,
            );
        }
    }
    if time.is_empty() {
        let empty: Vec<String> = roles
            .iter()
            .filter(|(_, c)| {
                raws.iter().all(|r| {
                    r.column(&c.column)
                        .is_none_or(|v| v.iter().all(|x| !x.is_finite()))
                })
            })
            .map(|(role, c)| format!("`{}` ({role})", c.column))
            .collect();
        let which = if empty.is_empty() || raws.iter().all(|r| r.columns.iter().all(Vec::is_empty))
        {
            String::new()
        } else {
            format!("; {} has none at all", empty.join(", "))
        };
        return Err(Error::data(
            format!("no row with finite values in every mapped column{which}"),
            "Look at the columns named in [roles], or leave a role out that was not logged",
        ));
    }
    let file_column: Vec<f64> = file_of_row.iter().map(|&f| f as f64).collect();
    let mut named: Vec<(String, Vec<f64>)> = names.into_iter().zip(columns).collect();
    named.push(("file".into(), file_column));
    let mut frame = Frame::new(named, time, sequences);
    if !spec.rows.sequences.is_empty() {
        frame = keep_sequences(&frame, &Expr::parse(&spec.rows.sequences)?)?;
    }
    let mut keep = vec![true; frame.len()];
    if !spec.rows.keep.is_empty() {
        let mask = Expr::parse(&spec.rows.keep)?.eval(&frame)?;
        keep.iter_mut()
            .zip(&mask)
            .for_each(|(k, m)| *k = *m != 0.0 && !m.is_nan());
    }
    hygiene::inspect(&mut frame, &mut keep, &spec.hygiene, &files, &mut findings);
    let kept = keep.iter().filter(|k| **k).count();
    if kept < FEWEST_ROWS {
        return Err(Error::data(
            format!("only {kept} rows are left to fit"),
            "Look at rows.keep and rows.sequences, or bring more data",
        ));
    }
    let (fold, fold_names, groups) = folds(&frame, &keep, spec, &files)?;
    let used: Vec<PathBuf> = {
        let mut ids: Vec<usize> = frame
            .column("file")
            .unwrap_or(&[])
            .iter()
            .map(|f| *f as usize)
            .collect();
        ids.dedup();
        ids.into_iter().map(|i| files[i].clone()).collect()
    };
    Ok(Data {
        frame,
        keep,
        fold,
        fold_names,
        groups,
        files: used,
        hygiene: findings.done(),
    })
}

/// Columns to keep in memory: roles, and raw columns that an expression or the hold-out names.
fn wanted(spec: &Spec, raws: &[Raw]) -> Result<Vec<String>, Error> {
    let mut names: Vec<String> = spec
        .roles
        .all()
        .into_iter()
        .map(|(n, _)| n)
        .filter(|n| n != "time")
        .collect();
    let mut extra = std::collections::BTreeSet::new();
    for text in spec
        .terms
        .iter()
        .map(|t| &t.expr)
        .chain([&spec.rows.keep, &spec.rows.sequences])
        .filter(|t| !t.is_empty())
    {
        extra.extend(Expr::parse(text)?.names());
    }
    extra.extend(spec.holdout.by.iter().cloned());
    extra.extend(spec.input.sequence.iter().cloned());
    for n in extra {
        if !names.contains(&n)
            && !["time", "elapsed", "file"].contains(&n.as_str())
            && raws.iter().all(|r| r.column(&n).is_some())
        {
            names.push(n);
        }
    }
    Ok(names)
}

/// Rows of each combination of the sequence columns, in order of appearance.
fn split_by(raw: &Raw, by: &[String]) -> Vec<Vec<usize>> {
    let n = raw.columns.first().map_or(0, Vec::len);
    if by.is_empty() {
        return vec![(0..n).collect()];
    }
    let cols: Vec<&[f64]> = by.iter().filter_map(|b| raw.column(b)).collect();
    let mut order = Vec::new();
    let mut groups: BTreeMap<Vec<u64>, Vec<usize>> = BTreeMap::new();
    for i in 0..n {
        let key: Vec<u64> = cols.iter().map(|c| c[i].to_bits()).collect();
        groups
            .entry(key.clone())
            .or_insert_with(|| {
                order.push(key);
                Vec::new()
            })
            .push(i);
    }
    order.iter().filter_map(|k| groups.remove(k)).collect()
}

fn cut_at_gaps(
    time: &[f64],
    begin: usize,
    gap_s: f64,
    out: &mut Vec<std::ops::Range<usize>>,
    log: &mut hygiene::Log,
    label: &str,
) {
    if begin == time.len() {
        return;
    }
    let mut steps: Vec<f64> = time[begin..].windows(2).map(|w| w[1] - w[0]).collect();
    let limit = if gap_s > 0.0 {
        gap_s
    } else {
        20.0 * crate::stats::median(&mut steps).unwrap_or(f64::INFINITY)
    };
    let mut start = begin;
    let mut gaps = 0;
    for i in begin + 1..time.len() {
        if time[i] - time[i - 1] > limit {
            out.push(start..i);
            start = i;
            gaps += 1;
        }
    }
    out.push(start..time.len());
    log.count(
        "gap",
        gaps,
        label,
        "gaps in time; memory starts afresh after each",
    );
}

fn keep_sequences(frame: &Frame, keep: &Expr) -> Result<Frame, Error> {
    let mask = keep.eval(frame)?;
    let kept: Vec<_> = frame
        .sequences()
        .iter()
        .filter(|r| mask[(*r).clone()].iter().any(|m| *m != 0.0))
        .cloned()
        .collect();
    if kept.is_empty() {
        return Err(Error::data(
            format!("rows.sequences = \"{keep}\" keeps nothing"),
            "Check the expression",
        ));
    }
    let gather = |c: &[f64]| {
        kept.iter()
            .flat_map(|r| c[r.clone()].iter().copied())
            .collect::<Vec<f64>>()
    };
    let columns = frame
        .names()
        .iter()
        .filter(|n| *n != "time" && *n != "elapsed")
        .map(|n| (n.clone(), gather(frame.column(n).unwrap_or(&[]))))
        .collect();
    let mut at = 0;
    let sequences = kept
        .iter()
        .map(|r| {
            at += r.len();
            at - r.len()..at
        })
        .collect();
    Ok(Frame::new(columns, gather(frame.time()), sequences))
}

/// Deals groups to folds.
fn folds(
    frame: &Frame,
    keep: &[bool],
    spec: &Spec,
    files: &[PathBuf],
) -> Result<(Vec<u32>, Vec<String>, usize), Error> {
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
    for (si, range) in frame.sequences().iter().enumerate() {
        for i in range.clone() {
            let mut key: Vec<u64> = cols.iter().map(|c| c[i].to_bits()).collect();
            if let Some(b) = spec.holdout.block_s {
                key.push(si as u64);
                key.push(((frame.time()[i] - frame.time()[range.start]) / b) as u64);
            }
            if !keep[i] {
                continue;
            }
            group_of_row[i] = *index.entry(key.clone()).or_insert_with(|| {
                let mut label: Vec<String> = by
                    .iter()
                    .zip(&cols)
                    .map(|(b, c)| {
                        if b == "file" {
                            files
                                .get(c[i] as usize)
                                .and_then(|f| f.file_name())
                                .map_or("file".into(), |f| f.to_string_lossy().into_owned())
                        } else {
                            format!("{b} {}", c[i])
                        }
                    })
                    .collect();
                if spec.holdout.block_s.is_some() {
                    label.push(format!("block {}", key[key.len() - 1]));
                }
                names.push(label.join(", "));
                names.len() - 1
            });
        }
    }
    let groups = names.len();
    if groups < 2 {
        return Err(Error::data(
            format!("only one group ({}) to hold out", names.join("")),
            "Bring data of a second file or unit, or set holdout.block_s to hold out blocks of time",
        ));
    }
    let count = groups.min(limit);
    let fold: Vec<u32> = group_of_row.iter().map(|g| (g % count) as u32).collect();
    let mut fold_names = vec![Vec::new(); count];
    for (g, name) in names.into_iter().enumerate() {
        fold_names[g % count].push(name);
    }
    Ok((
        fold,
        fold_names.into_iter().map(|f| f.join("; ")).collect(),
        groups,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_name_patterns_pick_numbers() {
        let got = file_keys(
            "unit{unit}_torque{t}_comp{c}",
            "unit3_torque35_comp14_repeat1.csv",
        )
        .unwrap();
        assert_eq!(
            got,
            [("unit".into(), 3.0), ("t".into(), 35.0), ("c".into(), 14.0)]
        );
        assert_eq!(
            file_keys("kp{kp}_ki{ki}", "wave_kp10.0_ki0.2.csv").unwrap(),
            [("kp".into(), 10.0), ("ki".into(), 0.2)]
        );
        assert!(file_keys("unit{unit}", "other.csv").is_none());
    }
}
