//! Diagnostics of a residual, whatever effects are in the model: whiteness, correlation with the
//! inputs, switching between levels, bursts, slow and narrow parts.

mod colour;
mod correlation;
mod envelope;
mod heteroscedasticity;
mod imitations;
mod levels;
mod narrow;
mod noise;
mod random_walk;
mod switching;
mod whiteness;

pub use correlation::correlation_rows;
pub use envelope::{Along, Growth};
pub use heteroscedasticity::Sort;
pub use levels::levels;
pub use noise::{unlike_noise, UnlikeNoise};
pub use switching::switching;
pub use whiteness::ResidualTest;
pub use whiteness::{cross_correlation, whiteness};

/// Noise whose correlation falls to 0.95 from row to row, for tests.
#[cfg(test)]
pub fn coloured(seed: u64, n: usize) -> Vec<f64> {
    let mut rng = residual_columns::stats::Rng::new(seed);
    let mut x = 0.0;
    (0..n)
        .map(|_| {
            x = 0.95 * x + rng.normal();
            x
        })
        .collect()
}
