//! What came of a case.

use serde::{Deserialize, Serialize};

/// Tension that no cable may reach, N.
pub const TENSION_N: f64 = 13.0;
/// Tension below which a cable of a running unit is slack, N.
pub const SLACK_N: f64 = 0.5;
/// Time that a cable of a running unit may be slack, in milliseconds: what the detections take, and
/// a reversal.
pub const SLACK_MS: u32 = 150;
/// Pull of a motor that counts as pulling, N: friction of the reel is 0.9 N.
pub const PULL_N: f64 = 1.5;
/// Time after which a motor that is not allowed to pull must not, in milliseconds: the cable is
/// given 75 ms to let go, then the PLC takes 10 ms; the rest is for a cable that is pulled again.
pub const PULL_MS: u32 = 150;
/// Cable that a reel may wind in while it is slack or its motor may not pull, m.
pub const MOTION_M: f64 = 0.03;

/// A hazard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Hazard {
    /// Tension above [`TENSION_N`].
    Tension,
    /// A running unit's cable below [`SLACK_N`] for longer than [`SLACK_MS`], after it has once
    /// been tight.
    Slack,
    /// A motor that is not armed, or faulted, pulls with more than [`PULL_N`] for longer than
    /// [`PULL_MS`].
    Pull,
    /// A reel wound in more than [`MOTION_M`] that nobody asked for.
    Motion,
}

/// Result of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Number of the case.
    pub number: u64,
    /// What was injected.
    pub plan: crate::injection::Plan,
    /// Fault that was latched first, of the board or of a unit; 0: none.
    pub fault: u16,
    /// Milliseconds from the first injection to the fault.
    pub detected_ms: Option<u32>,
    /// Milliseconds from the first injection until what faulted was at 0 V or without power.
    pub safe_ms: Option<u32>,
    /// Hazards, and the millisecond of each.
    pub hazards: Vec<(Hazard, u32)>,
    /// Largest tension of any cable, N.
    pub tension_n: f64,
    /// Whether a unit that ran had a slack cable at the first injection: its arming took that up.
    pub slack_before: bool,
    /// Whether the board is armed at the end.
    pub armed: bool,
    /// Whether the amplifiers have power at the end.
    pub powered: bool,
}

impl Outcome {
    /// Nothing happened that anyone would notice.
    #[must_use]
    pub fn is_harmless(&self) -> bool {
        self.fault == 0 && self.hazards.is_empty()
    }

    /// A hazard that no fault stopped.
    #[must_use]
    pub fn is_undetected(&self) -> bool {
        self.fault == 0 && !self.hazards.is_empty()
    }

    /// A hazard that happened although a fault was latched, before or after it.
    #[must_use]
    pub fn is_late(&self) -> bool {
        self.fault != 0 && !self.hazards.is_empty()
    }
}
