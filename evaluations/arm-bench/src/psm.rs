//! The patient-side arm of a da Vinci research kit by Wang and others: the first three joints, with
//! weights of 105 and 205 g.
//!
//! Where the weights were, two pages of the repository with photographs tell to some millimetres. A
//! model of the arm without a weight leaves their static moment; over the lever it is the weight.

use crate::chain::{about_x, about_z, efforts, places, Joint, OF_LINK};
use crate::fit::{apart, beside, filtered, Basis, Filtered, Linear, Sums};
use crate::log::{read, Columns, Log, LogError};
use nalgebra::{DMatrix, DVector, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

/// Where the data are to be had.
pub const SOURCE: &str = "https://github.com/WPI-AIM/dvrk_dynamics_identification";
const JOINTS: usize = 3;
/// From the remote centre back to the zero of the insertion, m (published in the repository's
/// model).
const BACK: f64 = 0.4318;
const FAST_S: f64 = 0.005;
const SLOW_S: f64 = 0.01;
/// Logs without a weight. Other files of such names are copies of these.
pub const UNLOADED: [&str; 3] = [
    "data/psm_simplified/measured_trajectory/one_no_weight_results.csv",
    "data/psm_simplified/measured_trajectory/three_results.csv",
    "data/psm/measured_trajectory/one_results.csv",
];
/// Speeds at which Coulomb friction has most of its size, rad/s, rad/s, m/s. Estimates.
const SLIDES: [f64; JOINTS] = [0.02, 0.02, 0.005];
/// Weights, kg.
pub const WEIGHTS_KG: [f64; 2] = [0.105, 0.205];
/// Where they were, by the files' names.
pub const MOUNTS: [&str; 2] = ["parallel", "insertion"];
/// Ways from the shaft of the parallel link, and from the remote centre, to the weights, m: along
/// the link and across it, by mount and weight, as `external_weights` of the repository tells them.
/// On the insertion the first of the heavier weight is not told, and taken from the lighter.
pub const WAYS_M: [[[f64; 2]; 2]; 2] = [
    [[0.165, 0.020], [0.165, 0.023]],
    [[0.535, 0.024], [0.535, 0.020]],
];
/// The files' words for the speed, and the time between rows, s.
pub const SPEEDS: [(&str, f64); 2] = [("1.0", FAST_S), ("0.5", SLOW_S)];

const fn columns() -> Columns {
    Columns {
        count: 21,
        position: 0,
        rate: 7,
        effort: 14,
        joints: JOINTS,
        // Half a turn; above any speed and effort of these logs.
        beyond: [3.15, 10.0, 100.0],
        clone: SOURCE,
    }
}

/// The arm as a serial chain about its remote centre. The parallelogram turns its links by the
/// pitch as well, so their masses are in those of the chain's.
#[must_use]
pub fn chain() -> [Joint; JOINTS] {
    let joint = |turn, way, slides| Joint { turn, way, slides };
    [
        joint(
            about_x(FRAC_PI_2) * about_z(FRAC_PI_2),
            Vector3::zeros(),
            false,
        ),
        joint(
            about_x(-FRAC_PI_2) * about_z(-FRAC_PI_2),
            Vector3::zeros(),
            false,
        ),
        joint(about_x(FRAC_PI_2), Vector3::new(0.0, BACK, 0.0), true),
    ]
}

/// Masses and inertias; of each joint friction, inertia of the motor, a spring (cables), a
/// constant.
fn physics(q: &[f64], rate: &[f64], acceleration: &[f64]) -> DMatrix<f64> {
    let chain = chain();
    let places = places(&chain, q, rate, acceleration);
    let mut parts: Vec<DMatrix<f64>> = (0..JOINTS).map(|k| efforts(&chain, &places, k)).collect();
    let own: Vec<Vec<f64>> = (0..JOINTS)
        .map(|i| {
            let slides = (rate[i] / SLIDES[i]).tanh();
            vec![slides, rate[i], acceleration[i], q[i], 1.0]
        })
        .collect();
    parts.push(apart(&own));
    beside(&parts)
}

/// Each effort linear in all positions, velocities and directions.
fn linear(q: &[f64], rate: &[f64], _: &[f64]) -> DMatrix<f64> {
    let mut row = vec![1.0];
    row.extend(q);
    row.extend(rate);
    row.extend((0..JOINTS).map(|i| (rate[i] / SLIDES[i]).tanh()));
    apart(&vec![row; JOINTS])
}

/// What the ten numbers of a weight on a link add to the efforts.
fn weight(q: &[f64], rate: &[f64], acceleration: &[f64], link: usize) -> DMatrix<f64> {
    let chain = chain();
    efforts(&chain, &places(&chain, q, rate, acceleration), link)
}

/// What a log with a weight says.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// Mount, of [`MOUNTS`].
    pub mount: usize,
    /// Speed, of [`SPEEDS`].
    pub speed: usize,
    /// Weight, of [`WEIGHTS_KG`].
    pub weight: usize,
    /// Effort that the model without a weight leaves, RMS: N·m, N·m, N.
    pub left: [f64; JOINTS],
    /// Mass that the insertion carries, from its effort along the axis, kg.
    pub carried_kg: f64,
    /// Static moment that turns with the pitch, kg·m.
    pub moment_kg_m: f64,
}

impl Loaded {
    /// Distance of the weight from the shaft about which it turns, m.
    #[must_use]
    pub fn lever_m(&self) -> f64 {
        let [along, across] = WAYS_M[self.mount][self.weight];
        along.hypot(across)
    }
}

/// A model of the efforts.
#[derive(Debug, Clone)]
pub struct Model {
    /// For people.
    pub name: &'static str,
    /// Effort that is left on logs that were left out, RMS: N·m, N·m, N.
    pub left: [f64; JOINTS],
    /// Static moment that is found where there is no weight, each log left out of the training,
    /// kg·m.
    pub none_kg_m: Vec<f64>,
    /// Logs with a weight, by the model of all without.
    pub loaded: Vec<Loaded>,
}

/// Static moment of a weight that turns with the pitch, and the mass that the insertion carries. A
/// link of the parallelogram turns about a shaft of its own, which the yaw moves: so a weight on
/// the yaw's link is fitted beside.
fn found(log: &Log, rows: &Filtered, left: &[DVector<f64>], model: &Linear) -> (f64, f64) {
    // The same filters on what a weight would add.
    let gain = [1.0; JOINTS];
    let on_pitch = filtered(log, &gain, &|q, v, a| {
        beside(&[weight(q, v, a, 1), weight(q, v, a, 0)])
    });
    let carried = filtered(log, &gain, &|q, v, a| weight(q, v, a, 2));
    debug_assert_eq!(rows.row, on_pitch.row);
    let mut normal = DMatrix::zeros(2 * OF_LINK, 2 * OF_LINK);
    let mut right = DVector::zeros(2 * OF_LINK);
    let (mut product, mut square) = (0.0, 0.0);
    for (n, left) in left.iter().enumerate() {
        for i in 0..2 {
            let row = on_pitch.basis[n].row(i).transpose();
            let information = model.deviation[i].powi(-2);
            normal.ger(information, &row, &row, 1.0);
            right.axpy(information * left[i], &row, 1.0);
        }
        let along = carried.basis[n][(2, 0)];
        product += along * left[2];
        square += along * along;
    }
    // 1 kg at 1 m is much: the spread of all numbers beforehand.
    for i in 0..2 * OF_LINK {
        normal[(i, i)] += 1.0;
    }
    let numbers = normal.cholesky().map(|c| c.solve(&right));
    let moment = numbers.map_or(f64::NAN, |n| n.rows(1, 3).norm());
    (moment, product / square)
}

fn rms(left: &[DVector<f64>]) -> [f64; JOINTS] {
    core::array::from_fn(|i| {
        let squares: f64 = left.iter().map(|row| row[i] * row[i]).sum();
        (squares / left.len() as f64).sqrt()
    })
}

/// Computes all figures from a clone.
///
/// # Errors
/// [`LogError`]: a log isn't there or can't be used.
pub fn compute(clone: &Path, progress: &mut dyn FnMut(&str)) -> Result<Vec<Model>, LogError> {
    let unloaded: Vec<Log> = (UNLOADED.iter())
        .map(|name| read(clone, name, FAST_S, &columns()))
        .collect::<Result<_, _>>()?;
    let mut logs = Vec::new();
    for (mount, at) in MOUNTS.iter().enumerate() {
        for (speed, (scale, step_s)) in SPEEDS.iter().enumerate() {
            for (weight, kg) in WEIGHTS_KG.iter().enumerate() {
                let grams = (kg * 1000.0).round();
                let name = format!(
                    "data/psm_simplified/measured_trajectory/one_results_{scale}_scale_{grams}_grams_{at}.csv"
                );
                let log = read(clone, &name, *step_s, &columns())?;
                logs.push((mount, speed, weight, log));
            }
        }
    }
    let gain = [1.0; JOINTS];
    let kinds: [(&'static str, Basis); 2] = [("physics", &physics), ("linear", &linear)];
    let mut models = Vec::new();
    for (name, basis) in kinds {
        progress(&format!("patient-side arm: {name}"));
        let rows: Vec<Filtered> = (unloaded.iter())
            .map(|log| filtered(log, &gain, basis))
            .collect();
        let sums: Vec<Sums> = rows.iter().map(Sums::of).collect();
        let (mut out, mut none_kg_m) = (Vec::new(), Vec::new());
        for (n, log) in unloaded.iter().enumerate() {
            let rest: Vec<&Sums> = (0..sums.len())
                .filter(|k| *k != n)
                .map(|k| &sums[k])
                .collect();
            let Some(model) = Sums::total(&rest).fit() else {
                continue;
            };
            let left = model.left(&rows[n]);
            none_kg_m.push(found(log, &rows[n], &left, &model).0);
            out.extend(left);
        }
        let all: Vec<&Sums> = sums.iter().collect();
        let Some(model) = Sums::total(&all).fit() else {
            continue;
        };
        let loaded = logs
            .iter()
            .map(|(mount, speed, weight, log)| {
                let rows = filtered(log, &gain, basis);
                let left = model.left(&rows);
                let (moment_kg_m, carried_kg) = found(log, &rows, &left, &model);
                Loaded {
                    mount: *mount,
                    speed: *speed,
                    weight: *weight,
                    left: rms(&left),
                    carried_kg,
                    moment_kg_m,
                }
            })
            .collect();
        models.push(Model {
            name,
            left: rms(&out),
            none_kg_m,
            loaded,
        });
    }
    Ok(models)
}
