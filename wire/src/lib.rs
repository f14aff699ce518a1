//! The wire protocol of the force board: the messages between host and board, and their framing.
//!
//! * [`message`]: the messages. Commands ([`HostFrame`]) and telemetry ([`BoardFrame`]) are
//!   separate types, so a stream of samples cannot be mistaken for a response.
//! * [`frame`]: COBS frames with a CRC-32, and a decoder that accepts any bytes.
//!
//! Two numbers guard a connection, both checked by [`message::Command::Hello`] before anything else
//! is accepted: [`ABI_VERSION`] changes when the *meaning* of a message changes, [`SCHEMA_HASH`]
//! whenever its *layout* does (it is computed from the types). Both are apart from the release
//! version.
//!
//! Units on the wire are integers with the unit in the name: `_un` micronewton, `_us` microsecond,
//! `_nm` nanometre, `_pn` piconewton, `_q16` a number times 65,536. SI belongs to the host's edge.
#![no_std]

pub mod frame;
pub mod message;
mod unit;

pub use frame::{encode, Decoder, FrameError, MAX_FRAME};
pub use message::{BoardFrame, BoardMessage, Command, HostFrame};
pub use unit::{UnitIndex, UnitSet, UNITS};

use postcard_schema::key::Key;

/// Meaning of the messages. Counted up by hand when a field keeps its type but not its meaning.
pub const ABI_VERSION: u16 = 4;

/// Layout of the messages, hashed from the types of both directions at compile time.
pub const SCHEMA_HASH: [u8; 8] = {
    let host = Key::for_path::<HostFrame>("host").to_bytes();
    let board = Key::for_path::<BoardFrame>("board").to_bytes();
    let mut hash = [0; 8];
    let mut i = 0;
    while i < 8 {
        // Rotated, so that exchanging the two directions gives another hash.
        hash[i] = host[i] ^ board[i].rotate_left(3);
        i += 1;
    }
    hash
};

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::fmt::Write;

    /// A host and a board of two releases find in the changelog whether they talk.
    #[test]
    fn the_changelog_names_both_numbers() {
        let mut line = std::format!("ABI {ABI_VERSION}, schema ");
        for byte in SCHEMA_HASH {
            write!(line, "{byte:02x}").unwrap();
        }
        let newest = include_str!("../../CHANGELOG.md")
            .lines()
            .find(|line| line.contains("schema"));
        let wanted = "the newest section with a part \"Wire\" should begin it with this pair";
        assert!(
            newest.is_some_and(|n| n.contains(&line)),
            "{wanted}: {line}"
        );
    }
}
