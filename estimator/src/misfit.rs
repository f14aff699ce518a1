//! Whether a model still fits its robot, told without a force sensor.
//!
//! Three motors tell one force, and one of less than three components leaves equations to spare:
//! what the balances lack must be what a force can do to them. The force that explains them best is
//! taken out, with the spread of the training as prior. What is left, in units of its noise, is the
//! misfit in three ways: as it is and averaged over `ALIKE_S`, both squared over `MISFIT_S`, and as
//! the torques that stay for `STAYS_S` and explain it best. What comes with each turn of a motor is
//! in the first, a torque that comes and goes in minutes in the last: while a force moves the
//! levers, it alone stays.
//!
//! A fourth way uses that a force is slow: friction turns its sign within a row, and no force does.
//! What the balances lack passes the filter of [`crate::wander`], which knows how fast a force is,
//! and so does what changes would add: a torque at each motor, and a share of the friction of all
//! motors. The misfit is how well these changes explain what the filter did not expect, over
//! `STAYS_S`.
//!
//! Each way is compared with that of trials which the model had not seen.

use crate::wander::{Share, Wander};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Time in which errors of a balance are alike, over which they are averaged, s.
const ALIKE_S: f64 = 2.0;
/// Number of ways.
pub const TIMES: usize = 4;
/// Time over which it is asked, s.
const MISFIT_S: f64 = 20.0;
/// Time over which a torque is asked for that stays, s. With 60 s as many trials were told (virtual
/// arm, seeds 11 to 13).
const STAYS_S: f64 = 30.0;
/// Such a torque before anything is known, standard deviations of the noise.
const USUAL: f64 = 10.0;
/// Changes of the fourth way: a torque at each motor, a share of the friction of all.
const CHANGES: usize = 4;
/// Standard deviation of each before anything is known, per friction. Estimate: that of the
/// recalibration.
const SHARE: f64 = 0.1;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Misfit {
    /// Coulomb friction of each motor.
    coulomb: [f64; 3],
    mean: Vector3<f64>,
    mean_square: [f64; 2],
    /// Of torques that stay: information and evidence of a row, averaged.
    information: Matrix3<f64>,
    evidence: Vector3<f64>,
    /// What the balances lack, and what the changes would add to them.
    slow: Box<Wander<{ 1 + CHANGES }>>,
    /// The same two of the changes, summed.
    of_changes: SMatrix<f64, CHANGES, CHANGES>,
    for_changes: SVector<f64, CHANGES>,
}

impl Misfit {
    /// Without a past. `coulomb`: friction of each motor; the others as in [`Wander::new`].
    #[must_use]
    pub fn new(
        coulomb: [f64; 3],
        force: &Matrix3<f64>,
        rate_per_s: f64,
        noise: [f64; 3],
        step_s: f64,
    ) -> Self {
        let slow = Wander::new(
            force,
            rate_per_s,
            [0.0; 3],
            noise,
            [Share::default(); 3],
            step_s,
        );
        Self::with(coulomb, Box::new(slow))
    }

    fn with(coulomb: [f64; 3], slow: Box<Wander<{ 1 + CHANGES }>>) -> Self {
        Self {
            coulomb,
            mean: Vector3::zeros(),
            mean_square: [0.0; 2],
            information: Matrix3::zeros(),
            evidence: Vector3::zeros(),
            slow,
            of_changes: SMatrix::zeros(),
            for_changes: SVector::zeros(),
        }
    }

    /// Forgets the past.
    pub fn forget(&mut self) {
        let mut slow = self.slow.clone();
        slow.forget();
        *self = Self::with(self.coulomb, slow);
    }

    /// Takes what the balances lack, its variances, levers, the inverse of the second moments of
    /// the force, and what the model has of each motor's friction; gives the misfit: RMS of what is
    /// left, in units of its noise.
    pub fn step(
        &mut self,
        lacking: &Vector3<f64>,
        variance: &Vector3<f64>,
        levers: &Matrix3<f64>,
        prior: &Matrix3<f64>,
        friction: &Vector3<f64>,
        elapsed_s: f64,
    ) -> [f64; TIMES] {
        let weights = Matrix3::from_diagonal(&variance.map(|v| 1.0 / v));
        let of_force = levers.transpose() * weights;
        let covariance = of_force * levers + prior;
        let covariance = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let force = covariance * of_force * lacking;
        let left = lacking - levers * force;
        let share = |time_s: f64| 1.0 - (-elapsed_s / time_s).exp();
        let per_noise = left.component_div(&variance.map(f64::sqrt));
        self.mean += (per_noise - self.mean) * share(ALIKE_S);
        let now = [per_noise, self.mean];
        for (square, now) in self.mean_square.iter_mut().zip(now) {
            *square += (now.norm_squared() - *square) * share(MISFIT_S);
        }
        // What is left of torques when the force is taken out.
        let spared = weights - of_force.transpose() * covariance * of_force;
        self.information += (spared - self.information) * share(STAYS_S);
        self.evidence += (weights * left - self.evidence) * share(STAYS_S);
        let information = self.information + weights / (USUAL * USUAL);
        let stays = information.try_inverse().map_or(0.0, |covariance| {
            (covariance * self.evidence).dot(&self.evidence)
        });
        let [square, slow] = self.mean_square;
        let changes = self.changes(lacking, variance, levers, friction, elapsed_s);
        [square, slow, stays, changes].map(|square| square.max(0.0).sqrt())
    }

    /// How well changes explain what a slow force does not.
    fn changes(
        &mut self,
        lacking: &Vector3<f64>,
        variance: &Vector3<f64>,
        levers: &Matrix3<f64>,
        friction: &Vector3<f64>,
        elapsed_s: f64,
    ) -> f64 {
        let mut columns = SMatrix::<f64, 3, { 1 + CHANGES }>::zeros();
        columns.set_column(0, lacking);
        for (i, coulomb) in self.coulomb.into_iter().enumerate() {
            columns[(i, 1 + i)] = coulomb;
        }
        columns.set_column(CHANGES, friction);
        let keep = (-elapsed_s / STAYS_S).exp();
        self.of_changes *= keep;
        self.for_changes *= keep;
        let none = Vector3::zeros();
        for (new, variance) in (self.slow).step(&columns, variance, levers, &none, elapsed_s) {
            let changes = new.fixed_columns::<CHANGES>(1).transpose();
            self.of_changes += changes * changes.transpose() / variance;
            self.for_changes += changes * (new[0] / variance);
        }
        let usual = SMatrix::<f64, CHANGES, CHANGES>::identity() / (SHARE * SHARE);
        let covariance = (self.of_changes + usual).try_inverse();
        covariance.map_or(0.0, |covariance| {
            (covariance * self.for_changes).dot(&self.for_changes)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COULOMB: [f64; 3] = [1.4, 1.1, 18.0];

    /// Misfit after a minute of a force along y that goes back and forth, with this much more at
    /// the balance of a motor. Friction turns its sign every five seconds.
    fn after_a_minute(motor: usize, more: impl Fn(f64, f64) -> f64, along_x: f64) -> [f64; TIMES] {
        let levers = Matrix3::new(0.1, 0.01, 0.04, 0.02, -0.08, 0.01, -0.4, 0.06, 0.9);
        let noise = [0.008, 0.005, 0.13];
        let variance = Vector3::from(noise).map(|sd: f64| sd * sd);
        // No force along x and z in training.
        let prior = Matrix3::from_diagonal(&Vector3::new(1e4, 0.25, 1e4));
        let force = prior.try_inverse().expect("not singular");
        let mut misfit = Misfit::new(COULOMB, &force, 0.08, noise, 0.02);
        let mut last = [0.0; TIMES];
        for n in 0..3_000 {
            let t = f64::from(n) * 0.02;
            let way = if t % 10.0 < 5.0 { 1.0 } else { -1.0 };
            let force = Vector3::new(along_x, 3.0 * (0.08 * t).sin(), 0.0);
            let mut lacking = levers * force;
            lacking[motor] += more(t, way);
            let friction = Vector3::from(COULOMB) * way;
            last = misfit.step(&lacking, &variance, &levers, &prior, &friction, 0.02);
        }
        last
    }

    #[test]
    fn a_force_is_no_misfit_and_a_torque_that_no_force_makes_is() {
        let force = after_a_minute(0, |_, _| 0.0, 0.0);
        assert!(force[..3].iter().all(|misfit| *misfit < 0.3), "{force:?}");
        // Three times the noise of the balance, in all averages.
        let torque = after_a_minute(0, |_, _| 0.024, 0.0);
        assert!(
            torque[..3].iter().all(|misfit| (1.5..4.0).contains(misfit)),
            "{torque:?}"
        );
        // Back and forth within a second: in the first alone.
        let ripple = after_a_minute(0, |t, _| 0.024 * (9.0 * t).sin(), 0.0);
        assert!(ripple[0] > 1.5 && ripple[2] < 0.3, "{ripple:?}");
        // A force where there was none in training is one too: the model was not trained for it.
        let other = after_a_minute(0, |_, _| 0.0, 0.5);
        assert!(other[1] > 2.0, "{other:?}");
    }

    #[test]
    fn friction_that_a_quick_force_would_explain_is_told_since_forces_are_slow() {
        let force = after_a_minute(1, |_, _| 0.0, 0.0);
        let friction = after_a_minute(1, |_, way| 0.01 * COULOMB[1] * way, 0.0);
        // A force along y would do the same at this motor, and little at the others.
        assert!(
            friction[..3].iter().all(|misfit| *misfit < 0.3),
            "{friction:?}"
        );
        assert!(friction[3] > 4.0 * force[3], "{force:?} {friction:?}");
    }
}
