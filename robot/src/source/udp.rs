//! JSON datagrams, one object each, shaped like CRTK's messages:
//!
//! ```json
//! {"stamp_s": 1700000000.25, "seq": 7,
//!  "measured_cp": {"position": [0.02, -0.01, -0.08], "orientation": [0, 0, 0, 1], "frame_id": "PSM1_base"},
//!  "measured_js": {"name": ["shoulder", "elbow", "insertion"], "position": [0.5, 1.5, 0.4], "effort": [0.1, 0.2, 3.0]},
//!  "operating_state": {"state": "ENABLED", "is_homed": true}}
//! ```
//!
//! `stamp_s` is the sender's clock in s, without it the time of receipt counts. The sender's
//! address is the publisher: two senders are two publishers. Everything but a tip or joints may be
//! missing; a position may be `{"x": ..., "y": ..., "z": ...}`, and a bare
//! `{"position": [x, y, z]}` is a tip. Of several lines the last one counts. `NaN` and `Infinity`,
//! which Python writes though JSON does not have them, and `null` are numbers that are not known.
//! Anything that is not of this shape is an event.

use super::{arrival, sift, Poll, Source, SourceError, UdpConfig};
use crate::crtk::operating;
use crate::state::{
    Clock, Effort, JointState, Meaning, OperatingState, RobotState, Stamp, StateError, TipState,
};
use crate::watch::Watch;
use serde::Deserialize;
use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{sync_channel, Receiver, SyncSender};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

/// Longest datagram, bytes.
const DATAGRAM: usize = 8_192;
/// Datagrams that wait for a poll at most: more would keep the caller from its cycle.
const QUEUE: usize = 1_000;
/// After this time without a datagram the thread looks whether it is still needed.
const PATIENCE: Duration = Duration::from_millis(200);

#[derive(Deserialize)]
struct Message {
    stamp_s: Option<f64>,
    seq: Option<u64>,
    measured_cp: Option<Cp>,
    measured_js: Option<Js>,
    operating_state: Option<Operates>,
    /// Of a bare pose.
    position: Option<Position>,
}

#[derive(Deserialize)]
struct Cp {
    position: Position,
    orientation: Option<[Number; 4]>,
    #[serde(default)]
    frame_id: String,
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
    name: Vec<String>,
    position: Vec<Number>,
    velocity: Vec<Number>,
    effort: Vec<Number>,
}

#[derive(Deserialize)]
struct Operates {
    state: String,
    /// Who does not tell it does not say that it is not.
    #[serde(default = "yes")]
    is_homed: bool,
    #[serde(default)]
    is_busy: bool,
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
    let wrong = |why: String| StateError::Format(why);
    let text = std::str::from_utf8(bytes).map_err(|error| wrong(error.to_string()))?;
    let line = text.lines().rev().find(|line| !line.trim().is_empty());
    let line = line.unwrap_or_default();
    serde_json::from_str(line)
        .or_else(|error| serde_json::from_str(&without_nan(line)).map_err(|_| error))
        .map_err(|error| wrong(error.to_string()))
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
    }

    /// The address that is listened on.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    fn state(&self, datagram: &Datagram, received: Stamp) -> Result<RobotState, StateError> {
        let message = parse(&datagram.bytes)?;
        let stamp = match message.stamp_s {
            Some(stamp_s) if stamp_s.abs() > LARGEST_STAMP_S && stamp_s.is_finite() => {
                return Err(StateError::StampUnit(stamp_s));
            }
            Some(stamp_s) if stamp_s.is_finite() => Stamp {
                clock: Clock::RobotUtc,
                t_ns: (stamp_s * 1e9) as i64,
            },
            _ => received.clone(),
        };
        let numbers = |list: Vec<Number>| list.into_iter().map(|number| number.0).collect();
        let some = |list: Vec<Number>| (!list.is_empty()).then(|| numbers(list));
        let bare = message.position.map(|position| Cp {
            position,
            orientation: None,
            frame_id: String::new(),
        });
        Ok(RobotState {
            publisher: datagram.from.to_string().into(),
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
            tip: message.measured_cp.or(bare).map(|cp| TipState {
                frame: self.config.frame.clone(),
                frame_id: cp.frame_id.into(),
                stamp_ns: None,
                position_m: cp.position.into(),
                orientation_xyzw: cp.orientation.map(|q| q.map(|number| number.0)),
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
            received.push(self.state(&datagram, arrival(now_ns, polled, datagram.came)));
        }
        Ok(sift(received, &mut self.watch, &self.config.mount, now_ns))
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
