//! How good a load cell is: linearity, hysteresis and creep.
//!
//! The figures are defined as in OIML R 60-1 (2021), 3.4 and 5.3 to 5.6, relative to the largest
//! load applied. No class is claimed: that takes its temperature and repetition programme.

use super::{Direction, Gain};

/// Linearity and hysteresis of one series of readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// Largest mean deviation from the fitted curve at one load, N, with its sign.
    pub linearity_n: f64,
    /// The same, part of the largest load.
    pub linearity_relative: f64,
    /// Load at which it is, N.
    pub linearity_at_n: f64,
    /// Hysteresis, where there are loads with readings in both directions.
    pub hysteresis: Option<Hysteresis>,
}

/// Difference between unloading and loading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    /// Largest difference of the means at one load, unloading less loading, N.
    pub largest_n: f64,
    /// The same, part of the largest load.
    pub relative: f64,
    /// Standard error of the difference, N.
    pub standard_error_n: f64,
    /// Load at which it is, N.
    pub at_n: f64,
}

/// Linearity and hysteresis from the residuals of a fit.
///
/// The linearity is against the curve of the fit: the straight line, unless the fit has taken the
/// quadratic term in.
#[must_use]
pub fn shape(gain: &Gain) -> Shape {
    let mut loads: Vec<f64> = gain.residuals.iter().map(|r| r.force_n).collect();
    loads.sort_by(f64::total_cmp);
    loads.dedup();
    let mean = |load: f64, direction: Option<Direction>| -> Option<(f64, f64)> {
        let chosen: Vec<_> = gain
            .residuals
            .iter()
            .filter(|r| r.force_n == load && (direction.is_none() || r.direction == direction))
            .collect();
        let n = chosen.len() as f64;
        let variance: f64 = chosen.iter().map(|r| r.sd_n * r.sd_n).sum::<f64>() / (n * n);
        (n > 0.0).then(|| {
            (
                chosen.iter().map(|r| r.residual_n).sum::<f64>() / n,
                variance,
            )
        })
    };
    let mut out = Shape {
        linearity_n: 0.0,
        linearity_relative: 0.0,
        linearity_at_n: 0.0,
        hysteresis: None,
    };
    for &load in &loads {
        if let Some((deviation, _)) = mean(load, None) {
            if deviation.abs() > out.linearity_n.abs() {
                out.linearity_n = deviation;
                out.linearity_at_n = load;
            }
        }
        let up = mean(load, Some(Direction::Loading));
        let down = mean(load, Some(Direction::Unloading));
        if let (Some((up, up_variance)), Some((down, down_variance))) = (up, down) {
            let difference = down - up;
            if out
                .hysteresis
                .is_none_or(|h| difference.abs() > h.largest_n.abs())
            {
                out.hysteresis = Some(Hysteresis {
                    largest_n: difference,
                    relative: difference / gain.largest_n,
                    standard_error_n: (up_variance + down_variance).sqrt(),
                    at_n: load,
                });
            }
        }
    }
    out.linearity_relative = out.linearity_n / gain.largest_n;
    out
}

/// Creep under a constant load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Creep {
    /// Change from the first reading to the one that is furthest from it, N.
    pub largest_n: f64,
    /// The same, part of the load.
    pub relative: f64,
    /// Change from 20 to 30 minutes, N, where the record reaches that far.
    pub late_n: Option<f64>,
    /// Amplitude of the exponential `A (1 - exp(-t / tau))` that fits best, N.
    pub amplitude_n: f64,
    /// Time constant `tau` of it, s.
    pub time_constant_s: f64,
    /// Root mean square of what it leaves, N.
    pub rms_left_n: f64,
}

/// Creep from a record of `(time in s, code)` at constant load `load_n` (N), averaged readings from
/// the moment the load is on. `None` for fewer than five readings, times that do not rise, a load
/// that is not positive, or numbers that are not finite.
#[must_use]
pub fn creep(record: &[(f64, f64)], n_per_code: f64, load_n: f64) -> Option<Creep> {
    let rising = record.windows(2).all(|w| w[1].0 > w[0].0);
    let finite = record.iter().all(|r| r.0.is_finite() && r.1.is_finite());
    let loaded = load_n > 0.0 && n_per_code.is_finite();
    if record.len() < 5 || !rising || !finite || !loaded {
        return None;
    }
    let (start, first) = record[0];
    let points: Vec<(f64, f64)> = record
        .iter()
        .map(|(t, c)| (t - start, (c - first) * n_per_code))
        .collect();
    let largest_n = points
        .iter()
        .map(|p| p.1)
        .max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
    let span = points.last()?.0;
    // Time constants from one step of the record to three times its length, by a scan and then
    // golden section.
    let low = (points[1].0 * 0.3).ln();
    let high = (3.0 * span).ln();
    let steps = 60;
    let at = |i: i32| low + (high - low) * f64::from(i) / f64::from(steps);
    let cost = |log_tau: f64| exponential(&points, log_tau.exp()).map_or(f64::INFINITY, |f| f.1);
    let best = (0..=steps).min_by(|&a, &b| cost(at(a)).total_cmp(&cost(at(b))))?;
    let (mut a, mut b) = (at((best - 1).max(0)), at((best + 1).min(steps)));
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (c, d) = (b - ratio * (b - a), a + ratio * (b - a));
        if cost(c) < cost(d) {
            b = d;
        } else {
            a = c;
        }
    }
    let tau = (0.5 * (a + b)).exp();
    let (amplitude_n, squares) = exponential(&points, tau)?;
    let near = |t: f64| {
        points
            .iter()
            .filter(|p| (p.0 - t).abs() <= 0.05 * t)
            .min_by(|x, y| (x.0 - t).abs().total_cmp(&(y.0 - t).abs()))
            .map(|p| p.1)
    };
    Some(Creep {
        largest_n,
        relative: largest_n / load_n,
        late_n: near(1800.0).zip(near(1200.0)).map(|(b, a)| b - a),
        amplitude_n,
        time_constant_s: tau,
        rms_left_n: (squares / points.len() as f64).sqrt(),
    })
}

/// Amplitude of `F0 + A (1 - exp(-t / tau))` and the sum of squares it leaves.
fn exponential(points: &[(f64, f64)], tau: f64) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let basis = |t: f64| 1.0 - (-t / tau).exp();
    let x_mean = points.iter().map(|p| basis(p.0)).sum::<f64>() / n;
    let y_mean = points.iter().map(|p| p.1).sum::<f64>() / n;
    let sxx: f64 = points.iter().map(|p| (basis(p.0) - x_mean).powi(2)).sum();
    let sxy: f64 = points
        .iter()
        .map(|p| (basis(p.0) - x_mean) * (p.1 - y_mean))
        .sum();
    if sxx <= 0.0 {
        return None;
    }
    let amplitude = sxy / sxx;
    let squares = points
        .iter()
        .map(|p| (p.1 - y_mean - amplitude * (basis(p.0) - x_mean)).powi(2))
        .sum();
    Some((amplitude, squares))
}
