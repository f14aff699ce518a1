//! What has changed of a robot since a model was trained, found on a minute of free motion.
//!
//! Each motor has an offset (zero of its amplifier), a share of its friction, a gain, a ripple of
//! its friction over a turn, and friction that is larger one way. They add to what its balance
//! lacks, and in free motion nothing else does:
//!
//! ```text
//! balance = effects * changes + noise        each motor by itself
//! ```
//!
//! The changes are few and small, so a minute tells them: least squares with what is usual as
//! prior. Neighbouring rows have the same error, so each counts by the time between them over that
//! in which errors are alike.
//!
//! A torque that comes and goes shows as an offset that moves within the minute, and friction that
//! warms as friction that does. Each change may be there or not: the result is the mean over all
//! choices, weighted by how well they explain the minute. A torque that may come and go is told
//! from the force under load, as far as it may be there, and so is friction that has changed: see
//! [`crate::wander`]. All changes as states of that filter were tried. It took slow forces for
//! offsets and asymmetries: see docs/estimation.md.
//!
//! Contacts bend as far as their friction is large, so that a second look at the log has the
//! friction that the first has found ([`Motion::with_friction`](crate::motion::Motion)).

mod found;

pub use found::{Change, Found};

use crate::motion::{Moment, FILTER_S};
use crate::wander;
use core::iter;
use found::of_motor;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use robot::kinematics::{COUPLING, TRANSMISSION};

/// Changes of a motor: offset per Coulomb friction, share of friction, gain, ripple (sine, cosine)
/// per Coulomb friction, share of friction that is more in positive direction.
pub const CHANGES: usize = 6;
/// Standard deviations before anything is known. Estimates: about the sizes of docs/robot.md, "What
/// changes".
pub const SPREAD: [f64; CHANGES] = [0.1, 0.1, 0.03, 0.1, 0.1, 0.1];
/// Time in which errors of a balance are alike, s. With 0.5 s the error after a minute was up to 20
/// % larger, with 1 s up to 5 % (virtual arm, seed 1).
pub const ALIKE_S: f64 = 2.0;
/// Chance from which a torque that comes and goes is followed under load. Estimate: below it the
/// size would be a third of the usual one, as that goes with the root of the chance.
pub const FOLLOWED: f64 = 0.1;
/// Standard deviation of a force on the tool that was not measured, N. Estimate.
const FORCE_N: f64 = 2.0;
/// Logarithm of the odds from which there is one, chosen on the virtual arm's seeds 11 to 13 above
/// what all changes of docs/estimation.md came to. `--example changes` counts how often a minute
/// without a force, and one with 1 N or 2 N, is above it.
const FORCE_ODDS: f64 = 8.0;
/// Sizes of a torque that may come and go, per Coulomb friction, each as likely. One of 0.1 N·m is
/// 0.02 of a stiff elbow and 0.2 of a light one. Chosen on the virtual arm's robots 11, 13, 22, 31,
/// 32 and 34: with 0.1 alone drags left more error after a recalibration, and so they did with
/// further sizes of 0.01 or 0.3.
const SIZES: [f64; 2] = [0.03, 0.1];
/// Place of the offset among the changes.
const OFFSET: usize = 0;
/// Place of the share of friction.
pub(crate) const FRICTION: usize = 1;
/// Place of the gain.
pub(crate) const GAIN: usize = 2;
/// Places of the kinds of changes that are there together or not at all; the last is friction that
/// warms. A torque that comes and goes is one more, of several sizes.
const KINDS: [core::ops::Range<usize>; 6] = [0..1, 1..2, 2..3, 3..5, 5..6, WARMS..WITH_TIME];
/// Stop operator that stands for the direction of motion: that of the smallest threshold.
const MOTION: usize = 0;
/// Stop operator that stands for the direction of sliding.
const DIRECTION: usize = 2;

/// [`CHANGES`] with rate and curvature of the offset, and the rate of the friction.
const WITH_TIME: usize = CHANGES + 3;
/// Place of the last.
const WARMS: usize = CHANGES + 2;
/// Its standard deviation before anything is known, share in [`wander::TIME_S`]. Estimate: a
/// warming by a tenth within ten minutes has 0.008.
const WARMING: f64 = 0.01;

/// What a change of 1 adds to a balance, each: see [`effects`].
pub type Effects = [f64; CHANGES];

type Vector = SVector<f64, CHANGES>;
type Matrix = SMatrix<f64, CHANGES, CHANGES>;
type Long = SVector<f64, WITH_TIME>;
type Square = SMatrix<f64, WITH_TIME, WITH_TIME>;

/// Angle of motor `i` when the filtered torque was, rad.
#[must_use]
pub fn motor_angle(m: &Moment, i: usize) -> f64 {
    (m.motors[i] - FILTER_S * m.flow[i]) * TRANSMISSION[i]
}

/// What the changes of motor `i` add to its balance. `coulomb`: size of its friction; `friction`:
/// what the model has of it now.
#[must_use]
pub fn effects(m: &Moment, i: usize, coulomb: f64, friction: f64) -> [f64; CHANGES] {
    let angle = motor_angle(m, i);
    let sliding = coulomb * m.motor_stop(i, DIRECTION);
    [
        coulomb,
        friction,
        m.torque[i],
        sliding * angle.sin(),
        sliding * angle.cos(),
        friction * m.motor_stop(i, MOTION),
    ]
}

/// What is known of changes before a log is seen.
fn usual_information() -> Matrix {
    Matrix::from_diagonal(&Vector::from(SPREAD.map(|sd| sd.powi(-2))))
}

/// The same with rates and curvature; those of the offset, in [`wander::TIME_S`], each as large as
/// this.
fn with_time(moves: f64) -> Square {
    let mut information = Square::identity() / (moves * moves);
    information[(WARMS, WARMS)] = WARMING.powi(-2);
    let mut changes = information.fixed_view_mut::<CHANGES, CHANGES>(0, 0);
    changes.copy_from(&usual_information());
    information
}

/// Changes, averaged over which of their kinds there are.
struct Average {
    mean: Long,
    covariance: Square,
    /// Chance that a torque comes and goes, and its usual size, per Coulomb friction, with that
    /// chance.
    wanders: f64,
    size: f64,
}

/// Changes and their covariance, averaged over which of the kinds there are at all: each may be
/// there or not. Where the log shows none, the model stays as it was trained, and is not bent to
/// the errors of a minute.
fn average(information: &Square, evidence: &Long) -> Option<Average> {
    let (mut weights, mut mean, mut squares) = (0.0, Long::zeros(), Square::zeros());
    let (mut most, mut wanders, mut size_squared) = (0.0_f64, 0.0, 0.0);
    let none = (0.0, SIZES.len() as f64);
    for (size, times) in iter::once(none).chain(SIZES.map(|size| (size, 1.0))) {
        for chosen in 0..1_u32 << KINDS.len() {
            let mut of = Long::zeros();
            for (kind, places) in KINDS.iter().enumerate() {
                if chosen >> kind & 1 == 1 {
                    places.clone().for_each(|k| of[k] = 1.0);
                }
            }
            // What is not there keeps its usual size, apart from the log: it cancels.
            let mut usual = with_time(SPREAD[OFFSET]);
            if size > 0.0 {
                usual = with_time(size);
                // It is as far from zero as it moves.
                let stays = of[OFFSET] * SPREAD[OFFSET];
                usual[(OFFSET, OFFSET)] = (size * size + stays * stays).recip();
                for k in [OFFSET, CHANGES, CHANGES + 1] {
                    of[k] = 1.0;
                }
            }
            let mask = Square::from_diagonal(&of);
            let covariance = (mask * information * mask + usual).try_inverse()?;
            let told = covariance * mask * evidence;
            let odds =
                (told.dot(evidence) + (covariance.determinant() * usual.determinant()).ln()) / 2.0;
            // Weights per the largest so far: the evidence may be more than an exponential holds.
            if odds > most {
                let less = (most - odds).exp();
                (weights, mean, squares) = (weights * less, mean * less, squares * less);
                (wanders, size_squared) = (wanders * less, size_squared * less);
                most = odds;
            }
            let weight = times * (odds - most).exp();
            weights += weight;
            if size > 0.0 {
                wanders += weight;
                size_squared += size * size * weight;
            }
            mean += told * weight;
            squares += (mask * covariance * mask + told * told.transpose()) * weight;
        }
    }
    mean /= weights;
    let finite = mean.iter().all(|change| change.is_finite());
    finite.then(|| Average {
        mean,
        covariance: squares / weights - mean * mean.transpose(),
        wanders: wanders / weights,
        size: (size_squared / weights).sqrt(),
    })
}

/// Sums of a log of free motion.
#[derive(Debug, Clone, Default)]
pub struct Free {
    information: [Square; 3],
    evidence: [Long; 3],
    /// Products of the effects with the levers, of the levers, and of these with what is lacking.
    across: [SMatrix<f64, WITH_TIME, 3>; 3],
    of_force: [Matrix3<f64>; 3],
    for_force: [Vector3<f64>; 3],
    /// Sum of the times of the rows and of their squares, and the last, in [`wander::TIME_S`].
    times: [f64; 2],
    last: f64,
    rows: f64,
    /// Coulomb friction of each motor.
    coulomb: [f64; 3],
    /// Sum of the squares of what the balances lack, per noise.
    squares: [f64; 3],
    /// Time of the rows, s.
    pub told_s: f64,
}

impl Free {
    /// Takes a row at a time of the log: what each balance lacks, its variance and the effects.
    pub fn push(
        &mut self,
        time_s: f64,
        effects: &[[f64; CHANGES]; 3],
        lacking: [f64; 3],
        variance: [f64; 3],
        levers: &Matrix3<f64>,
        step_s: f64,
    ) {
        self.told_s += step_s;
        let time = time_s / wander::TIME_S;
        self.times = [self.times[0] + time, self.times[1] + time * time];
        self.last = if self.rows > 0.0 {
            self.last.max(time)
        } else {
            time
        };
        self.rows += 1.0;
        self.coulomb = effects.map(|of| of[0]);
        for i in 0..3 {
            let mut row = Long::zeros();
            row.fixed_rows_mut::<CHANGES>(0)
                .copy_from_slice(&effects[i]);
            let coulomb = effects[i][0];
            row[CHANGES] = coulomb * time;
            row[CHANGES + 1] = coulomb * time * time / 2.0;
            row[WARMS] = effects[i][FRICTION] * time;
            let weight = step_s / ALIKE_S / variance[i];
            self.information[i] += row * row.transpose() * weight;
            self.evidence[i] += row * (lacking[i] * weight);
            self.squares[i] += lacking[i] * lacking[i] * weight;
            let lever = levers.row(i);
            self.across[i] += row * lever * weight;
            self.of_force[i] += lever.transpose() * lever * weight;
            self.for_force[i] += lever.transpose() * (lacking[i] * weight);
        }
    }

    /// The changes; `None` where numbers are not finite. `usual`: sizes of the torques that came
    /// and went in training, per Coulomb friction; 0: none did. `alike`: times in which errors of
    /// the balances are alike, in [`ALIKE_S`]. `followed`: chance from which a torque that comes
    /// and goes is followed under load, [`FOLLOWED`]; 1: none is.
    #[must_use]
    pub fn found(&self, usual: [f64; 3], alike: [f64; 3], followed: f64) -> Option<Found> {
        let mut motors = Vec::with_capacity(3);
        // Rate and curvature of the torques at the joints.
        let mut moves = [SVector::<f64, 2>::zeros(); 3];
        // A torque at a later joint is felt here.
        for i in (0..3).rev() {
            let felt = (i + 1..3).map(|k| moves[k] * COUPLING[k][i]).sum();
            let Average {
                mut mean,
                mut covariance,
                wanders,
                size,
            } = self.of_motor(i, alike[i], felt)?;
            // A motor whose effort is not logged has no friction, and tells nothing.
            let follows = usual[i] > 0.0 || (wanders > followed && self.coulomb[i] > 0.0);
            let mut wander = 0.0;
            if follows {
                let own = mean.fixed_rows::<2>(CHANGES).into_owned();
                moves[i] = own * self.coulomb[i];
                if wanders > followed {
                    let known = usual[i] > 0.0;
                    wander = own.norm().hypot(if known {
                        wanders.sqrt() * usual[i]
                    } else {
                        size
                    });
                }
                // The offset is the mean over the log: the filter under load follows the rest. It
                // stays as unsure as the log leaves it beside the other changes, an asymmetry above
                // all. Taken for sure, it left the asymmetry alone unsure, and the motor with it.
                let mut to = Square::identity();
                to[(OFFSET, CHANGES + 1)] = self.spread() / 2.0;
                mean = to * mean;
                covariance = to * covariance * to.transpose();
            }
            let changes = mean.fixed_rows::<CHANGES>(0).into_owned();
            let covariance = covariance.fixed_view::<CHANGES, CHANGES>(0, 0).into_owned();
            motors.push(of_motor(changes, covariance, wander, usual[i], wanders));
        }
        motors.reverse();
        motors.try_into().ok().map(Found)
    }

    /// Mean of the times of the log, in [`wander::TIME_S`].
    fn middle(&self) -> f64 {
        self.times[0] / self.rows
    }

    /// Their variance.
    fn spread(&self) -> f64 {
        self.times[1] / self.rows - self.middle().powi(2)
    }

    /// Changes of motor `i` where torques at later joints with this rate and curvature are felt
    /// there: those in the middle of the log, and the friction at its end.
    fn of_motor(&self, i: usize, alike: f64, felt: SVector<f64, 2>) -> Option<Average> {
        let middle = self.middle();
        // From these changes to those at the clock's zero.
        let mut to = Square::identity();
        to[(0, CHANGES)] = -middle;
        to[(0, CHANGES + 1)] = middle * middle / 2.0;
        to[(CHANGES, CHANGES + 1)] = -middle;
        to[(FRICTION, WARMS)] = -self.last;
        // Where changes explain the log badly, they are less sure.
        let alike = alike * self.left_with(i, &Vector3::zeros())?.max(1.0);
        let information = to.transpose() * self.information[i] * to / alike;
        let mut evidence = to.transpose() * self.evidence[i] / alike;
        if self.coulomb[i] > 0.0 {
            let mut known = Long::zeros();
            let part = -felt / self.coulomb[i];
            known.fixed_rows_mut::<2>(CHANGES).copy_from(&part);
            evidence -= information * known;
        }
        average(&information, &evidence)
    }

    /// What this log seems to tell of changes of motor `i`, squared and per its covariance, and
    /// what to expect of that where nothing has changed and errors are alike for [`ALIKE_S`].
    #[must_use]
    pub fn seems(&self, i: usize) -> Option<[f64; 2]> {
        let information = self.information[i].fixed_view::<CHANGES, CHANGES>(0, 0);
        let evidence = self.evidence[i].fixed_rows::<CHANGES>(0);
        let covariance = (information + usual_information()).try_inverse()?;
        let told = (covariance * evidence).dot(&evidence);
        Some([told, (covariance * information).trace()])
    }

    /// The constant force on the tool that explains what no changes do, N; `None`: there is none,
    /// or too little. `alike`: as in [`Self::found`].
    #[must_use]
    pub fn force_n(&self, alike: [f64; 3]) -> Option<[f64; 3]> {
        let (force, odds) = self.force(alike)?;
        (odds > FORCE_ODDS).then_some(force.into())
    }

    /// The constant force that explains best what the changes do not, N, and the logarithm of the
    /// odds that there is one. A torque that it makes at a motor changes with the lever, an offset
    /// does not.
    fn force(&self, alike: [f64; 3]) -> Option<(Vector3<f64>, f64)> {
        let (force, _) = self.force_of(alike)?;
        // Where changes and force explain the log badly, they tell less.
        let mut times = alike;
        for (i, times) in times.iter_mut().enumerate() {
            *times *= self.left_with(i, &force)?.max(1.0);
        }
        self.force_of(times)
    }

    /// The same where errors are alike for so many times [`ALIKE_S`].
    fn force_of(&self, alike: [f64; 3]) -> Option<(Vector3<f64>, f64)> {
        let usual = Matrix3::identity() / (FORCE_N * FORCE_N);
        let (mut information, mut evidence) = (usual, Vector3::zeros());
        for (i, alike) in alike.into_iter().enumerate() {
            let covariance = (self.information[i] / alike + with_time(1.0)).try_inverse()?;
            let across = self.across[i] / alike;
            information += self.of_force[i] / alike - across.transpose() * covariance * across;
            evidence += self.for_force[i] / alike
                - across.transpose() * covariance * self.evidence[i] / alike;
        }
        let covariance = information.try_inverse()?;
        let force = covariance * evidence;
        let odds = force.dot(&evidence) + (usual.determinant() * covariance.determinant()).ln();
        Some((force, odds / 2.0))
    }

    /// Square of what all changes of motor `i` leave of a log with this force, per the noise in
    /// training.
    fn left_with(&self, i: usize, force: &Vector3<f64>) -> Option<f64> {
        let evidence = self.evidence[i] - self.across[i] * force;
        let squares = self.squares[i] - 2.0 * force.dot(&self.for_force[i])
            + force.dot(&(self.of_force[i] * force));
        let all = (self.information[i] + with_time(1.0)).try_inverse()? * evidence;
        Some((squares - all.dot(&evidence)) / (self.told_s / ALIKE_S))
    }
}

#[cfg(test)]
mod tests {
    use super::found::DRIFT;
    use super::*;

    const COULOMB: [f64; 3] = [1.4, 1.1, 18.0];

    /// What a minute finds with these changes, and this much more at a time at the elbow's joint.
    fn minute(made: [[f64; CHANGES]; 3], more: impl Fn(f64) -> f64) -> Found {
        let sums = free(made, more, 3);
        sums.found([0.0; 3], [1.0; 3], FOLLOWED).expect("finite")
    }

    /// The sums of such a minute.
    fn free(made: [[f64; CHANGES]; 3], more: impl Fn(f64) -> f64, seed: u64) -> Free {
        let coulomb = COULOMB;
        let mut sums = Free::default();
        let mut noise = robot::random::Random::stream(seed, "recalibration", 0);
        for n in 0..3_000 {
            let t = f64::from(n) * 0.02;
            let mut m = Moment::default();
            let of = core::array::from_fn(|i| {
                m.motors[i] = 0.3 * (0.4 * t + i as f64).sin();
                let direction = (0.4 * t + i as f64).cos().signum();
                for level in [MOTION, DIRECTION] {
                    m.stops[i * crate::motion::LEVELS + level] = direction;
                }
                m.torque[i] = coulomb[i] * (direction + 0.8 * (0.13 * t).sin());
                effects(&m, i, coulomb[i], coulomb[i] * direction)
            });
            let lacking = core::array::from_fn(|i| {
                Vector::from(of[i]).dot(&Vector::from(made[i]))
                    + 0.005 * coulomb[i] * noise.normal()
                    + [-COUPLING[1][0], 1.0, 0.0][i] * more(t)
            });
            let variance = coulomb.map(|c| (0.005 * c).powi(2));
            sums.push(t, &of, lacking, variance, &Matrix3::zeros(), 0.02);
        }
        assert!((sums.told_s - 60.0).abs() < 1e-6);
        sums
    }

    #[test]
    fn a_minute_that_shows_no_change_of_a_kind_leaves_it_alone_and_is_sure_of_it() {
        let none = minute([[0.0; CHANGES]; 3], |_| 0.0);
        for (i, coulomb) in COULOMB.into_iter().enumerate() {
            let change = none.of_motor(i, coulomb);
            assert_eq!(change.surely("N·m"), Vec::<String>::new());
            // An offset and an asymmetry look the same, and hide each other.
            assert!(change.offset.abs() < 0.002 * coulomb, "{change:?}");
            assert!(change.deviation[0] < 0.02 * coulomb, "{change:?}");
        }
        let mut made = [[0.0; CHANGES]; 3];
        made[0][FRICTION] = -0.02;
        let change = minute(made, |_| 0.0).of_motor(0, COULOMB[0]);
        assert!((change.friction - 0.02).abs() < 0.003, "{change:?}");
        assert!(change.offset.abs() < 0.002 * COULOMB[0], "{change:?}");
        assert_eq!(change.surely("N·m"), ["friction rose by 2.0 %"]);
    }

    /// Where the log shows every kind, the average is the least squares of all; where it shows
    /// nothing, nothing has changed and half of each kind's usual variance is left.
    #[test]
    fn an_average_over_kinds_goes_from_nothing_to_the_least_squares_of_all() {
        let truth = Long::from([0.2, -0.2, 0.06, 0.15, -0.1, 0.2, 0.1, -0.1, 0.02]);
        let mix = Square::from_fn(|i, j| {
            if i == j {
                1.0
            } else {
                0.3 / (1 + i + j) as f64
            }
        });
        let information = mix.transpose() * mix * 1e10;
        let evidence = information * truth;
        let Average {
            mean, covariance, ..
        } = average(&information, &evidence).expect("finite");
        let all = (information + with_time(SPREAD[0]))
            .try_inverse()
            .expect("positive");
        assert!((mean - all * evidence).norm() < 1e-9, "{mean}");
        assert!(
            (covariance - all).norm() < 1e-6 * all.norm(),
            "{covariance}"
        );
        let Average {
            mean,
            covariance,
            wanders,
            size,
        } = average(&Square::zeros(), &Long::zeros()).expect("finite");
        assert_eq!(mean, Long::zeros());
        assert!((wanders - 0.5).abs() < 1e-12, "{wanders}");
        let squares = SIZES.map(|size| size * size / 4.0).iter().sum::<f64>();
        assert!((size * size - squares).abs() < 1e-12, "{size}");
        for (k, sd) in SPREAD.into_iter().enumerate() {
            // A torque that comes and goes is as far from zero as it moves.
            let more = if k == OFFSET { squares } else { 0.0 };
            assert!(
                (covariance[(k, k)] - sd * sd / 2.0 - more).abs() < 1e-12,
                "{covariance}"
            );
        }
    }

    #[test]
    fn a_force_that_stayed_on_the_tool_is_told_from_offsets_by_its_levers() {
        let told_beside = |error: f64, force: Vector3<f64>, offset: f64, swing: f64| {
            let mut sums = Free::default();
            let mut noise = robot::random::Random::stream(4, "force", 0);
            for n in 0..3_000 {
                let t = f64::from(n) * 0.02;
                let lever = |k: f64| 1.0 + swing * (0.3 * t + k).sin();
                let levers = Matrix3::from_fn(|i, j| {
                    0.1 * lever((3 * i + j) as f64) * if i == j { 1.0 } else { 0.3 }
                });
                let of = [[1.0, (0.4 * t).cos().signum(), 0.5, 0.0, 0.0, 1.0]; 3];
                let error = |i: usize| error * (0.45 * t + i as f64).sin();
                let lacking = levers * force
                    + Vector3::from_fn(|i, _| offset + error(i) + 0.005 * noise.normal());
                sums.push(t, &of, lacking.into(), [2.5e-5; 3], &levers, 0.02);
            }
            sums.force_n([1.0; 3])
        };
        let told = |force, offset, swing| told_beside(0.0, force, offset, swing);
        let force = Vector3::new(0.5, 2.0, -1.0);
        let found = Vector3::from(told(force, 0.0, 0.3).expect("a force"));
        assert!((found - force).norm() < 0.3, "{found}");
        let found = Vector3::from(told(force, 0.05, 0.3).expect("a force beside an offset"));
        assert!((found - force).norm() < 0.3, "{found}");
        assert_eq!(told(Vector3::zeros(), 0.05, 0.3), None);
        // Levers that stay make it an offset.
        assert_eq!(told(force, 0.0, 0.0), None);
        // A model that is wrong by more than that: neither changes nor a force explain it.
        assert_eq!(told_beside(0.2, Vector3::zeros(), 0.0, 0.3), None);
    }

    #[test]
    fn errors_that_stay_longer_make_a_minute_say_less() {
        // The same error for so many seconds, at the elbow.
        let seems = |stay_s: f64| {
            let of = |seed: u64| {
                let error = |t: f64| {
                    let mut random =
                        robot::random::Random::stream(seed, "slow", (t / stay_s) as u64);
                    0.01 * COULOMB[1] * random.normal()
                };
                free([[0.0; CHANGES]; 3], error, seed)
                    .seems(1)
                    .expect("finite")
            };
            let sum = (0..20)
                .map(of)
                .fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
            sum[0] / sum[1]
        };
        let (quick, slow) = (seems(0.5), seems(8.0));
        assert!(slow > 8.0 * quick, "{quick} {slow}");
        let mut made = [[0.0; CHANGES]; 3];
        made[0][FRICTION] = -0.02;
        let sums = free(made, |_| 0.0, 3);
        let deviation = |alike: f64| {
            let found = sums
                .found([0.0; 3], [alike, 1.0, 1.0], FOLLOWED)
                .expect("finite");
            found.of_motor(0, COULOMB[0]).deviation[1]
        };
        assert!(deviation(100.0) > 2.0 * deviation(1.0));
    }

    #[test]
    fn a_torque_that_comes_and_goes_is_told_from_changes_that_stay() {
        let made = [
            [0.0; CHANGES],
            [0.05, -0.06, 0.0, 0.0, 0.0, 0.0],
            [0.0; CHANGES],
        ];
        for phase in [0.0, 1.0, 2.0, 4.5] {
            let drag = |t: f64| 0.2 * (t / wander::TIME_S + phase).sin();
            let found = minute(made, drag);
            let sizes = found.wander(COULOMB).expect("it comes and goes");
            assert!((0.1..0.3).contains(&sizes[1]), "{sizes:?}");
            assert!(sizes[0] == 0.0 && sizes[2] == 0.0, "{sizes:?}");
            // The offset is that of the minute's mean.
            let mean = (0..600).map(|n| drag(0.1 * f64::from(n))).sum::<f64>() / 600.0;
            let change = found.of_motor(1, COULOMB[1]);
            let constant = change.offset / COULOMB[1] - change.asymmetry;
            assert!(
                (constant - 0.05 - mean / COULOMB[1]).abs() < 0.02,
                "{change:?}"
            );
        }
        assert_eq!(minute(made, |_| 0.1).wander(COULOMB), None);
    }

    #[test]
    fn friction_that_warms_is_that_of_the_end_and_no_torque_that_comes_and_goes() {
        // The elbow's friction falls by 1 % within the minute.
        let falls = |t: f64| {
            let direction = (0.4 * t + 1.0).cos().signum();
            -0.01 * t / 60.0 * COULOMB[1] * direction
        };
        let found = minute([[0.0; CHANGES]; 3], falls);
        assert_eq!(found.wander(COULOMB), None);
        let change = found.of_motor(1, COULOMB[1]);
        assert!((change.friction - 0.01).abs() < 0.001, "{change:?}");
    }

    /// A line through evenly spaced times is half as sure at its end as in its middle.
    #[test]
    fn friction_that_warms_is_as_sure_as_a_line_at_its_end() {
        let variance = |warms: f64| {
            let friction = |t: f64| {
                let direction = (0.4 * t + 1.0).cos().signum();
                (0.1 - warms * t / 60.0) * COULOMB[1] * direction
            };
            let sums = free([[0.0; CHANGES]; 3], friction, 3);
            let Average { covariance, .. } = sums
                .of_motor(1, 0.01, SVector::zeros())
                .expect("finite numbers");
            covariance[(FRICTION, FRICTION)]
        };
        let ratio = variance(0.02) / variance(0.0);
        assert!((3.2..4.4).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_minute_that_no_change_explains_leaves_all_of_them_less_sure() {
        let deviation = |quick: f64| {
            let more = |t: f64| quick * COULOMB[1] * (9.0 * t).sin();
            let found = minute([[0.0; CHANGES]; 3], more);
            found.of_motor(1, COULOMB[1]).deviation[1]
        };
        let [quiet, loud] = [0.0, 0.1].map(deviation);
        assert!(loud > 2.0 * quiet, "{quiet} {loud}");
    }

    #[test]
    fn a_torque_that_may_be_there_is_followed_by_its_chance_and_not_told() {
        let found = |slope: f64| {
            let more = |t: f64| slope * COULOMB[1] * t / wander::TIME_S;
            minute([[0.0; CHANGES]; 3], more)
        };
        let size = |found: &Found| found.wander(COULOMB).unwrap_or_default()[1] / COULOMB[1];
        let [none, maybe, sure] = [0.0, 0.006, 0.03].map(found);
        assert_eq!(size(&none), 0.0);
        let chance = maybe.0[1].wanders;
        assert!((0.2..0.8).contains(&chance), "{chance}");
        let usual = chance.sqrt() * SIZES[0]..chance.sqrt() * SIZES[1];
        assert!(usual.contains(&size(&maybe)), "{}", size(&maybe));
        assert!((0.04..0.12).contains(&size(&sure)), "{}", size(&sure));
        let more = |t: f64| 0.03 * COULOMB[1] * t / wander::TIME_S;
        let sums = free([[0.0; CHANGES]; 3], more, 3);
        let never = sums.found([0.0; 3], [1.0; 3], 1.0).expect("finite");
        assert_eq!(never.wander(COULOMB), None);
        let told = [none, maybe, sure].map(|found| found.of_motor(1, COULOMB[1]).wander > 0.0);
        assert_eq!(told, [false, false, true]);
    }

    #[test]
    fn a_motor_whose_effort_is_not_logged_tells_nothing_and_hinders_nothing() {
        let mut sums = Free::default();
        for n in 0..3_000 {
            let t = f64::from(n) * 0.02;
            let torque = 0.1 * (t / wander::TIME_S).sin();
            let effects = [
                [0.0; CHANGES],
                [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [0.0; CHANGES],
            ];
            let lacking = [0.0, torque, 0.0];
            sums.push(t, &effects, lacking, [2.5e-5; 3], &Matrix3::zeros(), 0.02);
        }
        let found = sums.found([0.0; 3], [1.0; 3], FOLLOWED).expect("finite");
        let sizes = found.wander([0.0, 1.0, 0.0]).expect("it comes and goes");
        assert!(
            sizes[0] == 0.0 && sizes[1] > 0.05 && sizes[2] == 0.0,
            "{sizes:?}"
        );
    }

    /// What is constant is told of offset and asymmetry together, and not of each.
    #[test]
    fn beside_a_torque_that_comes_and_goes_what_is_constant_is_as_sure_as_it_was() {
        let more = |t: f64| 0.03 * COULOMB[1] * t / wander::TIME_S;
        let mut made = [[0.0; CHANGES]; 3];
        made[1] = [0.02, 0.0, 0.0, 0.0, 0.0, 0.1];
        let found = minute(made, more);
        assert!(found.wander(COULOMB).is_some());
        let variance = |row: [f64; CHANGES]| found.adds(1, &row.map(|x| x * COULOMB[1])).1;
        let alone = variance([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let both = variance([1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert!(both < 0.1 * alone, "{both} {alone}");
    }

    /// At a stiff elbow the torque of a cable is a few hundredths of the friction, and where it is
    /// largest it hardly moves.
    #[test]
    fn a_small_torque_that_hardly_moves_within_the_minute_is_followed() {
        let turns = |t: f64| -0.03 * COULOMB[1] * ((t - 30.0) / wander::TIME_S).cos();
        let chance = |more: &dyn Fn(f64) -> f64| {
            let sums = free([[0.0; CHANGES]; 3], more, 3);
            let found = sums
                .found([0.0; 3], [20.0; 3], FOLLOWED)
                .expect("finite numbers");
            found.0[1].wanders
        };
        let [none, small] = [chance(&|_| 0.0), chance(&turns)];
        assert!(none < FOLLOWED && small > 2.0 * FOLLOWED, "{none} {small}");
    }

    #[test]
    fn a_torque_that_came_and_went_in_training_is_expected_and_told_where_it_was_seen_alone() {
        let sums = |drag: f64| {
            let mut sums = Free::default();
            for n in 0..3_000 {
                let t = f64::from(n) * 0.02;
                let effects = [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]; 3];
                let torque = 0.02 + drag * (t / wander::TIME_S).sin();
                let lacking = [-COUPLING[1][0] * torque, torque, 0.0];
                sums.push(t, &effects, lacking, [2.5e-5; 3], &Matrix3::zeros(), 0.02);
            }
            sums.found([0.0, 0.03, 0.0], [1.0; 3], FOLLOWED)
                .expect("finite")
        };
        let quiet = sums(0.0);
        assert_eq!(quiet.wander([1.0; 3]), Some([0.0, 0.03, 0.0]));
        assert_eq!(quiet.of_motor(1, 1.0).wander, 0.0);
        // One that was seen has its own size, and at least the usual one.
        let seen = sums(0.06);
        let size = seen.of_motor(1, 1.0).wander;
        assert!((0.03..0.1).contains(&size), "{size}");
        assert_eq!(seen.wander([1.0; 3]), Some([0.0, size, 0.0]));
    }

    #[test]
    fn friction_that_was_found_above_that_of_training_is_less_sure() {
        let sure = |friction: f64| {
            let mut made = [[0.0; CHANGES]; 3];
            made[0][FRICTION] = friction;
            minute(made, |_| 0.0).of_motor(0, COULOMB[0]).deviation[1]
        };
        // The balance is what the model expects less what is commanded.
        assert!(sure(-0.1) > 1.5 * sure(0.1), "{} {}", sure(-0.1), sure(0.1));
    }

    #[test]
    fn a_minute_tells_the_changes_of_each_motor() {
        let made = [
            [0.05, -0.06, 0.02, 0.1, 0.0, 0.0],
            [0.0; CHANGES],
            [-0.1, 0.03, 0.0, 0.0, -0.08, 0.12],
        ];
        let coulomb = COULOMB;
        let found = minute(made, |_| 0.0);
        assert_eq!(found.wander(COULOMB), None);
        for i in 0..3 {
            let change = found.of_motor(i, coulomb[i]);
            let [offset, friction, gain, sine, cosine, asymmetry] = made[i];
            // Where a contact slides all the time, an offset and an asymmetry look the same.
            let constant = change.offset / coulomb[i] - change.asymmetry;
            for (got, expected) in [
                (constant, offset + asymmetry),
                (change.friction, -friction),
                (change.gain, gain),
                (change.ripple, f64::hypot(sine, cosine)),
            ] {
                assert!((got - expected).abs() < 0.01, "motor {i}: {change:?}");
            }
            // What is far from usual is less sure.
            let row = [coulomb[i], coulomb[i], 0.0, 0.0, 0.0, coulomb[i]];
            assert!(found.adds(i, &row).1 > (DRIFT * coulomb[i]).powi(2));
        }
    }

    #[test]
    fn changes_that_no_robot_has_are_told_from_large_ones() {
        let found = |friction: f64, gain: f64| {
            let mut made = [[0.0; CHANGES]; 3];
            (made[0][FRICTION], made[0][GAIN]) = (-friction, gain);
            let change = minute(made, |_| 0.0).of_motor(0, COULOMB[0]);
            change.is_of_a_robot()
        };
        assert!(found(-0.24, 0.0) && found(0.5, 0.06));
        assert!(!found(-1.2, 0.0) && !found(0.0, -2.0) && !found(8.0, 0.0));
        // What 4 N on the tool look like.
        assert!(!found(-0.6, 0.0) && !found(-0.3, -0.55));
    }
}
