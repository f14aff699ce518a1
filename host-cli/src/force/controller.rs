//! The force controller on the host, 100 Hz (thesis 3.7).
//!
//! ```text
//! commanded force ─ slew ─ nearest feasible ─▶ reference ──┬───────────────────┐
//! pose ─▶ cable directions, 1/cos ──────────────┐       │ error               ▼
//! tensions ─▶ applied force A T ────────────────┼───────┴──▶ PI ─▶ compensated force
//!                                               └─▶ allocation ─▶ 6 tensions + 1/cos
//! ```
//!
//! The load-cell angle is compensated where the tension is computed: the board multiplies each load-cell
//! force by the 1/cos that goes out with the setpoints, so what it reports is the cable's tension.
//!
//! Anti-windup has two parts. A commanded force out of reach is replaced, for the error, by the nearest one within
//! reach, so the integral does not wind up. When the *compensated* force is out of reach, the excess is subtracted
//! from the integral.
//!
//! A unit that is not available (faulted, switched off) gets no share; the force is allocated to the rest.

use crate::force::allocation::{Allocation, AllocationError, Allocator, Problem};
use crate::rigfile::RigFile;
use nalgebra::Vector3;
use wire::message::UnitSetpoint;
use wire::UNITS;

/// Longest time between two cycles that the slew limit and the integral count, s. After a pause they don't jump.
const MAX_DT_S: f64 = 0.1;

/// Input of the controller in each cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input {
    /// Time since the last cycle, s.
    pub dt_s: f64,
    /// Tip of the robot, base frame, m.
    pub tip_m: Vector3<f64>,
    /// Cable tensions that the board measured, N; `None` where there is no new value.
    pub tension_n: [Option<f64>; UNITS],
    /// Units that can pull.
    pub available: [bool; UNITS],
    /// Commanded force at the tip, N.
    pub commanded_n: Vector3<f64>,
}

/// Output of a cycle, with every term of the sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Setpoints for the board.
    pub setpoints: [UnitSetpoint; UNITS],
    /// Commanded force after its slew limit, N.
    pub slewed_n: Vector3<f64>,
    /// The nearest force within reach, N: the reference of the error.
    pub reference_n: Vector3<f64>,
    /// Force applied at the tip by the measured tensions, N.
    pub applied_n: Vector3<f64>,
    /// Error, reference less applied, N.
    pub error_n: Vector3<f64>,
    /// Integral part, N.
    pub integral_n: Vector3<f64>,
    /// Output of the PI controller: force that the cables are to apply, N.
    pub compensated_n: Vector3<f64>,
    /// Allocation of this force to the cables.
    pub allocation: Allocation,
    /// How the slewed force itself compares with what the cables can apply.
    pub reach: Reach,
}

/// How a commanded force compares with what the available cables can apply.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Reach {
    /// Whether it is within reach.
    pub feasible: bool,
    /// Distance of the nearest force within reach, N.
    pub residual_n: f64,
    /// Largest feasible fraction in exactly its direction; `None`: not even zero.
    pub fraction: Option<f64>,
}

/// Why there can be no setpoints. The caller has to make the rig safe.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// The pose is not usable.
    #[error("the tip is reported at [{x:.3}, {y:.3}, {z:.3}] m, {distance:.3} m from the workspace's centre, {radius} m are allowed (`radius_m` in [workspace]); check the robot's pose")]
    OutsideWorkspace {
        /// Reported position in m.
        x: f64,
        /// Reported position in m.
        y: f64,
        /// Reported position in m.
        z: f64,
        /// From the centre, m.
        distance: f64,
        /// Allowed, m.
        radius: f64,
    },
    /// A cable's angle is too large for its load cell.
    #[error("unit {unit}: the cable is {angle:.0} degrees off its load cell's axis, 75 are the most; check pose, exit_m and axis")]
    Angle {
        /// Unit from 1.
        unit: u8,
        /// Angle in degrees.
        angle: f64,
    },
    /// No unit is left.
    #[error("no force unit is available; see `forcectl status`")]
    NoUnit,
    /// See there.
    #[error(transparent)]
    Allocation(#[from] AllocationError),
}

/// The controller and its memory.
#[derive(Debug)]
pub struct Controller {
    rig: RigFile,
    allocator: Allocator,
    slewed_n: Vector3<f64>,
    integral_n: Vector3<f64>,
    tension_n: [f64; UNITS],
}

impl Controller {
    /// At rest: no force commanded, nothing integrated.
    ///
    /// # Errors
    /// As [`Allocator::new`].
    pub fn new(rig: &RigFile) -> Result<Self, AllocationError> {
        Ok(Self {
            rig: rig.clone(),
            allocator: Allocator::new()?,
            slewed_n: Vector3::zeros(),
            integral_n: Vector3::zeros(),
            tension_n: [0.0; UNITS],
        })
    }

    /// One cycle.
    ///
    /// # Errors
    /// [`ControlError`]; there are no setpoints then, and the rig has to be made safe.
    pub fn step(&mut self, input: &Input) -> Result<Output, ControlError> {
        let (directions, inv_cos_q16) = self.geometry(input)?;
        let settings = self.rig.controller;
        let dt_s = input.dt_s.clamp(0.0, MAX_DT_S);
        let step_n = input.commanded_n - self.slewed_n;
        self.slewed_n += step_n.cap_magnitude(settings.slew_n_per_s * dt_s);

        let problem = self.problem(directions, &input.available);
        let direct = self.allocator.solve(&Problem {
            force_n: self.slewed_n,
            ..problem
        })?;
        // Within reach the tie-break costs less than a millinewton: no reason to aim beside the target.
        let reference_n = if direct.feasible {
            self.slewed_n
        } else {
            direct.force_n
        };

        for i in 0..UNITS {
            match input.tension_n[i] {
                _ if !input.available[i] => self.tension_n[i] = 0.0,
                Some(tension) => self.tension_n[i] = tension,
                None => {}
            }
        }
        let applied_n = problem.force_of(&self.tension_n);
        let error_n = reference_n - applied_n;
        let gain = settings.ki_per_s * dt_s;
        self.integral_n =
            (self.integral_n + error_n * gain).cap_magnitude(settings.integral_limit_n);
        let compensated_n = reference_n + error_n * settings.kp + self.integral_n;
        let allocation = self.allocator.solve(&Problem {
            force_n: compensated_n,
            ..problem
        })?;
        if !allocation.feasible {
            // Subtract what the cables can't follow, but never more than has been integrated.
            let excess_n = compensated_n - allocation.force_n;
            let limit_n = self.integral_n.norm();
            self.integral_n = (self.integral_n - excess_n).cap_magnitude(limit_n);
        }
        let setpoints = core::array::from_fn(|i| UnitSetpoint {
            tension_un: (allocation.tension_n[i] * 1e6).round() as i32,
            inv_cos_q16: inv_cos_q16[i],
            direction_q14: control::geometry::direction_q14(&directions[i]),
        });
        Ok(Output {
            setpoints,
            slewed_n: self.slewed_n,
            reference_n,
            applied_n,
            error_n,
            integral_n: self.integral_n,
            compensated_n,
            allocation,
            reach: Reach {
                feasible: direct.feasible,
                residual_n: direct.residual_n,
                fraction: direct.fraction,
            },
        })
    }

    /// Cable directions and 1/cos of all units at this tip.
    fn geometry(
        &self,
        input: &Input,
    ) -> Result<([Vector3<f64>; UNITS], [i32; UNITS]), ControlError> {
        let workspace = self.rig.workspace;
        let distance = (input.tip_m - workspace.center_m).norm();
        // Not finite ends here too.
        if distance.is_nan() || distance > workspace.radius_m {
            let [x, y, z] = input.tip_m.into();
            return Err(ControlError::OutsideWorkspace {
                x,
                y,
                z,
                distance,
                radius: workspace.radius_m,
            });
        }
        let mut directions = [Vector3::zeros(); UNITS];
        let mut inv_cos_q16 = [65_536; UNITS];
        for (i, unit) in self.rig.units.iter().enumerate() {
            let cable = unit.cable_at(input.tip_m);
            let inv_cos = cable.and_then(|(_, cos)| control::geometry::inv_cos_q16(cos));
            match (cable, inv_cos) {
                (Some((direction, _)), Some(q16)) => {
                    directions[i] = direction;
                    inv_cos_q16[i] = q16;
                }
                _ if !input.available[i] => {}
                (cable, _) => {
                    return Err(ControlError::Angle {
                        unit: unit.number,
                        angle: cable.map_or(90.0, |(_, cos)| cos.acos().to_degrees()),
                    })
                }
            }
        }
        if input.available.contains(&true) {
            Ok((directions, inv_cos_q16))
        } else {
            Err(ControlError::NoUnit)
        }
    }

    fn problem(&self, directions: [Vector3<f64>; UNITS], available: &[bool; UNITS]) -> Problem {
        let bound = |value: fn(&crate::rigfile::UnitSettings) -> f64| {
            core::array::from_fn(|i| {
                if available[i] {
                    value(&self.rig.units[i])
                } else {
                    0.0
                }
            })
        };
        Problem {
            directions,
            force_n: Vector3::zeros(),
            lower_n: bound(|unit| unit.tension_min_n),
            upper_n: bound(|unit| unit.tension_max_n),
            reference_n: self.rig.reference_n(),
            tie_break: self.rig.allocation.tie_break,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> RigFile {
        RigFile::built_in().unwrap()
    }

    fn input(rig: &RigFile) -> Input {
        Input {
            dt_s: 0.01,
            tip_m: rig.workspace.center_m,
            tension_n: [Some(0.0); UNITS],
            available: [true; UNITS],
            commanded_n: Vector3::new(0.0, 2.5, 0.0),
        }
    }

    /// Runs against cables that follow their setpoints with first-order lag and gain errors.
    fn run(
        rig: &RigFile,
        cycles: usize,
        change: impl Fn(usize, &mut Input),
    ) -> (Controller, Vec<Output>) {
        let mut controller = Controller::new(rig).unwrap();
        let mut tension = [0.0; UNITS];
        let mut outputs = Vec::new();
        for cycle in 0..cycles {
            let mut input = input(rig);
            input.tension_n = tension.map(Some);
            change(cycle, &mut input);
            let output = controller.step(&input).unwrap();
            for (i, t) in tension.iter_mut().enumerate() {
                // A cable that always holds 5 % less than its setpoint.
                let goal = 0.95 * f64::from(output.setpoints[i].tension_un) * 1e-6;
                *t += (goal - *t) * 0.2;
            }
            outputs.push(output);
        }
        (controller, outputs)
    }

    #[test]
    fn the_integral_takes_out_what_the_cables_miss() {
        let (_, outputs) = run(&rig(), 600, |_, _| {});
        let last = outputs.last().unwrap();
        assert!(last.error_n.norm() < 1e-3, "{:?}", last.error_n);
        assert!((last.applied_n - Vector3::new(0.0, 2.5, 0.0)).norm() < 1e-3);
        for setpoint in last.setpoints {
            assert!((2_000_000..=12_000_000).contains(&setpoint.tension_un));
            assert!((65_536..=262_144).contains(&setpoint.inv_cos_q16));
        }
    }

    #[test]
    fn the_commanded_force_changes_no_faster_than_its_slew_limit() {
        let (_, outputs) = run(&rig(), 50, |_, _| {});
        let limit = 0.01 * rig().controller.slew_n_per_s + 1e-12;
        for pair in outputs.windows(2) {
            let step = (pair[1].slewed_n - pair[0].slewed_n).norm();
            assert!(step <= limit, "{step}");
        }
    }

    #[test]
    fn the_impossible_does_not_wind_the_integral_up() {
        // 40 N along y for three seconds, then back to 2.5 N.
        let (_, outputs) = run(&rig(), 1200, |cycle, input| {
            if cycle < 500 {
                input.commanded_n = Vector3::new(0.0, 40.0, 0.0);
            }
        });
        let out = &outputs[490];
        assert!(!out.reach.feasible);
        assert!(out.reach.residual_n > 20.0, "{:?}", out.reach);
        assert!(
            out.reach.fraction.is_some_and(|f| f > 0.1 && f < 0.5),
            "{:?}",
            out.reach
        );
        assert!(out.integral_n.norm() <= rig().controller.integral_limit_n + 1e-9);
        // The way back takes (40 - 2.5) / 20 s of slew; half a second later the rest is the integral's time constant,
        // and not the 1.5 N of a wound-up one.
        let back = &outputs[500 + 188 + 50];
        assert!(
            (back.applied_n - Vector3::new(0.0, 2.5, 0.0)).norm() < 0.4,
            "{back:?}"
        );
    }

    #[test]
    fn a_unit_that_drops_out_is_left_out_and_the_rest_carries_on() {
        // Without unit 4 the cables can still pull along +y.
        let (_, outputs) = run(&rig(), 600, |cycle, input| {
            if cycle >= 200 {
                input.available[3] = false;
            }
        });
        let last = outputs.last().unwrap();
        assert_eq!(last.setpoints[3].tension_un, 0);
        assert!(last.reach.feasible, "{:?}", last.reach);
        assert!(last.error_n.norm() < 5e-3, "{:?}", last.error_n);
        // Without unit 3 they can't, and say what remains.
        let (_, outputs) = run(&rig(), 600, |_, input| input.available[2] = false);
        let last = outputs.last().unwrap();
        assert!(!last.reach.feasible);
        assert!(last.reach.residual_n > 2.0, "{:?}", last.reach);
    }

    #[test]
    fn a_bad_pose_gives_no_setpoints() {
        let mut controller = Controller::new(&rig()).unwrap();
        for bad in [f64::NAN, f64::INFINITY, 3.0] {
            let mut input = input(&rig());
            input.tip_m[1] = bad;
            let error = controller.step(&input).unwrap_err();
            assert!(
                matches!(error, ControlError::OutsideWorkspace { .. }),
                "{error}"
            );
        }
        let mut input = input(&rig());
        input.available = [false; UNITS];
        assert_eq!(controller.step(&input), Err(ControlError::NoUnit));
    }
}
