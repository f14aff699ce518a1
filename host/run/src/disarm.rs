//! The end of a run: tensions ramp down, then the board disarms.

use crate::friction::tell_of_friction;
use crate::phase::Observer;
use control::SystemState;
use rig::Rig;
use session::{system_state_name, LatchedFault, Patience, Session, SessionError, PERIOD};
use std::time::Duration;
use wire::{Command, UNITS};

/// How long disarming may take.
const DISARM_TIMEOUT: Duration = Duration::from_secs(3);
/// Time at 0 V after which a fault of the ramp-down is known: the board's watch over 0 V takes 75
/// ms ([`control::let_go`]) from the end of the DAC's and the filter's delay, a converter that is
/// silent 50 ms, a status 10 ms.
const WATCHED: Duration = Duration::from_millis(250);

/// Disarms the board, waits until the motors are at 0 V and it is known that they let go, and stops
/// the robot of an emulated rig. A fault of a unit that was `available` until now is an error as
/// one of the board is: a motor that still pulls shows only after 0 V.
///
/// The status is asked for in each cycle: a rig's service in lock-step lets no time pass for a
/// commander that is silent while the newest status says that the board is running.
///
/// # Errors
/// As [`Session::command`]; the board latches a fault, or it is not disarmed after 3 s.
pub fn ramp_down_and_disarm(
    session: &mut Session<'_>,
    available: &[bool; UNITS],
) -> Result<(), SessionError> {
    disarm(session)?;
    let until_ns = session.now_ns() + WATCHED.as_nanos() as u64;
    loop {
        if let Some(fault) = LatchedFault::first_of(&session.get_status()?, available) {
            return Err(SessionError::Fault(fault));
        }
        if session.now_ns() >= until_ns {
            return Ok(());
        }
        session.exchange(PERIOD)?;
    }
}

/// The same without the watch: a load hangs on the cables.
pub(crate) fn disarm(session: &mut Session<'_>) -> Result<(), SessionError> {
    session.command(&Command::Disarm)?;
    session.set_setpoints(None);
    let mut patience = Patience::new(DISARM_TIMEOUT, session.now_ns());
    loop {
        let status = session.get_status()?;
        if SystemState::from_u8(status.state).is_some_and(|state| !state.drives()) {
            if status.fault != 0 {
                return Err(SessionError::Fault(LatchedFault::of_board(&status)));
            }
            break;
        }
        if patience.is_over(session.now_ns(), Some(status.t_us)) {
            return Err(SessionError::TooLong(format!(
                "disarming is not over after {} s (state `{}`); see `forcectl status`",
                DISARM_TIMEOUT.as_secs(),
                system_state_name(status.state)
            )));
        }
        session.exchange(PERIOD)?;
    }
    if let Some(controls) = session.link().controls() {
        controls.robot(false)?;
    }
    Ok(())
}

/// Sets the motors to 0 V as far as the link allows, behind an error, and says what a fault 15 may
/// be.
pub fn make_safe(session: &mut Session<'_>, rig: &Rig, observer: &mut dyn Observer) {
    session.make_safe();
    tell_of_friction(session, rig, observer);
}

#[cfg(test)]
mod tests {
    use super::*;
    use control::Fault;
    use session::link::fake::{Behavior, FakeBoard};

    #[test]
    fn a_board_that_is_armed_ends_ready_and_one_that_is_not_stays_so() {
        let mut board = FakeBoard::new(Behavior::Good);
        let mut session = Session::connect(&mut board).unwrap();
        let all = [true; UNITS];
        ramp_down_and_disarm(&mut session, &all).unwrap();
        session.exchange(Duration::from_secs(2)).unwrap();
        session.command(&Command::Arm).unwrap();
        ramp_down_and_disarm(&mut session, &all).unwrap();
        assert_eq!(board.system, SystemState::Ready);
        assert!(board.commands.contains(&Command::Arm));
    }

    #[test]
    fn a_fault_of_a_unit_that_took_part_is_an_error_and_one_of_another_is_not() {
        for unit in 0..UNITS {
            let mut board = FakeBoard::new(Behavior::Good);
            board.unit_faults[unit] = Some((Fault::Implausible, 1));
            let mut session = Session::connect(&mut board).unwrap();
            let mut available = [true; UNITS];
            let error = ramp_down_and_disarm(&mut session, &available).unwrap_err();
            let words = format!("unit {}: fault 45", unit + 1);
            assert!(error.to_string().contains(&words), "{error}");
            available[unit] = false;
            ramp_down_and_disarm(&mut session, &available).unwrap();
        }
    }
}
