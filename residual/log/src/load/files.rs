//! Which files are read: logs below the given paths, by extension and by the name pattern of the
//! model file.

use super::Table;
use crate::finding::Findings;
use crate::spec::{Action, Input, Spec};
use residual_columns::error::Error;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What is under the paths.
#[derive(Default)]
pub(super) struct Found {
    /// The logs, sorted.
    pub(super) files: Vec<PathBuf>,
    /// What has the name of a log and is no file, such as a pipe: to read it could take without
    /// end.
    pub(super) passed: Vec<PathBuf>,
}

/// Every log under the paths, sorted, so that results do not depend on the file system. A path that
/// is a file is taken whatever its name; in folders logs are known by their extension, and only
/// regular files are taken.
///
/// # Errors
/// [`Error::Io`] if a path does not exist, or if there is no log.
pub fn find_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    Ok(find(paths)?.files)
}

/// As [`find_files`], with what was passed over.
pub(super) fn find(paths: &[PathBuf]) -> Result<Found, Error> {
    fn walk(path: &Path, out: &mut Found, seen: &mut Vec<PathBuf>, top: bool) -> Result<(), Error> {
        if path.is_dir() {
            // A link back to a folder above would be walked without end.
            let real = path.canonicalize().map_err(|e| Error::io(path, e))?;
            if seen.contains(&real) {
                return Ok(());
            }
            seen.push(real);
            let entries = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
            let mut inner: Vec<PathBuf> =
                entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
            inner.sort();
            inner.iter().try_for_each(|p| walk(p, out, seen, false))
        } else if !path.exists() {
            // A broken link in a folder is no log.
            if !top && path.is_symlink() {
                return Ok(());
            }
            Err(Error::io(path, "this file or folder does not exist"))
        } else {
            // A pipe that is given by name is what the user wants to be read.
            if top || (kind(path).is_some() && path.is_file()) {
                out.files.push(path.to_path_buf());
            } else if kind(path).is_some() {
                out.passed.push(path.to_path_buf());
            }
            Ok(())
        }
    }
    let (mut out, mut seen) = (Found::default(), Vec::new());
    paths
        .iter()
        .try_for_each(|p| walk(p, &mut out, &mut seen, true))?;
    if out.files.is_empty() {
        let first = paths.first().map_or(Path::new("."), PathBuf::as_path);
        return Err(Error::io(
            first,
            "no log (.csv, .txt, .tsv, .dat, .log, .lvm, .jsonl, .ndjson, each also as .gz, or .parquet) is in there; check the paths of the data",
        ));
    }
    Ok(out)
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Text,
    Parquet,
}

/// The format of a log by the extension of its name; `None` if it is not that of a log.
fn kind(path: &Path) -> Option<Kind> {
    match extension(path)?.as_str() {
        // Not `.json`: in a folder of logs that is a card or a setting more often than a log.
        "csv" | "txt" | "tsv" | "dat" | "log" | "lvm" | "ulg" | "jsonl" | "ndjson" => {
            Some(Kind::Text)
        }
        "parquet" | "pq" => Some(Kind::Parquet),
        _ => None,
    }
}

/// The extension in lower case, that of compression left out.
fn extension(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    Some(name.rsplit_once('.')?.1.into())
}

/// A Parquet log; `None` for another one.
pub(super) fn parquet(path: &Path) -> Option<Result<Table, Error>> {
    match kind(path)? {
        Kind::Text => None,
        #[cfg(feature = "parquet")]
        Kind::Parquet => Some(super::parquet::read(path)),
        #[cfg(not(feature = "parquet"))]
        Kind::Parquet => Some(Err(Error::io(
            path,
            "this program was built without the `parquet` feature; build it with the feature, or write the log as CSV",
        ))),
    }
}

/// Reads one log of a model.
pub(super) fn read_of(path: &Path, spec: &Spec) -> Result<Table, Error> {
    if !spec.input.messages.is_empty() && kind(path) != Some(Kind::Parquet) {
        return Ok(super::messages::read(path, spec)?.of(path));
    }
    let used = super::rows::largest_cells(spec)?;
    read(path, &spec.input, spec.hygiene.text, &used)
}

/// Reads one log; `used` and `lines` as for [`super::text::read`].
pub(super) fn read(
    path: &Path,
    input: &Input,
    lines: Action,
    used: &BTreeMap<String, f64>,
) -> Result<Table, Error> {
    let table = match parquet(path) {
        Some(table) => table,
        None => super::text::read(path, input, lines, Some(used)),
    }?;
    Ok(table.of(path))
}

/// Leaves out files of the folders whose name does not fit `input.file_name`, and notes them. A
/// file that was given by name must fit.
///
/// # Errors
/// [`Error::Io`] if no file fits.
pub(super) fn fitting(
    files: Vec<PathBuf>,
    given: &[PathBuf],
    spec: &Spec,
    findings: &mut Findings,
) -> Result<Vec<PathBuf>, Error> {
    if spec.input.file_name.is_empty() {
        return Ok(files);
    }
    let (fit, other): (Vec<PathBuf>, Vec<PathBuf>) = files
        .into_iter()
        .partition(|f| given.contains(f) || name_keys(f, &spec.input).is_some());
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
    Ok(fit)
}

/// Numbers at the places `{name}` of a file name pattern; `None` if the pattern does not fit.
fn file_keys(pattern: &str, name: &str) -> Option<Vec<(String, f64)>> {
    let Some((literal, tail)) = pattern.split_once('{') else {
        return name.starts_with(pattern).then(Vec::new);
    };
    // A literal may stand anywhere ahead, so that a pattern can skip what it ignores.
    let rest = &name[name.find(literal)? + literal.len()..];
    let (key, tail) = tail.split_once('}')?;
    let end = rest
        .find(|c: char| !(c.is_ascii_digit() || ".-+eE".contains(c)))
        .unwrap_or(rest.len());
    // The longest number with which the rest of the pattern fits; one that ends before the literal
    // that follows comes first, even where that begins with a dot.
    let next = tail.split('{').next().unwrap_or("");
    let begins = |n: &usize| !next.is_empty() && rest[*n..].starts_with(next);
    let (exact, other): (Vec<usize>, Vec<usize>) = (1..=end).rev().partition(begins);
    exact.into_iter().chain(other).find_map(|n| {
        let value: f64 = rest[..n].parse().ok()?;
        let mut keys = vec![(key.to_string(), value)];
        keys.extend(file_keys(tail, &rest[n..])?);
        Some(keys)
    })
}

/// Numbers that the model's pattern finds in a path; `None` if it does not fit.
pub(super) fn name_keys(path: &Path, input: &Input) -> Option<Vec<(String, f64)>> {
    let whole = path.to_string_lossy().replace('\\', "/");
    // A pattern with a slash is matched against the path, any other against the file's name.
    let name = if input.file_name.contains('/') {
        whole.as_str()
    } else {
        whole.rsplit('/').next().unwrap_or("")
    };
    file_keys(&input.file_name, name)
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
        assert_eq!(
            file_keys("{run}.TXT", "33.TXT").unwrap(),
            [("run".into(), 33.0)]
        );
        for (pattern, name, values) in [
            ("{a}.{b}.TXT", "1.1.TXT", vec![1.0, 1.0]),
            ("{a}.{b}.csv", "12.5.3.csv", vec![12.5, 3.0]),
            ("{a}-{b}.csv", "1-2.csv", vec![1.0, 2.0]),
            ("{run}_x", "1e1_x.csv", vec![10.0]),
            ("{run}_x", "1e-3_x.csv", vec![1e-3]),
            ("{run}e{x}.csv", "3e5.csv", vec![3.0, 5.0]),
            ("{run}east", "7east.csv", vec![7.0]),
            ("t{t}", "t-4.5.csv", vec![-4.5]),
        ] {
            let got = file_keys(pattern, name).unwrap_or_else(|| panic!("{pattern} {name}"));
            let got: Vec<f64> = got.iter().map(|k| k.1).collect();
            assert_eq!(got, values, "{pattern} {name}");
        }
    }
}
