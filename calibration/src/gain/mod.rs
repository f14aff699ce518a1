//! Gain of a load cell: newtons per converter code, from weights (thesis 3.5.1).
//!
//! [`read`] takes a table of readings, [`fit`] gives the scale with its interval. A reading that does not belong to the
//! weight it is entered with is named ([`GainError::WrongEntries`]) and never averaged in: see [`entries`].
//! How straight the cell is, its hysteresis and its creep: [`figures`].
//!
//! # Model
//!
//! ```text
//! code = zero + b (F + s) + [k (F + s)^2] + [z_T dT] + [b_T dT F] + [z_t t] + error,   F = m g
//! ```
//!
//! `s` is the creep, where the series can tell it: see [`creep`]. What a conversion needs, the force over the code:
//! [`conversion`].
//!
//! Terms in brackets are taken in one after the other while one of them is significant (two-sided t test, 1 %
//! shared out over the candidates). The error of a reading has three parts: its standard error, a repeatability that
//! all readings share and that the readings themselves give (Paule and Mandel, *J. Res. NBS* 87 (1982) 377), and the
//! error of the weight, which is the same each time this weight is put on. The last part makes the errors of
//! readings with one weight correlated; generalised least squares allows for it. The error of g is common to
//! everything and is added at the end.

pub mod conversion;
pub mod creep;
pub mod entries;
pub mod figures;

use crate::input::{InputError, Location, Table};
use crate::{stats, STANDARD_GRAVITY_M_PER_S2};
use creep::CreepTerm;
use entries::WrongEntry;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// The weights of the thesis, g.
pub const WEIGHTS_G: [f64; 7] = [10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];

/// Whether a weight was put on or taken off to come to this load.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// The load went up.
    Loading,
    /// The load went down.
    Unloading,
}

/// One reading: the mean code under one weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Where it was entered.
    pub at: Location,
    /// Weight as entered, g; 0 for the empty cell.
    pub weight_g: f64,
    /// Mean code.
    pub code: f64,
    /// Standard error of the mean code, autocorrelation included; see [`crate::zero::measure`].
    pub standard_error_codes: f64,
    /// Which way the load was reached, where known.
    pub direction: Option<Direction>,
    /// Middle of the reading, s from some start, where known.
    pub time_s: Option<f64>,
    /// When the load came on, s from the same start, where known.
    pub since_s: Option<f64>,
    /// Temperature of the cell, degrees Celsius, where a sensor gives it.
    pub temperature_c: Option<f64>,
}

/// Columns that a table of readings may have.
const COLUMNS: [&str; 7] = [
    "weight_g",
    "code",
    "standard_error",
    "direction",
    "time_s",
    "since_s",
    "temperature_c",
];

/// Reads a table with the columns `weight_g`, `code`, `standard_error` (codes) and, where known, `direction`
/// (`loading` or `unloading`), `time_s`,
/// `since_s`, `temperature_c`. `file` is the name that errors give.
///
/// # Errors
/// [`InputError`] with the line of the first cell that can't be used: weights from 0 to 3,000 g, codes of 24 bits,
/// standard errors above 0.
pub fn read(file: &str, text: &str) -> Result<Vec<Reading>, InputError> {
    let table = Table::parse(file, text)?;
    table.check_columns(&COLUMNS)?;
    let weight = table.column("weight_g")?;
    let code = table.column("code")?;
    let error = table.column("standard_error")?;
    let direction = table.find("direction");
    let time = table.find("time_s");
    let since = table.find("since_s");
    let temperature = table.find("temperature_c");
    table
        .rows()
        .iter()
        .map(|row| {
            let weight_g = table.number(row, weight)?;
            if !(0.0..=3000.0).contains(&weight_g) {
                return Err(table.bad_value(row, weight, "a weight is 0 to 3000 g"));
            }
            let mean = table.number(row, code)?;
            if mean.abs() > f64::from(1 << 23) {
                return Err(table.bad_value(row, code, "a code has 24 bits: -8388608 to 8388607"));
            }
            let standard_error_codes = table.number(row, error)?;
            if standard_error_codes <= 0.0 {
                return Err(table.bad_value(row, error, "a standard error is above 0"));
            }
            let direction = match direction.map(|c| (c, table.text(row, c).to_lowercase())) {
                None => None,
                Some((_, text)) if text.is_empty() => None,
                Some((_, text)) if text == "loading" => Some(Direction::Loading),
                Some((_, text)) if text == "unloading" => Some(Direction::Unloading),
                Some((c, _)) => {
                    return Err(table.bad_value(row, c, "a direction is `loading` or `unloading`"))
                }
            };
            Ok(Reading {
                at: row.at.clone(),
                weight_g,
                code: mean,
                standard_error_codes,
                direction,
                time_s: table.optional_number(row, time)?,
                since_s: table.optional_number(row, since)?,
                temperature_c: table.optional_number(row, temperature)?,
            })
        })
        .collect()
}

/// What [`fit`] has to know besides the readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Local acceleration of gravity, m/s^2.
    pub gravity_m_per_s2: f64,
    /// Relative standard uncertainty of it. 0.001 covers a laboratory that has not looked its value up (9.78 to 9.83
    /// from equator to pole); with the local value 2e-5 is easy.
    pub gravity_relative_sd: f64,
    /// Limit of the weights' relative error: +-0.001 for +-0.1 %, equally likely within (standard uncertainty
    /// limit / sqrt 3, GUM 4.3.7). Errors of different weights are independent.
    pub weight_limit_relative: f64,
    /// Weights that may have been meant, g: see [`entries`].
    pub weights_g: Vec<f64>,
    /// Nominal scale, N per code; a scale further than a factor of two from it is refused. `None` accepts any.
    pub nominal_n_per_code: Option<f64>,
    /// Lines to leave out, because the user said so.
    pub left_out: Vec<usize>,
    /// Lines whose weight the user has corrected, with the right weight in g.
    pub corrections_g: BTreeMap<usize, f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            gravity_m_per_s2: STANDARD_GRAVITY_M_PER_S2,
            gravity_relative_sd: 0.001,
            weight_limit_relative: 0.001,
            weights_g: WEIGHTS_G.to_vec(),
            nominal_n_per_code: Some(6.85e-6),
            left_out: Vec::new(),
            corrections_g: BTreeMap::new(),
        }
    }
}

/// A term of the model beside zero and slope.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Term {
    /// Curvature, codes per N^2.
    Quadratic,
    /// Zero over temperature, codes per K.
    ZeroTemperature,
    /// Slope over temperature, codes per N and K.
    SlopeTemperature,
    /// Drift of the zero, codes per s.
    ZeroTime,
    /// Creep, codes per N of crept load.
    Creep,
}

/// The terms of a fit beside zero and slope, and what they depend on that is not linear.
#[derive(Debug, Clone, Default)]
struct Model {
    terms: Vec<Term>,
    /// Time constant of the creep, s.
    tau_s: f64,
    /// Whether the fit has a column for an error of that, so that the covariances allow for it.
    tau_free: bool,
    /// Share of the creep, as far as it is known: the curve bends what has crept as well.
    share: f64,
}

impl Model {
    fn has(&self, term: Term) -> bool {
        self.terms.contains(&term)
    }

    /// Coefficients of the fit.
    fn columns(&self) -> usize {
        2 + self.terms.len() + usize::from(self.tau_free)
    }
}

/// A coefficient with its standard error and the p-value of its being zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficient {
    /// Value, in the unit of its [`Term`].
    pub value: f64,
    /// Standard error.
    pub standard_error: f64,
    /// Two-sided p-value.
    pub p: f64,
}

/// A fitted cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Gain {
    /// Scale, N per code: the inverse of the slope at no load.
    pub n_per_code: f64,
    /// Standard uncertainty of the scale, everything included, N per code.
    pub n_per_code_sd: f64,
    /// Half width of the 95 % interval of the scale, N per code.
    pub n_per_code_half_95: f64,
    /// Relative standard uncertainties of the scale: from the readings, from the weights, from gravity.
    pub relative_parts: UncertaintyParts,
    /// Code of the empty cell, at mean temperature and the time of the first reading.
    pub zero_code: f64,
    /// Standard error of [`Self::zero_code`].
    pub zero_code_se: f64,
    /// Slope, codes per N.
    pub codes_per_n: f64,
    /// Terms taken in beside zero and slope.
    pub terms: BTreeMap<Term, Coefficient>,
    /// Creep, where the readings tell it and it is significant.
    pub creep: Option<CreepTerm>,
    /// Repeatability beyond the readings' own standard errors, codes (standard deviation).
    pub repeatability_codes: f64,
    /// Chi-square of the residuals with the readings' own standard errors and the weights' errors only.
    pub chi_square: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Temperature at which the coefficients hold, degrees Celsius.
    pub reference_c: Option<f64>,
    /// Residual of each reading used, in the order given.
    pub residuals: Vec<Residual>,
    /// Largest load used, N.
    pub largest_n: f64,
}

/// Relative standard uncertainties that make up that of a scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncertaintyParts {
    /// Noise and repeatability of the readings.
    pub readings: f64,
    /// Tolerance of the weights.
    pub weights: f64,
    /// Local gravity.
    pub gravity: f64,
}

/// What the model leaves of one reading.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Where the reading was entered.
    pub at: Location,
    /// Load, N.
    pub force_n: f64,
    /// Direction, where known.
    pub direction: Option<Direction>,
    /// Measured less fitted, N.
    pub residual_n: f64,
    /// Standard deviation expected of it (without the fit's own), N.
    pub sd_n: f64,
}

/// Why readings give no gain.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GainError {
    /// Too few readings or different weights.
    #[error("{readings} usable readings with {weights} different weights give no gain; at least 3 readings with 3 weights (0 g counts) are needed")]
    TooFew {
        /// Readings used.
        readings: usize,
        /// Different weights.
        weights: usize,
    },
    /// A number that can't be used.
    #[error("{at}: {what} is {value}; {advice}")]
    BadReading {
        /// Where the reading was entered.
        at: Location,
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        advice: &'static str,
    },
    /// An option that can't be used.
    #[error("{name} is {value}; {advice}")]
    BadOption {
        /// The field of [`Options`].
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        advice: &'static str,
    },
    /// A line to leave out or to correct that no reading has.
    #[error("no reading stands in line {line}, which is to be left out or corrected")]
    NoSuchLine {
        /// The line.
        line: usize,
    },
    /// Readings that don't belong to the weight they are entered with.
    #[error("{}", entries::describe(.0))]
    WrongEntries(Vec<WrongEntry>),
    /// A scale that no cell of this kind has.
    #[error("the scale would be {n_per_code:.3e} N per code, more than a factor of two from the nominal {nominal:.3e}; are the weights in gram, is the gain of the converter right?")]
    ImplausibleScale {
        /// The scale found, N per code.
        n_per_code: f64,
        /// The nominal one, N per code.
        nominal: f64,
    },
    /// The code does not follow the load.
    #[error("the code does not depend on the load (slope {codes_per_n:.1} codes per N, standard error {se:.1}); check the bridge's wiring and that the weights hang on the cell")]
    NoSlope {
        /// The slope, codes per N.
        codes_per_n: f64,
        /// Its standard error, codes per N.
        se: f64,
    },
}

/// Level at which a further term is taken in, shared out over the candidates.
const TERM_LEVEL: f64 = 0.01;

/// Scale of a cell from readings under weights, in any order, with repeats.
///
/// # Errors
/// [`GainError`]; in particular [`GainError::WrongEntries`] with each reading that belongs to another weight or to none.
/// Put its line into [`Options::corrections_g`] or [`Options::left_out`] and fit again.
pub fn fit(readings: &[Reading], options: &Options) -> Result<Gain, GainError> {
    let used = usable(readings, options)?;
    let wrong = entries::find(&used, options);
    if !wrong.is_empty() && !only_shaped(&used, options) {
        return Err(GainError::WrongEntries(wrong));
    }
    let candidates = candidates(&used);
    let mut model = Model::default();
    let mut best = solve(&used, options, &model)?;
    loop {
        let mut chosen: Option<(f64, Model, Solution)> = None;
        for &term in candidates.iter().filter(|t| !model.has(**t)) {
            let Some((more, solution)) = with(term, &used, options, &model, &best) else {
                continue;
            };
            let searched = if term == Term::Creep {
                creep::SEARCHED
            } else {
                1.0
            };
            let p = searched * solution.coefficient(1 + more.terms.len()).p;
            let better = chosen.as_ref().is_none_or(|(least, ..)| p < *least);
            if p < TERM_LEVEL / candidates.len() as f64 && better {
                chosen = Some((p, more, solution));
            }
        }
        match chosen {
            Some((_, more, solution)) => (model, best) = (more, solution),
            None => break,
        }
    }
    if model.has(Term::Creep) {
        // Every interval allows for the time constant, which was searched.
        let free = Model {
            tau_free: true,
            ..model.clone()
        };
        if let Ok(solution) = solve(&used, options, &free) {
            (model, best) = (free, solution);
        }
    }
    finish(&used, options, &model, &best)
}

/// The model with one term more, fitted. `before`: the fit without it.
fn with(
    term: Term,
    used: &[Reading],
    options: &Options,
    model: &Model,
    before: &Solution,
) -> Option<(Model, Solution)> {
    let mut more = model.clone();
    more.terms.push(term);
    if !more.has(Term::Creep) {
        let solution = solve(used, options, &more).ok()?;
        return Some((more, solution));
    }
    // Time constant and share depend on each other through the curve.
    let mut repeatability = before.repeatability;
    let mut slope = before.beta[1];
    let mut found = None;
    for _ in 0..3 {
        let covariance =
            own_variance(used, repeatability) + weight_covariance(used, options, slope);
        let inverse = covariance.cholesky()?.inverse();
        more.tau_s = creep::search(used, options, &more, &inverse)?;
        more.share = creep::share(used, options, &more, &inverse)?;
        let solution = solve(used, options, &more).ok()?;
        (repeatability, slope) = (solution.repeatability, solution.beta[1]);
        found = Some(solution);
    }
    found.map(|solution| (more, solution))
}

/// Largest part of the range that a curve may take before the readings count as wrong rather than the cell as curved; with
/// this many different weights, which show a curve as such, and with fewer.
const LARGEST_CURVE: (usize, f64, f64) = (6, 0.25, 0.05);
/// Largest part of the range that creep may take.
const LARGEST_CREEP: f64 = 0.25;

/// Whether readings that leave the line leave it because the cell is curved or creeps: with that taken off, none is wrong.
/// A wrong entry can't pass for a curve: it bends the curve away from all others.
fn only_shaped(used: &[Reading], options: &Options) -> bool {
    let Ok(mut best) = solve(used, options, &Model::default()) else {
        return false;
    };
    let (enough, large, small) = LARGEST_CURVE;
    let weights = different_weights(used);
    let shapes = [
        (weights >= 4).then_some(Term::Quadratic),
        creep::can_tell(used).then_some(Term::Creep),
    ];
    // The curve alone, creep alone, both.
    for chosen in [&shapes[..1], &shapes[1..], &shapes[..]] {
        let mut model = Model::default();
        let mut fits = false;
        for &term in chosen.iter().flatten() {
            let Some((more, solution)) = with(term, used, options, &model, &best) else {
                fits = false;
                break;
            };
            (model, best, fits) = (more, solution, true);
        }
        if !fits {
            continue;
        }
        let x = design(used, options, &model);
        let part = |term: Term, row: usize| {
            let at = model.terms.iter().position(|t| *t == term);
            at.map_or(0.0, |at| best.beta[2 + at] * x[(row, 2 + at)])
        };
        let range = (0..used.len())
            .map(|row| (best.beta[1] * x[(row, 1)]).abs())
            .fold(0.0, f64::max);
        let most = |term: Term| {
            let parts = (0..used.len()).map(|row| part(term, row).abs());
            parts.fold(0.0, f64::max) / range
        };
        let curve = if weights >= enough { large } else { small };
        let straight: Vec<Reading> = used
            .iter()
            .enumerate()
            .map(|(row, r)| Reading {
                code: r.code - part(Term::Quadratic, row) - part(Term::Creep, row),
                ..r.clone()
            })
            .collect();
        if most(Term::Quadratic) <= curve
            && most(Term::Creep) <= LARGEST_CREEP
            && entries::find(&straight, options).is_empty()
        {
            return true;
        }
    }
    false
}

/// The readings with corrections made and lines left out, or what can't be used.
fn usable(readings: &[Reading], options: &Options) -> Result<Vec<Reading>, GainError> {
    let bad = |name, value, advice| GainError::BadOption {
        name,
        value,
        advice,
    };
    let g = options.gravity_m_per_s2;
    if !(9.7..=9.9).contains(&g) {
        return Err(bad("gravity_m_per_s2", g, "on Earth it is 9.76 to 9.84"));
    }
    for (name, value) in [
        ("gravity_relative_sd", options.gravity_relative_sd),
        ("weight_limit_relative", options.weight_limit_relative),
    ] {
        if !(0.0..0.1).contains(&value) {
            return Err(bad(
                name,
                value,
                "it is relative, 0 to 0.1 (0.1 % is 0.001)",
            ));
        }
    }
    for &line in options.left_out.iter().chain(options.corrections_g.keys()) {
        if !readings.iter().any(|r| r.at.line == line) {
            return Err(GainError::NoSuchLine { line });
        }
    }
    let mut used = Vec::new();
    for reading in readings {
        if options.left_out.contains(&reading.at.line) {
            continue;
        }
        let mut reading = reading.clone();
        if let Some(&weight) = options.corrections_g.get(&reading.at.line) {
            reading.weight_g = weight;
        }
        let check = |what, value: f64, ok: bool, advice| {
            if ok && value.is_finite() {
                Ok(())
            } else {
                Err(GainError::BadReading {
                    at: reading.at.clone(),
                    what,
                    value,
                    advice,
                })
            }
        };
        check(
            "the weight",
            reading.weight_g,
            reading.weight_g >= 0.0,
            "it has to be finite and not negative",
        )?;
        check("the code", reading.code, true, "it has to be finite")?;
        check(
            "the standard error",
            reading.standard_error_codes,
            reading.standard_error_codes > 0.0,
            "it has to be finite and above 0",
        )?;
        for (what, value) in [
            ("the time", reading.time_s),
            ("the time of the load", reading.since_s),
            ("the temperature", reading.temperature_c),
        ] {
            check(what, value.unwrap_or(0.0), true, "it has to be finite")?;
        }
        used.push(reading);
    }
    let weights = different_weights(&used);
    if used.len() < 3 || weights < 3 {
        return Err(GainError::TooFew {
            readings: used.len(),
            weights,
        });
    }
    Ok(used)
}

fn different_weights(readings: &[Reading]) -> usize {
    let mut weights: Vec<f64> = readings.iter().map(|r| r.weight_g).collect();
    weights.sort_by(f64::total_cmp);
    weights.dedup();
    weights.len()
}

/// Further terms that these readings can tell.
fn candidates(used: &[Reading]) -> Vec<Term> {
    let mut terms = Vec::new();
    if different_weights(used) >= 4 {
        terms.push(Term::Quadratic);
    }
    let range = |of: fn(&Reading) -> Option<f64>| -> f64 {
        let values: Option<Vec<f64>> = used.iter().map(of).collect();
        values.map_or(0.0, |v| {
            v.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b))
                - v.iter().fold(f64::INFINITY, |a, b| a.min(*b))
        })
    };
    // Below 2 K the sensor's own error is as large as what is looked for.
    if used.len() >= 8 && range(|r| r.temperature_c) >= 2.0 {
        terms.push(Term::ZeroTemperature);
        terms.push(Term::SlopeTemperature);
    }
    if used.len() >= 8 && range(|r| r.time_s) > 0.0 {
        terms.push(Term::ZeroTime);
    }
    if creep::can_tell(used) {
        terms.push(Term::Creep);
    }
    terms
}

/// One generalised least-squares fit. Columns: zero, slope, then the terms.
struct Solution {
    beta: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Part of `covariance` that comes from the readings, not from the weights.
    from_readings: DMatrix<f64>,
    residuals: DVector<f64>,
    repeatability: f64,
    chi_square: f64,
    dof: usize,
}

impl Solution {
    /// Degrees of freedom of coefficient `i`: infinite as far as it comes from the weights, whose tolerance is given
    /// (Welch and Satterthwaite, GUM G.4).
    fn effective_dof(&self, i: usize) -> f64 {
        let (all, own) = (self.covariance[(i, i)], self.from_readings[(i, i)]);
        self.dof as f64 * (all / own).powi(2)
    }

    fn coefficient(&self, i: usize) -> Coefficient {
        let standard_error = self.covariance[(i, i)].sqrt();
        Coefficient {
            value: self.beta[i],
            standard_error,
            p: stats::student_two_sided(self.beta[i] / standard_error, self.effective_dof(i)),
        }
    }
}

fn force_n(weight_g: f64, options: &Options) -> f64 {
    1e-3 * weight_g * options.gravity_m_per_s2
}

fn mean_temperature(used: &[Reading]) -> Option<f64> {
    let values: Option<Vec<f64>> = used.iter().map(|r| r.temperature_c).collect();
    values.map(|v| v.iter().sum::<f64>() / v.len() as f64)
}

fn design(used: &[Reading], options: &Options, model: &Model) -> DMatrix<f64> {
    let reference = mean_temperature(used).unwrap_or(0.0);
    let start = used.first().and_then(|r| r.time_s).unwrap_or(0.0);
    let crept = if model.has(Term::Creep) {
        creep::course(used, options, model.tau_s)
    } else {
        vec![0.0; used.len()]
    };
    let by_log_tau = if model.tau_free {
        creep::course_by_log_tau(used, options, model.tau_s)
    } else {
        Vec::new()
    };
    DMatrix::from_fn(used.len(), model.columns(), |row, column| {
        if column == 2 + model.terms.len() {
            return by_log_tau[row];
        }
        let r = &used[row];
        let force = force_n(r.weight_g, options);
        let warmer = r.temperature_c.map_or(0.0, |t| t - reference);
        match column {
            0 => 1.0,
            1 => force,
            _ => match model.terms[column - 2] {
                Term::Quadratic => (force + model.share * crept[row]).powi(2),
                Term::ZeroTemperature => warmer,
                Term::SlopeTemperature => warmer * force,
                Term::ZeroTime => r.time_s.unwrap_or(start) - start,
                Term::Creep => crept[row],
            },
        }
    })
}

fn solve(used: &[Reading], options: &Options, model: &Model) -> Result<Solution, GainError> {
    let n = used.len();
    let x = design(used, options, model);
    let too_few = || GainError::TooFew {
        readings: n,
        weights: different_weights(used),
    };
    if n <= x.ncols() {
        return Err(too_few());
    }
    let y = DVector::from_iterator(n, used.iter().map(|r| r.code));
    // The weights' errors in codes need the slope; a slope without them is right to far better than needed.
    let mut slope = {
        let weights =
            DVector::from_iterator(n, used.iter().map(|r| r.standard_error_codes.powi(-2)));
        let xtw = x.transpose() * DMatrix::from_diagonal(&weights);
        let beta = (&xtw * &x)
            .cholesky()
            .ok_or_else(too_few)?
            .solve(&(&xtw * &y));
        beta[1]
    };
    let dof = n - x.ncols();
    let mut last = None;
    for _ in 0..2 {
        let from_weights = weight_covariance(used, options, slope);
        let at = |repeatability: f64| gls(used, &x, &y, &from_weights, repeatability);
        let own = at(0.0).ok_or_else(too_few)?;
        let chi_square = own.chi_square;
        let mut solution = own;
        if chi_square > dof as f64 {
            // Paule and Mandel: the repeatability at which chi-square is what it should be.
            let (mut low, mut high) = (0.0, 1.0);
            while at(high).is_some_and(|s| s.chi_square > dof as f64) && high < 1e9 {
                high *= 4.0;
            }
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                if at(middle).is_some_and(|s| s.chi_square > dof as f64) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            solution = at(high).ok_or_else(too_few)?;
        }
        solution.chi_square = chi_square;
        slope = solution.beta[1];
        last = Some(solution);
    }
    last.ok_or_else(too_few)
}

/// Covariance of the codes from the errors of the weights, codes^2.
fn weight_covariance(used: &[Reading], options: &Options, codes_per_n: f64) -> DMatrix<f64> {
    let relative = options.weight_limit_relative / 3f64.sqrt();
    DMatrix::from_fn(used.len(), used.len(), |i, j| {
        if used[i].weight_g == used[j].weight_g {
            (relative * codes_per_n * force_n(used[i].weight_g, options)).powi(2)
        } else {
            0.0
        }
    })
}

/// Covariance of the codes from the readings' own errors, codes^2.
fn own_variance(used: &[Reading], repeatability: f64) -> DMatrix<f64> {
    let variances = used
        .iter()
        .map(|r| r.standard_error_codes.powi(2) + repeatability * repeatability);
    DMatrix::from_diagonal(&DVector::from_iterator(used.len(), variances))
}

fn gls(
    used: &[Reading],
    x: &DMatrix<f64>,
    y: &DVector<f64>,
    from_weights: &DMatrix<f64>,
    repeatability: f64,
) -> Option<Solution> {
    let n = used.len();
    let own = own_variance(used, repeatability);
    let inverse = (&own + from_weights).cholesky()?.inverse();
    let xtw = x.transpose() * &inverse;
    let covariance = (&xtw * x).cholesky()?.inverse();
    let estimator = &covariance * &xtw;
    let beta = &estimator * y;
    let residuals = y - x * &beta;
    let chi_square = (residuals.transpose() * &inverse * &residuals)[0];
    Some(Solution {
        beta,
        from_readings: &estimator * own * estimator.transpose(),
        covariance,
        residuals,
        repeatability,
        chi_square,
        dof: n - x.ncols(),
    })
}

fn finish(
    used: &[Reading],
    options: &Options,
    model: &Model,
    solution: &Solution,
) -> Result<Gain, GainError> {
    let slope = solution.beta[1];
    let slope_sd = solution.covariance[(1, 1)].sqrt();
    let depends = slope.abs() > 5.0 * slope_sd;
    if !depends {
        return Err(GainError::NoSlope {
            codes_per_n: slope,
            se: slope_sd,
        });
    }
    let n_per_code = 1.0 / slope;
    if let Some(nominal) = options.nominal_n_per_code {
        let ratio = n_per_code.abs() / nominal;
        if !(0.5..=2.0).contains(&ratio) {
            return Err(GainError::ImplausibleScale {
                n_per_code,
                nominal,
            });
        }
    }
    let own = solution.from_readings[(1, 1)];
    let parts = UncertaintyParts {
        readings: own.sqrt() / slope.abs(),
        weights: (solution.covariance[(1, 1)] - own).max(0.0).sqrt() / slope.abs(),
        gravity: options.gravity_relative_sd,
    };
    let relative = (parts.readings.powi(2) + parts.weights.powi(2) + parts.gravity.powi(2)).sqrt();
    let dof = solution.dof as f64 * (relative / parts.readings).powi(4);
    let coverage = stats::student_quantile(0.975, dof);
    let sd_of = |r: &Reading| {
        let weight =
            options.weight_limit_relative / 3f64.sqrt() * force_n(r.weight_g, options) * slope;
        (r.standard_error_codes.powi(2) + solution.repeatability.powi(2) + weight * weight).sqrt()
    };
    Ok(Gain {
        n_per_code,
        n_per_code_sd: relative * n_per_code.abs(),
        n_per_code_half_95: coverage * relative * n_per_code.abs(),
        relative_parts: parts,
        zero_code: solution.beta[0],
        zero_code_se: solution.covariance[(0, 0)].sqrt(),
        codes_per_n: slope,
        creep: model.terms.iter().position(|t| *t == Term::Creep).map(|i| {
            let found = solution.coefficient(2 + i);
            let by_log_tau = if model.tau_free {
                solution.covariance[(2 + model.terms.len(), 2 + model.terms.len())].sqrt()
            } else {
                f64::INFINITY
            };
            // A factor of a thousand says that nothing is known.
            let spread = (1.96 * by_log_tau / found.value).abs().exp().min(1e3);
            CreepTerm {
                share: found.value / slope,
                // The weight that stays has an error of its own.
                share_se: (found.standard_error / slope)
                    .hypot(found.value / slope * options.weight_limit_relative / 3f64.sqrt()),
                time_s: model.tau_s,
                time_95_s: (model.tau_s / spread, model.tau_s * spread),
            }
        }),
        terms: model
            .terms
            .iter()
            .enumerate()
            .map(|(i, &term)| (term, solution.coefficient(2 + i)))
            .collect(),
        repeatability_codes: solution.repeatability,
        chi_square: solution.chi_square,
        degrees_of_freedom: solution.dof,
        reference_c: mean_temperature(used),
        residuals: used
            .iter()
            .zip(solution.residuals.iter())
            .map(|(r, residual)| Residual {
                at: r.at.clone(),
                force_n: force_n(r.weight_g, options),
                direction: r.direction,
                residual_n: residual / slope,
                sd_n: (sd_of(r) / slope).abs(),
            })
            .collect(),
        largest_n: used
            .iter()
            .map(|r| force_n(r.weight_g, options))
            .fold(0.0, f64::max),
    })
}

impl Gain {
    /// Force of a code above the zero, N, with the quadratic term where there is one, at the reference temperature.
    /// NaN where the curve does not reach the code.
    #[must_use]
    pub fn force_n(&self, code_above_zero: f64) -> f64 {
        let b = self.codes_per_n;
        match self.terms.get(&Term::Quadratic) {
            None => code_above_zero / b,
            // The root that goes to code / b as the curvature goes to 0.
            Some(k) => {
                let root = (b * b + 4.0 * k.value * code_above_zero).sqrt() * b.signum();
                2.0 * code_above_zero / (b + root)
            }
        }
    }
}

#[cfg(test)]
mod tests;
