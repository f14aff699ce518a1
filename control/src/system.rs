//! The state machine of the board as a pure function: state and conditions in, state and denial out
//! (thesis 3.6.2, SystemStateMachine).
//!
//! Policy (docs/architecture.md, "Faults: unit or board"): a fault of the board wins over
//! everything and takes all outputs to 0 V; it is left only by an explicit clear, which does not
//! arm. Arming needs every enabled unit ready. Disarming ramps down.

use crate::state::SystemState;

/// A command that requests another state. At most one per cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Request {
    /// No request.
    #[default]
    None,
    /// Let the motors act.
    Arm,
    /// Ramp down and go back to ready.
    Disarm,
    /// Average zeros.
    Zero,
}

/// What the board's next state depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Conditions {
    /// Initialisation is over.
    pub booted: bool,
    /// A fault of the board is latched ([`crate::faults::Latch`]).
    pub faulted: bool,
    /// The E-stop loop is closed.
    pub estop_closed: bool,
    /// An enabled unit is in [`crate::MotorState::BringUp`].
    pub any_bringing_up: bool,
    /// At least one unit is enabled, and every enabled one is ready (none offline or faulted).
    pub all_ready: bool,
    /// At least one unit is still able to pull (ready or running, without a fault).
    pub any_usable: bool,
    /// The requested averages are complete or refused.
    pub zero_done: bool,
    /// Every commanded cable force has come down to zero.
    pub ramp_done: bool,
    /// Request of this cycle.
    pub request: Request,
}

/// Why a request was not followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Denied {
    /// Not possible in the state the board is in.
    State,
    /// A fault of the board is latched.
    Faulted,
    /// An enabled unit isn't ready.
    UnitNotReady,
    /// The E-stop loop is open.
    EStopOpen,
}

/// Result of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// State from now on.
    pub state: SystemState,
    /// Why the request of this cycle was not followed, if it wasn't.
    pub denied: Option<Denied>,
}

/// The next state for these conditions.
#[must_use]
pub fn next(state: SystemState, on: Conditions) -> Transition {
    use SystemState::{Boot, BringUp, Fault, Ready, Running, Stopping, Zeroing};
    let stay = |state| Transition {
        state,
        denied: match on.request {
            Request::None => None,
            _ if on.faulted => Some(Denied::Faulted),
            _ => Some(Denied::State),
        },
    };
    let go = |state| Transition {
        state,
        denied: None,
    };
    if !on.booted {
        return stay(Boot);
    }
    if on.faulted {
        return stay(Fault);
    }
    let idle = if on.any_bringing_up { BringUp } else { Ready };
    match state {
        // Out of Fault only because the latch was cleared; a request in the same cycle is refused,
        // so that clearing never arms.
        Boot | Fault | BringUp => stay(idle),
        Ready if on.any_bringing_up => stay(BringUp),
        Ready => match on.request {
            Request::None | Request::Disarm => go(Ready),
            Request::Zero => go(Zeroing),
            Request::Arm => Transition {
                state: if on.all_ready && on.estop_closed {
                    Running
                } else {
                    Ready
                },
                denied: if !on.estop_closed {
                    Some(Denied::EStopOpen)
                } else if !on.all_ready {
                    Some(Denied::UnitNotReady)
                } else {
                    None
                },
            },
        },
        Zeroing if on.zero_done => stay(idle),
        // A zeroing ends by itself, within a second and with every motor at 0 V. One that somebody
        // else ends would leave the old zero to the program that asked for a new one.
        Zeroing => stay(Zeroing),
        Running => match on.request {
            Request::Disarm => go(Stopping),
            Request::Arm => go(Running),
            // No unit is left that could pull, so the board does not stay armed.
            Request::None if !on.any_usable => go(Stopping),
            Request::None => go(Running),
            Request::Zero => stay(Running),
        },
        Stopping => match on.request {
            Request::None | Request::Disarm if on.ramp_done => go(idle),
            Request::None | Request::Disarm => go(Stopping),
            _ if on.ramp_done => stay(idle),
            _ => stay(Stopping),
        },
    }
}
