//! A robot on ROS 1: CRTK topics or the Raven's `ravenstate` in, the rig's force out.
//!
//! We subscribe `measured_js`, `setpoint_js`, `measured_cp`, `measured_cv`, `measured_cf` and
//! `operating_state` below the robot's namespace (or one `ravenstate`), publish `measured_cf`,
//! `setpoint_cf` and an estimator's `measured_cf_estimated` below our own, and take `servo_cf`
//! there. All forces that we publish act *on the tool*, in the frame of the robot's poses by the
//! name that the robot gives it. As a CRTK device we publish `operating_state`, latched, and take
//! `state_command`. The other nodes, a bag recorder among them, need nothing of ours.
//!
//! The client is roslibrust on a thread of its own; [`Source::poll`] takes what has come.
//! roslibrust joins all publishers of a topic without telling them apart, so the master is asked
//! twice a second for their names and for the topics' types.

mod front;
mod master;
mod messages;

use crate::intake::{adapter_for, device, since_1970, Incoming, Intake, Outlet};
use front::Front;
use master::Master;
use messages as m;
use robot::crtk::{Header, Joints, Topic};
use robot::ravenstate::{self, Ravenstate, Version};
use robot::source::{Estimate, Poll, Ros1Config, Source, SourceError};
use robot::state::{Operating, OperatingState, StateError, TipForce};
use robot::watch::Event;
use roslibrust::ros1::{NodeHandle, Publisher};
use roslibrust::RosMessageType;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::runtime::Runtime;

/// Messages of a topic that wait at most: a second at 1 kHz.
const QUEUE: usize = 1_000;
/// Between two looks at who publishes.
const LOOK: Duration = Duration::from_millis(500);
/// For the start: each topic waits for its publishers, and one that was killed is tried for
/// seconds.
const PATIENCE: Duration = Duration::from_secs(20);

/// See the module's page.
pub struct Ros1 {
    config: Ros1Config,
    master: Master,
    // Dropped first to last: the node before its runtime.
    intake: Intake,
    seen: Arc<Mutex<Seen>>,
    measured_cf: Publisher<m::WrenchStamped>,
    setpoint_cf: Publisher<m::WrenchStamped>,
    estimated_cf: Publisher<m::WrenchStamped>,
    estimated_half_width: Publisher<m::WrenchStamped>,
    operating: Publisher<m::OperatingState>,
    node: NodeHandle,
    runtime: Runtime,
    // Its node unregisters through it.
    _front: Front,
    sequence: u32,
    reported_two: bool,
    /// What was told once.
    told: BTreeSet<String>,
}

/// What the master says of the topics that the states come from.
#[derive(Debug, Default)]
struct Seen {
    /// Two nodes that publish the same one, both alive.
    two: Option<[String; 2]>,
    /// Nodes that are registered as publishers beside another and don't answer, with the topic.
    dead: Vec<(String, String)>,
    /// A topic of another type.
    wrong: Option<StateError>,
}

/// A topic that is watched, and its type.
type Watched = (String, &'static str);

impl std::fmt::Debug for Ros1 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ros1")
            .field("master", &self.master.uri)
            .finish_non_exhaustive()
    }
}

impl Ros1 {
    /// Connects to the master and subscribes.
    ///
    /// # Errors
    /// [`SourceError::Ros`] where there is no master or it refuses, [`SourceError::Mount`].
    pub fn open(config: &Ros1Config) -> Result<Self, SourceError> {
        config.mount.check().map_err(SourceError::Mount)?;
        let uri = config
            .master
            .clone()
            .or_else(|| std::env::var("ROS_MASTER_URI").ok())
            .unwrap_or_else(|| "http://localhost:11311".to_owned());
        let ros = |why: String| SourceError::Ros {
            master: uri.clone(),
            why,
        };
        let there = |why: String| SourceError::RosNode {
            master: uri.clone(),
            why,
        };
        let name = format!("/{}", config.node.trim_start_matches('/'));
        let master = Master {
            uri: uri.clone(),
            caller: name.clone(),
        };
        // The master ends whoever has the name already: that may be a run that holds a force.
        let taken = master.node(&name).map_err(|error| ros(error.to_string()))?;
        if let Some(by) = taken.filter(|_| master.is_alive(&name)) {
            return Err(there(format!(
                "the node name `{name}` is taken by a program at {by}; is another forcectl running? Set `node` in [robot] to another name, or end that program"
            )));
        }
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .map_err(|error| ros(error.to_string()))?;
        let raven = ravenstate::Adapter::gold(
            Version::V2023,
            config.ravenstate_slot.into(),
            &state_topic(config),
        );
        let adapter = adapter_for(&config.adapter, &config.topics());
        let (sender, intake) = Intake::new(&adapter, Some(raven), config.mount, &config.watch);
        let front = Front::open(&master).map_err(|error| there(error.to_string()))?;
        let started = runtime.block_on(async {
            tokio::time::timeout(PATIENCE, start(config, &front, sender)).await
        });
        let watched = watched(config);
        let (node, ours, operating) = started
            .map_err(|_| {
                let dead = look(&master, &watched, 0).dead;
                let dead: Vec<String> = dead.into_iter().map(|(name, _)| name).collect();
                there(if dead.is_empty() {
                    format!("the topics did not open within {} s", PATIENCE.as_secs())
                } else {
                    format!(
                        "the topics did not open within {} s: {dead:?} are registered as publishers and don't answer; `rosnode cleanup` removes them",
                        PATIENCE.as_secs()
                    )
                })
            })?
            .map_err(there)?;
        let [measured_cf, setpoint_cf, estimated_cf, estimated_half_width] = ours;
        let seen = Arc::new(Mutex::new(Seen::default()));
        keep_looking(master.clone(), watched, &seen);
        let mut source = Self {
            intake,
            seen,
            measured_cf,
            setpoint_cf,
            estimated_cf,
            estimated_half_width,
            node,
            runtime,
            _front: front,
            sequence: 0,
            reported_two: false,
            told: BTreeSet::new(),
            operating,
            config: config.clone(),
            master,
        };
        source.publish_operating(OperatingState {
            state: Operating::Disabled,
            is_homed: true,
            is_busy: false,
        })?;
        Ok(source)
    }

    /// Events of what the master says: each once, two publishers once until it is one again.
    fn news(&mut self) -> Vec<Event> {
        let mut news = Vec::new();
        let seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        match &seen.two {
            Some([first, second]) => {
                if !std::mem::replace(&mut self.reported_two, true) {
                    news.push(Event::TwoPublishers {
                        first: first.as_str().into(),
                        second: second.as_str().into(),
                    });
                }
            }
            None => self.reported_two = false,
        }
        for (name, topic) in &seen.dead {
            if self.told.insert(format!("{name} {topic}")) {
                news.push(Event::DeadPublisher {
                    name: name.clone(),
                    topic: topic.clone(),
                });
            }
        }
        if let Some(wrong) = &seen.wrong {
            if self.told.insert(wrong.to_string()) {
                news.push(Event::Invalid(wrong.clone()));
            }
        }
        news
    }

    fn failed(&self, why: String) -> SourceError {
        SourceError::RosNode {
            master: self.master.uri.clone(),
            why,
        }
    }

    fn wrench(&self, force: &TipForce) -> m::WrenchStamped {
        let (frame_id, wrench) = self.intake.wrench(force);
        m::WrenchStamped {
            header: self.header(frame_id),
            wrench,
        }
    }

    fn header(&self, frame_id: String) -> m::Header {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        self.header_at(frame_id, now)
    }

    /// A header with a time since 1970.
    fn header_at(&self, frame_id: String, at: Duration) -> m::Header {
        m::Header {
            seq: self.sequence,
            stamp: m::Time {
                secs: at.as_secs() as u32,
                nsecs: at.subsec_nanos(),
            },
            frame_id,
        }
    }
}

/// Topic that the states come from.
fn state_topic(config: &Ros1Config) -> String {
    match &config.ravenstate {
        Some(topic) => topic.clone(),
        None if config.adapter.joints => config.topics().measured_js,
        None => config.topics().measured_cp,
    }
}

fn cp_is_transform(config: &Ros1Config) -> bool {
    (config.cp_is_transform).unwrap_or(config.adapter.robot.cp_is_transform())
}

/// Topics on which the force depends, and the one that makes states.
fn watched(config: &Ros1Config) -> Vec<Watched> {
    if let Some(topic) = &config.ravenstate {
        return vec![(topic.clone(), m::RavenState::DESCRIPTION.ros_type_name)];
    }
    let topics = config.topics();
    let pose = if cp_is_transform(config) {
        m::TransformStamped::DESCRIPTION.ros_type_name
    } else {
        m::PoseStamped::DESCRIPTION.ros_type_name
    };
    let joints = m::JointState::DESCRIPTION.ros_type_name;
    let joints = (config.adapter.joints).then_some((topics.measured_js, joints));
    joints
        .into_iter()
        .chain([(topics.measured_cp, pose)])
        .collect()
}

type Started = (
    NodeHandle,
    [Publisher<m::WrenchStamped>; 4],
    Publisher<m::OperatingState>,
);

/// Node, subscriptions and publishers.
async fn start(config: &Ros1Config, front: &Front, to: Outlet) -> Result<Started, String> {
    let node = NodeHandle::new(&front.master_uri, &config.node)
        .await
        .map_err(|error| error.to_string())?;
    let own = node.get_client_uri().await;
    front.stands_for(&own.map_err(|error| error.to_string())?);
    if let Some(topic) = &config.ravenstate {
        subscribe::<m::RavenState>(&node, topic, &to, |message| {
            Incoming::Raven(Box::new(raven(&message)))
        })
        .await?;
    } else {
        subscribe_crtk(&node, config, &to).await?;
    }
    let own = |topic: &str| format!("{}/{topic}", config.publish);
    subscribe(&node, &own("servo_cf"), &to, |message: m::WrenchStamped| {
        Incoming::Request(message.wrench)
    })
    .await?;
    let advertise = |topic: String| {
        let node = node.clone();
        async move {
            node.advertise::<m::WrenchStamped>(&topic, QUEUE, false)
                .await
                .map_err(|error| format!("{topic}: {error}"))
        }
    };
    let measured_cf = advertise(own("measured_cf")).await?;
    let setpoint_cf = advertise(own("setpoint_cf")).await?;
    let estimated_cf = advertise(own("measured_cf_estimated")).await?;
    let half_width = advertise(own("measured_cf_estimated_half_width")).await?;
    let of_device = |topic: &str| format!("{}/{topic}", device(&config.publish));
    subscribe(
        &node,
        &of_device("state_command"),
        &to,
        |message: m::StringStamped| Incoming::Command(message.string),
    )
    .await?;
    let topic = of_device("operating_state");
    let operating = node
        .advertise::<m::OperatingState>(&topic, QUEUE, true)
        .await;
    let operating = operating.map_err(|error| format!("{topic}: {error}"))?;
    let ours = [measured_cf, setpoint_cf, estimated_cf, half_width];
    Ok((node, ours, operating))
}

async fn subscribe_crtk(node: &NodeHandle, config: &Ros1Config, to: &Outlet) -> Result<(), String> {
    let by = Subscriber {
        node,
        to,
        publisher: state_topic(config).into(),
    };
    let of = config.topics();
    by.crtk(&of.measured_js, |m: m::JointState| {
        (header(&m.header), Topic::MeasuredJs(joints(m)))
    })
    .await?;
    by.crtk(&of.setpoint_js, |m: m::JointState| {
        (header(&m.header), Topic::SetpointJs(joints(m)))
    })
    .await?;
    if cp_is_transform(config) {
        by.crtk(&of.measured_cp, |m: m::TransformStamped| {
            (header(&m.header), Topic::MeasuredCp(m.transform.into()))
        })
        .await?;
    } else {
        by.crtk(&of.measured_cp, |m: m::PoseStamped| {
            (header(&m.header), Topic::MeasuredCp(m.pose.into()))
        })
        .await?;
    }
    by.crtk(&of.measured_cv, |m: m::TwistStamped| {
        (header(&m.header), Topic::MeasuredCv(m.twist.into()))
    })
    .await?;
    by.crtk(&of.measured_cf, |m: m::WrenchStamped| {
        (header(&m.header), Topic::MeasuredCf(m.wrench.into()))
    })
    .await?;
    by.crtk(&of.operating_state, |m: m::OperatingState| {
        let operating = Topic::OperatingState(m.state, m.is_homed, m.is_busy);
        (header(&m.header), operating)
    })
    .await
}

/// Subscribes topics of the robot.
struct Subscriber<'a> {
    node: &'a NodeHandle,
    to: &'a Outlet,
    publisher: Arc<str>,
}

impl Subscriber<'_> {
    async fn crtk<T: RosMessageType>(
        &self,
        topic: &str,
        convert: fn(T) -> (Header, Topic),
    ) -> Result<(), String> {
        let publisher = Arc::clone(&self.publisher);
        subscribe::<T>(self.node, topic, self.to, move |message| {
            let (header, topic) = convert(message);
            Incoming::Crtk(Arc::clone(&publisher), header, topic)
        })
        .await
    }
}

/// Passes the messages of a topic on until either side is gone.
async fn subscribe<T: RosMessageType>(
    node: &NodeHandle,
    topic: &str,
    to: &Outlet,
    convert: impl Fn(T) -> Incoming + Send + 'static,
) -> Result<(), String> {
    let mut subscriber = node
        .subscribe::<T>(topic, QUEUE)
        .await
        .map_err(|error| format!("{topic}: {error}"))?;
    let (to, topic) = (to.clone(), topic.to_owned());
    tokio::spawn(async move {
        while let Some(message) = subscriber.next().await {
            let incoming = match message {
                Ok(message) => convert(message),
                Err(error) => Incoming::Bad(format!("{topic}: {error}")),
            };
            if to.send((Instant::now(), incoming)).is_err() {
                break;
            }
        }
    });
    Ok(())
}

/// What the master says of topics now; a node counts as dead beside `beside` others and more. What
/// it does not answer is as it should be.
fn look(master: &Master, topics: &[Watched], beside: usize) -> Seen {
    let mut seen = Seen::default();
    for (topic, expected) in topics {
        let names = master.publishers(topic).unwrap_or_default();
        if names.len() > beside {
            let (alive, dead): (Vec<String>, Vec<String>) =
                names.into_iter().partition(|name| master.is_alive(name));
            if let [first, second, ..] = alive.as_slice() {
                seen.two = Some([first.clone(), second.clone()]);
            }
            seen.dead
                .extend(dead.into_iter().map(|name| (name, topic.clone())));
        }
        let found = master.type_of(topic).ok().flatten();
        if let Some(found) = found.filter(|found| found != expected && found != "*") {
            seen.wrong = Some(StateError::TopicType {
                topic: topic.clone(),
                found,
                expected: (*expected).to_owned(),
            });
        }
    }
    seen
}

/// Asks the master now and then, for as long as somebody wants to know.
fn keep_looking(master: Master, topics: Vec<Watched>, seen: &Arc<Mutex<Seen>>) {
    let seen = Arc::downgrade(seen);
    std::thread::spawn(move || {
        while let Some(seen) = seen.upgrade() {
            let now = look(&master, &topics, 1);
            *seen.lock().unwrap_or_else(PoisonError::into_inner) = now;
            drop(seen);
            std::thread::sleep(LOOK);
        }
    });
}

impl Source for Ros1 {
    fn name(&self) -> String {
        format!("ROS 1 {}, {}", self.master.uri, state_topic(&self.config))
    }

    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError> {
        let news = self.news();
        let mut poll = self.intake.poll(now_ns, !self.reported_two);
        poll.events.extend(news);
        if self.node.is_ok() {
            Ok(poll)
        } else {
            Err(self.failed(format!(
                "our node `{}` was ended from outside: another program has taken its name (`node` in [robot]), or `rosnode kill`",
                self.master.caller
            )))
        }
    }

    fn publish(&mut self, applied: &TipForce, setpoint: &TipForce) -> Result<(), SourceError> {
        self.sequence = self.sequence.wrapping_add(1);
        let (applied, setpoint) = (self.wrench(applied), self.wrench(setpoint));
        let sent = self.runtime.block_on(async {
            self.measured_cf.publish(&applied).await?;
            self.setpoint_cf.publish(&setpoint).await
        });
        sent.map_err(|error| self.failed(format!("a force can't be published: {error}")))
    }

    fn publish_operating(&mut self, operating: OperatingState) -> Result<(), SourceError> {
        self.sequence = self.sequence.wrapping_add(1);
        let message = m::OperatingState {
            header: self.header(String::new()),
            state: operating.state.word().to_owned(),
            is_homed: operating.is_homed,
            is_busy: operating.is_busy,
        };
        let sent = self.runtime.block_on(self.operating.publish(&message));
        sent.map_err(|error| self.failed(format!("operating_state can't be published: {error}")))
    }

    fn publish_estimate(&mut self, estimate: &Estimate) -> Result<(), SourceError> {
        self.sequence = self.sequence.wrapping_add(1);
        let at = since_1970(estimate.stamp.t_ns);
        let stamped = |(frame_id, wrench)| m::WrenchStamped {
            header: self.header_at(frame_id, at),
            wrench,
        };
        let force = stamped(self.intake.wrench(&estimate.force));
        let half = self.intake.half_width(estimate).map(stamped);
        let sent = self.runtime.block_on(async {
            if let Some(half) = &half {
                self.estimated_half_width.publish(half).await?;
            }
            self.estimated_cf.publish(&force).await
        });
        sent.map_err(|error| self.failed(format!("a force can't be published: {error}")))
    }
}

fn header(header: &m::Header) -> Header {
    Header {
        seq: Some(header.seq),
        stamp_ns: i64::from(header.stamp.secs) * 1_000_000_000 + i64::from(header.stamp.nsecs),
        frame_id: header.frame_id.clone(),
    }
}

fn joints(message: m::JointState) -> Joints {
    Joints {
        name: message.name,
        position: message.position,
        velocity: message.velocity,
        effort: message.effort,
    }
}

fn raven(message: &m::RavenState) -> Ravenstate {
    let both = |ori: &[[f32; 9]; 2]| core::array::from_fn(|i| ori[i / 9][i % 9]);
    Ravenstate {
        stamp: (message.hdr.stamp.secs, message.hdr.stamp.nsecs),
        seq: message.hdr.seq,
        runlevel: message.runlevel,
        sublevel: message.sublevel,
        last_seq: message.last_seq,
        r#type: message.r#type,
        pos: message.pos,
        ori: both(&message.ori),
        ori_d: both(&message.ori_d),
        pos_d: message.pos_d,
        dt_ns: i64::from(message.dt.secs) * 1_000_000_000 + i64::from(message.dt.nsecs),
        enc_vals: message.encVals,
        dac_val: Some(message.dac_val),
        tau: message.tau,
        mpos: message.mpos,
        jpos: message.jpos,
        mvel: message.mvel,
        jvel: message.jvel,
        mpos_d: message.mpos_d,
        jpos_d: message.jpos_d,
        grasp_d: message.grasp_d,
        encoffsets: message.encoffsets,
        jac_vel: message.jac_vel,
        jac_f: message.jac_f,
    }
}
