//! The board's side of the protocol: commands, responses, status, fault reports.

use super::{Behavior, FakeBoard, MS};
use control::unit::Setpoint;
use control::{Config, Fault, MotorState, State, SystemState};
use wire::message::{
    BoardInfo, CommandError, FaultReport, Pull, Reply, Response, Status, UnitConfig, UnitSetpoint,
    UnitStatus,
};
use wire::{BoardFrame, BoardMessage, Command, HostFrame, UNITS};

impl FakeBoard {
    pub(super) fn t_us(&self) -> u32 {
        ((self.now_ns - self.epoch_ns) / 1000) as u32
    }

    pub(super) fn send(&mut self, message: BoardMessage) {
        self.seq = self.seq.wrapping_add(1);
        if let Behavior::Drops(n) = self.behavior {
            if self.seq.is_multiple_of(n) {
                return;
            }
        }
        let frame = BoardFrame {
            seq: self.seq,
            message,
        };
        let mut out = [0; wire::MAX_FRAME];
        let length = wire::encode(&frame, &mut out).expect("fits");
        self.out.extend_from_slice(&out[..length]);
    }

    pub(super) fn latch(&mut self, unit: Option<usize>, fault: Fault, detail: u32) {
        match unit {
            Some(unit) => self.unit_faults[unit] = Some((fault, detail)),
            None => {
                self.fault = Some((fault, detail));
                self.system = SystemState::Fault;
                // As on the board, setpoints age only while the units are driven.
                self.expires_ns = None;
            }
        }
        let report = FaultReport {
            t_us: self.t_us(),
            unit: unit.map_or(255, |unit| unit as u8),
            code: fault.code(),
            detail,
        };
        self.send(BoardMessage::Fault(report));
    }

    pub(super) fn unit_state(&self, i: usize) -> MotorState {
        if !self.configs[i].enabled() {
            MotorState::Offline
        } else if self.unit_faults[i].is_some() {
            MotorState::Faulted
        } else {
            match self.system {
                SystemState::Boot | SystemState::BringUp => MotorState::BringUp,
                SystemState::Ready | SystemState::Fault => MotorState::Ready,
                SystemState::Zeroing => MotorState::Zeroing,
                SystemState::Running => MotorState::Running,
                SystemState::Stopping => MotorState::Stopping,
            }
        }
    }

    fn wire_configs(&self) -> [UnitConfig; UNITS] {
        core::array::from_fn(|i| *self.configs[i].wire())
    }

    pub(super) fn status(&self) -> Status {
        let fault = self.fault;
        Status {
            t_us: self.t_us(),
            state: self.system as u8,
            fault: fault.map_or(0, |f| f.0.code()),
            fault_detail: fault.map_or(0, |f| f.1),
            estop_closed: fault.is_none_or(|f| f.0 != Fault::EStop),
            units: core::array::from_fn(|i| UnitStatus {
                state: self.unit_state(i) as u8,
                fault: self.unit_faults[i].map_or(0, |f| f.0.code()),
                fault_detail: self.unit_faults[i].map_or(0, |f| f.1),
                samples: self.samples[i],
                missed: 0,
                spikes: 0,
                failed_reads: 0,
                period_us: 3125,
                tension_un: self.states[i].tension().to_un(),
                adc_code: 0,
                encoder_counts: self.plant.encoder_counts(i) as i32,
            }),
            tip_force_un: self.tip.force_un(),
            alive_withheld: false,
            config_crc: rig::board_crc(&self.wire_configs()),
            setpoint_age_ms: 0,
            frames_dropped: 0,
            frames_bad: self.decoder.bad_frames(),
            bus_recoveries: 0,
            sleep_permille: 900,
            queue_high_water: 1,
        }
    }

    fn hello(&mut self) -> Response {
        let abi = match self.behavior {
            Behavior::OtherAbi(abi) => abi,
            _ => wire::ABI_VERSION,
        };
        self.connected = true;
        if abi != wire::ABI_VERSION {
            return Response::Rejected(CommandError::Version {
                abi,
                schema: [7; 8],
            });
        }
        Response::Hello(BoardInfo {
            abi,
            schema: wire::SCHEMA_HASH,
            version: "fake".try_into().expect("short"),
            core_hz: 400_000_000,
            silicon: 0x2003,
            hse: true,
            reset_flags: 0,
            option_bytes: 3 << 2,
            unique_id: self.unique_id,
            dac_reset_pull: Pull::Down,
            crash_record: (self.resets > 0).then(|| wire::message::CrashRecord {
                code: Fault::WatchdogReset.code(),
                detail: 0,
                pc: 0,
                text: "superloop".try_into().expect("short"),
            }),
        })
    }

    fn respond(&mut self, command: &Command) -> Option<Response> {
        match command {
            Command::Hello { .. } => Some(self.hello()),
            _ if !self.connected => Some(Response::Rejected(CommandError::NotConnected)),
            _ if self.behavior == Behavior::Refusing => {
                Some(Response::Rejected(CommandError::State(self.system as u8)))
            }
            Command::GetStatus => Some(Response::Status(self.status())),
            Command::GetConfig { unit } => Some(match self.configs.get(usize::from(*unit)) {
                Some(config) => Response::Config(*config.wire()),
                None => Response::Rejected(CommandError::UnknownUnit(*unit)),
            }),
            Command::GetBoard => Some(Response::Board(self.board_config)),
            Command::Setpoints { valid_ms, units } => self
                .take_setpoints(*valid_ms, units)
                .err()
                .map(Response::Rejected),
            command => Some(match self.execute(command) {
                Ok(()) => Response::Done,
                Err(error) => Response::Rejected(error),
            }),
        }
    }

    /// Refuses the whole frame where a number of it is out of its range, as the board does.
    fn take_setpoints(
        &mut self,
        valid_ms: u16,
        units: &[UnitSetpoint; UNITS],
    ) -> Result<(), CommandError> {
        let mut taken = self.setpoints;
        for (i, setpoint) in taken.iter_mut().enumerate() {
            if self.configs[i].enabled() {
                *setpoint = Setpoint::from_wire(&self.configs[i], &units[i]).map_err(|field| {
                    CommandError::Range {
                        unit: i as u8,
                        field,
                    }
                })?;
            }
        }
        if self.system != SystemState::Running {
            return Ok(());
        }
        self.setpoints = taken;
        self.tip
            .set_directions(&units.map(|unit| unit.direction_q14));
        self.expires_ns = Some(self.now_ns + u64::from(valid_ms) * MS);
        Ok(())
    }

    /// Commands that are answered with done, or rejected.
    fn execute(&mut self, command: &Command) -> Result<(), CommandError> {
        let armed = self.system.drives();
        match command {
            Command::StageConfig { unit, config } => {
                let checked = Config::from_wire(config).map_err(|error| CommandError::Range {
                    unit: *unit,
                    field: error.field.number,
                })?;
                self.staged[usize::from(*unit)] = Some(checked);
            }
            Command::StageBoard { config } => {
                self.board_config = *config;
                self.tip.set_limit(config.tip_force_limit_un);
            }
            Command::CommitConfig | Command::Zero { .. }
                if armed || self.system == SystemState::Zeroing =>
            {
                return Err(CommandError::State(self.system as u8))
            }
            Command::CommitConfig => {
                for (config, staged) in self.configs.iter_mut().zip(&mut self.staged) {
                    *config = staged.take().unwrap_or(*config);
                }
            }
            Command::Zero { units } => {
                for i in 0..UNITS {
                    self.zeroing[i] = (units >> i & 1 == 1 && self.configs[i].enabled())
                        .then(|| self.configs[i].zero_averager());
                }
                self.system = SystemState::Zeroing;
            }
            Command::Arm => {
                if let Some((fault, _)) = self.fault {
                    return Err(CommandError::Faulted(fault.code()));
                }
                let ready = (0..UNITS)
                    .all(|i| matches!(self.unit_state(i), MotorState::Ready | MotorState::Offline));
                // As on the board: one that is armed stays so.
                if self.system == SystemState::Running {
                    return Ok(());
                }
                if self.system != SystemState::Ready || !ready {
                    return Err(CommandError::State(self.system as u8));
                }
                self.states = [State::default(); UNITS];
                self.system = SystemState::Running;
            }
            Command::Disarm if armed => {
                self.system = SystemState::Stopping;
                self.expires_ns = None;
            }
            Command::Stop => self.latch(None, Fault::HostStop, 0),
            Command::ClearFaults => {
                self.fault = None;
                for i in 0..UNITS {
                    if !self.unplugged[i] {
                        self.unit_faults[i] = None;
                    }
                }
                if self.system == SystemState::Fault {
                    self.system = SystemState::Ready;
                }
            }
            _ => {}
        }
        Ok(())
    }

    pub(super) fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Ok(Some(frame)) = self.decoder.push::<HostFrame>(*byte) {
                self.commands.push(frame.command.clone());
                if let Some(response) = self.respond(&frame.command) {
                    // The host asks for the status at any time, and waits for nothing.
                    if self.behavior == Behavior::LosesAnswers
                        && frame.command != Command::GetStatus
                    {
                        if self.answer_lost.as_ref() != Some(&frame.command) {
                            self.answer_lost = Some(frame.command);
                            continue;
                        }
                        self.answer_lost = None;
                    }
                    self.send(BoardMessage::Reply(Reply {
                        seq: frame.seq,
                        response,
                    }));
                }
            }
        }
    }
}
