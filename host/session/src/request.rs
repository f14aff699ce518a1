//! Requests: a command goes out, its response comes back, several times where frames get lost.

use super::{
    command_name, explain_refusal, system_state_name, LatchedFault, Patience, Session,
    SessionError, PERIOD,
};
use control::SystemState;
use std::time::Duration;
use wire::message::{BoardConfig, CommandError, Response, Status, UnitConfig};
use wire::{Command, HostFrame, UNITS};

/// How long a response may take. The board answers within a pass of its loop; the rest is the
/// link's.
pub(super) const RESPONSE_TIMEOUT: Duration = Duration::from_millis(150);
/// How often a command is sent before the link counts as lost, where nothing arrives; and where
/// frames arrive. Every command may be repeated; a zero that is repeated while the board zeroes is
/// refused, which answers the first. Four are too few where a byte in 1,000 is damaged
/// and the response is long, as that with a unit's configuration is (host/service,
/// `damaged_lines_and_frames_harm_nobody_else`).
const ATTEMPTS: (u32, u32) = (4, 6);
/// Commands with setpoints that are kept: those that may be under way, and some more.
const KEPT: usize = 8;
/// Time between two checks for a response.
const POLL_PERIOD: Duration = Duration::from_millis(1);

impl Session<'_> {
    /// Encodes a command for the next exchange; returns its number.
    pub(super) fn queue(&mut self, command: Command) -> u16 {
        self.seq = self.seq.wrapping_add(1);
        if matches!(command, Command::Setpoints { .. }) {
            self.setpoints_sent.truncate(KEPT - 1);
            self.setpoints_sent.push_front((self.seq, command.clone()));
        }
        if command == Command::GetStatus {
            self.timekeeping.asked(self.seq, self.now_ns);
        }
        let frame = HostFrame {
            seq: self.seq,
            command,
        };
        let mut out = [0; wire::MAX_FRAME];
        // Every host frame is far shorter than MAX_FRAME, so encoding cannot fail; should a message
        // ever grow past it, the request times out with an error.
        if let Ok(length) = wire::encode(&frame, &mut out) {
            self.outbox.extend_from_slice(&out[..length]);
        }
        self.seq
    }

    /// Sends a command once and waits for its response; `None` after `timeout`.
    pub(super) fn request_once(
        &mut self,
        command: &Command,
        timeout: Duration,
    ) -> Result<Option<Response>, SessionError> {
        self.reply = None;
        let seq = self.queue(command.clone());
        let mut waited = Duration::ZERO;
        while waited < self.pace.on_host(timeout) {
            self.exchange_once(POLL_PERIOD)?;
            waited += POLL_PERIOD;
            if let Some((number, response)) = self.reply.take() {
                if number == seq {
                    return Ok(Some(response));
                }
            }
        }
        Ok(None)
    }

    /// Sends a command and waits for its response. Repeats it where no response comes.
    ///
    /// # Errors
    /// The board rejected it or never answered, or the link is gone.
    pub fn command(&mut self, command: &Command) -> Result<Response, SessionError> {
        for attempt in 0..ATTEMPTS.1 {
            if attempt >= ATTEMPTS.0 && self.is_silent() {
                break;
            }
            self.counters.retries += u64::from(attempt > 0);
            match self.request_once(command, RESPONSE_TIMEOUT)? {
                // It zeroes as it was asked to: the answer to the copy before got lost.
                Some(Response::Rejected(CommandError::State(state)))
                    if attempt > 0
                        && matches!(command, Command::Zero { .. })
                        && state == SystemState::Zeroing as u8 =>
                {
                    return Ok(Response::Done);
                }
                Some(Response::Rejected(refusal)) => {
                    if refusal == CommandError::NotConnected && self.reset_seen {
                        return Err(self.after_reset());
                    }
                    return Err(SessionError::Refused {
                        command: command_name(command),
                        why: explain_refusal(command, &refusal),
                        refusal,
                    });
                }
                Some(response) => return Ok(response),
                None if self.reset_seen => return Err(self.after_reset()),
                None => {}
            }
        }
        Err(SessionError::NoAnswer {
            command: command_name(command),
        })
    }

    /// Requests the status.
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

    /// Requests the six configurations in force.
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

    /// Stages the configuration of the whole board; [`Session::configure`] puts it in force.
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn stage_board(&mut self, config: BoardConfig) -> Result<(), SessionError> {
        self.command(&Command::StageBoard { config }).map(drop)
    }

    /// Requests the configuration of the whole board that is in force.
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn get_board(&mut self) -> Result<BoardConfig, SessionError> {
        match self.command(&Command::GetBoard)? {
            Response::Board(config) => Ok(config),
            _ => Err(SessionError::NoAnswer {
                command: "get board configuration",
            }),
        }
    }

    /// Lets time pass until the newest status satisfies `done`.
    ///
    /// # Errors
    /// [`SessionError::TooLong`] with `what` after `timeout`; a fault of the board; the link.
    pub fn wait_for(
        &mut self,
        timeout: Duration,
        what: &str,
        done: impl Fn(&Status) -> bool,
    ) -> Result<Status, SessionError> {
        let mut patience = Patience::new(timeout, self.now_ns);
        // What is there already may be older than the command that is waited for.
        self.status = None;
        loop {
            self.exchange(PERIOD)?;
            if let Some(status) = &self.status {
                if done(status) {
                    return Ok(status.clone());
                }
                if status.fault != 0 {
                    return Err(SessionError::Fault(LatchedFault::of_board(status)));
                }
            }
            if patience.is_over(self.now_ns, self.status.as_ref().map(|status| status.t_us)) {
                let state = self.status.as_ref().map_or_else(
                    || "no status".to_owned(),
                    |s| format!("state `{}`", system_state_name(s.state)),
                );
                return Err(SessionError::TooLong(format!(
                    "{what} is not over after {} s ({state}); see `forcectl status`",
                    timeout.as_secs_f64()
                )));
            }
        }
    }

    /// Takes the rig to a safe state as far as the link allows: asks to disarm, and to stop where
    /// that fails. Setpoints cease either way, so the board stops by itself even when nothing gets
    /// through.
    pub fn make_safe(&mut self) {
        self.setpoints = None;
        self.outbox.clear();
        if self.command(&Command::Disarm).is_err() {
            let _ = self.command(&Command::Stop);
        }
    }
}
