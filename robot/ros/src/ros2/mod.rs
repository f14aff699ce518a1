//! A robot on ROS 2: CRTK topics in, the rig's force out.
//!
//! The same topics as over ROS 1: we subscribe `measured_js`, `setpoint_js`, `measured_cp`,
//! `measured_cv`, `measured_cf` and `operating_state` below the robot's namespace, publish
//! `measured_cf`, `setpoint_cf` and an estimator's `measured_cf_estimated` below our own, and take
//! `servo_cf` there. Subscriptions are best effort and volatile, which fits every publisher; what
//! we publish is reliable. `operating_state` is subscribed a second time, reliable and transient
//! local: a dVRK 2 publishes it on change only and keeps the last one for late joiners. A message
//! carries its publisher's identity, so two publishers of a topic are told apart message by
//! message. As a CRTK device we publish `operating_state`, transient local, and take
//! `state_command`.
//!
//! The client is ros2-client on RustDDS. A thread takes what has come, so that each message has its
//! time of arrival.

mod messages;

use crate::intake::{adapter_for, device, since_1970, Incoming, Intake, Outlet};
use messages as m;
use robot::crtk::{self, Topic};
use robot::source::{Estimate, Poll, Ros2Config, Source, SourceError};
use robot::state::{Operating, OperatingState, TipForce};
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
    estimated_cf: Publisher<m::PairStamped>,
    estimated_half_width: Publisher<m::PairStamped>,
    operating: Publisher<m::OperatingState>,
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
        let adapter = adapter_for(&config.adapter, &config.topics());
        let (to, intake) = Intake::new(&adapter, None, config.mount, &config.watch);
        let topics = Topics {
            node: &mut node,
            config,
        };
        let (subscriptions, ours, operating) = topics.all().map_err(failed)?;
        let [measured_cf, setpoint_cf, estimated_cf, estimated_half_width] = ours;
        let alive = Arc::new(());
        let weak = Arc::downgrade(&alive);
        std::thread::Builder::new()
            .name("robot states over ROS 2".to_owned())
            .spawn(move || receive(&subscriptions, &weak, &to))
            .map_err(|error| failed(error.to_string()))?;
        let mut source = Self {
            config: config.clone(),
            domain,
            intake,
            measured_cf,
            setpoint_cf,
            estimated_cf,
            estimated_half_width,
            operating,
            _alive: alive,
            _node: node,
        };
        source.publish_operating(OperatingState {
            state: Operating::Disabled,
            is_homed: true,
            is_busy: false,
        })?;
        Ok(source)
    }

    fn not_published(&self, error: &dyn std::fmt::Display) -> SourceError {
        SourceError::Ros2 {
            domain: self.domain,
            why: format!("nothing can be published: {error}"),
        }
    }

    fn wrench(&self, force: &TipForce) -> m::PairStamped {
        let (frame_id, pair) = self.intake.wrench(force);
        m::PairStamped {
            header: header(frame_id),
            pair,
        }
    }
}

fn header(frame_id: String) -> m::Header {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    header_at(frame_id, now)
}

/// A header with a time since 1970.
fn header_at(frame_id: String, at: Duration) -> m::Header {
    m::Header {
        stamp: m::Time {
            sec: at.as_secs() as i32,
            nanosec: at.subsec_nanos(),
        },
        frame_id,
    }
}

/// Highest domain: its ports, 7400 + 250 domain and up to 250 more, must be below 65536 (DDSI-RTPS
/// 2.5 section 9.6.2.3).
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
    [Publisher<m::PairStamped>; 4],
    Publisher<m::OperatingState>,
);

/// Makes the topics of a node.
struct Topics<'a> {
    node: &'a mut Node,
    config: &'a Ros2Config,
}

impl Topics<'_> {
    fn all(mut self) -> Result<All, String> {
        let c = self.config;
        let of = c.topics();
        let mut looks = vec![
            self.crtk(&of.measured_js, SENSOR, "JointState", |m: m::JointState| {
                ((&m.header).into(), Topic::MeasuredJs(m.into()))
            })?,
            self.crtk(&of.setpoint_js, SENSOR, "JointState", |m: m::JointState| {
                ((&m.header).into(), Topic::SetpointJs(m.into()))
            })?,
            self.crtk(
                &of.measured_cv,
                GEOMETRY,
                "TwistStamped",
                |m: m::PairStamped| ((&m.header).into(), Topic::MeasuredCv(m.pair.into())),
            )?,
            self.crtk(
                &of.measured_cf,
                GEOMETRY,
                "WrenchStamped",
                |m: m::PairStamped| ((&m.header).into(), Topic::MeasuredCf(m.pair.into())),
            )?,
        ];
        for qos in [volatile(), latched()] {
            looks.push(self.crtk_with(
                &of.operating_state,
                CRTK,
                "OperatingState",
                &qos,
                |m: m::OperatingState| {
                    let operating = Topic::OperatingState(m.state, m.is_homed, m.is_busy);
                    ((&m.header).into(), operating)
                },
            )?);
        }
        let is_transform = (c.cp_is_transform).unwrap_or(c.adapter.robot.cp_is_transform());
        looks.push(if is_transform {
            self.crtk(
                &of.measured_cp,
                GEOMETRY,
                "TransformStamped",
                |m: m::TransformStamped| {
                    ((&m.header).into(), Topic::MeasuredCp(m.transform.into()))
                },
            )?
        } else {
            self.crtk(
                &of.measured_cp,
                GEOMETRY,
                "PoseStamped",
                |m: m::PoseStamped| ((&m.header).into(), Topic::MeasuredCp(m.pose.into())),
            )?
        });
        let own = |name: &str| format!("{}/{name}", c.publish);
        let requests = self.subscribe::<m::PairStamped>(
            &own("servo_cf"),
            GEOMETRY,
            "WrenchStamped",
            &volatile(),
        )?;
        looks.push(look(requests, |_, m| Incoming::Request(m.pair)));
        let forces = [
            self.publisher(&own("measured_cf"))?,
            self.publisher(&own("setpoint_cf"))?,
            self.publisher(&own("measured_cf_estimated"))?,
            self.publisher(&own("measured_cf_estimated_half_width"))?,
        ];
        let of_device = |name: &str| format!("{}/{name}", device(&c.publish));
        let commands = self.subscribe::<m::StringStamped>(
            &of_device("state_command"),
            CRTK,
            "StringStamped",
            &volatile(),
        )?;
        looks.push(look(commands, |_, m| Incoming::Command(m.string)));
        let kept = (QosProfile::publisher_default())
            .reliability_reliable(WhenFull::DEFAULT)
            .durability(Durability::TransientLocal)
            .history(History::KeepLast { depth: 1 });
        let topic = of_device("operating_state");
        let operating = self.publisher_of(&topic, CRTK, "OperatingState", kept)?;
        Ok((looks, forces, operating))
    }

    fn crtk<T: Message + Send + 'static>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
        convert: fn(T) -> (crtk::Header, Topic),
    ) -> Result<Look, String> {
        self.crtk_with(topic, package, kind, &volatile(), convert)
    }

    fn crtk_with<T: Message + Send + 'static>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
        qos: &QosProfile,
        convert: fn(T) -> (crtk::Header, Topic),
    ) -> Result<Look, String> {
        let subscription = self.subscribe::<T>(topic, package, kind, qos)?;
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
        qos: &QosProfile,
    ) -> Result<Subscription<T>, String> {
        let made = (self.node)
            .create_topic(&parse(topic)?, MessageTypeName::new(package, kind), qos)
            .and_then(|topic| {
                self.node
                    .create_subscription::<T>(&topic, Some(qos.clone()))
            });
        made.map_err(|error| format!("{topic}: {error}"))
    }

    fn publisher(&mut self, topic: &str) -> Result<Publisher<m::PairStamped>, String> {
        let qos = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::DEFAULT)
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: KEPT });
        self.publisher_of(topic, GEOMETRY, "WrenchStamped", qos)
    }

    fn publisher_of<T: Message>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
        qos: QosProfile,
    ) -> Result<Publisher<T>, String> {
        let made = (self.node)
            .create_topic(&parse(topic)?, MessageTypeName::new(package, kind), &qos)
            .and_then(|topic| self.node.create_publisher(&topic, Some(qos)));
        made.map_err(|error| format!("{topic}: {error}"))
    }
}

/// Fits every publisher.
fn volatile() -> QosProfile {
    QosProfile::subscription_default()
        .reliability(Reliability::BestEffort)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: QUEUE })
}

/// For what a publisher keeps for late joiners. It does not fit one that keeps nothing.
fn latched() -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(Durability::TransientLocal)
        .history(History::KeepLast { depth: 1 })
}

fn parse(topic: &str) -> Result<Name, String> {
    Name::parse(topic).map_err(|error| format!("{topic}: {error}"))
}

const SENSOR: &str = "sensor_msgs";
const GEOMETRY: &str = "geometry_msgs";
const CRTK: &str = "crtk_msgs";

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
        sent.map_err(|error| self.not_published(&error))
    }

    fn publish_operating(&mut self, operating: OperatingState) -> Result<(), SourceError> {
        let message = m::OperatingState {
            header: header(String::new()),
            state: operating.state.word().to_owned(),
            is_homed: operating.is_homed,
            is_busy: operating.is_busy,
        };
        let sent = self.operating.publish(message);
        sent.map_err(|error| self.not_published(&error))
    }

    fn publish_estimate(&mut self, estimate: &Estimate) -> Result<(), SourceError> {
        let at = since_1970(estimate.stamp.t_ns);
        let stamped = |(frame_id, pair)| m::PairStamped {
            header: header_at(frame_id, at),
            pair,
        };
        let force = stamped(self.intake.wrench(&estimate.force));
        let half = self.intake.half_width(estimate).map(stamped);
        let sent = half
            .map_or(Ok(()), |half| self.estimated_half_width.publish(half))
            .and_then(|()| self.estimated_cf.publish(force));
        sent.map_err(|error| self.not_published(&error))
    }
}
