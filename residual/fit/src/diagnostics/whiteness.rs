//! Tests of the residual that stay valid for coloured signals: against itself and against each
//! input.

use super::correlation::autocorrelation;
use residual_columns::frame::Frame;
use residual_columns::stats::{chi2_tail, mean, normal_tail};
use serde::{Deserialize, Serialize};

/// One test of the residual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResidualTest {
    /// Variable tested against; `itself` for whiteness.
    pub against: String,
    /// Lag of the largest correlation, in rows (positive: the residual follows the variable).
    pub lag: i64,
    /// Correlation at that lag.
    #[serde(deserialize_with = "residual_columns::nan::from_null")]
    pub correlation: f64,
    /// Probability of a statistic at least so large by chance.
    #[serde(
        rename = "p_value",
        deserialize_with = "residual_columns::nan::from_null"
    )]
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
    use crate::diagnostics::coloured;
    use residual_columns::stats::Rng;

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
