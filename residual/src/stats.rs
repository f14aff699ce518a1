//! Small statistics: robust location, distributions, a reproducible generator, tests of residuals
//! that stay valid for coloured signals.

use crate::frame::Frame;
use rustfft::{num_complex::Complex, FftPlanner};
use serde::Serialize;

/// Sorts in place and returns the median; `None` if empty.
pub fn median(v: &mut [f64]) -> Option<f64> {
    v.sort_by(f64::total_cmp);
    (!v.is_empty()).then(|| quantile_sorted(v, 0.5))
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

/// Mean; 0 if empty.
pub fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len().max(1) as f64
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

/// Upper tail of the standard normal distribution (Abramowitz and Stegun 7.1.26 on erfc; absolute
/// error below 1.5e-7).
pub fn normal_tail(z: f64) -> f64 {
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let poly = t
        * (0.254_829_592
            + t * (-0.284_496_736
                + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let tail = 0.5 * poly * (-x * x).exp();
    if z >= 0.0 {
        tail
    } else {
        1.0 - tail
    }
}

/// Upper tail of the chi-square distribution (Wilson and Hilferty's cube root).
pub fn chi2_tail(x: f64, k: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let c = 2.0 / (9.0 * k);
    normal_tail(((x / k).cbrt() - (1.0 - c)) / c.sqrt())
}

/// SplitMix64 (Steele, Lea and Flood 2014): small, reproducible on every platform.
#[derive(Debug, Clone)]
pub struct Rng(u64);

impl Rng {
    /// A generator from a seed.
    pub fn new(seed: u64) -> Rng {
        Rng(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d)
    }

    /// Next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }

    /// -1 or 1.
    pub fn sign(&mut self) -> f64 {
        if self.bits() >> 63 == 0 {
            1.0
        } else {
            -1.0
        }
    }

    /// Standard normal (Box and Muller).
    #[cfg(test)]
    pub fn normal(&mut self) -> f64 {
        let u = 1.0 - self.uniform();
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Autocorrelation of `x` at lags 0..=`lags` over the sequences, mean removed overall.
pub fn autocorrelation(x: &[f64], frame: &Frame, lags: usize) -> Vec<f64> {
    let m = mean(x);
    let mut out = vec![0.0; lags + 1];
    let mut planner = FftPlanner::<f64>::new();
    for r in frame.sequences() {
        // By the transform of the power spectrum, with zeros after the rows so that nothing wraps.
        let s = &x[r.clone()];
        let reach = lags.min(s.len().saturating_sub(1));
        let n = (s.len() + reach).next_power_of_two();
        let mut z = vec![Complex::new(0.0, 0.0); n];
        z.iter_mut().zip(s).for_each(|(z, x)| z.re = x - m);
        planner.plan_fft_forward(n).process(&mut z);
        z.iter_mut()
            .for_each(|z| *z = Complex::new(z.norm_sqr() / n as f64, 0.0));
        planner.plan_fft_inverse(n).process(&mut z);
        out.iter_mut()
            .zip(&z)
            .take(reach + 1)
            .for_each(|(o, z)| *o += z.re);
    }
    let zero = out[0];
    if zero > 0.0 {
        out.iter_mut().for_each(|o| *o /= zero);
    }
    out
}

/// Integrated correlation time in rows: 1 + 2 sum of the autocorrelation up to its first fall
/// below 0.05.
pub fn correlation_time(acf: &[f64]) -> f64 {
    1.0 + 2.0 * acf.iter().skip(1).take_while(|r| **r > 0.05).sum::<f64>()
}

/// Switching of a residual between levels, which no coloured noise shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Switching {
    /// Share of the variance that is in the slow part that switches.
    pub share: f64,
    /// Excess kurtosis of the slow part: -2 for two levels, 0 for noise.
    pub kurtosis: f64,
    /// The kurtosis in standard errors.
    pub z: f64,
}

/// Looks for a slow part that switches between levels: means over short stretches keep the levels and
/// lose the fast noise. Means of coloured noise, however slow, stay normal, with a kurtosis of 0 and a
/// standard error of sqrt(24 / n), where correlated means count as n / (1 + 2 sum rho^4). The stretch with the
/// largest |z| of those of 4 to 64 rows counts.
pub fn switching(r: &[f64], frame: &Frame) -> Switching {
    let total = rms(r).powi(2);
    let mut best = Switching {
        share: 0.0,
        kurtosis: 0.0,
        z: 0.0,
    };
    for width in [4usize, 8, 16, 32, 64] {
        let mut means = Vec::new();
        let (mut within, mut sequences) = (0.0, Vec::new());
        for range in frame.sequences() {
            let start = means.len();
            for s in r[range.clone()].chunks_exact(width) {
                let m = mean(s);
                within += s.iter().map(|x| (x - m).powi(2)).sum::<f64>();
                means.push(m);
            }
            sequences.push(start..means.len());
        }
        let n = means.len() as f64;
        if n < 100.0 {
            break;
        }
        let m = mean(&means);
        let moment = |k: i32| means.iter().map(|x| (x - m).powi(k)).sum::<f64>() / n;
        let variance = moment(2);
        if variance <= 0.0 {
            continue;
        }
        let short = Frame::new(
            vec![],
            (0..means.len()).map(|i| i as f64).collect(),
            sequences,
        );
        let lags = (means.len() / 8).clamp(4, 200);
        let rho = autocorrelation(&means, &short, lags);
        let clump = 1.0 + 2.0 * rho.iter().skip(1).map(|r| r.powi(4)).sum::<f64>();
        let kurtosis = moment(4) / (variance * variance) - 3.0;
        let z = kurtosis / (24.0 * clump / n).sqrt();
        // What white noise of the size found within the stretches would leave in their means.
        let white = within / (n * (width - 1) as f64) / width as f64;
        if z < best.z {
            best = Switching {
                share: ((variance - white) / total.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
                kurtosis,
                z,
            };
        }
    }
    best
}

/// One test of the residual.
#[derive(Debug, Clone, Serialize)]
pub struct ResidualTest {
    /// Variable tested against; `itself` for whiteness.
    pub against: String,
    /// Lag of the largest correlation, in rows (positive: the residual follows the variable).
    pub lag: i64,
    /// Correlation at that lag.
    pub correlation: f64,
    /// Probability of a statistic at least so large by chance.
    pub p: f64,
}

/// Whiteness: Ljung and Box's sum over 20 lags with Lobato's correction, which stays valid when the
/// variance changes with the signals.
pub fn whiteness(r: &[f64], frame: &Frame) -> ResidualTest {
    let lags = 20usize;
    let m = mean(r);
    let var = r.iter().map(|x| (x - m).powi(2)).sum::<f64>() / r.len().max(1) as f64;
    let (mut q, mut best) = (0.0, (0, 0.0f64));
    for k in 1..=lags {
        let (mut c, mut t) = (0.0, 0.0);
        for range in frame.sequences() {
            let s = &r[range.clone()];
            if s.len() > k {
                for (a, b) in s[k..].iter().zip(s) {
                    let p = (a - m) * (b - m);
                    c += p;
                    t += p * p;
                }
            }
        }
        if t > 0.0 {
            q += c * c / t;
        }
        let rho = c / (var * r.len() as f64).max(f64::MIN_POSITIVE);
        if rho.abs() > best.1.abs() {
            best = (k as i64, rho);
        }
    }
    ResidualTest {
        against: "itself".into(),
        lag: best.0,
        correlation: best.1,
        p: chi2_tail(q, lags as f64),
    }
}

/// Cross-correlation of residual and variable at lags -20..=20 rows. The variance of each estimate
/// is Bartlett's, sum over k of rho_r(k) rho_x(k) / n, so two slow but unrelated signals do not
/// pass for related; the largest lag is corrected for having been chosen among 41 (Sidak).
pub fn cross_correlation(r: &[f64], x: &[f64], name: &str, frame: &Frame) -> ResidualTest {
    let reach = (frame.len() / frame.sequences().len().max(1) / 2).clamp(20, 400);
    let (ar, ax) = (
        autocorrelation(r, frame, reach),
        autocorrelation(x, frame, reach),
    );
    let n = r.len() as f64;
    let var = ((1.0 + 2.0 * ar.iter().zip(&ax).skip(1).map(|(a, b)| a * b).sum::<f64>()) / n)
        .max(1.0 / n);
    let (mr, mx) = (mean(r), mean(x));
    let norm = (r.iter().map(|v| (v - mr).powi(2)).sum::<f64>()
        * x.iter().map(|v| (v - mx).powi(2)).sum::<f64>())
    .sqrt();
    let mut best = (0i64, 0.0f64);
    for lag in -20i64..=20 {
        let mut c = 0.0;
        for range in frame.sequences() {
            let (a, b) = (&r[range.clone()], &x[range.clone()]);
            let k = lag.unsigned_abs() as usize;
            if a.len() > k {
                let (head, tail) = if lag >= 0 { (&a[k..], b) } else { (a, &b[k..]) };
                c += head
                    .iter()
                    .zip(tail)
                    .map(|(p, q)| (p - mr) * (q - mx))
                    .sum::<f64>();
            }
        }
        let rho = if norm > 0.0 { c / norm } else { 0.0 };
        if rho.abs() > best.1.abs() {
            best = (lag, rho);
        }
    }
    let p = 2.0 * normal_tail(best.1.abs() / var.sqrt());
    ResidualTest {
        against: name.into(),
        lag: best.0,
        correlation: best.1,
        p: 1.0 - (1.0 - p.min(1.0)).powi(41),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_match_tables() {
        assert!((normal_tail(1.96) - 0.0249979).abs() < 1e-6);
        assert!((normal_tail(-1.0) - 0.8413447).abs() < 1e-6);
        assert!((chi2_tail(31.41, 20.0) - 0.05).abs() < 1e-3);
    }

    #[test]
    fn switching_is_told_from_slow_noise() {
        let n = 6000;
        let t: Vec<f64> = (0..n).map(f64::from).collect();
        let whole = std::iter::once(0..n as usize).collect();
        let frame = Frame::new(vec![], t, whole);
        let mut rng = Rng::new(9);
        let mut level = 1.0;
        let levels: Vec<f64> = (0..n)
            .map(|_| {
                if rng.uniform() < 0.02 {
                    level = -level;
                }
                level + rng.normal()
            })
            .collect();
        let s = switching(&levels, &frame);
        assert!(s.z < -6.0 && s.kurtosis < -0.7, "{s:?}");
        assert!((s.share - 0.5).abs() < 0.15, "{s:?}");
        for seed in 0..20 {
            let s = switching(&coloured(seed, n as usize), &frame);
            assert!(s.z > -4.0, "{seed}: {s:?}");
        }
    }

    #[test]
    fn autocorrelation_is_the_sum_of_lagged_products() {
        let x = coloured(3, 300);
        let t: Vec<f64> = (0..300).map(f64::from).collect();
        let frame = Frame::new(vec![], t, vec![0..120, 120..300]);
        let m = mean(&x);
        let at = |lag: usize| -> f64 {
            [0..120, 120..300]
                .iter()
                .map(|r| {
                    (r.start + lag..r.end)
                        .map(|i| (x[i] - m) * (x[i - lag] - m))
                        .sum::<f64>()
                })
                .sum()
        };
        let found = autocorrelation(&x, &frame, 30);
        for (lag, a) in found.iter().enumerate() {
            assert!((a - at(lag) / at(0)).abs() < 1e-12, "{lag}");
        }
    }

    fn coloured(seed: u64, n: usize) -> Vec<f64> {
        let mut rng = Rng::new(seed);
        let mut x = 0.0;
        (0..n)
            .map(|_| {
                x = 0.95 * x + rng.normal();
                x
            })
            .collect()
    }

    #[test]
    fn two_slow_unrelated_signals_rarely_pass_for_related() {
        let n = 4000;
        let t: Vec<f64> = (0..n).map(|i| i as f64).collect();
        let whole = std::iter::once(0..n).collect();
        let frame = Frame::new(vec![], t, whole);
        let false_alarms = (0..60)
            .filter(|&s| {
                cross_correlation(&coloured(s, n), &coloured(1000 + s, n), "x", &frame).p < 0.01
            })
            .count();
        assert!(false_alarms <= 3, "{false_alarms} of 60");
        let white: Vec<f64> = {
            let mut g = Rng::new(5);
            (0..n).map(|_| g.normal()).collect()
        };
        assert!(whiteness(&white, &frame).p > 0.001);
        assert!(whiteness(&coloured(1, n), &frame).p < 1e-6);
    }
}
