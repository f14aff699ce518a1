//! One connection: a thread reads lines into the hub's queue, another writes what the hub wants to say.
//!
//! The hub never waits for a client. What a client does not read in time is dropped where it is telemetry, and ends the
//! connection where it is an answer.

use super::hub::{ClientId, Inbound};
use super::protocol::{self, Request, MAX_LINE};
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// Lines of telemetry that wait for a client at most: 8 s of ticks.
const MAX_TELEMETRY: usize = 4096;
/// Lines in all that wait for a client at most. One that leaves more unread is disconnected.
const MAX_WAITING: usize = 5120;

/// Numbers of clients: 0 is the pseudo-terminal.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// A number for a new client.
pub(super) fn next_id() -> ClientId {
    NEXT_ID.fetch_add(1, Ordering::Relaxed)
}

/// A stream in both directions.
pub(super) trait Stream: Send {
    /// Its reading and its writing half.
    ///
    /// # Errors
    /// Those of the operating system.
    fn halves(self) -> io::Result<(Box<dyn Read + Send>, Box<dyn Closing>)>;
}

/// A writing half that can end both halves.
pub(super) trait Closing: Write + Send {
    /// Ends the connection: the reading half gets an end of file.
    fn close(&self);
}

impl Closing for UnixStream {
    fn close(&self) {
        let _ = self.shutdown(std::net::Shutdown::Both);
    }
}

impl Closing for TcpStream {
    fn close(&self) {
        let _ = self.shutdown(std::net::Shutdown::Both);
    }
}

impl Stream for UnixStream {
    fn halves(self) -> io::Result<(Box<dyn Read + Send>, Box<dyn Closing>)> {
        Ok((Box::new(self.try_clone()?), Box::new(self)))
    }
}

impl Stream for TcpStream {
    fn halves(self) -> io::Result<(Box<dyn Read + Send>, Box<dyn Closing>)> {
        self.set_nodelay(true)?;
        Ok((Box::new(self.try_clone()?), Box::new(self)))
    }
}

#[derive(Debug, Default)]
struct Waiting {
    lines: VecDeque<Arc<str>>,
    dropped: u64,
    closed: bool,
}

/// Lines on their way to a client. Clones share them.
#[derive(Debug, Clone, Default)]
pub(super) struct Outbox {
    shared: Arc<(Mutex<Waiting>, Condvar)>,
}

impl Outbox {
    fn with<T>(&self, act: impl FnOnce(&mut Waiting) -> T) -> T {
        let (lock, signal) = &*self.shared;
        let result = act(&mut lock.lock().unwrap_or_else(PoisonError::into_inner));
        signal.notify_one();
        result
    }

    /// Telemetry: dropped and counted where the client is behind.
    pub(super) fn telemetry(&self, line: Arc<str>) {
        self.with(|waiting| {
            if waiting.lines.len() >= MAX_TELEMETRY {
                waiting.dropped += 1;
            } else {
                waiting.lines.push_back(line);
            }
        });
    }

    /// An answer or an event. Ends the connection where the client has left too much unread.
    pub(super) fn line(&self, line: impl Into<Arc<str>>) {
        let line = line.into();
        self.with(|waiting| {
            if waiting.lines.len() >= MAX_WAITING {
                waiting.closed = true;
            } else {
                waiting.lines.push_back(line);
            }
        });
    }

    /// What the client did not read in time.
    pub(super) fn dropped(&self) -> u64 {
        self.with(|waiting| waiting.dropped)
    }

    /// Ends the connection after what is waiting.
    pub(super) fn close(&self) {
        self.with(|waiting| waiting.closed = true);
    }

    /// The next lines; `None` at the end.
    fn next(&self) -> Option<Vec<Arc<str>>> {
        let (lock, signal) = &*self.shared;
        let mut waiting = lock.lock().unwrap_or_else(PoisonError::into_inner);
        while waiting.lines.is_empty() && !waiting.closed {
            waiting = signal.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
        if waiting.lines.is_empty() || (waiting.closed && waiting.lines.len() >= MAX_WAITING) {
            return None;
        }
        Some(waiting.lines.drain(..).collect())
    }
}

/// Starts the two threads of a connection and reports it to the hub.
///
/// # Errors
/// Those of the operating system.
pub(super) fn start(
    stream: impl Stream,
    id: ClientId,
    trusted: bool,
    hub: &Sender<Inbound>,
) -> io::Result<()> {
    let (reader, mut writer) = stream.halves()?;
    let outbox = Outbox::default();
    let to_hub = hub.clone();
    let writing = outbox.clone();
    std::thread::Builder::new()
        .name(format!("client {id} out"))
        .spawn(move || {
            while let Some(lines) = writing.next() {
                let text: String = lines.iter().map(|line| &**line).collect();
                if writer.write_all(text.as_bytes()).is_err() {
                    break;
                }
            }
            writing.close();
            writer.close();
        })?;
    // The hub learns of the client before anything that it says.
    let _ = to_hub.send(Inbound::Opened {
        id,
        trusted,
        outbox: outbox.clone(),
    });
    std::thread::Builder::new()
        .name(format!("client {id} in"))
        .spawn(move || {
            read(reader, id, &outbox, &to_hub);
            let _ = to_hub.send(Inbound::Closed { id });
        })?;
    Ok(())
}

/// Reads lines until the end.
fn read(reader: impl Read, id: ClientId, outbox: &Outbox, hub: &Sender<Inbound>) {
    let mut reader = BufReader::new(reader);
    loop {
        let mut line = Vec::new();
        let limited = (&mut reader)
            .take(MAX_LINE as u64)
            .read_until(b'\n', &mut line);
        match limited {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let text = String::from_utf8_lossy(&line);
        if text.trim().is_empty() {
            continue;
        }
        match Request::parse(&text) {
            Ok(request) => {
                if hub.send(Inbound::Request { id, request }).is_err() {
                    return;
                }
            }
            Err((request_id, code, message)) => {
                let request_id = request_id.unwrap_or_default();
                outbox.line(protocol::answer(&request_id, &Err((code, message))));
                if line.len() >= MAX_LINE {
                    // The rest of an endless line is no request either.
                    outbox.close();
                    return;
                }
            }
        }
    }
}
