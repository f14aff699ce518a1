//! The core's FIFOs: received packets with their status, packets to be sent.

use std::collections::VecDeque;

/// What an entry of the receive FIFO reports (PKTSTS, section 57.14.7).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packet {
    /// OUT data.
    Out = 0b0010,
    /// An OUT transfer is over.
    OutDone = 0b0011,
    /// The SETUP stage is over.
    SetupDone = 0b0100,
    /// SETUP data.
    Setup = 0b0110,
}

/// An entry's status word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub packet: Packet,
    pub endpoint: usize,
    pub bytes: usize,
    pub data1: bool,
}

impl Entry {
    /// The word as GRXSTSR and GRXSTSP show it.
    pub fn status(&self) -> u32 {
        let data_pid = if self.data1 { 0b10 } else { 0 };
        (self.packet as u32) << 17
            | data_pid << 15
            | (self.bytes as u32) << 4
            | self.endpoint as u32
    }
}

/// The receive FIFO.
#[derive(Debug, Default)]
pub(super) struct ReceiveFifo {
    entries: VecDeque<(Entry, Vec<u32>)>,
    /// Words of the entry that was popped.
    open: VecDeque<u32>,
}

impl ReceiveFifo {
    pub fn clear(&mut self) {
        self.entries.clear();
        self.open.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    pub fn top(&self) -> Option<Entry> {
        self.entries.front().map(|(entry, _)| *entry)
    }

    /// Words in use: data and one status word for each entry.
    pub fn words(&self) -> usize {
        self.open.len()
            + self
                .entries
                .iter()
                .map(|(_, words)| words.len() + 1)
                .sum::<usize>()
    }

    pub fn push(&mut self, entry: Entry, bytes: &[u8]) {
        let words = bytes.chunks(4).map(|chunk| {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            u32::from_le_bytes(word)
        });
        self.entries.push_back((entry, words.collect()));
    }

    /// Takes the next entry; its data follow by [`Self::read_word`]. Also the number of words of
    /// the entry before it that nobody read.
    pub fn pop(&mut self) -> (Option<Entry>, usize) {
        let lost = self.open.len();
        let Some((entry, words)) = self.entries.pop_front() else {
            return (None, 0);
        };
        self.open = words.into();
        (Some(entry), lost)
    }

    pub fn read_word(&mut self) -> Option<u32> {
        self.open.pop_front()
    }
}

/// A transmit FIFO.
#[derive(Debug, Default)]
pub(super) struct TransmitFifo(VecDeque<u32>);

impl TransmitFifo {
    pub fn clear(&mut self) {
        self.0.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn words(&self) -> usize {
        self.0.len()
    }

    pub fn push(&mut self, word: u32) {
        self.0.push_back(word);
    }

    /// The first `length` bytes, which stay in the FIFO: the host may not acknowledge them.
    pub fn packet(&self, length: usize) -> Vec<u8> {
        let bytes = self.0.iter().flat_map(|word| word.to_le_bytes());
        bytes.take(length).collect()
    }

    /// Removes a packet of `length` bytes.
    pub fn sent(&mut self, length: usize) {
        self.0.drain(..length.div_ceil(4).min(self.0.len()));
    }
}
