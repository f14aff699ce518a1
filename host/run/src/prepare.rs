//! From a connected board to one that is configured, zeroed, calibrated and still disarmed.
//!
//! Units that fail during this are switched off and reported, so that the others can be armed. The configuration is
//! read back at the end: nothing is armed with another one than was sent.

use super::{
    begin, calibrate, configured, unit_fault, Observer, Phase, RunError, RunFault, PRETENSION_S,
    ROBOT_START_S,
};
use control::{MotorState, SystemState};
use rig::{board_crc, RigFile};
use session::link::{LinkError, RigLink};
use session::{explain_fault, system_state_name, Patience, Session, SessionError, PERIOD};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use wire::message::{Status, UnitConfig};
use wire::{Command, UNITS};

/// How long sensors may take to come up: three calibrations of 344 ms each, six units on one bus, and retries.
pub(super) const BRING_UP_TIMEOUT: Duration = Duration::from_secs(15);
/// How long zeroing may take: 256 samples at 310 SPS are 0.83 s.
const ZERO_TIMEOUT: Duration = Duration::from_secs(5);

/// A board that is configured, zeroed and disarmed.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The configurations in force, zeros included.
    pub configs: [UnitConfig; UNITS],
    /// CRC-32 of them, as the board reports it.
    pub config_crc: u32,
    /// Units that take part.
    pub available: [bool; UNITS],
    /// Faults of the units that don't.
    pub faults: Vec<RunFault>,
    /// Conversions that each unit had missed until then, by the board's own count.
    pub(super) missed_before: [u32; UNITS],
    /// Conversions that had stayed unread until then, by the embedded rig's count; 0 on a real rig.
    pub(super) lost_before: u64,
}

/// An error where the run was interrupted from outside.
pub(super) fn check_stop(stop: &AtomicBool) -> Result<(), RunError> {
    if stop.load(Ordering::Relaxed) {
        Err(RunError::Interrupted)
    } else {
        Ok(())
    }
}

/// Takes a connected board to one that is configured, zeroed and disarmed. Units that fail on the way are
/// switched off and reported.
///
/// # Errors
/// [`RunError`]; nothing was armed.
pub fn prepare_board(
    session: &mut Session<'_>,
    rig: &RigFile,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let mut configs = rig.units.map(|unit| unit.to_wire());
    let mut faults = bring_up(session, rig, &mut configs, stop, observer)?;
    faults.extend(zero(session, &mut configs, stop, observer)?);
    calibrate::calibrate(session, rig, &mut configs, observer)?;
    Prepared::verified(session, configs, faults, observer)
}

/// Configures an idle board and waits until its units have come up. Those that fail are switched off in `configs`; their faults are
/// returned.
pub(super) fn bring_up(
    session: &mut Session<'_>,
    rig: &RigFile,
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
    configured(session, observer, configs);
    check_stop(stop)?;
    begin(session, observer, Phase::BringUp);
    let status = wait_ready(session, BRING_UP_TIMEOUT, Phase::BringUp, stop, observer)?;
    leave_out_faulted(session, configs, &status, observer)
}

impl Prepared {
    /// Reads the configuration back and takes note of what is known of a board that is ready.
    ///
    /// # Errors
    /// The board holds another configuration, or no unit takes part.
    pub(super) fn verified(
        session: &mut Session<'_>,
        configs: [UnitConfig; UNITS],
        faults: Vec<RunFault>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RunError> {
        let (status, config_crc) = verify(session, &configs)?;
        configured(session, observer, &configs);
        let available = configs.map(|config| config.enabled);
        if !available.contains(&true) {
            return Err(RunError::Fault(
                "no force unit is ready; see `forcectl status`".to_owned(),
            ));
        }
        Ok(Self {
            configs,
            config_crc,
            available,
            faults,
            missed_before: status.units.map(|unit| unit.missed),
            lost_before: conversions_lost(session.link())?,
        })
    }
}

/// An error where the board is armed or a fault is latched.
pub(super) fn check_idle(status: &Status) -> Result<(), RunError> {
    if SystemState::from_u8(status.state).is_some_and(SystemState::drives) {
        return Err(RunError::Fault(
            "the board is armed already; `forcectl disarm` first (and end the program that armed it)".to_owned(),
        ));
    }
    if status.fault != 0 {
        return Err(RunError::Fault(format!(
            "a fault is latched: {}; then `forcectl clear`",
            explain_fault(status.fault, status.fault_detail)
        )));
    }
    Ok(())
}

/// Takes the zeros of all enabled units and puts them into `configs`; returns the faults of units that failed.
pub(super) fn zero(
    session: &mut Session<'_>,
    configs: &mut [UnitConfig; UNITS],
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Vec<RunFault>, RunError> {
    begin(session, observer, Phase::Zero);
    let units = (0..UNITS)
        .filter(|i| configs[*i].enabled)
        .fold(0, |mask, i| mask | 1 << i);
    session.command(&Command::Zero { units })?;
    let status = wait_ready(session, ZERO_TIMEOUT, Phase::Zero, stop, observer)?;
    for (config, in_force) in configs.iter_mut().zip(session.get_configs()?) {
        config.zero_code = in_force.zero_code;
    }
    super::configured(session, observer, configs);
    leave_out_faulted(session, configs, &status, observer)
}

/// Reads the configuration back. Returns the board's status and the configuration's CRC-32.
fn verify(
    session: &mut Session<'_>,
    configs: &[UnitConfig; UNITS],
) -> Result<(Status, u32), RunError> {
    let in_force = session.get_configs()?;
    if in_force != *configs {
        return Err(RunError::Fault(format!(
            "the board reads back another configuration than was sent ({}); nothing was armed; check the link and try again",
            differences(configs, &in_force).join(", ")
        )));
    }
    let status = session.get_status()?;
    let config_crc = board_crc(&in_force);
    if status.config_crc != config_crc {
        return Err(RunError::Fault(format!(
            "the board's configuration has CRC {:08x}, what it reads back {config_crc:08x}; nothing was armed; power-cycle the board and try again",
            status.config_crc
        )));
    }
    Ok((status, config_crc))
}

/// What differs between the configurations sent and those read back, in words.
fn differences(sent: &[UnitConfig; UNITS], back: &[UnitConfig; UNITS]) -> Vec<String> {
    let fields = |config: &UnitConfig| match serde_json::to_value(config) {
        Ok(serde_json::Value::Object(fields)) => fields,
        _ => serde_json::Map::new(),
    };
    let mut found = Vec::new();
    for (i, (sent, back)) in sent.iter().zip(back).enumerate() {
        let back = fields(back);
        for (name, value) in fields(sent) {
            if let Some(other) = back.get(&name).filter(|other| **other != value) {
                found.push(format!("unit {}: {name} {value} became {other}", i + 1));
            }
        }
    }
    found
}

/// Conversions that the embedded rig saw unread so far; 0 on a real rig.
fn conversions_lost(link: &mut dyn RigLink) -> Result<u64, LinkError> {
    let Some(controls) = link.controls() else {
        return Ok(0);
    };
    let report = controls.report()?;
    let lost = report
        .conversions
        .iter()
        .zip(report.conversions_read)
        .map(|(all, read)| all.saturating_sub(read));
    Ok(lost.sum())
}

/// Switches units that faulted off in the configuration, so that the others can be armed; returns their faults.
pub(super) fn leave_out_faulted(
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
            let fault = unit_fault(
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
        configured(session, observer, configs);
    }
    Ok(faults)
}

/// Waits until the board is ready: every unit has come up, or failed.
pub(super) fn wait_ready(
    session: &mut Session<'_>,
    timeout: Duration,
    phase: Phase,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Status, RunError> {
    let start = session.now_ns();
    let mut patience = Patience::new(timeout, start);
    // A status that was on its way before the command took effect must not count.
    session.advance(PERIOD)?;
    loop {
        check_stop(stop)?;
        session.advance(PERIOD)?;
        let status = session.get_status()?;
        observer.received(&session.drain());
        if status.fault != 0 {
            return Err(RunError::Fault(explain_fault(
                status.fault,
                status.fault_detail,
            )));
        }
        if status.state == SystemState::Ready as u8 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoopObserver;
    use session::link::fake::{Behavior, FakeBoard};

    #[test]
    fn a_prepared_board_holds_the_configuration_and_is_disarmed() {
        let rig = RigFile::built_in().unwrap();
        let mut board = FakeBoard::new(Behavior::Good);
        let mut session = Session::connect(&mut board).unwrap();
        let stop = AtomicBool::new(false);
        let prepared = prepare_board(&mut session, &rig, &stop, &mut NoopObserver).unwrap();
        assert_eq!(prepared.available, [true; UNITS]);
        assert_eq!(prepared.config_crc, board_crc(&prepared.configs));
        assert_eq!(session.get_configs().unwrap(), prepared.configs);
        assert!(prepared.configs.iter().all(|config| config.zero_code != 0));
        assert_eq!(board.system, SystemState::Ready);
        assert!(!board.commands.contains(&Command::Arm));
    }

    #[test]
    fn a_board_that_is_armed_or_faulted_is_left_as_it_is() {
        let rig = RigFile::built_in().unwrap();
        let stop = AtomicBool::new(false);
        for (command, words) in [
            (Command::Arm, "armed already"),
            (Command::Stop, "a fault is latched"),
        ] {
            let mut board = FakeBoard::new(Behavior::Good);
            let mut session = Session::connect(&mut board).unwrap();
            session.advance(Duration::from_secs(2)).unwrap();
            session.command(&command).unwrap();
            let error = prepare_board(&mut session, &rig, &stop, &mut NoopObserver).unwrap_err();
            assert!(error.to_string().contains(words), "{error}");
            assert!(!board.commands.contains(&Command::CommitConfig));
        }
    }

    #[test]
    fn a_configuration_that_differs_is_named_by_unit_and_field() {
        let sent = RigFile::built_in()
            .unwrap()
            .units
            .map(|unit| unit.to_wire());
        assert!(differences(&sent, &sent).is_empty());
        let mut back = sent;
        back[2].kp_q16 += 1;
        let found = differences(&sent, &back);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].starts_with("unit 3: kp_q16 "), "{found:?}");
    }
}
