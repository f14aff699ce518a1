//! Holding tensions: arm, hold zero force at least tension or given tensions, until it is ended.

use crate::checks::{fresh_pose, require_feasible};
use crate::disarm::ramp_down_and_disarm;
use crate::error::{ArgumentError, RunError};
use crate::options::Zeroing;
use crate::phase::{begin, connect, Observer, Phase};
use crate::ready::ready_board;
use force::controller::{ControlError, Controller, Input};
use force::pose::PoseSource;
use nalgebra::Vector3;
use rig::Rig;
use session::link::RigLink;
use session::{Session, PERIOD};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use wire::{Command, UNITS};

/// Time after arming until tensions count as held, s.
const SETTLE_S: f64 = 1.0;

/// What to hold.
#[derive(Debug, Clone, Default)]
pub struct TensionOptions {
    /// Tensions of units 1 to 6, N; `None`: zero force at the tip with the least tensions of the
    /// rig file.
    pub tension_n: Option<[f64; UNITS]>,
    /// For how long after they are reached, s; `None`: until `stop`.
    pub duration_s: Option<f64>,
    /// Where the zeros come from.
    pub zeroing: Zeroing,
    /// Set from outside to end.
    pub stop: Arc<AtomicBool>,
}

/// What was held.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct HeldTensions {
    /// For how long after settling, s.
    pub held_s: f64,
    /// Mean measured tension of each unit after settling, N; `None` without a sample.
    pub tension_n: [Option<f64>; UNITS],
    /// RMS difference of measured tension and setpoint after settling, N; `None` without a sample.
    pub error_rms_n: [Option<f64>; UNITS],
    /// Whether a signal or `disarm` ended it.
    pub interrupted: bool,
}

/// Sums over the cycles after settling.
#[derive(Debug, Default)]
struct Sums {
    cycles: [u64; UNITS],
    tension: [f64; UNITS],
    squared_error: [f64; UNITS],
}

/// Holds tensions and returns how well. `holding` is called once they count as reached. Any fault
/// ends it: the board has set the motors to 0 V then.
///
/// # Errors
/// [`RunError`]; the rig was made safe as far as the link allowed.
pub fn hold_tensions(
    link: &mut dyn RigLink,
    rig: &Rig,
    options: &TensionOptions,
    observer: &mut dyn Observer,
    holding: &mut dyn FnMut(),
) -> Result<HeldTensions, RunError> {
    check(rig, options)?;
    let mut pose = PoseSource::open(&rig.pose)?;
    let mut session = connect(link, observer)?;
    let prepared = ready_board(&mut session, rig, &options.zeroing, &options.stop, observer)?;
    let mut controller = Controller::new(rig).map_err(ControlError::from)?;
    let held = hold(
        &mut session,
        &mut controller,
        &mut pose,
        prepared.available,
        options,
        observer,
        holding,
    );
    match held {
        Ok(held) => {
            begin(&mut session, observer, Phase::Disarm);
            if let Err(error) = ramp_down_and_disarm(&mut session, &prepared.available) {
                session.make_safe();
                return Err(error.into());
            }
            observer.received(&session.drain());
            Ok(held)
        }
        Err(error) => {
            let error = error.with_who(session.link());
            session.make_safe();
            Err(error)
        }
    }
}

/// Checks the tensions before anything is opened.
fn check(rig: &Rig, options: &TensionOptions) -> Result<(), RunError> {
    let Some(tension_n) = options.tension_n else {
        // A single unit pulls at a fixed hook, during bring-up.
        let several = rig.units.iter().filter(|unit| unit.enabled).count() > 1;
        return if several {
            require_feasible(rig)
        } else {
            Ok(())
        };
    };
    for (unit, tension) in rig.units.iter().zip(tension_n) {
        if !(unit.tension_min_n..=unit.tension_max_n).contains(&tension) {
            return Err(ArgumentError::Tension {
                unit: unit.number,
                tension_n: tension,
                min_n: unit.tension_min_n,
                max_n: unit.tension_max_n,
            }
            .into());
        }
    }
    Ok(())
}

fn hold(
    session: &mut Session<'_>,
    controller: &mut Controller,
    pose: &mut PoseSource,
    available: [bool; UNITS],
    options: &TensionOptions,
    observer: &mut dyn Observer,
    holding: &mut dyn FnMut(),
) -> Result<HeldTensions, RunError> {
    fresh_pose(session, pose, &options.stop, observer)?;
    begin(session, observer, Phase::Tension);
    session.command(&Command::Arm)?;
    let start_ns = session.now_ns();
    let mut sums = Sums::default();
    let mut held_s = 0.0;
    let mut reported = false;
    loop {
        let interrupted = options.stop.load(Ordering::Relaxed);
        if interrupted
            || options
                .duration_s
                .is_some_and(|duration| held_s >= duration)
        {
            return Ok(sums.outcome(held_s, interrupted));
        }
        let (tip_m, moment) = pose.tip(session.tip_m(), session.now_ns())?;
        // While a cable's slack is taken up its reel turns as no robot makes it.
        let moment = moment.filter(|_| held_s > 0.0);
        let measured = session.recent_tension_n();
        let setpoints = match options.tension_n {
            Some(tension_n) => controller.setpoints_for(tip_m, moment, available, tension_n)?,
            None => {
                controller
                    .step(&Input {
                        dt_s: PERIOD.as_secs_f64(),
                        tip_m,
                        moment,
                        tension_n: measured,
                        available,
                        commanded_n: Vector3::zeros(),
                    })?
                    .setpoints
            }
        };
        session.send_setpoints(setpoints, PERIOD)?;
        let received = session.drain();
        observer.received(&received);
        if let Some(fault) = session.fault_in(&received) {
            return Err(fault.into());
        }
        let elapsed_s = (session.now_ns() - start_ns) as f64 * 1e-9;
        if elapsed_s < SETTLE_S {
            observer.progress(Phase::Tension, elapsed_s / SETTLE_S);
            continue;
        }
        held_s = elapsed_s - SETTLE_S;
        sums.add(&measured, &setpoints);
        if !reported {
            reported = true;
            holding();
        }
        let fraction = options.duration_s.map_or(0.0, |duration| held_s / duration);
        observer.progress(Phase::HoldTensions, fraction);
    }
}

impl Sums {
    fn add(
        &mut self,
        measured: &[Option<f64>; UNITS],
        setpoints: &[wire::message::UnitSetpoint; UNITS],
    ) {
        for i in 0..UNITS {
            if let Some(tension) = measured[i] {
                let error = tension - f64::from(setpoints[i].tension_un) * 1e-6;
                self.cycles[i] += 1;
                self.tension[i] += tension;
                self.squared_error[i] += error * error;
            }
        }
    }

    fn outcome(&self, held_s: f64, interrupted: bool) -> HeldTensions {
        let per = |i: usize, sum: f64| (self.cycles[i] > 0).then(|| sum / self.cycles[i] as f64);
        HeldTensions {
            held_s,
            tension_n: std::array::from_fn(|i| per(i, self.tension[i])),
            error_rms_n: std::array::from_fn(|i| per(i, self.squared_error[i]).map(f64::sqrt)),
            interrupted,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoopObserver;
    use control::SystemState;
    use session::link::fake::{Behavior, FakeBoard};

    #[test]
    fn given_tensions_are_held_and_the_rig_is_disarmed() {
        let rig = Rig::built_in().unwrap();
        let mut board = FakeBoard::new(Behavior::Good);
        let options = TensionOptions {
            tension_n: Some([2.0, 3.0, 2.5, 4.0, 2.0, 3.5]),
            duration_s: Some(2.0),
            ..TensionOptions::default()
        };
        let mut calls = 0;
        let held = hold_tensions(&mut board, &rig, &options, &mut NoopObserver, &mut || {
            calls += 1
        })
        .unwrap();
        assert_eq!(calls, 1);
        for (held, wanted) in held.tension_n.iter().zip(options.tension_n.unwrap()) {
            let held = held.unwrap();
            assert!((held - wanted).abs() < 0.1, "{held} {wanted}");
        }
        assert!((held.held_s - 2.0).abs() < 0.05, "{}", held.held_s);
        assert_eq!(board.system, SystemState::Ready);
    }

    #[test]
    fn least_tensions_keep_the_tip_free_of_force() {
        let rig = Rig::built_in().unwrap();
        let mut board = FakeBoard::new(Behavior::Good);
        let options = TensionOptions {
            duration_s: Some(1.0),
            ..TensionOptions::default()
        };
        let held = hold_tensions(&mut board, &rig, &options, &mut NoopObserver, &mut || {});
        let held = held.unwrap();
        let tip_m = Vector3::from(board.plant.tip_position_m());
        let force: Vector3<f64> = (rig.units.iter().zip(held.tension_n))
            .map(|(unit, tension)| unit.cable_at(tip_m).unwrap().0 * tension.unwrap())
            .sum();
        assert!(force.norm() < 0.2, "{force}");
        let least = rig.units[0].tension_min_n;
        assert!(
            held.tension_n.iter().all(|t| t.unwrap() > least - 0.2),
            "{held:?}"
        );
        // Nothing was held: that is no tension of 0.
        assert_eq!(Sums::default().outcome(0.0, true).tension_n, [None; UNITS]);
    }

    #[test]
    fn nothing_is_armed_where_zero_force_is_out_of_reach_or_no_pose_comes() {
        let mut copied = Rig::built_in().unwrap();
        copied.units[1].exit_m = copied.units[0].exit_m;
        copied.units[1].axis = copied.units[0].axis;
        let options = TensionOptions {
            duration_s: Some(1.0),
            ..TensionOptions::default()
        };
        let mut board = FakeBoard::new(Behavior::Good);
        let error = hold_tensions(&mut board, &copied, &options, &mut NoopObserver, &mut || {});
        let error = error.unwrap_err();
        assert!(matches!(error, RunError::Infeasible(_)), "{error}");
        assert!(board.commands.is_empty());
        let rig = Rig::built_in().unwrap();
        let mut board = FakeBoard::new(Behavior::NoPose);
        let error = hold_tensions(&mut board, &rig, &options, &mut NoopObserver, &mut || {});
        let error = error.unwrap_err().to_string();
        assert!(error.contains("no pose"), "{error}");
        assert!(!board.commands.contains(&Command::Arm));
    }

    #[test]
    fn tensions_outside_the_limits_are_refused_before_anything_is_driven() {
        let rig = Rig::built_in().unwrap();
        let mut board = FakeBoard::new(Behavior::Good);
        for wrong in [0.1, 40.0, f64::NAN] {
            let options = TensionOptions {
                tension_n: Some([2.5, 2.5, wrong, 2.5, 2.5, 2.5]),
                ..TensionOptions::default()
            };
            let error = hold_tensions(&mut board, &rig, &options, &mut NoopObserver, &mut || {});
            let error = error.unwrap_err().to_string();
            assert!(error.starts_with("unit 3"), "{error}");
        }
        assert!(board.commands.is_empty());
    }
}
