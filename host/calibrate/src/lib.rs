//! Calibration of a rig: readings from the rig or from files, what is kept of them, and how well
//! the applied force is known.
//!
//! The mathematics is in the package `calibration`; here it meets the board, the user's files and
//! the emulated rig.
//!
//! | question | module |
//! | --- | --- |
//! | codes of the load cells; zeros | [`cells`], [`zeros`] |
//! | gains from weights; when a weight was hung | [`weights`], [`load_time`] |
//! | exit points and axes from a digitizer | [`points`] |
//! | the same from a moving tip | [`moving`] |
//! | a known weight on a tip that hangs in the cables | [`floating`] |
//! | exchanged exit points, a mirrored or turned frame | [`frame`] |
//! | who stands in for weights and digitizer on an emulated rig | [`standin`] |
//! | which forces are feasible where | [`workspace`] |
//! | a calibration as a page to sign | [`certificate`] |
//! | pictures | [`picture`] |

pub mod cells;
pub mod certificate;
pub mod floating;
pub mod frame;
pub mod load_time;
pub mod moving;
pub mod picture;
pub mod points;
pub mod standin;
pub mod weights;
pub mod workspace;
pub mod zeros;

use known::StoreError;
use run::RunError;
use session::link::LinkError;
use session::SessionError;
use std::path::Path;

/// Why a calibration was not made. Nothing was stored.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// Readings that can't be used: the message names file and line.
    #[error("{0}\nnothing was stored")]
    Input(String),
    /// The readings are sound, and they give no calibration: a zero that drifts, a fit that
    /// contradicts them.
    #[error("{0}\nnothing was stored")]
    Refused(String),
    /// The board took another configuration than it was sent; of which units.
    #[error("the board reads back another configuration of unit {0} than was sent; check the link and run `forcectl calibrate push`")]
    ReadBack(String),
    /// What is known of the rig can't be read or kept.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The rig.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl CalibrateError {
    /// A file that can't be used.
    #[must_use]
    pub fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        StoreError::file(path, cause).into()
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
