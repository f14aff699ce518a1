//! The end of a run: tensions ramp down, then the board disarms.

use control::SystemState;
use session::{system_state_name, LatchedFault, Patience, Session, SessionError, PERIOD};
use std::time::Duration;
use wire::Command;

/// How long disarming may take.
const DISARM_TIMEOUT: Duration = Duration::from_secs(3);

/// Disarms the board, waits until the motors are at 0 V and stops the robot of an emulated rig.
///
/// The status is asked for in each cycle: a rig's service in lock-step lets no time pass for a
/// commander that is silent while the newest status says that the board is running.
///
/// # Errors
/// As [`Session::command`]; the board latches a fault, or it is not disarmed after 3 s.
pub fn ramp_down_and_disarm(session: &mut Session<'_>) -> Result<(), SessionError> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use session::link::fake::{Behavior, FakeBoard};

    #[test]
    fn a_board_that_is_armed_ends_ready_and_one_that_is_not_stays_so() {
        let mut board = FakeBoard::new(Behavior::Good);
        let mut session = Session::connect(&mut board).unwrap();
        ramp_down_and_disarm(&mut session).unwrap();
        session.exchange(Duration::from_secs(2)).unwrap();
        session.command(&Command::Arm).unwrap();
        ramp_down_and_disarm(&mut session).unwrap();
        assert_eq!(board.system, SystemState::Ready);
        assert!(board.commands.contains(&Command::Arm));
    }
}
