//! Calibrations of made-up rigs whose truth is hidden from the code under test: how large the
//! errors are and how often the stated intervals hold.
//!
//! | module | what it draws |
//! | --- | --- |
//! | [`cells`] | gains from weights, zeros, power-ups |
//! | [`surveys`] | exit points and axes from digitizer points |
//! | [`runs`] | exit points from a moving tip |
//! | [`forces`] | force at the tip before and after |
//! | [`page`] | all of it as a page |

pub mod cells;
pub mod forces;
pub mod page;
pub mod runs;
// The rig that is surveyed; the unit tests of the library use it too.
#[allow(missing_docs)]
#[path = "../../../calibration/tests/common/scene.rs"]
pub mod scene;
pub mod surveys;
pub mod tally;

/// Standard deviation of the digitizer in one coordinate, m.
pub const DIGITIZER_SD_M: f64 = 2e-4;
/// Limit of the weights' relative error.
pub const WEIGHT_LIMIT: f64 = 1e-3;
/// Relative standard uncertainty of the local gravity: looked up for the place.
pub const GRAVITY_SD: f64 = 1e-4;
