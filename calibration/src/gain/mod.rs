//! Gain of a load cell: newtons per converter code, from weights (thesis 3.5.1).
//!
//! [`read`] takes a table of readings, [`fit`] gives the scale with its interval. A reading that
//! does not belong to the weight it is entered with is named ([`GainError::WrongEntries`]) and
//! never averaged in: see [`entries`]. So is one mistake behind many readings
//! ([`GainError::Mistake`]): see [`causes`]. How straight the cell is, its hysteresis and its
//! creep: [`figures`].
//!
//! # Model
//!
//! ```text
//! code = zero + b (F + s) + [k (F + s)^2] + [z_T dT] + [b_T dT F] + [z_t t] + error,   F = m g
//! ```
//!
//! `s` is the creep, where the series can tell it: see [`creep`]. What a conversion needs, the
//! force over the code: [`conversion`].
//!
//! Terms in brackets are taken in one after the other while one of them is significant (two-sided t
//! test, 1 % shared out over the candidates). The error of a reading has three parts: its standard
//! error, a repeatability that all readings share and that the readings themselves give (Paule and
//! Mandel, *J. Res. NBS* 87 (1982) 377), and the error of the weight, which is the same each time
//! this weight is put on. The last part makes the errors of readings with one weight correlated;
//! generalised least squares allows for it, with the errors of different weights taken as
//! independent. What the weights of a set share moves the scale and not the shape: it enters the
//! uncertainty of the scale ([`WeightSet::correlation`]). Where a cell creeps, the time at which a
//! load came on has an error too ([`creep`]): it is the same in all readings after it. The error of
//! g is common to everything and is added at the end.
//!
//! Where the cell was mounted anew between series ([`iso376`]), each mounting has a zero and a
//! slope of its own. The slope of the cell is their mean, and their scatter enters its uncertainty:
//! the next mounting will be another.

pub mod causes;
pub mod conversion;
pub mod creep;
mod creep_search;
pub mod entries;
mod error;
pub mod figures;
pub mod iso376;
mod least_squares;
mod reading;
pub mod weight_set;

pub use error::{GainError, LooksLike};
pub use reading::{read, Direction, Reading, CREEP, PRELOAD};
pub use weight_set::{Class, Tolerance, WeightSet};

use crate::input::Location;
use crate::{gravity, stats};
use causes::Rests;
use creep::CreepTerm;
use least_squares::{
    design, mean_temperature, own_covariance, solve, weight_covariance, Model, Solution,
};
use nalgebra::{DMatrix, DVector};
use reading::{different_weights, usable};
use std::collections::BTreeMap;

/// The weights of the thesis, g.
pub const WEIGHTS_G: [f64; 7] = [10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];

/// What [`fit`] has to know besides the readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Local acceleration of gravity, m/s^2.
    pub gravity_m_per_s2: f64,
    /// Relative standard uncertainty of it: [`gravity::UNKNOWN_PLACE_SD`] where nobody has said
    /// where the rig stands; with the local value 2e-5 is easy.
    pub gravity_relative_sd: f64,
    /// Part of the weights that air carries; [`gravity::AIR_BUOYANCY`] for weights marked with
    /// their conventional mass.
    pub air_buoyancy: f64,
    /// The weights.
    pub weights: WeightSet,
    /// Where the cord of the weights runs over a pulley: its friction, at most this part of the
    /// load either way.
    pub pulley_friction: Option<f64>,
    /// Standard error of the time at which a load came on, s, for readings that do not give their
    /// own. A weight that is put on by hand takes some tenths of a second. It counts where a cell
    /// creeps.
    pub load_time_sd_s: f64,
    /// Weights that may have been meant, g: see [`entries`].
    pub weights_g: Vec<f64>,
    /// Nominal scale, N per code; a scale further than a factor of two from it, or with another
    /// sign, is refused. `None` accepts any.
    pub nominal_n_per_code: Option<f64>,
    /// Lines to leave out, because the user said so.
    pub left_out: Vec<usize>,
    /// Lines whose weight the user has corrected, with the right weight in g.
    pub corrections_g: BTreeMap<usize, f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            gravity_m_per_s2: gravity::STANDARD_M_PER_S2,
            gravity_relative_sd: gravity::UNKNOWN_PLACE_SD,
            air_buoyancy: gravity::AIR_BUOYANCY,
            weights: WeightSet::default(),
            pulley_friction: None,
            load_time_sd_s: 0.1,
            weights_g: WEIGHTS_G.to_vec(),
            nominal_n_per_code: Some(6.85e-6),
            left_out: Vec::new(),
            corrections_g: BTreeMap::new(),
        }
    }
}

impl Options {
    /// Force of a weight in air at the place, N.
    #[must_use]
    pub fn force_n(&self, weight_g: f64) -> f64 {
        1e-3 * weight_g * self.gravity_m_per_s2 * (1.0 - self.air_buoyancy)
    }

    /// Relative standard uncertainty of a force by the place: gravity and air.
    fn place_relative_sd(&self) -> f64 {
        self.gravity_relative_sd
            .hypot(gravity::AIR_BUOYANCY_SD * self.air_buoyancy / gravity::AIR_BUOYANCY)
    }

    /// The same by the pulley: its friction, any within the limit equally likely, and the cord.
    fn pulley_relative_sd(&self) -> f64 {
        let of = |friction: f64| friction.hypot(CORD) / 3f64.sqrt();
        self.pulley_friction.map_or(0.0, of)
    }

    /// Relative standard uncertainty of the force that a weight puts on the cell.
    #[must_use]
    pub fn force_relative_sd(&self, weight_g: f64) -> f64 {
        self.weights
            .relative_sd(weight_g)
            .hypot(self.place_relative_sd())
            .hypot(self.pulley_relative_sd())
    }

    /// Standard uncertainty of that force by the weight's own error, N.
    fn weight_sd_n(&self, weight_g: f64) -> f64 {
        self.weights.relative_sd(weight_g) * self.force_n(weight_g)
    }
}

/// Largest repeatability of a cell in order, N and as a part of the largest load: ten times what
/// plain bearings, swinging weights and poor cells do (docs/calibration.md). Beyond it, something
/// is wrong.
const LARGEST_SCATTER: (f64, f64) = (0.02, 0.003);
/// Part of a force that a cord loses that is off the axis of the cell by 2 degrees: 1 - cos 2
/// degrees.
const CORD: f64 = 6.1e-4;

/// The largest weight, g: the one that stays on for the creep.
fn held_g(used: &[Reading]) -> f64 {
    used.iter().map(|r| r.weight_g).fold(0.0, f64::max)
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
    /// Zero of a further mounting (1 or 2) against the first, codes, after the empty cells were
    /// made equal.
    MountingZero(u8),
    /// Slope of a further mounting less the mean of all mountings, codes per N.
    MountingSlope(u8),
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
    /// Half width of the 95 % interval of the scale for forces up to [`LARGEST_FORCE_N`], N per
    /// code. Wide on purpose for a cell that is straight: nobody knows that it is, beyond the
    /// weights.
    pub n_per_code_half_95: f64,
    /// The same for forces that the weights reach: without [`UncertaintyParts::beyond`].
    pub within_half_95: f64,
    /// Relative standard uncertainties of the scale: from the readings, from the weights, from
    /// gravity.
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
    /// Chi-square of the residuals with the readings' own standard errors and the weights' errors
    /// only.
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
    /// Local gravity, and the air.
    pub gravity: f64,
    /// Forces beyond the largest weight: the curve, by its error or as far as the readings don't
    /// exclude one, at [`LARGEST_FORCE_N`].
    pub beyond: f64,
    /// The next mounting of the cell, by the scatter of the scale from one to the next; 0 where it
    /// was mounted once.
    pub remounting: f64,
    /// Friction of the pulley and direction of the cord; 0 without a pulley.
    pub pulley: f64,
}

impl UncertaintyParts {
    /// All parts together.
    #[must_use]
    pub fn combined(&self) -> f64 {
        self.within().hypot(self.beyond)
    }

    /// All parts for forces that the weights reach.
    #[must_use]
    pub fn within(&self) -> f64 {
        [
            self.readings,
            self.weights,
            self.gravity,
            self.remounting,
            self.pulley,
        ]
        .iter()
        .map(|part| part * part)
        .sum::<f64>()
        .sqrt()
    }
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

/// Largest force on a cell in use, N (thesis 3.7).
pub const LARGEST_FORCE_N: f64 = 12.0;
/// Standard deviation of the curve of a cell of which nothing is known, 1/N: half of the curves of
/// the cells that the correction was made for (docs/calibration/cells.md).
pub const CURVE_SD_PER_N: f64 = 4e-3;

/// What the relative variance of the force at [`LARGEST_FORCE_N`] has more than that of the slope:
/// by the curve of the cell, as far as the readings tell it. As a standard deviation.
///
/// A curve that was fitted has an error, which goes with that of the slope. One that was not makes
/// a chord of the straight line: it cuts the curve where the force is `chord_n`, and at a force F
/// it is off by `curve (chord_n - F)`. That curve is known by the readings and by
/// [`CURVE_SD_PER_N`]; what counts is its mean square, since the line takes it as 0.
fn beyond(used: &[Reading], options: &Options, model: &Model, solution: &Solution) -> f64 {
    let slope = solution.beta[1];
    let at = |model: &Model| model.terms.iter().position(|term| *term == Term::Quadratic);
    if let Some(i) = at(model).map(|i| 2 + i) {
        let by_force = |slope_part: f64| {
            let mut coefficients = DVector::zeros(solution.beta.len());
            coefficients[1] = 1.0;
            coefficients[i] = slope_part;
            let (own, weights) = variances(solution, options, &coefficients);
            own + weights
        };
        let steeper = 1.0 + 2.0 * LARGEST_FORCE_N * solution.beta[i] / slope;
        let more = by_force(LARGEST_FORCE_N) / steeper.powi(2) - by_force(0.0);
        return (more.max(0.0).sqrt() / slope).abs();
    }
    let largest_n = options.force_n(held_g(used));
    let prior = CURVE_SD_PER_N.powi(2);
    let (mut square, mut chord_n) = (prior, largest_n);
    let mut curved = model.clone();
    curved.terms.push(Term::Quadratic);
    let found = (different_weights(used) >= 4).then(|| solve(used, options, &curved).ok());
    if let (Some(found), Some(i)) = (found.flatten(), at(&curved).map(|i| 2 + i)) {
        let curve = found.beta[i] / slope;
        let seen = found.covariance[(i, i)] / slope.powi(2);
        let chord = -found.covariance[(1, i)] / found.covariance[(i, i)];
        if seen.is_finite() && chord.is_finite() {
            let known = prior / (prior + seen);
            square = known * seen + (known * curve).powi(2);
            chord_n = chord;
        }
    }
    square.sqrt() * (LARGEST_FORCE_N - chord_n).abs()
}

/// Variance of a sum of a fit's coefficients with these factors, from the readings and from the
/// weights. The estimator takes the errors of the weights as independent. With a correlation r, a
/// part r of their variance is of one error that all share.
fn variances(solution: &Solution, options: &Options, factors: &DVector<f64>) -> (f64, f64) {
    let of = |covariance: &DMatrix<f64>| (factors.transpose() * covariance * factors)[0];
    let own = of(&solution.from_readings);
    let apart = (of(&solution.covariance) - own).max(0.0);
    let shared = factors.dot(&solution.from_shared_weights).powi(2);
    let r = options.weights.correlation;
    (own, (1.0 - r) * apart + r * shared)
}

/// Mountings beside the first, and the relative standard uncertainty of the scale in a further one:
/// the scatter of the scales, and that of their mean.
fn remounting(model: &Model, solution: &Solution) -> (usize, f64) {
    let at = |(i, term): (usize, &Term)| {
        matches!(term, Term::MountingSlope(_)).then(|| solution.beta[2 + i])
    };
    let others: Vec<f64> = model.terms.iter().enumerate().filter_map(at).collect();
    if others.is_empty() {
        return (0, 0.0);
    }
    // They are against the mean of all, so that the first has what is left.
    let first = others.iter().sum::<f64>();
    let squares: f64 = others.iter().map(|c| c * c).sum::<f64>() + first * first;
    let further = others.len();
    let scatter = (squares / further as f64).sqrt();
    let next = (1.0 + 1.0 / (further + 1) as f64).sqrt();
    (further, (scatter * next / solution.beta[1]).abs())
}

/// Level at which a further term is taken in, shared out over the candidates.
const TERM_LEVEL: f64 = 0.01;

/// Scale of a cell from readings under weights, in any order, with repeats.
///
/// # Errors
/// [`GainError`]; in particular [`GainError::WrongEntries`] with each reading that belongs to
/// another weight or to none. Put its line into [`Options::corrections_g`] or [`Options::left_out`]
/// and fit again.
pub fn fit(readings: &[Reading], options: &Options) -> Result<Gain, GainError> {
    let used = usable(readings, options)?;
    let wrong = entries::find(&used, options);
    if !wrong.is_empty() && !only_shaped(&used, options) {
        return Err(match in_place_of(&wrong, &used, options) {
            Some(found) => GainError::Mistake(Box::new(found)),
            None => GainError::WrongEntries(wrong),
        });
    }
    let mut candidates = candidates(&used);
    let (mut model, mut best) = select(&used, options, &candidates)?;
    if model.has(Term::Creep) {
        // Every interval allows for the time constant, which was searched.
        let free = Model {
            tau_free: true,
            ..model.clone()
        };
        match solve(&used, options, &free) {
            Ok(solution) if creep_search::is_significant(&free, &solution) => {
                (model, best) = (free, solution);
            }
            // Creep that a free time constant takes the significance from would only widen the
            // interval of the gain.
            _ => {
                candidates.retain(|term| *term != Term::Creep);
                (model, best) = select(&used, options, &candidates)?;
            }
        }
    }
    if let Some((found, _)) = causes::find(&used, options, &model, &best) {
        return Err(GainError::Mistake(Box::new(found)));
    }
    match causes::curve_rests(&used, options, &model, &best) {
        Rests::OnAll => {}
        Rests::OnOne(Some(found)) => return Err(GainError::Mistake(found)),
        // Too small to ask for: what it leaves is in the repeatability.
        Rests::OnOne(None) => {
            candidates.retain(|term| *term != Term::Quadratic);
            (model, best) = select(&used, options, &candidates)?;
        }
    }
    finish(&used, options, &model, &best)
}

/// One mistake that explains entries which belong to no weight.
fn in_place_of(
    wrong: &[entries::WrongEntry],
    used: &[Reading],
    options: &Options,
) -> Option<causes::Found> {
    // A slip to another weight of the set explains itself.
    if wrong.iter().all(|entry| entry.likely_g.is_some()) {
        return None;
    }
    let line = Model::of(used);
    let solution = solve(used, options, &line).ok()?;
    let straight = causes::find(used, options, &line, &solution)
        .filter(|(_, right)| entries::find(right, options).is_empty());
    if let Some((found, _)) = straight {
        return Some(found);
    }
    // On a cell that is curved or creeps, what leaves the line is not all due to the mistake.
    for term in shapes(used).into_iter().flatten() {
        let Some((model, solution)) = with(term, used, options, &line, &solution) else {
            continue;
        };
        let shaped = causes::find(used, options, &model, &solution)
            .filter(|(_, right)| only_shaped(right, options));
        if let Some((found, _)) = shaped {
            return Some(found);
        }
    }
    None
}

/// What a cell may do that leaves a line and that these readings can tell.
fn shapes(used: &[Reading]) -> [Option<Term>; 2] {
    [
        (different_weights(used) >= 4).then_some(Term::Quadratic),
        creep::can_tell(used).then_some(Term::Creep),
    ]
}

/// The model with the terms that are significant, taken in one after the other, and its fit.
fn select(
    used: &[Reading],
    options: &Options,
    candidates: &[Term],
) -> Result<(Model, Solution), GainError> {
    let mut model = Model::of(used);
    let mut best = solve(used, options, &model)?;
    loop {
        let mut chosen: Option<(f64, Model, Solution)> = None;
        for &term in candidates.iter().filter(|t| !model.has(**t)) {
            let Some((more, solution)) = with(term, used, options, &model, &best) else {
                continue;
            };
            let searched = if term == Term::Creep {
                creep_search::SEARCHED
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
            None => return Ok((model, best)),
        }
    }
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
        let covariance = own_covariance(used, options, &more, slope, repeatability)
            + weight_covariance(used, options, slope);
        let inverse = covariance.cholesky()?.inverse();
        more.tau_s = creep_search::search(used, options, &more, &inverse)?;
        more.share = creep_search::share(used, options, &more, &inverse)?;
        let solution = solve(used, options, &more).ok()?;
        (repeatability, slope) = (solution.repeatability, solution.beta[1]);
        found = Some(solution);
    }
    found.map(|solution| (more, solution))
}

/// Largest part of the range that a curve may take before the readings count as wrong rather than
/// the cell as curved; with this many different weights, which show a curve as such, and with
/// fewer.
const LARGEST_CURVE: (usize, f64, f64) = (6, 0.25, 0.05);
/// Largest part of the range that creep may take.
const LARGEST_CREEP: f64 = 0.25;

/// Whether readings that leave the line leave it because the cell is curved or creeps: with that
/// taken off, none is wrong. A wrong entry can't pass for a curve: it bends the curve away from all
/// others.
fn only_shaped(used: &[Reading], options: &Options) -> bool {
    let Ok(mut best) = solve(used, options, &Model::of(used)) else {
        return false;
    };
    let (enough, large, small) = LARGEST_CURVE;
    let weights = different_weights(used);
    let shapes = shapes(used);
    // The curve alone, creep alone, both.
    for chosen in [&shapes[..1], &shapes[1..], &shapes[..]] {
        let mut model = Model::of(used);
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
        let own = own_covariance(used, options, &model, best.beta[1], 0.0);
        let straight: Vec<Reading> = used
            .iter()
            .enumerate()
            .map(|(row, r)| Reading {
                code: r.code - part(Term::Quadratic, row) - part(Term::Creep, row),
                // What a creeping cell reads is as uncertain as the times of its loads.
                standard_error_codes: own[(row, row)].sqrt(),
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
        let ratio = (n_per_code / nominal).abs();
        if !(0.5..=2.0).contains(&ratio) {
            return Err(GainError::ImplausibleScale {
                n_per_code,
                nominal,
                looks_like: error::LooksLike::of(slope),
            });
        }
        if n_per_code * nominal < 0.0 {
            return Err(GainError::Falling {
                codes_per_n: slope,
                nominal,
            });
        }
    }
    let sd_n = (solution.repeatability / slope).abs();
    let limit_n = LARGEST_SCATTER.0 + LARGEST_SCATTER.1 * options.force_n(held_g(used));
    if sd_n > limit_n {
        let off_n = |i: usize| solution.residuals[i] / slope;
        let worst = (0..used.len()).max_by(|&a, &b| off_n(a).abs().total_cmp(&off_n(b).abs()));
        let worst = worst.unwrap_or_default();
        return Err(GainError::Scatter {
            at: used[worst].at.clone(),
            sd_n,
            off_n: off_n(worst),
        });
    }
    let mut of_slope = DVector::zeros(solution.beta.len());
    of_slope[1] = 1.0;
    let (own, weights) = variances(solution, options, &of_slope);
    let (further, remounting) = remounting(model, solution);
    let parts = UncertaintyParts {
        readings: own.sqrt() / slope.abs(),
        weights: weights.sqrt() / slope.abs(),
        gravity: options.place_relative_sd(),
        beyond: beyond(used, options, model, solution),
        remounting,
        pulley: options.pulley_relative_sd(),
    };
    // Welch and Satterthwaite (GUM G.4).
    let coverage = |relative: f64| {
        let dof = relative.powi(4)
            / (parts.readings.powi(4) / solution.dof as f64
                + parts.remounting.powi(4) / further.max(1) as f64);
        stats::student_quantile(0.975, dof)
    };
    let relative = parts.combined();
    let within = parts.within();
    let sd_of = |r: &Reading| {
        let weight = options.weight_sd_n(r.weight_g) * slope;
        (r.standard_error_codes.powi(2) + solution.repeatability.powi(2) + weight * weight).sqrt()
    };
    Ok(Gain {
        n_per_code,
        n_per_code_sd: relative * n_per_code.abs(),
        n_per_code_half_95: coverage(relative) * relative * n_per_code.abs(),
        within_half_95: coverage(within) * within * n_per_code.abs(),
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
                    .hypot(found.value / slope * options.weights.relative_sd(held_g(used))),
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
                force_n: options.force_n(r.weight_g),
                direction: r.direction,
                residual_n: residual / slope,
                sd_n: (sd_of(r) / slope).abs(),
            })
            .collect(),
        largest_n: used
            .iter()
            .map(|r| options.force_n(r.weight_g))
            .fold(0.0, f64::max),
    })
}

impl Gain {
    /// Force of a code above the zero, N, with the quadratic term where there is one, at the
    /// reference temperature. NaN where the curve does not reach the code.
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
