//! Surveys with a digitizer over three plates: joint estimate, chain of the thesis, Cramer-Rao
//! bound.

use crate::scene::{self, normal as gauss, Scene, CENTER_M};
use crate::tally::Tally;
use crate::DIGITIZER_SD_M;
use calibration::geometry::{self, GeometryError, UnitGeometry};
use nalgebra::{DMatrix, SymmetricEigen, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

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

    fn join(&mut self, more: Self) {
        self.position.join(more.position);
        self.axis.join(more.axis);
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
    let drawn: Vec<GeometryFigures> = (0..draws)
        .into_par_iter()
        .map(|draw| one(draw, &scene, &bound, layout, &options))
        .collect();
    drawn
        .into_iter()
        .fold(GeometryFigures::default(), |mut all, one| {
            all.joint.join(one.joint);
            all.chain.join(one.chain);
            all.bound.join(one.bound);
            all.false_alarms += one.false_alarms;
            all.surveys.extend(one.surveys);
            all
        })
}

/// One draw.
fn one(
    draw: u64,
    scene: &Scene,
    bound: &[UnitGeometry],
    layout: Layout,
    options: &geometry::Options,
) -> GeometryFigures {
    let mut out = GeometryFigures::default();
    let mut rng = ChaCha8Rng::seed_from_u64(0xB0_0000 + draw);
    let readings = scene.measure(0x5EED + draw, layout.repeats, DIGITIZER_SD_M);
    for e in [&mut out.joint, &mut out.chain, &mut out.bound] {
        e.new_draw();
    }
    for unit in bound {
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
    match geometry::survey(&readings, &scene.reference, options) {
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
            for e in [&mut out.joint, &mut out.chain] {
                e.position.refused();
                e.axis.refused();
            }
            out.surveys.push(None);
        }
        Err(other) => panic!("{other}"),
    }
    out
}
