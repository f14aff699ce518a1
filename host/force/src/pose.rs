//! Where the robot's tip is.
//!
//! The embedded rig reports its robot's pose with the link. On a real rig the robot's own software
//! does:
//!
//! * `source = "udp"`: one JSON object to a datagram, newline or not, sent at 100 Hz or faster,
//!   shaped like a CRTK `measured_cp` message. Only the position is used, in metres in the robot's
//!   base frame:
//!
//!   ```json
//!   {"measured_cp": {"position": [-0.08, 0.025, -0.14]}}
//!   ```
//!
//!   The shapes are those of [`robot::source::Udp`]. `{"position": [x, y, z]}` and
//!   `{"position": {"x": x, "y": y, "z": z}}` do as well; keys that are not known are told once
//!   ([`PoseSource::notices`]). Every pose passes [`robot::watch::Watch`]: a pose older than
//!   `max_age_s`, or none at all, a tip that jumps, another `frame_id`, a second sender, and an
//!   `operating_state` that is FAULT or DISABLED stop the rig.
//! * `source = "static"`: the tip is clamped at `position_m`.

use crate::preview::Moment;
use nalgebra::Vector3;
use rig::PoseChoice;
use robot::source::{Source, SourceError, Udp, UdpConfig};
use robot::state::StateError;
use robot::watch::{Event, WatchConfig};
use std::time::{Duration, Instant};

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
    /// The link brings none, or no longer.
    #[error("this link reports no pose, or none any more; set `source` in [pose] of the rig file to \"udp\" or \"static\"")]
    NotFromLink,
    /// Nothing has come yet, or not for too long.
    #[error("no pose of the robot on {listen} for {age_s:.2} s ({bad} datagrams were no poses{}); is the robot's software sending?", last.as_ref().map_or_else(String::new, |last| format!("; the last thing that was refused: {last}")))]
    Stale {
        /// The address.
        listen: String,
        /// Age in s.
        age_s: f64,
        /// Datagrams that could not be read.
        bad: u64,
        /// What was refused last since the newest pose.
        last: Option<Box<Event>>,
    },
    /// What the robot tells on the way to its poses.
    #[error("poses on {listen}: {event}")]
    Robot {
        /// The address.
        listen: String,
        /// What is not in order.
        event: Event,
    },
}

/// A source of poses.
#[derive(Debug)]
pub enum PoseSource {
    /// The link.
    Rig,
    /// Datagrams.
    Udp(Box<UdpPoses>),
    /// A clamped tip.
    Static(Vector3<f64>),
}

/// Receives poses as datagrams.
#[derive(Debug)]
pub struct UdpPoses {
    listen: String,
    source: Udp,
    max_age_s: f64,
    /// The newest pose and when it came, ns since `began`.
    newest: Option<(i64, Vector3<f64>)>,
    /// When the newest pose was, ns since `began`, where its sender stamps it.
    tip_at_ns: Option<i64>,
    /// When it was asked for, ns since `began`.
    asked_ns: i64,
    began: Instant,
    since: Instant,
    bad: u64,
    /// What was refused since the newest pose.
    last: Option<Box<Event>>,
    /// What is to be told and ends nothing.
    notices: Vec<String>,
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
            PoseChoice::Udp { listen, max_age_s } => {
                Self::Udp(Box::new(UdpPoses::listen(listen, *max_age_s)?))
            }
        })
    }

    /// The tip now, robot base frame, m; `from_link` is what the link reported last, where that is
    /// not too old.
    ///
    /// # Errors
    /// There is none, it is too old, or it is not to be believed.
    pub fn tip_m(&mut self, from_link: Option<Vector3<f64>>) -> Result<Vector3<f64>, PoseError> {
        match self {
            Self::Rig => from_link.ok_or(PoseError::NotFromLink),
            Self::Static(position_m) => Ok(*position_m),
            Self::Udp(poses) => poses.newest(),
        }
    }

    /// The tip as [`Self::tip_m`] has it, and when it was there. `from_link`: what the link
    /// reported last, and when, ns; `now_ns`: the link's time. A clamped tip has no time.
    ///
    /// # Errors
    /// As [`Self::tip_m`].
    pub fn tip(
        &mut self,
        from_link: Option<([f64; 3], u64)>,
        now_ns: u64,
    ) -> Result<(Vector3<f64>, Option<Moment>), PoseError> {
        let tip_m = self.tip_m(from_link.map(|(tip_m, _)| tip_m.into()))?;
        let s = |ns: f64| ns * 1e-9;
        let moment = match self {
            Self::Rig => from_link.map(|(_, at_ns)| Moment {
                tip_s: s(at_ns as f64),
                now_s: s(now_ns as f64),
            }),
            Self::Static(_) => None,
            Self::Udp(poses) => poses.tip_at_ns.map(|at_ns| Moment {
                tip_s: s(at_ns as f64),
                now_s: s(poses.asked_ns as f64),
            }),
        };
        Ok((tip_m, moment))
    }

    /// Drops every pose that was received until now, also those that wait in the socket: only a
    /// later one counts. Datagrams that queued up while the board was prepared are seconds old.
    pub fn discard(&mut self) {
        if let Self::Udp(poses) = self {
            poses.source.forget();
            poses.newest = None;
            poses.last = None;
            poses.tip_at_ns = None;
            poses.since = Instant::now();
        }
    }

    /// What the datagrams gave to tell since the last call, such as a key that is not known. It
    /// ends nothing.
    pub fn notices(&mut self) -> Vec<String> {
        match self {
            Self::Udp(poses) => (poses.notices.drain(..))
                .map(|text| format!("poses on {}: {text}", poses.listen))
                .collect(),
            Self::Rig | Self::Static(_) => Vec::new(),
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
    fn listen(listen: &str, max_age_s: f64) -> Result<Self, PoseError> {
        let config = UdpConfig {
            listen: listen.to_owned(),
            watch: WatchConfig {
                max_age_s,
                ..WatchConfig::default()
            },
            ..UdpConfig::default()
        };
        let source = Udp::listen(&config).map_err(|error| PoseError::Listen {
            listen: listen.to_owned(),
            cause: match error {
                SourceError::Listen { cause, .. } => cause,
                error => std::io::Error::other(error.to_string()),
            },
        })?;
        Ok(Self {
            source,
            listen: listen.to_owned(),
            max_age_s,
            newest: None,
            tip_at_ns: None,
            asked_ns: 0,
            began: Instant::now(),
            since: Instant::now(),
            bad: 0,
            last: None,
            notices: Vec::new(),
        })
    }

    fn newest(&mut self) -> Result<Vector3<f64>, PoseError> {
        let now_ns = i64::try_from(self.began.elapsed().as_nanos()).unwrap_or(i64::MAX);
        self.asked_ns = now_ns;
        let wrong = |listen: &str, event| PoseError::Robot {
            listen: listen.to_owned(),
            event,
        };
        let poll = match self.source.poll(now_ns) {
            Ok(poll) => poll,
            Err(error) => {
                let event = Event::Invalid(StateError::Format(error.to_string()));
                return Err(wrong(&self.listen, event));
            }
        };
        self.bad += poll.left_out.get("datagrams").unwrap_or(&0);
        for event in &poll.events {
            let is_no_message = matches!(event, Event::LeftOut(flaw) if flaw.is_no_message());
            if is_no_message || event.stops() && !matches!(event, Event::Silent { .. }) {
                self.last = Some(Box::new(event.clone()));
            }
            match event {
                // Of a shape that is not read. Too many in a row are a pose that is too old.
                Event::Invalid(StateError::Format(_)) => self.bad += 1,
                Event::Silent { .. } => {}
                event if event.stops() => return Err(wrong(&self.listen, event.clone())),
                Event::LeftOut(_) => self.notices.push(event.to_string()),
                _ => {}
            }
        }
        for state in &poll.states {
            if let (Some(tip), Some(received)) = (&state.tip, &state.received) {
                self.last = None;
                self.newest = Some((received.t_ns, tip.position_m.into()));
                self.tip_at_ns = poll.tip_at_ns(state);
            }
        }
        let age_s = match self.newest {
            Some((at_ns, _)) => (now_ns - at_ns) as f64 * 1e-9,
            None => self.since.elapsed().as_secs_f64(),
        };
        match self.newest {
            Some((_, position_m)) if age_s <= self.max_age_s => Ok(position_m),
            _ => Err(PoseError::Stale {
                listen: self.listen.clone(),
                age_s,
                bad: self.bad,
                last: self.last.clone(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    const POSE: &str = r#"{"position": [0.1, -0.2, 0.3]}"#;

    /// A source for poses that never get too old, and who sends them.
    struct Rig {
        source: PoseSource,
        sender: UdpSocket,
    }

    impl Rig {
        fn new() -> Self {
            let poses = UdpPoses::listen("127.0.0.1:0", 3600.0).unwrap();
            let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
            sender.connect(poses.source.address()).unwrap();
            Self {
                source: PoseSource::Udp(Box::new(poses)),
                sender,
            }
        }

        fn poses(&mut self) -> &mut UdpPoses {
            match &mut self.source {
                PoseSource::Udp(poses) => poses,
                _ => unreachable!("it is one"),
            }
        }

        /// Sends a datagram, and waits until the source shows it.
        fn until(
            &mut self,
            datagram: &str,
            found: impl Fn(&Result<Vector3<f64>, PoseError>, u64) -> bool,
        ) {
            self.sender.send(datagram.as_bytes()).unwrap();
            for _ in 0..20_000 {
                let tip = self.source.tip_m(None);
                let bad = self.poses().bad;
                if found(&tip, bad) {
                    return;
                }
                std::thread::sleep(Duration::from_micros(100));
            }
            panic!("never came: {datagram}");
        }

        fn reaches(&mut self, datagram: &str, tip_m: [f64; 3]) {
            self.until(
                datagram,
                |tip, _| matches!(tip, Ok(tip) if *tip == Vector3::from(tip_m)),
            );
        }

        fn stops(&mut self, datagram: &str, words: &str) {
            self.until(datagram, |tip, _| {
                matches!(tip, Err(error @ PoseError::Robot { .. }) if error.to_string().contains(words))
            });
        }
    }

    #[test]
    fn datagrams_arrive_and_age() {
        let mut rig = Rig::new();
        assert!(matches!(
            rig.source.tip_m(None),
            Err(PoseError::Stale { bad: 0, .. })
        ));
        rig.until("no pose", |_, bad| bad == 1);
        // Who waits for the first pose learns why none is.
        let error = rig.source.tip_m(None).unwrap_err();
        assert!(error.to_string().contains("can't be read"), "{error}");
        rig.until("{\"position\"", |_, bad| bad == 2);
        rig.reaches(POSE, [0.1, -0.2, 0.3]);
        rig.poses().max_age_s = 0.0;
        std::thread::sleep(Duration::from_millis(1));
        let error = rig.source.tip_m(None).unwrap_err();
        assert!(error.to_string().contains("no pose"), "{error}");
    }

    #[test]
    fn a_key_that_is_not_known_is_told_once() {
        let mut rig = Rig::new();
        for tip_m in [[0.1, -0.2, 0.3], [0.1, -0.2, 0.3001]] {
            let pose = format!(r#"{{"position": {tip_m:?}, "time": 5}}"#);
            rig.reaches(&pose, tip_m);
        }
        let told = rig.source.notices();
        assert!(told.len() == 1 && told[0].contains("`time`"), "{told:?}");
        assert!(rig.source.notices().is_empty());
    }

    #[test]
    fn what_came_before_arming_does_not_count() {
        let mut rig = Rig::new();
        rig.reaches(r#"{"position": [0.9, 0.9, 0.9]}"#, [0.9, 0.9, 0.9]);
        rig.source.discard();
        assert!(rig.source.may_still_come());
        assert!(matches!(
            rig.source.tip_m(None),
            Err(PoseError::Stale { .. })
        ));
        // The arm may have moved far since, and another program may send.
        rig.sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let to = rig.poses().source.address();
        rig.sender.connect(to).unwrap();
        rig.reaches(POSE, [0.1, -0.2, 0.3]);
        assert!(!rig.source.may_still_come());
    }

    #[test]
    fn a_tip_that_jumps_another_frame_and_a_robot_in_fault_stop_the_rig() {
        let jump = r#"{"position": [0.1, -0.2, 0.308]}"#;
        let frame = r#"{"measured_cp": {"position": [0.1, -0.2, 0.3], "frame_id": "ECM"}}"#;
        let fault = r#"{"position": [0.1, -0.2, 0.3], "operating_state": {"state": "FAULT"}}"#;
        // CRTK has the operating state on a topic of its own.
        let alone = r#"{"operating_state": {"state": "FAULT"}}"#;
        let nan = r#"{"position": [0.1, -0.2, null]}"#;
        let invalid = r#"{"position": [0.1, -0.2, 0.3], "stamp_s": 0}"#;
        let ns = r#"{"position": [0.1, -0.2, 0.3], "stamp_s": 1795860000000000000}"#;
        for (datagram, words) in [
            (frame, "`ECM`"),
            (fault, "in FAULT"),
            (alone, "in FAULT"),
            (nan, "not a number"),
            (invalid, "stamp is 0"),
            (ns, "ms, us or ns"),
        ] {
            let mut rig = Rig::new();
            rig.reaches(POSE, [0.1, -0.2, 0.3]);
            // It changes nothing.
            let enabled = r#"{"operating_state": {"state": "ENABLED", "is_homed": true}}"#;
            rig.sender.send(enabled.as_bytes()).unwrap();
            rig.reaches(POSE, [0.1, -0.2, 0.3]);
            rig.stops(datagram, words);
        }
        // Of ROS's shape, and a datagram that contradicts itself.
        let header = |stamp: &str, frame: &str| {
            POSE.replace(
                '}',
                &format!(r#", "header": {{"stamp": {stamp}, "frame_id": "{frame}"}}}}"#),
            )
        };
        let twice = header("7", "").replace('{', r#"{"stamp_s": 9, "#);
        let twice = twice.replacen(r#""header": {"stamp_s": 9, "#, r#""header": {"#, 1);
        for (datagram, words) in [
            (header(r#"{"secs": 0, "nsecs": 0}"#, ""), "stamp is 0"),
            (header("null", "ECM"), "`ECM`"),
            (twice, "its stamp is"),
        ] {
            let mut rig = Rig::new();
            rig.reaches(POSE, [0.1, -0.2, 0.3]);
            rig.stops(&datagram, words);
        }
        // By the sender's own clock, 10 ms apart: this test may be held up for longer.
        let mut rig = Rig::new();
        let at =
            |stamp_s: f64, pose: &str| pose.replace('}', &format!(r#", "stamp_s": {stamp_s}}}"#));
        rig.poses().source.forget();
        rig.reaches(&at(100.0, POSE), [0.1, -0.2, 0.3]);
        rig.stops(&at(100.01, jump), "jumped");
    }
}
