//! One process runs a trial at a time: a lock file in the trial's folder, which names its owner.
//!
//! The lock is the operating system's on the open file (`flock` or its like), so it ends with the
//! process however that ends; the file that stays behind is no lock. On network file systems it
//! holds where these pass locks on (NFS 4 and NFS 3 with lockd do).

use super::error::ExperimentError;
use super::folder::Folder;
use super::table::failed;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::time::SystemTime;

/// Name of the file in the trial's folder.
const NAME: &str = "lock";

/// Held as long as it lives.
#[derive(Debug)]
pub struct TrialLock {
    _file: File,
}

impl TrialLock {
    /// Takes the lock of a trial.
    ///
    /// # Errors
    /// Another process has it, and which; or the file can't be written.
    pub fn take(folder: &Folder, trial: usize) -> Result<Self, ExperimentError> {
        let place = folder.trial(trial);
        let path = place.join(NAME);
        let io = |error: std::io::Error| ExperimentError::from(failed(&path, error));
        std::fs::create_dir_all(&place).map_err(io)?;
        let mut file = (OpenOptions::new().read(true).write(true).create(true))
            .truncate(false)
            .open(&path)
            .map_err(io)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut owner = String::new();
                // Without a name the refusal stands.
                let _ = file.read_to_string(&mut owner);
                return Err(ExperimentError::Folder(format!(
                    "trial {trial} in {} is run by another process ({}); wait until it has ended, or give this one other trials with --trial I/N",
                    folder.root().display(),
                    owner.trim()
                )));
            }
            Err(TryLockError::Error(error)) => return Err(io(error)),
        }
        let owner = format!(
            "process {} since {}\n",
            std::process::id(),
            humantime::format_rfc3339_seconds(SystemTime::now())
        );
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(owner.as_bytes()))
            .map_err(io)?;
        Ok(Self { _file: file })
    }
}
