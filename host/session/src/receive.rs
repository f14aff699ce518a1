//! Receiving: bytes to frames, frames to samples, faults and status, board time without its wrap.

use super::{
    explain_crash_record, timekeeping, Session, SessionError, TimedSample, SILENCE_TIMEOUT,
};
use std::time::Duration;
use wire::message::{Response, Status};
use wire::{BoardFrame, BoardMessage, FrameError};

/// A step of board time further back than this is a reset and not telemetry out of order, in microseconds.
const RESET_STEP_US: i32 = -500_000;

impl Session<'_> {
    /// Lets time pass: sends what is queued and receives what arrives.
    ///
    /// # Errors
    /// The link is gone, the board stopped sending or was reset.
    pub fn advance(&mut self, duration: Duration) -> Result<(), SessionError> {
        self.exchange_with_reading(duration)?;
        if self.info.is_some() {
            if self.reset_seen {
                return Err(self.after_reset());
            }
            let limit = self.pace.on_host(SILENCE_TIMEOUT);
            if self.now_ns.saturating_sub(self.last_frame_ns) > limit.as_nanos() as u64 {
                return Err(SessionError::NoAnswer { command: "status" });
            }
        }
        Ok(())
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

    /// Sends the queued bytes, lets time pass and evaluates what arrived.
    pub(super) fn exchange(&mut self, duration: Duration) -> Result<(), SessionError> {
        if self.now_ns >= self.setpoints_due_ns {
            self.queue_setpoints();
        }
        let outbox = std::mem::take(&mut self.outbox);
        let exchange = self.link.exchange(&outbox, duration)?;
        self.now_ns = exchange.now_ns;
        self.utc_ns = timekeeping::utc_now_ns();
        if exchange.pose.is_some() {
            self.pose = exchange.pose;
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

    fn receive(&mut self, frame: BoardFrame) {
        self.counters.frames += 1;
        self.last_frame_ns = self.now_ns;
        self.counters.frames_lost += u64::from(self.gaps.arrived(frame.seq));
        match frame.message {
            BoardMessage::Reply(reply) => {
                if let Response::Status(status) = &reply.response {
                    let sent_ns = self.timekeeping.sent_ns(reply.seq);
                    self.receive_status(status.clone(), sent_ns);
                }
                if self.timekeeping.is_own(reply.seq) {
                    return;
                }
                self.reply = Some((reply.seq, reply.response));
            }
            BoardMessage::Status(status) => self.receive_status(status, None),
            BoardMessage::Fault(fault) => self.received.faults.push(fault),
            BoardMessage::Samples(batch) => {
                let start = self.unwrap_time(batch.t_us);
                let mut newest = start;
                for sample in batch.samples {
                    let t_us = start + u64::from(sample.dt_us);
                    if let Some(slot) = self.tension_n.get_mut(usize::from(sample.unit)) {
                        *slot = Some((f64::from(sample.tension) * 1e-4, t_us));
                    }
                    self.received.samples.push(TimedSample { t_us, sample });
                    newest = newest.max(t_us);
                }
                self.note_time(newest, None);
            }
        }
    }

    /// A status, and when it was requested, ns.
    fn receive_status(&mut self, status: Status, sent_ns: Option<u64>) {
        let board_us = self.unwrap_time(status.t_us);
        self.note_time(board_us, sent_ns);
        self.received.status = Some(status.clone());
        self.status = Some(status);
    }

    /// Continues the board's 32-bit microseconds past their wrap, and notices a restart.
    fn unwrap_time(&mut self, t_us: u32) -> u64 {
        let Some(before) = self.board_us else {
            self.board_us = Some(u64::from(t_us));
            return u64::from(t_us);
        };
        let step = t_us.wrapping_sub(before as u32) as i32;
        if step < RESET_STEP_US {
            self.reset_seen = true;
        }
        let now = before.saturating_add_signed(i64::from(step));
        self.board_us = Some(now.max(before));
        self.pace.frame(self.now_ns, now);
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::fake::{Behavior, FakeBoard};
    use wire::message::FaultReport;

    fn fault(seq: u16) -> BoardFrame {
        BoardFrame {
            seq,
            message: BoardMessage::Fault(FaultReport {
                t_us: 0,
                unit: 2,
                code: 33,
                detail: 0,
            }),
        }
    }

    #[test]
    fn board_time_goes_on_past_its_wrap_and_a_jump_back_is_a_reset() {
        let mut board = FakeBoard::new(Behavior::Good);
        let mut session = Session::connect(&mut board).unwrap();
        session.board_us = Some(u64::from(u32::MAX) - 9);
        assert_eq!(session.unwrap_time(5), (1 << 32) + 5);
        // Telemetry out of order is not a reset, and the newest time stays.
        assert_eq!(session.unwrap_time(u32::MAX), (1 << 32) - 1);
        assert_eq!(session.board_us, Some((1 << 32) + 5));
        assert!(!session.reset_seen);
        session.board_us = Some(10_000_000);
        session.unwrap_time(1000);
        assert!(session.reset_seen);
    }

    #[test]
    fn gaps_in_the_frame_numbers_are_counted() {
        let mut board = FakeBoard::new(Behavior::Good);
        let mut session = Session::connect(&mut board).unwrap();
        session.gaps.arrived(0);
        let before = session.counters.frames_lost;
        session.receive(fault(1));
        session.receive(fault(4));
        assert_eq!(session.counters.frames_lost, before + 2);
        assert_eq!(session.drain().faults.len(), 2);
    }
}
