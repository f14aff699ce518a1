//! The watch on the truth: hazards, the first fault, and when what faulted was safe. The same for
//! the firmware's core on the plant ([`crate::case`]) and for the whole image in the embedded rig.

use crate::outcome::{Hazard, MOTION_M, PULL_MS, PULL_N, SLACK_MS, SLACK_N, TENSION_N};
use wire::UNITS;

/// A rig at one millisecond.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    /// The board drives motors.
    pub armed: bool,
    /// Units that run.
    pub running: [bool; UNITS],
    /// Units that ramp down.
    pub stopping: [bool; UNITS],
    /// Fault of the board; 0: none.
    pub board_fault: u16,
    /// Faults of the units; 0: none.
    pub unit_fault: [u16; UNITS],
    /// The amplifiers have power.
    pub power: bool,
    /// True tensions of the cables, N.
    pub tension_n: [f64; UNITS],
    /// What the motors pull with, N.
    pub pull_n: [f64; UNITS],
    /// Cable wound in since any time before, m.
    pub wound_m: [f64; UNITS],
}

impl View {
    /// A unit that runs has a slack cable.
    #[must_use]
    pub fn takes_up_slack(&self) -> bool {
        let slack = self.tension_n.map(|tension_n| tension_n < SLACK_N);
        self.armed
            && self
                .running
                .iter()
                .zip(slack)
                .any(|(running, slack)| *running && slack)
    }
}

/// See the [module](self).
#[derive(Debug, Clone, Default)]
pub struct Watch {
    slack_ms: [u32; UNITS],
    pull_ms: [u32; UNITS],
    began_m: [f64; UNITS],
    /// The cable has been tight since the unit began to run: an arming takes up what a robot has
    /// left slack.
    tight: [bool; UNITS],
    /// Hazards, each once with the millisecond at which it came.
    pub hazards: Vec<(Hazard, u32)>,
    /// The first fault; 0: none.
    pub fault: u16,
    /// When it was latched, in milliseconds.
    pub detected_ms: Option<u32>,
    /// When what faulted did not pull any more, in milliseconds.
    pub safe_ms: Option<u32>,
    /// Largest tension of any cable, N.
    pub tension_n: f64,
}

impl Watch {
    /// Begins with the reels as they are.
    #[must_use]
    pub fn new(wound_m: [f64; UNITS]) -> Self {
        Self {
            began_m: wound_m,
            tight: [true; UNITS],
            ..Self::default()
        }
    }

    fn hazard(&mut self, hazard: Hazard, ms: u32) {
        if self.hazards.iter().all(|(known, _)| *known != hazard) {
            self.hazards.push((hazard, ms));
        }
    }

    /// A hazard came, and no fault yet.
    #[must_use]
    pub fn awaits_a_fault(&self) -> bool {
        self.fault == 0 && !self.hazards.is_empty()
    }

    /// A millisecond of the rig.
    pub fn look(&mut self, view: &View, ms: u32) {
        let mut safe = true;
        for unit in 0..UNITS {
            let running = view.armed && view.running[unit];
            let tension_n = view.tension_n[unit];
            self.tension_n = self.tension_n.max(tension_n);
            if tension_n > TENSION_N {
                self.hazard(Hazard::Tension, ms);
            }
            self.tight[unit] = running && (self.tight[unit] || tension_n >= SLACK_N);
            // What a tight cable winds in the robot gives, and what is taken up after an arming was
            // asked for.
            if running && (!self.tight[unit] || tension_n >= SLACK_N) {
                self.began_m[unit] = view.wound_m[unit];
            }
            let slack = self.tight[unit] && tension_n < SLACK_N;
            self.slack_ms[unit] = if running && view.power && slack {
                self.slack_ms[unit] + 1
            } else {
                0
            };
            if self.slack_ms[unit] > SLACK_MS {
                self.hazard(Hazard::Slack, ms);
            }
            let may_pull = view.armed && (running || view.stopping[unit]) && view.board_fault == 0;
            let pulls = view.pull_n[unit] > PULL_N;
            self.pull_ms[unit] = if pulls && !may_pull {
                self.pull_ms[unit] + 1
            } else {
                0
            };
            if self.pull_ms[unit] > PULL_MS {
                self.hazard(Hazard::Pull, ms);
            }
            if view.wound_m[unit] - self.began_m[unit] > MOTION_M {
                self.hazard(Hazard::Motion, ms);
            }
            safe &= may_pull || !pulls;
        }
        if self.fault == 0 {
            let of_unit = view.unit_fault.iter().copied().find(|fault| *fault != 0);
            self.fault = if view.board_fault != 0 {
                view.board_fault
            } else {
                of_unit.unwrap_or(0)
            };
            self.detected_ms = (self.fault != 0).then_some(ms);
        }
        if self.fault != 0 && self.safe_ms.is_none() && safe {
            self.safe_ms = Some(ms);
        }
    }
}
