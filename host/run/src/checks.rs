//! What has to be true before anything is driven.

use crate::error::{ArgumentError, Fault, Infeasible, RunError};
use crate::options::{Options, MAX_HOLD_S, MIN_HOLD_S};
use crate::phase::Observer;
use force::feasibility;
use force::pose::PoseSource;
use nalgebra::Vector3;
use rig::Rig;
use session::link::RigLink;
use session::{Session, PERIOD};
use std::sync::atomic::{AtomicBool, Ordering};
use wire::UNITS;

/// Checks that the enabled units of a rig file can hold zero force at every pose that it allows.
/// Nothing may be armed otherwise, except a single unit on a fixed hook.
///
/// # Errors
/// [`RunError::Infeasible`] with the reason.
pub fn require_feasible(rig: &Rig) -> Result<(), RunError> {
    let enabled = rig.units.map(|unit| unit.enabled);
    let refusal = match feasibility::examine_zero(rig, &enabled) {
        Ok(found) => found.refusal().map(Infeasible::OutOfReach),
        Err(error) => Some(Infeasible::Unknown(error)),
    };
    refusal.map_or(Ok(()), |why| Err(why.into()))
}

/// Checks the arguments of a run before anything is sent.
pub(super) fn check_arguments(
    link: &mut dyn RigLink,
    rig: &Rig,
    options: &Options,
) -> Result<(), RunError> {
    rig.check_force(options.commanded_n)
        .map_err(ArgumentError::Force)?;
    if !(MIN_HOLD_S..=MAX_HOLD_S).contains(&options.hold_s) {
        return Err(ArgumentError::Duration(options.hold_s).into());
    }
    if !options.injections.is_empty() && link.controls().is_none() {
        return Err(ArgumentError::NotInjectable.into());
    }
    Ok(())
}

/// Checks that the units that came up can hold zero force at a tip, m.
///
/// # Errors
/// [`Fault::ZeroOutOfReach`], or the tip is outside the workspace.
pub(super) fn require_zero_at(
    rig: &Rig,
    tip_m: Vector3<f64>,
    available: &[bool; UNITS],
) -> Result<(), RunError> {
    match feasibility::residual_at(rig, tip_m, available)? {
        None => Ok(()),
        Some(residual_n) => Err(Fault::ZeroOutOfReach { residual_n }.into()),
    }
}

/// An error where the run was interrupted from outside.
pub(super) fn check_stop(stop: &AtomicBool) -> Result<(), RunError> {
    if stop.load(Ordering::Relaxed) {
        Err(RunError::Interrupted)
    } else {
        Ok(())
    }
}

/// Tells what the poses gave to tell since the last call.
pub fn tell_of(pose: &mut PoseSource, observer: &mut dyn Observer) {
    let told = pose.notices();
    told.iter().for_each(|text| observer.notice(text));
}

/// The tip by a pose that is received from now on, robot base frame, m.
///
/// # Errors
/// None comes, or the run was interrupted.
pub fn fresh_pose(
    session: &mut Session<'_>,
    pose: &mut PoseSource,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Vector3<f64>, RunError> {
    pose.discard();
    loop {
        session.exchange(PERIOD)?;
        observer.received(&session.drain());
        check_stop(stop)?;
        let tip_m = pose.tip_m(session.pose().map(|pose| pose.position_m.into()));
        tell_of(pose, observer);
        match tip_m {
            Ok(tip_m) => return Ok(tip_m),
            Err(_) if pose.may_still_come() => {}
            Err(error) => return Err(error.into()),
        }
    }
}
