//! What a ROS client's thread brings, and how it becomes a [`Poll`]: the same for ROS 1 and ROS 2.

use crate::geometry::Pair;
use robot::crtk::{self, frame_of_force, Adapter, AdapterConfig, Header, Topic, Topics};
use robot::ravenstate::{self, Ravenstate};
use robot::source::{arrival, sift, Estimate, Poll};
use robot::state::{Acts, Frame, Meaning, Mount, RobotState, StateError, TipForce};
use robot::watch::{Watch, WatchConfig};
use std::sync::mpsc::{channel, Receiver, Sender};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What the subscriptions bring.
pub(crate) enum Incoming {
    /// A message of one of the robot's topics, with its publisher.
    Crtk(Arc<str>, Header, Topic),
    /// The Raven's own message.
    #[cfg_attr(not(feature = "ros1"), allow(dead_code))] // it exists in ROS 1 only
    Raven(Box<Ravenstate>),
    /// `servo_cf`.
    Request(Pair),
    /// `state_command`.
    Command(String),
    /// Messages that were dropped because nobody polled, or that could not be read.
    Bad(String),
}

/// Takes what came, with its time.
pub(crate) type Outlet = Sender<(Instant, Incoming)>;

/// The other end: adapters, mount and watch.
pub(crate) struct Intake {
    incoming: Receiver<(Instant, Incoming)>,
    adapter: Adapter,
    raven: Option<ravenstate::Adapter>,
    frame: Frame,
    /// The frame's name as the robot tells it, empty where it tells none.
    frame_id: Arc<str>,
    mount: Mount,
    watch: Watch,
}

impl Intake {
    /// An intake, and what fills it.
    pub fn new(
        adapter: &AdapterConfig,
        raven: Option<ravenstate::Adapter>,
        mount: Mount,
        watch: &WatchConfig,
    ) -> (Outlet, Self) {
        let (outlet, incoming) = channel();
        let intake = Self {
            incoming,
            frame: adapter.frame.clone(),
            frame_id: "".into(),
            adapter: Adapter::new(adapter.clone()),
            raven,
            mount,
            watch: Watch::new(watch.clone()),
        };
        (outlet, intake)
    }

    /// What has come. Without `trusted` nobody knows whose states these are, and they are left out.
    pub fn poll(&mut self, now_ns: i64, trusted: bool) -> Poll {
        let polled = Instant::now();
        let mut states: Vec<Result<RobotState, StateError>> = Vec::new();
        let mut requests = Vec::new();
        let mut commands = Vec::new();
        while let Ok((came, incoming)) = self.incoming.try_recv() {
            let received = Some(arrival(now_ns, polled, came));
            let at = |state: RobotState| RobotState { received, ..state };
            match incoming {
                Incoming::Crtk(publisher, header, topic) => {
                    let state = self.adapter.take(&publisher, &header, topic).transpose();
                    states.extend(state.map(|state| state.map(at)));
                }
                Incoming::Raven(message) => {
                    let raven = self.raven.as_ref();
                    states.extend(raven.map(|raven| Ok(at(raven.state(&message)))));
                }
                Incoming::Request(wrench) => match self.request(&wrench.into()) {
                    Ok(request) => requests.push(request),
                    Err(error) => states.push(Err(error)),
                },
                Incoming::Command(command) => commands.push(command),
                Incoming::Bad(why) => states.push(Err(StateError::Format(why))),
            }
        }
        if !trusted {
            states.retain(Result::is_err);
        }
        let mut poll = sift(states, &mut self.watch, &self.mount, now_ns);
        poll.requests = requests;
        poll.commands = commands;
        let told = |state: &RobotState| state.tip.as_ref().map(|tip| Arc::clone(&tip.frame_id));
        if let Some(frame_id) = poll.states.iter().rev().find_map(told) {
            self.frame_id = frame_id;
        }
        poll
    }

    /// A force that is asked for: on the tool, in the frame of the robot's poses.
    fn request(&self, wrench: &crtk::Pair) -> Result<TipForce, StateError> {
        let request = TipForce {
            frame: self.frame.clone(),
            acts: Acts::OnTool,
            meaning: Meaning::Requested,
            force_n: wrench.linear,
            torque_n_m: Some(wrench.angular),
        };
        if wrench.linear.iter().all(|v| v.is_finite()) {
            Ok(self.mount.force_in_rig(&request))
        } else {
            let asked = wrench.linear;
            Err(StateError::Format(format!("servo_cf asks for {asked:?} N")))
        }
    }

    /// A force as we publish it: name of the frame, force and torque *on the tool*. The frame is
    /// that of the robot's poses, by the name that the robot gives it: tf knows that one.
    pub fn wrench(&self, force: &TipForce) -> (String, Pair) {
        let force = (self.mount).force_from_rig(&force.acting(Acts::OnTool), self.frame.clone());
        let wrench = Pair {
            linear: force.force_n.into(),
            angular: force.torque_n_m.unwrap_or_default().into(),
        };
        let frame_id = match &*self.frame_id {
            "" => force.frame.to_string(),
            told => told.to_owned(),
        };
        (frame_id, wrench)
    }

    /// The half widths of an estimate, in the place of a force, in the frame in which we publish
    /// it.
    pub fn half_width(&self, estimate: &Estimate) -> Option<(String, Pair)> {
        let half_n = estimate.half_n?;
        let as_force = TipForce {
            force_n: half_n,
            torque_n_m: None,
            ..estimate.force.clone()
        };
        let (frame, mut pair) = self.wrench(&as_force);
        let turned: [f64; 3] = pair.linear.into();
        // A ball is the same in every frame. A width along an axis has no sign.
        let ball = half_n[0] == half_n[1] && half_n[1] == half_n[2];
        pair.linear = if ball { half_n } else { turned.map(f64::abs) }.into();
        Some((frame, pair))
    }
}

/// A stamp as a time since 1970. CRTK marks data with a stamp of 0 as invalid: a time before that
/// is one.
pub(crate) fn since_1970(t_ns: i64) -> Duration {
    Duration::from_nanos(u64::try_from(t_ns).unwrap_or(0))
}

/// Namespace of the rig as a CRTK device: the one below which its forces are, less their frame.
pub(crate) fn device(publish: &str) -> &str {
    match publish.rsplit_once('/') {
        Some((device, "spatial" | "body" | "local")) => device,
        _ => publish,
    }
}

/// The adapter of a robot with these topics.
pub(crate) fn adapter_for(config: &AdapterConfig, topics: &Topics) -> AdapterConfig {
    let by_name = || frame_of_force(&topics.measured_cf, &config.frame);
    AdapterConfig {
        force_frame: Some(config.force_frame.clone().unwrap_or_else(by_name)),
        ..config.clone()
    }
}
