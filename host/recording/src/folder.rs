//! The folder of a recording: whether it may be used, files that appear whole or not at all, and
//! their hashes.

use super::error::RecordError;
use super::format::{JSON_FILE, MCAP_FILE, SUMS_FILE, TABLES};
use super::read;
use std::path::Path;

/// Makes a folder ready for a recording.
///
/// # Errors
/// It can't be made, or holds a recording.
pub(super) fn prepare(folder: &Path) -> Result<(), RecordError> {
    std::fs::create_dir_all(folder).map_err(|error| RecordError::new(folder, &error))?;
    if holds_rows(folder) {
        return Err(RecordError::refused(
            folder,
            "it holds a recording already",
            "give another folder",
        ));
    }
    // What a start that failed has left.
    let tables = TABLES.iter().map(|table| table.file);
    for name in [MCAP_FILE, JSON_FILE, SUMS_FILE].into_iter().chain(tables) {
        let path = folder.join(name);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(RecordError::new(&path, &error))
            }
            _ => {}
        }
    }
    Ok(())
}

/// Whether a folder holds anything that was recorded: a message, or a Parquet file with a footer.
fn holds_rows(folder: &Path) -> bool {
    let message = |path: &Path| {
        read::Reader::open(path).is_ok_and(|mut reader| {
            reader.any(|entry| matches!(entry, read::Entry::Message { .. }))
        })
    };
    let parquet = TABLES.iter().any(|table| {
        let length = std::fs::metadata(folder.join(table.file)).map(|file| file.len());
        length.is_ok_and(|length| length > 0)
    });
    parquet || message(&folder.join(MCAP_FILE))
}

/// Writes a file so that it is there whole or as it was before.
pub(super) fn replace(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    files::replace(path, bytes).map_err(|error| RecordError::new(path, &error))
}

/// SHA-256 of a file, in hexadecimal.
pub(super) fn sha256(path: &Path) -> Result<String, RecordError> {
    files::sha256(path).map_err(|error| RecordError::unreadable(path, &error))
}

/// Writes the hashes of all files, in the form that `sha256sum --check` reads.
pub(super) fn write_sums(folder: &Path) -> Result<(), RecordError> {
    let mut text = String::new();
    let tables = TABLES.iter().map(|table| table.file);
    for name in [MCAP_FILE, JSON_FILE].into_iter().chain(tables) {
        let path = folder.join(name);
        if path.is_file() {
            text += &format!("{}  {name}\n", sha256(&path)?);
        }
    }
    replace(&folder.join(SUMS_FILE), text.as_bytes())
}
