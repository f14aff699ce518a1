//! A robot on ROS 1: CRTK topics or the Raven's `ravenstate` in, the rig's force out.
//!
//! We subscribe `measured_js`, `setpoint_js`, `measured_cp`, `measured_cv`, `measured_cf` and `operating_state` below the robot's
//! namespace (or one `ravenstate`), publish `measured_cf`, `setpoint_cf` and an estimator's `measured_cf_estimated` below our own, and take `servo_cf` there. All
//! forces that we publish act *on the tool* and say so: their frame_id is `<frame>/force_on_tool`. The other nodes, a bag
//! recorder among them, need nothing of ours.
//!
//! The client is roslibrust on a thread of its own; [`Source::poll`] takes what has come. roslibrust joins all publishers of a
//! topic without telling them apart, so the master is asked for their names twice a second.

mod master;
mod messages;

use super::intake::{Incoming, Intake, Outlet};
use super::{Poll, Ros1Config, Source, SourceError};
use crate::crtk::{Header, Joints, Topic};
use crate::ravenstate::{self, Ravenstate, Version};
use crate::state::TipForce;
use crate::watch::Event;
use messages as m;
use roslibrust::ros1::{NodeHandle, Publisher};
use roslibrust::RosMessageType;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::runtime::Runtime;

/// Messages of a topic that wait at most: a second at 1 kHz.
const QUEUE: usize = 1_000;
/// Between two looks at who publishes.
const LOOK: Duration = Duration::from_millis(500);
/// For the master's answers at the start.
const PATIENCE: Duration = Duration::from_secs(5);

/// See the module's page.
pub struct Ros1 {
    config: Ros1Config,
    master: String,
    // Dropped first to last: the node before its runtime.
    intake: Intake,
    publishers: Arc<Mutex<Vec<String>>>,
    measured_cf: Publisher<m::WrenchStamped>,
    setpoint_cf: Publisher<m::WrenchStamped>,
    estimated_cf: Publisher<m::WrenchStamped>,
    node: NodeHandle,
    runtime: Runtime,
    sequence: u32,
    reported_two: bool,
}

impl std::fmt::Debug for Ros1 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ros1")
            .field("master", &self.master)
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
        let master = config
            .master
            .clone()
            .or_else(|| std::env::var("ROS_MASTER_URI").ok())
            .unwrap_or_else(|| "http://localhost:11311".to_owned());
        let ros = |why: String| SourceError::Ros {
            master: master.clone(),
            why,
        };
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
        let (sender, intake) =
            Intake::new(&config.adapter, Some(raven), config.mount, &config.watch);
        let publishers = Arc::new(Mutex::new(Vec::new()));
        let started = runtime.block_on(async {
            tokio::time::timeout(PATIENCE, start(config, &master, sender)).await
        });
        let (node, [measured_cf, setpoint_cf, estimated_cf]) = started
            .map_err(|_| ros(format!("no answer within {} s", PATIENCE.as_secs())))?
            .map_err(ros)?;
        let topic = state_topic(config);
        look(master.clone(), config.node.clone(), topic, &publishers);
        Ok(Self {
            intake,
            publishers,
            measured_cf,
            setpoint_cf,
            estimated_cf,
            node,
            runtime,
            sequence: 0,
            reported_two: false,
            config: config.clone(),
            master,
        })
    }

    /// Event where more than one node publishes the states; one until it is one node again.
    fn two_publishers(&mut self) -> Option<Event> {
        let names = self
            .publishers
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        match names.as_slice() {
            [first, second, ..] => {
                let event = Event::TwoPublishers {
                    first: first.as_str().into(),
                    second: second.as_str().into(),
                };
                (!std::mem::replace(&mut self.reported_two, true)).then_some(event)
            }
            _ => {
                self.reported_two = false;
                None
            }
        }
    }

    fn wrench(&self, force: &TipForce) -> m::WrenchStamped {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let (frame_id, wrench) = self.intake.wrench(force);
        m::WrenchStamped {
            header: m::Header {
                seq: self.sequence,
                stamp: m::Time {
                    secs: now.as_secs() as u32,
                    nsecs: now.subsec_nanos(),
                },
                frame_id,
            },
            wrench,
        }
    }
}

/// Topic that the states come from.
fn state_topic(config: &Ros1Config) -> String {
    match &config.ravenstate {
        Some(topic) => topic.clone(),
        None if config.adapter.joints => format!("{}/measured_js", config.namespace),
        None => format!("{}/measured_cp", cp_namespace(config)),
    }
}

fn cp_namespace(config: &Ros1Config) -> &str {
    config.cp_namespace.as_deref().unwrap_or(&config.namespace)
}

type Started = (NodeHandle, [Publisher<m::WrenchStamped>; 3]);

/// Node, subscriptions and publishers.
async fn start(config: &Ros1Config, master: &str, to: Outlet) -> Result<Started, String> {
    let node = NodeHandle::new(master, &config.node)
        .await
        .map_err(|error| error.to_string())?;
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
    Ok((node, [measured_cf, setpoint_cf, estimated_cf]))
}

async fn subscribe_crtk(node: &NodeHandle, config: &Ros1Config, to: &Outlet) -> Result<(), String> {
    let by = Subscriber {
        node,
        to,
        publisher: state_topic(config).into(),
    };
    let topic = |name: &str| format!("{}/{name}", config.namespace);
    let cp = |name: &str| format!("{}/{name}", cp_namespace(config));
    by.crtk(&topic("measured_js"), |m: m::JointState| {
        (header(&m.header), Topic::MeasuredJs(joints(m)))
    })
    .await?;
    by.crtk(&topic("setpoint_js"), |m: m::JointState| {
        (header(&m.header), Topic::SetpointJs(joints(m)))
    })
    .await?;
    if config.cp_is_transform {
        by.crtk(&cp("measured_cp"), |m: m::TransformStamped| {
            (header(&m.header), Topic::MeasuredCp(m.transform.into()))
        })
        .await?;
    } else {
        by.crtk(&cp("measured_cp"), |m: m::PoseStamped| {
            (header(&m.header), Topic::MeasuredCp(m.pose.into()))
        })
        .await?;
    }
    by.crtk(&cp("measured_cv"), |m: m::TwistStamped| {
        (header(&m.header), Topic::MeasuredCv(m.twist.into()))
    })
    .await?;
    by.crtk(&cp("measured_cf"), |m: m::WrenchStamped| {
        (header(&m.header), Topic::MeasuredCf(m.wrench.into()))
    })
    .await?;
    by.crtk(&topic("operating_state"), |m: m::OperatingState| {
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

/// Asks the master now and then who publishes `topic`, for as long as somebody wants to know.
fn look(master: String, node: String, topic: String, publishers: &Arc<Mutex<Vec<String>>>) {
    let publishers = Arc::downgrade(publishers);
    std::thread::spawn(move || {
        while let Some(publishers) = publishers.upgrade() {
            if let Ok(names) = master::publishers(&master, &node, &topic) {
                *publishers.lock().unwrap_or_else(PoisonError::into_inner) = names;
            }
            drop(publishers);
            std::thread::sleep(LOOK);
        }
    });
}

impl Source for Ros1 {
    fn name(&self) -> String {
        format!("ROS 1 {}, {}", self.master, state_topic(&self.config))
    }

    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError> {
        let two = self.two_publishers();
        let mut poll = self.intake.poll(now_ns, !self.reported_two);
        poll.events.extend(two);
        if self.node.is_ok() {
            Ok(poll)
        } else {
            Err(SourceError::Ros {
                master: self.master.clone(),
                why: "our node has ended".to_owned(),
            })
        }
    }

    fn publish(&mut self, applied: &TipForce, setpoint: &TipForce) -> Result<(), SourceError> {
        self.sequence = self.sequence.wrapping_add(1);
        let (applied, setpoint) = (self.wrench(applied), self.wrench(setpoint));
        let sent = self.runtime.block_on(async {
            self.measured_cf.publish(&applied).await?;
            self.setpoint_cf.publish(&setpoint).await
        });
        sent.map_err(|error| SourceError::Ros {
            master: self.master.clone(),
            why: error.to_string(),
        })
    }

    fn publish_estimate(&mut self, estimated: &TipForce) -> Result<(), SourceError> {
        self.sequence = self.sequence.wrapping_add(1);
        let estimated = self.wrench(estimated);
        let sent = self.runtime.block_on(self.estimated_cf.publish(&estimated));
        sent.map_err(|error| SourceError::Ros {
            master: self.master.clone(),
            why: error.to_string(),
        })
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
