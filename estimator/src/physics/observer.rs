//! The physical model on a stream: what each balance lacks, and the force that explains it.

use super::{
    dot, friction, guide, joints_of, regressors, settle_rows, sums_of_pieces, Physics, EVERY,
    FREE_S, MEMORY_S, MINUTE_S, REGRESSORS, SETTLE_S,
};
use crate::misfit::{Misfit, TIMES};
use crate::model::{Fit, Stepper};
use crate::motion::{Moment, Motion, LONGEST_GAP_S};
use crate::pieces::Told;
use crate::recalibration::{effects, Effects, Found, FRICTION as FRICTION_OF};
use crate::sequence::Sequence;
use crate::wander::Wander;
use nalgebra::{Matrix3, Vector3};

impl Physics {
    fn wander(&self, found: &Found) -> Option<Wander> {
        let force = Matrix3::from_fn(|i, j| self.prior[i][j]).try_inverse()?;
        let sizes = found.wander(self.coulomb).unwrap_or_default();
        // Errors that stay must not be taken for the torque. Where none is followed, they would
        // take a part of the force.
        let share = found.wanders().sqrt();
        let noise = self.noise_deviation().map(|noise| share * noise);
        Some(Wander::new(
            &force,
            self.rate_per_s,
            sizes,
            noise,
            found.shares(),
            self.step_s,
        ))
    }

    /// Standard deviation of each balance at all speeds alike.
    fn noise_deviation(&self) -> [f64; 3] {
        core::array::from_fn(|i| self.noise[i].deviation())
    }

    fn misfit(&self) -> Misfit {
        let force = Matrix3::from_fn(|i, j| self.prior[i][j]).try_inverse();
        let force = force.unwrap_or_else(Matrix3::identity);
        let noise = self.noise_deviation();
        Misfit::new(self.coulomb, &force, self.rate_per_s, noise, self.step_s)
    }

    /// An observer that knows what has changed of the robot in this sequence: its measured force
    /// has told. See [`told_stepper`](crate::model::Model::told_stepper).
    #[must_use]
    pub fn told_observer(&self, sequence: &Sequence) -> Option<Observer<'_>> {
        let differs = self.differs.as_ref()?;
        let sums = sums_of_pieces(&self.base, self.coulomb, &self.motors, EVERY, &[sequence]);
        let mut own = Vec::new();
        for piece in sums.into_iter().flatten() {
            let mut motors = Vec::with_capacity(3);
            for (i, mut sums) in piece.into_iter().enumerate() {
                sums.take_out(REGRESSORS, &differs[i].mean);
                motors.push(differs[i].usual.own(
                    &mut sums,
                    REGRESSORS,
                    EVERY as f64 * self.step_s,
                )?);
            }
            own.push(motors.try_into().ok()?);
        }
        let told = Told { own, rows: 0 };
        Some(Observer {
            told: Some(told),
            ..self.observer()
        })
    }

    /// An observer that knows what has changed of the robot in this sequence, and the first row to
    /// ask it. See [`told_stepper`](crate::model::Model::told_stepper).
    #[must_use]
    pub fn told(&self, sequence: &Sequence) -> Option<(Observer<'_>, usize)> {
        match self.differs {
            Some(_) => Some((self.told_observer(sequence)?, 0)),
            None => self.recalibrated_observer(sequence),
        }
    }

    /// An observer that was recalibrated on the first minute of this sequence, whose measured force
    /// is taken out, and the first row after that. `None`: the sequence is too short.
    #[must_use]
    pub fn recalibrated_observer(&self, sequence: &Sequence) -> Option<(Observer<'_>, usize)> {
        let minute = sequence.beginning(SETTLE_S + MINUTE_S);
        // No torque came and went in this training: one that a minute may hold all the same would
        // be in the interval, and what the others are measured by too small.
        let (found, sums) = self.found(&[&minute], true, 1.0);
        if minute.rows() == sequence.rows() || sums.told_s < FREE_S {
            return None;
        }
        Some((self.observer_with(Some(found?)), minute.rows()))
    }

    /// An observer.
    #[must_use]
    pub fn observer(&self) -> Observer<'_> {
        self.observer_with(self.found.clone())
    }

    /// The same with what a recalibration has found.
    pub(super) fn observer_with(&self, found: Option<Found>) -> Observer<'_> {
        Observer {
            model: self,
            motion: self.motion(found.as_ref().map_or([1.0; 3], Found::times)),
            keep: (-self.step_s / MEMORY_S).exp(),
            steps: 1.0,
            information: Matrix3::zeros(),
            evidence: Vector3::zeros(),
            row: Vec::with_capacity(REGRESSORS),
            seen: Seen::default(),
            told: None,
            misfit: self.misfit(),
            wander: found
                .as_ref()
                .and_then(|found| self.wander(found))
                .map(Box::new),
            found,
        }
    }

    /// An observer that knows of no change but that the friction of each joint is so many times
    /// that of training.
    pub(super) fn observer_with_friction(&self, times: [f64; 3]) -> Observer<'_> {
        Observer {
            motion: self.motion(times),
            ..self.observer_with(None)
        }
    }

    fn motion(&self, times: [f64; 3]) -> Motion {
        Motion::with_friction(self.step_s, self.coulomb, times)
    }
}

/// The force across the tool's shaft, which makes it rub in its guide.
///
/// The friction follows the size of that force, so an estimate of the force must not only go into
/// it but come out of it too:
///
/// ```text
/// balance = levers * force - rubs * size of the force across the shaft
/// ```
///
/// Taken from the estimate of the row before, as a known force, it fed the estimate back: where the
/// insertion told most of the force, as beside an elbow whose torque comes and goes, the estimate
/// ran away (30 N of 1 N; virtual arm, seed 14). So the size is linear around that estimate, and
/// its slope is a part of the levers. Near no force the slope turns its sign; there the size is
/// what it was, and its balance is as unsure as the force is.
#[derive(Debug, Clone, Copy)]
struct Pressed {
    size_n: f64,
    /// Its direction, of length 1; 0 where there is none.
    along: Vector3<f64>,
    /// Share of the slope that is in the levers: the force's square, over that and its variance.
    share: f64,
    /// Standard deviation of the rest, N.
    unsure_n: f64,
}

impl Pressed {
    fn known(across: Vector3<f64>) -> Self {
        Self {
            size_n: across.norm(),
            along: Vector3::zeros(),
            share: 0.0,
            unsure_n: 0.0,
        }
    }

    fn told(across: Vector3<f64>, seen: &Seen) -> Self {
        let size_n = across.norm();
        let along = across.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let deviation_n = seen.spread.zip_map(&seen.unsure, f64::hypot).norm();
        let share = if size_n > 0.0 {
            size_n.powi(2) / (size_n.powi(2) + deviation_n.powi(2))
        } else {
            0.0
        };
        Self {
            size_n,
            along,
            share,
            unsure_n: (1.0 - share) * deviation_n,
        }
    }
}

/// What the observer knows at a row.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    /// Force on the tool, N.
    pub force: Vector3<f64>,
    /// What each motor's balance lacks: contact at the motors, in the joints' units.
    pub contact: [f64; 3],
    /// Standard deviation of each balance.
    pub deviation: [f64; 3],
    /// Levers: contact at the motors per force.
    pub levers: Matrix3<f64>,
    /// Standard deviation of the components by the weights, N.
    pub spread: Vector3<f64>,
    /// What changes of a robot would add to the balances.
    pub(super) effects: [Effects; 3],
    /// Standard deviation of the components by what a recalibration has left unknown, N.
    pub unsure: Vector3<f64>,
    /// See [`Misfit`]; 0 before a row told.
    pub misfit: [f64; TIMES],
}

/// The model on a stream.
#[derive(Debug, Clone)]
pub struct Observer<'a> {
    model: &'a Physics,
    motion: Motion,
    keep: f64,
    /// Rows from the last one to the next, more than one over a gap.
    steps: f64,
    information: Matrix3<f64>,
    evidence: Vector3<f64>,
    row: Vec<f64>,
    seen: Seen,
    misfit: Misfit,
    /// What a measured force has told of the changes of the robot.
    told: Option<Told>,
    /// What a recalibration has found.
    found: Option<Found>,
    /// Torques that come and go, and friction that goes on changing, after a recalibration.
    wander: Option<Box<Wander>>,
}

impl Observer<'_> {
    /// Takes a row of inputs.
    pub fn take(&mut self, input: &[f32]) -> (&Moment, &Seen) {
        self.take_with(input, None)
    }

    /// Takes a row of inputs and the force, N, where it is known. Where it is not, what it makes
    /// the tool rub in its guide follows from the force of the row before, and is a part of the
    /// levers (`Pressed`).
    pub fn take_with(&mut self, input: &[f32], force: Option<&Vector3<f64>>) -> (&Moment, &Seen) {
        let across = |force| self.model.base.across(joints_of(input), force);
        let pressed = match force {
            Some(force) => Pressed::known(across(force)),
            None => Pressed::told(across(&self.seen.force), &self.seen),
        };
        self.motion.lateral(pressed.size_n);
        let moment = self.motion.step(input);
        let mut levers = self.model.base.at_motors(moment.joints);
        let (mut information, mut evidence) = (Matrix3::zeros(), Vector3::zeros());
        let (mut contacts, mut variances, mut uncertain) =
            (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        for i in 0..3 {
            let motor = &self.model.motors[i];
            regressors(moment, i, self.model.coulomb[i], &mut self.row);
            let mut contact = motor.value(0, &self.row) - moment.torque[i];
            // Where a start or a gap has left the friction's state unknown, the motor tells little.
            let unknown = self.model.coulomb[i] * moment.unknown_at(i);
            let mut variance =
                self.model.noise[i].variance(moment.rate[i].abs()) + unknown * unknown;
            let rubs = guide(motor.weights(0), moment);
            let friction = friction(motor.weights(0), &self.row);
            // Less what is a part of the levers.
            contact -= rubs * pressed.share * pressed.size_n;
            variance += (rubs * pressed.unsure_n).powi(2);
            let lever = levers.row(i).transpose() - pressed.along * (rubs * pressed.share);
            levers.set_row(i, &lever.transpose());
            self.seen.effects[i] = effects(moment, i, self.model.coulomb[i], friction);
            if let Some(differs) = &self.model.differs {
                contact -= dot(&differs[i].mean, &self.seen.effects[i]);
            }
            if let Some(found) = &self.found {
                let (adds, more) = found.adds(i, &self.seen.effects[i]);
                contact -= adds;
                variance += more;
                uncertain[i] = more;
            }
            if let Some(told) = &self.told {
                let row = told.rows.saturating_sub(settle_rows(self.model.step_s));
                contact -= told.adds(i, row, self.model.step_s, &self.seen.effects[i]);
            }
            self.seen.contact[i] = contact;
            self.seen.deviation[i] = variance.sqrt();
            if let (Some(differs), None, None) = (&self.model.differs, &self.found, &self.told) {
                variance += differs[i].usual.variance(&self.seen.effects[i]);
            }
            information += lever * lever.transpose() / variance;
            evidence += lever * (contact / variance);
            contacts[i] = contact;
            variances[i] = variance;
        }
        let mut slow = Matrix3::from_diagonal(&uncertain);
        let mut unsure = variances;
        let elapsed_s = self.steps * self.model.step_s;
        let friction = Vector3::from_fn(|i, _| self.seen.effects[i][FRICTION_OF]);
        // A force that is known needs no telling.
        if let (Some(wander), None) = (&mut self.wander, force) {
            wander.step(&contacts, &variances, &levers, &friction, elapsed_s);
            let (torques, covariance) = wander.torques();
            contacts -= torques;
            evidence -= levers.transpose() * torques.component_div(&variances);
            self.seen.contact = contacts.into();
            slow += covariance;
            unsure += covariance.diagonal();
        }
        let prior = Matrix3::from_fn(|i, j| self.model.prior[i][j]);
        if moment.friction_known() {
            self.seen.misfit =
                (self.misfit).step(&contacts, &unsure, &levers, &prior, &friction, elapsed_s);
        }
        let keep = if self.steps == 1.0 {
            self.keep
        } else {
            self.keep.powf(self.steps)
        };
        if let Some(told) = &mut self.told {
            told.rows += 1;
        }
        self.steps = 1.0;
        let fresh = 1.0 - keep;
        self.information = self.information * keep + information * fresh;
        self.evidence = self.evidence * keep + evidence * fresh;
        // Positive definite: the prior is.
        if let Some(covariance) = (self.information + prior).try_inverse() {
            self.seen.force = covariance * self.evidence;
            self.seen.spread = covariance.diagonal().map(|v| v.max(0.0).sqrt());
            // How the force follows the balances while they stay as they are.
            let follows = covariance
                * levers.transpose()
                * Matrix3::from_diagonal(&variances.map(|v| 1.0 / v));
            let covariance = follows * slow * follows.transpose();
            self.seen.unsure = covariance.diagonal().map(|v| v.max(0.0).sqrt());
        }
        self.seen.levers = levers;
        (moment, &self.seen)
    }

    /// Forgets the past.
    pub fn forget(&mut self) {
        self.motion.reset();
        self.steps = 1.0;
        self.information = Matrix3::zeros();
        self.evidence = Vector3::zeros();
        self.seen.force = Vector3::zeros();
        self.misfit.forget();
        if let Some(wander) = &mut self.wander {
            wander.forget();
        }
        self.seen.misfit = [0.0; TIMES];
    }

    /// The next row comes `elapsed_s` after the one before it: rows are missing between them.
    pub fn miss(&mut self, elapsed_s: f64) {
        if let Some(told) = &mut self.told {
            told.rows += ((elapsed_s / self.model.step_s).round() as usize).saturating_sub(1);
        }
        if elapsed_s > LONGEST_GAP_S {
            self.forget();
        } else {
            self.motion.gap(elapsed_s);
            self.steps = (elapsed_s / self.model.step_s).max(1.0);
        }
    }
}

impl Stepper for Observer<'_> {
    fn step(&mut self, input: &[f32], force: &mut [f32]) {
        let axes = &self.model.axes;
        let (_, seen) = self.take(input);
        for (out, axis) in force.iter_mut().zip(axes) {
            *out = seen.force[*axis] as f32;
        }
    }

    fn fit(&self) -> Option<Fit> {
        Some(Fit {
            misfit: self.seen.misfit,
            unsure_n: self.seen.unsure.into(),
        })
    }

    fn reset(&mut self) {
        self.forget();
    }

    fn gap(&mut self, elapsed_s: f64) {
        self.miss(elapsed_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Estimates of a force along y from balances that it makes with this lever and this friction
    /// per force across the shaft, row after row, with this spread.
    fn estimates(force_n: f64, lever: f64, rubs: f64, spread_n: f64, rows: usize) -> f64 {
        let mut seen = Seen {
            spread: Vector3::new(0.0, spread_n, 0.0),
            ..Seen::default()
        };
        let balance = lever * force_n - rubs * force_n.abs();
        for _ in 0..rows {
            let pressed = Pressed::told(seen.force, &seen);
            let contact = balance + rubs * pressed.size_n * (1.0 - pressed.share);
            let lever = lever - rubs * pressed.share * pressed.along[1];
            let unsure = (rubs * pressed.unsure_n).powi(2);
            // A force of 2 N before anything is known, and noise of 0.02.
            let weight = (4e-4 + unsure).recip();
            let fresh = lever * contact * weight / (lever * lever * weight + 0.25);
            seen.force[1] += (fresh - seen.force[1]) * 0.1;
        }
        seen.force[1]
    }

    #[test]
    fn friction_that_follows_the_estimate_does_not_feed_it_back() {
        for force_n in [-4.0, -1.0, 3.0] {
            let told = estimates(force_n, 0.4, 0.2, 0.3, 500);
            assert!((told - force_n).abs() < 0.4, "{force_n}: {told}");
            // By a lever shorter than the friction two forces make this balance, and it is one of
            // them. Taken for known, the friction would double the error at each row.
            let told = estimates(force_n, 0.1, 0.2, 0.3, 500);
            let balance = |force: f64| 0.1 * force - 0.2 * force.abs();
            let error = balance(told) - balance(force_n);
            assert!(error.abs() < 0.04, "{force_n}: {told}");
        }
    }

    #[test]
    fn the_size_of_a_force_is_in_the_levers_as_far_as_it_is_known() {
        let seen = Seen {
            spread: Vector3::new(0.0, 0.3, 0.0),
            unsure: Vector3::new(0.0, 0.4, 0.0),
            ..Seen::default()
        };
        let told = |y| Pressed::told(Vector3::new(0.0, y, 0.0), &seen);
        let [near, far] = [told(0.5), told(-5.0)];
        assert_eq!((near.share, near.unsure_n), (0.5, 0.25));
        assert!(far.share > 0.98 && far.unsure_n < 0.01, "{far:?}");
        assert_eq!((far.size_n, far.along[1]), (5.0, -1.0));
        let none = told(0.0);
        assert_eq!((none.size_n, none.share, none.unsure_n), (0.0, 0.0, 0.5));
        let known = Pressed::known(Vector3::new(3.0, 4.0, 0.0));
        assert_eq!((known.size_n, known.share, known.unsure_n), (5.0, 0.0, 0.0));
    }
}
