//! Small statistics: robust location, distributions, a reproducible generator, tests of residuals
//! that stay valid for coloured signals.

use crate::frame::Frame;
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
    for r in frame.sequences() {
        let s = &x[r.clone()];
        for (k, o) in out.iter_mut().enumerate() {
            if s.len() > k {
                *o += s[k..]
                    .iter()
                    .zip(s)
                    .map(|(a, b)| (a - m) * (b - m))
                    .sum::<f64>();
            }
        }
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
