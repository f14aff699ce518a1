//! Columns of measured rows in sequences, expressions over them, and the numerics on them: the
//! ground floor of the residual analysis.

pub mod error;
pub mod expr;
pub mod format;
pub mod frame;
pub mod linalg;
pub mod nan;
pub mod parallel;
pub mod progress;
pub mod stats;
pub mod units;
