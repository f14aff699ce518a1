//! Files that are there whole or as they were before, and their SHA-256.

use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A file that takes its place when it is complete. Dropped before, it leaves the old file.
#[derive(Debug)]
pub struct Part {
    path: PathBuf,
    beside: PathBuf,
    finished: bool,
}

impl Part {
    /// Begins the file of this path beside it, in the same folder, with `.part` after its name.
    /// Folders are made.
    ///
    /// # Errors
    /// It can't be made.
    pub fn begin(path: &Path) -> io::Result<(Self, File)> {
        let folder = folder_of(path);
        fs::create_dir_all(folder)?;
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let part = Self {
            path: path.to_owned(),
            beside: folder.join(name),
            finished: false,
        };
        let file = File::create(&part.beside)?;
        Ok((part, file))
    }

    /// Puts the file in its place: after this its content and its name survive a loss of power.
    ///
    /// # Errors
    /// It can't be written or moved.
    pub fn finish(mut self, file: File) -> io::Result<()> {
        file.sync_all()?;
        drop(file);
        fs::rename(&self.beside, &self.path)?;
        self.finished = true;
        // The name is an entry of the folder. Windows has no such call.
        if cfg!(unix) {
            File::open(folder_of(&self.path))?.sync_all()?;
        }
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if !self.finished {
            let _ = fs::remove_file(&self.beside);
        }
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Writes a file so that it is there whole or as it was before, also after a loss of power. Folders
/// are made.
///
/// # Errors
/// It can't be written.
pub fn replace(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let (part, mut file) = Part::begin(path)?;
    file.write_all(content.as_ref())?;
    part.finish(file)
}

/// SHA-256 of a file, in hexadecimal.
///
/// # Errors
/// It can't be read.
pub fn sha256(path: &Path) -> io::Result<String> {
    let mut hash = Sha256::new();
    io::copy(&mut File::open(path)?, &mut hash)?;
    Ok(hex(&hash.finalize()))
}

/// SHA-256 of bytes, in hexadecimal.
#[must_use]
pub fn sha256_of(bytes: impl AsRef<[u8]>) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_or_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/rig.toml");
        replace(&path, "old").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        // A writer that gives up.
        let (part, mut file) = Part::begin(&path).unwrap();
        file.write_all(b"half").unwrap();
        drop((part, file));
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        replace(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(fs::read_dir(folder.path().join("new")).unwrap().count(), 1);
        assert!(replace(&path.join("below a file"), "").is_err());
    }

    #[test]
    fn hashes_are_those_of_the_standard() {
        // FIPS 180-2, appendix B.1.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256_of("abc"), abc);
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), "abc").unwrap();
        assert_eq!(sha256(file.path()).unwrap(), abc);
    }
}
