//! How sure a gain is: its p value from decoys, and its t statistic over blocks of time.

use residual_columns::stats;

/// Probability that a decoy gains so much.
///
/// With `n` decoys the smallest p value that a count can give is `1 / (n + 1)`: 1/49 for the usual
/// 48, too large after correction for a hundred forms. So the tail is that of a normal distribution
/// with the mean of the decoys' gains and 1.4 times their standard deviation. Where decoys reach
/// the gain, the p value is at least what their count says.
pub(super) fn p_value(gain: f64, decoys: &[f64]) -> f64 {
    if decoys.is_empty() {
        return 1.0;
    }
    let above = decoys.iter().filter(|d| **d >= gain).count();
    let mean = stats::mean(decoys).max(-0.01);
    let sd = stats::deviation(decoys).max(1e-9) * 1.4;
    let tail = stats::normal_tail((gain - mean) / sd);
    if above > 0 {
        tail.max((above + 1) as f64 / (decoys.len() + 1) as f64)
    } else {
        tail
    }
}

/// Mean fall of loss over blocks in standard errors of it; 0 for fewer than four blocks.
pub fn t_statistic(before: &[f64], after: &[f64]) -> f64 {
    let d = falls(before, after);
    if d.len() < 4 {
        return 0.0;
    }
    let se = stats::deviation(&d) / (d.len() as f64).sqrt();
    if se > 0.0 {
        stats::mean(&d) / se
    } else {
        0.0
    }
}

/// Whether the error falls in nearly all blocks in which it changes at all. An effect that acts in
/// few places (a limit that is seldom reached) has a large spread over all blocks, however sure it
/// is. A sign test: at least three blocks with a hundredth of the whole change each, at most one in
/// eight against.
pub(super) fn steady_where_it_acts(before: &[f64], after: &[f64]) -> bool {
    let change = falls(before, after);
    let whole: f64 = change.iter().map(|d| d.abs()).sum();
    let count = |sign: f64| change.iter().filter(|d| sign * **d > 0.01 * whole).count();
    let (fell, rose) = (count(1.0), count(-1.0));
    fell >= 3 && 8 * rose <= fell
}

/// Share of the blocks up to which an effect acts in few places.
const FEW: f64 = 0.25;

/// Whether nearly all of the change of loss is in a few blocks.
pub(super) fn acts_in_few(before: &[f64], after: &[f64]) -> bool {
    let mut change: Vec<f64> = falls(before, after).iter().map(|d| d.abs()).collect();
    change.sort_by(|a, b| b.total_cmp(a));
    let few = (FEW * change.len() as f64) as usize;
    let whole: f64 = change.iter().sum();
    change.iter().take(few).sum::<f64>() > 0.8 * whole
}

/// Fall of the loss block by block, where both are known.
fn falls(before: &[f64], after: &[f64]) -> Vec<f64> {
    before
        .iter()
        .zip(after)
        .map(|(b, a)| b - a)
        .filter(|d| d.is_finite())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_that_decoys_reach_has_at_least_their_p_value() {
        let decoys: Vec<f64> = (0..48).map(|i| f64::from(i) * 1e-3).collect();
        assert!(p_value(0.0465, &decoys) >= 2.0 / 49.0);
        assert!(p_value(0.3, &decoys) < 1e-6);
        assert_eq!(p_value(0.3, &[]), 1.0);
    }

    #[test]
    fn few_blocks_give_no_t_statistic() {
        assert_eq!(t_statistic(&[2.0; 3], &[1.0; 3]), 0.0);
        let t = t_statistic(&[2.0, 2.2, 1.9, 2.1], &[1.0, 1.1, 1.0, 1.0]);
        assert!(t > 10.0, "{t}");
    }

    #[test]
    fn a_change_in_three_of_twelve_blocks_is_in_few_places() {
        let before = [1.0; 12];
        let mut after = [0.99; 12];
        assert!(!acts_in_few(&before, &after));
        after[3..6].fill(0.5);
        assert!(acts_in_few(&before, &after));
        after[7..10].fill(1.5);
        assert!(!acts_in_few(&before, &after));
    }

    #[test]
    fn one_block_in_eight_may_go_against() {
        let before = [1.0; 12];
        let mut after = [1.0; 12];
        after[..8].fill(0.5);
        after[8] = 1.5;
        assert!(steady_where_it_acts(&before, &after));
        after[9] = 1.5;
        assert!(!steady_where_it_acts(&before, &after));
    }
}
