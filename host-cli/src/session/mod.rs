//! A conversation with the board: connecting, commands with their answers, what the board tells unasked.
//!
//! Whatever arrives while a command waits for its answer is kept and handed out by [`Session::drain`], so
//! no sample is lost to a question. While setpoints are in force they are sent again every 10 ms, also
//! during a question: the board stops within 100 ms when they cease.

use crate::link::{LinkError, RigLink};
use control::config::FIELDS;
use control::{Fault, MotorState, SystemState};
use emulator_link::{Pose, Truth};
use std::time::Duration;
use wire::message::{
    BoardInfo, CommandError, CrashRecord, FaultReport, Response, Sample, Status, UnitConfig,
    UnitSetpoint,
};
use wire::{BoardFrame, BoardMessage, Command, Decoder, FrameError, HostFrame, UNITS};

/// Period of the host's controller and of the setpoints (thesis 3.7: 100 Hz).
pub const PERIOD: Duration = Duration::from_millis(10);
/// For how long the board may hold setpoints, in milliseconds: nine lost frames in a row are survived.
pub const SETPOINTS_VALID_MS: u16 = 100;
/// How long an answer may take. The board answers within a pass of its loop; the rest is the link's.
const ANSWER_WITHIN: Duration = Duration::from_millis(150);
/// How often a command is sent before the link counts as dead. Every command may be repeated.
const ATTEMPTS: u32 = 4;
/// Time between two looks for an answer.
const LOOK_EVERY: Duration = Duration::from_millis(1);
/// A board that says nothing for this long is gone: its status comes every 50 ms.
pub const SILENCE: Duration = Duration::from_millis(400);
/// How long a board may take from power-on to its first answer.
const BOOT_WITHIN: Duration = Duration::from_secs(3);
/// Board times further back than this are a reset and not telemetry out of order, in microseconds.
const RESET_JUMP_US: i32 = -500_000;

/// A sample with its place in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimedSample {
    /// DRDY edge in microseconds of board time, without the wire's wrap.
    pub t_us: u64,
    /// The sample.
    pub sample: Sample,
}

/// What came in since the last [`Session::drain`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Received {
    /// Samples, in order.
    pub samples: Vec<TimedSample>,
    /// Faults, as they were latched.
    pub faults: Vec<FaultReport>,
    /// The plant's true state (embedded rig).
    pub truth: Vec<Truth>,
}

/// Counters of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct LinkCounters {
    /// Frames of the board that never arrived, by gaps in their numbers.
    pub frames_lost: u64,
    /// Frames that arrived damaged.
    pub frames_bad: u64,
    /// Frames whose CRC was right and whose content unknown: another protocol.
    pub frames_unknown: u64,
    /// Good frames.
    pub frames: u64,
    /// Bytes received.
    pub bytes: u64,
    /// Commands that had to be sent again.
    pub retries: u64,
}

/// Why a conversation failed.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The link itself.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No board answered when connecting.
    #[error("no board answers on {link}: {what}")]
    NoBoard {
        /// The link's name.
        link: String,
        /// What was received instead, and what to do.
        what: String,
    },
    /// Board and host speak other protocols.
    #[error("the board speaks ABI {abi} with schema {schema:02x?}, this forcectl ABI {own_abi} with schema {own_schema:02x?}: {advice}")]
    Version {
        /// The board's ABI version.
        abi: u16,
        /// The board's schema hash.
        schema: [u8; 8],
        /// This program's ABI version.
        own_abi: u16,
        /// This program's schema hash.
        own_schema: [u8; 8],
        /// Which side to update, and how.
        advice: String,
    },
    /// The board did not carry a command out.
    #[error("the board refused `{command}`: {why}")]
    Refused {
        /// The command.
        command: &'static str,
        /// Why, and what to do.
        why: String,
        /// The board's own words.
        refusal: CommandError,
    },
    /// The board fell silent or doesn't answer.
    #[error("the board doesn't answer `{command}` any more; it goes to 0 V by itself when setpoints cease; check cable and supply, then `forcectl status`")]
    NoAnswer {
        /// What it was asked, or was to send.
        command: &'static str,
    },
    /// The board was reset in between.
    #[error("the board was reset while connected{}; its motors are at 0 V", kept.as_ref().map(|k| format!(": {k}")).unwrap_or_default())]
    Reset {
        /// What the board kept of the reason.
        kept: Option<String>,
    },
    /// A fault of the whole board is latched.
    #[error("{0}")]
    Fault(String),
    /// Something took longer than it may.
    #[error("{0}")]
    TooLong(String),
}

/// A person's name for a command.
#[must_use]
pub fn command_name(command: &Command) -> &'static str {
    match command {
        Command::Hello { .. } => "hello",
        Command::GetStatus => "get status",
        Command::GetConfig { .. } => "get configuration",
        Command::StageConfig { .. } => "stage configuration",
        Command::CommitConfig => "commit configuration",
        Command::Zero { .. } => "zero",
        Command::Arm => "arm",
        Command::Disarm => "disarm",
        Command::Stop => "stop",
        Command::ClearFaults => "clear faults",
        Command::Setpoints { .. } => "setpoints",
        Command::Stream { .. } => "stream",
    }
}

/// Name of a system state's number.
#[must_use]
pub fn system_state_name(number: u8) -> String {
    SystemState::from_u8(number).map_or_else(
        || format!("unknown state {number}"),
        |s| s.name().to_owned(),
    )
}

/// Name of a unit's state's number.
#[must_use]
pub fn motor_state_name(number: u8) -> String {
    MotorState::from_u8(number).map_or_else(
        || format!("unknown state {number}"),
        |s| s.name().to_owned(),
    )
}

/// A fault in one line: number, name, meaning, way out.
#[must_use]
pub fn explain_fault(code: u16, detail: u32) -> String {
    match Fault::from_code(code) {
        Some(fault) => format!(
            "fault {code}, {}. {} {} (detail {detail}: {}; `forcectl explain {code}`)",
            fault.name(),
            fault.meaning(),
            fault.what_to_do(),
            fault.detail_meaning()
        ),
        None => format!("fault {code} (detail {detail}), which this forcectl does not know; is the firmware newer?"),
    }
}

/// What the run before this one left, in one line.
#[must_use]
pub fn explain_crash_record(kept: &CrashRecord) -> String {
    let mut text = match Fault::from_code(kept.code) {
        Some(fault) => format!("fault {}, {}", kept.code, fault.name()),
        None => format!("reason {}", kept.code),
    };
    if kept.pc != 0 {
        text.push_str(&format!(", at {:#010x}", kept.pc));
    }
    if !kept.text.is_empty() {
        text.push_str(&format!(": {}", kept.text.as_str()));
    }
    text
}

/// Why a command was refused, and what to do.
#[must_use]
pub fn explain_refusal(refusal: &CommandError) -> String {
    match *refusal {
        CommandError::NotConnected => "it has not been greeted on this link; it was reset, or another program took over: connect again".to_owned(),
        CommandError::Version { abi, .. } => format!("it speaks ABI {abi}"),
        CommandError::State(state) => match SystemState::from_u8(state) {
            Some(SystemState::Running | SystemState::Stopping) => "it is armed; `forcectl disarm` first".to_owned(),
            Some(SystemState::BringUp | SystemState::Boot) => "its sensors are still being brought up; wait a second, see `forcectl status`".to_owned(),
            Some(SystemState::Ready) => "not in the state `ready`, or a unit isn't ready or the E-stop is open; see `forcectl status`".to_owned(),
            _ => format!("not in the state `{}`; see `forcectl status`", system_state_name(state)),
        },
        CommandError::Faulted(code) => format!("{}; then `forcectl clear`", explain_fault(code, 0)),
        CommandError::UnknownUnit(unit) => format!("it has no unit {}", u16::from(unit) + 1),
        CommandError::UnitNotReady { unit, state } => format!(
            "unit {} is not ready (its state is `{}`); see `forcectl status`",
            u16::from(unit) + 1,
            motor_state_name(state)
        ),
        CommandError::Range { unit, field } => {
            let known: Vec<String> = FIELDS
                .iter()
                .filter(|f| f.number == field)
                .map(|f| format!("`{}` ({} to {}: {})", f.name, f.min, f.max, f.why))
                .collect();
            let name = if known.is_empty() {
                format!("number {field}")
            } else {
                known.join(" or ")
            };
            format!("unit {}: field {name} is out of its range; correct the rig file", u16::from(unit) + 1)
        }
    }
}

/// A conversation with a board over a link.
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
    board_seq: Option<u16>,
    /// Board time of the last frame, unwrapped.
    board_us: Option<u64>,
    resets: Option<u32>,
    reset_seen: bool,
    now_ns: u64,
    heard_ns: u64,
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
    /// Greets the board and checks versions.
    ///
    /// # Errors
    /// Nobody answers, or another version does.
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
            board_seq: None,
            board_us: None,
            resets: None,
            reset_seen: false,
            now_ns: 0,
            heard_ns: 0,
            setpoints: None,
            setpoints_due_ns: 0,
            tension_n: [None; UNITS],
        };
        session.handshake()?;
        Ok(session)
    }

    fn handshake(&mut self) -> Result<(), SessionError> {
        let hello = Command::Hello {
            abi: wire::ABI_VERSION,
            schema: wire::SCHEMA_HASH,
        };
        let mut waited = Duration::ZERO;
        while waited < BOOT_WITHIN {
            if let Some(answer) = self.ask_once(&hello, ANSWER_WITHIN)? {
                return self.greeted(answer);
            }
            waited += ANSWER_WITHIN;
        }
        Err(SessionError::NoBoard {
            link: self.link.name(),
            what: self.what_was_heard(),
        })
    }

    fn greeted(&mut self, answer: Response) -> Result<(), SessionError> {
        let (abi, schema) = match answer {
            Response::Hello(info) => {
                let numbers = (info.abi, info.schema);
                self.info = Some(info);
                numbers
            }
            Response::Rejected(CommandError::Version { abi, schema }) => (abi, schema),
            Response::Rejected(refusal) => {
                return Err(SessionError::Refused {
                    command: "hello",
                    why: explain_refusal(&refusal),
                    refusal,
                })
            }
            _ => (0, [0; 8]),
        };
        if abi == wire::ABI_VERSION && schema == wire::SCHEMA_HASH {
            self.reset_seen = false;
            return Ok(());
        }
        let advice = if abi > wire::ABI_VERSION {
            "the board is newer: update forcectl"
        } else if abi < wire::ABI_VERSION {
            "the board is older: flash this version's firmware with `cargo xtask flash`"
        } else {
            "same meaning, another layout: flash the firmware of the same checkout with `cargo xtask flash`"
        };
        Err(SessionError::Version {
            abi,
            schema,
            own_abi: wire::ABI_VERSION,
            own_schema: wire::SCHEMA_HASH,
            advice: advice.to_owned(),
        })
    }

    fn what_was_heard(&self) -> String {
        let c = &self.counters;
        if c.bytes == 0 {
            "it sends nothing; is it powered, flashed, and is this the right port?".to_owned()
        } else if c.frames > 0 {
            format!("{} telemetry frames arrive but no answer; is the line to the board (its RX) connected?", c.frames)
        } else if c.frames_unknown > 0 {
            format!("{} frames of another protocol version arrive; flash the firmware of the same checkout with `cargo xtask flash`", c.frames_unknown)
        } else {
            format!(
                "{} bytes arrive, none of them a frame; is this the right port, at {} baud?",
                c.bytes,
                crate::link::port::BAUD
            )
        }
    }

    /// Who the board said it is.
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

    /// The link, for what goes beside the conversation.
    pub fn link(&mut self) -> &mut dyn RigLink {
        self.link
    }

    /// Everything that came in since the last call.
    pub fn drain(&mut self) -> Received {
        std::mem::take(&mut self.received)
    }

    /// Puts setpoints in force from now on: they go out with the next exchange and every 10 ms after it.
    /// `None` ends that.
    pub fn set_setpoints(&mut self, setpoints: Option<[UnitSetpoint; UNITS]>) {
        self.setpoints = setpoints;
        self.setpoints_due_ns = self.now_ns;
    }

    fn queue_setpoints(&mut self) {
        if let Some(units) = self.setpoints {
            self.setpoints_due_ns = self.now_ns + PERIOD.as_nanos() as u64;
            self.queue(Command::Setpoints {
                valid_ms: SETPOINTS_VALID_MS,
                units,
            });
        }
    }

    /// Encodes a command for the next exchange; returns its number.
    fn queue(&mut self, command: Command) -> u16 {
        self.seq = self.seq.wrapping_add(1);
        let frame = HostFrame {
            seq: self.seq,
            command,
        };
        let mut out = [0; wire::MAX_FRAME];
        // Every host frame is far shorter than MAX_FRAME, so encoding cannot fail; should a message ever grow
        // past it, the command is never answered and says so.
        if let Ok(length) = wire::encode(&frame, &mut out) {
            self.outbox.extend_from_slice(&out[..length]);
        }
        self.seq
    }

    /// Lets time pass, sending what is queued and taking in what comes.
    ///
    /// # Errors
    /// The link is gone, the board fell silent or was reset.
    pub fn advance(&mut self, duration: Duration) -> Result<(), SessionError> {
        self.exchange(duration)?;
        if self.info.is_some() {
            if self.reset_seen {
                return Err(self.after_reset());
            }
            if self.now_ns.saturating_sub(self.heard_ns) > SILENCE.as_nanos() as u64 {
                return Err(SessionError::NoAnswer { command: "status" });
            }
        }
        Ok(())
    }

    /// Asks a board that was reset what it kept of the reason.
    fn after_reset(&mut self) -> SessionError {
        self.setpoints = None;
        self.info = None;
        self.outbox.clear();
        let kept = match self.handshake() {
            Ok(()) => self
                .info
                .as_ref()
                .and_then(|info| info.crash_record.as_ref())
                .map(explain_crash_record),
            Err(_) => None,
        };
        SessionError::Reset { kept }
    }

    fn exchange(&mut self, duration: Duration) -> Result<(), SessionError> {
        if self.now_ns >= self.setpoints_due_ns {
            self.queue_setpoints();
        }
        let outbox = std::mem::take(&mut self.outbox);
        let exchange = self.link.exchange(&outbox, duration)?;
        self.now_ns = exchange.now_ns;
        if exchange.pose.is_some() {
            self.pose = exchange.pose;
        }
        if self.resets.is_some_and(|before| exchange.resets != before) {
            self.reset_seen = true;
        }
        self.resets = Some(exchange.resets);
        self.received.truth.extend(exchange.truth);
        self.counters.bytes += exchange.from_board.len() as u64;
        for byte in exchange.from_board {
            match self.decoder.push::<BoardFrame>(byte) {
                Ok(None) => {}
                Ok(Some(frame)) => self.take(frame),
                Err(FrameError::Message) => self.counters.frames_unknown += 1,
                Err(_) => self.counters.frames_bad += 1,
            }
        }
        Ok(())
    }

    fn take(&mut self, frame: BoardFrame) {
        self.counters.frames += 1;
        self.heard_ns = self.now_ns;
        if let Some(before) = self.board_seq {
            let gap = frame.seq.wrapping_sub(before).wrapping_sub(1);
            // More than half the range back is a restart of the count and not a gap.
            if gap < u16::MAX / 2 {
                self.counters.frames_lost += u64::from(gap);
            }
        }
        self.board_seq = Some(frame.seq);
        match frame.message {
            BoardMessage::Reply(reply) => {
                if let Response::Status(status) = &reply.response {
                    self.take_status(status.clone());
                }
                self.reply = Some((reply.seq, reply.response));
            }
            BoardMessage::Status(status) => self.take_status(status),
            BoardMessage::Fault(fault) => self.received.faults.push(fault),
            BoardMessage::Samples(batch) => {
                let start = self.unwrap_time(batch.t_us);
                for sample in batch.samples {
                    let t_us = start + u64::from(sample.dt_us);
                    if let Some(slot) = self.tension_n.get_mut(usize::from(sample.unit)) {
                        *slot = Some((f64::from(sample.tension) * 1e-4, t_us));
                    }
                    self.received.samples.push(TimedSample { t_us, sample });
                }
            }
        }
    }

    fn take_status(&mut self, status: Status) {
        self.unwrap_time(status.t_us);
        self.status = Some(status);
    }

    /// Continues the board's 32-bit microseconds past their wrap, and notices a restart.
    fn unwrap_time(&mut self, t_us: u32) -> u64 {
        let Some(before) = self.board_us else {
            self.board_us = Some(u64::from(t_us));
            return u64::from(t_us);
        };
        let step = t_us.wrapping_sub(before as u32) as i32;
        if step < RESET_JUMP_US {
            self.reset_seen = true;
        }
        let now = before.saturating_add_signed(i64::from(step));
        self.board_us = Some(now.max(before));
        now
    }

    /// Sends a command once and waits for its answer.
    fn ask_once(
        &mut self,
        command: &Command,
        within: Duration,
    ) -> Result<Option<Response>, SessionError> {
        self.reply = None;
        let seq = self.queue(command.clone());
        let mut waited = Duration::ZERO;
        while waited < within {
            self.exchange(LOOK_EVERY)?;
            waited += LOOK_EVERY;
            if let Some((number, answer)) = self.reply.take() {
                if number == seq {
                    return Ok(Some(answer));
                }
            }
        }
        Ok(None)
    }

    /// Sends a command and waits for its answer, again where the answer stays out.
    ///
    /// # Errors
    /// It was refused, or never answered, or the link is gone.
    pub fn command(&mut self, command: &Command) -> Result<Response, SessionError> {
        for attempt in 0..ATTEMPTS {
            self.counters.retries += u64::from(attempt > 0);
            match self.ask_once(command, ANSWER_WITHIN)? {
                Some(Response::Rejected(refusal)) => {
                    if refusal == CommandError::NotConnected && self.reset_seen {
                        return Err(self.after_reset());
                    }
                    return Err(SessionError::Refused {
                        command: command_name(command),
                        why: explain_refusal(&refusal),
                        refusal,
                    });
                }
                Some(answer) => return Ok(answer),
                None if self.reset_seen => return Err(self.after_reset()),
                None => {}
            }
        }
        Err(SessionError::NoAnswer {
            command: command_name(command),
        })
    }

    /// Asks for the status.
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn get_status(&mut self) -> Result<Status, SessionError> {
        match self.command(&Command::GetStatus)? {
            Response::Status(status) => Ok(status),
            _ => Err(SessionError::NoAnswer {
                command: "get status",
            }),
        }
    }

    /// Asks for the six configurations in force.
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn get_configs(&mut self) -> Result<[UnitConfig; UNITS], SessionError> {
        let mut configs = Vec::with_capacity(UNITS);
        for unit in 0..UNITS as u8 {
            match self.command(&Command::GetConfig { unit })? {
                Response::Config(config) => configs.push(config),
                _ => {
                    return Err(SessionError::NoAnswer {
                        command: "get configuration",
                    })
                }
            }
        }
        configs.try_into().map_err(|_| SessionError::NoAnswer {
            command: "get configuration",
        })
    }

    /// Puts six configurations in force.
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn configure(&mut self, configs: &[UnitConfig; UNITS]) -> Result<(), SessionError> {
        for (unit, config) in configs.iter().enumerate() {
            self.command(&Command::StageConfig {
                unit: unit as u8,
                config: *config,
            })?;
        }
        self.command(&Command::CommitConfig)?;
        Ok(())
    }

    /// Lets time pass until the newest status satisfies `done`.
    ///
    /// # Errors
    /// [`SessionError::TooLong`] with `what` after `within`; a fault of the board; the link.
    pub fn wait_for(
        &mut self,
        within: Duration,
        what: &str,
        done: impl Fn(&Status) -> bool,
    ) -> Result<Status, SessionError> {
        let deadline = self.now_ns + within.as_nanos() as u64;
        // What is there already may be older than the command that is waited for.
        self.status = None;
        loop {
            self.advance(PERIOD)?;
            if let Some(status) = &self.status {
                if done(status) {
                    return Ok(status.clone());
                }
                if status.fault != 0 {
                    return Err(SessionError::Fault(explain_fault(
                        status.fault,
                        status.fault_detail,
                    )));
                }
            }
            if self.now_ns >= deadline {
                let state = self.status.as_ref().map_or_else(
                    || "no status".to_owned(),
                    |s| format!("state `{}`", system_state_name(s.state)),
                );
                return Err(SessionError::TooLong(format!(
                    "{what} is not over after {} s ({state}); see `forcectl status`",
                    within.as_secs_f64()
                )));
            }
        }
    }

    /// Takes the rig to a safe state as far as the link allows: asks to disarm, and to stop where that fails. Setpoints
    /// cease either way, so the board stops by itself even when nothing gets through.
    pub fn make_safe(&mut self) {
        self.setpoints = None;
        self.outbox.clear();
        if self.command(&Command::Disarm).is_err() {
            let _ = self.command(&Command::Stop);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_and_not_ready_units_read_differently() {
        let unknown = explain_refusal(&CommandError::UnknownUnit(6));
        assert!(unknown.contains("no unit 7"), "{unknown}");
        let not_ready = explain_refusal(&CommandError::UnitNotReady {
            unit: 2,
            state: MotorState::BringUp as u8,
        });
        assert!(
            not_ready.contains("unit 3 is not ready") && not_ready.contains("bring-up"),
            "{not_ready}"
        );
    }
}
