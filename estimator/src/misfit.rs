//! Whether a model still fits its robot, told without a force sensor.
//!
//! Three motors tell one force, and one of less than three components leaves equations to spare:
//! what the balances lack must be what a force can do to them. The force that explains them best is
//! taken out, with the spread of the training as prior. What is left, in units of its noise, is the
//! misfit in three ways: as it is and averaged over `ALIKE_S`, both squared over `MISFIT_S`, and as
//! the torques that stay for `STAYS_S` and explain it best. What comes with each turn of a motor is
//! in the first, a torque that comes and goes in minutes in the last: while a force moves the
//! levers, it alone stays. Each is compared with that of trials which the model had not seen.

use nalgebra::{Matrix3, Vector3};

/// Time in which errors of a balance are alike, over which they are averaged, s.
const ALIKE_S: f64 = 2.0;
/// Number of ways.
pub const TIMES: usize = 3;
/// Time over which it is asked, s.
const MISFIT_S: f64 = 20.0;
/// Time over which a torque is asked for that stays, s. With 60 s as many trials were told (virtual
/// arm, seeds 11 to 13).
const STAYS_S: f64 = 30.0;
/// Such a torque before anything is known, standard deviations of the noise.
const USUAL: f64 = 10.0;

/// See the module's page.
#[derive(Debug, Clone, Default)]
pub struct Misfit {
    mean: Vector3<f64>,
    mean_square: [f64; 2],
    /// Of torques that stay: information and evidence of a row, averaged.
    information: Matrix3<f64>,
    evidence: Vector3<f64>,
}

impl Misfit {
    /// Takes what the balances lack, its variances, levers, and the inverse of the second moments
    /// of the force; gives the misfit: RMS of what is left, in units of its noise.
    pub fn step(
        &mut self,
        lacking: &Vector3<f64>,
        variance: &Vector3<f64>,
        levers: &Matrix3<f64>,
        prior: &Matrix3<f64>,
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
        [square, slow, stays].map(|square| square.max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Misfit after a minute of a force along y that goes back and forth, with this much more at
    /// the balance of motor 1.
    fn after_a_minute(more: impl Fn(f64) -> f64, along_x: f64) -> [f64; TIMES] {
        let levers = Matrix3::new(0.1, 0.01, 0.04, 0.02, -0.08, 0.01, -0.4, 0.06, 0.9);
        let variance = Vector3::new(0.008, 0.005, 0.13).map(|sd: f64| sd * sd);
        // No force along x and z in training.
        let prior = Matrix3::from_diagonal(&Vector3::new(1e4, 0.25, 1e4));
        let mut misfit = Misfit::default();
        let mut last = [0.0; TIMES];
        for n in 0..3_000 {
            let t = f64::from(n) * 0.02;
            let force = Vector3::new(along_x, 3.0 * (0.2 * t).sin(), 0.0);
            let lacking = levers * force + Vector3::new(more(t), 0.0, 0.0);
            last = misfit.step(&lacking, &variance, &levers, &prior, 0.02);
        }
        last
    }

    #[test]
    fn a_force_is_no_misfit_and_a_torque_that_no_force_makes_is() {
        let force = after_a_minute(|_| 0.0, 0.0);
        assert!(force.iter().all(|misfit| *misfit < 0.3), "{force:?}");
        // Three times the noise of the balance, in all averages.
        let torque = after_a_minute(|_| 0.024, 0.0);
        assert!(
            torque.iter().all(|misfit| (1.5..4.0).contains(misfit)),
            "{torque:?}"
        );
        // Back and forth within a second: in the first alone.
        let ripple = after_a_minute(|t| 0.024 * (9.0 * t).sin(), 0.0);
        assert!(ripple[0] > 1.5 && ripple[2] < 0.3, "{ripple:?}");
        // A force where there was none in training is one too: the model was not trained for it.
        let other = after_a_minute(|_| 0.0, 0.5);
        assert!(other[1] > 2.0, "{other:?}");
    }
}
