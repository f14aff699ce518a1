//! Exit points and load-cell axes from a run with the robot moving, without a digitizer.
//!
//! # What the run tells
//!
//! A cable's length is the distance from the tip to its exit point. The encoder gives its change, the robot its tip:
//!
//! ```text
//! |x - p_k| = length_0 + (1 + scale) travel_k + compliance tension_k + error
//! ```
//!
//! with the exit point `x`, the tip `p_k`, the paid-out travel, the cable's stretch, the length at zero travel. A tip
//! that moves by some centimetres looks at `x` from different sides, so that `x` is found as by trilateration;
//! along the cable it is found through the curvature of the distance only, and the error of the reel's scale
//! looks much like it. [`Prior`] says what is known of scale and compliance.
//!
//! A cell reads `gain * tension_k (-a . d_k)`, so where a tension is known independently of the cell (motor current, a
//! force gauge, force closure), `gain * a` follows by linear least squares ([`axis`]).
//!
//! Errors of the tip enter through their part along the cable. They are taken as independent from sample to sample; an
//! error of the robot's frame that is constant moves all exit points with it and is not seen.
//!
//! What a run does not tell is reported: the singular value decomposition of the scaled Jacobian gives the
//! directions of the unknowns and how well each is known ([`Direction`]).

use crate::geometry::UnitGeometry;
use crate::stats;
use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen, Vector3};

/// Fewest samples of a run.
const FEWEST: usize = 8;

/// One sample of one unit while the tip moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Tip, base frame, m.
    pub tip_m: Vector3<f64>,
    /// Cable paid out since an arbitrary start, m: encoder counts times travel per count.
    pub travel_m: f64,
    /// Cable tension, N: stretches the cable.
    pub tension_n: f64,
}

/// What is known before the run. Standard deviations; 0 holds a number at its value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Standard deviation of one travel reading, m: encoder, winding of the reel.
    pub travel_sd_m: f64,
    /// Standard deviation of one coordinate of the tip, m, independent from sample to sample.
    pub tip_sd_m: f64,
    /// Standard deviation of the relative error of the travel's scale (reel radius): 0.002 for 20 um on 10 mm.
    pub scale_sd: f64,
    /// Expected stretch, m/N.
    pub compliance_m_per_n: f64,
    /// Its standard deviation, m/N.
    pub compliance_sd_m_per_n: f64,
    /// A direction of the unknowns whose standard deviation is larger than this counts as not observed, m.
    pub observable_sd_m: f64,
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            travel_sd_m: 1e-4,
            tip_sd_m: 2e-4,
            scale_sd: 0.001,
            compliance_m_per_n: 0.0,
            compliance_sd_m_per_n: 5e-5,
            observable_sd_m: 0.002,
        }
    }
}

/// An exit point from a run.
#[derive(Debug, Clone, PartialEq)]
pub struct ExitEstimate {
    /// Exit point, base frame, m.
    pub exit_m: Vector3<f64>,
    /// Its covariance, m^2.
    pub covariance_m2: Matrix3<f64>,
    /// Cable length at zero travel, m.
    pub length_m: f64,
    /// Relative error of the travel's scale.
    pub scale: f64,
    /// Stretch, m/N.
    pub compliance_m_per_n: f64,
    /// Chi-square of the lengths.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Directions of the exit point, best known first.
    pub directions: [Direction; 3],
    /// Singular values of the Jacobian of all unknowns, whitened, priors left out, largest first. A value of 0 is a
    /// combination that the run alone says nothing about.
    pub singular_values: Vec<f64>,
}

impl ExitEstimate {
    /// Directions that the run does not tell well enough ([`Prior::observable_sd_m`]).
    #[must_use]
    pub fn unobserved(&self) -> Vec<Direction> {
        self.directions
            .iter()
            .copied()
            .filter(|d| !d.observed)
            .collect()
    }

    /// p-value of the lengths' chi-square.
    #[must_use]
    pub fn p(&self) -> f64 {
        stats::chi_square_survival(self.chi_square, self.degrees_of_freedom)
    }
}

/// A direction in space and how well the exit point is known along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Unit vector, base frame.
    pub direction: Vector3<f64>,
    /// Standard deviation along it, m.
    pub sd_m: f64,
    /// Whether that is good enough.
    pub observed: bool,
}

/// Why a run gives no estimate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelfCalibrationError {
    /// Too few samples.
    #[error("{got} samples are too few; record at least {FEWEST}, with the tip moving in all three directions")]
    TooFew {
        /// Samples given.
        got: usize,
    },
    /// A number that can't be used.
    #[error("sample {sample}: {what} is not a finite number")]
    NotFinite {
        /// Index of the sample, from 0.
        sample: usize,
        /// Which number.
        what: &'static str,
    },
    /// A prior that can't be used.
    #[error("{name} is {value}; it has to be finite and {}", if *.zero { "0 or above" } else { "above 0" })]
    BadPrior {
        /// The field of [`Prior`] or the argument.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Whether 0 is allowed.
        zero: bool,
    },
    /// The tip does not move enough.
    #[error("the run does not determine the exit point: the tip moved by {extent_mm:.1} mm along its least direction; move it further, in all three directions")]
    NotObservable {
        /// Standard deviation of the tip along its least direction, mm.
        extent_mm: f64,
    },
    /// The fit does not come to rest.
    #[error("the fit of the exit point does not converge; check the sign of the travel (paid out is positive) and the frame of the tip")]
    NoConvergence,
}

/// Unknowns: exit x, y, z, length, scale, compliance.
const UNKNOWNS: usize = 6;

/// Exit point of one unit from a run. `start_m` is a rough position (m), as from a digitizer or a tape measure; without
/// one the lengths are solved linearly first.
///
/// # Errors
/// [`SelfCalibrationError`].
pub fn exit_point(
    samples: &[Sample],
    prior: &Prior,
    start_m: Option<Vector3<f64>>,
) -> Result<ExitEstimate, SelfCalibrationError> {
    check(samples, prior)?;
    let tip_mean = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / samples.len() as f64;
    let extent_mm = extent_mm(samples, &tip_mean);
    let not_observable = SelfCalibrationError::NotObservable { extent_mm };
    let start = start_m
        .or_else(|| linear_start(samples))
        .ok_or_else(|| not_observable.clone())?;
    let sd = (prior.travel_sd_m.powi(2) + prior.tip_sd_m.powi(2)).sqrt();
    let mut x = DVector::zeros(UNKNOWNS);
    x.fixed_rows_mut::<3>(0).copy_from(&start);
    x[5] = prior.compliance_m_per_n;
    x[3] = samples
        .iter()
        .map(|s| (start - s.tip_m).norm() - s.travel_m)
        .sum::<f64>()
        / samples.len() as f64;
    let model = Model { samples, prior, sd };
    let mut cost = model.cost(&x);
    let mut damping = 1e-9;
    let mut done = false;
    for _ in 0..200 {
        let (jacobian, residual) = model.linearise(&x);
        let normal = jacobian.transpose() * &jacobian;
        let gradient = jacobian.transpose() * residual;
        let mut damped = normal.clone();
        for i in 0..UNKNOWNS {
            damped[(i, i)] *= 1.0 + damping;
        }
        let Some(factor) = damped.cholesky() else {
            damping = f64::max(damping * 10.0, 1e-9);
            if damping > 1e12 {
                return Err(not_observable);
            }
            continue;
        };
        let step = -factor.solve(&gradient);
        let next = &x + &step;
        let next_cost = model.cost(&next);
        if next_cost <= cost {
            // A millionth of chi-square is far below what any statement rests on; a direction that is not
            // observed would creep on for ever.
            let small = step.rows(0, 4).amax() < 1e-9 || cost - next_cost < 1e-6;
            x = next;
            cost = next_cost;
            damping *= 0.1;
            if small {
                done = true;
                break;
            }
        } else {
            damping = f64::max(damping * 10.0, 1e-9);
            if damping > 1e12 {
                done = true;
                break;
            }
        }
    }
    if !x.iter().all(|v| v.is_finite()) {
        return Err(SelfCalibrationError::NoConvergence);
    }
    let (jacobian, _) = model.linearise(&x);
    let covariance = (jacobian.transpose() * &jacobian)
        .try_inverse()
        .ok_or_else(|| not_observable.clone())?;
    let covariance_m2: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
    if !covariance_m2.iter().all(|v| v.is_finite()) {
        return Err(not_observable);
    }
    if !done {
        // A fit that goes on and on: along a direction that the run says nothing about, or because it is wrong.
        let worst = covariance_m2.symmetric_eigenvalues().max();
        return Err(if worst > prior.observable_sd_m.powi(2) {
            not_observable
        } else {
            SelfCalibrationError::NoConvergence
        });
    }
    let eigen = SymmetricEigen::new(covariance_m2);
    let mut directions = [0, 1, 2].map(|i| {
        let sd_m = eigen.eigenvalues[i].max(0.0).sqrt();
        Direction {
            direction: eigen.eigenvectors.column(i).into_owned(),
            sd_m,
            observed: sd_m <= prior.observable_sd_m,
        }
    });
    directions.sort_by(|a, b| a.sd_m.total_cmp(&b.sd_m));
    let data = jacobian.rows(0, samples.len()).into_owned();
    let mut singular_values: Vec<f64> = data.singular_values().iter().copied().collect();
    singular_values.sort_by(|a, b| b.total_cmp(a));
    Ok(ExitEstimate {
        exit_m: x.fixed_rows::<3>(0).into_owned(),
        covariance_m2,
        length_m: x[3],
        scale: x[4],
        compliance_m_per_n: x[5],
        chi_square: cost,
        // Scale and compliance take one each and their priors give one each.
        degrees_of_freedom: samples.len() - 4,
        directions,
        singular_values,
    })
}

fn check(samples: &[Sample], prior: &Prior) -> Result<(), SelfCalibrationError> {
    for (name, value, zero) in [
        ("travel_sd_m", prior.travel_sd_m, false),
        ("tip_sd_m", prior.tip_sd_m, true),
        ("scale_sd", prior.scale_sd, true),
        ("compliance_sd_m_per_n", prior.compliance_sd_m_per_n, true),
        ("observable_sd_m", prior.observable_sd_m, false),
    ] {
        if !(value.is_finite() && (value > 0.0 || (zero && value == 0.0))) {
            return Err(SelfCalibrationError::BadPrior { name, value, zero });
        }
    }
    if samples.len() < FEWEST {
        return Err(SelfCalibrationError::TooFew { got: samples.len() });
    }
    for (sample, s) in samples.iter().enumerate() {
        for (what, good) in [
            ("the tip", s.tip_m.iter().all(|v| v.is_finite())),
            ("the travel", s.travel_m.is_finite()),
            ("the tension", s.tension_n.is_finite()),
        ] {
            if !good {
                return Err(SelfCalibrationError::NotFinite { sample, what });
            }
        }
    }
    Ok(())
}

fn extent_mm(samples: &[Sample], mean: &Vector3<f64>) -> f64 {
    let mut scatter = Matrix3::zeros();
    for s in samples {
        let d = s.tip_m - mean;
        scatter += d * d.transpose();
    }
    let least = scatter.symmetric_eigenvalues().min().max(0.0);
    1e3 * (least / samples.len() as f64).sqrt()
}

struct Model<'s> {
    samples: &'s [Sample],
    prior: &'s Prior,
    sd: f64,
}

impl Model<'_> {
    fn residual(&self, x: &DVector<f64>, s: &Sample) -> f64 {
        let exit = Vector3::new(x[0], x[1], x[2]);
        ((exit - s.tip_m).norm() - x[3] - (1.0 + x[4]) * s.travel_m - x[5] * s.tension_n) / self.sd
    }

    /// Scale and compliance against what is known of them, in standard deviations; a standard deviation of 0
    /// holds them (1e-12 of one: far below what a run can tell).
    fn beliefs(&self, x: &DVector<f64>) -> [(f64, f64); 2] {
        let weight = |sd: f64, unit: f64| 1.0 / if sd > 0.0 { sd } else { 1e-9 * unit };
        let scale = weight(self.prior.scale_sd, 1.0);
        let compliance = weight(self.prior.compliance_sd_m_per_n, 1e-3);
        [
            (x[4] * scale, scale),
            (
                (x[5] - self.prior.compliance_m_per_n) * compliance,
                compliance,
            ),
        ]
    }

    fn cost(&self, x: &DVector<f64>) -> f64 {
        let data: f64 = self
            .samples
            .iter()
            .map(|s| self.residual(x, s).powi(2))
            .sum();
        data + self.beliefs(x).iter().map(|b| b.0 * b.0).sum::<f64>()
    }

    fn linearise(&self, x: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.samples.len();
        let mut jacobian = DMatrix::zeros(n + 2, UNKNOWNS);
        let mut residual = DVector::zeros(n + 2);
        let exit = Vector3::new(x[0], x[1], x[2]);
        for (k, s) in self.samples.iter().enumerate() {
            let span = exit - s.tip_m;
            // A tip in the exit point has no direction; any will do for one step.
            let direction = span.try_normalize(1e-9).unwrap_or_else(Vector3::x) / self.sd;
            for i in 0..3 {
                jacobian[(k, i)] = direction[i];
            }
            jacobian[(k, 3)] = -1.0 / self.sd;
            jacobian[(k, 4)] = -s.travel_m / self.sd;
            jacobian[(k, 5)] = -s.tension_n / self.sd;
            residual[k] = self.residual(x, s);
        }
        for (i, (value, weight)) in self.beliefs(x).into_iter().enumerate() {
            jacobian[(n + i, 4 + i)] = weight;
            residual[n + i] = value;
        }
        (jacobian, residual)
    }
}

/// Exit point by squaring the lengths: linear in `x`, `length_0` and `|x|^2 - length_0^2`.
fn linear_start(samples: &[Sample]) -> Option<Vector3<f64>> {
    let mean = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / samples.len() as f64;
    let travel = samples.iter().map(|s| s.travel_m).sum::<f64>() / samples.len() as f64;
    let rows = samples.len();
    let matrix = DMatrix::from_fn(rows, 5, |k, i| {
        let s = &samples[k];
        match i {
            0..=2 => 2.0 * (s.tip_m[i] - mean[i]),
            3 => 2.0 * (s.travel_m - travel),
            _ => -1.0,
        }
    });
    let right = DVector::from_fn(rows, |k, _| {
        let s = &samples[k];
        (s.tip_m - mean).norm_squared() - (s.travel_m - travel).powi(2)
    });
    let solution = matrix.svd(true, true).solve(&right, 1e-9).ok()?;
    let found = Vector3::new(solution[0], solution[1], solution[2]) + mean;
    found.iter().all(|v| v.is_finite()).then_some(found)
}

/// A load cell's gain and axis from a run.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisEstimate {
    /// Axis, unit vector from the unit to the workspace, base frame.
    pub axis: Vector3<f64>,
    /// Its covariance, rad^2.
    pub covariance: Matrix3<f64>,
    /// Cell reading over the force along the axis: 1 where the gain is right.
    pub gain: f64,
    /// Standard deviation of the gain.
    pub gain_sd: f64,
    /// Standard deviation of the axis in its worst direction, rad.
    pub worst_sd_rad: f64,
    /// Whether that is below the limit given.
    pub observed: bool,
    /// Singular values of the whitened Jacobian, largest first.
    pub singular_values: [f64; 3],
}

/// Gain and axis of a load cell from its readings (`cell_n`, N, zero taken off), tensions known independently of the
/// cell and the exit point (m).
///
/// `sd_n` is the standard deviation of one cell reading less the projected tension, N, errors of the tension included;
/// `observable_sd_rad` the limit for [`AxisEstimate::observed`]. The error of the exit point is not in the covariance:
/// 1 mm at 0.4 m of cable turns the axis by 0.14 degrees.
///
/// # Errors
/// [`SelfCalibrationError`]; a tip that sees the unit from one direction only gives
/// [`SelfCalibrationError::NotObservable`].
pub fn axis(
    samples: &[Sample],
    cell_n: &[f64],
    exit_m: &Vector3<f64>,
    sd_n: f64,
    observable_sd_rad: f64,
) -> Result<AxisEstimate, SelfCalibrationError> {
    check(samples, &Prior::default())?;
    for (name, value) in [("sd_n", sd_n), ("observable_sd_rad", observable_sd_rad)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(SelfCalibrationError::BadPrior {
                name,
                value,
                zero: false,
            });
        }
    }
    if cell_n.len() != samples.len() {
        return Err(SelfCalibrationError::TooFew { got: cell_n.len() });
    }
    if let Some(sample) = cell_n.iter().position(|f| !f.is_finite()) {
        return Err(SelfCalibrationError::NotFinite {
            sample,
            what: "the cell's force",
        });
    }
    let mean = samples.iter().map(|s| s.tip_m).sum::<Vector3<f64>>() / samples.len() as f64;
    let not_observable = || SelfCalibrationError::NotObservable {
        extent_mm: extent_mm(samples, &mean),
    };
    let mut jacobian = DMatrix::zeros(samples.len(), 3);
    for (k, s) in samples.iter().enumerate() {
        let direction = (exit_m - s.tip_m)
            .try_normalize(1e-6)
            .ok_or_else(not_observable)?;
        for i in 0..3 {
            jacobian[(k, i)] = -s.tension_n * direction[i] / sd_n;
        }
    }
    let measured = DVector::from_iterator(cell_n.len(), cell_n.iter().map(|f| f / sd_n));
    let svd = jacobian.clone().svd(true, true);
    let largest = svd.singular_values.max();
    let told = svd.singular_values.min() > 1e-9 * largest;
    if !told {
        return Err(not_observable());
    }
    let solution = svd.solve(&measured, 0.0).map_err(|_| not_observable())?;
    let scaled = Vector3::new(solution[0], solution[1], solution[2]);
    let gain = scaled.norm();
    let axis = scaled.try_normalize(1e-12).ok_or_else(not_observable)?;
    let normal = jacobian.transpose() * jacobian;
    let covariance: Matrix3<f64> = normal
        .fixed_view::<3, 3>(0, 0)
        .into_owned()
        .try_inverse()
        .ok_or_else(not_observable)?;
    let across = (Matrix3::identity() - axis * axis.transpose()) / gain;
    let axis_covariance = across * covariance * across.transpose();
    let worst_sd_rad = SymmetricEigen::new(axis_covariance)
        .eigenvalues
        .max()
        .max(0.0)
        .sqrt();
    let mut singular_values: [f64; 3] = [0, 1, 2].map(|i| svd.singular_values[i]);
    singular_values.sort_by(|a, b| b.total_cmp(a));
    Ok(AxisEstimate {
        axis,
        covariance: axis_covariance,
        gain,
        gain_sd: (axis.transpose() * covariance * axis)[0].sqrt(),
        worst_sd_rad,
        observed: worst_sd_rad <= observable_sd_rad,
        singular_values,
    })
}

/// Two independent estimates of a position joined by their information (inverse covariances): position in m and
/// covariance in m^2. `None` where a covariance can't be inverted.
#[must_use]
pub fn fuse(
    a: (&Vector3<f64>, &Matrix3<f64>),
    b: (&Vector3<f64>, &Matrix3<f64>),
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let information_a = a.1.try_inverse()?;
    let information_b = b.1.try_inverse()?;
    let covariance = (information_a + information_b).try_inverse()?;
    let mean = covariance * (information_a * a.0 + information_b * b.0);
    mean.iter()
        .all(|v| v.is_finite())
        .then_some((mean, covariance))
}

/// Whether the rig stands where its calibration says.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// p-value that all units stand where they stood: small means moved.
    pub p: f64,
    /// Unit, displacement (m) and p-value, in the order given.
    pub units: Vec<(u8, Vector3<f64>, f64)>,
    /// What moved.
    pub verdict: MovedVerdict,
}

/// What moved since the calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum MovedVerdict {
    /// Nothing that this run shows.
    Unmoved,
    /// These units.
    Units(Vec<u8>),
    /// All units as one body against the robot (or the robot against them): translation of their centre, m, and
    /// rotation, rad.
    Body {
        /// Translation of the units' centre, m.
        translation_m: Vector3<f64>,
        /// Rotation vector, rad.
        rotation_rad: Vector3<f64>,
    },
}

/// A unit's displacement and how well it is known.
struct Displacement {
    unit: u8,
    from_m: Vector3<f64>,
    by_m: Vector3<f64>,
    /// Inverse covariance of `by_m`, 1/m^2.
    information: Matrix3<f64>,
}

impl Displacement {
    fn chi_square(&self) -> f64 {
        (self.by_m.transpose() * self.information * self.by_m)[0]
    }
}

/// Compares exit points from a run with the stored ones by chi-square, at the level `alpha` (0.001: one false alarm in
/// 1,000 runs). Units that moved one by one and a rig that moved as a body are told apart by the Bayesian information
/// criterion. `found` is matched to `stored` by unit number; units without a partner are left out. Correlations between
/// units are not used.
#[must_use]
pub fn moved(stored: &[UnitGeometry], found: &[(u8, ExitEstimate)], alpha: f64) -> Moved {
    let mut pairs: Vec<Displacement> = Vec::new();
    for (unit, estimate) in found {
        let Some(old) = stored.iter().find(|s| s.unit == *unit) else {
            continue;
        };
        let covariance = old.exit_covariance_m2() + estimate.covariance_m2;
        if let Some(information) = covariance.try_inverse() {
            pairs.push(Displacement {
                unit: *unit,
                from_m: old.exit_m,
                by_m: estimate.exit_m - old.exit_m,
                information,
            });
        }
    }
    let total: f64 = pairs.iter().map(Displacement::chi_square).sum();
    let units: Vec<(u8, Vector3<f64>, f64)> = pairs
        .iter()
        .map(|d| {
            (
                d.unit,
                d.by_m,
                stats::chi_square_survival(d.chi_square(), 3),
            )
        })
        .collect();
    let p = stats::chi_square_survival(total, 3 * pairs.len());
    // One unit that moved is diluted among six: look at the worst as well, Bonferroni over both looks.
    let worst = units.iter().map(|u| u.2).fold(1.0, f64::min) * pairs.len() as f64;
    if p.min(worst) >= 0.5 * alpha {
        return Moved {
            p,
            units,
            verdict: MovedVerdict::Unmoved,
        };
    }
    let observations = (3 * pairs.len()) as f64;
    let movers: Vec<usize> = (0..pairs.len())
        .filter(|&i| units[i].2 * (pairs.len() as f64) < 0.5 * alpha.max(0.01))
        .collect();
    let left: f64 = (0..pairs.len())
        .filter(|i| !movers.contains(i))
        .map(|i| pairs[i].chi_square())
        .sum();
    let single = left + 3.0 * movers.len() as f64 * observations.ln();
    let body = rigid(&pairs);
    let verdict = match body {
        Some((translation_m, rotation_rad, left)) if left + 6.0 * observations.ln() < single => {
            MovedVerdict::Body {
                translation_m,
                rotation_rad,
            }
        }
        _ => MovedVerdict::Units(movers.iter().map(|&i| pairs[i].unit).collect()),
    };
    Moved { p, units, verdict }
}

/// Small rigid motion of all units about their centre that explains the displacements best, and the chi-square it leaves.
fn rigid(pairs: &[Displacement]) -> Option<(Vector3<f64>, Vector3<f64>, f64)> {
    if pairs.len() < 3 {
        return None;
    }
    let center = pairs.iter().map(|p| p.from_m).sum::<Vector3<f64>>() / pairs.len() as f64;
    let mut normal = nalgebra::Matrix6::zeros();
    let mut right = nalgebra::Vector6::zeros();
    let jacobian = |at: &Vector3<f64>| {
        let mut j = nalgebra::Matrix3x6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&Matrix3::identity());
        j.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-crate::se3::skew(&(at - center)));
        j
    };
    for d in pairs {
        let j = jacobian(&d.from_m);
        normal += j.transpose() * d.information * j;
        right += j.transpose() * d.information * d.by_m;
    }
    let step = normal.cholesky()?.solve(&right);
    let left = pairs
        .iter()
        .map(|d| {
            let r = d.by_m - jacobian(&d.from_m) * step;
            (r.transpose() * d.information * r)[0]
        })
        .sum();
    Some((
        Vector3::new(step[0], step[1], step[2]),
        Vector3::new(step[3], step[4], step[5]),
        left,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing::{normal, normal3, CENTER_M, UNITS};
    use nalgebra::SMatrix;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn run(
        seed: u64,
        unit: usize,
        count: usize,
        reach_m: [f64; 3],
        prior: &Prior,
        shift: Vector3<f64>,
    ) -> Vec<Sample> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let exit = Vector3::from(UNITS[unit].0) + shift;
        let scale = prior.scale_sd * normal(&mut rng);
        let compliance = prior.compliance_m_per_n + prior.compliance_sd_m_per_n * normal(&mut rng);
        (0..count)
            .map(|_| {
                let tip = Vector3::from(CENTER_M)
                    + Vector3::from_fn(|i, _| reach_m[i] * rng.random_range(-1.0..1.0));
                let tension_n = rng.random_range(2.0..12.0);
                let length = (exit - tip).norm();
                Sample {
                    tip_m: tip + normal3(&mut rng) * prior.tip_sd_m,
                    travel_m: (length - 0.4 - compliance * tension_n) / (1.0 + scale)
                        + prior.travel_sd_m * normal(&mut rng),
                    tension_n,
                }
            })
            .collect()
    }

    const REACH: [f64; 3] = [0.07, 0.07, 0.07];

    #[test]
    fn exit_points_are_found_within_2_mm_and_covered() {
        let prior = Prior::default();
        let (mut within, mut covered, mut p_low) = (0, 0, 0);
        for seed in 0..30 {
            for (unit, (exit, _)) in UNITS.iter().enumerate() {
                // 30 s at 100 Hz. With 400 samples a quarter is beyond 2 mm, along the cable.
                let samples = run(seed, unit, 3000, REACH, &prior, Vector3::zeros());
                let found = exit_point(&samples, &prior, None).unwrap();
                let error = found.exit_m - Vector3::from(*exit);
                within += u32::from(error.norm() < 0.002);
                let inverse = found.covariance_m2.try_inverse().unwrap();
                let square = (error.transpose() * inverse * error)[0];
                covered += u32::from(square < 7.814_727_903);
                p_low += u32::from(found.p() < 0.05);
            }
        }
        assert!(within >= 171, "{within}");
        // Binomial(180, 0.95): 171 +- 2.9; Binomial(180, 0.05): 9 +- 2.9.
        assert!((159..=180).contains(&covered), "{covered}");
        assert!((1..=21).contains(&p_low), "{p_low}");
    }

    #[test]
    fn jacobian_matches_finite_differences() {
        let prior = Prior::default();
        let samples = run(1, 2, 20, REACH, &prior, Vector3::zeros());
        let model = Model {
            samples: &samples,
            prior: &prior,
            sd: 2e-4,
        };
        let x = DVector::from_vec(vec![0.1, 0.4, -0.2, 0.41, 1e-3, 2e-5]);
        let (jacobian, _) = model.linearise(&x);
        for i in 0..UNKNOWNS {
            let h = 1e-6;
            let mut step = DVector::zeros(UNKNOWNS);
            step[i] = h;
            for (k, s) in samples.iter().enumerate() {
                let slope = (model.residual(&(&x + &step), s) - model.residual(&(&x - &step), s))
                    / (2.0 * h);
                assert!((slope - jacobian[(k, i)]).abs() < 1e-4 * (1.0 + slope.abs()));
            }
        }
    }

    #[test]
    fn what_a_run_does_not_tell_is_reported() {
        let prior = Prior::default();
        // The tip moves along the cable of unit 1 (roughly x) only: nothing across it.
        let samples = run(1, 0, 400, [0.07, 1e-5, 1e-5], &prior, Vector3::zeros());
        let start = Some(Vector3::from(UNITS[0].0));
        match exit_point(&samples, &prior, start) {
            Ok(found) => {
                assert!(found.unobserved().len() >= 2, "{:?}", found.directions);
                assert!(found.singular_values[3] < 1e-3 * found.singular_values[0]);
            }
            Err(error) => assert!(matches!(error, SelfCalibrationError::NotObservable { .. })),
        }
        // A scale that is not known costs; the distance along the cable is what is known worst.
        let exact = Prior {
            scale_sd: 0.0,
            ..prior
        };
        let vague = Prior {
            scale_sd: 0.05,
            ..prior
        };
        let samples = run(1, 0, 400, REACH, &exact, Vector3::zeros());
        let loose = exit_point(&samples, &vague, None).unwrap();
        let tight = exit_point(&samples, &exact, None).unwrap();
        assert!(loose.covariance_m2.trace() > tight.covariance_m2.trace());
        assert_eq!(tight.scale.abs() < 1e-6, loose.scale.abs() > 1e-6);
        let along = (Vector3::from(UNITS[0].0) - Vector3::from(CENTER_M)).normalize();
        assert!(loose.directions[2].direction.dot(&along).abs() > 0.95);
    }

    #[test]
    fn axes_follow_from_independent_tensions() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut covered = 0;
        for seed in 0..200 {
            let samples = run(seed, 3, 400, REACH, &Prior::default(), Vector3::zeros());
            let exit = Vector3::from(UNITS[3].0);
            let truth = Vector3::from(UNITS[3].1).normalize();
            let cell: Vec<f64> = samples
                .iter()
                .map(|s| {
                    1.02 * s.tension_n * truth.dot(&(s.tip_m - exit).normalize())
                        + 0.02 * normal(&mut rng)
                })
                .collect();
            let found = axis(&samples, &cell, &exit, 0.02, 0.0087).unwrap();
            assert!(found.observed && (found.gain - 1.02).abs() < 0.005);
            // Two degrees of freedom across the axis.
            let error = found.axis - truth;
            let eigen = SymmetricEigen::new(found.covariance);
            let square: f64 = (0..3)
                .filter(|&i| eigen.eigenvalues[i] > 1e-3 * eigen.eigenvalues.max())
                .map(|i| error.dot(&eigen.eigenvectors.column(i)).powi(2) / eigen.eigenvalues[i])
                .sum();
            covered += u32::from(square < 5.991);
        }
        // Binomial(200, 0.95): 190 +- 3.1.
        assert!((178..=200).contains(&covered), "{covered}");
        let still = vec![
            Sample {
                tip_m: Vector3::from(CENTER_M),
                travel_m: 0.0,
                tension_n: 3.0
            };
            20
        ];
        let flat = axis(&still, &[3.0; 20], &Vector3::from(UNITS[3].0), 0.02, 0.01);
        assert!(matches!(
            flat,
            Err(SelfCalibrationError::NotObservable { .. })
        ));
    }

    #[test]
    fn joining_two_estimates_is_better_than_either() {
        let (a, b) = (Vector3::new(1.0, 0.0, 0.0), Vector3::new(2.0, 0.0, 0.0));
        let ca = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 4.0));
        let cb = Matrix3::from_diagonal(&Vector3::new(1.0, 3.0, 4.0));
        let (mean, covariance) = fuse((&a, &ca), (&b, &cb)).unwrap();
        assert!((mean.x - 1.5).abs() < 1e-12);
        assert!(
            (covariance - Matrix3::from_diagonal(&Vector3::new(0.5, 0.75, 2.0))).norm() < 1e-12
        );
        assert!(fuse((&a, &Matrix3::zeros()), (&b, &cb)).is_none());
    }

    fn stored() -> Vec<UnitGeometry> {
        (0..6)
            .map(|i| UnitGeometry {
                unit: i as u8 + 1,
                exit_m: Vector3::from(UNITS[i].0),
                axis: Vector3::from(UNITS[i].1),
                covariance: SMatrix::identity() * 4e-8,
            })
            .collect()
    }

    fn found(seed: u64, shift: impl Fn(usize) -> Vector3<f64>) -> Vec<(u8, ExitEstimate)> {
        let prior = Prior::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed + 1000);
        (0..6)
            .map(|i| {
                // The stored position has its own error, 0.2 mm in each coordinate.
                let shift = shift(i) + normal3(&mut rng) * 2e-4;
                let samples = run(100 * seed + i as u64, i, 300, REACH, &prior, shift);
                (i as u8 + 1, exit_point(&samples, &prior, None).unwrap())
            })
            .collect()
    }

    #[test]
    fn a_moved_unit_and_a_moved_rig_are_told() {
        let quiet = (0..60)
            .filter(|&s| {
                moved(&stored(), &found(s, |_| Vector3::zeros()), 0.01).verdict
                    != MovedVerdict::Unmoved
            })
            .count();
        // 0.6 expected at 1 %.
        assert!(quiet <= 4, "{quiet}");
        let one = moved(
            &stored(),
            &found(1, |i| {
                if i == 2 {
                    Vector3::new(0.004, 0.0, 0.0)
                } else {
                    Vector3::zeros()
                }
            }),
            0.001,
        );
        assert_eq!(one.verdict, MovedVerdict::Units(vec![3]));
        let shift = Vector3::new(0.003, -0.002, 0.004);
        match moved(&stored(), &found(2, |_| shift), 0.001).verdict {
            MovedVerdict::Body { translation_m, .. } => {
                assert!((translation_m - shift).norm() < 1e-3)
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn bad_input_is_an_error() {
        let prior = Prior::default();
        let good = run(1, 0, 30, REACH, &prior, Vector3::zeros());
        assert!(matches!(
            exit_point(&good[..4], &prior, None),
            Err(SelfCalibrationError::TooFew { got: 4 })
        ));
        let mut nan = good.clone();
        nan[7].travel_m = f64::NAN;
        assert!(matches!(
            exit_point(&nan, &prior, None),
            Err(SelfCalibrationError::NotFinite { sample: 7, .. })
        ));
        let bad = Prior {
            travel_sd_m: 0.0,
            ..prior
        };
        assert!(matches!(
            exit_point(&good, &bad, None),
            Err(SelfCalibrationError::BadPrior { .. })
        ));
        let still = vec![good[0]; 30];
        let result = exit_point(&still, &prior, None);
        assert!(result.map_or(true, |r| !r.unobserved().is_empty()));
        assert!(axis(&good, &[1.0; 3], &Vector3::zeros(), 0.1, 0.1).is_err());
    }
}
