//! Columns of measured rows in sequences, how files of them are described, expressions over them,
//! and the numerics on them: the ground floor of the residual analysis.

pub mod dates;
pub mod error;
pub mod expr;
pub mod format;
pub mod fourier;
pub mod frame;
pub mod layout;
pub mod linalg;
pub mod nan;
pub mod parallel;
pub mod progress;
pub mod stats;
pub mod units;
