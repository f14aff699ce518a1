//! Readings of the board's clock: the times at which a status was requested and arrived, and the times of samples.
//!
//! While a session lasts, a status is requested twice a second for the sake of the clock alone. It is waited for a few
//! milliseconds in steps of one, so that its arrival is known to a millisecond although the host's cycle has ten.

use super::{Session, SessionError};
use crate::clock::Reading;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use wire::Command;

/// Time between two requests for the sake of the clock, ns.
const REQUEST_PERIOD_NS: u64 = 500_000_000;
/// Resolution of the arrival.
const STEP: Duration = Duration::from_millis(1);
/// For how long the reply is waited for in such steps. A later one still counts, as a wider bound.
const WAIT: Duration = Duration::from_millis(5);

/// What is known of requests for the status.
#[derive(Debug, Default)]
pub(super) struct Timekeeping {
    /// Number of the newest request for the status, and when it was sent, ns.
    asked: Option<(u16, u64)>,
    /// Number of the request that was made for the clock and is not answered yet.
    own: Option<u16>,
    due_ns: u64,
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

    /// Whether the reply with this number belongs to a request that was made for the clock. True once.
    pub(super) fn is_own(&mut self, seq: u16) -> bool {
        self.own.take_if(|own| *own == seq).is_some()
    }
}

impl Session<'_> {
    /// Takes note that the board read its clock.
    pub(super) fn note_time(&mut self, board_us: u64, sent_ns: Option<u64>) {
        let reading = Reading {
            board_us,
            sent_ns,
            received_ns: self.now_ns,
        };
        // Of the frames that arrived together the newest says most.
        match self.received.readings.last_mut() {
            Some(last)
                if last.received_ns == reading.received_ns
                    && last.sent_ns.is_none()
                    && last.board_us <= board_us =>
            {
                *last = reading;
            }
            _ => self.received.readings.push(reading),
        }
    }

    /// Lets time pass as `exchange` does, with a request for the status where one is due.
    pub(super) fn exchange_with_reading(&mut self, duration: Duration) -> Result<(), SessionError> {
        if self.info.is_none() || duration <= WAIT || self.now_ns < self.timekeeping.due_ns {
            return self.exchange(duration);
        }
        self.timekeeping.due_ns = self.now_ns + REQUEST_PERIOD_NS;
        let end_ns = self.now_ns + duration.as_nanos() as u64;
        self.timekeeping.own = Some(self.queue(Command::GetStatus));
        let mut waited = Duration::ZERO;
        while waited < WAIT && self.timekeeping.own.is_some() {
            self.exchange(STEP)?;
            waited += STEP;
        }
        match end_ns.checked_sub(self.now_ns) {
            None | Some(0) => Ok(()),
            Some(left_ns) => self.exchange(Duration::from_nanos(left_ns)),
        }
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
