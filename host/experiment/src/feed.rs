//! The robot's states in a trial: from the virtual arm in the link, or from a source outside.

use robot::arm::Truth as ArmTruth;
use robot::source::{Fed, Poll, Source, SourceConfig, SourceError};
use robot::state::{Mount, Operating, OperatingState, RobotState, TipForce};
use robot::trajectory::Trajectory;
use robot::watch::Event;
use session::link::RigLink;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Changes what the virtual arm publishes: what a test makes go wrong.
pub type Tamper = Box<dyn FnMut(Vec<RobotState>) -> Vec<RobotState> + Send>;

/// See the module's page.
pub enum Feed {
    /// The virtual arm of the link.
    Virtual {
        /// Passes its states through the watch.
        fed: Box<Fed>,
        /// What a test makes go wrong.
        tamper: Option<Tamper>,
    },
    /// A source outside.
    Outside {
        /// It.
        source: Box<dyn Source>,
        /// How the link's time passes.
        pace: Pace,
    },
}

/// How the time of an emulated rig passes against this computer's. On a busy computer it is slow,
/// and a robot outside then looks as if its clock ran fast.
#[derive(Debug, Default)]
pub struct Pace {
    /// Link time, ns, and this computer's, of the last seconds.
    seen: VecDeque<(u64, Instant)>,
}

/// How far back the pace is looked at: the watch needs four seconds to tell a rate.
const PACE_OVER: Duration = Duration::from_secs(5);
/// Difference of the rig's rate from 1 that explains a robot's clock with a wrong rate: half of
/// what the watch tolerates.
const PACE_OFF: f64 = 0.01;

impl Pace {
    fn note(&mut self, link_ns: u64, at: Instant) {
        self.seen.push_back((link_ns, at));
        let old = |(_, then): &mut (u64, Instant)| at.duration_since(*then) > PACE_OVER;
        while self.seen.pop_front_if(old).is_some() {}
    }

    /// The event, or that of the rig where its pace explains it.
    fn explained(&self, event: Event) -> Event {
        let (Some(first), Some(last)) = (self.seen.front(), self.seen.back()) else {
            return event;
        };
        let link_s = last.0.saturating_sub(first.0) as f64 * 1e-9;
        let passed_s = last.1.duration_since(first.1).as_secs_f64();
        let (rate, behind_s) = (link_s / passed_s, passed_s - link_s);
        let explains = match event {
            // Both to the same side: a slow rig makes the robot fast.
            Event::ClockRate { rate: robot } => {
                (rate - 1.0).abs() > PACE_OFF && (rate < 1.0) == (robot > 1.0)
            }
            Event::ClockJump { by_s } => behind_s * by_s.signum() > 0.5 * by_s.abs(),
            _ => false,
        };
        if explains {
            Event::RigPace { rate }
        } else {
            event
        }
    }
}

impl std::fmt::Debug for Feed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Virtual { fed, .. } => f.debug_tuple("Virtual").field(fed).finish(),
            Self::Outside { source, .. } => f.debug_tuple("Outside").field(&source.name()).finish(),
        }
    }
}

/// What came in a cycle.
#[derive(Debug, Default)]
pub struct Fresh {
    /// Usable states and events.
    pub poll: Poll,
    /// The virtual arm's truth at its cycles of 1 ms.
    pub truth: Vec<ArmTruth>,
}

impl Feed {
    /// Opens what `[robot]` names; the virtual arm begins to follow `trajectory`.
    ///
    /// # Errors
    /// [`SourceError`]; also where the link has no virtual arm.
    pub fn open(
        config: &SourceConfig,
        link: &mut dyn RigLink,
        trajectory: Option<&Trajectory>,
        tamper: Option<Tamper>,
    ) -> Result<Self, SourceError> {
        let SourceConfig::Virtual(config) = config else {
            return Ok(Self::Outside {
                source: robot_ros::open(config)?,
                pace: Pace::default(),
            });
        };
        let Some(arm) = link.controls().and_then(|controls| controls.arm()) else {
            return Err(SourceError::Config {
                key: "kind",
                why: "the virtual arm exists in the fast rig only; use `--link fast`, or another kind".to_owned(),
            });
        };
        if let Some(trajectory) = trajectory {
            arm.follow(trajectory.clone());
        }
        arm.keep_messages(true);
        let mount: Mount = config.arm.mount;
        Ok(Self::Virtual {
            fed: Box::new(Fed::mounted("virtual arm", config.watch.clone(), mount)),
            tamper,
        })
    }

    /// What came by `now_ns` of the link's time.
    ///
    /// # Errors
    /// The source is gone.
    pub fn poll(&mut self, link: &mut dyn RigLink, now_ns: u64) -> Result<Fresh, SourceError> {
        let link_ns = now_ns;
        let now_ns = i64::try_from(now_ns).unwrap_or(i64::MAX);
        match self {
            Self::Outside { source, pace } => {
                let mut poll = source.poll(now_ns)?;
                // Only an emulated rig has a time of its own.
                if link.controls().is_some() {
                    pace.note(link_ns, Instant::now());
                    let events = poll.events.into_iter();
                    poll.events = events.map(|event| pace.explained(event)).collect();
                }
                Ok(Fresh {
                    poll,
                    truth: Vec::new(),
                })
            }
            Self::Virtual { fed, tamper } => {
                let mut truth = Vec::new();
                if let Some(arm) = link.controls().and_then(|controls| controls.arm()) {
                    let messages = arm.take_messages();
                    let mut states: Vec<_> = messages.iter().map(|m| arm.state_of(m)).collect();
                    truth = arm.take_truths();
                    if let Some(tamper) = tamper {
                        states = tamper(states);
                    }
                    fed.feed(states);
                }
                Ok(Fresh {
                    poll: fed.poll(now_ns)?,
                    truth,
                })
            }
        }
    }

    /// Tells the robot's side the applied force and the one that is aimed at.
    ///
    /// # Errors
    /// The source is gone.
    pub fn publish(&mut self, applied: &TipForce, setpoint: &TipForce) -> Result<(), SourceError> {
        match self {
            Self::Virtual { .. } => Ok(()),
            Self::Outside { source, .. } => source.publish(applied, setpoint),
        }
    }

    /// Tells the robot's side in which state the rig is.
    ///
    /// # Errors
    /// The source is gone.
    pub fn publish_operating(&mut self, state: Operating) -> Result<(), SourceError> {
        match self {
            Self::Virtual { .. } => Ok(()),
            Self::Outside { source, .. } => source.publish_operating(OperatingState {
                state,
                is_homed: true,
                is_busy: state == Operating::Enabled,
            }),
        }
    }

    /// Name in messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Virtual { fed, .. } => fed.name(),
            Self::Outside { source, .. } => source.name(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_emulated_rig_is_told_as_that_and_a_wrong_clock_of_the_robot_as_that() {
        let began = Instant::now();
        let at_pace = |rate: f64| {
            let mut pace = Pace::default();
            for n in 0..1_000_u32 {
                let passed = Duration::from_millis(10) * n;
                pace.note((passed.as_nanos() as f64 * rate) as u64, began + passed);
            }
            pace
        };
        let rate_off = Event::ClockRate { rate: 1.25 };
        let jump = Event::ClockJump { by_s: 0.5 };
        let slow = at_pace(0.8);
        for event in [&rate_off, &jump] {
            let Event::RigPace { rate } = slow.explained(event.clone()) else {
                panic!("{event}")
            };
            assert!((rate - 0.8).abs() < 1e-3, "{rate}");
            assert_eq!(at_pace(1.0).explained(event.clone()), *event);
        }
        // To the other side, and what has nothing to do with clocks.
        for event in [
            Event::ClockRate { rate: 0.8 },
            Event::ClockJump { by_s: -0.5 },
            Event::Repeated,
        ] {
            assert_eq!(slow.explained(event.clone()), event);
        }
    }
}
