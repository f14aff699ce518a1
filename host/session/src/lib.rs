//! A session with the board: links, connecting, commands with their responses, telemetry, clocks.
//!
//! | question | file |
//! | --- | --- |
//! | how do bytes get to the board | [`link`] |
//! | faults to inject into an emulated rig, as text | [`inject`] |
//! | who is the board, which protocol does it speak | `handshake` |
//! | a command and its response | `request` |
//! | bytes to samples, faults and status; time | `receive` |
//! | when the board read its clock | `timekeeping` |
//! | the board's clock against the host's | [`clock`] |
//! | what a rig does now, as one object | [`telemetry`] |
//! | how long a step may take, by the board's clock | `patience` |
//! | numbers in words | `explain` |
//! | what can go wrong | `error` |
//!
//! Whatever arrives while a command waits for its response is stored and returned by [`Session::drain`], so no sample
//! is lost during a request. While setpoints are in force they are sent again every 10 ms, also during a request: the
//! board stops within 100 ms when they cease. SI units throughout; the wire's integers end here.

pub mod clock;
mod error;
mod explain;
mod gaps;
mod handshake;
pub mod inject;
pub mod link;
mod patience;
mod receive;
mod request;
pub mod telemetry;
mod timekeeping;

pub use error::SessionError;
pub use explain::{
    command_name, explain_crash_record, explain_fault, explain_refusal, explain_report,
    motor_state_name, system_state_name,
};
pub use gaps::Gaps;
pub use patience::Patience;

use crate::clock::Reading;
use crate::link::RigLink;
use emulator_link::{Pose, Truth};
use std::time::Duration;
use timekeeping::Timekeeping;
use wire::message::{BoardInfo, FaultReport, Response, Sample, Status, UnitSetpoint};
use wire::{Decoder, UNITS};

/// Period of the host's controller and of the setpoints (thesis 3.7: 100 Hz).
pub const PERIOD: Duration = Duration::from_millis(10);
/// For how long the board may hold setpoints, in milliseconds: nine lost frames in a row are survived.
pub const SETPOINTS_VALID_MS: u16 = 100;
/// A tension older than this, counted from the newest of all units, is not used, us: a few sample periods.
const MAX_SAMPLE_AGE_US: u64 = 30_000;
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
    link: &'l mut dyn RigLink,
    decoder: Decoder,
    seq: u16,
    outbox: Vec<u8>,
    received: Received,
    reply: Option<(u16, Response)>,
    status: Option<Status>,
    info: Option<BoardInfo>,
    pose: Option<Pose>,
    counters: LinkCounters,
    gaps: Gaps,
    /// Board time of the last frame, unwrapped.
    board_us: Option<u64>,
    resets: Option<u32>,
    reset_seen: bool,
    now_ns: u64,
    /// UTC at `now_ns`, ns since 1970.
    utc_ns: u64,
    last_frame_ns: u64,
    pace: patience::Pace,
    timekeeping: Timekeeping,
    setpoints: Option<[UnitSetpoint; UNITS]>,
    setpoints_due_ns: u64,
    /// Newest tension of each unit in N, and when (board time, us).
    tension_n: [Option<(f64, u64)>; UNITS],
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
            // A zero ends whatever was on the line before.
            outbox: vec![0],
            received: Received::default(),
            reply: None,
            status: None,
            info: None,
            pose: None,
            counters: LinkCounters::default(),
            gaps: Gaps::default(),
            board_us: None,
            resets: None,
            reset_seen: false,
            now_ns: 0,
            utc_ns: 0,
            last_frame_ns: 0,
            pace: patience::Pace::default(),
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

    /// The newest pose that the link itself reported.
    #[must_use]
    pub fn pose(&self) -> Option<Pose> {
        self.pose
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

    /// Newest cable tension of each unit in N; `None` where it is more than 30 ms older than the newest of all.
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

    /// The first fault among what was received, else the one that the board's status names, in words.
    #[must_use]
    pub fn fault_in(&self, received: &Received) -> Option<String> {
        let reported = received.faults.first().map(explain_report);
        let latched = || {
            let status = self.status().filter(|status| status.fault != 0)?;
            Some(explain_fault(status.fault, status.fault_detail))
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

    /// Puts setpoints in force from now on: they go out with the next exchange and every 10 ms after it.
    /// `None` ends that.
    pub fn set_setpoints(&mut self, setpoints: Option<[UnitSetpoint; UNITS]>) {
        self.setpoints = setpoints;
        self.setpoints_due_ns = self.now_ns;
    }
}
