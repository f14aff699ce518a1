//! Commands of the host and their responses.

use super::{
    Effects, LinkCounters, LoopFigures, Machine, Unit, COMMANDER_SILENT_US, FIRST_SETPOINT_MS,
    LINKS,
};
use control::system::{Denied, Request};
use control::unit::Setpoint;
use control::{Config, Fault, Micros, SystemState, UnitIndex, UnitSet};
use wire::message::{
    BoardConfig, CommandError, Response, Status, UnitConfig, UnitSetpoint, UnitStatus,
};
use wire::{Command, HostFrame, ABI_VERSION, SCHEMA_HASH, UNITS};

/// Range of [`BoardConfig::tip_force_limit_un`]: 1 N, below which no force can be held, to 100 N,
/// which limits nothing.
const TIP_FORCE_LIMIT_UN: core::ops::RangeInclusive<i32> = 1_000_000..=100_000_000;

/// Longest validity of setpoints, in milliseconds.
const MAX_VALID_MS: u16 = 1_000;

fn known(unit: u8) -> Result<UnitIndex, CommandError> {
    UnitIndex::new(unit).ok_or(CommandError::UnknownUnit(unit))
}

impl Machine {
    /// Executes a command. `None`: no response (setpoints within their ranges).
    pub fn command(
        &mut self,
        link: usize,
        frame: &HostFrame,
        now: Micros,
        figures: LoopFigures,
        counters: LinkCounters,
        fx: &mut impl Effects,
    ) -> Option<Response> {
        // What anyone may ask, on any link and at any time.
        match &frame.command {
            Command::Hello { abi, schema } => return Some(self.hello(link, *abi, *schema)),
            Command::GetStatus => {
                return Some(Response::Status(self.status(now, figures, counters)))
            }
            Command::GetConfig { unit } => {
                self.exchange_configs();
                return Some(match known(*unit) {
                    Ok(unit) => Response::Config(*self.units[unit as usize].config.wire()),
                    Err(error) => Response::Rejected(error),
                });
            }
            Command::GetBoard => {
                self.exchange_configs();
                return Some(Response::Board(self.board));
            }
            Command::Stop => {
                self.fault_board(Fault::HostStop, u32::from(frame.seq), now, fx);
                return Some(Response::Done);
            }
            Command::Stream { decimation } if self.open.get(link) == Some(&true) => {
                self.decimation[link] = *decimation;
                return Some(Response::Done);
            }
            _ => {}
        }
        if !self.may_command(link, now) {
            return Some(Response::Rejected(CommandError::NotConnected));
        }
        self.commander = Some((link, now));
        // Commands execute between two samples, so this is a cycle boundary as well: a read after a
        // commit returns the committed configuration, and arming uses it.
        self.exchange_configs();
        let result = match &frame.command {
            Command::Hello { .. }
            | Command::GetStatus
            | Command::GetConfig { .. }
            | Command::GetBoard
            | Command::Stop
            | Command::Stream { .. } => Ok(()),
            Command::StageConfig { unit, config } => self.stage(*unit, config),
            Command::StageBoard { config } => self.stage_board(*config),
            Command::CommitConfig => self.commit(),
            Command::Zero { units } => self.zero(*units, fx),
            Command::Arm => self.arm(now, fx),
            Command::Disarm => self.request(Request::Disarm, fx),
            Command::ClearFaults => self.clear_faults(fx),
            Command::Setpoints { valid_ms, units } => match self.setpoints(*valid_ms, units, now) {
                Ok(()) => return None,
                rejected => rejected,
            },
        };
        Some(match result {
            Ok(()) => Response::Done,
            Err(error) => Response::Rejected(error),
        })
    }

    fn hello(&mut self, link: usize, abi: u16, schema: [u8; 8]) -> Response {
        if abi != ABI_VERSION || schema != SCHEMA_HASH || link >= LINKS {
            // A host with another protocol does not displace the link that commands.
            return Response::Rejected(CommandError::Version {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
            });
        }
        self.open[link] = true;
        Response::Hello(self.info.clone())
    }

    /// Whether this link may command: it has said Hello, and no other link drives the motors or has
    /// just done so.
    fn may_command(&self, link: usize, now: Micros) -> bool {
        let open = self.open.get(link).copied().unwrap_or(false);
        let free = match self.commander {
            Some((other, last)) if other != link && self.system.drives() => {
                now.since(last) > COMMANDER_SILENT_US
            }
            // A program that zeroes waits without a word, for less than a second.
            Some((other, _)) if other != link => self.system != SystemState::Zeroing,
            _ => true,
        };
        open && free
    }

    fn stage_board(&mut self, config: BoardConfig) -> Result<(), CommandError> {
        if self.system.drives() {
            return Err(CommandError::State(self.system as u8));
        }
        if !TIP_FORCE_LIMIT_UN.contains(&config.tip_force_limit_un) {
            return Err(CommandError::Range {
                unit: u8::MAX,
                field: 1,
            });
        }
        self.staged_board = Some(config);
        Ok(())
    }

    fn stage(&mut self, unit: u8, config: &UnitConfig) -> Result<(), CommandError> {
        if self.system.drives() {
            return Err(CommandError::State(self.system as u8));
        }
        let slot = &mut self.units[known(unit)? as usize];
        let config = Config::from_wire(config).map_err(|error| CommandError::Range {
            unit,
            field: error.field.number,
        })?;
        slot.staged = Some(config);
        Ok(())
    }

    fn commit(&mut self) -> Result<(), CommandError> {
        if self.system.drives() || self.system == SystemState::Zeroing {
            return Err(CommandError::State(self.system as u8));
        }
        self.commit = true;
        Ok(())
    }

    fn zero(&mut self, mask: u8, fx: &mut impl Effects) -> Result<(), CommandError> {
        if mask == 0 {
            return Err(CommandError::UnknownUnit(u8::MAX));
        }
        if mask >> UNITS != 0 {
            return Err(CommandError::UnknownUnit(
                mask.trailing_zeros().max(UNITS as u32) as u8,
            ));
        }
        let units = UnitSet::from_mask(mask);
        if let Some(why) = self.why_not_ready(|n, _| units.contains(n)) {
            return Err(why);
        }
        self.request(Request::Zero, fx)?;
        for (n, unit) in UnitIndex::zip(&mut self.units) {
            unit.zero = units.contains(n).then(|| unit.config.zero_averager());
        }
        Ok(())
    }

    fn arm(&mut self, now: Micros, fx: &mut impl Effects) -> Result<(), CommandError> {
        let was = self.system;
        self.request(Request::Arm, fx)?;
        if was != SystemState::Running && !self.expiry.is_valid(now) {
            for unit in &mut self.units {
                unit.setpoint = Setpoint::default();
            }
            self.expiry.renew(now, FIRST_SETPOINT_MS);
        }
        Ok(())
    }

    fn request(&mut self, request: Request, fx: &mut impl Effects) -> Result<(), CommandError> {
        match self.advance(request, fx) {
            None => Ok(()),
            Some(Denied::Faulted) => Err(CommandError::Faulted(self.latch.code())),
            Some(Denied::EStopOpen) => Err(CommandError::Faulted(Fault::EStop.code())),
            Some(Denied::State) => Err(CommandError::State(self.system as u8)),
            Some(Denied::UnitNotReady) => Err(self
                .why_not_ready(|_, unit| unit.config.enabled())
                .or_else(|| self.why_without_power())
                .unwrap_or(CommandError::State(self.system as u8))),
        }
    }

    /// Error for the first of these units that is not ready: its fault, or its state.
    fn why_not_ready(&self, of: impl Fn(UnitIndex, &Unit) -> bool) -> Option<CommandError> {
        let (n, unit) =
            UnitIndex::zip(&self.units).find(|(n, unit)| of(*n, unit) && !unit.usable())?;
        Some(match unit.latch.get() {
            Some((fault, _)) => CommandError::Faulted(fault.code()),
            None => CommandError::UnitNotReady {
                unit: n as u8,
                state: unit.motor as u8,
            },
        })
    }

    /// Error for the first unit that the amplifiers' power waits for.
    fn why_without_power(&self) -> Option<CommandError> {
        let enabled = || UnitIndex::zip(&self.units).filter(|(_, unit)| unit.config.enabled());
        let (n, unit) = enabled()
            .find(|(_, unit)| unit.at_rest().is_err())
            .or_else(|| enabled().next())?;
        Some(CommandError::UnitNotReady {
            unit: n as u8,
            state: unit.motor as u8,
        })
    }

    fn clear_faults(&mut self, fx: &mut impl Effects) -> Result<(), CommandError> {
        let estop_open = !self.estop_closed;
        let register_changed = self.register_changed;
        let still_held = self.units.iter().any(Unit::holds_on);
        let board = self.latch.clear(|fault| match fault {
            Fault::EStop => estop_open,
            // Detected once at boot: a counter that does not respond needs a repair and a restart.
            Fault::CounterBus => true,
            Fault::OutputStuck => still_held,
            Fault::RegisterChanged => register_changed,
            _ => false,
        });
        if !board {
            return Err(CommandError::Faulted(self.latch.code()));
        }
        // A cable that is still held latches the fault again with the next millisecond.
        for unit in &mut self.units {
            if !unit.holds_on() {
                unit.let_go.forget();
            }
            let limit = unit.config.over_tension(unit.tripped_driven);
            // With what trips, and what is filtered: the next sample must not trip again.
            let too_tight = unit.sensor_up && unit.control.strongest() > limit;
            unit.latch
                .clear(|fault| fault == Fault::OverTension && too_tight);
        }
        self.advance(Request::None, fx);
        match self.units.iter().find_map(|unit| unit.latch.get()) {
            None => Ok(()),
            Some((fault, _)) => Err(CommandError::Faulted(fault.code())),
        }
    }

    fn setpoints(
        &mut self,
        valid_ms: u16,
        wire: &[UnitSetpoint; UNITS],
        now: Micros,
    ) -> Result<(), CommandError> {
        if valid_ms == 0 || valid_ms > MAX_VALID_MS {
            return Err(CommandError::Range {
                unit: u8::MAX,
                field: 0,
            });
        }
        let mut checked = [Setpoint::default(); UNITS];
        for (n, (unit, wire)) in self.units.iter().zip(wire).enumerate() {
            if unit.config.enabled() {
                checked[n] = Setpoint::from_wire(&unit.config, wire).map_err(|field| {
                    CommandError::Range {
                        unit: n as u8,
                        field,
                    }
                })?;
            }
        }
        if self.system != SystemState::Running {
            // In transit when the board was disarmed or stopped. No response, as for accepted
            // setpoints: telemetry shows the setpoints in force.
            return Ok(());
        }
        for (unit, setpoint) in self.units.iter_mut().zip(checked) {
            unit.setpoint = setpoint;
        }
        self.tip
            .set_directions(&wire.map(|setpoint| setpoint.direction_q14));
        self.expiry.renew(now, valid_ms);
        Ok(())
    }

    /// State of the whole board, with the counters of one link.
    #[must_use]
    pub fn status(&self, now: Micros, figures: LoopFigures, counters: LinkCounters) -> Status {
        Status {
            t_us: now.0,
            state: self.system as u8,
            fault: self.latch.code(),
            fault_detail: self.latch.detail(),
            estop_closed: self.estop_closed,
            units: core::array::from_fn(|n| {
                let unit = &self.units[n];
                UnitStatus {
                    state: unit.motor as u8,
                    fault: unit.latch.code(),
                    fault_detail: unit.latch.detail(),
                    samples: unit.samples,
                    missed: unit.missed,
                    spikes: unit.spikes,
                    failed_reads: unit.failed_reads,
                    period_us: if unit.sensor_up {
                        unit.rate.period_us().min(u32::from(u16::MAX)) as u16
                    } else {
                        0
                    },
                    tension_un: unit.control.tension().to_un(),
                    adc_code: unit.adc_code.get(),
                    encoder_counts: unit.counts.0 as i32,
                }
            }),
            tip_force_un: self.tip.force_un(),
            alive_withheld: self.withholds_alive(),
            config_crc: self.config_crc,
            setpoint_age_ms: self.expiry.age_ms(now),
            frames_dropped: counters.dropped,
            frames_bad: counters.bad,
            bus_recoveries: self.recoveries,
            sleep_permille: figures.sleep_permille,
            queue_high_water: figures.queue_high_water,
        }
    }
}
