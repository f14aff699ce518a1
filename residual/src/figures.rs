//! Errors of a fitted model, with intervals by bootstrap over blocks of time.

use crate::model::Fit;
use crate::problem::Problem;
use crate::report::Figures;
use crate::stats::{self, Rng};

/// Bootstrap replicates.
const REPLICATES: usize = 1000;

/// Sums over one block of time.
struct Block {
    squares: f64,
    magnitudes: f64,
    rows: f64,
}

/// The 95 % interval of replicates.
pub(crate) fn interval(mut replicates: Vec<f64>) -> [f64; 2] {
    replicates.sort_by(f64::total_cmp);
    [
        stats::quantile_sorted(&replicates, 0.025),
        stats::quantile_sorted(&replicates, 0.975),
    ]
}

/// Held-out RMSE and MAE with 95 % block-bootstrap intervals.
pub(crate) fn figures(p: &Problem, fit: &Fit, seed: u64) -> Figures {
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
        heldout_rmse_ci: interval(rmse),
        heldout_mae: fit.held.iter().map(|x| x.abs()).sum::<f64>() / fit.held.len().max(1) as f64,
        heldout_mae_ci: interval(mae),
        insample_rmse: stats::rms(&fit.residual),
    }
}
