//! Watches a stream of robot states: is it one robot, alive, with the joints that fit and a clock that runs?
//!
//! Every state passes [`Watch::state`] before anything uses it, and [`Watch::tick`] is asked in every cycle. What is not in order is
//! an [`Event`], never a silent repair. An event that is [`Event::stops`] means that the rig has to go to its safe state and
//! the trial is to be marked; the states stay recorded.

use crate::state::{RobotState, StateError};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What is tolerated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WatchConfig {
    /// A state older than this stops the rig, s.
    pub max_age_s: f64,
    /// Largest difference between the robot's clock and ours over two states, s. Beyond it the clock was stepped.
    pub max_clock_step_s: f64,
    /// Largest travel of the tip between two states, m. Beyond it the pose is not believed.
    pub max_tip_step_m: f64,
    /// Names of the joints, in order; empty: those of the first state.
    pub joint_names: Vec<String>,
}

impl Default for WatchConfig {
    fn default() -> Self {
        Self {
            max_age_s: 0.1,
            max_clock_step_s: 0.1,
            max_tip_step_m: 0.01,
            joint_names: Vec::new(),
        }
    }
}

/// Something is not in order.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Event {
    /// The state itself is not usable.
    #[error("the robot's state can't be used: {0}")]
    Invalid(#[from] StateError),
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
    /// The robot's clock jumped against ours.
    #[error("the robot's clock jumped by {by_s:.3} s against this computer's between two states; slew clocks, don't step them (chrony: makestep off)")]
    ClockJump {
        /// Robot's minus ours, s.
        by_s: f64,
    },
    /// A state that is older than the last one.
    #[error("a state came {by_s:.4} s older than the one before; it is left out")]
    OutOfOrder {
        /// How much older, s.
        by_s: f64,
    },
    /// The tip jumped.
    #[error("the robot's tip jumped by {by_m:.4} m between two states, {limit_m} m are allowed (`max_tip_step_m`)")]
    TipJump {
        /// Distance, m.
        by_m: f64,
        /// Allowed, m.
        limit_m: f64,
    },
    /// Nothing came for too long.
    #[error("the robot has published nothing for {age_s:.3} s ({limit_s} s are allowed, `max_age_s`); is its software running?")]
    Silent {
        /// Age of the newest state, s.
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

impl Event {
    /// Whether the rig has to go to its safe state.
    #[must_use]
    pub const fn stops(&self) -> bool {
        !matches!(self, Self::Resumed { .. } | Self::OutOfOrder { .. })
    }
}

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Watch {
    config: WatchConfig,
    names: Option<Arc<[String]>>,
    publisher: Option<Arc<str>>,
    last: Option<Last>,
    began_ns: Option<i64>,
    silent: bool,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    stamp_ns: i64,
    received_ns: i64,
    tip_m: Option<[f64; 3]>,
}

impl Watch {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: WatchConfig) -> Self {
        Self {
            names: (!config.joint_names.is_empty()).then(|| config.joint_names.clone().into()),
            config,
            publisher: None,
            last: None,
            began_ns: None,
            silent: false,
        }
    }

    /// A state came at `now_ns` of our clock. `Ok`: it can be used, with an event that does not stop where there is one.
    ///
    /// # Errors
    /// It must not be used.
    pub fn state(&mut self, state: &RobotState, now_ns: i64) -> Result<Option<Event>, Event> {
        self.began_ns.get_or_insert(now_ns);
        self.one_publisher(state)?;
        state.check()?;
        self.joints_fit(state)?;
        let tip_m = state.tip.as_ref().map(|tip| tip.position_m);
        let now = Last {
            stamp_ns: state.stamp.t_ns,
            received_ns: now_ns,
            tip_m,
        };
        let mut resumed = None;
        if let Some(last) = self.last {
            let gap_s = (now_ns - last.received_ns) as f64 * 1e-9;
            let step_s = now.stamp_ns.saturating_sub(last.stamp_ns) as f64 * 1e-9;
            let by_s = step_s - gap_s;
            if by_s.abs() > self.config.max_clock_step_s {
                // The new clock is the one to compare with from now on: one jump is one event.
                self.last = Some(now);
                return Err(Event::ClockJump { by_s });
            }
            if step_s < 0.0 {
                return Err(Event::OutOfOrder { by_s: -step_s });
            }
            if std::mem::take(&mut self.silent) {
                resumed = Some(Event::Resumed { gap_s });
            } else if let (Some(before), Some(after)) = (last.tip_m, tip_m) {
                let by_m = distance(before, after);
                if by_m > self.config.max_tip_step_m {
                    self.last = Some(now);
                    return Err(Event::TipJump {
                        by_m,
                        limit_m: self.config.max_tip_step_m,
                    });
                }
            }
        }
        if self.last.is_none() && std::mem::take(&mut self.silent) {
            // It was late, and is there now.
            let began_ns = self.began_ns.unwrap_or(now_ns);
            resumed = Some(Event::Resumed {
                gap_s: (now_ns - began_ns) as f64 * 1e-9,
            });
        }
        self.last = Some(now);
        Ok(resumed)
    }

    /// Time is `now_ns` of our clock: is the robot still there? One event for each silence.
    pub fn tick(&mut self, now_ns: i64) -> Option<Event> {
        let since = match self.last {
            Some(last) => last.received_ns,
            None => *self.began_ns.get_or_insert(now_ns),
        };
        let age_s = (now_ns - since) as f64 * 1e-9;
        if age_s <= self.config.max_age_s || self.silent {
            return None;
        }
        self.silent = true;
        Some(Event::Silent {
            age_s,
            limit_s: self.config.max_age_s,
        })
    }

    /// Whether the newest state is recent enough to act on.
    #[must_use]
    pub fn is_alive(&self, now_ns: i64) -> bool {
        self.last
            .is_some_and(|last| (now_ns - last.received_ns) as f64 * 1e-9 <= self.config.max_age_s)
    }

    fn one_publisher(&mut self, state: &RobotState) -> Result<(), Event> {
        match &self.publisher {
            None => self.publisher = Some(Arc::clone(&state.publisher)),
            Some(first) if *first != state.publisher => {
                return Err(Event::TwoPublishers {
                    first: Arc::clone(first),
                    second: Arc::clone(&state.publisher),
                })
            }
            Some(_) => {}
        }
        Ok(())
    }

    fn joints_fit(&mut self, state: &RobotState) -> Result<(), Event> {
        let Some(joints) = &state.joints else {
            return match &self.names {
                Some(expected) if !self.config.joint_names.is_empty() => Err(Event::JointNames {
                    expected: expected.to_vec(),
                    got: Vec::new(),
                }),
                _ => Ok(()),
            };
        };
        let expected = self.names.get_or_insert_with(|| Arc::clone(&joints.names));
        if *expected == joints.names {
            Ok(())
        } else {
            Err(Event::JointNames {
                expected: expected.to_vec(),
                got: joints.names.to_vec(),
            })
        }
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Clock, Frame, JointState, Stamp, TipState};

    const MS: i64 = 1_000_000;

    fn state(stamp_ms: i64) -> RobotState {
        RobotState {
            publisher: "robot".into(),
            sequence: None,
            stamp: Stamp {
                clock: Clock::RobotUtc,
                t_ns: 1_700_000_000_000_000_000 + stamp_ms * MS,
            },
            received: None,
            joints: Some(JointState {
                names: ["a".to_owned(), "b".to_owned()].into(),
                position: vec![0.0, 0.0],
                velocity: None,
                effort: None,
                setpoint: None,
            }),
            tip: Some(TipState {
                frame: Frame::Rig,
                position_m: [0.0; 3],
                orientation_xyzw: None,
                velocity_m_per_s: None,
                angular_velocity_rad_per_s: None,
            }),
            force: None,
            operating: None,
        }
    }

    /// A watch that has seen ten states, 10 ms apart.
    fn watch() -> Watch {
        let mut watch = Watch::new(WatchConfig::default());
        for n in 0..10 {
            assert_eq!(watch.state(&state(10 * n), 10 * n * MS), Ok(None));
            assert_eq!(watch.tick(10 * n * MS), None);
        }
        watch
    }

    #[test]
    fn a_robot_that_stops_publishing_is_one_event_and_so_is_its_return() {
        let mut watch = watch();
        assert_eq!(watch.tick(190 * MS), None);
        assert!(watch.is_alive(190 * MS));
        let event = watch.tick(191 * MS).unwrap();
        assert!(
            matches!(event, Event::Silent { .. }) && event.stops(),
            "{event}"
        );
        assert!(!watch.is_alive(191 * MS));
        assert_eq!(watch.tick(300 * MS), None, "one event for each silence");
        let resumed = watch.state(&state(400), 400 * MS).unwrap().unwrap();
        assert!(matches!(resumed, Event::Resumed { .. }) && !resumed.stops());
        assert!(watch.tick(600 * MS).is_some());
    }

    #[test]
    fn a_robot_that_never_publishes_is_silent_too() {
        let mut watch = Watch::new(WatchConfig::default());
        assert_eq!(watch.tick(5 * MS), None);
        assert!(matches!(watch.tick(106 * MS), Some(Event::Silent { .. })));
        // It comes late: one event, with the whole gap.
        let event = watch.state(&state(200), 205 * MS).unwrap().unwrap();
        assert_eq!(event, Event::Resumed { gap_s: 0.2 });
        assert_eq!(watch.state(&state(210), 215 * MS), Ok(None));
    }

    #[test]
    fn a_clock_that_jumps_is_one_event_either_way() {
        for by_ms in [500, -500] {
            let mut watch = watch();
            let event = watch.state(&state(100 + by_ms), 100 * MS).unwrap_err();
            let Event::ClockJump { by_s } = event else {
                panic!("{event}")
            };
            assert!((by_s - by_ms as f64 * 1e-3).abs() < 1e-9);
            assert!(event.stops());
            // From then on the new clock counts.
            assert_eq!(watch.state(&state(110 + by_ms), 110 * MS), Ok(None));
        }
    }

    #[test]
    fn a_late_burst_of_states_is_no_jump() {
        let mut watch = watch();
        // Held up by the network for 60 ms, then all at once.
        for n in 10..16 {
            assert_eq!(watch.state(&state(10 * n), 150 * MS), Ok(None));
        }
    }

    #[test]
    fn states_out_of_order_are_left_out_and_don_t_stop() {
        let mut watch = watch();
        let event = watch.state(&state(85), 95 * MS).unwrap_err();
        assert!(
            matches!(event, Event::OutOfOrder { .. }) && !event.stops(),
            "{event}"
        );
        assert_eq!(watch.state(&state(100), 100 * MS), Ok(None));
    }

    #[test]
    fn a_second_publisher_is_refused_and_the_first_goes_on() {
        let mut watch = watch();
        let mut other = state(100);
        other.publisher = "impostor".into();
        let event = watch.state(&other, 100 * MS).unwrap_err();
        assert!(
            matches!(event, Event::TwoPublishers { .. }) && event.stops(),
            "{event}"
        );
        assert_eq!(watch.state(&state(100), 100 * MS), Ok(None));
    }

    #[test]
    fn joints_that_don_t_fit_are_named() {
        let mut watch = watch();
        let mut other = state(100);
        other.joints.as_mut().unwrap().names = ["a".to_owned(), "c".to_owned()].into();
        let event = watch.state(&other, 100 * MS).unwrap_err();
        assert!(event.to_string().contains("\"c\""), "{event}");
        let mut configured = Watch::new(WatchConfig {
            joint_names: vec!["x".to_owned()],
            ..WatchConfig::default()
        });
        assert!(matches!(
            configured.state(&state(0), 0),
            Err(Event::JointNames { .. })
        ));
        let mut without = state(0);
        without.joints = None;
        assert!(matches!(
            configured.state(&without, 0),
            Err(Event::JointNames { .. })
        ));
    }

    #[test]
    fn nan_poses_and_jumps_of_the_tip_stop() {
        let mut watch = watch();
        let mut bad = state(100);
        bad.tip.as_mut().unwrap().position_m[0] = f64::NAN;
        let event = watch.state(&bad, 100 * MS).unwrap_err();
        assert!(
            matches!(event, Event::Invalid(_)) && event.stops(),
            "{event}"
        );
        bad.tip.as_mut().unwrap().position_m[0] = 0.02;
        let event = watch.state(&bad, 110 * MS).unwrap_err();
        assert!(
            matches!(event, Event::TipJump { .. }) && event.stops(),
            "{event}"
        );
    }
}
