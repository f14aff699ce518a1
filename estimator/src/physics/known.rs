//! The physical model on logs whose force is known: a recalibration on free motion, and the
//! balances with the measured force.

use super::{force_of, Balance, Physics, FREE_S};
use crate::model::ModelError;
use crate::motion::{LowPass, FILTER_S};
use crate::recalibration::{motor_angle, Change, Found, Free, FOLLOWED, FRICTION as FRICTION_OF};
use crate::sequence::Sequence;
use nalgebra::Vector3;
use robot::kinematics::TRANSMISSION;

impl Physics {
    /// Whether a recalibration has told what has changed of the robot.
    #[must_use]
    pub const fn recalibrated(&self) -> bool {
        self.found.is_some()
    }

    /// Finds on free motion what has changed of the robot: no force is on the tool. What was found
    /// before is forgotten. Gives the changes, and a constant force that explains what they do not,
    /// N, where there seems to be one.
    ///
    /// # Errors
    /// Too few rows in which all joints move, or changes that no robot has. The model is as it was
    /// then.
    pub fn recalibrate(
        &mut self,
        free: &[&Sequence],
    ) -> Result<([Change; 3], Option<[f64; 3]>), ModelError> {
        let (found, sums) = self.found(free, false, FOLLOWED);
        let Some(found) = found.filter(|_| sums.told_s >= FREE_S) else {
            return Err(ModelError::Data(format!(
                "{:.0} s of this log tell the state of the friction, at least {FREE_S} s must: move all three joints back and forth for a minute, with nothing at the tool",
                sums.told_s
            )));
        };
        let changes: [Change; 3] = core::array::from_fn(|i| found.of_motor(i, self.coulomb[i]));
        if let Some(i) = changes.iter().position(|change| !change.is_of_a_robot()) {
            return Err(ModelError::Data(format!(
                "by this log friction of joint {} would have changed by {:+.0} % and its torque per command by {:+.0} %, more than a robot changes by itself. Check that \
                 nothing touched the tool, and sign, unit and order of efforts and velocities; a robot with other motors or amplifiers needs a training of its own",
                i + 1,
                100.0 * changes[i].friction,
                100.0 * changes[i].gain
            )));
        }
        self.found = Some(found);
        Ok((changes, sums.force_n(self.alike)))
    }

    /// Changes by logs, and their sums; no changes where numbers are not finite. Contacts bend as
    /// far as their friction is large, so a second look has the friction of the first. `followed`:
    /// as in [`Free::found`].
    pub(super) fn found(
        &self,
        logs: &[&Sequence],
        measured: bool,
        followed: f64,
    ) -> (Option<Found>, Free) {
        let found = |sums: &Free| sums.found(self.usual_torques(), self.alike, followed);
        let first = self.free(logs, measured, [1.0; 3]);
        match found(&first) {
            Some(changes) => {
                let second = self.free(logs, measured, changes.times());
                (found(&second), second)
            }
            None => (None, first),
        }
    }

    /// Sums of logs in which nothing is on the tool, or whose measured force is taken out. `times`:
    /// friction of each joint per that of training.
    fn free(&self, logs: &[&Sequence], measured: bool, times: [f64; 3]) -> Free {
        let mut sums = Free::default();
        for sequence in logs {
            let mut observer = self.observer_with_friction(times);
            // The contact is filtered as the torque is, or the balance would mix two times.
            let mut filters = [LowPass::new(FILTER_S, sequence.step_s); 3];
            for k in 0..sequence.rows() {
                let force = if measured {
                    force_of(sequence.target_row(k))
                } else {
                    Vector3::zeros()
                };
                let (moment, seen) = observer.take_with(sequence.input_row(k), Some(&force));
                let mut lacking = seen.contact;
                if measured {
                    let contact = seen.levers * force;
                    for (i, lacking) in lacking.iter_mut().enumerate() {
                        *lacking -= filters[i].step(contact[i]);
                    }
                }
                if moment.settled() {
                    let variance = seen.deviation.map(|sd| sd * sd);
                    let time_s = sequence.start_s + k as f64 * sequence.step_s;
                    sums.push(
                        time_s,
                        &seen.effects,
                        lacking,
                        variance,
                        &seen.levers,
                        sequence.step_s,
                    );
                }
            }
        }
        sums
    }

    /// The balance of each motor at each row that tells it, with the measured force; a force that
    /// was not measured counts as none.
    #[must_use]
    pub fn balances(&self, sequence: &Sequence) -> Vec<[Balance; 3]> {
        let mut observer = self.observer();
        // The contact is filtered as the torque is, or the balance would mix two times.
        let mut filters = [LowPass::new(FILTER_S, sequence.step_s); 3];
        let mut out = Vec::new();
        for k in 0..sequence.rows() {
            let force =
                force_of(sequence.target_row(k)).map(|n| if n.is_finite() { n } else { 0.0 });
            let (moment, seen) = observer.take_with(sequence.input_row(k), Some(&force));
            let contact = seen.levers * force;
            let contact: [f64; 3] = core::array::from_fn(|i| filters[i].step(contact[i]));
            if moment.settled() {
                out.push(core::array::from_fn(|i| Balance {
                    time_s: sequence.start_s + k as f64 * sequence.step_s,
                    torque: moment.torque[i],
                    expected: moment.torque[i] + seen.contact[i] - contact[i],
                    friction: seen.effects[i][FRICTION_OF],
                    angle: motor_angle(moment, i),
                    turn_rate: moment.flow[i] * TRANSMISSION[i],
                    deviation: self.noise[i].deviation(),
                    coulomb: self.coulomb[i],
                }));
            }
        }
        out
    }

    /// Sizes of torques that came and went in training, per Coulomb friction.
    fn usual_torques(&self) -> [f64; 3] {
        let differs = self.differs.as_ref();
        differs.map_or([0.0; 3], |differs| differs.map(|of| of.usual.torque()))
    }
}
