//! A session with the board: its state, and what arrived.

use crate::clock::Reading;
use crate::error::SessionError;
use crate::explain::LatchedFault;
use crate::gaps::Gaps;
use crate::link::RigLink;
use crate::patience::Pace;
use crate::timekeeping::Timekeeping;
use emulator_link::{Pose, Truth};
use std::collections::VecDeque;
use std::time::Duration;
use wire::message::{BoardInfo, CommandError, FaultReport, Response, Sample, Status, UnitSetpoint};
use wire::{Command, Decoder, UNITS};

/// Period of the host's controller and of the setpoints (thesis 3.7: 100 Hz).
pub const PERIOD: Duration = Duration::from_millis(10);
/// For how long the board may hold setpoints, in milliseconds: nine lost frames in a row are
/// survived.
pub const SETPOINTS_VALID_MS: u16 = 100;
/// A tension older than this, counted from the newest of all units, is not used, us: a few sample
/// periods.
const MAX_SAMPLE_AGE_US: u64 = 30_000;
/// A pose older than this is not used, ns: as of a robot's own software (`max_age_s`).
pub(super) const MAX_POSE_AGE_NS: u64 = 100_000_000;
/// A board that sends nothing for this long of its own time is gone: its status comes every 50 ms.
pub const SILENCE_TIMEOUT: Duration = Duration::from_millis(400);

/// A sample with its place in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimedSample {
    /// DRDY edge in microseconds of board time, without the wire's wrap.
    pub t_us: u64,
    /// The sample.
    pub sample: Sample,
}

/// What arrived since the last [`Session::drain`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Received {
    /// Samples, in order.
    pub samples: Vec<TimedSample>,
    /// Faults, as they were latched.
    pub faults: Vec<FaultReport>,
    /// The plant's true state (embedded rig).
    pub truth: Vec<Truth>,
    /// Readings of the board's clock.
    pub readings: Vec<Reading>,
    /// Time of the link when the newest of this had arrived, ns ([`Session::now_ns`]).
    pub host_ns: u64,
    /// UTC at that time, ns since 1970, by this machine's clock.
    pub utc_ns: u64,
    /// Counters of the link at that time.
    pub counters: LinkCounters,
    /// The newest status, where one arrived.
    pub status: Option<Status>,
}

/// Counters of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct LinkCounters {
    /// Frames of the board that never arrived, by gaps in their numbers.
    pub frames_lost: u64,
    /// Frames that arrived damaged.
    pub frames_bad: u64,
    /// Frames with a good CRC and unknown content: another protocol.
    pub frames_unknown: u64,
    /// Good frames.
    pub frames: u64,
    /// Bytes received.
    pub bytes: u64,
    /// Commands that had to be sent again.
    pub retries: u64,
}

/// A session with a board over a link.
pub struct Session<'l> {
    pub(super) link: &'l mut dyn RigLink,
    pub(super) decoder: Decoder,
    pub(super) seq: u16,
    pub(super) outbox: Vec<u8>,
    pub(super) received: Received,
    pub(super) reply: Option<(u16, Response)>,
    pub(super) status: Option<Status>,
    pub(super) info: Option<BoardInfo>,
    pub(super) pose: Option<Pose>,
    /// When it came.
    pub(super) pose_ns: u64,
    pub(super) counters: LinkCounters,
    pub(super) gaps: Gaps,
    /// Board time of the last frame, unwrapped.
    pub(super) board_us: Option<u64>,
    pub(super) resets: Option<u32>,
    pub(super) reset_seen: bool,
    pub(super) now_ns: u64,
    /// UTC at `now_ns`, ns since 1970.
    pub(super) utc_ns: u64,
    pub(super) last_frame_ns: u64,
    pub(super) pace: Pace,
    pub(super) timekeeping: Timekeeping,
    pub(super) setpoints: Option<[UnitSetpoint; UNITS]>,
    pub(super) setpoints_due_ns: u64,
    /// The last commands with setpoints and the numbers of their frames, the newest first.
    pub(super) setpoints_sent: VecDeque<(u16, Command)>,
    /// One of them that the board has refused, and why.
    pub(super) setpoints_refused: Option<(Command, CommandError)>,
    /// Newest tension of each unit in N, and when (board time, us).
    pub(super) tension_n: [Option<(f64, u64)>; UNITS],
}

impl std::fmt::Debug for Session<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session")
            .field("link", &self.link.name())
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}

impl<'l> Session<'l> {
    /// Connects to the board and compares protocol versions.
    ///
    /// # Errors
    /// No board answers, or one with another version.
    pub fn connect(link: &'l mut dyn RigLink) -> Result<Self, SessionError> {
        let mut session = Self {
            link,
            decoder: Decoder::new(),
            seq: 0,
            setpoints_sent: VecDeque::new(),
            setpoints_refused: None,
            // A zero ends whatever was on the line before.
            outbox: vec![0],
            received: Received::default(),
            reply: None,
            status: None,
            info: None,
            pose: None,
            pose_ns: 0,
            counters: LinkCounters::default(),
            gaps: Gaps::default(),
            board_us: None,
            resets: None,
            reset_seen: false,
            now_ns: 0,
            utc_ns: 0,
            last_frame_ns: 0,
            pace: Pace::default(),
            timekeeping: Timekeeping::default(),
            setpoints: None,
            setpoints_due_ns: 0,
            tension_n: [None; UNITS],
        };
        session.handshake()?;
        Ok(session)
    }

    /// The board's response to hello.
    #[must_use]
    pub fn info(&self) -> Option<&BoardInfo> {
        self.info.as_ref()
    }

    /// The newest status.
    #[must_use]
    pub fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// The newest pose that the link itself reported; `None` where it has reported none for 100 ms.
    #[must_use]
    pub fn pose(&self) -> Option<Pose> {
        self.pose
    }

    /// The tip of [`Self::pose`] and when it was reported, ns ([`Self::now_ns`]).
    #[must_use]
    pub fn tip_m(&self) -> Option<([f64; 3], u64)> {
        self.pose.map(|pose| (pose.position_m, self.pose_ns))
    }

    /// Counters of the link.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// Time of the link in nanoseconds ([`crate::link::Exchange::now_ns`]).
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Newest cable tension of each unit in N with its board time in microseconds.
    #[must_use]
    pub fn tension_n(&self) -> [Option<(f64, u64)>; UNITS] {
        self.tension_n
    }

    /// Newest cable tension of each unit in N; `None` where it is more than 30 ms older than the
    /// newest of all.
    #[must_use]
    pub fn recent_tension_n(&self) -> [Option<f64>; UNITS] {
        let newest_us = self.tension_n.iter().flatten().map(|(_, at)| *at).max();
        let oldest_us = newest_us.unwrap_or(0).saturating_sub(MAX_SAMPLE_AGE_US);
        self.tension_n.map(|tension| {
            tension
                .filter(|(_, at)| *at >= oldest_us)
                .map(|(tension, _)| tension)
        })
    }

    /// How much older a board time of the wire is than the newest frame, s; `None` before the
    /// first.
    #[must_use]
    pub fn age_s(&self, t_us: u32) -> Option<f64> {
        let newest_us = self.board_us? as u32;
        Some(f64::from(newest_us.wrapping_sub(t_us) as i32) * 1e-6)
    }

    /// The first fault among what was received, else the one that the board's status names.
    #[must_use]
    pub fn fault_in(&self, received: &Received) -> Option<LatchedFault> {
        let reported = received.faults.first().map(LatchedFault::from);
        let latched = || {
            let status = self.status().filter(|status| status.fault != 0)?;
            Some(LatchedFault::of_board(status))
        };
        reported.or_else(latched)
    }

    /// The link, for what is not part of the protocol.
    pub fn link(&mut self) -> &mut dyn RigLink {
        self.link
    }

    /// The samples since the last [`Session::drain`], which keeps them for it.
    #[must_use]
    pub fn undrained_samples(&self) -> &[TimedSample] {
        &self.received.samples
    }

    /// Everything that arrived since the last call.
    pub fn drain(&mut self) -> Received {
        Received {
            host_ns: self.now_ns,
            utc_ns: self.utc_ns,
            counters: self.counters,
            ..std::mem::take(&mut self.received)
        }
    }
}
