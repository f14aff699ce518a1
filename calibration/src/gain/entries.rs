//! Wrong entries among weight readings: 500 entered for 50, a weight of the set taken for another,
//! a reading that belongs to none.
//!
//! First the line that most readings agree with: each pair of readings with different weights gives
//! a line, and the line with the least sum of squared residuals, each cut off at three standard
//! deviations, wins. That stays right while the right readings outnumber those wrong in one way,
//! and a wrong entry at the largest weight can't draw the line to itself. Then, for each reading,
//! the likelihood of its code under the weight entered, under a decimal slip of it, under each
//! other weight of the set (and none), and under no weight at all (any code equally likely), with
//! the prior probabilities below. The scatter that the readings show is allowed for: a poor
//! repeatability makes no wrong entries. A reading is named when the weight entered is less likely
//! than the rest together.

use super::{Options, Reading};
use crate::input::Location;
use crate::stats;

/// Prior probability that an entry is a decimal slip, up and down together.
const SLIP: f64 = 0.004;
/// Prior probability that another weight of the set was meant, all of them together.
const OTHER: f64 = 0.008;
/// Prior probability that the reading belongs to no weight: touched, swinging, cable preloaded.
const NO_WEIGHT: f64 = 0.002;
/// Standard deviation allowed for curvature, hysteresis and creep while looking for wrong entries,
/// part of the range of codes.
const SHAPE: f64 = 1e-3;
/// Least standard deviation allowed for repeatability while looking for wrong entries, N: with a
/// small set of weights, what a hand does to the cell is more than the part [`SHAPE`] of the range.
const REPEATABILITY_N: f64 = 0.003;
/// Where the squared residual of a reading stops to count.
const CUT: f64 = 9.0;

/// A reading that does not belong to its weight.
#[derive(Debug, Clone, PartialEq)]
pub struct WrongEntry {
    /// Where it was entered.
    pub at: Location,
    /// Weight entered, g.
    pub entered_g: f64,
    /// Weight that the code belongs to, g; `None` where it belongs to no weight of the set.
    pub likely_g: Option<f64>,
    /// Probability of [`Self::likely_g`] (or of no weight), 0 to 1.
    pub probability: f64,
    /// Weight that the code would be, from the other readings, g.
    pub measured_g: f64,
}

pub(super) fn describe(wrong: &[WrongEntry]) -> String {
    let lines: Vec<String> = wrong
        .iter()
        .map(|w| match w.likely_g {
            Some(likely) => format!(
                "{}: entered {} g, but the code is that of {:.1} g: probably {} g (probability {:.3}); correct the line or leave it out",
                w.at, w.entered_g, w.measured_g, likely, w.probability
            ),
            None => format!(
                "{}: entered {} g, but the code is that of {:.1} g, which no weight of the set explains; measure it again or leave it out",
                w.at, w.entered_g, w.measured_g
            ),
        })
        .collect();
    lines.join("\n")
}

/// The readings that do not belong to their weight, in the order given. Empty where no line can be
/// found.
#[must_use]
pub fn find(readings: &[Reading], options: &Options) -> Vec<WrongEntry> {
    let codes = || readings.iter().map(|r| r.code);
    let range = codes().fold(f64::NEG_INFINITY, f64::max) - codes().fold(f64::INFINITY, f64::min);
    let Some((zero, codes_per_g)) = consensus(readings, options, range) else {
        return Vec::new();
    };
    let scatter = scatter(readings, zero, codes_per_g);
    readings
        .iter()
        .filter_map(|r| judge(r, options, (zero, codes_per_g), (range, scatter)))
        .collect()
}

/// How much the readings scatter for other reasons than their standard errors, codes.
///
/// About the line, or among the readings of one weight where that is less: a cell that is curved
/// leaves the line by the same each time, and its wrong entries are to be seen all the same.
fn scatter(readings: &[Reading], zero: f64, codes_per_g: f64) -> f64 {
    let residual = |r: &Reading| r.code - zero - codes_per_g * r.weight_g;
    let sizes = |values: &[f64]| values.iter().map(|v| v.abs()).collect::<Vec<f64>>();
    let about_line: Vec<f64> = readings.iter().map(residual).collect();
    let mut scatter = stats::MAD_TO_SD * stats::median(&sizes(&about_line));
    let mut among: Vec<f64> = Vec::new();
    for (i, r) in readings.iter().enumerate() {
        let same: Vec<f64> = readings
            .iter()
            .filter(|other| other.weight_g == r.weight_g)
            .map(residual)
            .collect();
        let count = same.len() as f64;
        if same.len() > 1 {
            // The middle is that of the same few readings, which makes them look too near to it.
            let free = (count / (count - 1.0)).sqrt();
            among.push(free * (about_line[i] - stats::median(&same)));
        }
    }
    if 2 * among.len() >= readings.len() {
        scatter = scatter.min(stats::MAD_TO_SD * stats::median(&sizes(&among)));
    }
    scatter
}

/// Standard deviation of a code about the line, codes.
fn sd(reading: &Reading, weight_g: f64, options: &Options, codes_per_g: f64, range: f64) -> f64 {
    let tolerance = options.weights.relative_sd(weight_g) * weight_g * codes_per_g;
    let repeatability = REPEATABILITY_N * codes_per_g / (1e-3 * options.gravity_m_per_s2);
    (reading.standard_error_codes.powi(2)
        + tolerance * tolerance
        + repeatability * repeatability
        + (SHAPE * range).powi(2))
    .sqrt()
}

/// Zero code and codes per gram of the line that most readings agree with.
fn consensus(readings: &[Reading], options: &Options, range: f64) -> Option<(f64, f64)> {
    let nominal = options
        .nominal_n_per_code
        .map(|n| (1e-3 * options.gravity_m_per_s2 / n).abs());
    let mut best: Option<(f64, f64, f64)> = None;
    for (i, a) in readings.iter().enumerate() {
        for b in &readings[i + 1..] {
            if a.weight_g == b.weight_g {
                continue;
            }
            let slope = (a.code - b.code) / (a.weight_g - b.weight_g);
            // A known scale leaves no room for slips that would make most of the readings wrong.
            let plausible = nominal.is_none_or(|n| (0.5..=2.0).contains(&(slope.abs() / n)));
            if !plausible || slope == 0.0 {
                continue;
            }
            let zero = a.code - slope * a.weight_g;
            let cost: f64 = readings
                .iter()
                .map(|r| {
                    let residual = r.code - zero - slope * r.weight_g;
                    (residual / sd(r, r.weight_g, options, slope, range))
                        .powi(2)
                        .min(CUT)
                })
                .sum();
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, zero, slope));
            }
        }
    }
    let (_, zero, slope) = best?;
    // The pair's own noise is in the line: fit the readings that agree with it once more.
    let mut sums = [0.0; 5];
    for r in readings {
        let sd = sd(r, r.weight_g, options, slope, range);
        if ((r.code - zero - slope * r.weight_g) / sd).powi(2) < CUT {
            let w = sd.powi(-2);
            for (sum, term) in sums.iter_mut().zip([
                1.0,
                r.weight_g,
                r.weight_g * r.weight_g,
                r.code,
                r.weight_g * r.code,
            ]) {
                *sum += w * term;
            }
        }
    }
    let [s, sx, sxx, sy, sxy] = sums;
    let determinant = s * sxx - sx * sx;
    if determinant > 1e-9 * s * sxx {
        let refined = (s * sxy - sx * sy) / determinant;
        Some(((sy - refined * sx) / s, refined))
    } else {
        Some((zero, slope))
    }
}

/// `line`: zero code and codes per gram. `spread`: range of the codes, and their [`scatter`].
fn judge(
    reading: &Reading,
    options: &Options,
    line: (f64, f64),
    spread: (f64, f64),
) -> Option<WrongEntry> {
    let (zero, codes_per_g) = line;
    let (range, scatter) = spread;
    let entered = reading.weight_g;
    let log_likelihood = |weight: f64| {
        let sd = sd(reading, weight, options, codes_per_g, range).hypot(scatter);
        let z = (reading.code - zero - codes_per_g * weight) / sd;
        -0.5 * z * z - sd.ln() - 0.5 * (2.0 * std::f64::consts::PI).ln()
    };
    // Weights that may have been meant, with their prior probability; equal ones once.
    let mut meant: Vec<(f64, f64)> =
        vec![(entered * 10.0, SLIP / 2.0), (entered / 10.0, SLIP / 2.0)];
    meant.retain(|(w, _)| *w > 0.0);
    let set: Vec<f64> = options
        .weights_g
        .iter()
        .copied()
        .chain([0.0])
        .filter(|w| *w != entered)
        .collect();
    for &weight in &set {
        let prior = OTHER / set.len() as f64;
        match meant.iter_mut().find(|(w, _)| (*w - weight).abs() < 1e-9) {
            Some((_, p)) => *p += prior,
            None => meant.push((weight, prior)),
        }
    }
    let none = NO_WEIGHT.ln() - range.max(1.0).ln();
    let right = (1.0 - SLIP - OTHER - NO_WEIGHT).ln() + log_likelihood(entered);
    let scored: Vec<(f64, f64)> = meant
        .iter()
        .map(|&(w, prior)| (w, prior.ln() + log_likelihood(w)))
        .collect();
    let top = scored
        .iter()
        .map(|s| s.1)
        .chain([none, right])
        .fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = scored
        .iter()
        .map(|s| s.1)
        .chain([none, right])
        .map(|l| (l - top).exp())
        .sum();
    let probability = |l: f64| (l - top).exp() / total;
    if probability(right) >= 0.5 {
        return None;
    }
    let best = scored.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let (likely_g, log) = if best.1 > none {
        (Some(best.0), best.1)
    } else {
        (None, none)
    };
    Some(WrongEntry {
        at: reading.at.clone(),
        entered_g: entered,
        likely_g,
        probability: probability(log),
        measured_g: (reading.code - zero) / codes_per_g,
    })
}
