//! Calibrations of made-up rigs whose truth is hidden from the code under test: how large the errors are and how often the
//! stated intervals hold. Used by `examples/monte_carlo.rs` (many draws) and `tests/monte_carlo.rs` (few).

// Each of the programs that include this file uses a part of it.
#![allow(dead_code)]

use super::scene::{self, normal as gauss, normal3 as gauss3, Scene, CENTER_M};
use calibration::gain::{self, Direction, Gain, Reading, WEIGHTS_G};
use calibration::geometry::{self, GeometryError, UnitGeometry};
use calibration::input::Location;
use calibration::self_calibration::{self, Prior, Sample};
use calibration::uncertainty::{self, Geometry, UnitInput};
use calibration::zero::{self, Limits};
use calibration::{stats, STANDARD_GRAVITY_M_PER_S2};
use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Standard deviation of the digitizer in one coordinate, m.
pub const DIGITIZER_SD_M: f64 = 2e-4;
/// Limit of the weights' relative error.
pub const WEIGHT_LIMIT: f64 = 1e-3;
/// Relative standard uncertainty of the local gravity: looked up for the place.
pub const GRAVITY_SD: f64 = 1e-4;

/// Errors and whether the interval stated with each holds.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Size of each error.
    pub errors: Vec<f64>,
    /// Largest error of each draw.
    pub worst_of_draw: Vec<f64>,
    /// Intervals that hold the truth.
    pub hits: usize,
    /// Intervals stated.
    pub intervals: usize,
}

impl Tally {
    fn add(&mut self, error: f64) {
        self.errors.push(error);
        if let Some(worst) = self.worst_of_draw.last_mut() {
            *worst = worst.max(error);
        }
    }

    fn new_draw(&mut self) {
        self.worst_of_draw.push(0.0);
    }

    fn interval(&mut self, holds: bool) {
        self.hits += usize::from(holds);
        self.intervals += 1;
    }

    /// Part of the errors that are below a limit.
    pub fn within(&self, limit: f64) -> f64 {
        part(&self.errors, limit)
    }

    /// Part of the draws whose largest error is below a limit.
    pub fn draws_within(&self, limit: f64) -> f64 {
        part(&self.worst_of_draw, limit)
    }

    /// The error that 95 % stay below.
    pub fn p95(&self) -> f64 {
        let mut sorted = self.errors.clone();
        sorted.sort_by(f64::total_cmp);
        sorted
            .get(sorted.len() * 95 / 100)
            .copied()
            .unwrap_or(f64::NAN)
    }

    /// Root mean square.
    pub fn rms(&self) -> f64 {
        (self.errors.iter().map(|e| e * e).sum::<f64>() / self.errors.len() as f64).sqrt()
    }

    /// Part of the 95 % intervals that hold the truth.
    pub fn coverage(&self) -> f64 {
        self.hits as f64 / self.intervals as f64
    }
}

fn part(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|v| **v < limit).count() as f64 / values.len() as f64
}

/// One load cell of a draw.
#[derive(Debug, Clone, Copy)]
struct Cell {
    n_per_code: f64,
    noise_sd_n: f64,
    zero_code: f64,
}

/// Errors of gains and zeros.
#[derive(Debug, Clone, Default)]
pub struct CellFigures {
    /// Relative error of the gain.
    pub gain: Tally,
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

/// Gains (weights +-0.1 %, twice up and down, 1 s each) and zeros (10 s at 320 SPS with spikes and drift) of six cells a
/// draw. Noise 1.7 to 5 mN a sample as the idle channels of the rig, correlated from one sample to the next.
pub fn cells(draws: u64) -> CellFigures {
    let mut out = CellFigures::default();
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0xCE11 + draw);
        out.gain.new_draw();
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
            };
            match gain::fit(&series(&cell, &weights, gravity, &mut rng), &gain_options()) {
                Ok(found) => {
                    let error = found.n_per_code - cell.n_per_code;
                    out.gain.add(error.abs() / cell.n_per_code);
                    out.gain.interval(error.abs() < found.n_per_code_half_95);
                    *gain = Some((found, cell.n_per_code));
                }
                Err(_) => out.false_names += 1,
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
                Err(_) => out.zeros_refused += 1,
            }
        }
        out.gains.push(gains);
        out.zeros.push(zeros);
    }
    out
}

fn gain_options() -> gain::Options {
    gain::Options {
        gravity_relative_sd: GRAVITY_SD,
        weight_limit_relative: WEIGHT_LIMIT,
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
            // Mean of 320 samples, each as correlated as `stream` makes them; putting a weight on repeats to 1 mN.
            let se_n = cell.noise_sd_n * (1.3f64 / 0.7 / 320.0).sqrt();
            let force = 1e-3 * weights[i] * gravity + se_n * gauss(rng) + 0.001 * gauss(rng);
            out.push(Reading {
                at: Location {
                    file: "weights.csv".into(),
                    line: out.len() + 2,
                },
                weight_g: WEIGHTS_G[i],
                code: cell.zero_code + force / cell.n_per_code,
                standard_error_codes: se_n / cell.n_per_code,
                direction: Some(direction),
                time_s: None,
                temperature_c: None,
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

/// A survey to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Distance of a plate's holes from its middle, m.
    pub plate_radius_m: f64,
    /// Holes of a plate.
    pub holes: u8,
    /// Whether the last station sees the base too and each unit is seen from two stations.
    pub closed: bool,
    /// Times that each point is touched from each station.
    pub repeats: usize,
}

/// Errors of one way to estimate.
#[derive(Debug, Clone, Default)]
pub struct Estimator {
    /// Distance of the exit point from the true one, m; intervals are of single coordinates.
    pub position: Tally,
    /// Angle between axis and true axis, rad; intervals are of the two components across it.
    pub axis: Tally,
}

impl Estimator {
    fn new_draw(&mut self) {
        self.position.new_draw();
        self.axis.new_draw();
    }

    fn add(&mut self, unit: &UnitGeometry, exit: &Vector3<f64>, axis: &Vector3<f64>) {
        let error = unit.exit_m - exit;
        self.position.add(error.norm());
        let covariance = unit.exit_covariance_m2();
        for i in 0..3 {
            self.position
                .interval(error[i].abs() < 1.96 * covariance[(i, i)].sqrt());
        }
        let angle = unit.axis.cross(axis).norm().atan2(unit.axis.dot(axis));
        self.axis.add(angle);
        let eigen = SymmetricEigen::new(unit.axis_covariance());
        let largest = eigen.eigenvalues.max();
        for i in 0..3 {
            if eigen.eigenvalues[i] > 1e-6 * largest {
                let along = (unit.axis - axis).dot(&eigen.eigenvectors.column(i));
                self.axis
                    .interval(along.abs() < 1.96 * eigen.eigenvalues[i].sqrt());
            }
        }
    }
}

/// Errors of a layout.
#[derive(Debug, Clone, Default)]
pub struct GeometryFigures {
    /// Joint estimate.
    pub joint: Estimator,
    /// Chain of the thesis.
    pub chain: Estimator,
    /// Draws from the Cramer-Rao bound: what the best unbiased estimate could show.
    pub bound: Estimator,
    /// Surveys that were refused with a fault, though there was none.
    pub false_alarms: usize,
    /// Units and covariances by draw, where the survey was taken.
    pub surveys: Vec<Option<(Vec<UnitGeometry>, DMatrix<f64>)>>,
}

fn survey_options(chain_covariance: bool) -> geometry::Options {
    geometry::Options {
        digitizer_sd_m: DIGITIZER_SD_M,
        workspace_center_m: Some(Vector3::from(CENTER_M)),
        chain_covariance,
        ..geometry::Options::default()
    }
}

/// Surveys over three plates.
pub fn surveys(draws: u64, layout: Layout, chain_covariance: bool) -> GeometryFigures {
    let scene: Scene = scene::layout(3, layout.plate_radius_m, layout.holes, layout.closed);
    let options = survey_options(chain_covariance);
    let exact = scene.measure(0, layout.repeats, 1e-12);
    let bound = geometry::cramer_rao(&exact, &scene.reference, &options).expect("a sound layout");
    let mut out = GeometryFigures::default();
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    for draw in 0..draws {
        let readings = scene.measure(0x5EED + draw, layout.repeats, DIGITIZER_SD_M);
        for e in [&mut out.joint, &mut out.chain, &mut out.bound] {
            e.new_draw();
        }
        for unit in &bound {
            let (exit, axis) = scene.unit(unit.unit);
            let mut drawn = unit.clone();
            let eigen = SymmetricEigen::new(unit.covariance);
            let mut step = nalgebra::Vector6::zeros();
            for i in 0..6 {
                step += eigen.eigenvectors.column(i)
                    * (eigen.eigenvalues[i].max(0.0).sqrt() * gauss(&mut rng));
            }
            drawn.exit_m = exit + step.fixed_rows::<3>(0);
            drawn.axis = (axis + step.fixed_rows::<3>(3)).normalize();
            out.bound.add(&drawn, &exit, &axis);
        }
        match geometry::survey(&readings, &scene.reference, &options) {
            Ok(found) => {
                for unit in &found.units {
                    let (exit, axis) = scene.unit(unit.unit);
                    out.joint.add(unit, &exit, &axis);
                }
                for unit in found.chain.iter().flatten() {
                    let (exit, axis) = scene.unit(unit.unit);
                    out.chain.add(unit, &exit, &axis);
                }
                out.surveys.push(Some((found.units, found.covariance)));
            }
            Err(GeometryError::Faults(_)) => {
                out.false_alarms += 1;
                out.surveys.push(None);
            }
            Err(other) => panic!("{other}"),
        }
    }
    out
}

/// Exit points from runs of `samples` poses within 70 mm of the centre, alone and joined with a survey: distances from the
/// truth, m; intervals are ellipsoids of 95 %.
pub fn runs(draws: u64, samples: usize, surveys: &GeometryFigures) -> (Tally, Tally) {
    let prior = Prior::default();
    let (mut alone, mut fused) = (Tally::default(), Tally::default());
    let limit = stats::chi_square_quantile(0.95, 3);
    let holds = |error: &Vector3<f64>, covariance: &Matrix3<f64>| {
        covariance
            .try_inverse()
            .is_some_and(|w| (error.transpose() * w * error)[0] < limit)
    };
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0xF0F0 + draw);
        alone.new_draw();
        fused.new_draw();
        for unit in 0..6 {
            let exit = Vector3::from(scene::UNITS[unit].0);
            let samples = run(&exit, samples, &prior, &mut rng);
            let Ok(found) = self_calibration::exit_point(&samples, &prior, None) else {
                alone.add(f64::INFINITY);
                alone.interval(false);
                continue;
            };
            let error = found.exit_m - exit;
            alone.add(error.norm());
            alone.interval(holds(&error, &found.covariance_m2));
            let survey = surveys.surveys.get(draw as usize).and_then(Option::as_ref);
            if let Some((units, _)) = survey {
                let other = (&units[unit].exit_m, &units[unit].exit_covariance_m2());
                if let Some((at, covariance)) =
                    self_calibration::fuse((&found.exit_m, &found.covariance_m2), other)
                {
                    fused.add((at - exit).norm());
                    fused.interval(holds(&(at - exit), &covariance));
                }
            }
        }
    }
    (alone, fused)
}

fn run(exit: &Vector3<f64>, count: usize, prior: &Prior, rng: &mut ChaCha8Rng) -> Vec<Sample> {
    let scale = prior.scale_sd * gauss(rng);
    let compliance = prior.compliance_sd_m_per_n * gauss(rng);
    let mut samples = Vec::new();
    while samples.len() < count {
        let offset = Vector3::from_fn(|_, _| rng.random_range(-0.07..0.07));
        if offset.norm() > 0.07 {
            continue;
        }
        let tip = Vector3::from(CENTER_M) + offset;
        let tension_n = rng.random_range(2.0..12.0);
        let length = (exit - tip).norm();
        samples.push(Sample {
            tip_m: tip + gauss3(rng) * prior.tip_sd_m,
            travel_m: (length - 0.4 - compliance * tension_n) / (1.0 + scale)
                + prior.travel_sd_m * gauss(rng),
            tension_n,
        });
    }
    samples
}

/// Error of the force at the tip, N, by what the rig is calibrated with.
#[derive(Debug, Clone, Default)]
pub struct ForceFigures {
    /// Nominal scale, geometry by tape measure (5 mm, 2 degrees), zeros taken.
    pub before: Tally,
    /// Calibrated; intervals are ellipsoids of 95 % about the stated force.
    pub after: Tally,
}

/// Force at the tip believed from the cells' readings against the true one, at random poses and tensions, with gains and
/// zeros of `cells` and geometry of `surveys`.
pub fn forces(draws: u64, cells: &CellFigures, surveys: &GeometryFigures) -> ForceFigures {
    let mut out = ForceFigures::default();
    let limit = stats::chi_square_quantile(0.95, 3);
    for draw in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(0xF0_2CE + draw);
        let index = draw as usize;
        let Some((units, covariance)) = surveys.surveys[index].as_ref() else {
            continue;
        };
        let gains: Option<Vec<_>> = cells.gains[index].iter().cloned().collect();
        let zeros: Option<Vec<_>> = cells.zeros[index].iter().copied().collect();
        let (Some(gains), Some(zeros)) = (gains, zeros) else {
            continue;
        };
        out.before.new_draw();
        out.after.new_draw();
        let tip = Vector3::from(CENTER_M) + Vector3::from_fn(|_, _| rng.random_range(-0.04..0.04));
        let (mut truth, mut nominal) = (Vector3::zeros(), Vector3::zeros());
        let mut inputs = Vec::new();
        let mut common = 0.0;
        for i in 0..6 {
            let exit = Vector3::from(scene::UNITS[i].0);
            let axis = Vector3::from(scene::UNITS[i].1).normalize();
            let d = (exit - tip).normalize();
            let tension = rng.random_range(2.0..12.0);
            truth += d * tension;
            let (found, true_gain) = &gains[i];
            let parts = found.relative_parts;
            // All units were calibrated with the same weights in the same place.
            common = parts.weights.hypot(parts.gravity);
            let code_above_zero = tension * -axis.dot(&d) / true_gain;
            // Before: tape and protractor.
            let tape = exit + gauss3(&mut rng) * 0.005;
            let rough = (axis + gauss3(&mut rng) * 0.035).normalize();
            let d_tape = (tape - tip).normalize();
            nominal += d_tape * (code_above_zero * 6.85e-6 / -rough.dot(&d_tape));
            // After: a zero that reads high by `error` takes it off each reading.
            let cell = found.force_n(code_above_zero) - zeros[i].0;
            let d_now = (units[i].exit_m - tip).normalize();
            inputs.push(UnitInput {
                exit_m: units[i].exit_m,
                axis: units[i].axis,
                tension_n: cell / -units[i].axis.dot(&d_now),
                gain_relative_sd: parts.readings,
                zero_sd_n: zeros[i].1,
                held_sd_n: 0.0,
            });
        }
        let geometry = Geometry {
            covariance: covariance.clone(),
            tip_covariance_m2: Matrix3::zeros(),
        };
        let stated = uncertainty::tip_force(&inputs, &tip, &geometry, common).expect("sound units");
        let error = stated.force_n - truth;
        out.before.add((nominal - truth).norm());
        out.after.add(error.norm());
        let inverse = stated.covariance_n2.try_inverse().expect("a covariance");
        out.after
            .interval((error.transpose() * inverse * error)[0] < limit);
    }
    out
}
