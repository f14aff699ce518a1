//! Common mistakes that touch many readings at once: the zero moved, a hanger that was not entered,
//! a weight of the set that is not what is written on it, a scale that changed within the series.
//!
//! Each is one column more in the model of the series ([`super`]): a step of the zero from a line
//! on, a constant with every load, a constant with one weight, a step of the slope from a line on.
//! What a cell does by itself (curve, creep, drift, temperature, hysteresis) is a column too. All
//! of them are compared by their posterior probability: the likelihood, with the repeatability that
//! fits each best, the Bayesian information criterion for the number of columns, and the priors
//! below. A curve that only the largest weight shows is as likely as an error of that weight, and
//! one that all weights show is not.
//!
//! A mistake is named where it is more likely than everything else by `ODDS`, and large enough to
//! matter.

use super::least_squares::{design, own_covariance, solve, weight_covariance, Model, Solution};
use super::{Direction, Options, Reading, Term};
use crate::input::Location;
use nalgebra::{DMatrix, DVector};
use std::fmt;

/// What happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Cause {
    /// The zero moved by so much, N, between two readings.
    ZeroMoved {
        /// The last reading before.
        before: Location,
        /// The first after.
        after: Location,
        /// By how much, N.
        by_n: f64,
    },
    /// Every load but the empty cell is heavier than entered.
    Hanger {
        /// By so much, g.
        by_g: f64,
    },
    /// A weight is not what is written on it.
    Weight {
        /// What is written on it, g.
        weight_g: f64,
        /// What it is by the others, g.
        is_g: f64,
        /// Its tolerance, g.
        limit_g: f64,
        /// Lines in which it was hung.
        lines: Vec<usize>,
        /// Whether a curve of the cell would explain the readings as well: only this weight shows
        /// it.
        or_curved: bool,
        /// Whether it is the largest and gives far less than it should: the code may have stopped.
        or_stopped: bool,
    },
    /// The scale changed between two readings.
    ScaleChanged {
        /// The last reading before.
        before: Location,
        /// The first after.
        after: Location,
        /// Codes per newton after over before, less 1.
        part: f64,
    },
}

/// A mistake that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// What happened.
    pub cause: Cause,
    /// Standard error of its size, in its unit.
    pub standard_error: f64,
    /// How many times more likely it is than everything that is no mistake.
    pub odds: f64,
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let se = self.standard_error;
        match &self.cause {
            Cause::ZeroMoved { before, after, by_n } => write!(
                f,
                "{before}: the zero moved by {by_n:+.3} +- {se:.3} N before line {}; something touched cell, cable or converter in between, or the converter was powered up again: weigh once more without that, or leave out the lines of one part",
                after.line
            ),
            Cause::Hanger { by_g } => write!(
                f,
                "every load is {by_g:+.2} +- {se:.2} g against what is entered, and the empty cell is not: a hanger or hook that hangs with the weights only? Read the empty cell with it, or add it to each weight"
            ),
            Cause::Weight {
                weight_g,
                is_g,
                limit_g,
                lines,
                or_curved,
                or_stopped,
            } => {
                let otherwise = if *or_stopped {
                    ". Or the code stops to grow before this load, at a limit of cell or converter: hang weights between this one and the next smaller to tell"
                } else if *or_curved {
                    ". Or the cell is curved, which no other weight shows: hang weights between this one and the next smaller to tell"
                } else {
                    ""
                };
                let lines: Vec<String> = lines.iter().map(usize::to_string).collect();
                write!(
                    f,
                    "the weight of {weight_g} g is {is_g:.4} +- {se:.4} g by the others, {:.1} times its tolerance of {limit_g:.4} g (lines {}): have it weighed, or leave it out{otherwise}",
                    (is_g - weight_g).abs() / limit_g,
                    lines.join(", ")
                )
            }
            Cause::ScaleChanged {
                before,
                after,
                part,
            } => write!(
                f,
                "{before}: the same weights give {:+.2} +- {:.2} % from line {} on; another gain of the converter, another cell, another set of weights? Weigh once more, or leave out the lines of one part",
                100.0 * part,
                100.0 * se,
                after.line
            ),
        }
    }
}

/// Odds from which a mistake is named.
const ODDS: f64 = 50.0;
/// How much likelier than an error of one weight a curve has to be.
const CURVE_ODDS: f64 = 10.0;
/// Prior odds of one mistake of a kind in a series, all its places together.
const MISTAKE: f64 = 0.01;
/// Prior odds of what a cell does by itself, each.
const SHAPE: f64 = 0.2;
/// A step of the zero, or a hanger, below this is in the uncertainty and no mistake, N: the goal
/// for a zero.
const LEAST_N: f64 = 0.005;
/// The same for a step of the scale: what temperature does in an hour.
const LEAST_PART: f64 = 1e-3;
/// A weight within so many tolerances is no mistake: its limit may be that of the next class.
const LEAST_LIMITS: f64 = 2.0;
/// Nor is one by less than this, N, however good its class: creep and hysteresis that the model
/// leaves are as large on a good cell (0.01 % of 10 N).
const LEAST_WEIGHT_N: f64 = 0.001;
/// Part of the largest weight that has to be missing before its code may have stopped: more than
/// the curve of any cell.
const STOPPED: f64 = 0.1;
/// Readings that each part before and after a step has at least; fewer are single wrong entries.
const PART: usize = 3;

enum Kind {
    Zero(usize),
    Hanger,
    Weight(f64),
    Scale(usize),
}

/// The most likely mistake, where one is far more likely than none, and the readings without it.
/// `model` and `solution`: the fit that was chosen without one.
pub(super) fn find(
    used: &[Reading],
    options: &Options,
    model: &Model,
    solution: &Solution,
) -> Option<(Found, Vec<Reading>)> {
    let compared = Compared::new(used, options, model, solution)?;
    let best = compared.best()?;
    told(used, options, model, &compared, &best, false)
}

/// A mistake in words, and the readings without it; `None` where it is too small to matter.
fn told(
    used: &[Reading],
    options: &Options,
    model: &Model,
    compared: &Compared,
    best: &Best,
    or_curved: bool,
) -> Option<(Found, Vec<Reading>)> {
    let kind = &compared.kinds[best.column];
    // The slope without the mistake in it.
    let right: Vec<Reading> = used
        .iter()
        .zip(compared.mistakes.column(best.column).iter())
        .map(|(r, column)| Reading {
            code: r.code - best.coefficient * column,
            ..r.clone()
        })
        .collect();
    let slope = solve(&right, options, model).ok()?.beta[1];
    let (size, se) = (
        best.coefficient / slope,
        (best.standard_error / slope).abs(),
    );
    let g_per_n = 1.0 / options.force_n(1.0);
    let place = |at: usize| (used[at - 1].at.clone(), used[at].at.clone());
    let (cause, standard_error) = match kind {
        Kind::Zero(at) if size.abs() >= LEAST_N => {
            let (before, after) = place(*at);
            let by_n = size;
            (
                Cause::ZeroMoved {
                    before,
                    after,
                    by_n,
                },
                se,
            )
        }
        Kind::Hanger if size.abs() >= LEAST_N => {
            let by_g = size * g_per_n;
            (Cause::Hanger { by_g }, se * g_per_n)
        }
        Kind::Weight(weight_g) => {
            let limit_g = options.weights.relative_sd(*weight_g) * 3f64.sqrt() * weight_g;
            if (size * g_per_n).abs() < LEAST_LIMITS * limit_g || size.abs() < LEAST_WEIGHT_N {
                return None;
            }
            let hung = used.iter().filter(|r| r.weight_g == *weight_g);
            let cause = Cause::Weight {
                weight_g: *weight_g,
                is_g: weight_g + size * g_per_n,
                limit_g,
                lines: hung.map(|r| r.at.line).collect(),
                or_curved,
                or_stopped: used.iter().all(|r| r.weight_g <= *weight_g)
                    && size * g_per_n < -STOPPED * weight_g,
            };
            (cause, se * g_per_n)
        }
        // The column is the load: the coefficient is codes per newton.
        Kind::Scale(at) if size.abs() >= LEAST_PART => {
            let (before, after) = place(*at);
            let part = size;
            let cause = Cause::ScaleChanged {
                before,
                after,
                part,
            };
            (cause, se)
        }
        _ => return None,
    };
    let found = Found {
        cause,
        standard_error,
        odds: best.odds,
    };
    Some((found, right))
}

/// The mistakes' columns, and what they are compared with.
struct Compared {
    /// Zero, slope, and what the cell does by itself.
    own: DMatrix<f64>,
    /// Bit by bit, which of these every model has: those of further mountings.
    always: usize,
    mistakes: DMatrix<f64>,
    kinds: Vec<Kind>,
    /// Prior of each kind, shared out over its places.
    log_priors: Vec<f64>,
    codes: DVector<f64>,
    /// Covariance of the codes without repeatability.
    covariance: DMatrix<f64>,
    repeatabilities: Vec<f64>,
}

struct Best {
    column: usize,
    coefficient: f64,
    standard_error: f64,
    odds: f64,
}

impl Compared {
    fn new(
        used: &[Reading],
        options: &Options,
        model: &Model,
        solution: &Solution,
    ) -> Option<Self> {
        let n = used.len();
        let fixed = Model {
            tau_free: false,
            ..model.clone()
        };
        let mut own = design(used, options, &fixed);
        let force = |r: &Reading| options.force_n(r.weight_g);
        let largest_n = used.iter().map(force).fold(0.0, f64::max);
        let both = [Direction::Loading, Direction::Unloading]
            .iter()
            .all(|way| used.iter().any(|r| r.direction == Some(*way)));
        if both {
            let at = own.ncols();
            own = own.insert_column(at, 0.0);
            for (row, r) in used.iter().enumerate() {
                if r.direction == Some(Direction::Unloading) {
                    own[(row, at)] = force(r) * (largest_n - force(r)) / largest_n;
                }
            }
        }
        let mut kinds = Vec::new();
        let mut columns: Vec<DVector<f64>> = Vec::new();
        let mut log_priors = Vec::new();
        let of = |value: &dyn Fn(usize, &Reading) -> f64| {
            DVector::from_iterator(n, used.iter().enumerate().map(|(i, r)| value(i, r)))
        };
        let mut weights: Vec<f64> = used
            .iter()
            .map(|r| r.weight_g)
            .filter(|w| *w > 0.0)
            .collect();
        weights.sort_by(f64::total_cmp);
        weights.dedup();
        // With three weights, the error of one is the curve of the others.
        if weights.len() >= 4 {
            for &weight in &weights {
                kinds.push(Kind::Weight(weight));
                columns.push(of(&|_, r| f64::from(u8::from(r.weight_g == weight))));
                log_priors.push((MISTAKE / weights.len() as f64).ln());
            }
        }
        if used.iter().any(|r| r.weight_g == 0.0) {
            kinds.push(Kind::Hanger);
            columns.push(of(&|_, r| f64::from(u8::from(r.weight_g > 0.0))));
            log_priors.push(MISTAKE.ln());
        }
        let loads = |part: &[Reading]| super::reading::different_weights(part);
        let steps: Vec<usize> = (PART..(n + 1).saturating_sub(PART))
            .filter(|&at| loads(&used[..at]) >= 2 && loads(&used[at..]) >= 2)
            .collect();
        for &at in &steps {
            for scale in [false, true] {
                kinds.push(if scale {
                    Kind::Scale(at)
                } else {
                    Kind::Zero(at)
                });
                columns.push(of(&|i, r| match (i >= at, scale) {
                    (false, _) => 0.0,
                    (true, false) => 1.0,
                    (true, true) => force(r),
                }));
                log_priors.push((MISTAKE / steps.len() as f64).ln());
            }
        }
        if columns.is_empty() {
            return None;
        }
        let slope = solution.beta[1];
        let line = solve(used, options, &Model::of(used)).ok()?;
        let most = line.repeatability.max(solution.repeatability);
        let mut repeatabilities = vec![0.0];
        repeatabilities.extend((0..9).map(|i| most * 0.5f64.powi(i)).filter(|r| *r > 0.0));
        let of_mounting =
            |term: &Term| matches!(term, Term::MountingZero(_) | Term::MountingSlope(_));
        let bits = model.terms.iter().enumerate();
        let always = bits
            .filter(|(_, term)| of_mounting(term))
            .map(|(i, _)| 1 << i)
            .sum();
        Some(Self {
            own,
            always,
            mistakes: DMatrix::from_columns(&columns),
            kinds,
            log_priors,
            codes: DVector::from_iterator(n, used.iter().map(|r| r.code)),
            covariance: own_covariance(used, options, &fixed, slope, 0.0)
                + weight_covariance(used, options, slope),
            repeatabilities,
        })
    }

    /// The mistake with the largest posterior, with its odds against the best model without one.
    fn best(&self) -> Option<Best> {
        let mut without = f64::NEG_INFINITY;
        let mut with: Option<(f64, Best)> = None;
        self.scan(|model| match model.mistake {
            None => without = without.max(model.log_posterior),
            Some((column, coefficient, standard_error)) => {
                let posterior = model.log_posterior + self.log_priors[column];
                if with.as_ref().is_none_or(|(most, _)| posterior > *most) {
                    let best = Best {
                        column,
                        coefficient,
                        standard_error,
                        odds: 0.0,
                    };
                    with = Some((posterior, best));
                }
            }
        })?;
        let (most, best) = with?;
        let odds = (most - without).min(700.0).exp();
        (odds >= ODDS).then_some(Best { odds, ..best })
    }

    /// Tells of every model: each choice of what the cell does by itself, alone and with one
    /// mistake, with each repeatability.
    /// `None` where the covariance is none.
    fn scan(&self, mut tell: impl FnMut(&Compare)) -> Option<()> {
        let n = self.codes.len();
        let shapes = self.own.ncols() - 2;
        let per_column = -0.5 * (n as f64).ln();
        for repeatability in &self.repeatabilities {
            let mut covariance = self.covariance.clone();
            for i in 0..n {
                covariance[(i, i)] += repeatability * repeatability;
            }
            let root = covariance.cholesky()?.unpack();
            let log_determinant: f64 = root.diagonal().map(|v| 2.0 * v.ln()).sum();
            let own = root.solve_lower_triangular(&self.own)?;
            let mistakes = root.solve_lower_triangular(&self.mistakes)?;
            let codes = root.solve_lower_triangular(&self.codes)?;
            for chosen in (0..1usize << shapes).filter(|c| c & self.always == self.always) {
                let taken: Vec<usize> = (0..own.ncols())
                    .filter(|c| *c < 2 || chosen >> (c - 2) & 1 == 1)
                    .collect();
                if taken.len() + 1 >= n {
                    continue;
                }
                let q = own.select_columns(&taken).qr().q();
                let left = &codes - &q * q.tr_mul(&codes);
                let more = (taken.len() - 2) as f64;
                let alone = -0.5 * (log_determinant + left.norm_squared())
                    + more * (per_column + SHAPE.ln());
                tell(&Compare {
                    chosen,
                    mistake: None,
                    log_posterior: alone,
                });
                let across = &mistakes - &q * q.tr_mul(&mistakes);
                for column in 0..across.ncols() {
                    let c = across.column(column);
                    let square = c.norm_squared();
                    if square < 1e-6 * mistakes.column(column).norm_squared() {
                        // The others hold it already.
                        continue;
                    }
                    let along = c.dot(&left);
                    tell(&Compare {
                        chosen,
                        mistake: Some((column, along / square, square.sqrt().recip())),
                        log_posterior: alone + 0.5 * along * along / square + per_column,
                    });
                }
            }
        }
        Some(())
    }
}

/// A model that is compared with others.
struct Compare {
    /// Bit by bit, which columns of what the cell does by itself it has.
    chosen: usize,
    /// The column of a mistake, its coefficient and the standard error of that.
    mistake: Option<(usize, f64, f64)>,
    /// Without the prior of the mistake.
    log_posterior: f64,
}

/// On what a curve rests.
pub(super) enum Rests {
    /// On several weights, or there is none.
    OnAll,
    /// On one weight that may be off as well; what that would be, where it is more than its
    /// tolerance allows.
    OnOne(Option<Box<Found>>),
}

/// Whether the readings tell a curve from an error of one weight. They do where they are more
/// likely by [`CURVE_ODDS`] with a curve than with a straight cell of which the largest weight is
/// off. A smaller one would not bend the line.
pub(super) fn curve_rests(
    used: &[Reading],
    options: &Options,
    model: &Model,
    solution: &Solution,
) -> Rests {
    let curve = model.terms.iter().position(|term| *term == Term::Quadratic);
    let (Some(curve), Some(compared)) = (curve, Compared::new(used, options, model, solution))
    else {
        return Rests::OnAll;
    };
    let largest_g = used.iter().map(|r| r.weight_g).fold(0.0, f64::max);
    let mut curved = f64::NEG_INFINITY;
    let mut straight: Option<(f64, Best)> = None;
    let scanned = compared.scan(|model| {
        let has_curve = model.chosen >> curve & 1 == 1;
        match model.mistake {
            // The prior of the curve is not counted: both are one column.
            None if has_curve => curved = curved.max(model.log_posterior - SHAPE.ln()),
            Some((column, coefficient, standard_error)) if !has_curve => {
                let better = straight
                    .as_ref()
                    .is_none_or(|(l, _)| model.log_posterior > *l);
                if better && matches!(compared.kinds[column], Kind::Weight(weight_g) if weight_g == largest_g) {
                    let best = Best {
                        column,
                        coefficient,
                        standard_error,
                        odds: 0.0,
                    };
                    straight = Some((model.log_posterior, best));
                }
            }
            _ => {}
        }
    });
    let (Some(()), Some((likely, mut best))) = (scanned, straight) else {
        return Rests::OnAll;
    };
    if curved - likely > CURVE_ODDS.ln() {
        return Rests::OnAll;
    }
    best.odds = (likely - curved).min(700.0).exp();
    let mut line = model.clone();
    line.terms.retain(|term| *term != Term::Quadratic);
    let found = told(used, options, &line, &compared, &best, true);
    Rests::OnOne(found.map(|(found, _)| Box::new(found)))
}
