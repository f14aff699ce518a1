//! Fourier transforms, by rustfft.
//!
//! rustfft is generic over the number. It is called here alone, so that its transforms of `f64` are
//! compiled once, and not in each package that wants one.

use rustfft::FftPlanner;
use std::sync::Arc;

pub use rustfft::{num_complex::Complex, Fft};

/// Plans transforms, and keeps what it has planned. None of them is normalised.
pub struct Planner(FftPlanner<f64>);

impl Default for Planner {
    fn default() -> Self {
        Self(FftPlanner::new())
    }
}

impl std::fmt::Debug for Planner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Planner")
    }
}

impl Planner {
    /// From `n` values to their spectrum.
    pub fn forward(&mut self, n: usize) -> Arc<dyn Fft<f64>> {
        self.0.plan_fft_forward(n)
    }

    /// From a spectrum to `n` times the values.
    pub fn inverse(&mut self, n: usize) -> Arc<dyn Fft<f64>> {
        self.0.plan_fft_inverse(n)
    }
}
