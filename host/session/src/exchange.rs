//! Exchanges of bytes with the board: the one place where anything is sent, the setpoints in force
//! among it, and where time passes.
//!
//! Twice a second a status is requested for the sake of the clock alone. It is waited for a few
//! milliseconds in steps of one, so that its arrival is known to a millisecond although the host's
//! cycle has ten.

use super::session::MAX_POSE_AGE_NS;
use super::{
    command_name, explain_crash_record, explain_refusal, timekeeping, Session, SessionError,
    PERIOD, SETPOINTS_VALID_MS, SILENCE_TIMEOUT,
};
use std::time::Duration;
use wire::message::UnitSetpoint;
use wire::{BoardFrame, Command, FrameError, UNITS};

/// Time between two requests for the sake of the clock, ns.
const READING_PERIOD_NS: u64 = 500_000_000;
/// Resolution of the arrival.
const READING_STEP: Duration = Duration::from_millis(1);
/// For how long the reply is waited for in such steps. A later one still counts, as a wider bound.
const READING_WAIT: Duration = Duration::from_millis(5);

impl Session<'_> {
    /// Sends setpoints, and exchanges bytes with the board while `duration` passes. They stay in
    /// force: every exchange from now on sends them again when 10 ms are over.
    ///
    /// # Errors
    /// As [`Session::exchange`].
    pub fn send_setpoints(
        &mut self,
        setpoints: [UnitSetpoint; UNITS],
        duration: Duration,
    ) -> Result<(), SessionError> {
        self.set_setpoints(Some(setpoints));
        self.exchange(duration)
    }

    /// Puts setpoints in force from now on: they go out with the next exchange and every 10 ms
    /// after it. `None` ends that.
    pub fn set_setpoints(&mut self, setpoints: Option<[UnitSetpoint; UNITS]>) {
        self.setpoints = setpoints;
        self.setpoints_due_ns = self.now_ns;
    }

    /// Sends setpoints once, valid for `valid_ms` of the board's own time, 1 to 1,000: without
    /// newer ones the board then goes to 0 V by itself and latches fault 2. Exchanges bytes with
    /// the board while `duration` passes.
    ///
    /// # Errors
    /// As [`Session::exchange`].
    pub fn pulse(
        &mut self,
        units: [UnitSetpoint; UNITS],
        valid_ms: u16,
        duration: Duration,
    ) -> Result<(), SessionError> {
        self.set_setpoints(None);
        self.queue(Command::Setpoints { valid_ms, units });
        self.exchange(duration)
    }

    /// Exchanges bytes with the board while `duration` passes: what is queued goes out, with the
    /// setpoints in force every 10 ms, and what arrives is received.
    ///
    /// # Errors
    /// The link is gone, the board stopped sending or was reset, or has refused setpoints.
    pub fn exchange(&mut self, duration: Duration) -> Result<(), SessionError> {
        self.exchange_with_reading(duration)?;
        if self.info.is_some() {
            if self.reset_seen {
                return Err(self.after_reset());
            }
            if let Some((sent, refusal)) = self.setpoints_refused.take() {
                // Others of that kind may still be refused: it is told once.
                self.setpoints_sent.clear();
                self.setpoints = None;
                return Err(SessionError::Refused {
                    command: command_name(&sent),
                    why: explain_refusal(&sent, &refusal),
                    refusal,
                });
            }
            if self.is_silent() {
                return Err(SessionError::NoAnswer { command: "status" });
            }
        }
        Ok(())
    }

    /// Whether nothing has arrived for so long that the board counts as gone.
    pub(super) fn is_silent(&self) -> bool {
        let limit = self.pace.on_host(SILENCE_TIMEOUT);
        self.now_ns.saturating_sub(self.last_frame_ns) > limit.as_nanos() as u64
    }

    /// As [`Session::exchange_once`], with a request for the status where one is due.
    fn exchange_with_reading(&mut self, duration: Duration) -> Result<(), SessionError> {
        if self.info.is_none() || duration <= READING_WAIT || self.now_ns < self.timekeeping.due_ns
        {
            return self.exchange_once(duration);
        }
        self.timekeeping.due_ns = self.now_ns + READING_PERIOD_NS;
        let end_ns = self.now_ns + duration.as_nanos() as u64;
        self.timekeeping.own = Some(self.queue(Command::GetStatus));
        let mut waited = Duration::ZERO;
        while waited < READING_WAIT && self.timekeeping.own.is_some() {
            self.exchange_once(READING_STEP)?;
            waited += READING_STEP;
        }
        match end_ns.checked_sub(self.now_ns) {
            None | Some(0) => Ok(()),
            Some(left_ns) => self.exchange_once(Duration::from_nanos(left_ns)),
        }
    }

    /// One exchange over the link: setpoints that are due and the queued bytes go out, what arrived
    /// is evaluated.
    pub(super) fn exchange_once(&mut self, duration: Duration) -> Result<(), SessionError> {
        if self.now_ns >= self.setpoints_due_ns {
            self.queue_setpoints();
        }
        let outbox = std::mem::take(&mut self.outbox);
        let exchange = self.link.exchange(&outbox, duration)?;
        self.now_ns = exchange.now_ns;
        self.utc_ns = timekeeping::utc_now_ns();
        if exchange.pose.is_some() {
            (self.pose, self.pose_ns) = (exchange.pose, self.now_ns);
        } else if self.now_ns.saturating_sub(self.pose_ns) > MAX_POSE_AGE_NS {
            self.pose = None;
        }
        if self.resets.is_some_and(|before| exchange.resets != before) {
            self.reset_seen = true;
        }
        self.resets = Some(exchange.resets);
        self.received.truth.extend(exchange.truth);
        self.counters.bytes += exchange.from_board.len() as u64;
        for byte in exchange.from_board {
            match self.decoder.push::<BoardFrame>(byte) {
                Ok(None) => {}
                Ok(Some(frame)) => self.receive(frame),
                Err(FrameError::Message) => self.counters.frames_unknown += 1,
                Err(_) => self.counters.frames_bad += 1,
            }
        }
        Ok(())
    }

    /// Queues the setpoints in force, if any.
    fn queue_setpoints(&mut self) {
        if let Some(units) = self.setpoints {
            self.setpoints_due_ns = self.now_ns + PERIOD.as_nanos() as u64;
            self.queue(Command::Setpoints {
                valid_ms: SETPOINTS_VALID_MS,
                units,
            });
        }
    }

    /// Connects again to a board that was reset, and reports its crash record.
    pub(super) fn after_reset(&mut self) -> SessionError {
        self.setpoints = None;
        self.info = None;
        self.outbox.clear();
        let crash_record = match self.handshake() {
            Ok(()) => self
                .info
                .as_ref()
                .and_then(|info| info.crash_record.as_ref())
                .map(explain_crash_record),
            Err(_) => None,
        };
        SessionError::Reset { crash_record }
    }
}
