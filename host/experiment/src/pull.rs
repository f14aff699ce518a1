//! How a force becomes tensions: by two units along one axis, or by all units and the force
//! controller.

use super::file::Force;
use force::allocation::{Allocator, Problem};
use force::controller::{problem, Cables, ControlError, Controller, Input};
use nalgebra::Vector3;
use rig::Rig;
use wire::message::UnitSetpoint;
use wire::UNITS;

/// Two units that pull against each other along an axis.
///
/// The axis component of the applied force is the commanded one; what the cables' angles give
/// across it is applied too, and recorded. The cable that does not pull has the pre-tension or a
/// little more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneAxis {
    /// Unit vector, robot base frame.
    pub axis: Vector3<f64>,
    /// Unit (from 0) that pulls towards its positive end.
    pub plus: usize,
    /// Unit (from 0) that pulls towards its negative end.
    pub minus: usize,
    /// Least tension of both, N.
    pub pretension_n: f64,
}

impl OneAxis {
    /// From the experiment's force; `None` for a force of three axes.
    #[must_use]
    pub fn of(force: &Force) -> Option<Self> {
        match force {
            Force::OneAxis {
                toward_plus,
                toward_minus,
                pretension_n,
                ..
            } => Some(Self {
                axis: force.axis()?,
                plus: usize::from(toward_plus.checked_sub(1)?),
                minus: usize::from(toward_minus.checked_sub(1)?),
                pretension_n: *pretension_n,
            }),
            Force::ThreeAxes { .. } => None,
        }
    }

    /// Tensions for a force along the axis, N; `None` where a cable does not pull to its side.
    #[must_use]
    pub fn tensions_n(
        &self,
        directions: &[Vector3<f64>; UNITS],
        along_n: f64,
    ) -> Option<[f64; UNITS]> {
        let toward_plus = directions[self.plus].dot(&self.axis);
        let toward_minus = -directions[self.minus].dot(&self.axis);
        if toward_plus < LEAST_COSINE || toward_minus < LEAST_COSINE {
            return None;
        }
        let base_n = self.pretension_n * toward_plus.max(toward_minus);
        let mut tension_n = [0.0; UNITS];
        tension_n[self.plus] = (base_n + along_n.max(0.0)) / toward_plus;
        tension_n[self.minus] = (base_n + (-along_n).max(0.0)) / toward_minus;
        Some(tension_n)
    }
}

/// Least cosine between a cable and the axis along which it is to pull.
const LEAST_COSINE: f64 = 0.5;

/// Whether a force at a tip is within reach, and what is otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reach {
    /// It is.
    Within,
    /// The cables can't work at this tip.
    Pose,
    /// The force is not.
    Force {
        /// The nearest force that is, N.
        nearest_n: Vector3<f64>,
        /// Largest part of the force that is within reach in exactly its direction.
        part: f64,
    },
}

/// Examines forces at tips.
#[derive(Debug)]
pub struct Examiner {
    rig: Rig,
    enabled: [bool; UNITS],
    one_axis: Option<OneAxis>,
    allocator: Allocator,
}

impl Examiner {
    /// For the enabled units of a rig file.
    ///
    /// # Errors
    /// As [`Allocator::new`].
    pub fn new(rig: &Rig, force: &Force) -> Result<Self, ControlError> {
        Ok(Self {
            rig: rig.clone(),
            enabled: rig.units.map(|unit| unit.enabled),
            one_axis: OneAxis::of(force),
            allocator: Allocator::warm()?,
        })
    }

    /// Whether `force_n` is within reach at `tip_m`.
    ///
    /// # Errors
    /// As [`Allocator::solve`].
    pub fn examine(
        &mut self,
        tip_m: Vector3<f64>,
        force_n: Vector3<f64>,
    ) -> Result<Reach, ControlError> {
        let Ok(cables) = Cables::at(&self.rig, tip_m, &self.enabled) else {
            return Ok(Reach::Pose);
        };
        match self.one_axis {
            Some(one) => Ok(self.one_axis_reach(&one, &cables, force_n)),
            None => {
                let zero = problem(&self.rig, &cables, &self.enabled);
                let found = self.allocator.solve(&Problem { force_n, ..zero })?;
                if found.feasible {
                    return Ok(Reach::Within);
                }
                Ok(Reach::Force {
                    nearest_n: found.force_n,
                    part: found.fraction.value().unwrap_or(0.0),
                })
            }
        }
    }

    fn one_axis_reach(&self, one: &OneAxis, cables: &Cables, force_n: Vector3<f64>) -> Reach {
        let along_n = force_n.dot(&one.axis);
        let Some(tension_n) = one.tensions_n(&cables.directions, along_n) else {
            return Reach::Pose;
        };
        let unit = if along_n >= 0.0 { one.plus } else { one.minus };
        let most_n = self.rig.units[unit].tension_max_n;
        if tension_n[unit] <= most_n {
            return Reach::Within;
        }
        let cosine = cables.directions[unit].dot(&one.axis).abs();
        let excess_n = (tension_n[unit] - most_n) * cosine;
        let part = (1.0 - excess_n / along_n.abs()).max(0.0);
        Reach::Force {
            nearest_n: one.axis * (along_n * part),
            part,
        }
    }
}

/// What a cycle sends, and what it aims at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulled {
    /// Setpoints for the board.
    pub setpoints: [UnitSetpoint; UNITS],
    /// The same in N.
    pub tension_n: [f64; UNITS],
    /// Force that the measured tensions apply, N, a cycle ago: along the cables of then.
    pub applied_n: Vector3<f64>,
}

/// The force loop of a trial.
#[derive(Debug)]
pub struct Puller {
    rig: Rig,
    controller: Controller,
    one_axis: Option<OneAxis>,
    held_n: [f64; UNITS],
    /// The cables in the cycle before: the measured tensions pulled along these.
    cables: Option<Cables>,
}

impl Puller {
    /// At rest.
    ///
    /// # Errors
    /// As [`Controller::new`].
    pub fn new(rig: &Rig, force: &Force) -> Result<Self, ControlError> {
        Ok(Self {
            rig: rig.clone(),
            controller: Controller::new(rig)?,
            one_axis: OneAxis::of(force),
            held_n: [0.0; UNITS],
            cables: None,
        })
    }

    /// One cycle: setpoints for the commanded force in `input`.
    ///
    /// # Errors
    /// As [`Controller::step`].
    pub fn step(&mut self, input: &Input) -> Result<Pulled, ControlError> {
        let Some(one) = self.one_axis else {
            let output = self.controller.step(input)?;
            return Ok(Pulled {
                setpoints: output.setpoints,
                tension_n: output.allocation.tension_n,
                applied_n: output.applied_n,
            });
        };
        let cables = Cables::at(&self.rig, input.tip_m, &input.available)?;
        for (held, measured) in self.held_n.iter_mut().zip(input.tension_n) {
            *held = measured.unwrap_or(*held);
        }
        let along_n = input.commanded_n.dot(&one.axis);
        let Some(tension_n) = one.tensions_n(&cables.directions, along_n) else {
            let unit = self.rig.units[one.plus].number;
            return Err(ControlError::Angle { unit, angle: 60.0 });
        };
        let setpoints =
            self.controller
                .setpoints_for(input.tip_m, input.moment, input.available, tension_n)?;
        let then = self.cables.replace(cables).unwrap_or(cables);
        Ok(Pulled {
            setpoints,
            tension_n,
            applied_n: problem(&self.rig, &then, &input.available).force_of(&self.held_n),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Experiment;

    #[test]
    fn the_axis_component_is_the_commanded_one_and_both_cables_stay_taut() {
        let thesis = Experiment::thesis().unwrap();
        let rig = thesis.prepare_rig(&Rig::built_in().unwrap()).unwrap();
        let one = OneAxis::of(&thesis.force).unwrap();
        let enabled = rig.units.map(|unit| unit.enabled);
        for dx in [-0.06, 0.0, 0.06] {
            let tip_m = rig.workspace.center_m + Vector3::new(dx, 0.03, -dx);
            let cables = Cables::at(&rig, tip_m, &enabled).unwrap();
            for along_n in [-4.5, -1.0, 0.0, 0.3, 4.5] {
                let t = one.tensions_n(&cables.directions, along_n).unwrap();
                let force: Vector3<f64> = (0..UNITS).map(|i| cables.directions[i] * t[i]).sum();
                assert!((force.dot(&one.axis) - along_n).abs() < 1e-12);
                assert!(t[2] >= 2.0 - 1e-12 && t[3] >= 2.0 - 1e-12, "{t:?}");
                assert!(t[2].min(t[3]) < 2.2, "{t:?}");
                assert_eq!((t[0], t[1], t[4], t[5]), (0.0, 0.0, 0.0, 0.0));
            }
        }
    }

    /// They are that old when the host has them.
    #[test]
    fn tensions_count_along_the_cables_of_a_cycle_ago() {
        let thesis = Experiment::thesis().unwrap();
        let rig = thesis.prepare_rig(&Rig::built_in().unwrap()).unwrap();
        let mut puller = Puller::new(&rig, &thesis.force).unwrap();
        let available = rig.units.map(|unit| unit.enabled);
        let at = |tip_m| {
            let cables = Cables::at(&rig, tip_m, &available).unwrap();
            problem(&rig, &cables, &available).force_of(&[3.0; UNITS])
        };
        let mut input = Input {
            dt_s: 0.01,
            tip_m: rig.workspace.center_m,
            moment: None,
            tension_n: [Some(3.0); UNITS],
            available,
            commanded_n: Vector3::zeros(),
        };
        let mut last_m = input.tip_m;
        for _ in 0..3 {
            assert_eq!(puller.step(&input).unwrap().applied_n, at(last_m));
            last_m = input.tip_m;
            input.tip_m.x += 1e-3;
        }
        assert_ne!(at(last_m), at(input.tip_m));
    }

    #[test]
    fn what_is_out_of_reach_comes_with_the_nearest_force() {
        let thesis = Experiment::thesis().unwrap();
        let rig = thesis.prepare_rig(&Rig::built_in().unwrap()).unwrap();
        let mut examiner = Examiner::new(&rig, &thesis.force).unwrap();
        let tip_m = rig.workspace.center_m;
        let reach = examiner
            .examine(tip_m, Vector3::new(0.0, 4.5, 0.0))
            .unwrap();
        assert_eq!(reach, Reach::Within);
        let Reach::Force { nearest_n, part } = examiner
            .examine(tip_m, Vector3::new(0.0, 20.0, 0.0))
            .unwrap()
        else {
            panic!("20 N with 12 N at most");
        };
        assert!((nearest_n.y - 20.0 * part).abs() < 1e-12 && nearest_n.y < 11.0);
        let again = examiner.examine(tip_m, nearest_n * 0.999_999).unwrap();
        assert_eq!(again, Reach::Within);
        let far = tip_m + Vector3::new(0.0, 1.0, 0.0);
        assert_eq!(
            examiner.examine(far, Vector3::zeros()).unwrap(),
            Reach::Pose
        );
    }
}
