//! Requests for the status: which one was sent when, so that its reply is a reading of the board's
//! clock.

use std::time::{SystemTime, UNIX_EPOCH};

/// What is known of requests for the status.
#[derive(Debug, Default)]
pub(super) struct Timekeeping {
    /// Number of the newest request for the status, and when it was sent, ns.
    asked: Option<(u16, u64)>,
    /// Number of the request that was made for the clock and is not answered yet.
    pub(super) own: Option<u16>,
    /// When the next one is due, ns.
    pub(super) due_ns: u64,
}

impl Timekeeping {
    /// A request for the status goes out.
    pub(super) fn asked(&mut self, seq: u16, now_ns: u64) {
        self.asked = Some((seq, now_ns));
    }

    /// When the request with this number was sent, ns.
    pub(super) fn sent_ns(&self, seq: u16) -> Option<u64> {
        self.asked
            .filter(|(number, _)| *number == seq)
            .map(|(_, sent_ns)| sent_ns)
    }

    /// Whether the reply with this number belongs to a request that was made for the clock. True
    /// once.
    pub(super) fn is_own(&mut self, seq: u16) -> bool {
        self.own.take_if(|own| *own == seq).is_some()
    }
}

/// UTC by this machine's clock, ns since 1970; 0 before.
pub(super) fn utc_now_ns() -> u64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |passed| {
            u64::try_from(passed.as_nanos()).unwrap_or(u64::MAX)
        })
}
