//! Watches a stream of robot states: is it one robot, alive, fit to be pulled, with the joints and
//! the frame that fit and a clock that runs?
//!
//! Every state passes [`Watch::settle`] and [`Watch::state`] before anything uses it, and
//! [`Watch::tick`] is asked in every cycle. What is not in order is an [`Event`], never a silent
//! repair. An event that is [`Event::stops`] means that the rig has to go to its safe state and the
//! trial is to be marked; the states stay recorded.
//!
//! Age counts for each quantity that the force depends on, not for the stream: joints that go on
//! don't keep a tip alive, and a state with an old stamp is old however lately it came.

mod delays;
mod event;

pub use delays::Delays;
pub use event::{Event, Unfit};

use crate::state::{JointState, RobotState, StateError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What is tolerated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WatchConfig {
    /// A state, or the tip in it, older than this stops the rig, s.
    pub max_age_s: f64,
    /// Largest difference between the robot's clock and ours over two states, s. Beyond it the
    /// clock was stepped.
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
            // Reduced speed of a robot beside people, ISO 10218-1: ten times what a lab's trials
            // move.
            max_tip_speed_m_per_s: 0.25,
            joint_names: Vec::new(),
            frame_id: None,
        }
    }
}

/// Travel of the tip that jitter of the stamps and encoder counts make up for at any speed, m: 4 ms
/// at the largest speed.
const TIP_SLACK_M: f64 = 0.001;
/// So many states in a row that are older than the newest, over at least this time, are a clock
/// that was set back. A datagram that took another way is one, or comes with its neighbours at
/// once.
const SET_BACK_STATES: u32 = 3;
const SET_BACK_NS: i64 = 15_000_000;

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

    /// Our time less the robot's stamp for the fastest state of the last one to two seconds, ns.
    pub(crate) fn least_delay_ns(&self) -> i64 {
        self.delays.least_ns()
    }

    /// A state came at `now_ns` of our clock. `Ok`: it can be used, with an event that does not
    /// stop where there is one.
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

    /// Whether an event of [`Watch::state`] is worth telling: a state that is left out is told once
    /// until another can be used.
    #[must_use]
    pub fn is_news(&self, event: &Event) -> bool {
        !event.is_only_left_out() || self.left_out.as_ref().is_none_or(|(count, _)| *count == 1)
    }

    fn examine(&mut self, state: &RobotState, now_ns: i64) -> Result<Option<Event>, Event> {
        self.one_publisher(state)?;
        // First: what a robot in FAULT reports beside it may be no state.
        if let Some(unfit) = state.operating.and_then(Unfit::of) {
            return Err(Event::NotOperating(unfit));
        }
        state.check()?;
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

    /// Time is `now_ns` of our clock: are the robot and its tip still there? One event for each
    /// silence.
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
        let tip_age = (self.tip.filter(|_| !self.tip_silent)).map_or(0.0, |tip| age_s(tip.at_ns));
        if age.max(tip_age) <= limit_s {
            return None;
        }
        // A state may have been joined with an older tip. Where the robot ends, its tip is too old
        // first then: where no state came for most of that time either, its joints do not go on.
        if age > limit_s.min(tip_age / 2.0) {
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

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests;
