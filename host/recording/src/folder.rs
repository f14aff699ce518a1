//! The folder of a recording: whether it may be used, files that appear whole or not at all, and their hashes.

use super::{read, RecordError, JSON_FILE, MCAP_FILE, SUMS_FILE, TABLES};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// Makes a folder ready for a recording.
///
/// # Errors
/// It can't be made, or holds a recording.
pub(super) fn prepare(folder: &Path) -> Result<(), RecordError> {
    std::fs::create_dir_all(folder).map_err(|error| RecordError::new(folder, &error))?;
    if holds_rows(folder) {
        return Err(RecordError::new(
            folder,
            &"it holds a recording already; give another folder",
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
    let part = part_of(path);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write().map_err(|error| {
        let _ = std::fs::remove_file(&part);
        RecordError::new(path, &error)
    })
}

/// Name of a file while it is written.
pub(super) fn part_of(path: &Path) -> std::path::PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    path.with_file_name(name)
}

/// SHA-256 of a file, in hexadecimal.
///
/// # Errors
/// It can't be read.
pub fn sha256(path: &Path) -> Result<String, RecordError> {
    let mut hash = Sha256::new();
    let mut file = File::open(path).map_err(|error| RecordError::unreadable(path, &error))?;
    let mut bytes = vec![0; 1 << 20];
    loop {
        match file.read(&mut bytes) {
            Ok(0) => break,
            Ok(count) => hash.update(&bytes[..count]),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(RecordError::unreadable(path, &error)),
        }
    }
    Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
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
