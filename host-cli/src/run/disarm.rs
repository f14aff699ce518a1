//! The end of a run: tensions ramp down, then the board disarms.

use crate::session::{Session, SessionError};
use control::SystemState;
use std::time::Duration;
use wire::Command;

/// How long disarming may take.
const DISARM_TIMEOUT: Duration = Duration::from_secs(3);

/// Disarms the board, waits until the motors are at 0 V and stops the robot of an emulated rig.
///
/// # Errors
/// As [`Session::command`] and [`Session::wait_for`].
pub(crate) fn ramp_down_and_disarm(session: &mut Session<'_>) -> Result<(), SessionError> {
    session.command(&Command::Disarm)?;
    session.set_setpoints(None);
    session.wait_for(DISARM_TIMEOUT, "disarming", |status| {
        SystemState::from_u8(status.state).is_some_and(|state| !state.drives())
    })?;
    if let Some(controls) = session.link().controls() {
        controls.robot(false)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::fake::{FakeBoard, Mood};

    #[test]
    fn a_board_that_is_armed_ends_ready_and_one_that_is_not_stays_so() {
        let mut board = FakeBoard::new(Mood::Good);
        let mut session = Session::connect(&mut board).unwrap();
        ramp_down_and_disarm(&mut session).unwrap();
        session.advance(Duration::from_secs(2)).unwrap();
        session.command(&Command::Arm).unwrap();
        ramp_down_and_disarm(&mut session).unwrap();
        assert_eq!(board.system, SystemState::Ready);
        assert!(board.commands.contains(&Command::Arm));
    }
}
