//! The UR10e of Mamedov and Mikhel: 100 Hz, positions, velocities, motor currents.
//!
//! Currents become torques by the controller's own wanted torques per wanted currents at
//! standstill, in logs without a load. So no gain is taken from the loads that are to be estimated.

use crate::chain::{about_x, efforts, jacobian, places, Joint};
use crate::fit::{accelerations, apart, beside, filtered, Filter, Filtered, Linear, Sums};
use crate::log::{read, Columns, Log, LogError};
use estimator::metrics::half_width;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

/// Where the data are to be had.
pub const SOURCE: &str = "https://github.com/shamilmamedov/dynamic_calibration";
const FOLDER: &str = "dataset_ur10e";
const STEP_S: f64 = 0.01;
const JOINTS: usize = 6;
/// Logs of excitation without a load.
pub const UNLOADED: [&str; 13] = [
    "identification_data/ur-19_12_23_free.csv",
    "validation_data/ur-20_01_17-ptp_10_points.csv",
    "identification_data/ur-20_01_31-unload.csv",
    "identification_data/ur-20_02_05-20sec_8harm.csv",
    "identification_data/ur-20_02_05-20sec_12harm.csv",
    "identification_data/ur-20_02_06-20sec_5harm.csv",
    "identification_data/ur-20_02_06-20sec_10harm.csv",
    "identification_data/ur-20_02_10-20sec_7harm.csv",
    "identification_data/ur-20_02_10-30sec_12harm.csv",
    "identification_data/ur-20_02_12-40sec_12harm.csv",
    "identification_data/ur-20_02_12-50sec_12harm.csv",
    "identification_data/ur-20_02_19_14harm50sec.csv",
    "identification_data/ur-20_02_19_15harm50sec.csv",
];
/// Logs with a load, and its mass where the repository tells it, kg: in the file's name, or in the
/// script that uses the file.
pub const LOADED: [(&str, Option<f64>); 4] = [
    ("identification_data/ur-20_01_13-load_2600.csv", Some(2.6)),
    ("identification_data/ur-20_01_31-load.csv", None),
    (
        "identification_data/ur-20_02_19_14harm50secLoad.csv",
        Some(2.805),
    ),
    ("identification_data/ur-20_02_19_15harm50secLoad.csv", None),
];
/// Lengths of the links by the maker, m: along z, then along x, then a turn about x, rad.
const LINKS: [(f64, f64, f64); JOINTS] = [
    (0.1807, 0.0, FRAC_PI_2),
    (0.0, -0.6127, 0.0),
    (0.0, -0.571_55, 0.0),
    (0.174_15, 0.0, FRAC_PI_2),
    (0.119_85, 0.0, -FRAC_PI_2),
    (0.116_55, 0.0, 0.0),
];
/// Speed at which Coulomb friction has most of its size, rad/s. Estimate.
const SLIDES: f64 = 0.02;
/// Force and moment about the flange before anything is known, standard deviations, N and N·m: a
/// tool of the arm's size, 0.1 m from the flange.
const PRIOR: [f64; 2] = [30.0, 3.0];

const fn columns() -> Columns {
    Columns {
        count: 31,
        position: 1,
        rate: 7,
        effort: 13,
        joints: JOINTS,
        // Two turns of a joint; twice its greatest speed; above any current of these logs.
        beyond: [12.6, 6.3, 60.0],
        clone: SOURCE,
    }
}

/// The arm.
#[must_use]
pub fn chain() -> Vec<Joint> {
    let mut before = (Matrix3::identity(), Vector3::zeros());
    let mut out = Vec::with_capacity(JOINTS);
    for (along_z, along_x, turn) in LINKS {
        out.push(Joint {
            turn: before.0,
            way: before.1,
            slides: false,
        });
        before = (about_x(turn), Vector3::new(along_x, 0.0, along_z));
    }
    out
}

/// Flange in the frame of the last link, m.
const FLANGE: Vector3<f64> = Vector3::new(0.0, 0.0, LINKS[JOINTS - 1].0);

/// Masses and inertias of all links; of each joint friction, inertia of the rotor, a constant.
fn physics(q: &[f64], rate: &[f64], acceleration: &[f64]) -> DMatrix<f64> {
    let chain = chain();
    let places = places(&chain, q, rate, acceleration);
    let mut parts: Vec<DMatrix<f64>> = (0..JOINTS).map(|k| efforts(&chain, &places, k)).collect();
    let own: Vec<Vec<f64>> = (0..JOINTS)
        .map(|i| vec![(rate[i] / SLIDES).tanh(), rate[i], acceleration[i], 1.0])
        .collect();
    parts.push(apart(&own));
    beside(&parts)
}

/// Each torque linear in all positions, velocities and directions.
fn linear(q: &[f64], rate: &[f64], _: &[f64]) -> DMatrix<f64> {
    let mut row = vec![1.0];
    row.extend(q);
    row.extend(rate);
    row.extend(rate.iter().map(|v| (v / SLIDES).tanh()));
    apart(&vec![row; JOINTS])
}

/// Torque per current: the controller's wanted ones at standstill. Where a joint holds nothing
/// there, that of its neighbour of the same size.
fn gains(logs: &[Log]) -> [f64; JOINTS] {
    let columns = columns();
    let (current, torque) = (columns.effort + JOINTS, columns.effort + 2 * JOINTS);
    let mut sums = [[0.0; 2]; JOINTS];
    for log in logs {
        let rows = log.cells.iter().zip(&log.rate);
        for (cells, _) in rows.filter(|(_, rate)| rate.iter().all(|v| v.abs() < 1e-3)) {
            for (i, sum) in sums.iter_mut().enumerate() {
                sum[0] += cells[current + i] * cells[torque + i];
                sum[1] += cells[current + i] * cells[current + i];
            }
        }
    }
    let mut gains = sums.map(|[product, square]| product / f64::max(square, 1e-12));
    gains[0] = gains[1];
    gains[5] = gains[4];
    gains
}

/// Force errors of a log.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// Log.
    pub name: String,
    /// Mass, kg, where it is told; 0 without a load.
    pub mass_kg: Option<f64>,
    /// Mean absolute error of each component, N, where the mass is told.
    pub mae_n: Option<[f64; 3]>,
    /// The same of an estimate that is always 0.
    pub zero_n: Option<[f64; 3]>,
    /// Vertical force over the vertical acceleration that it holds: least squares, kg.
    pub weighed_kg: f64,
}

/// The force at the flange row by row, and that of a body of 1 kg there, N.
fn forces(log: &Log, filtered: &Filtered, model: &Linear) -> Vec<[Vector3<f64>; 2]> {
    let chain = chain();
    let mut filter = Filter::new(log.step_s);
    let mut rows = filtered.row.iter().zip(model.left(filtered)).peekable();
    let weights = DMatrix::from_diagonal(&DVector::from_iterator(
        JOINTS,
        model.deviation.iter().map(|sd| sd.powi(-2)),
    ));
    let prior = DMatrix::from_diagonal(&DVector::from_fn(6, |i, _| PRIOR[i / 3].powi(-2)));
    let mut out = Vec::new();
    for row in 0..log.position.len() {
        let acceleration = accelerations(log, row);
        let places = places(&chain, &log.position[row], &log.rate[row], &acceleration);
        let last = places[JOINTS - 1];
        let way = last.turn * FLANGE;
        let [spin, more] = last.spin;
        let holds = last.acceleration + more.cross(&way) + spin.cross(&spin.cross(&way));
        let turns = jacobian(&chain, &places, &(last.origin + way));
        // Filtered as the torques are.
        let both = DMatrix::from_fn(6, JOINTS + 1, |i, j| {
            if j < JOINTS {
                turns[(i, j)]
            } else if i < 3 {
                holds[i]
            } else {
                0.0
            }
        });
        let both = filter.step(&both);
        if let Some((_, left)) = rows.next_if(|(at, _)| **at == row) {
            let levers = both.columns(0, JOINTS).transpose();
            let information = levers.transpose() * &weights * &levers + &prior;
            let evidence = levers.transpose() * &weights * left;
            let wrench = information.cholesky().map(|c| c.solve(&evidence));
            let wrench = wrench.unwrap_or_else(|| DVector::zeros(6));
            let force = Vector3::new(wrench[0], wrench[1], wrench[2]);
            let holds = Vector3::new(both[(0, JOINTS)], both[(1, JOINTS)], both[(2, JOINTS)]);
            out.push([force, holds]);
        }
    }
    out
}

fn score(log: &Log, filtered: &Filtered, model: &Linear, mass_kg: Option<f64>) -> Loaded {
    let forces = forces(log, filtered, model);
    let rows = forces.len() as f64;
    let mae = |error: &dyn Fn(&[Vector3<f64>; 2]) -> Vector3<f64>| -> [f64; 3] {
        let sum: Vector3<f64> = forces.iter().map(|row| error(row).abs()).sum();
        (sum / rows).into()
    };
    let sum = |of: &dyn Fn(&[Vector3<f64>; 2]) -> f64| forces.iter().map(of).sum::<f64>();
    Loaded {
        name: log.name.clone(),
        mass_kg,
        mae_n: mass_kg.map(|kg| mae(&|[force, holds]| force - holds * kg)),
        zero_n: mass_kg.map(|kg| mae(&|[_, holds]| holds * kg)),
        weighed_kg: sum(&|[force, holds]| force.z * holds.z) / sum(&|[_, holds]| holds.z.powi(2)),
    }
}

/// A model of the torques.
#[derive(Debug, Clone)]
pub struct Model {
    /// For people.
    pub name: &'static str,
    /// Torque that is left on each log that was left out of the training, RMS by joint, N·m.
    pub left: [f64; JOINTS],
    /// Length of the force that is estimated where there is none, each log left out of the
    /// training: mean over logs, N, and half of its 95 % interval.
    pub none_n: (f64, Option<f64>),
    /// Logs with a load, by the model of all without.
    pub loaded: Vec<Loaded>,
}

/// What the data give.
#[derive(Debug, Clone)]
pub struct Results {
    /// Torque per current, N·m/A.
    pub gains: [f64; JOINTS],
    /// Rows that were dropped, by log.
    pub dropped: Vec<(String, usize)>,
    /// Physics, linear.
    pub models: Vec<Model>,
}

/// Computes all figures from a clone.
///
/// # Errors
/// [`LogError`]: a log isn't there or can't be used.
pub fn compute(clone: &Path, progress: &mut dyn FnMut(&str)) -> Result<Results, LogError> {
    let folder = clone.join(FOLDER);
    let open = |name: &str| read(&folder, name, STEP_S, &columns());
    let unloaded: Vec<Log> = UNLOADED.iter().map(|n| open(n)).collect::<Result<_, _>>()?;
    let loaded: Vec<Log> = (LOADED.iter().map(|(n, _)| open(n))).collect::<Result<_, _>>()?;
    let gains = gains(&unloaded);
    let mut models = Vec::new();
    let kinds: [(&'static str, crate::fit::Basis); 2] =
        [("physics", &physics), ("linear", &linear)];
    for (name, basis) in kinds {
        progress(&format!("UR10e: {name}"));
        let rows: Vec<Filtered> = unloaded
            .iter()
            .map(|log| filtered(log, &gains, basis))
            .collect();
        let sums: Vec<Sums> = rows.iter().map(Sums::of).collect();
        let without = |left_out: Option<usize>| {
            let parts = sums.iter().enumerate();
            let parts: Vec<&Sums> = parts
                .filter(|(n, _)| Some(*n) != left_out)
                .map(|(_, sums)| sums)
                .collect();
            Sums::total(&parts).fit()
        };
        let (mut squares, mut count, mut none_n) = ([0.0; JOINTS], 0.0, Vec::new());
        for (n, log) in unloaded.iter().enumerate() {
            let Some(model) = without(Some(n)) else {
                continue;
            };
            for left in model.left(&rows[n]) {
                count += 1.0;
                for i in 0..JOINTS {
                    squares[i] += left[i] * left[i];
                }
            }
            let forces = forces(log, &rows[n], &model);
            let length: f64 = forces.iter().map(|[force, _]| force.norm()).sum();
            none_n.push(length / forces.len() as f64);
        }
        let mean = none_n.iter().sum::<f64>() / none_n.len() as f64;
        let Some(model) = without(None) else { continue };
        models.push(Model {
            name,
            left: squares.map(|s: f64| (s / count).sqrt()),
            none_n: (mean, half_width(&none_n)),
            loaded: loaded
                .iter()
                .zip(LOADED)
                .map(|(log, (_, kg))| score(log, &filtered(log, &gains, basis), &model, kg))
                .collect(),
        });
    }
    let dropped = unloaded.iter().chain(&loaded);
    let dropped = dropped
        .filter(|log| log.dropped > 0)
        .map(|log| (log.name.clone(), log.dropped));
    Ok(Results {
        gains,
        dropped: dropped.collect(),
        models,
    })
}
