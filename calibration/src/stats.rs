//! The statistics that the calibration needs: robust location and scale, and the normal, chi-square
//! and Student distributions.

use statrs::function::beta::checked_beta_reg;
use statrs::function::gamma::{checked_gamma_lr, checked_gamma_ur};

/// Factor from the median absolute deviation to the standard deviation of normal data, 1 / 0.6745.
pub const MAD_TO_SD: f64 = 1.482_602_218_505_602;

/// Median; for an even count the mean of the two middle values. NaN for an empty slice.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => sorted[n / 2],
        _ => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// Standard deviation of the normal part of the data, from the median absolute deviation. Half of
/// the data may be wrong. NaN for an empty slice.
#[must_use]
pub fn robust_sd(values: &[f64]) -> f64 {
    let middle = median(values);
    let deviations: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
    MAD_TO_SD * median(&deviations)
}

/// Probability that a standard normal number is below `z`.
#[must_use]
pub fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

/// The `p` quantile of the standard normal distribution, `p` in 0 to 1 (exclusive). NaN outside.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    invert(p, -40.0, 40.0, normal_cdf)
}

/// Probability that chi-square with `dof` degrees of freedom exceeds `x`. 1 for no degrees of
/// freedom.
#[must_use]
pub fn chi_square_survival(x: f64, dof: usize) -> f64 {
    if dof == 0 || x <= 0.0 {
        return 1.0;
    }
    checked_gamma_ur(0.5 * dof as f64, 0.5 * x).unwrap_or(f64::NAN)
}

/// The `p` quantile of chi-square with `dof` degrees of freedom.
#[must_use]
pub fn chi_square_quantile(p: f64, dof: usize) -> f64 {
    chi_square_quantile_of(p, dof as f64)
}

/// The same for a number of degrees of freedom that is not whole.
#[must_use]
pub fn chi_square_quantile_of(p: f64, k: f64) -> f64 {
    invert(p, 0.0, k + 40.0 * (2.0 * k).sqrt() + 100.0, |x| {
        // Refused where k or x is 0.
        checked_gamma_lr(0.5 * k, 0.5 * x).unwrap_or(0.0)
    })
}

/// The `p` quantile of Student's t with `dof` degrees of freedom (any positive number); the normal
/// quantile for an infinite one.
#[must_use]
pub fn student_quantile(p: f64, dof: f64) -> f64 {
    if dof > 1e6 {
        return normal_quantile(p);
    }
    invert(p, -1e6, 1e6, |t| student_cdf(t, dof))
}

/// Two-sided p-value of a t statistic with `dof` degrees of freedom.
#[must_use]
pub fn student_two_sided(t: f64, dof: f64) -> f64 {
    if dof > 1e6 {
        return libm::erfc(t.abs() / std::f64::consts::SQRT_2);
    }
    checked_beta_reg(0.5 * dof, 0.5, dof / (dof + t * t)).unwrap_or(f64::NAN)
}

fn student_cdf(t: f64, dof: f64) -> f64 {
    let tail = 0.5 * student_two_sided(t, dof);
    if t > 0.0 {
        1.0 - tail
    } else {
        tail
    }
}

/// Inverse of an increasing function by bisection; NaN where `p` is no probability.
fn invert(p: f64, mut low: f64, mut high: f64, cdf: impl Fn(f64) -> f64) -> f64 {
    if !(p > 0.0 && p < 1.0) {
        return f64::NAN;
    }
    // 100 halvings reach the last bit of any start within these bounds.
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if cdf(middle) < p {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Reference values from published tables (NIST/SEMATECH e-handbook, 1.3.6.7).
    #[test]
    fn quantiles_match_the_tables() {
        for (got, want) in [
            (normal_quantile(0.975), 1.959_963_984_540_054),
            (student_quantile(0.975, 5.0), 2.570_581_835_636_314),
            (student_quantile(0.975, 1.0), 12.706_204_736_432_095),
            (student_quantile(0.95, 30.0), 1.697_260_886_593_957),
            (chi_square_quantile(0.95, 3), 7.814_727_903_251_178),
            (chi_square_quantile(0.95, 1), 3.841_458_820_694_124),
            (chi_square_quantile(0.99, 18), 34.805_305_734_705_065),
        ] {
            assert!((got / want - 1.0).abs() < 1e-9, "{got} {want}");
        }
        assert!((chi_square_survival(7.814_727_903_251_178, 3) - 0.05).abs() < 1e-12);
        assert!((student_two_sided(2.570_581_835_636_314, 5.0) - 0.05).abs() < 1e-12);
    }

    #[test]
    fn bad_probabilities_give_nan() {
        for p in [0.0, 1.0, -1.0, f64::NAN] {
            assert!(normal_quantile(p).is_nan());
        }
    }

    #[test]
    fn robust_figures_ignore_a_minority() {
        let mut values: Vec<f64> = (0..101).map(|i| f64::from(i) / 50.0 - 1.0).collect();
        let sd = robust_sd(&values);
        for v in values.iter_mut().take(20) {
            *v = 1e9;
        }
        assert!(median(&values).abs() < 0.5);
        assert!(robust_sd(&values) < 2.0 * sd);
    }
}
