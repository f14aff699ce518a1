//! Noises of the same colour that a residual is compared with.

use residual_columns::frame::Frame;
use residual_columns::stats;

/// Standard deviations by which a residual must differ from noise of the same colour and the same
/// distribution.
pub(super) const SURE: f64 = 6.0;

/// Noises of the same colour that a residual is compared with.
const NOISES: usize = 32;

/// Rows of each such noise. A longer one shows nothing more: the scatter of a mean falls with the
/// root of its rows.
pub(super) const NOISE_ROWS: usize = 120_000;

/// Noises that a residual is compared with.
pub(super) struct Imitations {
    /// Number of noises.
    pub count: usize,
    /// Their rows.
    pub frame: Frame,
    /// Scatter of a mean over the rows of the residual, over that of one over these.
    shrink: f64,
}

impl Imitations {
    /// For a residual on the rows of a frame.
    pub fn new(frame: &Frame) -> Imitations {
        let own = frame.longest(NOISE_ROWS);
        Imitations {
            count: NOISES,
            shrink: (own.len() as f64 / frame.len().max(1) as f64).sqrt(),
            frame: own,
        }
    }

    /// Standard error of the difference between a mean over the rows of the residual and the mean
    /// of its `values` for the noises.
    pub fn error(&self, values: &[f64]) -> f64 {
        let own = self.shrink.powi(2) + 1.0 / values.len().max(1) as f64;
        stats::deviation(values) * own.sqrt()
    }
}
