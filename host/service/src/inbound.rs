//! What reaches the hub, of clients and of jobs.

use super::outbox::Outbox;
use super::protocol::Request;
use serde_json::Value;
use std::sync::atomic::{AtomicU64, Ordering};

/// Number of a client.
pub(super) type ClientId = u64;
/// The program on the pseudo-terminal.
pub(super) const TERMINAL: ClientId = 0;

/// Numbers of clients: 0 is the pseudo-terminal.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// A number for a new client.
pub(super) fn next_id() -> ClientId {
    NEXT_ID.fetch_add(1, Ordering::Relaxed)
}

/// What reaches the hub.
pub(super) enum Inbound {
    /// A client connected.
    Opened {
        /// Its number.
        id: ClientId,
        /// Whether it needs no token.
        trusted: bool,
        /// Lines to it.
        outbox: Outbox,
    },
    /// A client requests something.
    Request {
        /// Its number.
        id: ClientId,
        /// The request.
        request: Request,
    },
    /// A client is gone.
    Closed {
        /// Its number.
        id: ClientId,
    },
    /// The job reports.
    Job(JobReport),
}

/// What a job reports.
pub(super) struct JobReport {
    /// Number of the job.
    pub number: u64,
    /// Name of the job.
    pub name: String,
    /// Whether it has ended.
    pub ended: bool,
    /// What to answer to whom.
    pub answer: Option<(ClientId, Option<Value>)>,
    /// The result.
    pub result: Result<Value, (i64, String)>,
}
