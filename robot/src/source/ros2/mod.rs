//! A robot on ROS 2: CRTK topics in, the rig's force out.
//!
//! The same topics as over ROS 1: we subscribe `measured_js`, `setpoint_js`, `measured_cp`, `measured_cv`, `measured_cf` and
//! `operating_state` below the robot's namespace, publish `measured_cf` and `setpoint_cf` below our own, and take `servo_cf`
//! there. Subscriptions are best effort, which fits every publisher; what we publish is reliable. A message carries its
//! publisher's identity, so two publishers of a topic are told apart message by message.
//!
//! The client is ros2-client on RustDDS. A thread takes what has come, so that each message has its time of arrival.

mod messages;

use super::intake::{Incoming, Intake, Outlet};
use super::{Poll, Ros2Config, Source, SourceError};
use crate::crtk::{self, Topic};
use crate::state::TipForce;
use messages as m;
use ros2_client::qos::{Durability, History, Reliability, WhenFull};
use ros2_client::{
    Context, ContextOptions, Message, MessageTypeName, Name, Node, NodeName, NodeOptions,
    Publisher, QosProfile, Subscription,
};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Messages of a topic that wait at most: a second at 1 kHz.
const QUEUE: usize = 1_000;
/// Messages of ours that are kept for slow readers.
const KEPT: usize = 10;
/// Between two looks for messages: the resolution of their arrival.
const LOOK: Duration = Duration::from_micros(500);

/// See the module's page.
pub struct Ros2 {
    config: Ros2Config,
    domain: u16,
    intake: Intake,
    measured_cf: Publisher<m::PairStamped>,
    setpoint_cf: Publisher<m::PairStamped>,
    /// Dropped with the source: the thread ends then.
    _alive: Arc<()>,
    _node: Node,
}

impl std::fmt::Debug for Ros2 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ros2")
            .field("domain", &self.domain)
            .finish_non_exhaustive()
    }
}

impl Ros2 {
    /// Joins the domain and subscribes. A robot that is not there yet is no error.
    ///
    /// # Errors
    /// [`SourceError::Ros2`] where the network or a name is refused, [`SourceError::Mount`].
    pub fn open(config: &Ros2Config) -> Result<Self, SourceError> {
        config.mount.check().map_err(SourceError::Mount)?;
        let domain = domain(config)?;
        let failed = |why: String| SourceError::Ros2 { domain, why };
        let options = ContextOptions::new().domain_id(domain);
        let context = Context::with_options(options).map_err(|error| failed(error.to_string()))?;
        let name = NodeName::new("/", &config.node).map_err(|error| failed(error.to_string()))?;
        let mut node = (context.new_node(name, NodeOptions::new()))
            .map_err(|error| failed(error.to_string()))?;
        let (to, intake) = Intake::new(&config.adapter, None, config.mount, &config.watch);
        let topics = Topics {
            node: &mut node,
            config,
        };
        let (subscriptions, measured_cf, setpoint_cf) = topics.all().map_err(failed)?;
        let alive = Arc::new(());
        let weak = Arc::downgrade(&alive);
        std::thread::Builder::new()
            .name("robot states over ROS 2".to_owned())
            .spawn(move || receive(&subscriptions, &weak, &to))
            .map_err(|error| failed(error.to_string()))?;
        Ok(Self {
            config: config.clone(),
            domain,
            intake,
            measured_cf,
            setpoint_cf,
            _alive: alive,
            _node: node,
        })
    }

    fn wrench(&self, force: &TipForce) -> m::PairStamped {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let (frame_id, pair) = self.intake.wrench(force);
        m::PairStamped {
            header: m::Header {
                stamp: m::Time {
                    sec: now.as_secs() as i32,
                    nanosec: now.subsec_nanos(),
                },
                frame_id,
            },
            pair,
        }
    }
}

/// Highest domain: its ports, 7400 + 250 domain and up to 250 more, must be below 65536 (DDSI-RTPS 2.5 section 9.6.2.3).
const LAST_DOMAIN: u16 = 232;

/// The domain: of the configuration, else of ROS_DOMAIN_ID, else 0.
fn domain(config: &Ros2Config) -> Result<u16, SourceError> {
    if let Some(domain) = config.domain {
        return if domain <= LAST_DOMAIN {
            Ok(domain)
        } else {
            Err(SourceError::Config {
                key: "domain",
                why: format!("{domain} is not a number from 0 to {LAST_DOMAIN}"),
            })
        };
    }
    let Ok(text) = std::env::var("ROS_DOMAIN_ID") else {
        return Ok(0);
    };
    let number = text.trim().parse().ok();
    number
        .filter(|domain| *domain <= LAST_DOMAIN)
        .ok_or_else(|| SourceError::Config {
            key: "domain",
            why: format!(
                "ROS_DOMAIN_ID is `{text}`, which is not a number from 0 to {LAST_DOMAIN}"
            ),
        })
}

/// A subscription, whatever its type: passes on what has come.
type Look = Box<dyn Fn(&Outlet) -> bool + Send>;

type All = (
    Vec<Look>,
    Publisher<m::PairStamped>,
    Publisher<m::PairStamped>,
);

/// Makes the topics of a node.
struct Topics<'a> {
    node: &'a mut Node,
    config: &'a Ros2Config,
}

impl Topics<'_> {
    fn all(mut self) -> Result<All, String> {
        let c = self.config;
        let of = |space: &str, name: &str| format!("{space}/{name}");
        let (js, cp) = (
            c.namespace.as_str(),
            c.cp_namespace.as_deref().unwrap_or(&c.namespace),
        );
        let mut looks = vec![
            self.crtk(
                &of(js, "measured_js"),
                SENSOR,
                "JointState",
                |m: m::JointState| ((&m.header).into(), Topic::MeasuredJs(m.into())),
            )?,
            self.crtk(
                &of(js, "setpoint_js"),
                SENSOR,
                "JointState",
                |m: m::JointState| ((&m.header).into(), Topic::SetpointJs(m.into())),
            )?,
            self.crtk(
                &of(cp, "measured_cv"),
                GEOMETRY,
                "TwistStamped",
                |m: m::PairStamped| ((&m.header).into(), Topic::MeasuredCv(m.pair.into())),
            )?,
            self.crtk(
                &of(cp, "measured_cf"),
                GEOMETRY,
                "WrenchStamped",
                |m: m::PairStamped| ((&m.header).into(), Topic::MeasuredCf(m.pair.into())),
            )?,
            self.crtk(
                &of(js, "operating_state"),
                "crtk_msgs",
                "OperatingState",
                |m: m::OperatingState| {
                    let operating = Topic::OperatingState(m.state, m.is_homed, m.is_busy);
                    ((&m.header).into(), operating)
                },
            )?,
        ];
        looks.push(if c.cp_is_transform {
            self.crtk(
                &of(cp, "measured_cp"),
                GEOMETRY,
                "TransformStamped",
                |m: m::TransformStamped| {
                    ((&m.header).into(), Topic::MeasuredCp(m.transform.into()))
                },
            )?
        } else {
            self.crtk(
                &of(cp, "measured_cp"),
                GEOMETRY,
                "PoseStamped",
                |m: m::PoseStamped| ((&m.header).into(), Topic::MeasuredCp(m.pose.into())),
            )?
        });
        let own = |name: &str| of(&c.publish, name);
        let requests =
            self.subscribe::<m::PairStamped>(&own("servo_cf"), GEOMETRY, "WrenchStamped")?;
        looks.push(look(requests, |_, m| Incoming::Request(m.pair)));
        let measured_cf = self.publisher(&own("measured_cf"))?;
        let setpoint_cf = self.publisher(&own("setpoint_cf"))?;
        Ok((looks, measured_cf, setpoint_cf))
    }

    fn crtk<T: Message + Send + 'static>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
        convert: fn(T) -> (crtk::Header, Topic),
    ) -> Result<Look, String> {
        let subscription = self.subscribe::<T>(topic, package, kind)?;
        let name: Arc<str> = topic.into();
        Ok(look(subscription, move |publisher, message| {
            let (header, topic) = convert(message);
            Incoming::Crtk(format!("{name} of {publisher}").into(), header, topic)
        }))
    }

    fn subscribe<T: Message + 'static>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
    ) -> Result<Subscription<T>, String> {
        let qos = QosProfile::subscription_default()
            .reliability(Reliability::BestEffort)
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: QUEUE });
        let made = (self.node)
            .create_topic(&parse(topic)?, MessageTypeName::new(package, kind), &qos)
            .and_then(|topic| self.node.create_subscription::<T>(&topic, Some(qos)));
        made.map_err(|error| format!("{topic}: {error}"))
    }

    fn publisher(&mut self, topic: &str) -> Result<Publisher<m::PairStamped>, String> {
        let qos = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::DEFAULT)
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: KEPT });
        let kind = MessageTypeName::new(GEOMETRY, "WrenchStamped");
        let made = (self.node)
            .create_topic(&parse(topic)?, kind, &qos)
            .and_then(|topic| self.node.create_publisher(&topic, Some(qos)));
        made.map_err(|error| format!("{topic}: {error}"))
    }
}

fn parse(topic: &str) -> Result<Name, String> {
    Name::parse(topic).map_err(|error| format!("{topic}: {error}"))
}

const SENSOR: &str = "sensor_msgs";
const GEOMETRY: &str = "geometry_msgs";

/// Passes on what a subscription has; `false` once nobody wants it.
fn look<T: Message + Send + 'static>(
    subscription: Subscription<T>,
    convert: impl Fn(String, T) -> Incoming + Send + 'static,
) -> Look {
    Box::new(move |to| loop {
        let incoming = match subscription.take() {
            Ok(None) => return true,
            Ok(Some((message, info))) => convert(format!("{:?}", info.publisher_gid()), message),
            Err(error) => Incoming::Bad(error.to_string()),
        };
        if to.send((Instant::now(), incoming)).is_err() {
            return false;
        }
    })
}

/// Looks at all subscriptions until the source is gone.
fn receive(looks: &[Look], alive: &Weak<()>, to: &Outlet) {
    while alive.strong_count() > 0 && looks.iter().all(|look| look(to)) {
        std::thread::sleep(LOOK);
    }
}

impl Source for Ros2 {
    fn name(&self) -> String {
        format!("ROS 2 domain {}, {}", self.domain, self.config.namespace)
    }

    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError> {
        Ok(self.intake.poll(now_ns, true))
    }

    fn publish(&mut self, applied: &TipForce, setpoint: &TipForce) -> Result<(), SourceError> {
        let sent = self
            .measured_cf
            .publish(self.wrench(applied))
            .and_then(|()| self.setpoint_cf.publish(self.wrench(setpoint)));
        sent.map_err(|error| SourceError::Ros2 {
            domain: self.domain,
            why: format!("a force can't be published: {error}"),
        })
    }
}
