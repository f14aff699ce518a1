//! Exit points and load-cell axes from a run with the robot moving, without a digitizer.
//!
//! # What a run determines
//!
//! A cable's length is the distance from the tip to its exit point. The encoder gives its change,
//! the robot its tip:
//!
//! ```text
//! |x - p_k| = length_0 + (1 + scale) travel_k + compliance tension_k + error
//! ```
//!
//! with the exit point `x`, the tip `p_k`, the paid-out travel, the cable's stretch, the length at
//! zero travel. A tip that moves by some centimetres looks at `x` from different sides, so that `x`
//! is found as by trilateration; along the cable it is found through the curvature of the distance
//! only, and the error of the reel's scale looks much like it. [`Prior`] says what is known of
//! scale and compliance.
//!
//! A cell reads `gain * tension_k (-a . d_k)`, so where a tension is known independently of the
//! cell (motor current, a force gauge, force closure), `gain * a` follows by linear least squares
//! ([`axis()`]).
//!
//! Errors of the tip enter through their part along the cable. They are taken as independent from
//! sample to sample; an error of the robot's frame that is constant moves all exit points with it
//! and is not seen.
//!
//! What a run does not determine is reported: the singular value decomposition of the scaled
//! Jacobian gives the directions of the unknowns and how well each is known ([`Direction`]).
//!
//! | file | content |
//! | --- | --- |
//! | `exit_point.rs` | exit point of one unit |
//! | `axis.rs` | gain and axis of one load cell |
//! | `advice.rs` | how much longer or further the robot has to move |
//! | `moved.rs` | whether the rig has moved since its calibration |

mod advice;
mod axis;
mod exit_point;
mod moved;

pub use advice::Needs;
pub use axis::{axis, AxisEstimate};
pub use exit_point::{exit_point, Direction, ExitEstimate};
pub use moved::{moved, Moved, MovedVerdict};

use nalgebra::{Matrix3, Vector3};

/// Fewest samples of a run.
const FEWEST: usize = 8;

/// One sample of one unit while the tip moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Tip, base frame, m.
    pub tip_m: Vector3<f64>,
    /// Cable paid out since an arbitrary start, m: encoder counts times travel per count.
    pub travel_m: f64,
    /// Cable tension, N: stretches the cable.
    pub tension_n: f64,
}

/// What is known before the run. Standard deviations; 0 holds a number at its value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Standard deviation of one travel reading, m: encoder, winding of the reel.
    pub travel_sd_m: f64,
    /// Standard deviation of one coordinate of the tip, m, independent from sample to sample.
    pub tip_sd_m: f64,
    /// Standard deviation of the relative error of the travel's scale (reel radius): 0.002 for 20
    /// um on 10 mm.
    pub scale_sd: f64,
    /// Expected stretch, m/N.
    pub compliance_m_per_n: f64,
    /// Its standard deviation, m/N.
    pub compliance_sd_m_per_n: f64,
    /// A direction of the unknowns whose standard deviation is larger than this counts as not
    /// observed, m.
    pub observable_sd_m: f64,
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            travel_sd_m: 1e-4,
            tip_sd_m: 2e-4,
            scale_sd: 0.001,
            compliance_m_per_n: 0.0,
            compliance_sd_m_per_n: 5e-5,
            observable_sd_m: 0.002,
        }
    }
}

/// Why a run gives no estimate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelfCalibrationError {
    /// Too few samples.
    #[error("{got} samples are too few; record at least {FEWEST}, with the tip moving in all three directions")]
    TooFew {
        /// Samples given.
        got: usize,
    },
    /// A number that can't be used.
    #[error("sample {sample}: {what} is not a finite number")]
    NotFinite {
        /// Index of the sample, from 0.
        sample: usize,
        /// Which number.
        what: &'static str,
    },
    /// The readings of the cell do not belong to the samples.
    #[error(
        "{readings} readings of the cell for {samples} samples; give one reading for each sample"
    )]
    Mismatch {
        /// Samples given.
        samples: usize,
        /// Readings given.
        readings: usize,
    },
    /// A prior that can't be used.
    #[error("{name} is {value}; it has to be finite and {}", if *.zero { "0 or above" } else { "above 0" })]
    BadPrior {
        /// The field of [`Prior`] or the argument.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Whether 0 is allowed.
        zero: bool,
    },
    /// The tip does not move enough.
    #[error("the run does not determine the exit point: the tip moved by {extent_mm:.1} mm along its least direction; move it further, in all three directions")]
    NotObservable {
        /// Standard deviation of the tip along its least direction, mm.
        extent_mm: f64,
    },
    /// The fit does not come to rest.
    #[error("the fit of the exit point does not converge; check the sign of the travel (paid out is positive) and the frame of the tip")]
    NoConvergence,
}

/// Two independent estimates of a position joined by their information (inverse covariances):
/// position in m and covariance in m^2. `None` where a covariance can't be inverted.
#[must_use]
pub fn fuse(
    a: (&Vector3<f64>, &Matrix3<f64>),
    b: (&Vector3<f64>, &Matrix3<f64>),
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let information_a = a.1.try_inverse()?;
    let information_b = b.1.try_inverse()?;
    let covariance = (information_a + information_b).try_inverse()?;
    let mean = covariance * (information_a * a.0 + information_b * b.0);
    mean.iter()
        .all(|v| v.is_finite())
        .then_some((mean, covariance))
}

/// Refuses samples and priors that no fit can use.
fn check(samples: &[Sample], prior: &Prior) -> Result<(), SelfCalibrationError> {
    for (name, value, zero) in [
        ("travel_sd_m", prior.travel_sd_m, false),
        ("tip_sd_m", prior.tip_sd_m, true),
        ("scale_sd", prior.scale_sd, true),
        ("compliance_sd_m_per_n", prior.compliance_sd_m_per_n, true),
        ("observable_sd_m", prior.observable_sd_m, false),
    ] {
        if !(value.is_finite() && (value > 0.0 || (zero && value == 0.0))) {
            return Err(SelfCalibrationError::BadPrior { name, value, zero });
        }
    }
    if samples.len() < FEWEST {
        return Err(SelfCalibrationError::TooFew { got: samples.len() });
    }
    for (sample, s) in samples.iter().enumerate() {
        for (what, good) in [
            ("the tip", s.tip_m.iter().all(|v| v.is_finite())),
            ("the travel", s.travel_m.is_finite()),
            ("the tension", s.tension_n.is_finite()),
        ] {
            if !good {
                return Err(SelfCalibrationError::NotFinite { sample, what });
            }
        }
    }
    Ok(())
}

/// Standard deviation of the tip along its least direction, mm.
fn extent_mm(samples: &[Sample], mean: &Vector3<f64>) -> f64 {
    let mut scatter = Matrix3::zeros();
    for s in samples {
        let d = s.tip_m - mean;
        scatter += d * d.transpose();
    }
    let least = scatter.symmetric_eigenvalues().min().max(0.0);
    1e3 * (least / samples.len() as f64).sqrt()
}

#[cfg(test)]
mod tests;
