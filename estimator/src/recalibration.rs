//! What has changed of a robot since a model was trained, found on a minute of free motion.
//!
//! Each motor has an offset (zero of its amplifier), a share of its friction, a gain, a ripple of its friction over a turn, and friction
//! that is larger one way. They add to what its balance lacks, and in free motion nothing else does:
//!
//! ```text
//! balance = effects * changes + noise        each motor by itself
//! ```
//!
//! The changes are few and small, so a minute tells them: least squares with what is usual as prior. Neighbouring rows have the same
//! error, so each counts by the time between them over that in which errors are alike.
//!
//! Changes that are followed while a force is on the tool were tried, with a filter that has the force and the changes as states. At this
//! arm it took slow forces for offsets: see docs/estimation.md.

use crate::motion::{Moment, FILTER_S};
use nalgebra::{SMatrix, SVector};
use robot::kinematics::TRANSMISSION;
use serde::{Deserialize, Serialize};

/// Changes of a motor: offset per Coulomb friction, share of friction, gain, ripple (sine, cosine) per Coulomb friction, share of
/// friction that is more in positive direction.
const CHANGES: usize = 6;
/// Standard deviations before anything is known. Estimates: about the sizes of docs/robot.md, "What changes".
const SPREAD: [f64; CHANGES] = [0.1, 0.1, 0.03, 0.1, 0.1, 0.1];
/// Time in which errors of a balance are alike, s. With 0.5 s the error after a minute was up to 20 % larger, with 1 s up to 5 % (virtual
/// arm, seed 1).
const ALIKE_S: f64 = 2.0;
/// Part of a change that is of another form than its effect here: a gear's friction does not change in all contacts alike. Estimate; with
/// 0 the intervals of large changes covered 78 to 85 % (virtual arm, seed 1).
const FORM: f64 = 0.05;
/// Standard deviation of the friction's change until the next recalibration, share of it. Estimate: a tenth of the change over a day.
const DRIFT: f64 = 0.005;
/// Place of the share of friction among the changes.
const FRICTION: usize = 1;
/// Ripple of the friction over a turn that is told, share: some times what a minute finds where there is none.
const TOLD_RIPPLE: f64 = 0.03;
/// Stop operator that stands for the direction of sliding.
const DIRECTION: usize = 2;

type Vector = SVector<f64, CHANGES>;
type Matrix = SMatrix<f64, CHANGES, CHANGES>;

/// What the changes of motor `i` add to its balance. `coulomb`: size of its friction; `friction`: what the model has of it now.
#[must_use]
pub fn effects(m: &Moment, i: usize, coulomb: f64, friction: f64) -> [f64; CHANGES] {
    // Where the motor was when the filtered torque was.
    let angle = (m.motors[i] - FILTER_S * m.flow[i]) * TRANSMISSION[i];
    let sliding = coulomb * m.motor_stop(i, DIRECTION);
    [
        coulomb,
        friction,
        m.torque[i],
        sliding * angle.sin(),
        sliding * angle.cos(),
        friction.abs(),
    ]
}

/// Sums of a log of free motion.
#[derive(Debug, Clone, Default)]
pub struct Free {
    information: [Matrix; 3],
    evidence: [Vector; 3],
    /// Time of the rows, s.
    pub told_s: f64,
}

impl Free {
    /// Takes a row: what each balance lacks, its variance and the effects.
    pub fn push(
        &mut self,
        effects: &[[f64; CHANGES]; 3],
        lacking: [f64; 3],
        variance: [f64; 3],
        step_s: f64,
    ) {
        self.told_s += step_s;
        for i in 0..3 {
            let row = Vector::from(effects[i]);
            let weight = step_s / ALIKE_S / variance[i];
            self.information[i] += row * row.transpose() * weight;
            self.evidence[i] += row * (lacking[i] * weight);
        }
    }

    /// The changes; `None` where numbers are not finite.
    #[must_use]
    pub fn found(&self) -> Option<Found> {
        let prior = Matrix::from_diagonal(&Vector::from(SPREAD.map(|sd| sd.powi(-2))));
        let mut motors = Vec::with_capacity(3);
        for (information, evidence) in self.information.iter().zip(&self.evidence) {
            let covariance = (information + prior).try_inverse()?;
            let changes = covariance * evidence;
            let more = Vector::from_fn(|k, _| {
                let form = FORM * changes[k];
                form * form + if k == FRICTION { DRIFT * DRIFT } else { 0.0 }
            });
            let covariance = covariance + Matrix::from_diagonal(&more);
            motors.push(OfMotor {
                changes: changes.into(),
                covariance: covariance.into(),
            });
        }
        motors.try_into().ok().map(Found)
    }
}

/// Changes that were found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found([OfMotor; 3]);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct OfMotor {
    changes: [f64; CHANGES],
    /// Column by column; symmetric.
    covariance: [[f64; CHANGES]; CHANGES],
}

/// Changes of a motor for people, positive where there is more of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Torque that is not commanded, at the joint: N·m, N·m, N.
    pub offset: f64,
    /// Share of the friction.
    pub friction: f64,
    /// Torque per command, share.
    pub gain: f64,
    /// Amplitude of the friction over a turn of the motor, share.
    pub ripple: f64,
    /// Friction in positive direction above the mean of both, share.
    pub asymmetry: f64,
    /// Standard deviations of these but the ripple's, in the same order.
    pub deviation: [f64; 4],
}

impl Change {
    /// What has surely changed, in words: more than three standard deviations. `unit`: that of a torque at the joint.
    #[must_use]
    pub fn surely(&self, unit: &str) -> Vec<String> {
        let [offset, friction, gain, asymmetry] = self.deviation;
        let far = |value: f64, deviation: f64| value.abs() > 3.0 * deviation;
        let moved = |value: f64| {
            let way = if value < 0.0 { "fell" } else { "rose" };
            format!("{way} by {:.1} %", 100.0 * value.abs())
        };
        let mut out = Vec::new();
        if far(self.friction, friction) {
            out.push(format!("friction {}", moved(self.friction)));
        }
        if far(self.gain, gain) {
            out.push(format!("torque per command {}", moved(self.gain)));
        }
        if far(self.offset, offset) {
            out.push(format!(
                "a torque of {:.3} {unit} that is not commanded",
                self.offset
            ));
        }
        if self.ripple > TOLD_RIPPLE {
            let ripple = 100.0 * self.ripple;
            out.push(format!(
                "friction goes up and down by {ripple:.0} % over a turn of the motor"
            ));
        }
        if far(self.asymmetry, asymmetry) {
            let way = if self.asymmetry < 0.0 {
                "negative"
            } else {
                "positive"
            };
            let more = 100.0 * self.asymmetry.abs();
            out.push(format!(
                "friction is {more:.0} % above its mean in {way} direction"
            ));
        }
        out
    }
}

impl Found {
    /// What they add to the balance of motor `i`, and the variance of that.
    #[must_use]
    pub fn adds(&self, i: usize, effects: &[f64; CHANGES]) -> (f64, f64) {
        let OfMotor {
            changes,
            covariance,
        } = &self.0[i];
        let row = Vector::from(*effects);
        let variance = (Matrix::from(*covariance) * row).dot(&row);
        (row.dot(&Vector::from(*changes)), variance.max(0.0))
    }

    /// The changes of motor `i`, which has the friction `coulomb`.
    #[must_use]
    pub fn of_motor(&self, i: usize, coulomb: f64) -> Change {
        let OfMotor {
            changes: c,
            covariance,
        } = &self.0[i];
        let deviation = |k: usize| covariance[k][k].max(0.0).sqrt();
        // The balance is what the model expects less what is commanded.
        Change {
            offset: c[0] * coulomb,
            friction: -c[1],
            gain: c[2],
            ripple: c[3].hypot(c[4]),
            asymmetry: -c[5],
            deviation: [
                deviation(0) * coulomb,
                deviation(1),
                deviation(2),
                deviation(5),
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minute_tells_the_changes_of_each_motor() {
        let made = [
            [0.05, -0.06, 0.02, 0.1, 0.0, 0.0],
            [0.0; CHANGES],
            [-0.1, 0.03, 0.0, 0.0, -0.08, 0.12],
        ];
        let coulomb = [1.4, 1.1, 18.0];
        let mut sums = Free::default();
        let mut noise = robot::random::Random::stream(3, "recalibration", 0);
        for n in 0..3_000 {
            let t = f64::from(n) * 0.02;
            let mut m = Moment::default();
            let of = core::array::from_fn(|i| {
                m.motors[i] = 0.3 * (0.4 * t + i as f64).sin();
                let direction = (0.4 * t + i as f64).cos().signum();
                m.stops[i * crate::motion::LEVELS + DIRECTION] = direction;
                m.torque[i] = coulomb[i] * (direction + 0.8 * (0.13 * t).sin());
                effects(&m, i, coulomb[i], coulomb[i] * direction)
            });
            let lacking = core::array::from_fn(|i| {
                Vector::from(of[i]).dot(&Vector::from(made[i]))
                    + 0.005 * coulomb[i] * noise.normal()
            });
            let variance = coulomb.map(|c| (0.005 * c).powi(2));
            sums.push(&of, lacking, variance, 0.02);
        }
        assert!((sums.told_s - 60.0).abs() < 1e-6);
        let found = sums.found().expect("finite");
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
    fn sure_changes_are_told_in_words_and_others_are_not() {
        let change = Change {
            offset: 0.01,
            friction: -0.06,
            gain: 0.01,
            ripple: 0.12,
            asymmetry: 0.08,
            deviation: [0.02, 0.01, 0.02, 0.02],
        };
        let told = change.surely("N·m").join("; ");
        assert_eq!(
            told,
            "friction fell by 6.0 %; friction goes up and down by 12 % over a turn of the motor; friction is 8 % above its mean in positive direction"
        );
        let none = Change {
            friction: 0.02,
            ripple: 0.01,
            asymmetry: 0.0,
            ..change
        };
        assert_eq!(none.surely("N·m"), Vec::<String>::new());
    }
}
