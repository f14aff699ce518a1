//! The serial line: bytes in both directions and the baud rate that their spacing shows.

use super::Board;

/// The spacing of the bytes that the board's USART3 sends, from which its baud rate shows.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Line {
    pub(super) last_ns: u64,
    pub(super) closest_ns: Option<u64>,
    pub(super) bytes: u64,
}

impl Board {
    /// Puts bytes on the board's receive line; they cross at line rate.
    pub fn queue_to_board(&mut self, bytes: &[u8]) {
        self.to_board.extend(bytes);
    }

    /// The next byte on the board's receive line.
    pub fn next_to_board(&mut self) -> Option<u8> {
        self.to_board.pop_front()
    }

    /// Whether bytes wait for the board.
    #[must_use]
    pub fn to_board_waiting(&self) -> usize {
        self.to_board.len()
    }

    /// The stop bit of a byte from the board has ended.
    pub fn sent_by_board(&mut self, t_ns: u64, byte: u8) {
        if self.line.bytes > 0 {
            let gap = t_ns - self.line.last_ns;
            self.line.closest_ns =
                Some(self.line.closest_ns.map_or(gap, |closest| closest.min(gap)));
        }
        self.line.last_ns = t_ns;
        self.line.bytes += 1;
        self.from_board.push(byte);
    }

    /// The bytes that the board has sent since the last call.
    pub fn take_from_board(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.from_board)
    }
}
