//! Autocorrelation over sequences, and the correlation time from it.

use crate::problem::Problem;
use residual_columns::fourier::{Complex, Planner};
use residual_columns::frame::Frame;
use residual_columns::stats::{deviation, mean};

/// Autocorrelation of `x` at lags 0..=`lags` over the sequences, mean removed overall.
pub fn autocorrelation(x: &[f64], frame: &Frame, lags: usize) -> Vec<f64> {
    let m = mean(x);
    let mut out = vec![0.0; lags + 1];
    let mut planner = Planner::default();
    for r in frame.sequences() {
        // By the transform of the power spectrum, with zeros after the rows so that nothing wraps.
        let s = &x[r.clone()];
        let reach = lags.min(s.len().saturating_sub(1));
        let n = (s.len() + reach).next_power_of_two();
        let mut z = vec![Complex::new(0.0, 0.0); n];
        z.iter_mut().zip(s).for_each(|(z, x)| z.re = x - m);
        planner.forward(n).process(&mut z);
        z.iter_mut()
            .for_each(|z| *z = Complex::new(z.norm_sqr() / n as f64, 0.0));
        planner.inverse(n).process(&mut z);
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

/// Variance of the mean of values that have this correlation time in rows.
pub(super) fn variance_of_mean(values: &[f64], clump: f64) -> f64 {
    deviation(values).powi(2) * clump / values.len().max(1) as f64
}

/// Correlation time of values on kept rows, in rows.
pub fn correlation_rows(p: &Problem, r: &[f64]) -> f64 {
    let frame = p.kept_frame();
    let reach = (frame.len() / 50).clamp(20, 400);
    correlation_time(&autocorrelation(r, &frame, reach))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::coloured;

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
}
