//! Small statistics on plain values: robust location, steps, distributions, a reproducible
//! generator.

use crate::parallel;
use random::SplitMix64;
use statrs::distribution::{ContinuousCDF, FisherSnedecor, StudentsT};

/// Sorts in place and returns the median; `None` if empty.
pub fn median(v: &mut [f64]) -> Option<f64> {
    parallel::sort(v, f64::total_cmp);
    (!v.is_empty()).then(|| quantile_sorted(v, 0.5))
}

/// Quantile of values, linear between them, by selection: their order changes. 0 if empty.
pub fn quantile(v: &mut [f64], q: f64) -> f64 {
    if v.is_empty() {
        return 0.0;
    }
    let x = q.clamp(0.0, 1.0) * (v.len() - 1) as f64;
    let i = x as usize;
    let (_, at, above) = v.select_nth_unstable_by(i, f64::total_cmp);
    let next = above.iter().copied().min_by(f64::total_cmp);
    *at + (next.unwrap_or(*at) - *at) * (x - i as f64)
}

/// Quantile of sorted values, linear between them; 0 if empty.
pub fn quantile_sorted(v: &[f64], q: f64) -> f64 {
    if v.is_empty() {
        return 0.0;
    }
    let x = q.clamp(0.0, 1.0) * (v.len() - 1) as f64;
    let i = x as usize;
    let j = (i + 1).min(v.len() - 1);
    v[i] + (v[j] - v[i]) * (x - i as f64)
}

/// The 95 % interval of replicates: between their 2.5 % and 97.5 % quantiles.
pub fn interval(mut replicates: Vec<f64>) -> [f64; 2] {
    replicates.sort_by(f64::total_cmp);
    [
        quantile_sorted(&replicates, 0.025),
        quantile_sorted(&replicates, 0.975),
    ]
}

/// How many times the median of the others an error is unlike them.
pub const UNLIKE: f64 = 2.0;

/// Share of the errors that may be unlike the others: of more they are two sorts.
const FEW: f64 = 0.25;

/// The few errors of many that are more than [`UNLIKE`] times the median of the others: their
/// places, the largest first, and that median. `None` if there are none, more than a few, or fewer
/// than three errors.
pub fn few_unlike(errors: &[f64]) -> Option<(Vec<usize>, f64)> {
    if errors.len() < 3 {
        return None;
    }
    let mut places: Vec<usize> = (0..errors.len()).collect();
    places.sort_by(|a, b| errors[*b].total_cmp(&errors[*a]));
    let most = ((FEW * errors.len() as f64) as usize).max(1);
    (1..=most).find_map(|count| {
        let (unlike, others) = places.split_at(count);
        let mut values: Vec<f64> = others.iter().map(|i| errors[*i]).collect();
        let of_others = median(&mut values)?;
        let apart = |place: &usize| errors[*place] > UNLIKE * of_others;
        (unlike.last().is_some_and(apart) && !apart(&others[0]))
            .then(|| (unlike.to_vec(), of_others))
    })
}

/// Mean; 0 if empty.
pub fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len().max(1) as f64
}

/// Slope of the straight line through points, and the squared distances from it; `None` where `x`
/// does not vary.
pub fn line(x: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let (mx, my) = (mean(x), mean(y));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (x, y) = (x - mx, y - my);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    (xx > 0.0).then(|| (xy / xx, (yy - xy * xy / xx).max(0.0)))
}

/// Smallest and largest value; infinite, the smallest above the largest, if empty.
pub fn range(v: &[f64]) -> (f64, f64) {
    v.iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| {
            (lo.min(*x), hi.max(*x))
        })
}

/// Root mean square; 0 if empty.
pub fn rms(v: &[f64]) -> f64 {
    (v.iter().map(|x| x * x).sum::<f64>() / v.len().max(1) as f64).sqrt()
}

/// Standard deviation with n - 1.
pub fn deviation(v: &[f64]) -> f64 {
    let m = mean(v);
    (v.iter().map(|x| (x - m) * (x - m)).sum::<f64>() / (v.len().max(2) - 1) as f64).sqrt()
}

/// Step of a quantised column: all distinct values are multiples of it apart, and they repeat.
pub fn quantum(c: &[f64]) -> Option<f64> {
    let stride = (c.len() / 20_000).max(1);
    let mut v: Vec<f64> = c.iter().step_by(stride).copied().collect();
    let n = v.len();
    v.sort_by(f64::total_cmp);
    v.dedup();
    if v.len() < 8 || v.len() * 10 > n {
        return None;
    }
    let mut gaps: Vec<f64> = v.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_by(f64::total_cmp);
    let q = gaps[gaps.len() / 10];
    let whole = gaps
        .iter()
        .filter(|g| ((*g / q) - (*g / q).round()).abs() < 0.05)
        .count();
    (whole * 10 >= gaps.len() * 9).then_some(q)
}

/// Upper tail of the standard normal distribution, exact to the last digits far out as well.
pub fn normal_tail(z: f64) -> f64 {
    0.5 * libm::erfc(z / std::f64::consts::SQRT_2)
}

/// 97.5 % quantile of Student's distribution with `freedom` degrees of freedom.
pub fn student_975(freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |d| d.inverse_cdf(0.975))
}

/// Upper tail of the chi-square distribution (Wilson and Hilferty's cube root).
pub fn chi2_tail(x: f64, k: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let c = 2.0 / (9.0 * k);
    normal_tail(((x / k).cbrt() - (1.0 - c)) / c.sqrt())
}

/// Upper tail of Snedecor's F distribution with `upper` and `lower` degrees of freedom; 1 where it
/// isn't defined.
pub fn f_tail(f: f64, upper: f64, lower: f64) -> f64 {
    match FisherSnedecor::new(upper, lower) {
        Ok(d) if f > 0.0 => d.sf(f),
        _ => 1.0,
    }
}

/// The analysis's own draws.
#[derive(Debug, Clone)]
pub struct Rng(SplitMix64);

impl Rng {
    /// A generator from a seed.
    pub fn new(seed: u64) -> Rng {
        let state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d;
        Rng(SplitMix64::new(state))
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0.unit()
    }

    /// Whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }

    /// -1 or 1.
    pub fn sign(&mut self) -> f64 {
        if self.0.bits() >> 63 == 0 {
            1.0
        } else {
            -1.0
        }
    }

    /// Exponential with mean 1.
    pub fn exponential(&mut self) -> f64 {
        -(1.0 - self.uniform()).ln()
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        self.0.normal()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_errors_above_the_others_are_found() {
        assert_eq!(
            few_unlike(&[0.1, 0.12, 0.5, 0.09, 0.1]),
            Some((vec![2], 0.1))
        );
        let of_eight = [0.1, 0.3, 0.1, 0.1, 0.1, 0.4, 0.1, 0.1];
        assert_eq!(few_unlike(&of_eight), Some((vec![5, 1], 0.1)));
        for alike in [
            &[0.1, 0.19, 0.12, 0.1][..],
            &[0.1, 0.5],
            // Two sorts, not few among others.
            &[0.1, 0.5, 0.5, 0.1],
            &[f64::NAN; 4],
            &[],
        ] {
            assert_eq!(few_unlike(alike), None, "{alike:?}");
        }
    }

    #[test]
    fn selection_gives_the_quantiles_of_sorting() {
        for n in [1, 2, 7, 100] {
            let values: Vec<f64> = (0..n).map(|i| f64::from(i * 37 % 101)).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            for q in [0.0, 0.1, 0.5, 0.77, 1.0] {
                let found = quantile(&mut values.clone(), q);
                assert_eq!(found, quantile_sorted(&sorted, q), "{n} {q}");
            }
        }
        assert_eq!(quantile(&mut [], 0.5), 0.0);
    }

    #[test]
    fn tails_match_tables() {
        assert!((normal_tail(1.96) - 0.0249979).abs() < 1e-6);
        assert!((normal_tail(-1.0) - 0.8413447).abs() < 1e-6);
        assert!((normal_tail(6.0) / 9.865_876_450_376_98e-10 - 1.0).abs() < 1e-12);
        assert!((chi2_tail(31.41, 20.0) - 0.05).abs() < 1e-3);
        for (freedom, quantile) in [
            (2.0, 4.303),
            (3.0, 3.182),
            (5.0, 2.571),
            (10.0, 2.228),
            (100.0, 1.984),
        ] {
            assert!((student_975(freedom) / quantile - 1.0).abs() < 5e-4);
        }
        assert!((f_tail(30.82, 2.0, 3.0) - 0.01).abs() < 1e-5);
        assert!((f_tail(4.965, 1.0, 10.0) - 0.05).abs() < 1e-5);
        assert_eq!(f_tail(f64::INFINITY, 2.0, 3.0), 0.0);
        assert_eq!(f_tail(f64::NAN, 2.0, 3.0), 1.0);
    }
}
