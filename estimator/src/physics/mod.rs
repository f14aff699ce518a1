//! The physical model: torque balance of each motor, with identified gravity and friction, and a
//! recursive estimate of the force.
//!
//! A motor's torque is what gravity, friction and the contact need:
//!
//! ```text
//! torque = gravity(q) + friction(motion, load) - levers(q) * force          per motor, in the joint's unit
//! ```
//!
//! Gravity and friction are linear in what is identified: gravity in products of the joints' sines
//! and cosines, friction in stop operators (presliding and Coulomb friction with their true
//! hysteresis) of motors and links, their rates (damping of a contact that bends, as in LuGre),
//! their products with the motors' load (load-dependent friction) and with functions that fade with
//! speed (Stribeck, motors and links), and velocity (viscous friction). What loads a gear is the
//! torque less the motor's own friction, of which only the sum with the links' is known beforehand:
//! products with several parts of it let the fit find the part. Links follow their motors with and
//! without the stretch of the cables. Velocities and accelerations have the filter of the torque:
//! with velocities over 0.1 s alone, half of the balance's residual was their difference in delay.
//!
//! What the balance lacks is the contact. It is the first-order disturbance observer of De Luca's
//! kind: filtered torque less filtered model. Each motor then gives one equation for the force;
//! they are weighted by the inverse of their residual variance, which depends on the motor's speed,
//! and summed with an exponential memory. In a dead zone a motor's weight is small and the other
//! motors, the memory, and at last the prior hold the estimate.

mod known;
mod observer;

pub use self::observer::{Observer, Seen};
use crate::geometry::Base;
use crate::model::{Model, ModelError, Stepper};
use crate::motion::{LowPass, Moment, Motion, FADE, FILTER_S, LEVELS, STOPS};
use crate::pieces::{self, Told, Usual};
use crate::recalibration::{effects, Effects, Found, Free, CHANGES, GAIN as GAIN_OF};
use crate::ridge::{Ridge, Sums};
use crate::sequence::Sequence;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

/// Rows at the start of a sequence that no fit uses, s: the stop operators do not yet know their
/// state.
pub const SETTLE_S: f64 = 10.0;
/// Time constant of the memory, s. Shorter is noisier, longer lags: a force that changes by 0.3 N/s
/// is 0.06 N late.
pub const MEMORY_S: f64 = 0.2;
/// Bins of speed for the residual variance of a motor.
const BINS: usize = 8;
/// Stop operator that stands for the direction of sliding in products.
const MIDDLE: usize = 2;
/// Regressors of gravity.
const GRAVITY: usize = 14;
/// Regressors of a motor.
pub const REGRESSORS: usize =
    GRAVITY + 3 + 3 + 3 + 1 + 2 * STOPS + 6 + 3 + 3 + 16 + LEVELS * SHARES.len() + 2;
/// Places of the friction of the tool in its guide.
const GUIDE: core::ops::Range<usize> = REGRESSORS - GUIDE_LINKS.len()..REGRESSORS;
/// Links that rub there: link 3, without and with the stretch of the cables.
const GUIDE_LINKS: [usize; 2] = [1, 3];
/// What the guide's friction must take off the squared error of the insertion's balance in parts of
/// the training that were left out, share. A choice: far above what chance takes off, and of little
/// cost where it is wrong. A training whose force is always as large does not show it.
const GUIDE_TAKES: f64 = 0.05;
/// Places of the regressors that are friction with a direction: not the rates of the stops, which
/// are damping, nor loads without one.
const FRICTION: [[usize; 2]; 3] = {
    let stops = GRAVITY + 10;
    let products = stops + 2 * STOPS;
    let links = products + 6 + 3 + 3;
    [
        [stops, stops + STOPS],
        [products, products + 6 + 3],
        [links, REGRESSORS],
    ]
};
/// Parts of a motor's Coulomb friction that may lie before its gear's load: which part it is, the
/// fit finds.
const SHARES: [f64; 4] = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0];
/// Speeds at which the excess of a link's breakaway fades: rad/s of link 2, m/s of link 3.
const LINK_FADE: [[f64; 4]; 2] = [[0.001, 0.003, 0.01, 0.03], [1e-4, 3e-4, 1e-3, 3e-3]];
/// Free motion that is asked for, s.
const MINUTE_S: f64 = 60.0;
/// Least time of free motion that recalibrates, s: a start and rests tell nothing.
const FREE_S: f64 = MINUTE_S / 2.0;
/// Noise with changes between pieces per that without, at the motor where it is least, below which
/// they are taken for changes of the robot. It was 0.31 at most on the arm of the standard
/// experiment, and 0.78 at least on one that is the same in all trials (virtual arm, seeds 11 to
/// 13).
const CHANGES_FROM: f64 = 0.5;
/// Standard deviation of a balance per Coulomb friction from which the search for it begins.
/// Estimate.
const USUAL_NOISE: f64 = 0.01;
/// Every so many rows enters the fits where there are many: neighbours tell nearly the same.
const EVERY: usize = 3;
/// Every so many rows enters the figures of errors: neighbours tell the same.
const FEW: usize = 5;
/// Parts of the training that are left out in turn to find its errors.
const FOLDS: usize = 6;
/// Rows for each regressor from which there are many.
const MANY: usize = 12;

/// The model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Physics {
    step_s: f64,
    base: Base,
    #[serde(deserialize_with = "balances")]
    motors: [Ridge; 3],
    /// Coulomb friction that each motor feels, its own and that of the links: N·m, N·m, N.
    coulomb: [f64; 3],
    /// Variance of a motor's balance, by speed.
    noise: [Noise; 3],
    /// Inverse of the second moments of the force in training, 1/N².
    prior: [[f64; 3]; 3],
    /// Rate of the force in training per its size, 1/s.
    #[serde(default = "usual_rate")]
    rate_per_s: f64,
    /// How each motor differed between pieces of the training, where it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    differs: Option<[Differs; 3]>,
    /// Times in which errors of the balances are alike, in those of [`crate::recalibration`].
    #[serde(default = "usual_alike")]
    alike: [f64; 3],
    /// Components that are given out: 0 x, 1 y, 2 z.
    axes: Vec<usize>,
    /// What a recalibration has found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    found: Option<Found>,
}

/// Reads the balances of a model file.
fn balances<'de, D: Deserializer<'de>>(file: D) -> Result<[Ridge; 3], D::Error> {
    let motors = <[Ridge; 3]>::deserialize(file)?;
    let known = |motor: &Ridge| motor.regressors() == REGRESSORS && motor.fits(1);
    if motors.iter().all(known) {
        return Ok(motors);
    }
    Err(D::Error::custom(format!(
        "the balances have other coefficients than this program's {REGRESSORS}: train the model again"
    )))
}

/// How a motor differed between pieces of the training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Differs {
    /// Changes that all pieces have.
    mean: Effects,
    usual: Usual,
}

/// Balance of a motor at a row, in the joint's unit: N·m, N·m, N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance {
    /// Time in the trial, s.
    pub time_s: f64,
    /// Torque that is commanded, filtered.
    pub torque: f64,
    /// What the model expects of it: gravity and friction less the contact.
    pub expected: f64,
    /// The part of it that is friction.
    pub friction: f64,
    /// Angle of the motor, rad.
    pub angle: f64,
    /// Velocity of the motor, rad/s.
    pub turn_rate: f64,
    /// Standard deviation of torque less expected in training.
    pub deviation: f64,
    /// Coulomb friction in training, its own and that of the links.
    pub coulomb: f64,
}

/// Variance by speed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Noise {
    /// Upper ends of the bins but the last.
    edges: Vec<f64>,
    variance: Vec<f64>,
}

impl Noise {
    fn fit(mut pairs: Vec<(f64, f64)>) -> Self {
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let size = pairs.len().div_ceil(BINS).max(1);
        let chunks: Vec<&[(f64, f64)]> = pairs.chunks(size).collect();
        let variance = chunks
            .iter()
            .map(|c| c.iter().map(|(_, e)| e * e).sum::<f64>() / c.len() as f64);
        Self {
            variance: variance.map(|v| v.max(1e-12)).collect(),
            edges: chunks.iter().skip(1).map(|c| c[0].0).collect(),
        }
    }

    /// Standard deviation at all speeds alike.
    fn deviation(&self) -> f64 {
        (self.variance.iter().sum::<f64>() / self.variance.len().max(1) as f64).sqrt()
    }

    fn variance(&self, speed: f64) -> f64 {
        self.variance[self.edges.partition_point(|edge| *edge <= speed)]
    }
}

/// Regressors of the balance of motor `i`.
/// `coulomb`: its Coulomb friction, N·m, N·m, N.
pub fn regressors(m: &Moment, i: usize, coulomb: f64, row: &mut Vec<f64>) {
    row.clear();
    let (s1, c1) = m.joints[0].sin_cos();
    let (s2, c2) = m.joints[1].sin_cos();
    let q3 = m.joints[2];
    row.extend([s1, c1, s2, c2, s1 * s2, s1 * c2, c1 * s2, c1 * c2]);
    row.extend([
        q3 * s1 * s2,
        q3 * s1 * c2,
        q3 * c1 * s2,
        q3 * c1 * c2,
        q3 * s1,
        q3 * c1,
    ]);
    row.extend(m.speed);
    row.extend(m.flow);
    row.extend(m.acceleration);
    row.push(m.rate[i]);
    row.extend(m.stops);
    row.extend(m.stop_rates);
    let direction = m.motor_stop(i, MIDDLE);
    for torque in m.torque {
        row.extend([direction * torque.abs(), direction * torque]);
    }
    row.extend(FADE[i].map(|speed| direction * (-m.rate[i].abs() / speed).exp()));
    row.extend(m.torque.map(f64::abs));
    for link in 0..4 {
        let direction = m.link_stop(link, MIDDLE);
        let speeds = LINK_FADE[link % 2];
        row.extend(speeds.map(|speed| direction / (1.0 + (m.link_flow[link] / speed).powi(2))));
    }
    // What loads the gear is the torque less the motor's own friction.
    for share in SHARES {
        let load = (m.torque[i] - share * coulomb * direction).abs();
        row.extend((0..LEVELS).map(|level| m.motor_stop(i, level) * load));
    }
    // The tool's shaft rubs in its guide as hard as the force across it presses.
    row.extend(GUIDE_LINKS.map(|link| m.link_stop(link, MIDDLE) * m.lateral_n));
}

/// Friction of the tool in its guide per force across its shaft, as the weights of a motor's fit
/// have it now.
fn guide(weights: &[f64], m: &Moment) -> f64 {
    let stops = GUIDE_LINKS.map(|link| m.link_stop(link, MIDDLE));
    weights[GUIDE].iter().zip(stops).map(|(w, x)| w * x).sum()
}

/// Rows that fits and figures leave out at the start of a sequence: [`SETTLE_S`].
#[must_use]
pub fn settle_rows(step_s: f64) -> usize {
    (SETTLE_S / step_s).round() as usize
}

fn force_of(target: &[f32]) -> Vector3<f64> {
    Vector3::from_fn(|k, _| target.get(k).map_or(0.0, |v| f64::from(*v)))
}

fn joints_of(input: &[f32]) -> [f64; 3] {
    core::array::from_fn(|i| f64::from(input[i]))
}

/// Visits every settled row of the sequences, one thread a sequence: state, levers, filtered force.
fn visit<T: Send>(
    base: &Base,
    coulomb: [f64; 3],
    sequences: &[&Sequence],
    start: impl Fn() -> T + Sync,
    row: impl Fn(&mut T, &Moment, &Vector3<f64>) + Sync,
) -> Vec<T> {
    sequences
        .par_iter()
        .map(|sequence| {
            let mut out = start();
            let mut motion = Motion::with_friction(sequence.step_s, coulomb, [1.0; 3]);
            // The contact is filtered as the torque is, or the balance would mix two times.
            let mut filters = [LowPass::new(FILTER_S, sequence.step_s); 3];
            let settle = settle_rows(sequence.step_s);
            for k in 0..sequence.rows() {
                let input = sequence.input_row(k);
                let force = force_of(sequence.target_row(k));
                motion.lateral(base.across(joints_of(input), &force).norm());
                let moment = motion.step(input);
                let contact = base.at_motors(moment.joints) * force;
                let contact = Vector3::from_fn(|i, _| filters[i].step(contact[i]));
                if k >= settle {
                    row(&mut out, moment, &contact);
                }
            }
            out
        })
        .collect()
}

/// Sums of the balances of the motors, with what each piece has for itself: by sequence, piece,
/// motor. `motors` tell the friction.
fn sums_of_pieces(
    base: &Base,
    coulomb: [f64; 3],
    motors: &[Ridge; 3],
    every: usize,
    sequences: &[&Sequence],
) -> Vec<Vec<[Sums; 3]>> {
    let fresh = || [(); 3].map(|()| Sums::new(REGRESSORS + pieces::OWN, 1));
    let step_s = sequences.first().map_or(1.0, |first| first.step_s);
    let parts = visit(
        base,
        coulomb,
        sequences,
        || (Vec::new(), Vec::new(), 0_usize),
        |(sums, row, n), moment, contact| {
            let (piece, time_s) = pieces::place(*n, step_s);
            if sums.len() <= piece {
                sums.push(fresh());
            }
            if *n % every == 0 {
                for i in 0..3 {
                    regressors(moment, i, coulomb[i], row);
                    let effects = expected_effects(&motors[i], moment, i, coulomb[i], row);
                    let left = moment.torque[i] + contact[i] - motors[i].value(0, row);
                    pieces::push(&effects, time_s, row);
                    sums[piece][i].push(row, &[left]);
                }
            }
            *n += 1;
        },
    );
    parts.into_iter().map(|(sums, _, _)| sums).collect()
}

fn dot(changes: &Effects, effects: &Effects) -> f64 {
    changes.iter().zip(effects).map(|(c, x)| c * x).sum()
}

/// What changes would add to a balance whose contact is known. A gain is on what is expected of the
/// torque: the torque itself would explain itself.
fn expected_effects(
    motor: &Ridge,
    moment: &Moment,
    i: usize,
    coulomb: f64,
    row: &[f64],
) -> Effects {
    let mut effects = effects(moment, i, coulomb, friction(motor.weights(0), row));
    effects[GAIN_OF] = motor.value(0, row);
    effects
}

/// Noise of the balances. `value`: what is expected of torque and contact, from the number of the
/// sequence, that of the settled row, the motor, the state and its regressors.
fn noise_of(
    base: &Base,
    coulomb: [f64; 3],
    sequences: &[&Sequence],
    value: impl Fn(usize, usize, usize, &Moment, &[f64]) -> f64 + Sync,
) -> [Noise; 3] {
    let parts: Vec<_> = (sequences.par_iter().enumerate())
        .flat_map(|(number, sequence)| {
            visit(
                base,
                coulomb,
                &[*sequence],
                || ([(); 3].map(|()| Vec::new()), Vec::new(), 0_usize),
                |(pairs, row, n), moment, contact| {
                    *n += 1;
                    if *n % FEW == 0 {
                        for i in 0..3 {
                            regressors(moment, i, coulomb[i], row);
                            let value = value(number, *n - 1, i, moment, row);
                            let error = value - moment.torque[i] - contact[i];
                            pairs[i].push((moment.rate[i].abs(), error));
                        }
                    }
                },
            )
        })
        .collect();
    let mut noise: [Vec<(f64, f64)>; 3] = Default::default();
    for (part, _, _) in parts {
        for (all, more) in noise.iter_mut().zip(part) {
            all.extend(more);
        }
    }
    noise.map(Noise::fit)
}

/// Balances of a robot that changes between pieces of the training.
struct Changing {
    motors: [Ridge; 3],
    noise: [Noise; 3],
    differs: [Differs; 3],
}

/// Fits them; `None`: too few rows. `coarse`: the first fit; `guide`: whether the tool rubs in its
/// guide.
fn changing(
    base: &Base,
    coulomb: [f64; 3],
    coarse: &[Ridge; 3],
    every: usize,
    guide: bool,
    sequences: &[&Sequence],
) -> Option<Changing> {
    // What has changed is told by the few regressors of the first fit. Those with a torque would
    // explain the torque by itself.
    let coarse: [Ridge; 3] = core::array::from_fn(|i| {
        let mut places: Vec<usize> = (0..GRAVITY).collect();
        places.extend([GRAVITY + 10 + i * LEVELS + MIDDLE, GRAVITY + 3 + i]);
        coarse[i].placed(&places, REGRESSORS)
    });
    let step_s = sequences.first()?.step_s;
    let parts = sums_of_pieces(base, coulomb, &coarse, every, sequences);
    let counts: Vec<usize> = parts.iter().map(Vec::len).collect();
    let mut by_motor: [Vec<Sums>; 3] = Default::default();
    for piece in parts.into_iter().flatten() {
        for (all, mut sums) in by_motor.iter_mut().zip(piece) {
            if !guide {
                sums.forget(GUIDE);
            }
            all.push(sums);
        }
    }
    let mut fitted = Vec::with_capacity(3);
    for (i, pieces_of) in by_motor.iter_mut().enumerate() {
        let noise = (USUAL_NOISE * coulomb[i]).powi(2).max(1e-12);
        fitted.push(pieces::fit(
            pieces_of,
            &coarse[i],
            noise,
            every as f64 * step_s,
        )?);
    }
    // What each sequence has for itself.
    let mut from = 0;
    let told = counts.into_iter().map(|count| {
        let pieces = from..from + count;
        from += count;
        let own = pieces.map(|piece| core::array::from_fn(|i| fitted[i].own[piece].clone()));
        Told {
            own: own.collect(),
            rows: 0,
        }
    });
    let told: Vec<Told> = told.collect();
    let noise = noise_of(base, coulomb, sequences, |sequence, at, i, moment, row| {
        let effects = expected_effects(&coarse[i], moment, i, coulomb[i], row);
        fitted[i].common.value(0, row)
            - dot(&fitted[i].mean, &effects)
            - told[sequence].adds(i, at, step_s, &effects)
    });
    let differs = core::array::from_fn(|i| Differs {
        mean: fitted[i].mean,
        usual: fitted[i].usual,
    });
    let motors: Vec<Ridge> = fitted.into_iter().map(|fitted| fitted.common).collect();
    Some(Changing {
        motors: motors.try_into().ok()?,
        noise,
        differs,
    })
}

/// Regressors of the first fit: gravity, Coulomb and viscous friction.
const SMALL: usize = GRAVITY + 2;

/// Sums of the balance of each motor on every `every`-th settled row, of each [`fold`].
fn sums_of_folds(
    base: &Base,
    coulomb: [f64; 3],
    sequences: &[&Sequence],
    width: usize,
    every: usize,
    regressors: impl Fn(&Moment, usize, &mut Vec<f64>) + Sync,
) -> Vec<[Sums; 3]> {
    let parts = visit(
        base,
        coulomb,
        sequences,
        || ([(); 3].map(|()| Sums::new(width, 1)), Vec::new(), 0_usize),
        |(sums, row, n), moment, contact| {
            *n += 1;
            if *n % every == 0 {
                for (i, sum) in sums.iter_mut().enumerate() {
                    regressors(moment, i, row);
                    sum.push(row, &[moment.torque[i] + contact[i]]);
                }
            }
        },
    );
    let mut folds: Vec<[Sums; 3]> = Vec::new();
    for (number, (part, _, _)) in parts.into_iter().enumerate() {
        match folds.get_mut(fold(number)) {
            Some(sums) => add(sums, part),
            None => folds.push(part),
        }
    }
    folds
}

/// Part of the training that a sequence is in.
const fn fold(sequence: usize) -> usize {
    sequence % FOLDS
}

fn add(to: &mut [Sums; 3], more: [Sums; 3]) {
    for (sums, more) in to.iter_mut().zip(more) {
        sums.merge(more);
    }
}

/// The balance of each motor by all folds but one, or by all; `None`: too few rows.
fn solved(folds: &[[Sums; 3]], but: Option<usize>) -> Option<[Ridge; 3]> {
    let mut chosen = (0..folds.len()).filter(|n| Some(*n) != but);
    let mut total = folds.get(chosen.next()?)?.clone();
    chosen.for_each(|n| add(&mut total, folds[n].clone()));
    let motors: Option<Vec<Ridge>> = total.into_iter().map(Sums::solve).collect();
    motors?.try_into().ok()
}

/// Fits the balance of each motor on every `every`-th settled row.
fn fit(folds: &[[Sums; 3]], every: usize) -> Result<[Ridge; 3], ModelError> {
    solved(folds, None).ok_or_else(|| {
        let width = folds.first().map_or(0, |[sums, ..]| sums.regressors());
        ModelError::Data(format!(
            "too few rows for the physical model: it needs more than {} rows after the first {SETTLE_S} s of each unbroken stretch",
            width * every
        ))
    })
}

/// Whether the parts of the training show that the tool rubs in its guide. Where they do not, a fit
/// would take something else for it, and be wrong in free motion.
fn rubs_in_its_guide(folds: &[[Sums; 3]]) -> bool {
    let mut without = folds.to_vec();
    (without.iter_mut().flatten()).for_each(|sums| sums.forget(GUIDE));
    let left = |of: &[[Sums; 3]]| -> Option<f64> {
        let parts = folds.iter().enumerate().map(|(out, [.., insertion])| {
            let [.., fitted] = solved(of, Some(out))?;
            Some(insertion.clone().left(&fitted))
        });
        parts.sum()
    };
    let pair = left(folds).zip(left(&without));
    pair.is_some_and(|(with, without)| with < (1.0 - GUIDE_TAKES) * without)
}

/// Times in which errors of the balances are alike, in those of [`crate::recalibration`]: what
/// minutes that were not fitted seem to tell of changes of the robot, which did not change, over
/// what they would tell if only neighbouring rows had the same error. A slow motion has slower
/// errors.
fn alike(
    base: &Base,
    coulomb: [f64; 3],
    noise: &[Noise; 3],
    sequences: &[&Sequence],
    folds: &[[Sums; 3]],
) -> [f64; 3] {
    let fitted = (0..folds.len()).map(|out| solved(folds, Some(out)));
    let Some(fitted) = fitted.collect::<Option<Vec<[Ridge; 3]>>>() else {
        return [1.0; 3];
    };
    let parts: Vec<_> = (sequences.par_iter().enumerate())
        .flat_map(|(number, sequence)| {
            let motors = &fitted[fold(number)];
            visit(
                base,
                coulomb,
                &[*sequence],
                || (Vec::<Free>::new(), Vec::new(), 0_usize),
                |(minutes, row, n), moment, contact| {
                    let time_s = *n as f64 * sequence.step_s;
                    *n += 1;
                    if *n % FEW != 0 {
                        return;
                    }
                    let (mut of, mut lacking) = ([[0.0; CHANGES]; 3], [0.0; 3]);
                    let mut variance = [0.0; 3];
                    for i in 0..3 {
                        regressors(moment, i, coulomb[i], row);
                        let friction = friction(motors[i].weights(0), row);
                        of[i] = effects(moment, i, coulomb[i], friction);
                        lacking[i] = motors[i].value(0, row) - moment.torque[i] - contact[i];
                        variance[i] = noise[i].variance(moment.rate[i].abs());
                    }
                    let minute = (time_s / MINUTE_S) as usize;
                    minutes.resize(minutes.len().max(minute + 1), Free::default());
                    let step_s = FEW as f64 * sequence.step_s;
                    let levers = Matrix3::zeros();
                    minutes[minute].push(time_s, &of, lacking, variance, &levers, step_s);
                },
            )
        })
        .collect();
    core::array::from_fn(|i| {
        let minutes = parts.iter().flat_map(|(minutes, _, _)| minutes);
        let all = minutes.filter_map(|minute| minute.seems(i));
        let [told, expected] = all.fold([0.0; 2], |sum, of| [sum[0] + of[0], sum[1] + of[1]]);
        if told > expected {
            told / expected
        } else {
            1.0
        }
    })
}

impl Physics {
    /// Identifies gravity and friction from sequences with the force's three components as targets.
    ///
    /// # Errors
    /// Too few rows, or targets that are no vector.
    pub fn train(base: Base, sequences: &[&Sequence], axes: &[usize]) -> Result<Self, ModelError> {
        let Some(first) = sequences.first() else {
            return Err(ModelError::Data("no training rows".to_owned()));
        };
        if sequences.iter().any(|s| s.targets != 3) {
            return Err(ModelError::Data(
                "the physical model needs the force's three components as targets".to_owned(),
            ));
        }
        // Gravity, Coulomb and viscous friction alone, on a tenth of the rows, tell how large the
        // friction is.
        let coarse = sums_of_folds(&base, [0.0; 3], sequences, SMALL, 10, |m, i, row| {
            regressors(m, i, 0.0, row);
            row.truncate(GRAVITY);
            row.extend([m.motor_stop(i, MIDDLE), m.flow[i]]);
        });
        let coarse = fit(&coarse, 10)?;
        let coulomb = core::array::from_fn(|i| coarse[i].weights(0)[GRAVITY].max(0.0));
        let settled = |s: &&Sequence| s.rows().saturating_sub(settle_rows(s.step_s));
        let rows: usize = sequences.iter().map(settled).sum();
        let every = if rows < MANY * REGRESSORS { 1 } else { EVERY };
        let mut folds = sums_of_folds(&base, coulomb, sequences, REGRESSORS, every, |m, i, row| {
            regressors(m, i, coulomb[i], row);
        });
        let guide = rubs_in_its_guide(&folds);
        if !guide {
            (folds.iter_mut().flatten()).for_each(|sums| sums.forget(GUIDE));
        }
        let motors = fit(&folds, every)?;
        let plain = noise_of(&base, coulomb, sequences, |_, _, i, _, row| {
            motors[i].value(0, row)
        });
        let changing = changing(&base, coulomb, &coarse, every, guide, sequences);
        let less = |of: &Changing| -> [f64; 3] {
            core::array::from_fn(|i| of.noise[i].deviation() / plain[i].deviation())
        };
        let changing = changing.filter(|of| less(of).iter().any(|ratio| *ratio < CHANGES_FROM));
        // What pieces have for themselves takes their slow errors, too.
        let alike = match changing {
            Some(_) => usual_alike(),
            None => alike(&base, coulomb, &plain, sequences, &folds),
        };
        let (motors, noise, differs) = match changing {
            Some(of) => (of.motors, of.noise, Some(of.differs)),
            None => (motors, plain, None),
        };
        Ok(Self {
            step_s: first.step_s,
            base,
            motors,
            coulomb,
            noise,
            prior: prior(sequences),
            rate_per_s: rate_per_s(sequences),
            differs,
            alike,
            axes: axes.to_vec(),
            found: None,
        })
    }

    /// Time between rows, s.
    #[must_use]
    pub const fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Where the robot's base stands.
    #[must_use]
    pub const fn base(&self) -> &Base {
        &self.base
    }

    /// Components that are given out.
    #[must_use]
    pub fn axes(&self) -> &[usize] {
        &self.axes
    }

    /// Number of identified numbers.
    #[must_use]
    pub fn count(&self) -> usize {
        self.motors.iter().map(Ridge::parameters).sum::<usize>()
            + self.coulomb.len()
            + self.noise.iter().map(|n| n.variance.len()).sum::<usize>()
            + 6
    }
}

/// Inverse of the second moments of the force.
fn prior(sequences: &[&Sequence]) -> [[f64; 3]; 3] {
    let (mut moments, mut rows) = (Matrix3::zeros(), 0.0);
    for sequence in sequences {
        for k in (0..sequence.rows()).step_by(10) {
            let force = force_of(sequence.target_row(k));
            moments += force * force.transpose();
            rows += 1.0;
        }
    }
    // 0.01 N of spread at least: a component that is always zero stays invertible.
    let moments = moments / f64::max(rows, 1.0) + Matrix3::identity() * 1e-4;
    let inverse = moments.try_inverse().unwrap_or_else(Matrix3::identity);
    core::array::from_fn(|i| core::array::from_fn(|j| inverse[(i, j)]))
}

/// Rate of a force of 0.1 to 0.3 N/s and up to 4.5 N, as in the thesis, for models that were
/// trained before it was found: 1/s.
const fn usual_rate() -> f64 {
    0.08
}

/// That of models that were trained before it was found.
const fn usual_alike() -> [f64; 3] {
    [1.0; 3]
}

/// Rate of the force over [`MEMORY_S`] per its size, 1/s.
fn rate_per_s(sequences: &[&Sequence]) -> f64 {
    let (mut rates, mut sizes) = (0.0, 0.0);
    for sequence in sequences {
        let apart = (MEMORY_S / sequence.step_s).round().max(1.0) as usize;
        for k in (apart..sequence.rows()).step_by(apart) {
            let force = force_of(sequence.target_row(k));
            let rate = (force - force_of(sequence.target_row(k - apart)))
                / (apart as f64 * sequence.step_s);
            rates += rate.norm_squared();
            sizes += force.norm_squared();
        }
    }
    if sizes > 0.0 && rates > 0.0 {
        (rates / sizes).sqrt()
    } else {
        usual_rate()
    }
}

/// Part of a motor's balance that is friction with a direction, by the weights of its fit.
fn friction(weights: &[f64], row: &[f64]) -> f64 {
    let part = |[from, to]: [usize; 2]| weights[from..to].iter().zip(&row[from..to]);
    let products = FRICTION.into_iter().flat_map(part).map(|(w, x)| w * x);
    products.sum()
}

impl Model for Physics {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        crate::model::by_steps(self.stepper(), sequence, self.axes.len())
    }

    fn parameters(&self) -> usize {
        self.count()
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(self.observer())
    }

    fn told_stepper(&self, sequence: &Sequence) -> Option<(Box<dyn Stepper + '_>, usize)> {
        let (observer, from) = self.told(sequence)?;
        Some((Box::new(observer), from))
    }
}

const _: () = assert!(MIDDLE < LEVELS);
