//! What can go wrong in a session, with what to do about it.

use crate::explain::LatchedFault;
use crate::link::LinkError;
use wire::message::CommandError;

/// Why a session failed.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The link itself.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No board answered when connecting.
    #[error("no board answers on {link}: {what}")]
    NoBoard {
        /// The link's name.
        link: String,
        /// What was received instead, and what to do.
        what: String,
    },
    /// Board and host have different protocol versions.
    #[error("the board speaks ABI {abi} with schema {schema:02x?}, this forcectl ABI {own_abi} with schema {own_schema:02x?}: {advice}")]
    Version {
        /// The board's ABI version.
        abi: u16,
        /// The board's schema hash.
        schema: [u8; 8],
        /// This program's ABI version.
        own_abi: u16,
        /// This program's schema hash.
        own_schema: [u8; 8],
        /// Which side to update, and how.
        advice: String,
    },
    /// The board is not the one with which the rig was tested.
    #[error(
        "since the bring-up of this rig the board was {tested} and is {is}: its wiring is not what was tested; use the rig file of this board, or run `forcectl bring-up` again; nothing was driven"
    )]
    OtherBoard {
        /// Number of the board that was tested.
        tested: String,
        /// Number of this one.
        is: String,
    },
    /// The board rejected a command.
    #[error("the board refused `{command}`: {why}")]
    Refused {
        /// The command.
        command: &'static str,
        /// Why, and what to do.
        why: String,
        /// The board's error code.
        refusal: CommandError,
    },
    /// The board stopped sending or doesn't answer.
    #[error("the board doesn't answer `{command}` any more; it goes to 0 V by itself when setpoints cease; check cable and supply, then `forcectl status`")]
    NoAnswer {
        /// The command, or what it was to send.
        command: &'static str,
    },
    /// The board was reset in between.
    #[error("the board was reset while connected{}; its motors are at 0 V", crash_record.as_ref().map(|record| format!(": {record}")).unwrap_or_default())]
    Reset {
        /// The board's crash record.
        crash_record: Option<String>,
    },
    /// A fault of the whole board is latched.
    #[error("{0}")]
    Fault(LatchedFault),
    /// Something took longer than it may.
    #[error("{0}")]
    TooLong(String),
}
