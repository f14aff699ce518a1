//! Where the robot's tip is.
//!
//! The embedded rig reports its robot's pose with the link. On a real rig the robot's own software does:
//!
//! * `source = "udp"`: one JSON object to a datagram, newline or not, sent at 100 Hz or faster, shaped like a
//!   CRTK `measured_cp` message. Only the position is used, in metres in the robot's base frame:
//!
//!   ```json
//!   {"measured_cp": {"position": [-0.08, 0.025, -0.14]}}
//!   ```
//!
//!   `{"position": [x, y, z]}` and `{"position": {"x": x, "y": y, "z": z}}` do as well (the shape of a ROS `Pose` turned
//!   to JSON). Other keys are ignored. A pose older than `max_age_s`, or none at all, stops the rig.
//! * `source = "static"`: the tip is clamped at `position_m`.

use nalgebra::Vector3;
use rig::PoseChoice;
use serde::Deserialize;
use std::net::UdpSocket;
use std::time::{Duration, Instant};

/// Longest datagram that is read, bytes.
const DATAGRAM: usize = 4096;
/// How long the first pose may take before arming: a robot that sends at 100 Hz needs 10 ms.
const FIRST_POSE_WAIT: Duration = Duration::from_secs(1);

/// Why there is no pose. The rig has to be made safe.
#[derive(Debug, thiserror::Error)]
pub enum PoseError {
    /// The address can't be listened on.
    #[error("poses can't be received on {listen}: {cause}; check `listen` in [pose] of the rig file, and whether another program has the port")]
    Listen {
        /// The address.
        listen: String,
        /// The operating system's words.
        cause: std::io::Error,
    },
    /// The link brings none.
    #[error("this link reports no pose; set `source` in [pose] of the rig file to \"udp\" or \"static\"")]
    NotFromLink,
    /// Nothing has come yet, or not for too long.
    #[error("no pose of the robot on {listen} for {age_s:.2} s ({bad} datagrams were no poses); is the robot's software sending?")]
    Stale {
        /// The address.
        listen: String,
        /// Age in s.
        age_s: f64,
        /// Datagrams that could not be read.
        bad: u64,
    },
}

/// A source of poses.
#[derive(Debug)]
pub enum PoseSource {
    /// The link.
    Rig,
    /// Datagrams.
    Udp(UdpPoses),
    /// A clamped tip.
    Static(Vector3<f64>),
}

/// Receives poses as datagrams.
#[derive(Debug)]
pub struct UdpPoses {
    listen: String,
    socket: UdpSocket,
    max_age: Duration,
    newest: Option<(Instant, Vector3<f64>)>,
    since: Instant,
    bad: u64,
}

impl PoseSource {
    /// Opens what the rig file names.
    ///
    /// # Errors
    /// [`PoseError::Listen`].
    pub fn open(choice: &PoseChoice) -> Result<Self, PoseError> {
        Ok(match choice {
            PoseChoice::Rig => Self::Rig,
            PoseChoice::Static { position_m } => Self::Static(*position_m),
            PoseChoice::Udp { listen, max_age_s } => Self::Udp(UdpPoses::listen(
                listen,
                Duration::from_secs_f64(*max_age_s),
            )?),
        })
    }

    /// The tip now, robot base frame, m; `from_link` is what the link reported last.
    ///
    /// # Errors
    /// There is none, or it is too old.
    pub fn tip_m(&mut self, from_link: Option<Vector3<f64>>) -> Result<Vector3<f64>, PoseError> {
        match self {
            Self::Rig => from_link.ok_or(PoseError::NotFromLink),
            Self::Static(position_m) => Ok(*position_m),
            Self::Udp(poses) => poses.newest(),
        }
    }
}

impl PoseSource {
    /// Drops every pose that was received until now, also those that wait in the socket: only a later one counts.
    /// Datagrams that queued up while the board was prepared are seconds old.
    pub fn discard(&mut self) {
        if let Self::Udp(poses) = self {
            poses.receive();
            poses.newest = None;
            poses.since = Instant::now();
        }
    }

    /// Whether it is still worth waiting for the first pose after [`PoseSource::discard`].
    #[must_use]
    pub fn may_still_come(&self) -> bool {
        match self {
            Self::Udp(poses) => poses.newest.is_none() && poses.since.elapsed() < FIRST_POSE_WAIT,
            Self::Rig | Self::Static(_) => false,
        }
    }
}

impl UdpPoses {
    fn listen(listen: &str, max_age: Duration) -> Result<Self, PoseError> {
        let open = || {
            let socket = UdpSocket::bind(listen)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        Ok(Self {
            socket: open().map_err(|cause| PoseError::Listen {
                listen: listen.to_owned(),
                cause,
            })?,
            listen: listen.to_owned(),
            max_age,
            newest: None,
            since: Instant::now(),
            bad: 0,
        })
    }

    /// Reads the datagrams that have arrived.
    fn receive(&mut self) {
        let mut datagram = [0; DATAGRAM];
        while let Ok(length) = self.socket.recv(&mut datagram) {
            match parse(&datagram[..length]) {
                Some(position_m) => self.newest = Some((Instant::now(), position_m)),
                None => self.bad += 1,
            }
        }
    }

    fn newest(&mut self) -> Result<Vector3<f64>, PoseError> {
        self.receive();
        let came = self.newest.map_or(self.since, |(at, _)| at);
        match self.newest {
            Some((at, position_m)) if at.elapsed() <= self.max_age => Ok(position_m),
            _ => Err(PoseError::Stale {
                listen: self.listen.clone(),
                age_s: came.elapsed().as_secs_f64(),
                bad: self.bad,
            }),
        }
    }
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Position {
    Array([f64; 3]),
    Named { x: f64, y: f64, z: f64 },
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Message {
    Crtk { measured_cp: Body },
    Plain(Body),
}

#[derive(Deserialize)]
struct Body {
    position: Position,
}

/// The position in a datagram, in m; `None` where it holds none, or not the last line of several.
fn parse(datagram: &[u8]) -> Option<Vector3<f64>> {
    let text = std::str::from_utf8(datagram).ok()?;
    // Several lines in one datagram: the last one is the newest.
    let line = text.lines().rev().find(|line| !line.trim().is_empty())?;
    let body = match serde_json::from_str(line).ok()? {
        Message::Crtk { measured_cp } => measured_cp,
        Message::Plain(body) => body,
    };
    let position_m = match body.position {
        Position::Array(position_m) => Vector3::from(position_m),
        Position::Named { x, y, z } => Vector3::new(x, y, z),
    };
    position_m
        .iter()
        .all(|v| v.is_finite())
        .then_some(position_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_of_poses() {
        let p = Some(Vector3::new(0.1, -0.2, 0.3));
        assert_eq!(
            parse(br#"{"measured_cp": {"position": [0.1, -0.2, 0.3], "orientation": [0,0,0,1]}}"#),
            p
        );
        assert_eq!(
            parse(br#"{"position": {"x": 0.1, "y": -0.2, "z": 0.3}, "t": 5}"#),
            p
        );
        assert_eq!(
            parse(b"{\"position\": [9, 9, 9]}\n{\"position\": [0.1, -0.2, 0.3]}\n"),
            p
        );
        for bad in [
            &b""[..],
            b"\n\n",
            b"{}",
            b"[1,2,3]",
            b"\xff\xfe",
            br#"{"position": [0.1, 0.2]}"#,
            br#"{"position": [0.1, 0.2, null]}"#,
        ] {
            assert_eq!(parse(bad), None, "{bad:?}");
        }
    }

    #[test]
    fn datagrams_arrive_and_age() {
        let mut source = UdpPoses::listen("127.0.0.1:0", Duration::from_secs(3600)).unwrap();
        assert!(matches!(
            source.newest(),
            Err(PoseError::Stale { bad: 0, .. })
        ));
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let to = source.socket.local_addr().unwrap();
        sender.send_to(b"no pose", to).unwrap();
        sender
            .send_to(br#"{"position": [0.1, -0.2, 0.3]}"#, to)
            .unwrap();
        let found = (0..1000).find_map(|_| {
            std::thread::sleep(Duration::from_millis(1));
            source.newest().ok()
        });
        assert_eq!(found, Some(Vector3::new(0.1, -0.2, 0.3)));
        assert_eq!(source.bad, 1);
        let mut source = PoseSource::Udp(source);
        // A pose that waits in the socket is dropped; one that comes later counts.
        sender
            .send_to(br#"{"position": [9.0, 9.0, 9.0]}"#, to)
            .unwrap();
        std::thread::sleep(Duration::from_millis(50));
        source.discard();
        assert!(source.may_still_come());
        assert!(matches!(source.tip_m(None), Err(PoseError::Stale { .. })));
        sender
            .send_to(br#"{"position": [0.3, 0.2, 0.1]}"#, to)
            .unwrap();
        let found = (0..1000).find_map(|_| {
            std::thread::sleep(Duration::from_millis(1));
            source.tip_m(None).ok()
        });
        assert_eq!(found, Some(Vector3::new(0.3, 0.2, 0.1)));
        assert!(!source.may_still_come());
        let PoseSource::Udp(mut source) = source else {
            unreachable!("it is one");
        };
        source.max_age = Duration::ZERO;
        std::thread::sleep(Duration::from_millis(1));
        assert!(source.newest().unwrap_err().to_string().contains("no pose"));
    }
}
