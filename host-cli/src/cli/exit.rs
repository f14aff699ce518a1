//! Exit codes, and the failure that carries one.

use known::StoreError;
use rig::RigFileError;
use run::RunError;
use serde_json::{json, Value};
use session::link::LinkError;
use session::SessionError;
use std::path::Path;

/// The command succeeded.
pub const DONE: u8 = 0;
/// The arguments are wrong, or a file that they name can't be read. Nothing was driven.
pub const USAGE: u8 = 2;
/// The rig file is wrong. Nothing was opened or driven.
pub const RIG_FILE: u8 = 3;
/// The link cannot be opened, was lost, or the other end is not a board of this version.
pub const LINK: u8 = 4;
/// The board or its service refused a command, or a fault stopped the rig.
pub const BOARD: u8 = 5;
/// The run was completed, but not with the requested result.
pub const DEGRADED: u8 = 6;
/// A file or the standard output could not be written.
pub const FILE: u8 = 7;
/// The recording of `identify` does not allow an analysis.
#[cfg(feature = "residual")]
pub const ANALYSIS: u8 = 8;
/// Ctrl-C, SIGTERM or SIGHUP ended the command.
pub const INTERRUPTED: u8 = 130;

/// The table below the help of `forcectl`.
pub const TABLE: &str = "\
Exit codes:
  0  the command succeeded
  2  the arguments are wrong, or a file that they name can't be read; nothing was driven
  3  the rig file is wrong; nothing was driven
  4  the link cannot be opened, was lost, or the other end is not a board of this version
  5  the board or its service refused a command, or a fault stopped the rig
  6  the run was completed, but the force was not held as commanded: it never settled, left its
     band, was out of reach or saturated a limit, a unit was missing, the amplifiers lost power,
     or an injection did not happen; or a calibration step was refused
  7  a file or the standard output could not be written
130  Ctrl-C, SIGTERM or SIGHUP ended the command; `set-force` and `identify` disarmed the rig
`residual` and `identify` list their own codes in their help.";

/// What a command has to say: a text for people, a JSON object for programs, and the exit code.
#[derive(Debug)]
pub struct Reply {
    /// Exit code.
    pub code: u8,
    /// What standard output gets without `--json`.
    pub text: String,
    /// What standard output gets with `--json`; `None` where the command has printed its own lines.
    pub json: Option<Value>,
}

impl Reply {
    /// The command succeeded.
    pub fn new(text: impl Into<String>, json: Value) -> Self {
        Self {
            code: DONE,
            text: text.into(),
            json: Some(json),
        }
    }

    /// One sentence, which is `done` in JSON.
    pub fn done(text: &str) -> Self {
        Self::new(format!("{text}\n"), json!({ "done": text }))
    }

    /// A text that has no JSON form. The command has refused `--json` before.
    pub fn text(text: impl Into<String>) -> Self {
        Self {
            code: DONE,
            text: text.into(),
            json: None,
        }
    }

    /// The same with another exit code.
    pub fn with_code(self, code: u8) -> Self {
        Self { code, ..self }
    }
}

/// Why a command failed.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    /// What happened, where, and what to do.
    pub message: String,
    /// Results that exist in spite of the failure.
    pub reply: Option<Box<Reply>>,
}

/// Result of a command.
pub type Result<T> = std::result::Result<T, Failure>;

impl Failure {
    /// A failure with its exit code.
    pub fn new(code: u8, message: impl ToString) -> Self {
        Self {
            code,
            message: message.to_string(),
            reply: None,
        }
    }

    /// Arguments that are wrong.
    pub fn usage(message: impl ToString) -> Self {
        Self::new(USAGE, message)
    }

    /// A file that cannot be written.
    pub fn file(path: &Path, error: impl std::fmt::Display) -> Self {
        Self::new(
            FILE,
            format!("{} cannot be written: {error}", path.display()),
        )
    }

    /// The same with another exit code.
    pub fn with_code(self, code: u8) -> Self {
        Self { code, ..self }
    }

    /// Adds the results that exist in spite of the failure.
    pub fn with_reply(self, reply: Reply) -> Self {
        Self {
            reply: Some(Box::new(reply)),
            ..self
        }
    }

    /// The JSON object that stands for the failure.
    pub fn json(&self) -> Value {
        let mut object = json!({ "error": self.message, "exit_code": self.code });
        if let Some(result) = self.reply.as_ref().and_then(|reply| reply.json.as_ref()) {
            object["result"] = result.clone();
        }
        object
    }
}

/// The code of a link's error. A service that refuses has a link.
const fn code_of_link(error: &LinkError) -> u8 {
    match error {
        LinkError::NotAllowed(_) => BOARD,
        _ => LINK,
    }
}

impl From<files::Refused> for Failure {
    fn from(error: files::Refused) -> Self {
        Self::usage(error)
    }
}

impl From<RigFileError> for Failure {
    fn from(error: RigFileError) -> Self {
        Self::new(RIG_FILE, error)
    }
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Self {
        Self::new(code_of_link(&error), error)
    }
}

#[cfg(unix)]
impl From<service::ServiceError> for Failure {
    fn from(error: service::ServiceError) -> Self {
        use service::{protocol, ServiceError};
        let code = match &error {
            ServiceError::Refused { code, .. } if *code == protocol::code::EXCHANGED => USAGE,
            ServiceError::Refused { code, .. } if *code != protocol::code::LINK => BOARD,
            _ => LINK,
        };
        Self::new(code, error)
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        let code = match &error {
            SessionError::Link(error) => code_of_link(error),
            SessionError::NoBoard { .. }
            | SessionError::Version { .. }
            | SessionError::NoAnswer { .. } => LINK,
            SessionError::OtherBoard { .. } => USAGE,
            SessionError::Refused { .. }
            | SessionError::Reset { .. }
            | SessionError::Fault(_)
            | SessionError::TooLong(_) => BOARD,
        };
        Self::new(code, error)
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Session(error) => error.into(),
            RunError::Argument(_) => Self::new(USAGE, error),
            RunError::Infeasible(_) => Self::new(RIG_FILE, error),
            RunError::Interrupted => Self::new(INTERRUPTED, error),
            RunError::Store(error) => error.into(),
            RunError::Control(_)
            | RunError::Pose(_)
            | RunError::Fault(_)
            | RunError::UnitLost(_) => Self::new(BOARD, error),
        }
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        let code = match &error {
            StoreError::Input(_) | StoreError::Zeros { .. } => USAGE,
            StoreError::Refused(_) => DEGRADED,
            StoreError::File { .. } => FILE,
        };
        Self::new(code, error)
    }
}

#[cfg(feature = "record")]
impl From<recording::RecordError> for Failure {
    fn from(error: recording::RecordError) -> Self {
        Self::new(if error.of_input { USAGE } else { FILE }, error)
    }
}

#[cfg(feature = "residual")]
impl From<identify::FindError> for Failure {
    fn from(error: identify::FindError) -> Self {
        use identify::FindError;
        let code = match &error {
            FindError::File { .. } => FILE,
            FindError::Analysis { .. } => ANALYSIS,
            FindError::Rewrite(_) => RIG_FILE,
        };
        Self::new(code, error)
    }
}

#[cfg(feature = "residual")]
impl From<identify::FileError> for Failure {
    fn from(error: identify::FileError) -> Self {
        Self::new(FILE, error)
    }
}

#[cfg(feature = "residual")]
impl From<identify::HoldError> for Failure {
    fn from(error: identify::HoldError) -> Self {
        use identify::HoldError;
        match error {
            HoldError::Run(error) => error.into(),
            HoldError::Implausible(_) => Self::new(BOARD, error),
            HoldError::Short => Self::new(USAGE, error),
        }
    }
}

#[cfg(feature = "residual")]
impl From<identify::BoardFileError> for Failure {
    fn from(error: identify::BoardFileError) -> Self {
        use identify::BoardFileError;
        match error {
            BoardFileError::Missing(_) | BoardFileError::Rig(_) | BoardFileError::Edit(_) => {
                Self::new(RIG_FILE, error)
            }
            BoardFileError::Unit(_) | BoardFileError::Terms(_) => Self::new(USAGE, error),
            BoardFileError::File(error) => error.into(),
        }
    }
}
