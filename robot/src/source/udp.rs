//! JSON datagrams, one object each, shaped like CRTK's messages:
//!
//! ```json
//! {"stamp_s": 1700000000.25, "seq": 7,
//!  "measured_cp": {"position": [0.02, -0.01, -0.08], "orientation": [0, 0, 0, 1]},
//!  "measured_js": {"name": ["shoulder", "elbow", "insertion"], "position": [0.5, 1.5, 0.4], "effort": [0.1, 0.2, 3.0]}}
//! ```
//!
//! `stamp_s` is the sender's clock in s, without it the time of receipt counts. The sender's address is the publisher: two
//! senders are two publishers. A line feed at the end is allowed. Numbers that JSON does not have (NaN) make a datagram
//! invalid, as does anything that is not of this shape; both are events.

use super::{arrival, sift, Poll, Source, SourceError, UdpConfig};
use crate::state::{Clock, Effort, JointState, Meaning, RobotState, Stamp, StateError, TipState};
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
}

#[derive(Deserialize)]
struct Cp {
    position: [f64; 3],
    orientation: Option<[f64; 4]>,
}

#[derive(Deserialize)]
#[serde(default)]
#[derive(Default)]
struct Js {
    name: Vec<String>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
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

    /// The address that is listened on.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    fn state(&self, datagram: &Datagram, received: Stamp) -> Result<RobotState, StateError> {
        let publisher = datagram.from.to_string();
        let datagram: Message = serde_json::from_slice(&datagram.bytes)
            .map_err(|error| StateError::Format(error.to_string()))?;
        let stamp = match datagram.stamp_s {
            Some(stamp_s) if stamp_s.is_finite() => Stamp {
                clock: Clock::RobotUtc,
                t_ns: (stamp_s * 1e9) as i64,
            },
            _ => received.clone(),
        };
        let some = |list: Vec<f64>| (!list.is_empty()).then_some(list);
        Ok(RobotState {
            publisher: Arc::from(publisher),
            sequence: datagram.seq,
            stamp,
            received: Some(received),
            joints: datagram.measured_js.map(|js| JointState {
                names: js.name.into(),
                position: js.position,
                velocity: some(js.velocity),
                effort: some(js.effort).map(|value| Effort {
                    meaning: Meaning::Measured,
                    value,
                }),
                setpoint: None,
            }),
            tip: datagram.measured_cp.map(|cp| TipState {
                frame: self.config.frame.clone(),
                position_m: cp.position,
                orientation_xyzw: cp.orientation,
                velocity_m_per_s: None,
                angular_velocity_rad_per_s: None,
            }),
            force: None,
            operating: None,
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
