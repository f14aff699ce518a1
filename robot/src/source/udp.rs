//! JSON datagrams, one object each, shaped like CRTK's messages:
//!
//! ```json
//! {"stamp_s": 1700000000.25, "seq": 7,
//!  "measured_cp": {"position": [0.02, -0.01, -0.08], "orientation": [0, 0, 0, 1], "frame_id": "PSM1_base"},
//!  "measured_js": {"name": ["shoulder", "elbow", "insertion"], "position": [0.5, 1.5, 0.4], "effort": [0.1, 0.2, 3.0]},
//!  "operating_state": {"state": "ENABLED", "is_homed": true}}
//! ```
//!
//! `stamp_s` is the sender's clock in s, without it the time of receipt counts. A `header` of ROS
//! in the datagram, in `measured_cp` or in `measured_js` does as well: `stamp` is `{"secs",
//! "nsecs"}`, `{"sec", "nanosec"}` or s, `frame_id` that of the pose. What is told twice has to
//! agree. The sender's address is the publisher: two senders are two publishers. Everything but a
//! tip or joints may be missing; a position may be `{"x": ..., "y": ..., "z": ...}`, and a bare
//! `{"position": [x, y, z]}` is a tip. Of several lines the last one counts. `NaN` and `Infinity`,
//! which Python writes though JSON does not have them, and `null` are numbers that are not known.
//! Joints and tip of one stamp may come in two datagrams ([`Pairs`]).
//!
//! A datagram that is no message at all (no JSON object, or one without any of these keys: another
//! program's) is left out, counted and told; a message of another shape is an event. A key that is
//! not known is left out, and told.

use super::{arrival, sift, Poll, Source, SourceError, UdpConfig};
use crate::crtk::operating;
use crate::state::{
    Clock, Effort, JointState, Meaning, OperatingState, RobotState, Stamp, StateError, TipState,
};
use crate::watch::{Unfit, Watch};
use serde::de::IgnoredAny;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{sync_channel, Receiver, SyncSender};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

/// Longest datagram, bytes.
const DATAGRAM: usize = 8_192;
/// Datagrams that wait for a poll at most: more would keep the caller from its cycle.
const QUEUE: usize = 1_000;
/// Keys of a message. An object without any of them is another program's.
const KEYS: [&str; 7] = [
    "stamp_s",
    "seq",
    "header",
    "measured_cp",
    "measured_js",
    "operating_state",
    "position",
];
/// How long joints wait for the tip of their stamp, or the tip for the joints. A driver sends both
/// in one cycle; half a period at 100 Hz keeps the tip from getting old.
const PAIR_WITHIN: Duration = Duration::from_millis(5);
/// After this time without a datagram the thread looks whether it is still needed.
const PATIENCE: Duration = Duration::from_millis(200);

/// Keys that are not known. One of them may be a stamp by another name, so none is passed over in
/// silence.
type Unknown = BTreeMap<String, IgnoredAny>;

#[derive(Deserialize)]
struct Message {
    stamp_s: Option<f64>,
    seq: Option<u64>,
    header: Option<Header>,
    measured_cp: Option<Cp>,
    measured_js: Option<Js>,
    operating_state: Option<Operates>,
    /// Of a bare pose.
    position: Option<Position>,
    #[serde(flatten)]
    unknown: Unknown,
}

/// `std_msgs/Header` of ROS 1 or 2.
#[derive(Deserialize)]
struct Header {
    stamp: Option<Time>,
    #[serde(default)]
    frame_id: String,
    #[serde(rename = "seq")]
    _seq: Option<IgnoredAny>,
    #[serde(flatten)]
    unknown: Unknown,
}

/// A stamp: of ROS 1, of ROS 2, or s.
#[derive(Deserialize, Clone, Copy)]
#[serde(
    untagged,
    expecting = "a stamp that is none: {\"secs\", \"nsecs\"}, {\"sec\", \"nanosec\"} or a number of s"
)]
enum Time {
    Ros {
        #[serde(alias = "sec")]
        secs: i64,
        #[serde(alias = "nanosec")]
        nsecs: u32,
    },
    Seconds(f64),
}

impl Time {
    /// ns since 1970; `None` where it is not known.
    fn ns(self) -> Result<Option<i64>, StateError> {
        let s = match self {
            Self::Ros { secs, .. } => secs as f64,
            Self::Seconds(s) => s,
        };
        if s.is_finite() && s.abs() > LARGEST_STAMP_S {
            return Err(StateError::StampUnit(s));
        }
        Ok(match self {
            Self::Ros { secs, nsecs } => Some(secs * 1_000_000_000 + i64::from(nsecs)),
            Self::Seconds(s) => s.is_finite().then_some((s * 1e9) as i64),
        })
    }
}

impl Header {
    fn ns(header: Option<&Self>) -> Result<Option<i64>, StateError> {
        let stamp = header.and_then(|header| header.stamp);
        stamp.map_or(Ok(None), Time::ns)
    }
}

#[derive(Deserialize)]
struct Cp {
    header: Option<Header>,
    position: Position,
    orientation: Option<[Number; 4]>,
    #[serde(default)]
    frame_id: String,
    #[serde(flatten)]
    unknown: Unknown,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Position {
    Array([Number; 3]),
    Named { x: Number, y: Number, z: Number },
}

#[derive(Deserialize)]
#[serde(default)]
#[derive(Default)]
struct Js {
    header: Option<Header>,
    name: Vec<String>,
    position: Vec<Number>,
    velocity: Vec<Number>,
    effort: Vec<Number>,
    #[serde(flatten)]
    unknown: Unknown,
}

#[derive(Deserialize)]
struct Operates {
    /// It is published on change: its stamp does not count.
    #[serde(rename = "header")]
    _header: Option<IgnoredAny>,
    #[serde(rename = "sub_state")]
    _sub_state: Option<IgnoredAny>,
    state: String,
    /// Who does not tell it does not say that it is not.
    #[serde(default = "yes")]
    is_homed: bool,
    #[serde(default)]
    is_busy: bool,
    #[serde(flatten)]
    unknown: Unknown,
}

impl Message {
    /// The keys that are not known, as a flaw of a part that is not needed.
    fn unknown(&self) -> Option<StateError> {
        let headers = [
            ("header.", self.header.as_ref()),
            (
                "measured_cp.header.",
                self.measured_cp.as_ref().and_then(|cp| cp.header.as_ref()),
            ),
            (
                "measured_js.header.",
                self.measured_js.as_ref().and_then(|js| js.header.as_ref()),
            ),
        ];
        let parts = [
            ("", Some(&self.unknown)),
            (
                "measured_cp.",
                self.measured_cp.as_ref().map(|cp| &cp.unknown),
            ),
            (
                "measured_js.",
                self.measured_js.as_ref().map(|js| &js.unknown),
            ),
            (
                "operating_state.",
                self.operating_state.as_ref().map(|o| &o.unknown),
            ),
        ];
        let headers = headers.map(|(at, header)| (at, header.map(|header| &header.unknown)));
        let keys: Vec<String> = (parts.into_iter().chain(headers))
            .flat_map(|(at, keys)| {
                keys.into_iter()
                    .flat_map(BTreeMap::keys)
                    .map(move |key| format!("`{at}{}`", key.escape_debug()))
            })
            .collect();
        (!keys.is_empty())
            .then(|| StateError::UnknownKeys(keys.join(", ")).of_optional("unknown keys"))
    }

    /// Stamps of the state and of its pose, ns: that of the datagram is that of both.
    fn stamps(&self) -> Result<Stamps, StateError> {
        let of_all = one_stamp([
            (self.stamp_s.map(Time::Seconds)).map_or(Ok(None), Time::ns)?,
            Header::ns(self.header.as_ref())?,
        ])?;
        let cp = Header::ns(self.measured_cp.as_ref().and_then(|cp| cp.header.as_ref()))?;
        let js = Header::ns(self.measured_js.as_ref().and_then(|js| js.header.as_ref()))?;
        let (tip, joints) = (one_stamp([of_all, cp])?, one_stamp([of_all, js])?);
        // Without a stamp of their own the joints are as old as the pose.
        Ok(Stamps {
            state: if js.is_some() { joints } else { tip },
            tip,
        })
    }

    /// Name of the pose's frame; empty where none is told.
    fn frame_id(&self) -> Result<&str, StateError> {
        let cp = self.measured_cp.as_ref();
        let told = [
            cp.map(|cp| cp.frame_id.as_str()),
            cp.and_then(|cp| cp.header.as_ref())
                .map(|h| h.frame_id.as_str()),
            self.header.as_ref().map(|h| h.frame_id.as_str()),
        ];
        let mut told = told.into_iter().flatten().filter(|name| !name.is_empty());
        let first = told.next().unwrap_or_default();
        match told.find(|other| *other != first) {
            None => Ok(first),
            Some(other) => Err(StateError::Contradiction {
                key: "frame_id",
                first: first.to_owned(),
                second: other.to_owned(),
            }),
        }
    }
}

/// Stamps of a datagram, ns; `None`: not told.
struct Stamps {
    state: Option<i64>,
    tip: Option<i64>,
}

/// Stamps that differ by less are the same, ns: one of them may be rounded to ms.
const SAME_STAMP_NS: i64 = 1_000_000;

/// The one stamp that is told once or twice.
fn one_stamp([first, second]: [Option<i64>; 2]) -> Result<Option<i64>, StateError> {
    match (first, second) {
        // CRTK's mark of invalid data counts, whatever stands beside it.
        (Some(0), _) | (_, Some(0)) => Err(StateError::Invalid),
        (Some(a), Some(b)) if a.abs_diff(b) > SAME_STAMP_NS.unsigned_abs() => {
            let s = |ns: i64| format!("{:.9} s", ns as f64 * 1e-9);
            Err(StateError::Contradiction {
                key: "stamp",
                first: s(a),
                second: s(b),
            })
        }
        // A header's is whole ns.
        (first, second) => Ok(second.or(first)),
    }
}

const fn yes() -> bool {
    true
}

/// A number; `null` is one that is not known, NaN.
#[derive(Deserialize, Clone, Copy)]
#[serde(from = "Option<f64>")]
struct Number(f64);

impl From<Option<f64>> for Number {
    fn from(number: Option<f64>) -> Self {
        Self(number.unwrap_or(f64::NAN))
    }
}

impl From<Position> for [f64; 3] {
    fn from(position: Position) -> Self {
        match position {
            Position::Array(xyz) => xyz.map(|number| number.0),
            Position::Named { x, y, z } => [x.0, y.0, z.0],
        }
    }
}

/// The last line of a datagram that is not empty, as an object.
fn parse(bytes: &[u8]) -> Result<Message, StateError> {
    let none = |why: String| StateError::NoMessage(why).of_optional("datagrams");
    if bytes.len() == DATAGRAM {
        return Err(none(format!("it has {DATAGRAM} bytes or more")));
    }
    let text = std::str::from_utf8(bytes).map_err(|error| none(error.to_string()))?;
    let line = text.lines().rev().find(|line| !line.trim().is_empty());
    let line = line.unwrap_or_default();
    let without_nan = without_nan(line);
    let message = serde_json::from_str(line)
        .or_else(|error| serde_json::from_str(&without_nan).map_err(|_| error));
    let keys = serde_json::from_str::<Unknown>(&without_nan);
    match (message, keys) {
        (Err(error), Err(_)) => Err(none(error.to_string())),
        (_, Ok(keys)) if !KEYS.iter().any(|key| keys.contains_key(*key)) => {
            Err(none(format!("it has none of the keys {}", KEYS.join(", "))))
        }
        (message, _) => message.map_err(|error| StateError::Format(error.to_string())),
    }
}

/// The text with `null` for each NaN and Infinity that stands outside of a string.
fn without_nan(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    // Every second part is a string, where none holds an escaped quote; with one the text stays as
    // wrong as it was.
    for (n, part) in text.split('"').enumerate() {
        if n > 0 {
            out.push('"');
        }
        if n % 2 == 1 {
            out.push_str(part);
        } else {
            let part = part.replace("-Infinity", "null");
            out.push_str(&part.replace("Infinity", "null").replace("NaN", "null"));
        }
    }
    out
}

/// See the module's page.
#[derive(Debug)]
pub struct Udp {
    config: UdpConfig,
    address: SocketAddr,
    incoming: Receiver<Datagram>,
    pairs: Pairs,
    /// Dropped with the source: the thread ends then.
    _alive: Arc<()>,
    watch: Watch,
}

/// A datagram, its sender, and when it came.
#[derive(Debug)]
struct Datagram {
    came: Instant,
    from: SocketAddr,
    bytes: Vec<u8>,
}

impl Udp {
    /// Opens the socket. A thread takes the datagrams, so that each has the time at which it came.
    ///
    /// # Errors
    /// [`SourceError::Listen`], [`SourceError::Mount`].
    pub fn listen(config: &UdpConfig) -> Result<Self, SourceError> {
        config.mount.check().map_err(SourceError::Mount)?;
        let alive = Arc::new(());
        let weak = Arc::downgrade(&alive);
        let (to, incoming) = sync_channel(QUEUE);
        let open = || {
            let socket = UdpSocket::bind(&config.listen)?;
            socket.set_read_timeout(Some(PATIENCE))?;
            let address = socket.local_addr()?;
            std::thread::Builder::new()
                .name("robot states over UDP".to_owned())
                .spawn(move || receive(&socket, &weak, &to))?;
            Ok(address)
        };
        let address = open().map_err(|cause| SourceError::Listen {
            listen: config.listen.clone(),
            cause,
        })?;
        Ok(Self {
            address,
            incoming,
            pairs: Pairs::default(),
            _alive: alive,
            watch: Watch::new(config.watch.clone()),
            config: config.clone(),
        })
    }

    /// Forgets all that came until now, what waits in the socket included: the next state is the
    /// first one.
    pub fn forget(&mut self) {
        // A socket keeps its order: what comes before a datagram of our own is old.
        let marked = UdpSocket::bind((self.address.ip(), 0)).and_then(|marker| {
            marker.send_to(&[], self.address)?;
            marker.local_addr()
        });
        let until = Instant::now() + PATIENCE;
        let next = || {
            let left = until.saturating_duration_since(Instant::now());
            self.incoming.recv_timeout(left).ok()
        };
        if let Ok(marker) = marked {
            let is_marker = |d: &Datagram| d.bytes.is_empty() && d.from.port() == marker.port();
            while next().is_some_and(|datagram| !is_marker(&datagram)) {}
        }
        self.watch = Watch::new(self.config.watch.clone());
        self.pairs.waits = None;
        self.pairs.last = None;
    }

    /// The address that is listened on.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    fn state(
        &self,
        message: Message,
        from: SocketAddr,
        received: Stamp,
    ) -> Result<RobotState, StateError> {
        let stamps = message.stamps()?;
        let frame_id = message.frame_id()?.into();
        let stamp = match stamps.state {
            Some(t_ns) => Stamp {
                clock: Clock::RobotUtc,
                t_ns,
            },
            None => received.clone(),
        };
        let numbers = |list: Vec<Number>| list.into_iter().map(|number| number.0).collect();
        let some = |list: Vec<Number>| (!list.is_empty()).then(|| numbers(list));
        let bare = message.position.map(|position| (position, None));
        let pose = (message.measured_cp).map(|cp| (cp.position, cp.orientation));
        Ok(RobotState {
            publisher: from.to_string().into(),
            sequence: message.seq,
            stamp,
            received: Some(received),
            joints: message.measured_js.map(|js| JointState {
                names: js.name.into(),
                position: numbers(js.position),
                velocity: some(js.velocity),
                effort: some(js.effort).map(|value| Effort {
                    meaning: Meaning::Measured,
                    value,
                }),
                setpoint: None,
            }),
            tip: pose.or(bare).map(|(position, orientation)| TipState {
                frame: self.config.frame.clone(),
                frame_id,
                stamp_ns: stamps.tip,
                position_m: position.into(),
                orientation_xyzw: orientation.map(|q| q.map(|number| number.0)),
                velocity_m_per_s: None,
                angular_velocity_rad_per_s: None,
            }),
            force: None,
            operating: message.operating_state.map(|operates| OperatingState {
                state: operating(&operates.state),
                is_homed: operates.is_homed,
                is_busy: operates.is_busy,
            }),
        })
    }
}

impl Source for Udp {
    fn name(&self) -> String {
        format!("UDP {}", self.config.listen)
    }

    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError> {
        let polled = Instant::now();
        let mut received = Vec::new();
        for datagram in self.incoming.try_iter().take(QUEUE) {
            let came = arrival(now_ns, polled, datagram.came);
            let state = parse(&datagram.bytes).and_then(|message| {
                received.extend(message.unknown().map(Err));
                self.state(message, datagram.from, came)
            });
            match state {
                Ok(state) => received.extend(self.pairs.take(state, datagram.came).map(Ok)),
                Err(error) => received.push(Err(error)),
            }
        }
        received.extend(self.pairs.waited(polled).map(Ok));
        Ok(sift(received, &mut self.watch, &self.config.mount, now_ns))
    }
}

/// Joins joints and tip of one stamp that one sender tells in two datagrams, as a driver with a
/// topic for each does. Nothing waits before the first such pair was seen: a robot that tells poses
/// alone has each of them used as it comes.
#[derive(Debug, Default)]
struct Pairs {
    /// Which part comes first; `None`: no pair was seen.
    first: Option<Part>,
    /// The newest state that was passed on and is half of a pair.
    last: Option<RobotState>,
    /// A first part that waits for the second one, and when it came.
    waits: Option<(Instant, RobotState)>,
}

/// Half of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Joints,
    Tip,
}

impl Part {
    fn of(state: &RobotState) -> Option<Self> {
        match (&state.joints, &state.tip) {
            (Some(_), None) => Some(Self::Joints),
            (None, Some(_)) => Some(Self::Tip),
            _ => None,
        }
    }
}

impl Pairs {
    /// What can be passed on once `state` came.
    fn take(&mut self, state: RobotState, came: Instant) -> impl Iterator<Item = RobotState> {
        if state.is_operating_alone() {
            // On a topic of its own it may come between the two.
            return None.into_iter().chain(Some(state));
        }
        let before = self.waits.take().map(|(_, state)| state);
        let part = Part::of(&state);
        let is_pair = |first: &RobotState| {
            let parts = (Part::of(first), part);
            matches!(parts, (Some(first), Some(second)) if first != second)
                && state.stamp.clock == Clock::RobotUtc
                && (&first.stamp, &first.publisher) == (&state.stamp, &state.publisher)
        };
        let (before, now) = match before {
            Some(first) if is_pair(&first) => (None, Some(joined(first, state))),
            before => {
                if let Some(first) = self.last.as_ref().filter(|first| is_pair(first)) {
                    self.first = Part::of(first);
                }
                // A robot that is unfit is told of at once.
                let is_fit = state.operating.and_then(Unfit::of).is_none();
                if part.is_some() && part == self.first && is_fit {
                    self.waits = Some((came, state));
                    (before, None)
                } else {
                    (before, Some(state))
                }
            }
        };
        if let Some(passed) = now.as_ref().or(before.as_ref()) {
            self.note(passed);
        }
        before.into_iter().chain(now)
    }

    /// A first part whose second one did not come in time.
    fn waited(&mut self, now: Instant) -> Option<RobotState> {
        let late =
            |(came, _): &mut (Instant, _)| now.saturating_duration_since(*came) > PAIR_WITHIN;
        let (_, state) = self.waits.take_if(late)?;
        self.note(&state);
        Some(state)
    }

    fn note(&mut self, passed: &RobotState) {
        self.last = Part::of(passed).map(|_| passed.clone());
    }
}

/// A state with the parts of both. It was whole when the second one came.
fn joined(first: RobotState, second: RobotState) -> RobotState {
    RobotState {
        sequence: first.sequence.or(second.sequence),
        joints: first.joints.or(second.joints),
        tip: first.tip.or(second.tip),
        operating: second.operating.or(first.operating),
        ..second
    }
}

/// Largest stamp, s: the year 2255. In ms today's stamps have 1.8e12.
const LARGEST_STAMP_S: f64 = 9e9;

/// Passes datagrams on until the source is gone. Where nobody polls, the newest ones are dropped.
fn receive(socket: &UdpSocket, alive: &Weak<()>, to: &SyncSender<Datagram>) {
    let mut bytes = [0; DATAGRAM];
    while alive.strong_count() > 0 {
        // A time-out, or an error of a datagram that we never sent (ICMP): there may be more.
        let Ok((length, from)) = socket.recv_from(&mut bytes) else {
            continue;
        };
        let _ = to.try_send(Datagram {
            came: Instant::now(),
            from,
            bytes: bytes[..length].to_vec(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_a_pair_waits_for_the_other_and_that_of_a_robot_in_fault_does_not() {
        let udp = Udp::listen(&UdpConfig {
            listen: "127.0.0.1:0".to_owned(),
            ..UdpConfig::default()
        })
        .unwrap();
        let came = Instant::now();
        let mut pairs = Pairs::default();
        let mut passed = |n: u32, rest: &str| {
            let stamp_s = 100.0 + 0.01 * f64::from(n);
            let message = parse(format!(r#"{{"stamp_s": {stamp_s}, {rest}}}"#).as_bytes()).unwrap();
            let stamp = Stamp {
                clock: Clock::RobotUtc,
                t_ns: 0,
            };
            let state = udp.state(message, udp.address, stamp).unwrap();
            let passed: Vec<RobotState> = pairs.take(state, came).collect();
            passed.len()
        };
        let joints = r#""measured_js": {"name": ["a"], "position": [0.5]}"#;
        let tip = r#""measured_cp": {"position": [0.1, 0.2, 0.3]}"#;
        // Nobody knew of pairs before the first one.
        assert_eq!([passed(0, joints), passed(0, tip)], [1, 1]);
        assert_eq!([passed(1, joints), passed(1, tip)], [0, 1]);
        let fault = format!(r#"{joints}, "operating_state": {{"state": "FAULT"}}"#);
        assert_eq!(passed(2, &fault), 1);
    }
}
