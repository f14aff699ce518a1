//! Zero of a load cell: what the converter reads while the cable is slack (thesis 3.5.1).
//!
//! [`measure`] takes a stream of codes and gives the zero with its uncertainty, or the reason why
//! this stream gives none. [`split`] takes the weight of motor and rack (about 500 g along the
//! measuring axis) from it, so that the rest is the converter's own offset. [`History`] follows
//! that offset over power-ups: the calibration that the NAU7802 does at each start moves it (device
//! facts, NAU7802), and tells a slack cable from a preloaded one.
//!
//! # Method
//!
//! Spikes (logs of the rig have them) are codes further than [`Limits::spike_sd`] robust standard
//! deviations from the median; they are left out. A line in time is fitted to the rest: its middle
//! is the mean, its end is the zero that holds when the measurement is over. Successive codes are
//! not independent (the converter's filter, the mains), so the variance is multiplied by the
//! integrated autocorrelation time of the residuals, summed by Geyer's initial positive sequence
//! (*Statistical Science* 7 (1992) 473).

mod history;
mod pay_out;

pub use history::{History, PowerUp, Verdict, PRIOR_POWER_UPS};
pub use pay_out::{pay_out, PayOut, LEAST_TRAVEL_M};

use crate::stats;
use nalgebra::{Matrix3, Vector3};

/// Largest code of the converter, where it saturates.
const CODE_MAX: i32 = 0x7F_FFFF;
/// Smallest code of the converter, where it saturates.
const CODE_MIN: i32 = -0x80_0000;
/// Fewest codes that give a zero: the autocorrelation needs a stretch.
const FEWEST: usize = 64;

/// What a stream of codes has to keep to. All forces are converted with the nominal scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Nominal scale, N per code (6.85e-6 for the cells of the thesis at gain 128).
    pub nominal_n_per_code: f64,
    /// Distance from the median beyond which a code is a spike, in robust standard deviations.
    pub spike_sd: f64,
    /// Largest part of the codes that may be spikes, 0 to 1.
    pub spike_part: f64,
    /// Largest standard deviation of the codes, N.
    pub noise_n: f64,
    /// Largest change over the stream, N. Above it, the stream drifts if the change is also larger
    /// than three times its standard error.
    pub drift_n: f64,
    /// Largest standard error of the zero, N.
    pub standard_error_n: f64,
}

impl Default for Limits {
    /// For a zero within 5 mN: noise up to 20 mN (idle channels of the rig have 1.7 to 5 mN), drift
    /// up to 3 mN, standard error up to 2 mN.
    fn default() -> Self {
        Self {
            nominal_n_per_code: 6.85e-6,
            spike_sd: 6.0,
            spike_part: 0.05,
            noise_n: 0.020,
            drift_n: 0.003,
            standard_error_n: 0.002,
        }
    }
}

/// A measured zero. All in codes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Zero {
    /// Zero at the end of the stream, from the fitted line: the value to use.
    pub at_end_codes: f64,
    /// Standard error of [`Self::at_end_codes`].
    pub at_end_se_codes: f64,
    /// Robust mean over the stream.
    pub mean_codes: f64,
    /// Standard error of [`Self::mean_codes`].
    pub mean_se_codes: f64,
    /// Change from the first to the last code, from the fitted line.
    pub drift_codes: f64,
    /// Standard error of [`Self::drift_codes`].
    pub drift_se_codes: f64,
    /// Standard deviation of one code about the line, spikes left out.
    pub noise_sd_codes: f64,
    /// Integrated autocorrelation time, in samples: 1 for independent ones. The stream counts for
    /// this many times fewer codes.
    pub correlation_samples: f64,
    /// Codes used.
    pub used: usize,
    /// Spikes left out.
    pub spikes: usize,
}

/// Why a stream of codes gives no zero.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ZeroError {
    /// Fewer codes than needed.
    #[error("{got} codes are too few for a zero; take at least {FEWEST}")]
    TooFew {
        /// Codes given.
        got: usize,
    },
    /// The converter stands at an end of its range.
    #[error("the converter is saturated at code {code} (sample {sample}); unload the cell, check the wiring of the bridge and the gain")]
    Saturated {
        /// The code.
        code: i32,
        /// Index of the sample, from 0.
        sample: usize,
    },
    /// The same code all the time: the converter doesn't convert.
    #[error("all codes are {code}: the converter is not converting; check CS in PU_CTRL and the DRDY line")]
    Stuck {
        /// The code.
        code: i32,
    },
    /// Too many codes far from the others.
    #[error("{spikes} of {total} codes are spikes, more than {limit}; check cable screen and bus errors")]
    Spikes {
        /// Codes far from the median.
        spikes: usize,
        /// Codes given.
        total: usize,
        /// Spikes allowed.
        limit: usize,
    },
    /// The codes scatter too much.
    #[error("the codes scatter by {noise_n:.4} N (standard deviation), limit {limit_n:.4} N; wait until robot and motors are still, check the screen")]
    Noisy {
        /// Standard deviation, N.
        noise_n: f64,
        /// Limit, N.
        limit_n: f64,
    },
    /// The codes drift.
    #[error("the zero drifts: {drift_n:+.4} N over the stream (standard error {se_n:.4} N), limit {limit_n:.4} N; let the cell warm up and measure again")]
    Drifting {
        /// Change, N.
        drift_n: f64,
        /// Its standard error, N.
        se_n: f64,
        /// Limit, N.
        limit_n: f64,
    },
    /// The mean isn't known well enough.
    #[error("the zero is known to {se_n:.4} N only (standard error; codes correlated over {correlation_samples:.0} samples), limit {limit_n:.4} N; measure longer, or let the cell come to rest")]
    Uncertain {
        /// Standard error, N.
        se_n: f64,
        /// Correlation time, samples.
        correlation_samples: f64,
        /// Limit, N.
        limit_n: f64,
    },
    /// A number in the limits is not positive and finite.
    #[error("limit `{name}` is {value}; it has to be positive and finite")]
    BadLimit {
        /// The field of [`Limits`].
        name: &'static str,
        /// Its value.
        value: f64,
    },
}

/// The zero in a stream of codes taken at a constant rate with the cable slack.
///
/// # Errors
/// [`ZeroError`] with the first reason, in the order of the variants, why the stream gives none.
pub fn measure(codes: &[i32], limits: &Limits) -> Result<Zero, ZeroError> {
    for (name, value) in [
        ("nominal_n_per_code", limits.nominal_n_per_code),
        ("spike_sd", limits.spike_sd),
        ("noise_n", limits.noise_n),
        ("drift_n", limits.drift_n),
        ("standard_error_n", limits.standard_error_n),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(ZeroError::BadLimit { name, value });
        }
    }
    if codes.len() < FEWEST {
        return Err(ZeroError::TooFew { got: codes.len() });
    }
    // A single code at the end of the range may be a spike (a lost bit); a run of them is
    // saturation.
    let at_end = |c: i32| c >= CODE_MAX || c <= CODE_MIN;
    if let Some(sample) = (0..codes.len() - 2).find(|&i| codes[i..i + 3].iter().all(|&c| at_end(c)))
    {
        return Err(ZeroError::Saturated {
            code: codes[sample],
            sample,
        });
    }
    if codes.iter().all(|&c| c == codes[0]) {
        return Err(ZeroError::Stuck { code: codes[0] });
    }
    let values: Vec<f64> = codes.iter().map(|&c| f64::from(c)).collect();
    let middle = stats::median(&values);
    // Half a code at least: a quiet converter may give two codes only.
    let reach = limits.spike_sd * stats::robust_sd(&values).max(0.5);
    let kept: Vec<(f64, f64)> = values
        .iter()
        .enumerate()
        .filter(|(_, v)| (*v - middle).abs() <= reach)
        .map(|(i, v)| (i as f64, *v))
        .collect();
    let spikes = codes.len() - kept.len();
    let allowed = (limits.spike_part.clamp(0.0, 1.0) * codes.len() as f64) as usize;
    if spikes > allowed || kept.len() < FEWEST {
        return Err(ZeroError::Spikes {
            spikes,
            total: codes.len(),
            limit: allowed,
        });
    }
    let zero = line(&kept, codes.len(), spikes);
    let newtons = limits.nominal_n_per_code;
    let drift_n = zero.drift_codes * newtons;
    let drift_se_n = zero.drift_se_codes * newtons;
    if drift_n.abs() > limits.drift_n && drift_n.abs() > 3.0 * drift_se_n {
        return Err(ZeroError::Drifting {
            drift_n,
            se_n: drift_se_n,
            limit_n: limits.drift_n,
        });
    }
    let noise_n = zero.noise_sd_codes * newtons;
    if noise_n > limits.noise_n {
        return Err(ZeroError::Noisy {
            noise_n,
            limit_n: limits.noise_n,
        });
    }
    let se_n = zero.at_end_se_codes * newtons;
    if se_n > limits.standard_error_n {
        return Err(ZeroError::Uncertain {
            se_n,
            correlation_samples: zero.correlation_samples,
            limit_n: limits.standard_error_n,
        });
    }
    Ok(zero)
}

/// Line through `(sample, code)` with errors that allow for autocorrelation.
fn line(kept: &[(f64, f64)], total: usize, spikes: usize) -> Zero {
    let n = kept.len() as f64;
    let t_mean = kept.iter().map(|k| k.0).sum::<f64>() / n;
    let mean = kept.iter().map(|k| k.1).sum::<f64>() / n;
    let sxx: f64 = kept.iter().map(|k| (k.0 - t_mean).powi(2)).sum();
    let sxy: f64 = kept.iter().map(|k| (k.0 - t_mean) * (k.1 - mean)).sum();
    let slope = sxy / sxx;
    let residuals: Vec<f64> = kept
        .iter()
        .map(|k| k.1 - mean - slope * (k.0 - t_mean))
        .collect();
    let variance = residuals.iter().map(|r| r * r).sum::<f64>() / (n - 2.0)
        // Rounding to whole codes, where the noise is too small to show it.
        + 1.0 / 12.0;
    let correlation = correlation_time(&residuals);
    let mean_variance = variance * correlation / n;
    let slope_variance = variance * correlation / sxx;
    let last = total as f64 - 1.0;
    Zero {
        at_end_codes: mean + slope * (last - t_mean),
        at_end_se_codes: (mean_variance + slope_variance * (last - t_mean).powi(2)).sqrt(),
        mean_codes: mean,
        mean_se_codes: mean_variance.sqrt(),
        drift_codes: slope * last,
        drift_se_codes: slope_variance.sqrt() * last,
        noise_sd_codes: variance.sqrt(),
        correlation_samples: correlation,
        used: kept.len(),
        spikes,
    }
}

/// Integrated autocorrelation time of a series of zero mean, in samples, at least 0.1: 1 + 2 sum of
/// the autocorrelations, over pairs of lags while their sum is positive and falling.
fn correlation_time(residuals: &[f64]) -> f64 {
    let n = residuals.len();
    let covariance = |lag: usize| -> f64 {
        residuals[lag..]
            .iter()
            .zip(residuals)
            .map(|(a, b)| a * b)
            .sum::<f64>()
            / n as f64
    };
    let variance = covariance(0);
    if variance <= 0.0 {
        return 1.0;
    }
    let mut sum = -1.0;
    let mut before = f64::INFINITY;
    for pair in 0..n / 4 {
        let gamma = (covariance(2 * pair) + covariance(2 * pair + 1)) / variance;
        if gamma <= 0.0 {
            break;
        }
        before = gamma.min(before);
        sum += 2.0 * before;
    }
    sum.max(0.1)
}

/// The moving mass of a force unit and the gravity that acts on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    /// Mass of motor and rack, kg (thesis 3.5.1: about 0.5).
    pub mass_kg: f64,
    /// Standard uncertainty of the mass, kg.
    pub mass_sd_kg: f64,
    /// Acceleration of gravity in the base frame, m/s^2: a vector that points down.
    pub gravity_m_per_s2: Vector3<f64>,
    /// Measuring axis, unit vector from the unit to the workspace, base frame.
    pub axis: Vector3<f64>,
    /// Covariance of the axis, dimensionless (rad^2 across the axis).
    pub axis_covariance: Matrix3<f64>,
}

/// A zero in its two parts, N. Their sum is the zero times the scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// Weight of motor and rack along the axis, `m g . axis`, N: constant while the unit stays
    /// where it is.
    pub mounting_n: f64,
    /// Standard uncertainty of [`Self::mounting_n`], N.
    pub mounting_sd_n: f64,
    /// Offset of bridge and converter, N: changes at each power-up.
    pub converter_n: f64,
    /// Standard uncertainty of [`Self::converter_n`], N. The two parts are anticorrelated: the
    /// uncertainty of their sum is that of the zero.
    pub converter_sd_n: f64,
}

/// Splits a measured zero into the weight of motor and rack and the converter's own offset.
///
/// `n_per_code` is the scale with its standard uncertainty, N per code.
#[must_use]
pub fn split(zero: &Zero, n_per_code: (f64, f64), mounting: &Mounting) -> Parts {
    let (scale, scale_sd) = n_per_code;
    let g = mounting.gravity_m_per_s2;
    let along = g.dot(&mounting.axis);
    let mounting_n = mounting.mass_kg * along;
    let mounting_variance = (mounting.mass_sd_kg * along).powi(2)
        + mounting.mass_kg.powi(2) * (g.transpose() * mounting.axis_covariance * g)[0];
    let zero_variance =
        (scale * zero.at_end_se_codes).powi(2) + (scale_sd * zero.at_end_codes).powi(2);
    Parts {
        mounting_n,
        mounting_sd_n: mounting_variance.sqrt(),
        converter_n: scale * zero.at_end_codes - mounting_n,
        converter_sd_n: (zero_variance + mounting_variance).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing::normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// `n` codes with correlation `rho` from one to the next, standard deviation `sd` codes, about
    /// 12,345.
    fn stream(seed: u64, n: usize, rho: f64, sd: f64, drift: f64) -> Vec<i32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = normal(&mut rng);
        (0..n)
            .map(|i| {
                noise = rho * noise + (1.0 - rho * rho).sqrt() * normal(&mut rng);
                (12_345.0 + drift * i as f64 / n as f64 + sd * noise).round() as i32
            })
            .collect()
    }

    #[test]
    fn intervals_cover_with_correlated_noise() {
        let limits = Limits {
            drift_n: 0.02,
            ..Limits::default()
        };
        for (rho, drift) in [(0.0, 0.0), (0.5, 200.0), (0.8, -200.0)] {
            let hits = (0..400)
                .filter(|&seed| {
                    let zero = measure(&stream(seed, 2000, rho, 400.0, drift), &limits).unwrap();
                    let error = zero.at_end_codes - 12_345.0 - drift;
                    error.abs() < 1.96 * zero.at_end_se_codes
                })
                .count();
            // Binomial(400, 0.95) has a standard deviation of 4.4; Geyer's sum is a little short at
            // rho 0.8.
            assert!((362..=396).contains(&hits), "rho {rho}: {hits} of 400");
        }
    }

    #[test]
    fn spikes_do_not_move_the_mean() {
        let clean = stream(1, 2000, 0.0, 400.0, 0.0);
        let mut spiky = clean.clone();
        for i in (0..2000).step_by(40) {
            spiky[i] = spiky[i].wrapping_mul(256).clamp(CODE_MIN, CODE_MAX);
        }
        let (a, b) = (
            measure(&clean, &Limits::default()).unwrap(),
            measure(&spiky, &Limits::default()).unwrap(),
        );
        assert_eq!(b.spikes, 50);
        assert!((a.mean_codes - b.mean_codes).abs() < 10.0);
    }

    #[test]
    fn each_refusal_has_its_reason() {
        let limits = Limits::default();
        let refuse = |codes: &[i32]| measure(codes, &limits).unwrap_err();
        assert!(matches!(refuse(&[1; 10]), ZeroError::TooFew { got: 10 }));
        assert!(matches!(refuse(&[7; 100]), ZeroError::Stuck { code: 7 }));
        assert!(matches!(
            refuse(&[CODE_MAX; 100]),
            ZeroError::Saturated { .. }
        ));
        // 5,000 codes are 34 mN.
        assert!(matches!(
            refuse(&stream(1, 2000, 0.0, 400.0, 5000.0)),
            ZeroError::Drifting { .. }
        ));
        assert!(matches!(
            refuse(&stream(1, 2000, 0.0, 5000.0, 0.0)),
            ZeroError::Noisy { .. }
        ));
        // A random walk: its mean says little, though it does not scatter much.
        assert!(matches!(
            refuse(&stream(3, 2000, 0.999, 4000.0, 0.0)),
            ZeroError::Uncertain { .. } | ZeroError::Drifting { .. }
        ));
        let mut spiky = stream(1, 2000, 0.0, 400.0, 0.0);
        for code in spiky.iter_mut().step_by(10) {
            *code = 1_000_000;
        }
        assert!(matches!(refuse(&spiky), ZeroError::Spikes { .. }));
        let bad = Limits {
            noise_n: f64::NAN,
            ..limits
        };
        assert!(matches!(
            measure(&spiky, &bad),
            Err(ZeroError::BadLimit { .. })
        ));
    }

    #[test]
    fn mounting_and_converter_part_add_up() {
        let zero = measure(&stream(1, 2000, 0.0, 400.0, 0.0), &Limits::default()).unwrap();
        let axis = Vector3::new(0.0, 0.6, -0.8);
        let parts = split(
            &zero,
            (6.85e-6, 6.85e-9),
            &Mounting {
                mass_kg: 0.5,
                mass_sd_kg: 0.01,
                gravity_m_per_s2: Vector3::new(0.0, 0.0, -9.80665),
                axis,
                axis_covariance: (Matrix3::identity() - axis * axis.transpose()) * 0.005f64.powi(2),
            },
        );
        assert!((parts.mounting_n - 0.5 * 9.80665 * 0.8).abs() < 1e-12);
        let sum = parts.mounting_n + parts.converter_n;
        assert!((sum - 6.85e-6 * zero.at_end_codes).abs() < 1e-12);
        // Mass: 0.01 kg * 7.845; axis: 0.5 * 9.80665 * 0.005 * sin(angle) = 0.6.
        let want = (0.078_453f64.powi(2) + (0.5 * 9.80665 * 0.005 * 0.6f64).powi(2)).sqrt();
        assert!((parts.mounting_sd_n - want).abs() < 1e-4);
    }
}
