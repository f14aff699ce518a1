//! The state machine of one unit as a pure function: state and conditions in, state and action out
//! (thesis 3.6.2, MotorStateMachine).
//!
//! The caller owns the latch ([`crate::faults::Latch`]) and passes `faulted` for as long as it
//! holds one. Clearing brings the unit up again from the start, because the state of its converter
//! is unknown after a fault. A unit runs only while the board is armed.

use crate::state::{MotorState, SystemState};

/// What a unit's next state depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Conditions {
    /// `UnitConfig::enabled`.
    pub enabled: bool,
    /// A fault of this unit is latched.
    pub faulted: bool,
    /// The converter has been brought up and its first sample is in.
    pub sensor_up: bool,
    /// State of the board in this cycle.
    pub system: SystemState,
}

/// What the caller does once, at the moment of a transition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Action {
    /// Nothing.
    #[default]
    None,
    /// Write 0 V now (the unit may have been driving) and start bringing the converter up.
    StartBringUp,
    /// Forget filter, integrator and direction: [`crate::unit::State::reset`].
    ResetController,
    /// Write 0 V now, don't wait for the next sample.
    ZeroOutput,
}

/// Result of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// State from now on.
    pub state: MotorState,
    /// What to do about it.
    pub action: Action,
}

/// The next state for these conditions, and the action of the transition.
#[must_use]
pub fn next(state: MotorState, on: Conditions) -> Transition {
    use MotorState::{BringUp, Faulted, Offline, Ready, Running, Stopping, Zeroing};
    let target = if !on.enabled {
        Offline
    } else if on.faulted {
        Faulted
    } else {
        match state {
            // A unit that was off or faulted starts from the beginning, and never in the middle of
            // a run.
            Offline | Faulted => {
                if on.system.drives() {
                    state
                } else {
                    BringUp
                }
            }
            // A unit that becomes ready during a run waits: only arming makes a unit run.
            BringUp if on.sensor_up && !on.system.drives() => Ready,
            BringUp => BringUp,
            // A converter that was lost without a fault (a recovery that starts over) leaves the
            // loop.
            Ready | Running | Zeroing | Stopping if !on.sensor_up => BringUp,
            Ready | Running | Zeroing | Stopping => match on.system {
                SystemState::Running if matches!(state, Stopping) => Stopping,
                SystemState::Running => Running,
                SystemState::Stopping if state.drives() => Stopping,
                SystemState::Zeroing => Zeroing,
                _ => Ready,
            },
        }
    };
    let action = if target == state {
        Action::None
    } else {
        match target {
            BringUp => Action::StartBringUp,
            Running => Action::ResetController,
            _ if state.drives() && !target.drives() => Action::ZeroOutput,
            _ => Action::None,
        }
    };
    Transition {
        state: target,
        action,
    }
}
