//! Holding tensions: arm, hold zero force at least tension or given tensions, until it is ended.

use crate::checks::{fresh_pose, require_feasible, require_zero_at, tell_of};
use crate::disarm::{make_safe, ramp_down_and_disarm};
use crate::error::{ArgumentError, Fault, RunError};
use crate::options::Zeroing;
use crate::phase::{begin, connect, Observer, Phase};
use crate::quality::MOST_RMS_N;
use crate::ready::ready_board;
use force::controller::{problem, Cables, ControlError, Controller, Input};
use force::pose::PoseSource;
use nalgebra::Vector3;
use rig::Rig;
use session::link::RigLink;
use session::{Session, PERIOD};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use wire::message::UnitSetpoint;
use wire::{Command, UNITS};

/// Time after arming before which no tension counts as reached, s.
const SETTLE_S: f64 = 1.0;
/// Time after arming within which every cable has to be at its tension, s. Estimate: the board's
/// own faults of a slack cable (45) and of a command at its limit (46) come within seconds.
const REACHED_WITHIN_S: f64 = 10.0;
/// Difference of a tension from its setpoint from which on it is not reached, N: above the peak at
/// a reversal (0.32 N), a quarter of the least tension of the built-in rig.
const REACHED_N: f64 = 0.5;

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
    /// Force at the tip that the cables could not avoid where none was commanded, N: the largest.
    pub pull_n: f64,
    /// Units that are enabled and took no part.
    pub left_out: [bool; UNITS],
    /// Whether a signal or `disarm` ended it.
    pub interrupted: bool,
}

impl HeldTensions {
    /// What was not as asked for, a sentence each without its full stop.
    #[must_use]
    pub fn shortfalls(&self) -> Vec<String> {
        let mut out = Vec::new();
        for i in 0..UNITS {
            let unit = i + 1;
            match self.error_rms_n[i] {
                _ if self.left_out[i] => {
                    out.push(format!("unit {unit} is not ready, and took no part"))
                }
                Some(rms) if rms > MOST_RMS_N => out.push(format!(
                    "the tension of unit {unit} was off by {rms:.2} N RMS (most {MOST_RMS_N:.2} N)"
                )),
                _ => {}
            }
        }
        if self.pull_n > 0.0 {
            out.push(format!(
                "zero force was out of reach of the cables at times: the tip was pulled with up to {:.2} N",
                self.pull_n
            ));
        }
        out
    }
}

/// Sums over the cycles after settling.
#[derive(Debug, Default)]
struct Sums {
    cycles: [u64; UNITS],
    tension: [f64; UNITS],
    squared_error: [f64; UNITS],
    pull_n: f64,
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
    let held = hold(
        &mut session,
        rig,
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
                make_safe(&mut session, rig, observer);
                return Err(error.into());
            }
            observer.received(&session.drain());
            Ok(held)
        }
        Err(error) => {
            let error = error.with_who(session.link());
            make_safe(&mut session, rig, observer);
            Err(error)
        }
    }
}

/// Checks the tensions before anything is opened.
fn check(rig: &Rig, options: &TensionOptions) -> Result<(), RunError> {
    let Some(tension_n) = options.tension_n else {
        return if is_single(rig) {
            Ok(())
        } else {
            require_feasible(rig)
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

/// Checks at the tip's pose what the tensions do to the tip, before anything is armed.
fn require_at(
    rig: &Rig,
    tip_m: Vector3<f64>,
    available: &[bool; UNITS],
    tension_n: Option<[f64; UNITS]>,
) -> Result<(), RunError> {
    if is_single(rig) {
        return Ok(());
    }
    let Some(tension_n) = tension_n else {
        return require_zero_at(rig, tip_m, available);
    };
    let cables = Cables::at(rig, tip_m, available)?;
    let driven = std::array::from_fn(|i| if available[i] { tension_n[i] } else { 0.0 });
    let force_n = problem(rig, &cables, available).force_of(&driven);
    Ok(rig.check_force(force_n).map_err(ArgumentError::Force)?)
}

/// Whether a single unit is enabled: it pulls at a fixed hook, during bring-up.
fn is_single(rig: &Rig) -> bool {
    rig.units.iter().filter(|unit| unit.enabled).count() < 2
}

/// What a cable lacks to its setpoint, in words; `None` where it is there.
fn away(unit: usize, measured_n: Option<f64>, setpoint: &UnitSetpoint) -> Option<String> {
    let wanted_n = wanted(setpoint);
    match measured_n {
        Some(measured_n) if (measured_n - wanted_n).abs() < REACHED_N => None,
        Some(measured_n) => Some(format!(
            "cable {} ({measured_n:.2} of {wanted_n:.2} N)",
            unit + 1
        )),
        None => Some(format!("cable {} (no sample of {wanted_n:.2} N)", unit + 1)),
    }
}

/// Tension of a setpoint, N.
fn wanted(setpoint: &UnitSetpoint) -> f64 {
    f64::from(setpoint.tension_un) * 1e-6
}

fn hold(
    session: &mut Session<'_>,
    rig: &Rig,
    pose: &mut PoseSource,
    available: [bool; UNITS],
    options: &TensionOptions,
    observer: &mut dyn Observer,
    holding: &mut dyn FnMut(),
) -> Result<HeldTensions, RunError> {
    let tip_m = fresh_pose(session, pose, &options.stop, observer)?;
    require_at(rig, tip_m, &available, options.tension_n)?;
    let mut controller = Controller::new(rig).map_err(ControlError::from)?;
    begin(session, observer, Phase::Tension);
    session.command(&Command::Arm)?;
    let start_ns = session.now_ns();
    let mut sums = Sums::default();
    let mut held_s = 0.0;
    // When every cable was at its tension.
    let mut reached_s = None;
    loop {
        let interrupted = options.stop.load(Ordering::Relaxed);
        if interrupted
            || options
                .duration_s
                .is_some_and(|duration| held_s >= duration)
        {
            let left_out = std::array::from_fn(|i| rig.units[i].enabled && !available[i]);
            return Ok(sums.outcome(held_s, left_out, interrupted));
        }
        let tip = pose.tip(session.tip_m(), session.now_ns());
        tell_of(pose, observer);
        let (tip_m, moment) = tip?;
        // While a cable's slack is taken up its reel turns as no robot makes it.
        let moment = moment.filter(|_| held_s > 0.0);
        let measured = session.recent_tension_n();
        let (setpoints, pull_n) = match options.tension_n {
            Some(tension_n) => {
                let of = controller.setpoints_for(tip_m, moment, available, tension_n)?;
                (of, 0.0)
            }
            None => {
                let output = controller.step(&Input {
                    dt_s: PERIOD.as_secs_f64(),
                    tip_m,
                    moment,
                    tension_n: measured,
                    available,
                    commanded_n: Vector3::zeros(),
                })?;
                let reach = output.reach;
                let pulls = !reach.feasible && !is_single(rig);
                (output.setpoints, if pulls { reach.residual_n } else { 0.0 })
            }
        };
        session.send_setpoints(setpoints, PERIOD)?;
        let received = session.drain();
        observer.received(&received);
        if let Some(fault) = session.fault_in(&received) {
            return Err(fault.into());
        }
        let elapsed_s = (session.now_ns() - start_ns) as f64 * 1e-9;
        if reached_s.is_none() && elapsed_s >= SETTLE_S {
            let cables: Vec<String> = (0..UNITS)
                .filter(|i| available[*i])
                .filter_map(|i| away(i, measured[i], &setpoints[i]))
                .collect();
            if cables.is_empty() {
                reached_s = Some(elapsed_s);
                holding();
            } else if elapsed_s > REACHED_WITHIN_S {
                let within_s = REACHED_WITHIN_S;
                return Err(Fault::NotReached { within_s, cables }.into());
            }
        }
        let Some(reached_s) = reached_s else {
            observer.progress(Phase::Tension, elapsed_s / REACHED_WITHIN_S);
            continue;
        };
        held_s = elapsed_s - reached_s;
        sums.add(&measured, &setpoints);
        sums.pull_n = sums.pull_n.max(pull_n);
        let fraction = options.duration_s.map_or(0.0, |duration| held_s / duration);
        observer.progress(Phase::HoldTensions, fraction);
    }
}

impl Sums {
    fn add(&mut self, measured: &[Option<f64>; UNITS], setpoints: &[UnitSetpoint; UNITS]) {
        for i in 0..UNITS {
            if let Some(tension) = measured[i] {
                let error = tension - wanted(&setpoints[i]);
                self.cycles[i] += 1;
                self.tension[i] += tension;
                self.squared_error[i] += error * error;
            }
        }
    }

    fn outcome(&self, held_s: f64, left_out: [bool; UNITS], interrupted: bool) -> HeldTensions {
        let per = |i: usize, sum: f64| (self.cycles[i] > 0).then(|| sum / self.cycles[i] as f64);
        HeldTensions {
            held_s,
            tension_n: std::array::from_fn(|i| per(i, self.tension[i])),
            error_rms_n: std::array::from_fn(|i| per(i, self.squared_error[i]).map(f64::sqrt)),
            pull_n: self.pull_n,
            left_out,
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
        assert_eq!(
            Sums::default().outcome(0.0, [false; UNITS], true).tension_n,
            [None; UNITS]
        );
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
    fn a_unit_that_is_lost_and_tensions_that_pull_the_tip_are_refused_before_arming() {
        let rig = Rig::built_in().unwrap();
        let refused = |board: &mut FakeBoard, tension_n| {
            let options = TensionOptions {
                tension_n,
                duration_s: Some(1.0),
                ..TensionOptions::default()
            };
            let held = hold_tensions(board, &rig, &options, &mut NoopObserver, &mut || {});
            assert!(!board.commands.contains(&Command::Arm));
            held.unwrap_err().to_string()
        };
        let mut board = FakeBoard::new(Behavior::Good);
        board.unit_faults[2] = Some((control::Fault::Implausible, 1));
        let error = refused(&mut board, None);
        assert!(error.contains("zero force is out of reach"), "{error}");
        // One cable of each pair: three pulls at right angles.
        let mut board = FakeBoard::new(Behavior::Good);
        let pairs = Some([12.0, 2.0, 12.0, 2.0, 12.0, 2.0]);
        let error = refused(&mut board, pairs);
        assert!(error.contains("force_limit_n"), "{error}");
    }

    #[test]
    fn what_was_not_held_is_told() {
        let mut held = HeldTensions {
            error_rms_n: [Some(0.05); UNITS],
            ..HeldTensions::default()
        };
        assert_eq!(held.shortfalls(), Vec::<String>::new());
        held.error_rms_n[1] = Some(0.3);
        held.left_out[4] = true;
        held.pull_n = 1.5;
        let told = held.shortfalls().join("; ");
        for words in ["unit 2 was off by 0.30 N", "unit 5 is not ready", "1.50 N"] {
            assert!(told.contains(words), "{told}");
        }
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
