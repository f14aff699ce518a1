//! A random walk: a slow part that is as slow as the log is long, which no filter of a sensor
//! makes.

use residual_columns::frame::Frame;

/// Blocks of a sequence whose means are compared.
const BLOCKS: usize = 20;

/// Least number of rows of a block.
const LEAST_ROWS: usize = 16;

/// Correlation of the means of neighbouring blocks that noise does not reach whose memory is short
/// against the log: 0.54 for one that forgets in a block, 0.33 in half a block.
const ALIKE: f64 = 0.5;

/// Standard errors above [`ALIKE`] of what was found.
const SURE: f64 = 2.0;

/// A slow part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomWalk {
    /// Share of the variance within the sequences that is in the means of blocks.
    pub share: f64,
    /// Correlation of the means of neighbouring blocks.
    pub alike: f64,
}

/// Looks for a slow part within the sequences: the means of twentieths of a log follow each other.
/// Noise with a memory of some hundredths of the log, whatever its colour, has means that do not.
pub fn random_walk(r: &[f64], frame: &Frame) -> Option<RandomWalk> {
    let (mut slow, mut all, mut next, mut pairs) = (0.0, 0.0, 0.0, 0usize);
    for range in frame.sequences() {
        let s = &r[range.clone()];
        let rows = s.len() / BLOCKS;
        if rows < LEAST_ROWS {
            continue;
        }
        let m = residual_columns::stats::mean(s);
        let means: Vec<f64> = s
            .chunks_exact(rows)
            .map(|b| residual_columns::stats::mean(b) - m)
            .collect();
        slow += means.iter().map(|x| x * x).sum::<f64>() * rows as f64;
        all += s.iter().map(|x| (x - m).powi(2)).sum::<f64>();
        next +=
            rows as f64 * means.windows(2).map(|w| w[0] * w[1]).sum::<f64>() * means.len() as f64
                / (means.len() - 1) as f64;
        pairs += means.len() - 1;
    }
    if all <= 0.0 || slow <= 0.0 {
        return None;
    }
    let alike = (next / slow).clamp(-1.0, 1.0);
    let error = ((1.0 - alike * alike) / pairs as f64).sqrt();
    (alike - SURE * error > ALIKE).then(|| RandomWalk {
        share: (slow / all).min(1.0),
        alike,
    })
}
