//! Whether a model still fits its robot, told without a force sensor.
//!
//! Three motors tell one force, and one of less than three components leaves equations to spare: what the balances lack must be what a
//! force can do to them. The force that explains them best is taken out, with the spread of the training as prior. What is left, in units
//! of its noise, averaged over each of `ALIKE_S` and squared over `MISFIT_S`, is the misfit: what comes with each turn of a motor is in the
//! first, a torque that stays in the last. Each is compared with that of trials which the model had not seen.

use nalgebra::{Matrix3, Vector3};

/// Times over which noise is averaged out, s: not at all, that in which errors of a balance are alike, and that of a turn of a joint.
const ALIKE_S: [f64; TIMES] = [0.0, 2.0, 10.0];
/// Number of averages.
pub const TIMES: usize = 3;
/// Time over which it is asked, s.
const MISFIT_S: f64 = 20.0;

/// See the module's page.
#[derive(Debug, Clone, Default)]
pub struct Misfit {
    mean: [Vector3<f64>; TIMES],
    mean_square: [f64; TIMES],
}

impl Misfit {
    /// Takes what the balances lack, its variances, levers, and the inverse of the second moments of the force; gives
    /// the misfit: RMS of what is left, in units of its noise.
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
        let force = (of_force * levers + prior)
            .try_inverse()
            .map_or_else(Vector3::zeros, |covariance| covariance * of_force * lacking);
        let left = (lacking - levers * force).component_div(&variance.map(f64::sqrt));
        let share = |time_s: f64| 1.0 - (-elapsed_s / time_s).exp();
        let more = share(MISFIT_S);
        core::array::from_fn(|k| {
            let (mean, square) = (&mut self.mean[k], &mut self.mean_square[k]);
            *mean += (left - *mean)
                * if ALIKE_S[k] > 0.0 {
                    share(ALIKE_S[k])
                } else {
                    1.0
                };
            *square += (mean.norm_squared() - *square) * more;
            square.sqrt()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Misfit after a minute of a force along y that goes back and forth, with this much more at the balance of motor 1.
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
        // To and fro within a second: in the first alone.
        let ripple = after_a_minute(|t| 0.024 * (9.0 * t).sin(), 0.0);
        assert!(ripple[0] > 1.5 && ripple[2] < 0.3, "{ripple:?}");
        // A force where there was none in training is one too: the model was not trained for it.
        let other = after_a_minute(|_| 0.0, 0.5);
        assert!(other[1] > 2.0, "{other:?}");
    }
}
