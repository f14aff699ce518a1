//! Files that are written, and the replacement of a rig file.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refuses.
    #[error("{} cannot be written: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The operating system's message.
        cause: std::io::Error,
    },
    /// There is no name left for the old file.
    #[error(
        "{}: all names from .before-1 to .before-9999 are taken; move the old files away",
        .0.display()
    )]
    NamesTaken(PathBuf),
}

impl FileError {
    fn at(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |cause| Self::Write {
            path: path.to_owned(),
            cause,
        }
    }
}

/// Writes a file.
///
/// # Errors
/// It can't be written.
pub fn write(path: &Path, text: &str) -> Result<(), FileError> {
    std::fs::write(path, text).map_err(FileError::at(path))
}

/// Replaces a rig file by a new one. The old file stays beside it under a new name. Returns both
/// paths.
///
/// # Errors
/// One of them can't be written; the rig file is then as it was.
pub fn replace(path: &Path, old: &str, new: &str) -> Result<(PathBuf, PathBuf), FileError> {
    let free = (1..10_000).find_map(|n| {
        let mut kept = path.as_os_str().to_owned();
        kept.push(format!(".before-{n}"));
        let kept = PathBuf::from(kept);
        // An existing file is not overwritten.
        match File::create_new(&kept) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => None,
            created => Some((kept, created)),
        }
    });
    let (kept, created) = free.ok_or_else(|| FileError::NamesTaken(path.to_owned()))?;
    created
        .and_then(|mut file| {
            file.write_all(old.as_bytes())?;
            file.sync_all()
        })
        .map_err(FileError::at(&kept))?;
    files::replace(path, new).map_err(FileError::at(path))?;
    Ok((path.to_owned(), kept))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_old_rig_file_is_kept_however_often() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, "one").expect("written");
        let read = |path: &Path| std::fs::read_to_string(path).expect("is there");
        let (_, first) = replace(&path, "one", "two").expect("replaced");
        let (_, second) = replace(&path, "two", "three").expect("replaced");
        assert_eq!(
            (read(&path), read(&first), read(&second)),
            ("three".into(), "one".into(), "two".into())
        );
        // Nothing else is left lying about.
        assert_eq!(std::fs::read_dir(&folder).expect("is there").count(), 3);
        // A place that can't be written to: an error, and the file is as it was.
        let failure =
            replace(&folder.path().join("none/rig.toml"), "x", "y").expect_err("is refused");
        assert!(failure.to_string().contains("cannot be written"));
    }
}
