//! Where the MCAP file's bytes go: kept in memory until a chunk is complete, then written, and
//! brought to the disk twice a second.
//!
//! A write that fails (a full disk, a drive that is gone) loses nothing at first: the file is cut
//! back to the last whole chunk, the bytes are kept, and the next flush tries again.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::time::{Duration, Instant};

/// A file, or what a test puts in its place.
pub trait Storage: Send {
    /// Writes all bytes from an offset on.
    ///
    /// # Errors
    /// As the system reports them.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;
    /// Cuts the file off.
    ///
    /// # Errors
    /// As the system reports them.
    fn cut(&mut self, length: u64) -> io::Result<()>;
    /// Brings what was written to the disk, so that it survives a loss of power.
    ///
    /// # Errors
    /// As the system reports them.
    fn sync(&mut self) -> io::Result<()>;
}

impl Storage for File {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.seek(SeekFrom::Start(offset))?;
        self.write_all(bytes)
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Shortest time between two syncs: chunks that are complete by their size follow each other faster
/// than a disk can sync.
const SYNC_PERIOD: Duration = Duration::from_millis(400);

/// Collects bytes; [`Write::flush`] brings them to the storage.
pub(super) struct Sink {
    storage: Box<dyn Storage>,
    /// Length of what is on the disk.
    stored: u64,
    waiting: Vec<u8>,
    /// Whether something was written since the last sync, and when that was.
    unsynced: bool,
    synced: Instant,
    /// Bytes that wait because of an error; shared with who decides what is still taken.
    backlog: std::sync::Arc<std::sync::atomic::AtomicU64>,
}

impl Sink {
    /// A sink, and the number of bytes that it could not write yet.
    pub(super) fn new(
        storage: Box<dyn Storage>,
    ) -> (Self, std::sync::Arc<std::sync::atomic::AtomicU64>) {
        let backlog = std::sync::Arc::default();
        let sink = Self {
            storage,
            stored: 0,
            waiting: Vec::new(),
            unsynced: false,
            synced: Instant::now(),
            backlog: std::sync::Arc::clone(&backlog),
        };
        (sink, backlog)
    }

    fn store(&mut self) -> io::Result<()> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let written = self.storage.write_at(self.stored, &self.waiting);
        let waiting = match &written {
            Ok(()) => {
                self.stored += self.waiting.len() as u64;
                self.waiting.clear();
                self.unsynced = true;
                0
            }
            Err(_) => {
                // Part of a chunk is of no use to a reader. Where this fails too, readers stop at
                // the part.
                let _ = self.storage.cut(self.stored);
                self.waiting.len() as u64
            }
        };
        self.backlog
            .store(waiting, std::sync::atomic::Ordering::Relaxed);
        written
    }

    /// Brings what was written to the disk.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.unsynced) {
            self.storage.sync()?;
        }
        Ok(())
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.waiting.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.store()?;
        if self.synced.elapsed() >= SYNC_PERIOD {
            self.synced = Instant::now();
            self.sync()?;
        }
        Ok(())
    }
}
