//! Errors of a fitted model, with intervals by bootstrap over blocks of time.

use crate::model::Fit;
use residual_columns::nan;
use residual_columns::stats::{self, Rng};
use residual_fit::problem::Problem;
use serde::{Deserialize, Serialize};

/// Errors of a model, in the target's unit. Intervals `[low, high]` are 95 %, from a bootstrap over
/// blocks of time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Root mean square error on held-out groups.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_rmse: f64,
    /// Its interval.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_rmse_ci: [f64; 2],
    /// Mean absolute error on held-out groups.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_mae: f64,
    /// Its interval.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_mae_ci: [f64; 2],
    /// Root mean square error on the rows that the model was fitted to.
    #[serde(deserialize_with = "nan::from_null")]
    pub insample_rmse: f64,
}

/// Bootstrap replicates.
const REPLICATES: usize = 1000;

/// Sums over one block of time.
struct Block {
    squares: f64,
    magnitudes: f64,
    rows: f64,
}

/// Held-out RMSE and MAE with 95 % block-bootstrap intervals.
pub fn figures(p: &Problem, fit: &Fit, seed: u64) -> Figures {
    let blocks: Vec<Block> = p
        .blocks
        .iter()
        .map(|b| {
            let r = &fit.held[b.range.clone()];
            Block {
                squares: r.iter().map(|x| x * x).sum(),
                magnitudes: r.iter().map(|x| x.abs()).sum(),
                rows: r.len() as f64,
            }
        })
        .collect();
    let mut rng = Rng::new(seed ^ 0xb00);
    let (rmse, mae): (Vec<f64>, Vec<f64>) = (0..REPLICATES)
        .map(|_| {
            let (mut s, mut a, mut n) = (0.0, 0.0, 0.0);
            for _ in 0..blocks.len() {
                let b = &blocks[rng.below(blocks.len())];
                s += b.squares;
                a += b.magnitudes;
                n += b.rows;
            }
            ((s / n).sqrt(), a / n)
        })
        .unzip();
    Figures {
        heldout_rmse: stats::rms(&fit.held),
        heldout_rmse_ci: stats::interval(rmse),
        heldout_mae: fit.held.iter().map(|x| x.abs()).sum::<f64>() / fit.held.len().max(1) as f64,
        heldout_mae_ci: stats::interval(mae),
        insample_rmse: stats::rms(&fit.residual),
    }
}
