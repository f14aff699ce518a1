//! Connecting: the board identifies itself, and both sides compare protocol versions.

use super::request::RESPONSE_TIMEOUT;
use super::{explain_refusal, Session, SessionError};
use std::time::Duration;
use wire::message::{CommandError, Response};
use wire::Command;

/// How long a board may take from power-on to its first answer.
const BOOT_TIMEOUT: Duration = Duration::from_secs(3);

/// The first command of a session.
const HELLO: Command = Command::Hello {
    abi: wire::ABI_VERSION,
    schema: wire::SCHEMA_HASH,
};

impl Session<'_> {
    /// Sends hello until the board answers, and checks versions.
    pub(super) fn handshake(&mut self) -> Result<(), SessionError> {
        let mut waited = Duration::ZERO;
        while waited < BOOT_TIMEOUT {
            if let Some(response) = self.request_once(&HELLO, RESPONSE_TIMEOUT)? {
                return self.check_version(response);
            }
            waited += RESPONSE_TIMEOUT;
        }
        Err(SessionError::NoBoard {
            link: self.link.name(),
            what: self.diagnose(),
        })
    }

    /// Stores the identity of the board, and compares protocol versions.
    fn check_version(&mut self, response: Response) -> Result<(), SessionError> {
        let (abi, schema) = match response {
            Response::Hello(info) => {
                let numbers = (info.abi, info.schema);
                self.info = Some(info);
                numbers
            }
            Response::Rejected(CommandError::Version { abi, schema }) => (abi, schema),
            Response::Rejected(refusal) => {
                return Err(SessionError::Refused {
                    command: "hello",
                    why: explain_refusal(&HELLO, &refusal),
                    refusal,
                })
            }
            _ => (0, [0; 8]),
        };
        if abi == wire::ABI_VERSION && schema == wire::SCHEMA_HASH {
            self.reset_seen = false;
            return self.check_board();
        }
        let advice = if abi > wire::ABI_VERSION {
            "the board is newer: update forcectl"
        } else if abi < wire::ABI_VERSION {
            "the board is older: flash this version's firmware with `cargo xtask flash`"
        } else {
            "same meaning, another layout: flash the firmware of the same checkout with `cargo xtask flash`"
        };
        Err(SessionError::Version {
            abi,
            schema,
            own_abi: wire::ABI_VERSION,
            own_schema: wire::SCHEMA_HASH,
            advice: advice.to_owned(),
        })
    }

    /// Refuses another board than the one that the link has to lead to. A board without a number
    /// (the embedded rig's) is not told apart.
    fn check_board(&self) -> Result<(), SessionError> {
        let is = self
            .info
            .as_ref()
            .and_then(wire::message::BoardInfo::number);
        match (self.link.board(), is) {
            (Some(tested), Some(is)) if tested != is.as_str() => Err(SessionError::OtherBoard {
                tested: tested.to_owned(),
                is: is.as_str().to_owned(),
            }),
            _ => Ok(()),
        }
    }

    /// Why no board answered, by what was received.
    fn diagnose(&self) -> String {
        let c = &self.counters;
        if c.bytes == 0 {
            "it sends nothing; is it powered, flashed, and is this the right port?".to_owned()
        } else if c.frames > 0 {
            format!("{} telemetry frames arrive but no response; is the line to the board (its RX) connected?", c.frames)
        } else if c.frames_unknown > 0 {
            format!("{} frames of another protocol version arrive; flash the firmware of the same checkout with `cargo xtask flash`", c.frames_unknown)
        } else {
            format!(
                "{} bytes arrive, none of them a frame; is this the right port, at {} baud?",
                c.bytes,
                crate::link::port::BAUD
            )
        }
    }
}
