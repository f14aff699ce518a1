//! The force controller on the host, 100 Hz (thesis 3.7).
//!
//! ```text
//! commanded force ─ slew ─ nearest feasible ─▶ reference ──┬───────────────────┐
//! pose ─▶ cable directions, 1/cos ──────────────┐       │ error               ▼
//! tensions ─▶ applied force A T ────────────────┼───────┴──▶ PI ─▶ compensated force
//!                                               └─▶ allocation ─▶ 6 tensions + 1/cos
//! ```
//!
//! The load-cell angle is compensated where the tension is computed: the board multiplies each
//! load-cell force by the 1/cos that goes out with the setpoints, so what it reports is the cable's
//! tension.
//!
//! Anti-windup has two parts. A commanded force out of reach is replaced, for the error, by the
//! nearest one within reach, so the integral does not wind up. When the *compensated* force is out
//! of reach, the integral loses what it has along the excess, at most the excess and never more
//! than is there: it can't change its sign, and what it holds across the excess stays.
//!
//! A unit that is not available (faulted, switched off) gets no share; the force is allocated to
//! the rest.

use crate::allocation::{Allocation, AllocationError, Allocator, Fraction, Problem};
use crate::preview::{reel_um_per_s, Moment, Preview};
use nalgebra::Vector3;
use rig::{Rig, UnitSettings};
use wire::message::UnitSetpoint;
use wire::UNITS;

/// Longest time between two cycles that the slew limit and the integral count, s. After a pause
/// they don't jump.
const MAX_DT_S: f64 = 0.1;

/// Input of the controller in each cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input {
    /// Time since the last cycle, s.
    pub dt_s: f64,
    /// Tip of the robot, base frame, m.
    pub tip_m: Vector3<f64>,
    /// When it was there; `None`: not known, and no reel's speed is sent.
    pub moment: Option<Moment>,
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
    /// Force applied at the tip by the measured tensions, N, a cycle ago: along the cables of then.
    pub applied_n: Vector3<f64>,
    /// Error, reference less applied, N.
    pub error_n: Vector3<f64>,
    /// Integral part, N.
    pub integral_n: Vector3<f64>,
    /// Output of the PI controller: force that the cables are to apply, N.
    pub compensated_n: Vector3<f64>,
    /// Allocation of this force to the cables.
    pub allocation: Allocation,
    /// How the commanded force compares with what the cables can apply.
    pub reach: Reach,
    /// Whether the integral is at its limit.
    pub integral_limited: bool,
}

/// How a commanded force compares with what the available cables can apply.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Reach {
    /// Whether it is within reach.
    pub feasible: bool,
    /// Distance of the nearest force within reach, N.
    pub residual_n: f64,
    /// How much of it is within reach in exactly its direction.
    pub fraction: Fraction,
}

impl Reach {
    /// In words, for the user.
    #[must_use]
    pub fn describe(&self) -> String {
        let nearest = format!(
            "the force is out of reach of the cables and their limits: the nearest one is held, {:.3} N away",
            self.residual_n
        );
        match self.fraction {
            _ if self.feasible => "the force is within reach".to_owned(),
            Fraction::Of(fraction) => format!(
                "{nearest}; in exactly this direction {:.1} % of it would be within reach",
                100.0 * fraction
            ),
            Fraction::NotEvenZero => format!("{nearest}; not even zero force is within reach"),
            Fraction::Unknown => format!(
                "{nearest}; how much of it would be within reach is not known, because the solver of that question failed"
            ),
        }
    }
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
    rig: Rig,
    allocator: Allocator,
    slewed_n: Vector3<f64>,
    integral_n: Vector3<f64>,
    tension_n: [f64; UNITS],
    /// The cables in the cycle before.
    cables: Option<Cables>,
    preview: Preview,
}

impl Controller {
    /// At rest: no force commanded, nothing integrated.
    ///
    /// # Errors
    /// As [`Allocator::new`].
    pub fn new(rig: &Rig) -> Result<Self, AllocationError> {
        Ok(Self {
            rig: rig.clone(),
            allocator: Allocator::warm()?,
            slewed_n: Vector3::zeros(),
            integral_n: Vector3::zeros(),
            tension_n: [0.0; UNITS],
            cables: None,
            preview: Preview::default(),
        })
    }

    /// One cycle.
    ///
    /// # Errors
    /// [`ControlError`]; there are no setpoints then, and the rig has to be made safe.
    pub fn step(&mut self, input: &Input) -> Result<Output, ControlError> {
        let cables = Cables::at(&self.rig, input.tip_m, &input.available)?;
        let problem = problem(&self.rig, &cables, &input.available);
        let settings = self.rig.controller;
        let dt_s = input.dt_s.clamp(0.0, MAX_DT_S);
        let step_n = input.commanded_n - self.slewed_n;
        self.slewed_n += step_n.cap_magnitude(settings.slew_n_per_s * dt_s);
        let direct = self.allocator.solve(&Problem {
            force_n: self.slewed_n,
            ..problem
        })?;
        // Within reach the tie-break costs less than a millinewton: no reason to aim beside the
        // target.
        let reference_n = if direct.feasible {
            self.slewed_n
        } else {
            direct.force_n
        };
        let reach = self.reach(&problem, &direct, input.commanded_n)?;

        for i in 0..UNITS {
            match input.tension_n[i] {
                _ if !input.available[i] => self.tension_n[i] = 0.0,
                Some(tension) => self.tension_n[i] = tension,
                None => {}
            }
        }
        // The tensions are about a cycle older than the pose: they pulled along the cables of then.
        let then = self.cables.replace(cables).unwrap_or(cables);
        let applied_n = self::problem(&self.rig, &then, &input.available).force_of(&self.tension_n);
        let error_n = reference_n - applied_n;
        let gain = settings.ki_per_s * dt_s;
        let integral_n = self.integral_n + error_n * gain;
        let integral_limited = integral_n.norm() > settings.integral_limit_n;
        self.integral_n = integral_n.cap_magnitude(settings.integral_limit_n);
        let compensated_n = reference_n + error_n * settings.kp + self.integral_n;
        let allocation = self.allocator.solve(&Problem {
            force_n: compensated_n,
            ..problem
        })?;
        if !allocation.feasible {
            self.integral_n = unwound(self.integral_n, compensated_n - allocation.force_n);
        }
        let velocity = self.tip_velocity(input.tip_m, input.moment);
        let setpoints = core::array::from_fn(|i| UnitSetpoint {
            tension_un: self.rig.units[i].setpoint_un(allocation.tension_n[i]),
            inv_cos_q16: cables.inv_cos_q16[i],
            direction_q14: control::geometry::direction_q14(&cables.directions[i]),
            reel_um_per_s: velocity.and_then(|v| reel_um_per_s(&cables.directions[i], &v)),
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
            reach,
            integral_limited,
        })
    }

    /// The tip's velocity, m/s, where the rig file wants it told and it is known well enough.
    fn tip_velocity(
        &mut self,
        tip_m: Vector3<f64>,
        moment: Option<Moment>,
    ) -> Option<Vector3<f64>> {
        let wanted = self.rig.controller.preview;
        self.preview.see(tip_m, moment.filter(|_| wanted))
    }

    /// Setpoints for given cable tensions, N, at this tip (robot base frame, m), which was there at
    /// `moment`. Units that are not available get 0.
    ///
    /// # Errors
    /// As [`Controller::step`], apart from the allocation.
    pub fn setpoints_for(
        &mut self,
        tip_m: Vector3<f64>,
        moment: Option<Moment>,
        available: [bool; UNITS],
        tension_n: [f64; UNITS],
    ) -> Result<[UnitSetpoint; UNITS], ControlError> {
        let velocity = self.tip_velocity(tip_m, moment);
        let cables = Cables::at(&self.rig, tip_m, &available)?;
        Ok(core::array::from_fn(|i| UnitSetpoint {
            tension_un: if available[i] {
                self.rig.units[i].setpoint_un(tension_n[i])
            } else {
                0
            },
            inv_cos_q16: cables.inv_cos_q16[i],
            direction_q14: control::geometry::direction_q14(&cables.directions[i]),
            reel_um_per_s: velocity.and_then(|v| reel_um_per_s(&cables.directions[i], &v)),
        }))
    }

    /// How the commanded force compares with what the cables can apply; `direct` is the allocation
    /// of the slewed one.
    fn reach(
        &mut self,
        problem: &Problem,
        direct: &Allocation,
        commanded_n: Vector3<f64>,
    ) -> Result<Reach, AllocationError> {
        let allocation = if commanded_n == self.slewed_n {
            *direct
        } else {
            self.allocator.solve(&Problem {
                force_n: commanded_n,
                ..*problem
            })?
        };
        Ok(Reach {
            feasible: allocation.feasible,
            residual_n: allocation.residual_n,
            fraction: allocation.fraction,
        })
    }
}

/// The integral after an excess of the compensated force over what the cables can apply, N.
fn unwound(integral_n: Vector3<f64>, excess_n: Vector3<f64>) -> Vector3<f64> {
    match excess_n.try_normalize(0.0) {
        Some(along) => {
            let part_n = integral_n.dot(&along).clamp(0.0, excess_n.norm());
            integral_n - along * part_n
        }
        None => integral_n,
    }
}

/// The cables at one tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cables {
    /// Unit vectors from the tip to where each cable leaves its reel; zero for a unit that is not
    /// available and has none.
    pub directions: [Vector3<f64>; UNITS],
    /// 1/cos of the angle between cable and load cell, times 65,536.
    pub inv_cos_q16: [i32; UNITS],
}

impl Cables {
    /// The cables of the available units at a tip, m, robot base frame.
    ///
    /// # Errors
    /// The tip is outside the workspace, a cable is too far off its load cell's axis, or no unit is
    /// available.
    pub fn at(
        rig: &Rig,
        tip_m: Vector3<f64>,
        available: &[bool; UNITS],
    ) -> Result<Self, ControlError> {
        let workspace = rig.workspace;
        let distance = (tip_m - workspace.center_m).norm();
        // Not finite ends here too.
        if distance.is_nan() || distance > workspace.radius_m {
            let [x, y, z] = tip_m.into();
            return Err(ControlError::OutsideWorkspace {
                x,
                y,
                z,
                distance,
                radius: workspace.radius_m,
            });
        }
        let mut cables = Self {
            directions: [Vector3::zeros(); UNITS],
            inv_cos_q16: [65_536; UNITS],
        };
        for (i, unit) in rig.units.iter().enumerate() {
            let cable = unit.cable_at(tip_m);
            let inv_cos = cable.and_then(|(_, cos)| control::geometry::inv_cos_q16(cos));
            match (cable, inv_cos) {
                (Some((direction, _)), Some(q16)) => {
                    cables.directions[i] = direction;
                    cables.inv_cos_q16[i] = q16;
                }
                _ if !available[i] => {}
                (cable, _) => {
                    return Err(ControlError::Angle {
                        unit: unit.number,
                        angle: cable.map_or(90.0, |(_, cos)| cos.acos().to_degrees()),
                    })
                }
            }
        }
        if available.contains(&true) {
            Ok(cables)
        } else {
            Err(ControlError::NoUnit)
        }
    }
}

/// The allocation of zero force to the available units.
#[must_use]
pub fn problem(rig: &Rig, cables: &Cables, available: &[bool; UNITS]) -> Problem {
    let bound = |value: fn(&UnitSettings) -> f64| {
        core::array::from_fn(|i| {
            if available[i] {
                value(&rig.units[i])
            } else {
                0.0
            }
        })
    };
    Problem {
        directions: cables.directions,
        force_n: Vector3::zeros(),
        lower_n: bound(|unit| unit.tension_min_n),
        upper_n: bound(|unit| unit.tension_max_n),
        reference_n: rig.reference_n(),
        tie_break: rig.allocation.tie_break,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig::built_in().unwrap()
    }

    fn input(rig: &Rig) -> Input {
        Input {
            dt_s: 0.01,
            tip_m: rig.workspace.center_m,
            moment: None,
            tension_n: [Some(0.0); UNITS],
            available: [true; UNITS],
            commanded_n: Vector3::new(0.0, 2.5, 0.0),
        }
    }

    /// Runs against cables that follow their setpoints with first-order lag and gain errors.
    fn run(
        rig: &Rig,
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

    /// They are that old when the host has them.
    #[test]
    fn tensions_count_along_the_cables_of_a_cycle_ago() {
        let rig = rig();
        let mut controller = Controller::new(&rig).unwrap();
        let mut input = input(&rig);
        input.tension_n = [Some(3.0); UNITS];
        let available = input.available;
        let at = |tip_m| {
            let cables = Cables::at(&rig, tip_m, &available).unwrap();
            problem(&rig, &cables, &available).force_of(&[3.0; UNITS])
        };
        let mut last_m = input.tip_m;
        for _ in 0..3 {
            let applied_n = controller.step(&input).unwrap().applied_n;
            assert_eq!(applied_n, at(last_m));
            last_m = input.tip_m;
            input.tip_m.x += 1e-3;
        }
        assert_ne!(at(last_m), at(input.tip_m));
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
            out.reach
                .fraction
                .value()
                .is_some_and(|f| f > 0.1 && f < 0.5),
            "{:?}",
            out.reach
        );
        assert!(out.integral_n.norm() <= rig().controller.integral_limit_n + 1e-9);
        // The way back takes (40 - 2.5) / 20 s of slew; half a second later the rest is the
        // integral's time constant, and not the 1.5 N of a wound-up one.
        let back = &outputs[500 + 188 + 50];
        assert!(
            (back.applied_n - Vector3::new(0.0, 2.5, 0.0)).norm() < 0.4,
            "{back:?}"
        );
    }

    #[test]
    fn an_excess_takes_from_the_integral_only_what_lies_along_it() {
        let v = Vector3::new;
        let close = |a: Vector3<f64>, b: Vector3<f64>| (a - b).norm() < 1e-12;
        // Across the excess nothing is lost.
        assert!(close(
            unwound(v(1.0, 0.4, 0.0), v(0.0, 0.3, 0.0)),
            v(1.0, 0.1, 0.0)
        ));
        // A large excess takes what is there and does not reverse it.
        assert!(close(
            unwound(v(1.0, 0.4, 0.0), v(0.0, 30.0, 0.0)),
            v(1.0, 0.0, 0.0)
        ));
        // An integral that works against the excess stays.
        assert!(close(
            unwound(v(0.0, -0.4, 0.0), v(0.0, 3.0, 0.0)),
            v(0.0, -0.4, 0.0)
        ));
        assert!(close(
            unwound(v(0.1, 0.2, 0.3), Vector3::zeros()),
            v(0.1, 0.2, 0.3)
        ));
    }

    #[test]
    fn reach_is_that_of_the_commanded_force_from_the_first_cycle_on() {
        let mut controller = Controller::new(&rig()).unwrap();
        let mut input = input(&rig());
        input.commanded_n = Vector3::new(0.0, 40.0, 0.0);
        let first = controller.step(&input).unwrap();
        // The slewed force is 0.2 N and within reach; the commanded one is not.
        assert!(first.slewed_n.norm() < 0.3);
        let fraction = first.reach.fraction.value().unwrap();
        let mut last = first;
        for _ in 0..300 {
            last = controller.step(&input).unwrap();
        }
        assert!(!first.reach.feasible);
        assert!((last.reach.fraction.value().unwrap() - fraction).abs() < 1e-6);
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
    fn the_setpoints_tell_how_fast_the_tip_moves_each_reel() {
        let mut rig = rig();
        assert!(rig.controller.preview);
        let velocity = Vector3::new(0.008, -0.004, 0.002);
        let moves = |rig: &Rig, timed: bool| {
            let (_, outputs) = run(rig, 200, |cycle, input| {
                let now_s = cycle as f64 * 0.01;
                input.tip_m += velocity * (now_s - 1.0);
                input.moment = timed.then_some(Moment {
                    tip_s: now_s,
                    now_s,
                });
            });
            *outputs.last().unwrap()
        };
        for (i, setpoint) in moves(&rig, true).setpoints.iter().enumerate() {
            let told = f64::from(setpoint.reel_um_per_s.unwrap());
            // The length that the cable loses in a second between reel and tip.
            let length = |t: f64| {
                let tip_m = rig.workspace.center_m + velocity * (1.0 + t);
                (rig.units[i].exit_m - tip_m).norm()
            };
            let expected = (length(-0.005) - length(0.005)) * 1e8;
            assert!(
                (told - expected).abs() < 150.0,
                "unit {i}: {told}, {expected}"
            );
        }
        let tells = |setpoints: [UnitSetpoint; UNITS]| setpoints.map(|s| s.reel_um_per_s.is_some());
        assert_eq!(tells(moves(&rig, false).setpoints), [false; UNITS]);
        // Where the rig file says so, nothing is told.
        rig.controller.preview = false;
        assert_eq!(tells(moves(&rig, true).setpoints), [false; UNITS]);
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

    #[test]
    fn reach_is_told_in_newtons_and_percent() {
        let reach = |feasible, fraction| {
            Reach {
                feasible,
                residual_n: 1.25,
                fraction,
            }
            .describe()
        };
        assert!(reach(true, Fraction::Of(1.0)).ends_with("within reach"));
        let text = reach(false, Fraction::Of(0.4));
        assert!(
            text.contains("1.250 N") && text.contains("40.0 %"),
            "{text}"
        );
        assert!(reach(false, Fraction::NotEvenZero).contains("not even zero force"));
        let text = reach(false, Fraction::Unknown);
        assert!(
            text.contains("solver") && !text.contains("not even zero"),
            "{text}"
        );
    }
}
