//! A force at the tip, from the first argument to the last figure.

use crate::checks::{check_arguments, require_feasible};
use crate::disarm::{disarm, ramp_down_and_disarm};
use crate::error::RunError;
use crate::friction::tell_of_friction;
use crate::hold::Hold;
use crate::options::{Options, PRETENSION_S, ROBOT_START_S};
use crate::outcome::Outcome;
use crate::phase::{connect, Observer, Phase};
use crate::ready::ready_board;
use emulator_link::Injection;
use force::pose::{PoseError, PoseSource};
use rig::{PoseChoice, Rig};
use session::explain_crash_record;
use session::link::{LinkError, RigLink};
use std::collections::VecDeque;

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
    rig: &Rig,
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
    rig: &Rig,
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
    let mut hold = Hold::new(rig, options, &mut *observer, pose, injections, &prepared)?;
    let ended = (hold.run(&mut session)).map_err(|error| error.with_who(session.link()));
    let disarmed = match &ended {
        // The board is still driving as it should.
        Ok(_) | Err(RunError::UnitLost(_)) => {
            hold.observer.progress(Phase::Disarm, 0.0);
            if options.loaded {
                disarm(&mut session)
            } else {
                ramp_down_and_disarm(&mut session, hold.available())
            }
        }
        Err(_) => Ok(()),
    };
    match ended.and_then(|interrupted| disarmed.map(|()| interrupted).map_err(Into::into)) {
        Ok(interrupted) => Ok(hold.outcome(&mut session, &prepared, interrupted, None)?),
        Err(error) => {
            session.make_safe();
            let why = error.to_string();
            let outcome = hold.was_armed().then(|| {
                hold.outcome(&mut session, &prepared, false, Some(&why))
                    .ok()
                    .map(Box::new)
            });
            tell_of_friction(&mut session, rig, observer);
            Err(Stopped {
                error,
                outcome: outcome.flatten(),
            })
        }
    }
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
