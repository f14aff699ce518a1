//! A whole run: prepare the rig, hold a force while the robot moves, disarm.
//!
//! | step | file |
//! | --- | --- |
//! | connect, configure, bring up, zero | `prepare` |
//! | calibrate the load cells of an emulated rig | `calibrate` |
//! | keep, compare and store zeros | `ready` |
//! | hold tensions instead of a force | `tension` |
//! | arm, tension, hold at 100 Hz | `hold` |
//! | ramp down and disarm | `disarm` |
//! | figures, faults, losses | `outcome` |
//! | whether the run did what was commanded | `quality` |
//! | progress for the user | `phase` |
//!
//! [`set_force`] is what the command `forcectl set-force` calls, and the bench and the scenarios as well: no
//! terminal, no files, one link. After any failure the rig is disarmed as far as the link allows. Setpoints expire on the
//! board in every case.

mod calibrate;
mod disarm;
mod hold;
mod outcome;
mod phase;
pub mod plot;
mod prepare;
mod quality;
mod ready;
mod tension;
#[cfg(test)]
mod tests;

pub use disarm::ramp_down_and_disarm;
use outcome::unit_fault;
pub use outcome::{describe_reach, Ended, LatencyMs, Outcome, RunFault};
use phase::configured;
pub use phase::{begin, connect};
pub use phase::{NoopObserver, Observer, Phase};
pub use prepare::{prepare_board, Prepared};
pub use quality::{Shortfall, ShortfallKind};
pub use ready::{ready_board, Zeroing};
pub use tension::{hold_tensions, HeldTensions, TensionOptions};

use emulator_link::Injection;
use force::controller::ControlError;
use force::feasibility;
use force::pose::{PoseError, PoseSource};
use hold::Hold;
use known::StoreError;
use nalgebra::Vector3;
use rig::{PoseChoice, RigFile};
use session::link::{LinkError, RigLink};
use session::{explain_crash_record, SessionError};
use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::sync::Arc;

/// How long the cables are tensioned before the robot moves, s.
const PRETENSION_S: f64 = 1.0;
/// How long the robot moves before the force is commanded, s: longer than its soft start.
const ROBOT_START_S: f64 = 1.5;
/// Longest run, s: a day.
const MAX_HOLD_S: f64 = 86_400.0;

/// What to do in a run.
#[derive(Debug, Clone)]
pub struct Options {
    /// Commanded force at the tip, robot base frame, N.
    pub commanded_n: Vector3<f64>,
    /// For how long it is held, s.
    pub hold_s: f64,
    /// Whether the robot of an emulated rig moves meanwhile.
    pub robot_moves: bool,
    /// What is injected and when, in seconds after the force is commanded (negative: before; what lies before the
    /// start happens at power-on). Emulated rig only.
    pub injections: Vec<(f64, Injection)>,
    /// Where the zeros come from.
    pub zeroing: Zeroing,
    /// Set from outside to end the run early; the rig is then disarmed as at the end.
    pub stop: Arc<AtomicBool>,
}

impl Options {
    /// Holds a force, N, for some seconds while the robot moves.
    #[must_use]
    pub fn new(commanded_n: impl Into<Vector3<f64>>, hold_s: f64) -> Self {
        Self {
            commanded_n: commanded_n.into(),
            hold_s,
            robot_moves: true,
            injections: Vec::new(),
            zeroing: Zeroing::default(),
            stop: Arc::default(),
        }
    }
}

/// Why a run could not be done. The rig was made safe as far as the link allowed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The commanded force or another argument is not usable; nothing was driven.
    #[error("{0}")]
    Argument(String),
    /// Session or link.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// No setpoints could be computed.
    #[error("stopped: {0}")]
    Control(#[from] ControlError),
    /// The robot's pose is not known.
    #[error("stopped: {0}")]
    Pose(#[from] PoseError),
    /// A fault of the board.
    #[error("{0}")]
    Fault(String),
    /// The rig file's cables cannot hold zero force; nothing was driven.
    #[error("{0}; nothing was driven")]
    Infeasible(String),
    /// Units dropped out and the others cannot hold zero force; the rig was ramped down.
    #[error("{0}")]
    UnitLost(String),
    /// What is known of the rig can't be read or kept.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Interrupted before the force was commanded.
    #[error("interrupted; the rig is disarmed")]
    Interrupted,
}

impl From<LinkError> for RunError {
    fn from(error: LinkError) -> Self {
        Self::Session(error.into())
    }
}

/// A run that ended early.
#[derive(Debug)]
pub struct Stopped {
    /// Why.
    pub error: RunError,
    /// Result until then; `None` where nothing had been armed.
    pub outcome: Option<Box<Outcome>>,
}

impl<E: Into<RunError>> From<E> for Stopped {
    fn from(error: E) -> Self {
        Self {
            error: error.into(),
            outcome: None,
        }
    }
}

/// Holds a force at the tip and returns the run's figures, faults and cycles.
///
/// # Errors
/// [`RunError`]; the rig was made safe as far as the link allowed.
pub fn set_force(
    link: &mut dyn RigLink,
    rig: &RigFile,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Outcome, RunError> {
    hold_force(link, rig, options, observer).map_err(|stopped| stopped.error)
}

/// As [`set_force`], with the result until then where the run ended early.
///
/// # Errors
/// [`Stopped`]; the rig was made safe as far as the link allowed.
pub fn hold_force(
    link: &mut dyn RigLink,
    rig: &RigFile,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Outcome, Stopped> {
    check_arguments(link, rig, options)?;
    require_feasible(rig)?;
    let pose = PoseSource::open(&rig.pose)?;
    let injections = inject_at_power_on(link, options)?;
    let mut session = connect(link, observer)?;
    if rig.pose == PoseChoice::Rig && session.pose().is_none() {
        return Err(PoseError::NotFromLink.into());
    }
    if let Some(record) = session.info().and_then(|info| info.crash_record.as_ref()) {
        observer.notice(&format!(
            "the board's run before this one ended with {}",
            explain_crash_record(record)
        ));
    }
    let prepared = ready_board(&mut session, rig, &options.zeroing, &options.stop, observer)?;
    let mut hold = Hold::new(rig, options, observer, pose, injections, &prepared)?;
    let ended = hold.run(&mut session);
    let disarmed = match &ended {
        // The board is still driving as it should.
        Ok(_) | Err(RunError::UnitLost(_)) => {
            hold.observer.progress(Phase::Disarm, 0.0);
            ramp_down_and_disarm(&mut session)
        }
        Err(_) => {
            session.make_safe();
            Ok(())
        }
    };
    if disarmed.is_err() {
        session.make_safe();
    }
    match ended.and_then(|interrupted| disarmed.map(|()| interrupted).map_err(Into::into)) {
        Ok(interrupted) => Ok(hold.outcome(&mut session, &prepared, interrupted, None)?),
        Err(error) => {
            let why = error.to_string();
            let outcome = hold.was_armed().then(|| {
                hold.outcome(&mut session, &prepared, false, Some(&why))
                    .ok()
                    .map(Box::new)
            });
            Err(Stopped {
                error,
                outcome: outcome.flatten(),
            })
        }
    }
}

/// Checks that the enabled units of a rig file can hold zero force at every pose that it allows. Nothing may be armed
/// otherwise, except a single unit on a fixed hook.
///
/// # Errors
/// [`RunError::Infeasible`] with the reason.
pub fn require_feasible(rig: &RigFile) -> Result<(), RunError> {
    let enabled = rig.units.map(|unit| unit.enabled);
    let refusal = match feasibility::examine_zero(rig, &enabled) {
        Ok(found) => found.refusal(),
        Err(error) => Some(error.to_string()),
    };
    refusal.map_or(Ok(()), |why| Err(RunError::Infeasible(why)))
}

/// Checks the arguments of a run before anything is sent.
fn check_arguments(
    link: &mut dyn RigLink,
    rig: &RigFile,
    options: &Options,
) -> Result<(), RunError> {
    rig.check_force(options.commanded_n)
        .map_err(RunError::Argument)?;
    if !(options.hold_s.is_finite() && options.hold_s > 0.0 && options.hold_s <= MAX_HOLD_S) {
        return Err(RunError::Argument(format!(
            "a force can't be held for {} s; give 0.1 to {MAX_HOLD_S}",
            options.hold_s
        )));
    }
    if !options.injections.is_empty() && link.controls().is_none() {
        return Err(RunError::Argument(
            "nothing can be injected into a real rig; use --link embedded".to_owned(),
        ));
    }
    Ok(())
}

/// Injects what belongs before the start, and returns the rest by time.
fn inject_at_power_on(
    link: &mut dyn RigLink,
    options: &Options,
) -> Result<VecDeque<(f64, Injection)>, LinkError> {
    let mut injections = options.injections.clone();
    injections.sort_by(|a, b| a.0.total_cmp(&b.0));
    let early = injections.partition_point(|(t_s, _)| *t_s < -(PRETENSION_S + ROBOT_START_S));
    if let Some(controls) = link.controls() {
        for (_, injection) in injections.drain(..early) {
            controls.inject(injection)?;
        }
    }
    Ok(injections.into())
}
