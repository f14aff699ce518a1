//! Receiving: bytes to frames, frames to samples, faults and status, board time without its wrap.

use super::{Session, TimedSample};
use crate::clock::Reading;
use wire::message::{CommandError, Response, Status};
use wire::{BoardFrame, BoardMessage};

/// A step of board time further back than this is a reset and not telemetry out of order, in
/// microseconds.
const RESET_STEP_US: i32 = -500_000;

impl Session<'_> {
    /// Evaluates a frame.
    pub(super) fn receive(&mut self, frame: BoardFrame) {
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
                // Setpoints are answered only where they are refused.
                if let Response::Rejected(refusal @ CommandError::Range { .. }) = reply.response {
                    let mut sent = self.setpoints_sent.iter();
                    if let Some((_, sent)) = sent.find(|(seq, _)| *seq == reply.seq) {
                        self.setpoints_refused = Some((sent.clone(), refusal));
                        return;
                    }
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

    /// Takes note that the board read its clock.
    fn note_time(&mut self, board_us: u64, sent_ns: Option<u64>) {
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
