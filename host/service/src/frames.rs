//! Frames of the board for several clients: each client sees a count without gaps of its own.
//!
//! The board counts its frames. A client that does not get the replies to others would take each of
//! them for a lost frame; so each client has a count of its own, which has a gap only where the
//! board's had one.

use wire::{BoardFrame, BoardMessage};

/// The count of one client.
#[derive(Debug, Default)]
pub struct Numbering {
    seq: u16,
}

impl Numbering {
    /// Frames that the board lost: a gap for this client as well.
    pub fn skip(&mut self, lost: u16) {
        self.seq = self.seq.wrapping_add(lost);
    }

    /// The bytes of a message for this client.
    pub fn encode(&mut self, message: &BoardMessage, to: &mut Vec<u8>) {
        self.seq = self.seq.wrapping_add(1);
        let frame = BoardFrame {
            seq: self.seq,
            message: message.clone(),
        };
        let mut out = [0; wire::MAX_FRAME];
        // It came from a frame of this size.
        if let Ok(length) = wire::encode(&frame, &mut out) {
            to.extend_from_slice(&out[..length]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use session::Gaps;
    use wire::message::{FaultReport, Reply, Response};

    fn fault(seq: u16) -> BoardFrame {
        BoardFrame {
            seq,
            message: BoardMessage::Fault(FaultReport {
                t_us: 0,
                unit: 1,
                code: 33,
                detail: 0,
            }),
        }
    }

    #[test]
    fn a_client_sees_the_boards_gaps_and_no_others() {
        let mut gaps = Gaps::default();
        let mut client = Numbering::default();
        let mut bytes = Vec::new();
        // 10, 11 (a reply to another client), 12, two lost, 15.
        for (seq, for_client) in [(10, true), (11, false), (12, true), (15, true)] {
            let mut frame = fault(seq);
            if !for_client {
                frame.message = BoardMessage::Reply(Reply {
                    seq: 1,
                    response: Response::Done,
                });
            }
            client.skip(gaps.arrived(seq));
            if for_client {
                client.encode(&frame.message, &mut bytes);
            }
        }
        let mut decoder = wire::Decoder::new();
        let seen: Vec<u16> = bytes
            .iter()
            .filter_map(|byte| decoder.push::<BoardFrame>(*byte).unwrap())
            .map(|frame| frame.seq)
            .collect();
        assert_eq!(seen, [1, 2, 5]);
    }
}
