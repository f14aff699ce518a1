//! How sure the effects found are: intervals of their parameters, names that the data support, data
//! that the search has not seen, tests of the residual, what is left without a name, and the
//! verdict.

pub mod attribution;
pub mod by_log;
pub mod check;
pub mod feedback;
pub mod few;
pub mod intervals;
pub mod leftover;
mod one_alone;
pub mod residual_tests;
pub mod verdict;
