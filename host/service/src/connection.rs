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

/// Requests of one client that the hub has not carried out at most. More are left unread: a client that floods the service makes
/// itself wait, and nobody else.
const MAX_REQUESTS: usize = 64;

/// Numbers of clients: 0 is the pseudo-terminal.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// A number for a new client.
pub(super) fn next_id() -> ClientId {
    NEXT_ID.fetch_add(1, Ordering::Relaxed)
}

/// A stream in both directions.
pub(super) trait Stream: Send {
    /// Its reading and its writing half, and what ends both.
    ///
    /// # Errors
    /// Those of the operating system.
    fn parts(self) -> io::Result<Parts>;
}

/// Reading half, writing half, and what ends both: a blocked write fails, the reading half gets an end of file.
type Parts = (
    Box<dyn Read + Send>,
    Box<dyn Write + Send>,
    Arc<dyn Closing>,
);

/// Ends a connection.
pub(super) trait Closing: Send + Sync {
    /// Ends both directions at once.
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
    fn parts(self) -> io::Result<Parts> {
        let (reader, writer) = (self.try_clone()?, self.try_clone()?);
        Ok((Box::new(reader), Box::new(writer), Arc::new(self)))
    }
}

impl Stream for TcpStream {
    fn parts(self) -> io::Result<Parts> {
        self.set_nodelay(true)?;
        let (reader, writer) = (self.try_clone()?, self.try_clone()?);
        Ok((Box::new(reader), Box::new(writer), Arc::new(self)))
    }
}

#[derive(Default)]
struct Waiting {
    lines: VecDeque<Arc<str>>,
    dropped: u64,
    closed: bool,
    /// Requests on their way to the hub.
    requests: usize,
    connection: Option<Arc<dyn Closing>>,
}

/// Lines on their way to a client, and requests on theirs to the hub. Clones share them.
#[derive(Clone, Default)]
pub(super) struct Outbox {
    shared: Arc<(Mutex<Waiting>, Condvar)>,
}

impl Outbox {
    fn with<T>(&self, act: impl FnOnce(&mut Waiting) -> T) -> T {
        let (lock, signal) = &*self.shared;
        let result = act(&mut lock.lock().unwrap_or_else(PoisonError::into_inner));
        signal.notify_all();
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
                // The thread that writes is blocked by a client that does not read.
                if let Some(connection) = &waiting.connection {
                    connection.close();
                }
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

    /// The hub has carried out a request.
    pub(super) fn carried_out(&self) {
        self.with(|waiting| waiting.requests = waiting.requests.saturating_sub(1));
    }

    /// Waits until the hub may be given another request; `false` at the end.
    fn may_request(&self) -> bool {
        let (lock, signal) = &*self.shared;
        let mut waiting = lock.lock().unwrap_or_else(PoisonError::into_inner);
        while waiting.requests >= MAX_REQUESTS && !waiting.closed {
            waiting = signal.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
        waiting.requests += 1;
        !waiting.closed
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
    let (reader, mut writer, connection) = stream.parts()?;
    let outbox = Outbox::default();
    outbox.with(|waiting| waiting.connection = Some(Arc::clone(&connection)));
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
            connection.close();
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
                if !outbox.may_request() || hub.send(Inbound::Request { id, request }).is_err() {
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    /// Long enough for a thread to run, where something must not happen.
    const A_MOMENT: Duration = Duration::from_millis(100);

    #[test]
    fn a_client_that_floods_waits_for_itself() {
        let lines = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"status\"}\n".repeat(1000);
        let outbox = Outbox::default();
        let (sender, hub) = channel();
        let reading = outbox.clone();
        let thread = std::thread::spawn(move || read(lines.as_bytes(), 7, &reading, &sender));
        let arrived = || hub.recv_timeout(A_MOMENT).is_ok();
        let first = std::iter::repeat_with(arrived).take_while(|here| *here);
        assert_eq!(first.count(), MAX_REQUESTS);
        // One is carried out: one more comes.
        outbox.carried_out();
        assert!(arrived() && !arrived());
        outbox.close();
        thread.join().unwrap();
    }

    #[test]
    fn a_client_that_leaves_everything_unread_is_disconnected_while_a_write_blocks() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        let (sender, hub) = channel();
        start(ours, 7, true, &sender).unwrap();
        let Ok(Inbound::Opened { outbox, .. }) = hub.recv() else {
            panic!("the hub was not told");
        };
        // Far more than the socket's buffer: the thread that writes is blocked.
        outbox.line("x".repeat(1 << 24));
        std::thread::sleep(A_MOMENT);
        for _ in 0..=MAX_WAITING {
            outbox.line("y\n");
        }
        assert!(matches!(hub.recv(), Ok(Inbound::Closed { id: 7 })));
        let mut rest = Vec::new();
        theirs.read_to_end(&mut rest).unwrap();
        assert!(rest.len() < 1 << 24);
    }
}
