//! The clocks of a trial: link (ours), board and robot.
//!
//! The virtual arm lives on the board's clock, and in the fast rig that is the link's as well. For
//! a robot outside, both offsets are estimated by `session::clock`: the board's from requests and
//! replies, the robot's from the arrival of its states.

use robot::state::RobotState;
use session::clock::{BoardClock, Estimate, OneWayClock, Reading};

/// Resolution of the board's time stamps, s: all that is between two ends of one virtual clock.
const BOARD_TICK_S: f64 = 1e-6;
/// What the fastest state of a second takes from its stamp to its arrival, s: a period of the
/// robot's publisher (1 ms) and its way through the operating systems.
const LEAST_DELAY_S: f64 = 0.002;
/// Time between two estimates of the board's clock, ns.
const ESTIMATE_NS: u64 = 250_000_000;

/// When a state was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct When {
    /// Link time, s.
    pub link_s: f64,
    /// Board time, s.
    pub board_s: f64,
    /// Uncertainty of the time between robot and board, s.
    pub error_s: f64,
}

/// See the module's page.
#[derive(Debug)]
pub(super) struct Clocks {
    /// Whether robot, board and link have one virtual clock.
    shared: bool,
    board: BoardClock,
    board_now: Option<Estimate>,
    board_due_ns: u64,
    robot: OneWayClock,
    robot_now: Option<Estimate>,
}

impl Clocks {
    /// Of a robot on the board's own clock (`shared`), or of one outside.
    pub fn new(shared: bool) -> Self {
        Self {
            shared,
            board: BoardClock::live(),
            board_now: None,
            board_due_ns: 0,
            robot: OneWayClock::new(LEAST_DELAY_S),
            robot_now: None,
        }
    }

    /// Whether robot, board and link have one virtual clock.
    pub const fn shared(&self) -> bool {
        self.shared
    }

    /// Readings of the board's clock.
    pub fn board(&mut self, readings: &[Reading]) {
        if self.shared {
            return;
        }
        for reading in readings {
            self.board.push(reading);
            if reading.received_ns >= self.board_due_ns {
                self.board_due_ns = reading.received_ns + ESTIMATE_NS;
                self.board_now = self.board.at(reading.board_us);
            }
        }
    }

    /// A state of the robot that arrived by `now_ns` of the link.
    pub fn robot(&mut self, state: &RobotState, now_ns: u64) {
        if self.shared {
            return;
        }
        let sent_us = stamp_us(state);
        let arrived_ns = (state.received.as_ref())
            .and_then(|stamp| u64::try_from(stamp.t_ns).ok())
            .unwrap_or(now_ns);
        if self.robot.push(sent_us, arrived_ns) || self.robot_now.is_none() {
            self.robot_now = self.robot.at(sent_us);
        }
    }

    /// When a state was, where the clocks are known.
    pub fn when(&self, state: &RobotState) -> Option<When> {
        let stamp_s = state.stamp.t_ns as f64 * 1e-9;
        if self.shared {
            return Some(When {
                link_s: stamp_s,
                board_s: stamp_s,
                error_s: BOARD_TICK_S,
            });
        }
        let (robot, board) = (self.robot_now?, self.board_now?);
        let link_ns = robot.host_ns(stamp_us(state));
        Some(When {
            link_s: link_ns * 1e-9,
            board_s: board.board_us(link_ns) * 1e-6,
            error_s: (robot.uncertainty_ns + board.uncertainty_ns) * 1e-9,
        })
    }

    /// Link time as board time, s.
    pub fn board_s(&self, link_s: f64) -> f64 {
        match self.board_now {
            Some(estimate) if !self.shared => estimate.board_us(link_s * 1e9) * 1e-6,
            _ => link_s,
        }
    }
}

fn stamp_us(state: &RobotState) -> u64 {
    u64::try_from(state.stamp.t_ns / 1000).unwrap_or(0)
}
