//! The first power-up of a rig: tests in order, and names for the mistakes of its wiring.
//!
//! ```text
//! tests ─ a person's hands ([`hands`]), samples and pulses ─▶ figures ─▶ mistakes, ranked ([`judge`]) ─▶ record ([`record`])
//! ```
//!
//! | module | what it holds |
//! | --- | --- |
//! | [`figures`] | what each test measured, by itself: numbers of the board, in SI |
//! | [`judge`] | from these figures to named mistakes: a pure function |
//! | [`mistake`] | the mistakes, in words, with what to do |
//! | [`steps`] | the tests on a session with the board |
//! | [`pulse`] | the motor test: short pulses that the board ends by itself, and their bounds |
//! | [`tension`] | the test of a cable under tension, and its bounds |
//! | [`hands`] | what a person does meanwhile, or the emulated rig in his place |
//! | [`record`] | the record of a rig: results, identities, and what has changed since |
//! | [`gate`] | whether a rig may be driven: no part was exchanged since |

pub mod figures;
pub mod gate;
pub mod hands;
pub mod judge;
pub mod mistake;
pub mod pulse;
pub mod record;
mod settings;
mod spectrum;
pub mod steps;
pub mod tension;
mod window;

use session::{LatchedFault, Session, SessionError};
use wire::message::CommandError;
use wire::Command;

/// Why the tests could not go on. The motors are at 0 V.
#[derive(Debug, thiserror::Error)]
pub enum BringUpError {
    /// The session with the board.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The record.
    #[error(transparent)]
    Store(#[from] known::StoreError),
    /// The board is armed.
    #[error("the board is armed: `forcectl disarm` first; nothing was driven")]
    Armed,
    /// The person, or a signal, ended the tests.
    #[error("stopped; what was measured is kept, and the same command goes on from there")]
    Stopped,
    /// The question could not be asked.
    #[error("{0}")]
    Question(String),
}

/// That of a board that somebody has stopped: it stays so, whatever the tests were about to do.
fn stopped_by_host() -> LatchedFault {
    LatchedFault::new(control::Fault::HostStop.code(), 0)
}

/// Clears what is latched, as far as its cause is gone.
fn clear(session: &mut Session<'_>) -> Result<(), BringUpError> {
    if session.get_status()?.fault == stopped_by_host().code {
        return Err(SessionError::Fault(stopped_by_host()).into());
    }
    refused(session, &Command::ClearFaults).map(drop)
}

/// Asks the board; why it refused, where it did.
fn refused(session: &mut Session<'_>, command: &Command) -> Result<Option<String>, BringUpError> {
    match session.command(command) {
        Ok(_) => Ok(None),
        Err(SessionError::Refused {
            refusal: CommandError::Faulted(code),
            ..
        }) if code == stopped_by_host().code => Err(SessionError::Fault(stopped_by_host()).into()),
        Err(SessionError::Refused { why, .. }) => Ok(Some(why)),
        Err(error) => Err(error.into()),
    }
}
