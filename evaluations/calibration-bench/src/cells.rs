//! Gains and zeros of made-up load cells, and what a power-up does to a zero.

use crate::scene::normal as gauss;
use crate::tally::Tally;
use crate::{GRAVITY_SD, WEIGHT_LIMIT};
use calibration::gain::{self, Direction, Gain, Reading, Term, Tolerance, WeightSet, WEIGHTS_G};
use calibration::input::Location;
use calibration::zero::{self, Limits};
use calibration::{gravity, STANDARD_GRAVITY_M_PER_S2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One load cell of a draw.
#[derive(Debug, Clone, Copy)]
struct Cell {
    n_per_code: f64,
    noise_sd_n: f64,
    zero_code: f64,
    /// Curve, 1/N.
    curve_per_n: f64,
}

/// Errors of gains and zeros.
#[derive(Debug, Clone, Default)]
pub struct CellFigures {
    /// Relative error of the gain; intervals are those for forces that the weights reach.
    pub gain: Tally,
    /// The same with the intervals for forces up to 12 N.
    pub gain_to_largest: Tally,
    /// Relative error of a force of 12 N on a cell whose curve is drawn from what the fit assumes
    /// of cells, with weights whose errors are normally distributed: six cells a draw.
    pub gain_beyond: Tally,
    /// Of the intervals of [`Self::gain_beyond`], those with a curve in the fit: held, of how many.
    pub curve_fitted: (usize, usize),
    /// As [`Self::gain_beyond`] with the weights of [`Self::gain`], any error within the limits
    /// equally likely.
    pub gain_beyond_rectangular: Tally,
    /// Error of the zero, N.
    pub zero: Tally,
    /// Series in which an entry was called wrong, though none was.
    pub false_names: usize,
    /// Zeros refused.
    pub zeros_refused: usize,
    /// Gain found and true gain, N per code, by draw and unit.
    pub gains: Vec<[Option<(Gain, f64)>; 6]>,
    /// Error and standard error of the zeros, N.
    pub zeros: Vec<[Option<(f64, f64)>; 6]>,
}

/// Gains (weights +-0.1 %, twice up and down, 1 s each) and zeros (10 s at 320 SPS with spikes and
/// drift) of six cells a draw. Noise 1.7 to 5 mN a sample as the idle channels of the rig,
/// correlated from one sample to the next.
pub fn cells(draws: u64) -> CellFigures {
    let mut out = CellFigures::default();
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0xCE11 + draw);
        out.gain.new_draw();
        out.gain_to_largest.new_draw();
        out.gain_beyond.new_draw();
        out.zero.new_draw();
        // One set of weights and one place for all units.
        let weights: Vec<f64> = WEIGHTS_G
            .iter()
            .map(|w| w * (1.0 + WEIGHT_LIMIT * rng.random_range(-1.0..1.0)))
            .collect();
        let gravity = STANDARD_GRAVITY_M_PER_S2 * (1.0 + GRAVITY_SD * gauss(&mut rng));
        let mut gains: [Option<(Gain, f64)>; 6] = std::array::from_fn(|_| None);
        let mut zeros = [None; 6];
        for (gain, zero_error) in gains.iter_mut().zip(&mut zeros) {
            let n_per_code = rng.random_range(6.2e-6..7.3e-6);
            let cell = Cell {
                n_per_code,
                noise_sd_n: rng.random_range(0.0017..0.005),
                // Converter's offset and the weight of motor and rack, up to 5 N either way.
                zero_code: rng.random_range(-5.0..5.0) / n_per_code,
                curve_per_n: 0.0,
            };
            match gain::fit(&series(&cell, &weights, gravity, &mut rng), &gain_options()) {
                Ok(found) => {
                    let error = found.n_per_code - cell.n_per_code;
                    out.gain.add(error.abs() / cell.n_per_code);
                    out.gain.interval(error.abs() < found.within_half_95);
                    out.gain_to_largest.add(error.abs() / cell.n_per_code);
                    (out.gain_to_largest).interval(error.abs() < found.n_per_code_half_95);
                    *gain = Some((found, cell.n_per_code));
                }
                Err(_) => {
                    out.false_names += 1;
                    out.gain.refused();
                }
            }
            let (codes, truth) = stream(&cell, &mut rng);
            let limits = Limits {
                nominal_n_per_code: 6.85e-6,
                ..Limits::default()
            };
            match zero::measure(&codes, &limits) {
                Ok(found) => {
                    let error = (found.at_end_codes - truth) * cell.n_per_code;
                    let se = found.at_end_se_codes * cell.n_per_code;
                    out.zero.add(error.abs());
                    out.zero.interval(error.abs() < 1.96 * se);
                    *zero_error = Some((error, se));
                }
                Err(_) => {
                    out.zeros_refused += 1;
                    out.zero.refused();
                }
            }
        }
        out.gain_beyond_rectangular.new_draw();
        for _ in 0..6 {
            // The same standard uncertainty.
            let normal: Vec<f64> = WEIGHTS_G
                .iter()
                .map(|w| w * (1.0 + WEIGHT_LIMIT / 3f64.sqrt() * gauss(&mut rng)))
                .collect();
            let (tally, fitted) = (&mut out.gain_beyond, &mut out.curve_fitted);
            curved(&normal, gravity, &mut rng, tally, fitted);
            let tally = &mut out.gain_beyond_rectangular;
            curved(&weights, gravity, &mut rng, tally, &mut (0, 0));
        }
        out.gains.push(gains);
        out.zeros.push(zeros);
    }
    out
}

/// A force of 12 N by a cell that is curved by as much as the fit assumes of cells.
fn curved(
    weights: &[f64],
    gravity: f64,
    rng: &mut ChaCha8Rng,
    out: &mut Tally,
    fitted: &mut (usize, usize),
) {
    let n_per_code = rng.random_range(6.2e-6..7.3e-6);
    let cell = Cell {
        n_per_code,
        noise_sd_n: rng.random_range(0.0017..0.005),
        zero_code: rng.random_range(-5.0..5.0) / n_per_code,
        curve_per_n: gain::CURVE_SD_PER_N * gauss(rng),
    };
    let largest = gain::LARGEST_FORCE_N;
    let code = largest * (1.0 + cell.curve_per_n * largest) / n_per_code;
    match gain::fit(&series(&cell, weights, gravity, rng), &gain_options()) {
        Ok(found) => {
            let error = (found.force_n(code) / largest - 1.0).abs();
            out.add(error);
            let holds = error < found.n_per_code_half_95 / found.n_per_code;
            out.interval(holds);
            if found.terms.contains_key(&Term::Quadratic) {
                fitted.0 += usize::from(holds);
                fitted.1 += 1;
            }
        }
        Err(_) => out.refused(),
    }
}

/// What the errors of a set of weights are in truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetErrors {
    /// Each weight has its own.
    Own,
    /// All have the same part of their limits.
    Common,
}

/// Gains with weights of class M2, gravity known, by what their errors are and with which
/// correlation the fit counts: relative errors and whether the 95 % intervals hold. One cell a
/// draw.
#[must_use]
pub fn sets(draws: u64, errors: SetErrors, correlation: f64) -> Tally {
    let mut out = Tally::default();
    let weights = WeightSet {
        correlation,
        ..WeightSet::default()
    };
    let options = gain::Options {
        gravity_relative_sd: 0.0,
        weights,
        ..gain::Options::default()
    };
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0x5E7_0000 + draw);
        out.new_draw();
        let common: f64 = rng.random_range(-1.0..1.0);
        let masses: Vec<f64> = WEIGHTS_G
            .iter()
            .map(|w| {
                let part = match errors {
                    SetErrors::Own => rng.random_range(-1.0..1.0),
                    SetErrors::Common => common,
                };
                w * (1.0 + part * 3f64.sqrt() * weights.relative_sd(*w))
            })
            .collect();
        let n_per_code = rng.random_range(6.2e-6..7.3e-6);
        let cell = Cell {
            n_per_code,
            noise_sd_n: rng.random_range(0.0017..0.005),
            zero_code: rng.random_range(-5.0..5.0) / n_per_code,
            curve_per_n: 0.0,
        };
        let in_air = STANDARD_GRAVITY_M_PER_S2 * (1.0 - gravity::AIR_BUOYANCY);
        match gain::fit(&series(&cell, &masses, in_air, &mut rng), &options) {
            Ok(found) => {
                let error = (found.n_per_code - n_per_code).abs();
                out.add(error / n_per_code);
                out.interval(error < found.within_half_95);
            }
            Err(_) => out.refused(),
        }
    }
    out
}

fn gain_options() -> gain::Options {
    gain::Options {
        gravity_relative_sd: GRAVITY_SD,
        air_buoyancy: 0.0,
        weights: WeightSet {
            tolerance: Tolerance::Relative(WEIGHT_LIMIT),
            correlation: 0.0,
        },
        ..gain::Options::default()
    }
}

fn series(cell: &Cell, weights: &[f64], gravity: f64, rng: &mut ChaCha8Rng) -> Vec<Reading> {
    let order = (0..7).map(|i| (i, Direction::Loading));
    let round: Vec<_> = order
        .chain((0..7).rev().map(|i| (i, Direction::Unloading)))
        .collect();
    let mut out = Vec::new();
    for _ in 0..2 {
        for &(i, direction) in &round {
            // Mean of 320 samples, each as correlated as `stream` makes them; putting a weight on
            // repeats to 1 mN.
            let se_n = cell.noise_sd_n * (1.3f64 / 0.7 / 320.0).sqrt();
            let force = 1e-3 * weights[i] * gravity + se_n * gauss(rng) + 0.001 * gauss(rng);
            out.push(Reading {
                at: Location {
                    file: "weights.csv".into(),
                    line: out.len() + 2,
                },
                weight_g: WEIGHTS_G[i],
                code: cell.zero_code + force * (1.0 + cell.curve_per_n * force) / cell.n_per_code,
                standard_error_codes: se_n / cell.n_per_code,
                direction: Some(direction),
                time_s: None,
                since_s: None,
                since_sd_s: None,
                temperature_c: None,
                series: None,
            });
        }
    }
    out
}

/// Codes and the true zero at their end.
fn stream(cell: &Cell, rng: &mut ChaCha8Rng) -> (Vec<i32>, f64) {
    let count = 3200;
    // Up to 1 mN over the stream.
    let drift = rng.random_range(-0.001..0.001) / cell.n_per_code;
    let sd = cell.noise_sd_n / cell.n_per_code;
    let mut noise = gauss(rng);
    let codes = (0..count)
        .map(|i| {
            noise = 0.3 * noise + (1.0 - 0.09f64).sqrt() * gauss(rng);
            let mut code =
                cell.zero_code + drift * f64::from(i) / f64::from(count - 1) + sd * noise;
            if rng.random_range(0.0..1.0) < 0.002 {
                code += rng.random_range(-3e5..3e5);
            }
            code.round() as i32
        })
        .collect();
    (codes, cell.zero_code + drift)
}

/// What power-ups do to the zeros of a rig: 12 of them for each of six units a draw.
#[derive(Debug, Clone, Copy, Default)]
pub struct PowerUpFigures {
    /// Zeros of slack cables that were compared with the ones before.
    pub slack: usize,
    /// Those of them that were refused.
    pub slack_refused: usize,
    /// Zeros of cables that pull with 0.7 to 1.0 N, what friction keeps in a cable after a run: how
    /// many were accepted, of how many, with fewer than [`LEARNT`] power-ups before.
    pub preloaded_early: (usize, usize),
    /// The same with at least so many before.
    pub preloaded: (usize, usize),
    /// Intervals of the part of the mounting angle that hold the truth, of how many.
    pub mounting: (usize, usize),
    /// The same of the converter's own offset.
    pub converter: (usize, usize),
}

/// What the pay-out test does: two readings of one power-up, the second with the cable paid out.
#[derive(Debug, Clone, Copy, Default)]
pub struct PayOutFigures {
    /// Slack cables that were refused, of how many.
    pub slack: (usize, usize),
    /// Cables that pull with 0.7 to 1.0 N that were accepted, of how many.
    pub preloaded: (usize, usize),
    /// The same of cables that pull with 0.03 to 0.1 N.
    pub faint: (usize, usize),
}

/// The pay-out test on the cells of [`cells`]: 3 s before, 10 s after. A cable stretches by 0.05 to
/// 0.2 mm/N, 3 mm or more are paid out, and a slack cell still creeps and drifts by up to 5 mN from
/// one reading to the next.
#[must_use]
pub fn pay_outs(draws: u64) -> PayOutFigures {
    let mut out = PayOutFigures::default();
    let limits = Limits {
        nominal_n_per_code: 6.85e-6,
        ..Limits::default()
    };
    for draw in 0..6 * draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0x9A70_0000 + draw);
        let n_per_code = rng.random_range(6.2e-6..7.3e-6);
        let cell = Cell {
            n_per_code,
            noise_sd_n: rng.random_range(0.0017..0.005),
            zero_code: rng.random_range(-5.0..5.0) / n_per_code,
            curve_per_n: 0.0,
        };
        let mm_per_n = rng.random_range(0.05..0.2);
        let drift_n = rng.random_range(-0.005..0.005);
        let mut slack_after = |pull_n: f64| -> Option<bool> {
            let left_n = (pull_n - 1e3 * zero::LEAST_TRAVEL_M / mm_per_n).max(0.0);
            let at = |force_n: f64| Cell {
                zero_code: cell.zero_code + force_n / n_per_code,
                ..cell
            };
            let before = stream(&at(pull_n), &mut rng).0;
            let after = stream(&at(left_n + drift_n), &mut rng).0;
            let before = zero::measure(&before[..960], &limits).ok()?;
            let after = zero::measure(&after, &limits).ok()?;
            Some(zero::pay_out(&before, &after, n_per_code).slack)
        };
        let count = |figure: &mut (usize, usize), slack: Option<bool>, wrong: bool| {
            if let Some(slack) = slack {
                figure.0 += usize::from(slack == wrong);
                figure.1 += 1;
            }
        };
        count(&mut out.slack, slack_after(0.0), false);
        let mut pull = ChaCha8Rng::seed_from_u64(0x9A71_0000 + draw);
        let (strong, faint) = (pull.random_range(0.7..1.0), pull.random_range(0.03..0.1));
        count(&mut out.preloaded, slack_after(strong), true);
        count(&mut out.faint, slack_after(faint), true);
    }
    out
}

/// Standard deviation of a unit's axis about each perpendicular as surveyed, rad.
const AXIS_SD_RAD: f64 = 0.003;
/// Standard deviation of the mass of motor and rack as weighed, kg; the mass itself is about 0.5
/// kg.
const MASS_SD_KG: f64 = 0.005;
/// A converter's own calibration misses the zero by up to this at a power-up, N (1 % of a 3 kg
/// cell's range).
pub const POWER_UP_MISS_N: f64 = 0.3;
/// Zeros further than this many standard deviations from the ones before are refused.
pub const POWER_UP_LIMIT_SD: f64 = 3.0;
/// Power-ups after which a unit's own spread is known.
pub const LEARNT: usize = 5;

/// Zeros over power-ups, of units mounted at any angle.
#[must_use]
pub fn power_ups(draws: u64) -> PowerUpFigures {
    use nalgebra::{Matrix3, Vector3};
    let mut out = PowerUpFigures::default();
    let gravity = Vector3::new(0.0, 0.0, -STANDARD_GRAVITY_M_PER_S2);
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0x9077E2 + draw);
        for _ in 0..6 {
            let axis = Vector3::from_fn(|_, _| gauss(&mut rng)).normalize();
            let across = axis.cross(&Vector3::from_fn(|_, _| gauss(&mut rng)));
            let across = across.normalize();
            let other = axis.cross(&across);
            let seen = axis
                + across * (AXIS_SD_RAD * gauss(&mut rng))
                + other * (AXIS_SD_RAD * gauss(&mut rng));
            let seen = seen.normalize();
            let mass = 0.5 + MASS_SD_KG * gauss(&mut rng);
            let n_per_code = rng.random_range(6.2e-6..7.3e-6);
            let true_mounting = mass * gravity.dot(&axis);
            let bridge_n = rng.random_range(-2.0..2.0);
            let mounting = zero::Mounting {
                mass_kg: 0.5,
                mass_sd_kg: MASS_SD_KG,
                gravity_m_per_s2: gravity,
                axis: seen,
                axis_covariance: (Matrix3::identity() - seen * seen.transpose())
                    * AXIS_SD_RAD.powi(2),
            };
            let mut history = zero::History::default();
            for _ in 0..12 {
                let offset = bridge_n + POWER_UP_MISS_N * rng.random_range(-1.0..1.0);
                let se_n = 3e-4;
                let zero_n = true_mounting + offset + se_n * gauss(&mut rng);
                let measured = zero::Zero {
                    at_end_codes: zero_n / n_per_code,
                    at_end_se_codes: se_n / n_per_code,
                    mean_codes: zero_n / n_per_code,
                    mean_se_codes: se_n / n_per_code,
                    drift_codes: 0.0,
                    drift_se_codes: 0.0,
                    noise_sd_codes: 500.0,
                    correlation_samples: 1.0,
                    used: 3200,
                    spikes: 0,
                };
                let parts = zero::split(&measured, (n_per_code, 3e-4 * n_per_code), &mounting);
                let holds = |error: f64, sd: f64| usize::from(error.abs() < 1.96 * sd);
                out.mounting.0 += holds(parts.mounting_n - true_mounting, parts.mounting_sd_n);
                out.mounting.1 += 1;
                out.converter.0 += holds(parts.converter_n - offset, parts.converter_sd_n);
                out.converter.1 += 1;
                let entry = |zero_n| zero::PowerUp {
                    zero_n,
                    se_n,
                    mounting_n: parts.mounting_n,
                };
                if !history.entries().is_empty() {
                    out.slack += 1;
                    let verdict = history.judge(&entry(zero_n), POWER_UP_MISS_N, POWER_UP_LIMIT_SD);
                    out.slack_refused += usize::from(!verdict.is_accepted());
                    let pulled = zero_n + rng.random_range(0.7..1.0);
                    let verdict = history.judge(&entry(pulled), POWER_UP_MISS_N, POWER_UP_LIMIT_SD);
                    let count = if history.entries().len() < LEARNT {
                        &mut out.preloaded_early
                    } else {
                        &mut out.preloaded
                    };
                    count.0 += usize::from(verdict.is_accepted());
                    count.1 += 1;
                }
                history.push(entry(zero_n));
            }
        }
    }
    out
}
