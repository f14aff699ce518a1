//! Which files are read: logs below the given paths, by extension and by the name pattern of the model file.

use super::Table;
use crate::error::Error;
use crate::hygiene;
use crate::spec::Spec;
use std::path::{Path, PathBuf};

/// Every log under the paths, sorted, so that results do not depend on the file system. A path that is a
/// file is taken whatever its name; in folders logs are known by their extension.
///
/// # Errors
/// [`Error::Io`] if a path does not exist, or if there is no log.
pub fn find_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    fn walk(
        path: &Path,
        out: &mut Vec<PathBuf>,
        seen: &mut Vec<PathBuf>,
        top: bool,
    ) -> Result<(), Error> {
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
            if top || kind(path).is_some() {
                out.push(path.to_path_buf());
            }
            Ok(())
        }
    }
    let (mut out, mut seen) = (Vec::new(), Vec::new());
    paths
        .iter()
        .try_for_each(|p| walk(p, &mut out, &mut seen, true))?;
    if out.is_empty() {
        let first = paths.first().map_or(Path::new("."), PathBuf::as_path);
        return Err(Error::io(
            first,
            "no log (.csv, .txt, .tsv, .dat, .log, each also as .gz, or .parquet) is in there; check the paths of the data",
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
        "csv" | "txt" | "tsv" | "dat" | "log" => Some(Kind::Text),
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

/// Reads one log.
pub(super) fn read(path: &Path, spec: &Spec) -> Result<Table, Error> {
    let table = match kind(path).unwrap_or(Kind::Text) {
        // A file that was given by name may have any extension, but JSON as CSV would only confuse.
        Kind::Text if extension(path).as_deref() == Some("json") => {
            Err(Error::io(path, "JSON is not a format of logs; write the log as CSV or Parquet"))
        }
        Kind::Text if !spec.input.messages.is_empty() => super::messages::read(path, spec),
        Kind::Text => {
            let used = super::rows::largest_cells(spec)?;
            super::text::read(path, &spec.input, spec.hygiene.text, Some(&used))
        }
        #[cfg(feature = "parquet")]
        Kind::Parquet => super::parquet::read(path),
        #[cfg(not(feature = "parquet"))]
        Kind::Parquet => Err(Error::io(
            path,
            "this program was built without the `parquet` feature; build it with the feature, or write the log as CSV",
        )),
    }?;
    Ok(table.of(path))
}

/// Leaves out files of the folders whose name does not fit `input.file_name`, and notes them. A file
/// that was given by name must fit.
///
/// # Errors
/// [`Error::Io`] if no file fits.
pub(super) fn fitting(
    files: Vec<PathBuf>,
    given: &[PathBuf],
    spec: &Spec,
    findings: &mut hygiene::Log,
) -> Result<Vec<PathBuf>, Error> {
    if spec.input.file_name.is_empty() {
        return Ok(files);
    }
    let (fit, other): (Vec<PathBuf>, Vec<PathBuf>) = files
        .into_iter()
        .partition(|f| given.contains(f) || name_keys(f, spec).is_some());
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
                // The number ends before the literal that follows, even where that begins with a dot.
                let next = tail.split('{').next().unwrap_or("");
                let fits = |n: usize| rest[..n].parse::<f64>().is_ok();
                let exact = (1..=n)
                    .rev()
                    .find(|n| fits(*n) && !next.is_empty() && rest[*n..].starts_with(next));
                n = exact.unwrap_or(n);
                while n > 0 && !fits(n) {
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
pub(super) fn name_keys(path: &Path, spec: &Spec) -> Option<Vec<(String, f64)>> {
    let whole = path.to_string_lossy().replace('\\', "/");
    // A pattern with a slash is matched against the path, any other against the file's name.
    let name = if spec.input.file_name.contains('/') {
        whole.as_str()
    } else {
        whole.rsplit('/').next().unwrap_or("")
    };
    file_keys(&spec.input.file_name, name)
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
    }
}
