//! What a recalibration found, for the model and in words.

use super::{Matrix, Vector, CHANGES, FRICTION};
use crate::wander::{self, Share};
use core::ops::Range;
use serde::{Deserialize, Serialize};

/// Part of a change that is of another form than its effect here. Estimate: with twice this, and
/// 0.05 for the friction, intervals after changes without a drag were wider and covered no better
/// (virtual arm, robots 11, 13, 22, 31, 32, 34).
const FORM: f64 = 0.01;
/// The same of the friction: it does not change in all contacts alike. What is of another form is
/// followed under load, as far as it stays: [`Found::shares`].
const FRICTION_FORM: f64 = 0.03;
/// Standard deviation of the friction's change until the next recalibration, share of it. Estimate:
/// a twentieth of the change over a day; with 0.005 the intervals of an unchanged arm covered 97 %
/// (virtual arm, seeds 11 to 13), with 0.003 95 %.
pub(super) const DRIFT: f64 = 0.003;
/// The same of friction that was found above that of training, share of what is above: a cold arm
/// may warm. A warming of 600 s takes 0.2 of it (RMS over the three minutes after the minute).
const COLD: f64 = 0.2;
/// Time in which a cold arm warms so far, s.
const COLD_S: f64 = 180.0;
/// Chance from which a torque that comes and goes is told.
const TOLD: f64 = 0.9;
/// Ripple of the friction over a turn that is told, share: some times what a minute finds where
/// there is none.
const TOLD_RIPPLE: f64 = 0.03;

/// Adds what no minute tells.
pub(super) fn of_motor(
    changes: Vector,
    mut covariance: Matrix,
    wander: f64,
    usual: f64,
    wanders: f64,
) -> OfMotor {
    for k in (0..CHANGES).filter(|k| *k != FRICTION) {
        let form = FORM * changes[k];
        covariance[(k, k)] += form * form;
    }
    covariance[(FRICTION, FRICTION)] += DRIFT * DRIFT;
    OfMotor {
        changes: changes.into(),
        covariance: covariance.into(),
        wander,
        usual,
        wanders,
    }
}

/// Changes that were found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found(pub(super) [OfMotor; 3]);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct OfMotor {
    changes: [f64; CHANGES],
    /// Column by column; symmetric.
    covariance: [[f64; CHANGES]; CHANGES],
    /// Size of a torque at the joint that comes and goes, per Coulomb friction; 0: none.
    #[serde(default)]
    wander: f64,
    /// The same at the motor, in training.
    #[serde(default)]
    usual: f64,
    /// Chance of it. Files of before have torques that were sure.
    #[serde(default = "sure")]
    pub(super) wanders: f64,
}

const fn sure() -> f64 {
    1.0
}

impl OfMotor {
    /// Friction above that of training, share of it.
    const fn friction(&self) -> f64 {
        -self.changes[FRICTION]
    }

    /// What is not known of the friction beside the covariance.
    fn share(&self) -> Share {
        let cold = COLD * self.friction().max(0.0);
        Share {
            start: (FRICTION_FORM * self.friction()).hypot(cold),
            per_s: cold * cold / COLD_S,
        }
    }
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
    /// Size of a torque that comes and goes, at the joint; 0: none was found.
    pub wander: f64,
    /// Standard deviations of the first three and the asymmetry, in this order.
    pub deviation: [f64; 4],
}

/// Changes of friction and of torque per command that a robot may have by itself, shares. Grease,
/// temperature and the tension of the cables change the friction by some tenths; zero and gain of
/// an amplifier by some hundredths (docs/robot.md, "What changes"). Where friction is nearly all of
/// a torque the two are hardly told apart: a model of few minutes found -0.21 of the gain where
/// nothing had changed. More is a force on the tool that was not measured (4 N made -0.6 and
/// -0.55), a sign, a unit or another column.
const FRICTION_OF_A_ROBOT: Range<f64> = -0.5..1.0;
const GAIN_OF_A_ROBOT: Range<f64> = -0.4..0.6;

impl Change {
    /// Whether a robot may change so. Else something touched the tool, or a sign, a unit or a
    /// column of the log is wrong.
    #[must_use]
    pub fn is_of_a_robot(&self) -> bool {
        FRICTION_OF_A_ROBOT.contains(&self.friction) && GAIN_OF_A_ROBOT.contains(&self.gain)
    }

    /// What has surely changed, in words: more than three standard deviations. `unit`: that of a
    /// torque at the joint.
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
        if self.wander > 0.0 {
            out.push("a torque that is not commanded comes and goes".to_owned());
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
    /// What they add to the balance of motor `i`, and the variance of that, without that of
    /// [`Self::shares`].
    #[must_use]
    pub fn adds(&self, i: usize, effects: &[f64; CHANGES]) -> (f64, f64) {
        let OfMotor {
            changes,
            covariance,
            ..
        } = &self.0[i];
        let row = Vector::from(*effects);
        let variance = (Matrix::from(*covariance) * row).dot(&row);
        (row.dot(&Vector::from(*changes)), variance.max(0.0))
    }

    /// Friction of each joint per that of training.
    #[must_use]
    pub fn times(&self) -> [f64; 3] {
        let Range { start, end } = FRICTION_OF_A_ROBOT;
        core::array::from_fn(|i| 1.0 + self.0[i].friction().clamp(start, end))
    }

    /// What is not known of the friction of each motor, and is followed under load: a cold arm
    /// warms, and contacts do not change alike.
    #[must_use]
    pub fn shares(&self) -> [Share; 3] {
        core::array::from_fn(|i| self.0[i].share())
    }

    /// Sizes of the torques at the joints that come and go, of motors with the friction `coulomb`;
    /// `None`: there is none.
    #[must_use]
    pub fn wander(&self, coulomb: [f64; 3]) -> Option<[f64; 3]> {
        let usual = wander::at_joints(core::array::from_fn(|i| self.0[i].usual * coulomb[i]));
        let sizes = core::array::from_fn(|i| usual[i].max(self.0[i].wander * coulomb[i]));
        sizes.iter().any(|size: &f64| *size > 0.0).then_some(sizes)
    }

    /// Chance that a torque that is followed comes and goes.
    #[must_use]
    pub fn wanders(&self) -> f64 {
        let followed = |motor: &OfMotor| {
            if motor.usual > 0.0 {
                1.0
            } else if motor.wander > 0.0 {
                motor.wanders
            } else {
                0.0
            }
        };
        self.0.iter().map(followed).fold(0.0, f64::max)
    }

    /// The changes of motor `i`, which has the friction `coulomb`.
    #[must_use]
    pub fn of_motor(&self, i: usize, coulomb: f64) -> Change {
        let OfMotor {
            changes: c,
            covariance,
            wander,
            wanders,
            ..
        } = &self.0[i];
        let told = if *wanders > TOLD { *wander } else { 0.0 };
        let deviation = |k: usize| covariance[k][k].max(0.0).sqrt();
        // The balance is what the model expects less what is commanded.
        Change {
            offset: c[0] * coulomb,
            friction: -c[1],
            gain: c[2],
            ripple: c[3].hypot(c[4]),
            asymmetry: -c[5],
            wander: told * coulomb,
            deviation: [
                deviation(0) * coulomb,
                deviation(FRICTION).hypot(self.0[i].share().start),
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
    fn sure_changes_are_told_in_words_and_others_are_not() {
        let change = Change {
            offset: 0.01,
            friction: -0.06,
            gain: 0.01,
            ripple: 0.12,
            asymmetry: 0.08,
            wander: 0.0,
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
        let cable = Change {
            wander: 0.1,
            ..none
        };
        let told = cable.surely("N·m").join("; ");
        assert_eq!(told, "a torque that is not commanded comes and goes");
    }

    #[test]
    fn friction_of_a_cold_arm_may_fall_and_one_that_fell_stays() {
        let found = |friction: f64| {
            let mut changes = Vector::zeros();
            changes[FRICTION] = -friction;
            let motor = || of_motor(changes, Matrix::zeros(), 0.0, 0.0, 0.0);
            Found(core::array::from_fn(|_| motor()))
        };
        let [cold, fell, same] = [0.1, -0.1, 0.0].map(|friction| found(friction).shares()[0]);
        let after = |share: Share, s: f64| share.start.powi(2) + share.per_s * s;
        assert!(after(cold, 0.0) > (0.9 * COLD * 0.1).powi(2));
        assert!((cold.per_s * COLD_S).sqrt() >= 0.9 * COLD * 0.1);
        assert!((after(fell, 180.0).sqrt() - 0.1 * FRICTION_FORM).abs() < 1e-12);
        assert_eq!(same, Share::default());
        assert_eq!(found(-0.24).times(), [0.76; 3]);
        // Contacts without friction would divide by zero.
        assert_eq!(found(-1.5).times(), [0.5; 3]);
    }

    /// Errors that stay are told from a torque as far as there may be one.
    #[test]
    fn a_torque_is_followed_by_its_chance_and_one_of_the_training_for_sure() {
        let chance = |motors: [[f64; 3]; 3]| {
            let motor = |[wander, usual, wanders]: [f64; 3]| {
                of_motor(Vector::zeros(), Matrix::zeros(), wander, usual, wanders)
            };
            Found(motors.map(motor)).wanders()
        };
        let none = [0.0, 0.0, 0.05];
        assert_eq!(chance([none; 3]), 0.0);
        assert_eq!(chance([none, [0.02, 0.0, 0.4], [0.1, 0.0, 0.3]]), 0.4);
        assert_eq!(chance([none, [0.02, 0.0, 0.4], [0.0, 0.1, 0.3]]), 1.0);
    }
}
