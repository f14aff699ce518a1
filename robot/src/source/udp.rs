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

use super::{sift, Poll, Source, SourceError, UdpConfig};
use crate::state::{Clock, Effort, JointState, Meaning, RobotState, Stamp, StateError, TipState};
use crate::watch::Watch;
use serde::Deserialize;
use std::net::UdpSocket;
use std::sync::Arc;

/// Longest datagram, bytes.
const DATAGRAM: usize = 8_192;
/// Datagrams of one poll: more would keep the caller from its cycle.
const PER_POLL: usize = 1_000;

#[derive(Deserialize)]
struct Datagram {
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
    socket: UdpSocket,
    watch: Watch,
}

impl Udp {
    /// Opens the socket.
    ///
    /// # Errors
    /// [`SourceError::Listen`], [`SourceError::Mount`].
    pub fn listen(config: &UdpConfig) -> Result<Self, SourceError> {
        config.mount.check().map_err(SourceError::Mount)?;
        let open = || {
            let socket = UdpSocket::bind(&config.listen)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        Ok(Self {
            socket: open().map_err(|cause| SourceError::Listen {
                listen: config.listen.clone(),
                cause,
            })?,
            watch: Watch::new(config.watch.clone()),
            config: config.clone(),
        })
    }

    /// The address that is listened on.
    ///
    /// # Errors
    /// The operating system's.
    pub fn address(&self) -> std::io::Result<std::net::SocketAddr> {
        self.socket.local_addr()
    }

    fn state(&self, bytes: &[u8], publisher: &str, now_ns: i64) -> Result<RobotState, StateError> {
        let datagram: Datagram =
            serde_json::from_slice(bytes).map_err(|error| StateError::Format(error.to_string()))?;
        let stamp = match datagram.stamp_s {
            Some(stamp_s) if stamp_s.is_finite() => Stamp {
                clock: Clock::RobotUtc,
                t_ns: (stamp_s * 1e9) as i64,
            },
            _ => Stamp {
                clock: Clock::HostMonotonic,
                t_ns: now_ns,
            },
        };
        let some = |list: Vec<f64>| (!list.is_empty()).then_some(list);
        Ok(RobotState {
            publisher: Arc::from(publisher),
            sequence: datagram.seq,
            stamp,
            received: Some(Stamp {
                clock: Clock::HostMonotonic,
                t_ns: now_ns,
            }),
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
        let mut bytes = [0; DATAGRAM];
        let mut received = Vec::new();
        for _ in 0..PER_POLL {
            let Ok((length, from)) = self.socket.recv_from(&mut bytes) else {
                break;
            };
            received.push(self.state(&bytes[..length], &from.to_string(), now_ns));
        }
        Ok(sift(received, &mut self.watch, &self.config.mount, now_ns))
    }
}
