//! From a connected board to one that is configured, zeroed, calibrated and still disarmed: with
//! zeros measured now, or with those that it holds already.
//!
//! Units that fail during this are switched off and reported, so that the others can be armed.
//!
//! A zero is true only while the cables are slack. On a rig that stays powered, friction keeps 0.7
//! to 1.0 N in a cable after a run; a zero taken then would make every later force wrong by that
//! much. So a zero is measured at power-on of an emulated rig and when the user asks for it, and a
//! run keeps what is there. A measured zero far from the last one is refused
//! ([`known::zeros::ZERO_TOLERANCE_N`]): a cable that pulls looks like a zero that moved.

mod prepared;
#[cfg(test)]
mod tests;
mod zeros;

pub use prepared::Prepared;

use crate::calibrate;
use crate::checks::check_stop;
use crate::error::{ArgumentError, Fault, RunError};
use crate::fault::RunFault;
use crate::options::{Zeroing, PRETENSION_S, ROBOT_START_S};
use crate::phase::{begin, tell_configs, Observer, Phase};
use control::{MotorState, SystemState};
use known::zeros::ZeroStore;
use rig::Rig;
use session::{system_state_name, LatchedFault, Patience, Session, SessionError, PERIOD};
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use wire::message::{Status, UnitConfig};
use wire::{Command, UNITS};
use zeros::{carried_over, far, references, References};

/// How long sensors may take to come up: three calibrations of 344 ms each, six units on one bus,
/// and retries.
const BRING_UP_TIMEOUT: Duration = Duration::from_secs(15);
/// How long zeroing may take: 256 samples at 310 SPS are 0.83 s.
const ZERO_TIMEOUT: Duration = Duration::from_secs(5);
/// How long zeroing goes on at most after its command.
const ZERO_END: Duration = Duration::from_secs(5);

/// Makes a board ready: configured, with zeros, disarmed.
///
/// # Errors
/// [`RunError`]; nothing was armed, and zeros that were refused are not in force.
pub fn ready_board(
    session: &mut Session<'_>,
    rig: &Rig,
    zeroing: &Zeroing,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let (store, replace) = match zeroing {
        Zeroing::Measure => return at_power_on(session, rig, stop, observer),
        Zeroing::Keep(store) => return keep(session, rig, store, stop, observer),
        Zeroing::Ask(store) => (store, false),
        Zeroing::Replace(store) => (store, true),
    };
    let before = session.get_configs()?;
    let references = if replace {
        References::Replaced
    } else {
        References::Stored(references(store, &before)?)
    };
    measure(session, rig, &before, &references, store, stop, observer)
}

/// Measures the zeros, whatever they are.
fn at_power_on(
    session: &mut Session<'_>,
    rig: &Rig,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let mut configs = rig.units.map(|unit| unit.to_wire());
    let mut faults = bring_up(session, rig, &mut configs, stop, observer)?;
    faults.extend(zero(session, &mut configs, stop, observer)?);
    calibrate::calibrate(session, rig, &mut configs, observer)?;
    Prepared::verified(session, configs, faults, observer)
}

/// Uses the zeros that the board holds.
fn keep(
    session: &mut Session<'_>,
    rig: &Rig,
    store: &ZeroStore,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    check_idle(&session.get_status()?)?;
    let in_force = session.get_configs()?;
    let wanted = carried_over(session, rig, &in_force);
    let complete = wanted
        .iter()
        .all(|config| !config.enabled || config.zero_code != 0);
    if !complete {
        let stored = store.references()?;
        if stored.is_empty() {
            let lacks = wanted.map(|config| config.enabled && config.zero_code == 0);
            return Err(ArgumentError::NoZero {
                rig: rig.name.clone(),
                units: (1..)
                    .zip(lacks)
                    .filter_map(|(n, lacks)| lacks.then_some(n))
                    .collect(),
            }
            .into());
        }
        observer.notice("the board was powered up since its last zero: zeros are measured and compared with the stored ones");
        return measure(
            session,
            rig,
            &in_force,
            &References::Stored(stored),
            store,
            stop,
            observer,
        );
    }
    let wrong = far(&wanted, &store.references()?);
    if !wrong.is_empty() {
        return Err(Fault::ZerosNotStored(wrong).into());
    }
    let mut configs = wanted;
    let same = wanted == in_force && session.get_board()? == rig.controller.board_config();
    let faults = if same {
        // Nothing is sent that would start the sensors anew.
        observer.configured(&in_force);
        session.command(&Command::Stream { decimation: 1 })?;
        let status = wait_ready(session, BRING_UP_TIMEOUT, Phase::BringUp, stop, observer)?;
        leave_out_faulted(session, &mut configs, &status, observer)?
    } else {
        bring_up(session, rig, &mut configs, stop, observer)?
    };
    Prepared::verified(session, configs, faults, observer)
}

/// Measures zeros. Where they disagree with the references, the board gets `before` back.
fn measure(
    session: &mut Session<'_>,
    rig: &Rig,
    before: &[UnitConfig; UNITS],
    references: &References,
    store: &ZeroStore,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let mut configs = carried_over(session, rig, before);
    let mut faults = bring_up(session, rig, &mut configs, stop, observer)?;
    match zero(session, &mut configs, stop, observer) {
        Ok(found) => faults.extend(found),
        Err(error) => {
            // The board may have finished by itself: zeros that nobody has compared must not stay
            // in force.
            let _ = session.wait_for(ZERO_END, "zeroing", |status| {
                status.state == SystemState::Ready as u8
            });
            let _ = session.configure(before);
            return Err(error);
        }
    }
    let (wrong, accepted) = match references {
        References::Replaced => (Vec::new(), true),
        References::Stored(stored) => (far(&configs, stored), false),
    };
    if !wrong.is_empty() {
        session.configure(before)?;
        return Err(Fault::ZerosRefused(wrong).into());
    }
    let prepared = Prepared::verified(session, configs, faults, observer)?;
    store.add(&rig.name, &configs, accepted)?;
    Ok(prepared)
}

/// Configures an idle board and waits until its units have come up. Those that fail are switched
/// off in `configs`; their faults are returned.
fn bring_up(
    session: &mut Session<'_>,
    rig: &Rig,
    configs: &mut [UnitConfig; UNITS],
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Vec<RunFault>, RunError> {
    check_idle(&session.get_status()?)?;
    let before = session.get_configs()?;
    // What has arrived until now belongs to it too.
    observer.configured(&before);
    session.command(&Command::Stream { decimation: 1 })?;
    begin(session, observer, Phase::Configure);
    session.stage_board(rig.controller.board_config())?;
    session.configure(configs)?;
    tell_configs(session, observer, configs);
    check_stop(stop)?;
    begin(session, observer, Phase::BringUp);
    let status = wait_ready(session, BRING_UP_TIMEOUT, Phase::BringUp, stop, observer)?;
    leave_out_faulted(session, configs, &status, observer)
}

/// An error where the board is armed or a fault is latched.
fn check_idle(status: &Status) -> Result<(), RunError> {
    if SystemState::from_u8(status.state).is_some_and(SystemState::drives) {
        return Err(Fault::Armed.into());
    }
    if status.fault != 0 {
        return Err(Fault::LatchedBefore(LatchedFault::of_board(status)).into());
    }
    Ok(())
}

/// Takes the zeros of all enabled units and puts them into `configs`; returns the faults of units
/// that failed.
fn zero(
    session: &mut Session<'_>,
    configs: &mut [UnitConfig; UNITS],
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Vec<RunFault>, RunError> {
    begin(session, observer, Phase::Zero);
    let units = (0..UNITS)
        .filter(|i| configs[*i].enabled)
        .fold(0, |mask, i| mask | 1 << i);
    if units == 0 {
        return Err(Fault::NoUnit.into());
    }
    session.command(&Command::Zero { units })?;
    let status = wait_ready(session, ZERO_TIMEOUT, Phase::Zero, stop, observer)?;
    for (config, in_force) in configs.iter_mut().zip(session.get_configs()?) {
        config.zero_code = in_force.zero_code;
    }
    tell_configs(session, observer, configs);
    leave_out_faulted(session, configs, &status, observer)
}

/// Switches units that faulted off in the configuration, so that the others can be armed; returns
/// their faults.
fn leave_out_faulted(
    session: &mut Session<'_>,
    configs: &mut [UnitConfig; UNITS],
    status: &Status,
    observer: &mut dyn Observer,
) -> Result<Vec<RunFault>, RunError> {
    let mut faults = Vec::new();
    for (i, unit) in status.units.iter().enumerate() {
        let faulted =
            unit.fault != 0 || MotorState::from_u8(unit.state) == Some(MotorState::Faulted);
        if configs[i].enabled && faulted {
            let fault = RunFault::of_unit(
                -(PRETENSION_S + ROBOT_START_S),
                i,
                unit.fault,
                unit.fault_detail,
            );
            observer.notice(&format!("unit {} is left out: {}", i + 1, fault.text));
            faults.push(fault);
            configs[i].enabled = false;
        }
    }
    if !faults.is_empty() {
        session.configure(configs)?;
        tell_configs(session, observer, configs);
        session.wait_for(BRING_UP_TIMEOUT, "the amplifiers' power", |status| {
            !waits_for_power(status)
        })?;
    }
    Ok(faults)
}

/// Whether the board is about to give the amplifiers their power: every unit that is used has come
/// up, and it watches them for a moment. Until then it refuses to arm.
fn waits_for_power(status: &Status) -> bool {
    let ready = |number| MotorState::from_u8(number) == Some(MotorState::Ready);
    status.alive_withheld
        && status.units.iter().all(|unit| unit.fault == 0)
        && status.units.iter().any(|unit| ready(unit.state))
}

/// Waits until the board is ready: every unit has come up, or failed.
fn wait_ready(
    session: &mut Session<'_>,
    timeout: Duration,
    phase: Phase,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Status, RunError> {
    let start = session.now_ns();
    let mut patience = Patience::new(timeout, start);
    // A status that was on its way before the command took effect must not count.
    session.exchange(PERIOD)?;
    loop {
        check_stop(stop)?;
        session.exchange(PERIOD)?;
        let status = session.get_status()?;
        observer.received(&session.drain());
        if status.fault != 0 {
            return Err(Fault::from(LatchedFault::of_board(&status)).into());
        }
        if status.state == SystemState::Ready as u8 && !waits_for_power(&status) {
            observer.progress(phase, 1.0);
            return Ok(status);
        }
        let waited = Duration::from_nanos(session.now_ns() - start);
        if patience.is_over(session.now_ns(), Some(status.t_us)) {
            return Err(SessionError::TooLong(format!(
                "{} is not over after {} s (state `{}`); see `forcectl status`",
                phase.describe(),
                timeout.as_secs(),
                system_state_name(status.state)
            ))
            .into());
        }
        observer.progress(phase, (waited.as_secs_f64() / 2.0).min(0.99));
    }
}
