//! Watches a stream of robot states: is it one robot, alive, fit to be pulled, with the joints and the frame that fit and a
//! clock that runs?
//!
//! Every state passes [`Watch::settle`] and [`Watch::state`] before anything uses it, and [`Watch::tick`] is asked in every
//! cycle. What is not in order is an [`Event`], never a silent repair. An event that is [`Event::stops`] means that the rig has
//! to go to its safe state and the trial is to be marked; the states stay recorded.
//!
//! Age counts for each quantity that the force depends on, not for the stream: joints that go on don't keep a tip alive, and a
//! state with an old stamp is old however lately it came.

use crate::state::{JointState, Operating, OperatingState, RobotState, StateError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

/// What is tolerated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WatchConfig {
    /// A state, or the tip in it, older than this stops the rig, s.
    pub max_age_s: f64,
    /// Largest difference between the robot's clock and ours over two states, s. Beyond it the clock was stepped.
    pub max_clock_step_s: f64,
    /// Largest travel of the tip between two states, m. Beyond it the pose is not believed.
    pub max_tip_step_m: f64,
    /// Largest speed of the tip between two states, m/s. Beyond it the pose is not believed.
    pub max_tip_speed_m_per_s: f64,
    /// Names of the joints, in order; empty: those of the first state.
    pub joint_names: Vec<String>,
    /// The `frame_id` of the robot's poses; `None`: that of the first one.
    pub frame_id: Option<String>,
}

impl Default for WatchConfig {
    fn default() -> Self {
        Self {
            max_age_s: 0.1,
            max_clock_step_s: 0.1,
            max_tip_step_m: 0.01,
            // Reduced speed of a robot beside people, ISO 10218-1: ten times what a lab's trials move.
            max_tip_speed_m_per_s: 0.25,
            joint_names: Vec::new(),
            frame_id: None,
        }
    }
}

/// Travel of the tip that jitter of the stamps and encoder counts make up for at any speed, m: 4 ms at the largest speed.
const TIP_SLACK_M: f64 = 0.001;
/// So many states in a row that are older than the newest, over at least this time, are a clock that was set back. A datagram
/// that took another way is one, or comes with its neighbours at once.
const SET_BACK_STATES: u32 = 3;
const SET_BACK_NS: i64 = 15_000_000;
/// Time over which the fastest state is looked for, ns.
const BLOCK_NS: i64 = 1_000_000_000;
/// Rate of the robot's clock against ours beyond which no state's time can be told: NTP slews by 500 ppm, chrony by up to
/// 8 % while it corrects a large offset.
const MAX_RATE_ERROR: f64 = 0.02;
/// Blocks in a row that differ by such a rate to the same side: one alone may be a delay that changed.
const RATE_BLOCKS: u32 = 3;

/// Something is not in order.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Event {
    /// The state itself is not usable.
    #[error("the robot's state can't be used: {0}")]
    Invalid(#[from] StateError),
    /// A part without which the state can be used has a flaw. Told once for each part.
    #[error(
        "a part of the robot's state is left out, here and from now on where it is the same: {0}"
    )]
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
    #[error("the robot has published nothing for {age_s:.3} s ({limit_s} s are allowed, `max_age_s`); is its software running?")]
    Silent {
        /// Age of the newest state, s.
        age_s: f64,
        /// Allowed, s.
        limit_s: f64,
    },
    /// States came, and none could be used for too long.
    #[error("the robot has published nothing that can be used for {age_s:.3} s ({limit_s} s are allowed, `max_age_s`); {count} states were left out, the last one: {last}")]
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
    const fn of(operating: OperatingState) -> Option<Self> {
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

    /// Whether it is about a single state that is left out, as can happen. When no other comes, that is an event of its own.
    const fn is_only_left_out(&self) -> bool {
        matches!(
            self,
            Self::OutOfOrder { .. } | Self::Late { .. } | Self::Repeated
        )
    }
}

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Watch {
    config: WatchConfig,
    names: Option<Arc<[String]>>,
    publisher: Option<Arc<str>>,
    frame_id: Option<Arc<str>>,
    last: Option<Last>,
    tip: Option<Tip>,
    began_ns: Option<i64>,
    silent: bool,
    tip_silent: bool,
    delays: Delays,
    /// States since the newest one that are older than it.
    older: Option<Older>,
    /// States that were left out since the last usable one, and why the last of them was.
    left_out: Option<(u64, Event)>,
    /// Parts that were left out of states, each told once.
    flawed: BTreeSet<&'static str>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    stamp_ns: i64,
    received_ns: i64,
}

/// The newest tip. Its age is that of its own stamp.
#[derive(Debug, Clone, Copy)]
struct Tip {
    stamp_ns: i64,
    at_ns: i64,
    position_m: [f64; 3],
}

/// States in a row that are older than the newest.
#[derive(Debug, Clone, Copy)]
struct Older {
    count: u32,
    since_ns: i64,
    stamp_ns: i64,
}

impl Watch {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: WatchConfig) -> Self {
        Self {
            names: (!config.joint_names.is_empty()).then(|| config.joint_names.clone().into()),
            frame_id: config.frame_id.as_deref().map(Arc::from),
            config,
            publisher: None,
            last: None,
            tip: None,
            began_ns: None,
            silent: false,
            tip_silent: false,
            delays: Delays::default(),
            older: None,
            left_out: None,
            flawed: BTreeSet::new(),
        }
    }

    /// Leaves out of a state what has a flaw and is not needed, and returns it.
    pub fn settle(&mut self, state: &mut RobotState) -> Vec<StateError> {
        let nameless = |joints: &JointState| joints.names.is_empty();
        if state.joints.as_ref().is_some_and(nameless) {
            // By their place: it is all that such a robot tells.
            if let (Some(joints), Some(names)) = (&mut state.joints, &self.names) {
                if joints.position.len() == names.len() {
                    let flaw = StateError::Nameless(names.len()).of_optional("joint names");
                    joints.names = Arc::clone(names);
                    let mut flaws = state.leave_out_flaws();
                    flaws.push(flaw);
                    return flaws;
                }
            }
        }
        state.leave_out_flaws()
    }

    /// The event of a part that was left out: one for each part.
    pub fn left_out(&mut self, flaw: &StateError) -> Option<Event> {
        let StateError::Optional { field, .. } = flaw else {
            return None;
        };
        (self.flawed.insert(field)).then(|| Event::LeftOut(flaw.clone()))
    }

    /// A state came at `now_ns` of our clock. `Ok`: it can be used, with an event that does not stop where there is one.
    ///
    /// # Errors
    /// It must not be used.
    pub fn state(&mut self, state: &RobotState, now_ns: i64) -> Result<Option<Event>, Event> {
        self.began_ns.get_or_insert(now_ns);
        let usable = self.examine(state, now_ns);
        match &usable {
            Ok(_) => self.left_out = None,
            Err(event) => {
                let (count, last) = self.left_out.get_or_insert_with(|| (0, event.clone()));
                *count += 1;
                last.clone_from(event);
            }
        }
        usable
    }

    /// Whether an event of [`Watch::state`] is worth telling: a state that is left out is told once until another can be used.
    #[must_use]
    pub fn is_news(&self, event: &Event) -> bool {
        !event.is_only_left_out() || self.left_out.as_ref().is_none_or(|(count, _)| *count == 1)
    }

    fn examine(&mut self, state: &RobotState, now_ns: i64) -> Result<Option<Event>, Event> {
        self.one_publisher(state)?;
        state.check()?;
        if let Some(unfit) = state.operating.and_then(Unfit::of) {
            return Err(Event::NotOperating(unfit));
        }
        self.joints_fit(state)?;
        self.frame_fits(state)?;
        // When it came is known better than when it was looked for.
        let received = state.received.as_ref().map(|stamp| stamp.t_ns);
        let received_ns = received.map_or(now_ns, |at_ns| at_ns.min(now_ns));
        let now = Last {
            stamp_ns: state.stamp.t_ns,
            received_ns,
        };
        self.clock(now)?;
        let mut resumed = None;
        if std::mem::take(&mut self.silent) {
            // It was late, or was gone, and is there now. The arm may have moved meanwhile.
            let since_ns = (self.last.map(|last| last.received_ns))
                .or(self.began_ns)
                .unwrap_or(now_ns);
            let gap_s = (now_ns - since_ns) as f64 * 1e-9;
            resumed = Some(Event::Resumed { gap_s });
            self.tip = None;
        }
        self.last = Some(now);
        self.tip_travel(state, received_ns)?;
        Ok(resumed)
    }

    /// Whether the state's stamp follows the last one, as far as our clock can tell.
    fn clock(&mut self, now: Last) -> Result<(), Event> {
        let delay_ns = now.received_ns.saturating_sub(now.stamp_ns);
        let Some(last) = self.last else {
            self.delays.note(now.received_ns, delay_ns);
            return Ok(());
        };
        let by_s = (self.delays.least_ns() - delay_ns) as f64 * 1e-9;
        if now.stamp_ns == last.stamp_ns {
            return Err(Event::Repeated);
        }
        if now.stamp_ns < last.stamp_ns {
            let before = self.older.filter(|older| now.stamp_ns > older.stamp_ns);
            let older = Older {
                count: before.map_or(1, |older| older.count + 1),
                since_ns: before.map_or(now.received_ns, |older| older.since_ns),
                stamp_ns: now.stamp_ns,
            };
            self.older = Some(older);
            if older.count < SET_BACK_STATES || now.received_ns - older.since_ns < SET_BACK_NS {
                let by_s = (last.stamp_ns - now.stamp_ns) as f64 * 1e-9;
                return Err(Event::OutOfOrder { by_s });
            }
            return Err(self.new_clock(now, by_s));
        }
        self.older = None;
        if by_s > self.config.max_clock_step_s {
            return Err(self.new_clock(now, by_s));
        }
        self.delays.note(now.received_ns, delay_ns);
        if -by_s > self.config.max_age_s {
            return Err(Event::Late {
                by_s: -by_s,
                limit_s: self.config.max_age_s,
            });
        }
        match self.delays.rate_off() {
            Some(rate) => Err(Event::ClockRate { rate }),
            None => Ok(()),
        }
    }

    /// The new clock is the one to compare with from now on: one jump is one event.
    fn new_clock(&mut self, now: Last, by_s: f64) -> Event {
        self.last = Some(now);
        self.older = None;
        self.delays = Delays::default();
        let delay_ns = now.received_ns.saturating_sub(now.stamp_ns);
        self.delays.note(now.received_ns, delay_ns);
        // Its stamps don't compare with the old clock's.
        self.tip = None;
        Event::ClockJump { by_s }
    }

    fn tip_travel(&mut self, state: &RobotState, received_ns: i64) -> Result<(), Event> {
        let Some(tip) = &state.tip else {
            return Ok(());
        };
        let stamp_ns = tip.stamp_ns.unwrap_or(state.stamp.t_ns);
        let now = Tip {
            stamp_ns,
            at_ns: received_ns - state.stamp.t_ns.saturating_sub(stamp_ns).max(0),
            position_m: tip.position_m,
        };
        let before = self.tip.filter(|_| !self.tip_silent);
        if (self.tip).is_some_and(|before| before.stamp_ns >= stamp_ns) {
            // The same pose again, or one before it: no newer than it was.
            return Ok(());
        }
        self.tip = Some(now);
        self.tip_silent = false;
        let Some(before) = before else {
            return Ok(());
        };
        let by_m = distance(before.position_m, now.position_m);
        let passed_s = (stamp_ns - before.stamp_ns) as f64 * 1e-9;
        let limit_m = (TIP_SLACK_M + self.config.max_tip_speed_m_per_s * passed_s)
            .min(self.config.max_tip_step_m);
        if by_m > limit_m {
            return Err(Event::TipJump { by_m, limit_m });
        }
        Ok(())
    }

    /// Time is `now_ns` of our clock: are the robot and its tip still there? One event for each silence.
    pub fn tick(&mut self, now_ns: i64) -> Option<Event> {
        let limit_s = self.config.max_age_s;
        let age_s = |since_ns: i64| (now_ns - since_ns) as f64 * 1e-9;
        let since_ns = match self.last {
            Some(last) => last.received_ns,
            None => *self.began_ns.get_or_insert(now_ns),
        };
        if self.silent {
            return None;
        }
        let age = age_s(since_ns);
        if age > limit_s {
            self.silent = true;
            return Some(match self.left_out.clone() {
                Some((count, last)) => Event::NoneUsable {
                    age_s: age,
                    limit_s,
                    count,
                    last: Box::new(last),
                },
                None => Event::Silent {
                    age_s: age,
                    limit_s,
                },
            });
        }
        let tip_age = age_s(self.tip.filter(|_| !self.tip_silent)?.at_ns);
        if tip_age <= limit_s {
            return None;
        }
        self.tip_silent = true;
        Some(Event::TipSilent {
            age_s: tip_age,
            limit_s,
        })
    }

    /// Whether the newest state is recent enough to act on.
    #[must_use]
    pub fn is_alive(&self, now_ns: i64) -> bool {
        self.last
            .is_some_and(|last| (now_ns - last.received_ns) as f64 * 1e-9 <= self.config.max_age_s)
    }

    fn frame_fits(&mut self, state: &RobotState) -> Result<(), Event> {
        let Some(tip) = &state.tip else {
            return Ok(());
        };
        let before = (self.frame_id).get_or_insert_with(|| Arc::clone(&tip.frame_id));
        if *before == tip.frame_id {
            return Ok(());
        }
        Err(Event::Frame {
            before: Arc::clone(before),
            after: Arc::clone(&tip.frame_id),
        })
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

/// Our time of a state's arrival less its stamp, for the fastest states of the last one to two seconds. What is above is
/// delay, what falls far below is a clock that jumped, and what drifts is a clock of another rate.
#[derive(Debug, Clone, Copy, Default)]
struct Delays {
    now: Option<Block>,
    before: Option<Block>,
    /// Blocks in a row with a wrong rate, and the last rate.
    off: u32,
    rate: f64,
}

/// The fastest state of a second.
#[derive(Debug, Clone, Copy)]
struct Block {
    since_ns: i64,
    least_ns: i64,
}

impl Delays {
    fn note(&mut self, at_ns: i64, delay_ns: i64) {
        match &mut self.now {
            Some(now) if at_ns - now.since_ns < BLOCK_NS => {
                now.least_ns = now.least_ns.min(delay_ns);
            }
            _ => {
                let ended = self.now.replace(Block {
                    since_ns: at_ns,
                    least_ns: delay_ns,
                });
                if let (Some(before), Some(ended)) = (self.before, ended) {
                    let passed_ns = (ended.since_ns - before.since_ns) as f64;
                    let rate = 1.0 - (ended.least_ns - before.least_ns) as f64 / passed_ns;
                    let same_side = (rate > 1.0) == (self.rate > 1.0);
                    self.off = match (rate - 1.0).abs() > MAX_RATE_ERROR {
                        true if same_side => self.off + 1,
                        is_off => u32::from(is_off),
                    };
                    self.rate = rate;
                }
                self.before = ended;
            }
        }
    }

    /// The least delay; 0 before the first.
    fn least_ns(&self) -> i64 {
        let least = |block: &Block| block.least_ns;
        let blocks = [&self.now, &self.before];
        (blocks.into_iter().flatten().map(least).min()).unwrap_or_default()
    }

    /// The rate of the robot's clock where it is wrong for good.
    fn rate_off(&self) -> Option<f64> {
        (self.off >= RATE_BLOCKS).then_some(self.rate)
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
                frame_id: "base".into(),
                stamp_ns: None,
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
    fn a_clock_that_is_set_is_one_event_either_way() {
        for by_ms in [500, -500, 150, -150] {
            let mut watch = watch();
            let mut events = Vec::new();
            for n in 10..30 {
                let usable = watch.state(&state(10 * n + by_ms), 10 * n * MS);
                events.extend(usable.err().filter(|event| watch.is_news(event)));
            }
            let jumps: Vec<f64> = (events.iter())
                .filter_map(|event| match event {
                    Event::ClockJump { by_s } => Some(*by_s),
                    _ => None,
                })
                .collect();
            let [by_s] = jumps.as_slice() else {
                panic!("{by_ms}: {events:?}")
            };
            assert!((by_s - by_ms as f64 * 1e-3).abs() < 1e-9, "{events:?}");
            // A clock that was set back shows as states that are older at first: told once.
            assert_eq!(events.len(), if by_ms < 0 { 2 } else { 1 }, "{events:?}");
            assert!(events.last().unwrap().stops());
            // From then on the new clock counts.
            assert_eq!(watch.state(&state(300 + by_ms), 300 * MS), Ok(None));
        }
    }

    #[test]
    fn one_state_that_came_late_is_late_and_no_clock_jumped() {
        // By another way, after those that were sent later.
        let mut late = watch();
        for n in 10..30 {
            if n != 12 {
                assert_eq!(late.state(&state(10 * n), 10 * n * MS), Ok(None), "{n}");
            }
            if n == 28 {
                let event = late.state(&state(120), 10 * n * MS + 1).unwrap_err();
                assert_eq!(event, Event::OutOfOrder { by_s: 0.16 });
                assert!(!event.stops());
            }
        }
        // Several by that way at once are no clock that was set back either.
        for n in 13..18 {
            let event = late.state(&state(10 * n), 295 * MS).unwrap_err();
            assert!(matches!(event, Event::OutOfOrder { .. }), "{event}");
        }
        assert_eq!(late.state(&state(300), 300 * MS), Ok(None));
        // All of them, by a link that was held up: no state is usable, and that is said with its cause.
        let mut held_up = watch();
        let silent = held_up.tick(205 * MS).unwrap();
        assert!(matches!(silent, Event::Silent { .. }), "{silent}");
        for n in 10..20 {
            let event = held_up.state(&state(10 * n), 310 * MS).unwrap_err();
            assert!(matches!(event, Event::Late { .. }), "{n}: {event}");
        }
        assert!(held_up.state(&state(300), 310 * MS).unwrap().is_some());
        // A link that stays behind: the states are old, however regularly they come.
        let mut behind = watch();
        let mut stop = None;
        for n in 10..60 {
            let _ = behind.state(&state(10 * n - (5 * (n - 10)).min(200)), 10 * n * MS);
            stop = stop.or(behind.tick(10 * n * MS).map(|event| (n, event)));
        }
        let (n, event) = stop.unwrap();
        let text = event.to_string();
        assert!(
            event.stops() && text.contains("published nothing"),
            "{text}"
        );
        assert!(text.contains("late"), "{text}");
        // 100 ms behind at 30, and 100 ms without a usable state after that.
        assert!((40..=42).contains(&n), "{n}: {text}");
    }

    #[test]
    fn a_stamp_that_stands_keeps_nothing_alive() {
        let mut watch = watch();
        let mut told = Vec::new();
        for n in 10..25 {
            let usable = watch.state(&state(90), 10 * n * MS);
            told.extend(usable.err().filter(|event| watch.is_news(event)));
            told.extend(watch.tick(10 * n * MS));
        }
        let [Event::Repeated, Event::NoneUsable { count, .. }] = told.as_slice() else {
            panic!("{told:?}")
        };
        assert_eq!(*count, 11);
        assert!(told[1].stops() && !told[0].stops());
    }

    #[test]
    fn a_clock_of_another_rate_is_named_with_its_rate() {
        for (rate, words) in [(0.95, "0.950"), (1.05, "1.050"), (2.0, "2.000")] {
            let mut watch = Watch::new(WatchConfig::default());
            let event = (0..1000).find_map(|n| {
                let stamp_ms = (10.0 * rate * f64::from(n)) as i64;
                let usable = watch.state(&state(stamp_ms), 10 * i64::from(n) * MS);
                usable.err().filter(Event::stops)
            });
            let text = event.expect("an event").to_string();
            assert!(text.contains("rate") || text.contains("runs at"), "{text}");
            assert!(text.contains(words), "{text}");
        }
        // Slewed by NTP, and with delays that differ from state to state: in order.
        for rate in [0.999_5, 1.000_5] {
            let mut watch = Watch::new(WatchConfig::default());
            for n in 0..3000_i64 {
                let stamp_ns = (10e6 * rate * n as f64) as i64;
                let mut state = state(0);
                state.stamp.t_ns += stamp_ns;
                let delay_ns = 37 * n % 19 * MS;
                assert_eq!(watch.state(&state, 10 * n * MS + delay_ns), Ok(None), "{n}");
            }
        }
    }

    #[test]
    fn a_state_counts_from_when_it_came_and_not_from_when_it_was_looked_for() {
        // This computer was held up for 150 ms; a thread took the states as they came.
        let mut watch = watch();
        for n in 10..25 {
            let mut state = state(10 * n);
            state.received = Some(Stamp {
                clock: Clock::HostMonotonic,
                t_ns: 10 * n * MS,
            });
            assert_eq!(watch.state(&state, 245 * MS), Ok(None), "{n}");
        }
        assert_eq!(watch.tick(245 * MS), None);
        assert!(watch.tick(345 * MS).is_some());
    }

    #[test]
    fn joints_that_go_on_do_not_keep_a_tip_alive() {
        // No tip at all, and the last one again and again with its own stamp.
        for frozen in [false, true] {
            let mut watch = watch();
            let mut told = Vec::new();
            for n in 10..40 {
                let mut state = state(10 * n);
                let tip = state.tip.as_mut().unwrap();
                tip.stamp_ns = Some(super::tests::state(90).stamp.t_ns);
                if !frozen {
                    state.tip = None;
                }
                assert_eq!(watch.state(&state, 10 * n * MS), Ok(None));
                told.extend(watch.tick(10 * n * MS).map(|event| (n, event)));
            }
            let [(n, event)] = told.as_slice() else {
                panic!("{told:?}")
            };
            assert!(matches!(event, Event::TipSilent { .. }) && event.stops());
            assert_eq!(*n, 20, "{event}");
        }
        // A robot that tells no tip has none to lose.
        let mut without = Watch::new(WatchConfig::default());
        for n in 0..40 {
            let mut state = state(10 * n);
            state.tip = None;
            assert_eq!(without.state(&state, 10 * n * MS), Ok(None));
            assert_eq!(without.tick(10 * n * MS), None);
        }
    }

    #[test]
    fn a_robot_that_says_that_it_must_not_be_used_stops_and_a_paused_one_does_not() {
        let all = [
            (Operating::Enabled, true, None),
            (Operating::Paused, true, None),
            (Operating::Disabled, true, Some("DISABLED")),
            (Operating::Fault, true, Some("FAULT")),
            (Operating::Fault, false, Some("FAULT")),
            (Operating::Disabled, false, Some("DISABLED")),
            (Operating::Enabled, false, Some("not homed")),
            (Operating::Paused, false, Some("not homed")),
        ];
        for (operating, is_homed, words) in all {
            let mut watch = watch();
            let mut state = state(100);
            state.operating = Some(OperatingState {
                state: operating,
                is_homed,
                is_busy: false,
            });
            match (watch.state(&state, 100 * MS), words) {
                (Ok(None), None) => {}
                (Err(event), Some(words)) => {
                    assert!(
                        event.stops() && event.to_string().contains(words),
                        "{event}"
                    );
                }
                (other, _) => panic!("{operating:?} {is_homed}: {other:?}"),
            }
        }
    }

    #[test]
    fn another_frame_stops_and_one_that_is_expected_is_compared() {
        let mut watch = watch();
        let mut other = state(100);
        other.tip.as_mut().unwrap().frame_id = "ECM".into();
        for stamp_ms in [100, 110] {
            other.stamp.t_ns = state(stamp_ms).stamp.t_ns;
            let event = watch.state(&other, stamp_ms * MS).unwrap_err();
            let text = event.to_string();
            assert!(
                event.stops() && text.contains("`ECM`") && text.contains("`base`"),
                "{text}"
            );
        }
        let mut configured = Watch::new(WatchConfig {
            frame_id: Some("PSM1_base".to_owned()),
            ..WatchConfig::default()
        });
        assert!(matches!(
            configured.state(&state(0), 0),
            Err(Event::Frame { .. })
        ));
    }

    #[test]
    fn a_tip_may_move_as_fast_as_an_arm_and_no_faster() {
        // 0.2 m/s at 100 Hz and at 1 kHz, with stamps that jitter by 2 ms at 100 Hz.
        for (period_us, jitter_us) in [(10_000, 2_000), (1_000, 0)] {
            let mut watch = Watch::new(WatchConfig::default());
            for n in 0..200_i64 {
                let at_us = n * period_us;
                let mut state = state(0);
                state.stamp.t_ns += 1000 * (at_us + n % 2 * jitter_us);
                state.tip.as_mut().unwrap().position_m[0] = 0.2e-6 * at_us as f64;
                assert_eq!(watch.state(&state, at_us * 1000 + 5 * MS), Ok(None), "{n}");
            }
        }
        // 8 mm in 10 ms: another frame, or another arm.
        let mut watch = watch();
        let mut moved = state(100);
        moved.tip.as_mut().unwrap().position_m[2] = 0.008;
        let event = watch.state(&moved, 100 * MS).unwrap_err();
        assert!(matches!(event, Event::TipJump { .. }) && event.stops());
        // Slow enough for 80 ms, and too far all the same.
        let mut rare = super::tests::watch();
        moved.stamp.t_ns = state(170).stamp.t_ns;
        moved.tip.as_mut().unwrap().position_m[2] = 0.012;
        let event = rare.state(&moved, 170 * MS).unwrap_err();
        assert!(
            matches!(event, Event::TipJump { limit_m: 0.01, .. }),
            "{event}"
        );
        // A tip that was away for long is compared with nothing: the arm may have moved.
        let mut away = super::tests::watch();
        assert!(away.tick(400 * MS).is_some());
        moved.tip.as_mut().unwrap().position_m[2] = 0.05;
        moved.stamp.t_ns = state(410).stamp.t_ns;
        assert!(away.state(&moved, 410 * MS).is_ok());
    }

    #[test]
    fn joints_without_names_are_told_by_their_place() {
        let mut named = watch();
        let mut nameless = state(100);
        nameless.joints.as_mut().unwrap().names = Vec::new().into();
        let mut first = nameless.clone();
        let flaws = named.settle(&mut nameless);
        assert_eq!(nameless, state(100));
        assert!(named.left_out(&flaws[0]).is_some());
        assert_eq!(named.left_out(&flaws[0]), None, "one event for each part");
        assert_eq!(named.state(&nameless, 100 * MS), Ok(None));
        // From the beginning: numbers, which hold from then on.
        let mut new = Watch::new(WatchConfig::default());
        new.settle(&mut first);
        assert_eq!(
            *first.joints.as_ref().unwrap().names,
            ["joint_1", "joint_2"]
        );
        assert_eq!(new.state(&first, 100 * MS), Ok(None));
        assert!(matches!(
            new.state(&state(110), 110 * MS),
            Err(Event::JointNames { .. })
        ));
        // Another number of joints is another arm, names or not.
        let mut three = state(120);
        let joints = three.joints.as_mut().unwrap();
        (joints.names, joints.position) = (Vec::new().into(), vec![0.0; 3]);
        named.settle(&mut three);
        assert!(matches!(
            named.state(&three, 120 * MS),
            Err(Event::JointNames { .. })
        ));
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
