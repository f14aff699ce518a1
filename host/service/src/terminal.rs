//! A pseudo-terminal for a program that expects a serial port. It gets the board's frames and may
//! command, as a client.
//!
//! Nobody has to read it: what does not fit is dropped, and the service never waits.

use rustix::fs::{fcntl_setfl, OFlags};
use rustix::pty::{grantpt, openpt, ptsname, unlockpt, OpenptFlags};
use rustix::termios::{tcgetattr, tcsetattr, OptionalActions};
use std::fs::File;
use std::io::{self, Read, Write};

/// Bytes that are read at once.
const CHUNK: usize = 4096;

/// A pseudo-terminal. It ends with this value.
#[derive(Debug)]
pub(super) struct Terminal {
    master: File,
    /// Held open: the line stays raw, and reading the other side's end is no error while nobody has
    /// it open.
    _slave: File,
    path: String,
}

impl Terminal {
    /// Opens one in raw mode.
    ///
    /// # Errors
    /// Those of the operating system.
    pub(super) fn open() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = ptsname(&master, Vec::new())?
            .into_string()
            .map_err(|error| io::Error::other(error.to_string()))?;
        let slave = File::options()
            .read(true)
            .write(true)
            .custom_flags_noctty()
            .open(&path)?;
        let mut modes = tcgetattr(&slave)?;
        modes.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &modes)?;
        fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK)?;
        Ok(Self {
            master: File::from(master),
            _slave: slave,
            path,
        })
    }

    /// Path of the side that a program opens.
    pub(super) fn path(&self) -> &str {
        &self.path
    }

    /// What the program sent.
    pub(super) fn read(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut chunk = [0; CHUNK];
        while let Ok(length @ 1..) = self.master.read(&mut chunk) {
            bytes.extend_from_slice(&chunk[..length]);
            if length < CHUNK {
                break;
            }
        }
        bytes
    }

    /// Sends to the program. What does not fit is dropped: its decoder finds the next frame.
    pub(super) fn write(&mut self, bytes: &[u8]) {
        let _ = self.master.write(bytes);
    }
}

/// Opening without making it the controlling terminal.
trait NoControl {
    fn custom_flags_noctty(&mut self) -> &mut Self;
}

impl NoControl for std::fs::OpenOptions {
    fn custom_flags_noctty(&mut self) -> &mut Self {
        std::os::unix::fs::OpenOptionsExt::custom_flags(self, OFlags::NOCTTY.bits() as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_pass_unchanged_and_nobody_has_to_read() {
        let mut terminal = Terminal::open().unwrap();
        let mut program = File::options()
            .read(true)
            .write(true)
            .open(terminal.path())
            .unwrap();
        let all: Vec<u8> = (0..=255).collect();
        terminal.write(&all);
        let mut back = vec![0; all.len()];
        program.read_exact(&mut back).unwrap();
        assert_eq!(back, all);
        program.write_all(&all).unwrap();
        assert_eq!(terminal.read(), all);
        // Far more than its buffer holds, without a reader.
        for _ in 0..1000 {
            terminal.write(&all);
        }
        assert!(terminal.read().is_empty());
    }
}
