//! Why readings give no gain.

use super::causes::Found;
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
    /// One mistake behind many readings.
    #[error("{0}")]
    Mistake(Box<Found>),
    /// A scale that no cell of this kind has.
    #[error("the scale would be {n_per_code:.3e} N per code, more than a factor of two from the nominal {nominal:.3e}; {}", looks_like.map_or("are the weights in gram, is the gain of the converter right?".to_owned(), |unit| format!("the column `code` looks like {unit}: give the codes of the converter, whole numbers of up to 8388607")))]
    ImplausibleScale {
        /// The scale found, N per code.
        n_per_code: f64,
        /// The nominal one, N per code.
        nominal: f64,
        /// What the codes may be instead.
        looks_like: Option<LooksLike>,
    },
    /// The codes fall as the load grows.
    #[error("the codes fall as the load grows ({codes_per_n:.1} codes per N), and the nominal scale of {nominal:.3e} N per code rises: the signal wires S+ and S- of the cell are exchanged, or the weights pull it the other way than its cable does; correct that and weigh again")]
    Falling {
        /// The slope, codes per N.
        codes_per_n: f64,
        /// The nominal scale, N per code.
        nominal: f64,
    },
    /// The readings leave every curve by far more than a cell and a hand do.
    #[error("{at}: the readings scatter by {sd_n:.3} N about any curve, this one by {off_n:+.3} N, and no single mistake explains it: are there several, or does something touch the cell? Weigh again, or leave lines out")]
    Scatter {
        /// The reading that is furthest off.
        at: Location,
        /// Repeatability, N.
        sd_n: f64,
        /// How far that reading is off, N.
        off_n: f64,
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

/// What a column of codes may hold instead of codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LooksLike {
    /// Output of the bridge, mV/V.
    MilliVoltPerVolt,
    /// Output of the bridge, V/V.
    VoltPerVolt,
    /// Newton.
    Newton,
    /// Gram.
    Gram,
    /// Kilogram.
    Kilogram,
}

impl LooksLike {
    /// The unit whose readings have this slope per newton; of a bridge of 2 mV/V at 3 kg (thesis
    /// 3.2.3). `None`: none of them, within a factor of 1.2 (mV/V and kg differ by 1.5).
    pub(super) fn of(per_n: f64) -> Option<Self> {
        const G: f64 = crate::STANDARD_GRAVITY_M_PER_S2;
        [
            (Self::MilliVoltPerVolt, 2.0 / (3.0 * G)),
            (Self::VoltPerVolt, 2e-3 / (3.0 * G)),
            (Self::Newton, 1.0),
            (Self::Gram, 1e3 / G),
            (Self::Kilogram, 1.0 / G),
        ]
        .into_iter()
        .find(|(_, slope)| (per_n.abs() / slope).ln().abs() < 1.2f64.ln())
        .map(|(unit, _)| unit)
    }
}

impl std::fmt::Display for LooksLike {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::MilliVoltPerVolt => "mV/V",
            Self::VoltPerVolt => "V/V",
            Self::Newton => "newtons",
            Self::Gram => "gram",
            Self::Kilogram => "kilogram",
        })
    }
}
