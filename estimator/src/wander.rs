//! A torque at a joint that comes and goes within minutes, as that of a tool's cable, and friction
//! that goes on changing, told from the force on the tool.
//!
//! What a balance lacks is what the force and these do together:
//!
//! ```text
//! balance = levers * force + coupling * torque + friction * share + noise        each motor
//! ```
//!
//! The torque is at a joint. The cables of the later joints run over the earlier ones, so that a
//! torque at the elbow is felt by the shoulder's motor too ([`torques_at_motors`]), as a force is.
//! Taken for one at the elbow's motor alone, the shoulder's balance seemed to tell it from a force
//! along y, and told wrongly.
//!
//! Force and torque are slow processes: each has a size and a rate, and goes back to its mean
//! (Matérn, 3/2). A Kalman filter with both as states tells them apart by what the other motors say
//! of the force, and by the force's size and rate in training. Where that is little, its covariance
//! says how little: on such processes no estimator that has the same balances does better.
//!
//! Friction turns its sign with the motion, which no slow force does, so what has changed of it is
//! told well. It walks from what a recalibration has found: [`Share`].

use crate::motion::torques_at_motors;
use nalgebra::{Matrix3, RowSVector, SMatrix, SVector, Vector3};

/// Force, its rate, torque, its rate, share of the friction; three of each.
const STATES: usize = 15;
const TORQUE: usize = 6;
const SHARE: usize = 12;
/// Time in which a tool's cable changes its torque by as much as its size, s: a sinusoid of five
/// minutes (docs/robot.md) has this one.
pub const TIME_S: f64 = 48.0;
/// Time in which errors of a balance are alike here, s. Their means over 10 s are 0.4 to 0.7 of
/// those over 2 s, those over 30 s another 0.5 (virtual arm, seeds 11 to 13, trials that were not
/// trained on).
pub const ALIKE_S: f64 = 6.0;
/// Size of the errors that stay for a minute, per the noise of the balance: covers their means over
/// 30 s (0.2 to 0.6, the same seeds).
const STAYS: f64 = 0.8;
/// Standard deviation of the torque as told per that of the filter: neither force nor cable is
/// such a process. A drag of 0.1 and 0.2 N·m was covered by 93 and 92 % with 1.0 and by 95 and 94 %
/// with 1.2 (virtual arm, seeds 11 and 12), and on five robots by 97 % with 1.2.
const WIDER: f64 = 1.1;

type State = SVector<f64, STATES>;
type Covariance = SMatrix<f64, STATES, STATES>;

/// What is not known of the friction of a motor, share of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Share {
    /// Standard deviation at the start.
    pub start: f64,
    /// Variance that comes to it in time, 1/s.
    pub per_s: f64,
}

/// Processes of force, torque and friction. `COLUMNS`: series of balances that are filtered alike.
#[derive(Debug, Clone)]
pub struct Wander<const COLUMNS: usize = 1> {
    at_rest: Covariance,
    rates_per_s: [f64; 2],
    /// Transition of one step and the noise that it adds.
    one: (f64, Covariance, Covariance),
    shares: [Share; 3],
    /// Friction at the motors now.
    friction: Vector3<f64>,
    state: SMatrix<f64, STATES, COLUMNS>,
    covariance: Covariance,
}

/// Torques at the motors per torques at the joints.
fn coupling() -> Matrix3<f64> {
    let column = |k: usize| Vector3::from(torques_at_motors(Vector3::ith(k, 1.0).into()));
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// Standard deviations of independent torques at the joints that give these at the motors.
#[must_use]
pub fn at_joints(motors: [f64; 3]) -> [f64; 3] {
    let coupling = coupling();
    let mut squares = motors.map(|sd| sd * sd);
    for k in (0..3).rev() {
        for i in 0..k {
            squares[i] = (squares[i] - coupling[(i, k)].powi(2) * squares[k]).max(0.0);
        }
    }
    squares.map(f64::sqrt)
}

/// Transition within `step_s`.
fn transition(rates_per_s: [f64; 2], step_s: f64) -> Covariance {
    let mut a = Covariance::identity();
    for (k, rate) in rates_per_s.into_iter().enumerate() {
        let x = rate * step_s;
        let e = (-x).exp();
        for i in 6 * k..6 * k + 3 {
            a[(i, i)] = e * (1.0 + x);
            a[(i, i + 3)] = e * step_s;
            a[(i + 3, i)] = -e * rate * x;
            a[(i + 3, i + 3)] = e * (1.0 - x);
        }
    }
    a
}

impl<const COLUMNS: usize> Wander<COLUMNS> {
    /// `force`: second moments of the force, N²; `rate_per_s`: its rate per its size, 1/s; `sizes`:
    /// standard deviations of the torques that come and go, at the joints; `noise`: those of the
    /// balances, of which a part stays for minutes; `shares`: what is not known of the friction.
    #[must_use]
    pub fn new(
        force: &Matrix3<f64>,
        rate_per_s: f64,
        sizes: [f64; 3],
        noise: [f64; 3],
        shares: [Share; 3],
        step_s: f64,
    ) -> Self {
        let rates_per_s = [rate_per_s, 1.0 / TIME_S];
        let mut at_rest = Covariance::zeros();
        let coupled = coupling() * Matrix3::from_diagonal(&Vector3::from(sizes));
        let stays = Vector3::from(noise).map(|noise| (STAYS * noise).powi(2));
        // At the motors.
        let torque = coupled * coupled.transpose() + Matrix3::from_diagonal(&stays);
        for (k, part) in [*force, torque].into_iter().enumerate() {
            at_rest
                .fixed_view_mut::<3, 3>(6 * k, 6 * k)
                .copy_from(&part);
            let rate = part * rates_per_s[k].powi(2);
            at_rest
                .fixed_view_mut::<3, 3>(6 * k + 3, 6 * k + 3)
                .copy_from(&rate);
        }
        for (i, share) in shares.iter().enumerate() {
            at_rest[(SHARE + i, SHARE + i)] = share.start.powi(2);
        }
        let a = transition(rates_per_s, step_s);
        Self {
            at_rest,
            rates_per_s,
            one: (step_s, a, at_rest - a * at_rest * a.transpose()),
            shares,
            friction: Vector3::zeros(),
            state: SMatrix::zeros(),
            covariance: at_rest,
        }
    }

    /// Takes what the balances lack, its variances, levers and friction; gives what of each balance
    /// the processes did not expect, and the variance of that.
    pub fn step(
        &mut self,
        lacking: &SMatrix<f64, 3, COLUMNS>,
        variance: &Vector3<f64>,
        levers: &Matrix3<f64>,
        friction: &Vector3<f64>,
        elapsed_s: f64,
    ) -> [(RowSVector<f64, COLUMNS>, f64); 3] {
        let (a, more) = if elapsed_s == self.one.0 {
            (self.one.1, self.one.2)
        } else {
            let a = transition(self.rates_per_s, elapsed_s);
            (a, self.at_rest - a * self.at_rest * a.transpose())
        };
        self.state = a * self.state;
        self.covariance = a * self.covariance * a.transpose() + more;
        for (i, share) in self.shares.iter().enumerate() {
            self.covariance[(SHARE + i, SHARE + i)] += share.per_s * elapsed_s;
        }
        self.friction = *friction;
        let times = (ALIKE_S / elapsed_s).max(1.0);
        let new = core::array::from_fn(|i| {
            let mut row = State::zeros();
            for k in 0..3 {
                row[k] = levers[(i, k)];
            }
            row[TORQUE + i] = 1.0;
            row[SHARE + i] = friction[i];
            let with = self.covariance * row;
            let variance = row.dot(&with) + variance[i] * times;
            let gain = with / variance;
            let new = lacking.row(i) - row.transpose() * self.state;
            self.state += gain * new;
            self.covariance -= gain * with.transpose();
            (new, variance)
        });
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        new
    }

    /// Forgets the past.
    pub fn forget(&mut self) {
        self.state = SMatrix::zeros();
        self.covariance = self.at_rest;
    }
}

impl Wander {
    /// Torques at the motors now that are not the force's, with those of friction that has changed,
    /// and the covariance of their errors.
    #[must_use]
    pub fn torques(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let rows = |torque: f64| {
            let mut rows = SMatrix::<f64, 3, STATES>::zeros();
            for i in 0..3 {
                rows[(i, TORQUE + i)] = torque;
                rows[(i, SHARE + i)] = self.friction[i];
            }
            rows
        };
        let wider = rows(WIDER);
        let covariance = wider * self.covariance * wider.transpose();
        (rows(1.0) * self.state, covariance)
    }

    /// Force now, N, and the covariance of its error.
    #[must_use]
    pub fn force(&self) -> (Vector3<f64>, Matrix3<f64>) {
        (
            self.state.fixed_rows::<3>(0).into_owned(),
            self.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Friction that is as it was.
    const KNOWN: [Share; 3] = [Share {
        start: 0.0,
        per_s: 0.0,
    }; 3];

    /// Errors of the torque at motor 1, and their standard deviations as told, over minutes of a
    /// force along y and a drag there.
    fn errors(third_lever: f64) -> Vec<(f64, f64)> {
        let force = Matrix3::from_diagonal(&Vector3::new(1e-4, 4.0, 1e-4));
        let mut filter = Wander::new(&force, 0.08, [0.0, 0.14, 0.0], [0.0; 3], KNOWN, 0.02);
        let levers = Matrix3::new(0.1, 0.0, 0.04, 0.02, -0.08, 0.01, -0.4, third_lever, 0.9);
        let variance = Vector3::new(0.01, 0.01, 0.1).map(|sd: f64| sd * sd);
        let mut noise = robot::random::Random::stream(5, "wander", 0);
        let mut out = Vec::new();
        for n in 0..15_000 {
            let t = f64::from(n) * 0.02;
            let drag = 0.2 * (t / TIME_S).sin();
            let y = 2.5 * (0.083 * t).sin() + 1.8 * (0.051 * t + 2.0).sin();
            // White noise of the power that is expected.
            let balances = levers * Vector3::new(0.0, y, 0.0)
                + coupling() * Vector3::new(0.0, drag, 0.0)
                + variance.map(|v| (v * ALIKE_S / 0.02).sqrt() * noise.normal());
            filter.step(&balances, &variance, &levers, &Vector3::zeros(), 0.02);
            if t > 60.0 {
                let (torques, covariance) = filter.torques();
                out.push((torques[1] - drag, covariance[(1, 1)].sqrt()));
                let at_elbow = coupling() * Vector3::new(0.0, torques[1], 0.0);
                assert!((torques - at_elbow).norm() < 1e-9, "{torques}");
            }
        }
        out
    }

    fn rms(values: impl Iterator<Item = f64>) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for value in values {
            sum += value * value;
            count += 1.0;
        }
        f64::sqrt(sum / count)
    }

    #[test]
    fn another_motor_that_feels_the_force_tells_the_torque_and_without_one_it_stays_unsure() {
        let told = errors(0.5);
        let error = rms(told.iter().map(|(error, _)| *error));
        assert!(error < 0.02, "{error}");
        let alone = errors(0.0);
        let error_alone = rms(alone.iter().map(|(error, _)| *error));
        let sure = rms(told.iter().map(|(_, sd)| *sd));
        let unsure = rms(alone.iter().map(|(_, sd)| *sd));
        assert!(error_alone > 2.0 * error && unsure > 2.0 * sure);
        for (errors, name) in [(told, "told"), (alone, "alone")] {
            let inside = errors
                .iter()
                .filter(|(e, sd)| e.abs() <= 1.645 * sd)
                .count();
            let share = inside as f64 / errors.len() as f64;
            assert!(share > 0.85, "{name}: {share}");
        }
    }

    #[test]
    fn a_torque_at_the_elbow_is_told_by_the_shoulder_too() {
        let force = Matrix3::identity();
        let none = Matrix3::zeros();
        let mut filter = Wander::new(&force, 0.1, [0.0, 0.1, 0.0], [0.01; 3], KNOWN, 0.02);
        // What the shoulder alone tells: the elbow's balance is as good as unknown.
        let variance = Vector3::new(1e-6, 1e6, 1e6);
        let lacking = coupling() * Vector3::new(0.0, 0.2, 0.0);
        for _ in 0..500 {
            filter.step(&lacking, &variance, &none, &Vector3::zeros(), 0.02);
        }
        assert!(filter.torques().0[1] > 0.1, "{}", filter.torques().0);
        let motors = coupling().map(|c| c * c) * Vector3::new(0.04, 0.01, 4.0);
        let sizes = at_joints(motors.map(f64::sqrt).into());
        for (size, made) in sizes.into_iter().zip([0.2, 0.1, 2.0]) {
            assert!((size - made).abs() < 1e-12, "{sizes:?}");
        }
        assert_eq!(at_joints([0.001, 0.1, 0.0]), [0.0, 0.1, 0.0]);
    }

    #[test]
    fn what_was_told_fades_over_a_gap_and_is_forgotten_at_a_start() {
        let force = Matrix3::identity();
        let mut filter = Wander::new(&force, 0.1, [0.0, 0.1, 0.0], [0.0; 3], KNOWN, 0.02);
        let fresh = filter.torques().1[(1, 1)];
        // No lever of a force: the balance is the torque.
        let none = Matrix3::zeros();
        let lacking = coupling() * Vector3::new(0.0, 0.08, 0.0);
        let variance = Vector3::repeat(1e-6);
        for _ in 0..500 {
            filter.step(&lacking, &variance, &none, &Vector3::zeros(), 0.02);
        }
        let (torques, covariance) = filter.torques();
        assert!((torques[1] - 0.08).abs() < 0.002 && covariance[(1, 1)] < 0.01 * fresh);
        let unknown = Vector3::repeat(1e6);
        filter.step(&lacking, &unknown, &none, &Vector3::zeros(), 10.0 * TIME_S);
        let (torques, covariance) = filter.torques();
        assert!(torques[1].abs() < 0.001 && covariance[(1, 1)] > 0.99 * fresh);
        filter.step(&lacking, &variance, &none, &Vector3::zeros(), 0.02);
        filter.forget();
        assert_eq!(filter.torques(), (Vector3::zeros(), filter.torques().1));
        assert!((filter.torques().1[(1, 1)] - fresh).abs() < 1e-12);
    }

    /// Error of the force along y after three minutes in which the friction of motor 1 fell by a
    /// fiftieth, and its standard deviation as told.
    fn beside_falling_friction(shares: [Share; 3]) -> (f64, f64) {
        let force = Matrix3::from_diagonal(&Vector3::new(1e-4, 4.0, 1e-4));
        let mut filter = Wander::new(&force, 0.08, [0.0; 3], [0.0; 3], shares, 0.02);
        let levers = Matrix3::new(0.1, 0.0, 0.04, 0.02, -0.08, 0.01, -0.4, 0.0, 0.9);
        let variance = Vector3::new(1.0, 1e-4, 1e4);
        let mut noise = robot::random::Random::stream(5, "friction", 0);
        let mut squares = 0.0;
        let mut count = 0.0;
        for n in 0..9_000 {
            let t = f64::from(n) * 0.02;
            let friction = Vector3::new(0.0, 3.0 * (0.9 * t).sin().signum(), 0.0);
            let y = 2.5 * (0.083 * t).sin();
            let mut lacking = levers * Vector3::new(0.0, y, 0.0) + friction * (0.02 * t / 180.0);
            lacking[1] += (variance[1] * ALIKE_S / 0.02).sqrt() * noise.normal();
            filter.step(&lacking, &variance, &levers, &friction, 0.02);
            if t > 120.0 {
                let error = filter.force().0[1] - y;
                squares += error * error;
                count += 1.0;
            }
        }
        (f64::sqrt(squares / count), filter.force().1[(1, 1)].sqrt())
    }

    #[test]
    fn friction_that_falls_under_load_is_told_from_the_force() {
        let cold = Share {
            start: 0.003,
            per_s: 0.02 * 0.02 / 180.0,
        };
        let (error, sure) = beside_falling_friction([cold; 3]);
        let (known, _) = beside_falling_friction(KNOWN);
        assert!(error < 0.6 * known, "{error} {known}");
        assert!(error < 1.5 * sure, "{error} {sure}");
    }
}
