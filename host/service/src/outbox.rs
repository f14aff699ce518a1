//! What waits between the hub and one client.
//!
//! The hub never waits for a client. What a client does not read in time is dropped where it is
//! telemetry, and ends the connection where it is an answer.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// Lines of telemetry that wait for a client at most: 8 s of ticks.
const MAX_TELEMETRY: usize = 4096;
/// Lines in all that wait for a client at most. One that leaves more unread is disconnected.
pub(super) const MAX_WAITING: usize = 5120;

/// Requests of one client that the hub has not carried out at most. More are left unread: a client
/// that floods the service makes itself wait, and nobody else.
pub(super) const MAX_REQUESTS: usize = 64;

/// Ends a connection.
pub(super) trait Closing: Send + Sync {
    /// Ends both directions at once.
    fn close(&self);
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
    /// Of a connection, which is ended where too much stays unread.
    pub(super) fn of(connection: Arc<dyn Closing>) -> Self {
        let outbox = Self::default();
        outbox.with(|waiting| waiting.connection = Some(connection));
        outbox
    }

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
    pub(super) fn may_request(&self) -> bool {
        let (lock, signal) = &*self.shared;
        let mut waiting = lock.lock().unwrap_or_else(PoisonError::into_inner);
        while waiting.requests >= MAX_REQUESTS && !waiting.closed {
            waiting = signal.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
        waiting.requests += 1;
        !waiting.closed
    }

    /// The next lines; `None` at the end.
    pub(super) fn next(&self) -> Option<Vec<Arc<str>>> {
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
