//! What is not in order with a robot.

use crate::state::{Operating, OperatingState, StateError};
use std::fmt;
use std::sync::Arc;

/// Something is not in order.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Event {
    /// The state itself is not usable.
    #[error("the robot's state can't be used: {0}")]
    Invalid(#[from] StateError),
    /// A part without which the state can be used has a flaw, or a datagram is no message. Told
    /// once for each part.
    #[error("left out, here and from now on where the flaw is the same: {0}")]
    LeftOut(StateError),
    /// The joints are not those that were expected.
    #[error("the robot reports the joints {got:?}, expected are {expected:?}: check `joint_names` in [robot] and which arm is connected")]
    JointNames {
        /// Expected.
        expected: Vec<String>,
        /// Reported.
        got: Vec<String>,
    },
    /// A second publisher sends on the same topic.
    #[error(
        "two publishers send the robot's state: `{first}` and now `{second}`; stop one of them"
    )]
    TwoPublishers {
        /// Whose states are used.
        first: Arc<str>,
        /// Whose are not.
        second: Arc<str>,
    },
    /// A publisher that is registered and gone.
    #[error("`{name}` is registered as a publisher of {topic} and does not answer: it was killed, perhaps; `rosnode cleanup` removes it")]
    DeadPublisher {
        /// Its name.
        name: String,
        /// Of what.
        topic: String,
    },
    /// The robot says that it must not be used.
    #[error("the robot says that it is {0} (operating_state); nothing may pull it")]
    NotOperating(Unfit),
    /// The tip is told in another frame.
    #[error("the robot's tip is in the frame `{after}` now, it was in `{before}` (frame_id): the mount in [robot] holds for one of them; set the robot's base frame back, or end the run before it changes")]
    Frame {
        /// Expected.
        before: Arc<str>,
        /// Reported.
        after: Arc<str>,
    },
    /// The robot's clock jumped against ours.
    #[error("the robot's clock jumped by {by_s:.3} s against this computer's between two states; slew clocks, don't step them (chrony: makestep off)")]
    ClockJump {
        /// Robot's minus ours, s.
        by_s: f64,
    },
    /// The robot's clock runs at another rate.
    #[error("the robot's clock runs at {rate:.3} of this computer's: is it simulated (use_sim_time), or is its time being corrected (chrony: maxslewrate)? This computer can't tell when its states were")]
    ClockRate {
        /// Its seconds in one of ours.
        rate: f64,
    },
    /// The time that states are compared with is that of an emulated rig, and did not pass as this
    /// computer's.
    #[error("the emulated rig ran at {rate:.3} of real time, so when the robot's states were can't be told; run it on a computer with less to do")]
    RigPace {
        /// Its seconds in one of this computer's.
        rate: f64,
    },
    /// A state that is older than the last one.
    #[error("a state came {by_s:.4} s older than the one before; it is left out")]
    OutOfOrder {
        /// How much older, s.
        by_s: f64,
    },
    /// A state that needed too long.
    #[error("a state came {by_s:.3} s late ({limit_s} s are allowed, `max_age_s`): the network or the robot's computer held it up, or its clock is slower than this computer's; it is left out")]
    Late {
        /// Delay above that of the fastest state of the last seconds, s.
        by_s: f64,
        /// Allowed, s.
        limit_s: f64,
    },
    /// A state whose stamp is that of the one before.
    #[error("a state has the stamp of the one before; it is left out")]
    Repeated,
    /// The tip jumped.
    #[error("the robot's tip jumped by {by_m:.4} m between two states, {limit_m:.4} m are allowed (`max_tip_step_m`, `max_tip_speed_m_per_s`)")]
    TipJump {
        /// Distance, m.
        by_m: f64,
        /// Allowed, m.
        limit_m: f64,
    },
    /// Nothing came for too long.
    #[error("the robot has published nothing for {age_s:.3} s (a state and its tip may be {limit_s} s old, `max_age_s`); is its software running?")]
    Silent {
        /// Age of the newest state, s.
        age_s: f64,
        /// Allowed, s.
        limit_s: f64,
    },
    /// States came, and none could be used for too long.
    #[error("the robot has published nothing that can be used for {age_s:.3} s (a state and its tip may be {limit_s} s old, `max_age_s`); {count} states were left out, the last one: {last}")]
    NoneUsable {
        /// Age of the newest usable state, s.
        age_s: f64,
        /// Allowed, s.
        limit_s: f64,
        /// How many were left out since.
        count: u64,
        /// Why the last one was.
        last: Box<Event>,
    },
    /// No tip came for too long, while states did.
    #[error("the robot has published no tip (measured_cp) that can be used for {age_s:.3} s ({limit_s} s are allowed, `max_age_s`), while its joints go on")]
    TipSilent {
        /// Age of the newest tip, s.
        age_s: f64,
        /// Allowed, s.
        limit_s: f64,
    },
    /// It publishes again.
    #[error("the robot publishes again after {gap_s:.3} s")]
    Resumed {
        /// Length of the gap, s.
        gap_s: f64,
    },
}

/// Why a robot must not be used, by its own word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// In fault.
    Fault,
    /// Drives off.
    Disabled,
    /// Its joint positions are not absolute, so the tip is not where it says.
    NotHomed,
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fault => "in FAULT",
            Self::Disabled => "DISABLED",
            Self::NotHomed => "not homed",
        })
    }
}

impl Unfit {
    /// Of an operating state. PAUSED is fit: the drives hold the robot.
    pub(crate) const fn of(operating: OperatingState) -> Option<Self> {
        match operating.state {
            Operating::Fault => Some(Self::Fault),
            Operating::Disabled => Some(Self::Disabled),
            Operating::Enabled | Operating::Paused if !operating.is_homed => Some(Self::NotHomed),
            Operating::Enabled | Operating::Paused => None,
        }
    }
}

impl Event {
    /// Whether the rig has to go to its safe state.
    #[must_use]
    pub const fn stops(&self) -> bool {
        !self.is_only_left_out()
            && !matches!(
                self,
                Self::Resumed { .. } | Self::LeftOut(_) | Self::DeadPublisher { .. }
            )
    }

    /// Whether it is about a single state that is left out, as can happen. When no other comes,
    /// that is an event of its own.
    pub(super) const fn is_only_left_out(&self) -> bool {
        matches!(
            self,
            Self::OutOfOrder { .. } | Self::Late { .. } | Self::Repeated
        )
    }
}
