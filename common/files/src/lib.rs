//! Files that are there whole or as they were before, which of them a command must not write, and
//! their SHA-256.

use sha2::{Digest, Sha256};
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read, Write};
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
    /// It can't be made, or something is there that is no regular file: a device would be replaced.
    pub fn begin(path: &Path) -> io::Result<(Self, File)> {
        if irregular(path) {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, IRREGULAR));
        }
        fs::create_dir_all(folder_of(path))?;
        let part = Self {
            path: path.to_owned(),
            beside: beside(path),
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

/// Where a file is written until it is complete.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    folder_of(path).join(name)
}

/// What is wrong with an output that is there and no file.
const IRREGULAR: &str = "something is there that is no regular file";

/// Whether something is there that is no regular file.
fn irregular(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file())
}

/// Why a file must not be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused(String);

impl std::error::Error for Refused {}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Looks at a file before a command that reads `inputs` writes it. Inputs are files and folders;
/// one that is not there counts as well. Writes nothing.
///
/// # Errors
/// The file is one of the inputs, by whatever path or link, or is written beside its place over
/// one; it would lie in a folder that is an input; or something is there that is no regular file.
pub fn check_output(path: &Path, inputs: &[&Path]) -> Result<(), Refused> {
    let refused = |why: String| {
        let path = path.display();
        Err(Refused(format!(
            "{path}: {why}. Nothing was written; name another file"
        )))
    };
    if irregular(path) {
        return refused(IRREGULAR.to_owned());
    }
    for input in inputs {
        if same(path, input) || same(&beside(path), input) {
            return refused(format!(
                "{} is read by this command and would be lost",
                input.display()
            ));
        }
        if real(path).starts_with(real(input)) {
            return refused(format!(
                "it would lie in {}, which this command reads",
                input.display()
            ));
        }
    }
    Ok(())
}

/// Whether two paths lead to one file.
fn same(one: &Path, other: &Path) -> bool {
    real(one) == real(other) || same_inode(one, other)
}

/// Whether two paths are links to one file.
#[cfg(unix)]
fn same_inode(one: &Path, other: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let inode = |path| fs::metadata(path).ok().map(|file| (file.dev(), file.ino()));
    inode(one).is_some_and(|one| inode(other) == Some(one))
}

/// Windows tells the number of a file only where it is open.
#[cfg(not(unix))]
fn same_inode(_: &Path, _: &Path) -> bool {
    false
}

/// A path without links, as far as it is there.
fn real(path: &Path) -> PathBuf {
    match (path.canonicalize(), path.file_name()) {
        (Ok(real), _) => real,
        (_, Some(name)) => real(folder_of(path)).join(name),
        (_, None) => path.to_owned(),
    }
}

/// The folder of a file.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
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

/// Longest text that is read whole, bytes: a configuration, a card, a table of readings. The
/// largest of ours (`result.json` of a long trial) has less than 1 MB.
const TEXT_MAX: u64 = 64 << 20;

/// Opens a file to read it. A pipe without a writer and `/dev/zero` have no end, and a pipe can't
/// be read twice: what is no regular file is refused before it is opened.
///
/// # Errors
/// It can't be opened, or is a folder, a pipe or a device.
pub fn open(path: &Path) -> io::Result<File> {
    let kind = fs::metadata(path)?.file_type();
    let wrong = match (kind.is_file(), kind.is_dir()) {
        (true, _) => return File::open(path),
        (_, true) => "it is a folder and not a regular file",
        _ => {
            "it is a pipe or a device and not a regular file; write what it gives to a file, \
             and name that"
        }
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, wrong))
}

/// The text of a file, read whole. It may be a pipe, as a shell makes for `<(...)`.
///
/// # Errors
/// As [`open`], but for a pipe; it is no UTF-8, or has more than 64 MiB.
pub fn read_text(path: &Path) -> io::Result<String> {
    let file = match is_pipe(path)? {
        true => File::open(path)?,
        false => open(path)?,
    };
    let long = || {
        let text = format!(
            "it has more than {} MiB: another file is meant",
            TEXT_MAX >> 20
        );
        io::Error::new(io::ErrorKind::FileTooLarge, text)
    };
    if file.metadata()?.len() > TEXT_MAX {
        return Err(long());
    }
    // One that grows meanwhile, or of a file system that does not tell its length.
    let text = io::read_to_string(file.take(TEXT_MAX + 1))?;
    if text.len() as u64 > TEXT_MAX {
        return Err(long());
    }
    Ok(text)
}

#[cfg(unix)]
fn is_pipe(path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::FileTypeExt;
    Ok(fs::metadata(path)?.file_type().is_fifo())
}

#[cfg(not(unix))]
fn is_pipe(_: &Path) -> io::Result<bool> {
    Ok(false)
}

/// SHA-256 of a file, in hexadecimal.
///
/// # Errors
/// It can't be read.
pub fn sha256(path: &Path) -> io::Result<String> {
    let mut hash = Sha256::new();
    io::copy(&mut open(path)?, &mut hash)?;
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
    fn a_folder_and_a_text_that_is_too_long_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let why = read_text(folder.path()).unwrap_err().to_string();
        assert!(why.contains("folder"), "{why}");
        let long = folder.path().join("long");
        // A file with a hole takes no space.
        File::create(&long).unwrap().set_len(TEXT_MAX + 1).unwrap();
        let why = read_text(&long).unwrap_err().to_string();
        assert!(why.contains("64 MiB"), "{why}");
        fs::write(&long, "text").unwrap();
        assert_eq!(read_text(&long).unwrap(), "text");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_without_an_end_is_refused() {
        for result in [
            open(Path::new("/dev/zero")).map(drop),
            sha256(Path::new("/dev/zero")).map(drop),
        ] {
            assert!(result.unwrap_err().to_string().contains("a device"));
        }
    }

    #[test]
    fn an_output_that_would_cost_an_input_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("rec/deep")).unwrap();
        for name in ["log.csv", "rec/run.mcap", "new.parquet.part"] {
            fs::write(at(name), name).unwrap();
        }
        let (log, rec, part) = (at("log.csv"), at("rec"), at("new.parquet.part"));
        let inputs = [log.as_path(), &rec, &part];
        let check = |name: &str| check_output(&at(name), &inputs);
        for name in ["log.csv", "rec/../log.csv", "new.parquet"] {
            let why = check(name).unwrap_err().to_string();
            assert!(why.contains("would be lost"), "{why}");
        }
        for name in ["rec/run.mcap", "rec/new", "rec/deep/er/new"] {
            let why = check(name).unwrap_err().to_string();
            assert!(why.contains("it would lie in"), "{why}");
        }
        for name in ["rec", "rec/deep"] {
            let why = check(name).unwrap_err().to_string();
            assert!(why.contains("no regular file"), "{why}");
        }
        for name in ["joined.parquet", "record", "new/joined.parquet"] {
            assert_eq!(check(name), Ok(()), "{name}");
        }
        // An input that is not there yet, for example one with a wrong name.
        let none = at("none.csv");
        assert!(check_output(&none, &[&none]).is_err());
        assert_eq!(fs::read_to_string(&log).unwrap(), "log.csv");
    }

    #[cfg(unix)]
    #[test]
    fn links_to_an_input_are_seen_and_a_device_is_not_replaced() {
        use std::os::unix::fs::{symlink, FileTypeExt};
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("rec")).unwrap();
        fs::write(at("rec/log.csv"), "log").unwrap();
        symlink(at("rec/log.csv"), at("link")).unwrap();
        symlink(at("rec"), at("folder")).unwrap();
        fs::hard_link(at("rec/log.csv"), at("hard")).unwrap();
        for name in ["link", "hard", "folder/log.csv"] {
            let refused = check_output(&at(name), &[&at("rec/log.csv")]);
            assert!(refused.is_err(), "{name}");
        }
        assert!(check_output(&at("folder/new"), &[&at("rec")]).is_err());
        // A socket stands for a device.
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        let why = check_output(&at("socket"), &[]).unwrap_err().to_string();
        assert!(why.contains("no regular file"), "{why}");
        let why = replace(&at("socket"), "text").unwrap_err().to_string();
        assert!(why.contains("no regular file"), "{why}");
        assert!(fs::metadata(at("socket")).unwrap().file_type().is_socket());
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
