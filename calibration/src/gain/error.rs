//! Why readings give no gain.

use super::entries::{self, WrongEntry};
use crate::input::Location;

/// Why readings give no gain.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GainError {
    /// Too few readings or different weights.
    #[error("{readings} usable readings with {weights} different weights give no gain; at least 3 readings with 3 weights (0 g counts) are needed")]
    TooFew {
        /// Readings used.
        readings: usize,
        /// Different weights.
        weights: usize,
    },
    /// A number that can't be used.
    #[error("{at}: {what} is {value}; {advice}")]
    BadReading {
        /// Where the reading was entered.
        at: Location,
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        advice: &'static str,
    },
    /// A row that is there twice.
    #[error("{at}: line {} is a copy of line {of}; leave it out", .at.line)]
    Copied {
        /// The second of the two rows.
        at: Location,
        /// Line of the first one.
        of: usize,
    },
    /// An option that can't be used.
    #[error("{name} is {value}; {advice}")]
    BadOption {
        /// The field of [`Options`](super::Options).
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        advice: &'static str,
    },
    /// A line to leave out or to correct that no reading has.
    #[error("no reading stands in line {line}, which is to be left out or corrected")]
    NoSuchLine {
        /// The line.
        line: usize,
    },
    /// Readings that don't belong to the weight they are entered with.
    #[error("{}", entries::describe(.0))]
    WrongEntries(Vec<WrongEntry>),
    /// A scale that no cell of this kind has.
    #[error("the scale would be {n_per_code:.3e} N per code, more than a factor of two from the nominal {nominal:.3e}; are the weights in gram, is the gain of the converter right?")]
    ImplausibleScale {
        /// The scale found, N per code.
        n_per_code: f64,
        /// The nominal one, N per code.
        nominal: f64,
    },
    /// The code does not follow the load.
    #[error("the code does not depend on the load (slope {codes_per_n:.1} codes per N, standard error {se:.1}); check the bridge's wiring and that the weights hang on the cell")]
    NoSlope {
        /// The slope, codes per N.
        codes_per_n: f64,
        /// Its standard error, codes per N.
        se: f64,
    },
}
