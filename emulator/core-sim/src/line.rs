//! The serial line and its frames: the firmware's `links.rs` with a line in place of the DMA queue.

use crate::timing::SERIAL_BYTE_NS;
use board::machine::LinkCounters;
use board::telemetry::Batcher;
use std::collections::VecDeque;
use wire::message::{Reply, Response};
use wire::{encode, BoardFrame, BoardMessage, Decoder, HostFrame, MAX_FRAME};

/// Number of the USB link among the board's links.
pub(crate) const USB: usize = 0;
/// Number of USART3 among them.
pub(crate) const USART: usize = 1;

/// Bytes that may wait for the line: the firmware's queue.
const QUEUE: usize = 4_096;

/// The line.
#[derive(Debug, Clone, Default)]
pub(crate) struct Line {
    decoder: Decoder,
    sequence: u16,
    dropped: u32,
    bad: u32,
    pub batcher: Batcher,
    /// Bytes for the board, with the end of their stop bits.
    to_board: VecDeque<(u64, u8)>,
    rx_free_ns: u64,
    /// Frames of the board, with the end of their last stop bit.
    from_board: VecDeque<(u64, Vec<u8>)>,
    tx_free_ns: u64,
}

impl Line {
    /// Puts bytes on the receive line from `t_ns` on.
    pub fn queue(&mut self, t_ns: u64, bytes: &[u8]) {
        let mut at = self.rx_free_ns.max(t_ns);
        for byte in bytes {
            at += SERIAL_BYTE_NS;
            self.to_board.push_back((at, *byte));
        }
        self.rx_free_ns = at;
    }

    /// When the next byte for the board is complete.
    pub fn due(&self) -> Option<u64> {
        self.to_board.front().map(|(at, _)| *at)
    }

    /// Takes the byte that is due; a command comes with the last one of its frame.
    pub fn receive(&mut self, t_ns: u64) -> Option<HostFrame> {
        let (_, byte) = self.to_board.pop_front_if(|(at, _)| *at <= t_ns)?;
        match self.decoder.push(byte) {
            Ok(frame) => frame,
            Err(_) => {
                self.bad = self.bad.wrapping_add(1);
                None
            }
        }
    }

    /// Sends a message. Where there is no room it is dropped, and the gap in the sequence shows it.
    pub fn send(&mut self, t_ns: u64, message: BoardMessage) {
        let frame = BoardFrame {
            seq: self.sequence,
            message,
        };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = [0; MAX_FRAME];
        let waiting = (self.tx_free_ns.saturating_sub(t_ns) / SERIAL_BYTE_NS) as usize;
        match encode(&frame, &mut bytes) {
            Ok(length) if waiting + length <= QUEUE => {
                self.tx_free_ns = self.tx_free_ns.max(t_ns) + length as u64 * SERIAL_BYTE_NS;
                self.from_board
                    .push_back((self.tx_free_ns, bytes[..length].to_vec()));
            }
            _ => self.dropped = self.dropped.wrapping_add(1),
        }
    }

    /// Sends the response to the command with this number.
    pub fn reply(&mut self, t_ns: u64, seq: u16, response: Response) {
        self.send(t_ns, BoardMessage::Reply(Reply { seq, response }));
    }

    /// The frames that have crossed the line by `t_ns`.
    pub fn sent(&mut self, t_ns: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        while let Some((_, frame)) = self.from_board.pop_front_if(|(at, _)| *at <= t_ns) {
            bytes.extend(frame);
        }
        bytes
    }

    /// Frames dropped and frames damaged so far.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            dropped: self.dropped,
            bad: self.bad,
        }
    }
}
