//! Calibration of a rig: readings from the rig or from files, what is kept of them, and how well the applied force is known.
//!
//! The mathematics is in the package `calibration`; here it meets the board, the user's files and the emulated rig.
//!
//! | question | module |
//! | --- | --- |
//! | where are calibrations kept, which versions are there | [`store`] |
//! | what is a rig's calibration before anything was measured; how does it enter the rig file's settings | [`base`] |
//! | codes of the load cells; zeros | [`cells`], [`zeros`] |
//! | gains from weights; when a weight was hung | [`weights`], [`load_time`] |
//! | exit points and axes from a digitizer | [`points`] |
//! | the same from a moving tip | [`moving`] |
//! | who stands in for weights and digitizer on an emulated rig | [`standin`] |
//! | which parts is a calibration of | [`serials`] |
//! | how well is the force at the tip known | [`applied`] |
//! | which forces are feasible where | [`workspace`] |
//! | pictures | [`picture`] |

pub mod applied;
pub mod base;
pub mod cells;
pub mod load_time;
pub mod moving;
pub mod picture;
pub mod points;
pub mod serials;
pub mod standin;
pub mod store;
pub mod weights;
pub mod workspace;
pub mod zeros;

use crate::link::LinkError;
use crate::run::RunError;
use crate::session::SessionError;
use std::path::Path;

/// Why a calibration was not made. Nothing was stored.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// Readings that can't be used: the message names file and line.
    #[error("{0}\nnothing was stored")]
    Input(String),
    /// The readings are sound, and they give no calibration: a zero that drifts, a fit that contradicts them.
    #[error("{0}\nnothing was stored")]
    Refused(String),
    /// A file.
    #[error("{path}: {cause}")]
    File {
        /// The file.
        path: String,
        /// What is wrong, and what to do.
        cause: String,
    },
    /// The rig.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl CalibrateError {
    /// A file that can't be used.
    #[must_use]
    pub fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        Self::File {
            path: path.display().to_string(),
            cause: cause.to_string(),
        }
    }

    /// Readings that can't be used.
    #[must_use]
    pub fn input(why: impl std::fmt::Display) -> Self {
        Self::Input(why.to_string())
    }

    /// Sound readings without a result.
    #[must_use]
    pub fn refused(why: impl std::fmt::Display) -> Self {
        Self::Refused(why.to_string())
    }
}

impl From<SessionError> for CalibrateError {
    fn from(error: SessionError) -> Self {
        Self::Run(error.into())
    }
}

impl From<LinkError> for CalibrateError {
    fn from(error: LinkError) -> Self {
        Self::Run(error.into())
    }
}

/// Result of a calibration step.
pub type Result<T> = std::result::Result<T, CalibrateError>;

/// Today's date, UTC, `YYYY-MM-DD`.
#[must_use]
pub fn today() -> String {
    let now = humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string();
    now.chars().take(10).collect()
}
