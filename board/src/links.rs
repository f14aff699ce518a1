//! A link: bytes to commands, messages to frames. The same for USB and USART3.

use board::hw::usart::Producer;
use board::machine::LinkCounters;
use board::telemetry::Batcher;
use wire::message::{Reply, Response};
use wire::{encode, BoardFrame, BoardMessage, Decoder, FrameError, HostFrame, MAX_FRAME};

/// Number of the USB link.
pub const USB: usize = 0;
/// Number of the USART3 link.
pub const USART: usize = 1;

/// One of them.
pub struct Link {
    decoder: Decoder,
    sequence: u16,
    queue: Producer,
    dropped: u32,
    bad: u32,
    /// Samples that wait for a full frame.
    pub batcher: Batcher,
}

// The largest grant must stay under half the ring, or it may never fit after a wrap.
const _: () = assert!(MAX_FRAME * 2 < board::hw::usart::QUEUE);

impl Link {
    /// A link without traffic so far.
    pub fn new(queue: Producer) -> Self {
        Self {
            decoder: Decoder::new(),
            sequence: 0,
            queue,
            dropped: 0,
            bad: 0,
            batcher: Batcher::default(),
        }
    }

    /// Takes a received byte; a command comes with the last one of its frame.
    pub fn push(&mut self, byte: u8) -> Option<HostFrame> {
        match self.decoder.push(byte) {
            Ok(frame) => frame,
            Err(FrameError::TooLong | FrameError::Cobs | FrameError::Crc | FrameError::Message) => {
                self.bad = self.bad.wrapping_add(1);
                None
            }
        }
    }

    /// Queues a message. Where there is no room it is dropped, and the gap in the sequence shows
    /// it.
    pub fn send(&mut self, message: BoardMessage) {
        let frame = BoardFrame {
            seq: self.sequence,
            message,
        };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = [0; MAX_FRAME];
        let queued = encode(&frame, &mut bytes).ok().and_then(|length| {
            let mut grant = self.queue.grant_exact(length).ok()?;
            grant.copy_from_slice(bytes.get(..length)?);
            grant.commit(length);
            Some(())
        });
        if queued.is_none() {
            self.dropped = self.dropped.wrapping_add(1);
        }
    }

    /// Sends the response to the command with this number.
    pub fn reply(&mut self, seq: u16, response: Response) {
        self.send(BoardMessage::Reply(Reply { seq, response }));
    }

    /// Frames dropped and frames damaged so far.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            dropped: self.dropped,
            bad: self.bad,
        }
    }
}
