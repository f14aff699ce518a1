//! The machine that the host talks to: six controllers, their state machines, faults, setpoints,
//! configuration and commands. Pure: samples, time and commands go in, DAC codes, answers and [`Effects`]
//! come out. The superloop owns the only one.
//!
//! Two links reach the board, and one of them commands: the one that said Hello last. The other may go on
//! listening; its commands are refused. So no two programs can pull at the motors in turn.

use crate::bus;
use control::faults::Latch;
use control::motor;
use control::supervisor::{EncoderWatch, Expiry, Rate, RateLimits, Verdict};
use control::system::{self, Denied, Request};
use control::unit::{self, Controller, Drive, Setpoint};
use control::zero::{Averager, Progress};
use control::{
    Config, Counts, DacCode, Fault, Input, LoadCode, Micros, MotorState, Output, SystemState,
};
use drivers::nau7802::{Cause, SequenceError, Stage};
use wire::frame::crc32;
use wire::message::{
    flags, BoardInfo, CommandError, FaultReport, Response, Sample, Status, UnitConfig,
    UnitSetpoint, UnitStatus,
};
use wire::{Command, HostFrame, ABI_VERSION, SCHEMA_HASH, UNITS};

/// Links that the board has.
pub const LINKS: usize = 2;

/// Time after arming in which the first setpoints must have come, in milliseconds.
pub const FIRST_SETPOINT_MS: u16 = 1_000;

/// Time from the end of a bring-up to its first sample, in milliseconds: seven conversions are 22 ms.
pub const FIRST_SAMPLE_MS: u32 = 100;

/// Failed reads of a converter in a row that make a fault.
pub const MAX_FAILED_READS: u8 = 4;

/// Longest pass of the superloop in microseconds. A pass takes some tens; half a sample period is the most
/// that a sample may wait.
pub const MAX_PASS_US: u32 = 1_500;

/// Events of noise at an encoder within a second that are a fault.
const ENCODER_NOISE_EVENTS: u8 = 5;
/// Milliseconds between checks of the configuration in memory.
const CONFIG_CHECK_MS: u32 = 1_000;

/// What the machine makes the board do, apart from the DAC code that a sample returns.
pub trait Effects {
    /// Bring this unit's converter up from the start.
    fn start_sensor(&mut self, unit: u8);
    /// Do not look after this unit's converter any more.
    fn stop_sensor(&mut self, unit: u8);
    /// 0 V on this unit's motor now.
    fn zero_output(&mut self, unit: u8);
    /// Tell both links of a fault.
    fn report(&mut self, report: FaultReport);
}

/// What the supervisor's millisecond finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Health {
    /// The E-stop loop is closed.
    pub estop_closed: bool,
    /// Board time when the loop opened last.
    pub estop_opened_at: u32,
    /// Longest pass of the superloop since the last millisecond, in microseconds.
    pub longest_pass_us: u32,
    /// Events that the queue had no room for, since boot.
    pub events_lost: u32,
    /// SPI1_SR where a DAC word did not come to its end.
    pub dac_error: Option<u32>,
}

/// What a link counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkCounters {
    /// Frames that its queue had no room for.
    pub dropped: u32,
    /// Frames from the host that were damaged or unknown.
    pub bad: u32,
}

/// What the superloop measures for [`Status`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LoopFigures {
    /// Part of the last second asleep, in thousandths.
    pub sleep_permille: u16,
    /// Most samples that waited at once since the last status.
    pub queue_high_water: u8,
}

/// One force unit.
#[derive(Debug, Clone, Copy)]
struct Unit {
    config: Config,
    /// When the noise events that are being counted began, and how many there were.
    encoder_noise: (u32, u8),
    encoder: EncoderWatch,
    staged: Option<Config>,
    control: unit::State,
    motor: MotorState,
    latch: Latch,
    rate: Rate,
    setpoint: Setpoint,
    /// The converter has been brought up and its first sample is in.
    sensor_up: bool,
    /// When the bring-up ended, for as long as the first sample is awaited.
    came_up: Option<u32>,
    zero: Option<Averager>,
    /// The force last commanded is zero.
    at_zero: bool,
    samples: u32,
    missed: u32,
    spikes: u32,
}

impl Unit {
    fn new() -> Self {
        Self {
            config: Config::default(),
            encoder_noise: (0, 0),
            encoder: EncoderWatch::default(),
            staged: None,
            control: unit::State::default(),
            motor: MotorState::default(),
            latch: Latch::new(),
            rate: Rate::default(),
            setpoint: Setpoint::default(),
            sensor_up: false,
            came_up: None,
            zero: None,
            at_zero: true,
            samples: 0,
            missed: 0,
            spikes: 0,
        }
    }

    fn usable(&self) -> bool {
        !self.latch.is_set()
            && matches!(
                self.motor,
                MotorState::Ready
                    | MotorState::Running
                    | MotorState::Stopping
                    | MotorState::Zeroing
            )
    }
}

/// A sample that has been answered; turned into telemetry after its DAC word is on its way.
#[derive(Debug, Clone, Copy, Default)]
pub struct Answered {
    unit: u8,
    code: LoadCode,
    counts: i64,
    missed: bool,
    output: Output,
}

impl Answered {
    /// The telemetry, times left at 0.
    #[must_use]
    pub fn describe(&self) -> Sample {
        let mut sample = Sample {
            unit: self.unit,
            adc_code: self.code.get(),
            encoder_counts: self.counts as i32,
            ..Sample::default()
        };
        self.output.describe(&mut sample);
        if self.missed {
            sample.flags |= flags::MISSED;
        }
        sample
    }
}

/// See the [module](self).
#[derive(Debug)]
pub struct Machine {
    units: [Unit; UNITS],
    system: SystemState,
    latch: Latch,
    expiry: Expiry,
    estop_closed: bool,
    estop_open_ms: u8,
    commit: bool,
    config_crc: u32,
    config_check_ms: u32,
    events_lost: u32,
    recoveries: u16,
    bus_stuck: bool,
    commander: Option<usize>,
    decimation: [u8; LINKS],
    info: BoardInfo,
}

impl Machine {
    /// A machine at rest: every unit off until it is configured. A reason that the run before this one left
    /// is latched as a fault, so that nobody arms without having seen it.
    #[must_use]
    pub fn new(info: BoardInfo) -> Self {
        let mut latch = Latch::new();
        if let Some(record) = &info.crash_record {
            if let Some(fault) = Fault::from_code(record.code) {
                latch.latch(fault, record.detail);
            }
        }
        let mut machine = Self {
            units: core::array::from_fn(|_| Unit::new()),
            system: SystemState::Boot,
            latch,
            expiry: Expiry::default(),
            estop_closed: false,
            estop_open_ms: 0,
            commit: false,
            config_crc: 0,
            config_check_ms: 0,
            events_lost: 0,
            recoveries: 0,
            bus_stuck: false,
            commander: None,
            decimation: [0; LINKS],
            info,
        };
        machine.config_crc = machine.crc();
        machine
    }

    /// State of the board.
    #[must_use]
    pub const fn system(&self) -> SystemState {
        self.system
    }

    /// Whether any fault is latched, of the board or of a unit.
    #[must_use]
    pub fn is_faulted(&self) -> bool {
        self.latch.is_set() || self.units.iter().any(|unit| unit.latch.is_set())
    }

    /// Decimation of this link's telemetry: one sample of each unit in this many is sent; 0: none.
    #[must_use]
    pub fn decimation(&self, link: usize) -> u8 {
        self.decimation.get(link).copied().unwrap_or(0)
    }

    // --- the sample path -------------------------------------------------------------------------

    /// One sample of one unit: the DAC code that answers it, and what telemetry will tell of it.
    pub fn sample(
        &mut self,
        unit: u8,
        code: LoadCode,
        counts: i64,
        at: u32,
        missed: u8,
        fx: &mut impl Effects,
    ) -> (DacCode, Answered) {
        let Some(slot) = self.units.get_mut(usize::from(unit)) else {
            return (DacCode::ZERO_VOLT, Answered::default());
        };
        slot.samples = slot.samples.wrapping_add(1);
        slot.missed = slot.missed.wrapping_add(u32::from(missed));
        slot.rate.observe(Micros(at), missed);
        slot.sensor_up = true;
        slot.came_up = None;
        let drive = match slot.motor {
            _ if self.latch.is_set() || slot.latch.is_set() => Drive::Off,
            MotorState::Running => Drive::Follow,
            MotorState::Stopping => Drive::Ramp,
            _ => Drive::Off,
        };
        let input = Input {
            code,
            counts: Counts(counts),
            at: Micros(at),
            setpoint: slot.setpoint,
            drive,
        };
        let output = Controller::step(&slot.config, &mut slot.control, input);
        slot.at_zero = output.at_zero;
        let swing = slot
            .encoder
            .observe(drive != Drive::Off, Counts(counts), output.tension);
        let answered = Answered {
            unit,
            code,
            counts,
            missed: missed > 0,
            output,
        };
        if output.flags & flags::SPIKE != 0 {
            slot.spikes = slot.spikes.wrapping_add(1);
        }
        if let Some(averager) = &mut slot.zero {
            match averager.push(code) {
                Progress::Collecting(_) => {}
                Progress::Done(zero) => {
                    slot.zero = None;
                    slot.config = slot.config.with_zero(zero);
                    // A configuration that waits for its commit must not bring the old zero back.
                    slot.staged = slot.staged.map(|staged| staged.with_zero(zero));
                    slot.control.config_changed();
                    self.config_crc = self.crc();
                }
                Progress::Refused(why) => {
                    slot.zero = None;
                    self.fault_unit(unit, Fault::ZeroRefused, why.detail(), at, fx);
                }
            }
        }
        if let Some((fault, detail)) = output.fault {
            self.fault_unit(unit, fault, detail, at, fx);
        } else if let Some(swing) = swing {
            let detail = (swing.to_un() / 1_000).unsigned_abs();
            self.fault_unit(unit, Fault::EncoderStill, detail, at, fx);
            return (DacCode::ZERO_VOLT, answered);
        }
        (output.dac, answered)
    }

    /// Something else that the bus reported.
    pub fn bus_event(&mut self, event: bus::Event, now: u32, fx: &mut impl Effects) {
        match event {
            bus::Event::Edge { .. } | bus::Event::Sample { .. } => {}
            bus::Event::Up { unit } => {
                if let Some(slot) = self.units.get_mut(usize::from(unit)) {
                    slot.came_up = Some(now);
                }
            }
            bus::Event::BringUpFailed { unit, error } => {
                self.fault_unit(unit, Fault::BringUpFailed, bring_up_detail(&error), now, fx);
            }
            bus::Event::ReadFailed { unit, in_a_row } => {
                if in_a_row >= MAX_FAILED_READS {
                    self.fault_unit(unit, Fault::SensorReads, u32::from(in_a_row), now, fx);
                }
            }
            bus::Event::Recovery => self.recoveries = self.recoveries.saturating_add(1),
            bus::Event::Stuck { rounds, sda_low } => {
                self.bus_stuck = true;
                let detail = u32::from(rounds) | u32::from(sda_low) << 31;
                self.fault_board(Fault::BusStuck, detail, now, fx);
            }
            bus::Event::MuxSilent { mask } => {
                self.fault_board(Fault::MuxSilent, u32::from(mask) << 8 | 0xFF, now, fx);
            }
        }
    }

    // --- the supervisor --------------------------------------------------------------------------

    /// The supervisor's millisecond.
    pub fn tick(&mut self, now: u32, health: Health, fx: &mut impl Effects) {
        self.exchange_configs();
        self.watch_board(now, health, fx);
        for n in 0..UNITS as u8 {
            self.watch_unit(n, now, fx);
        }
        self.advance(Request::None, now, fx);
    }

    /// A fault of the whole board that another part found (a counter that does not answer).
    pub fn fault_board(&mut self, fault: Fault, detail: u32, now: u32, fx: &mut impl Effects) {
        if self.latch.latch(fault, detail) {
            fx.report(FaultReport {
                t_us: now,
                unit: u8::MAX,
                code: fault.code(),
                detail,
            });
        }
        // Not with the next sample: now. And again for each fault: it costs little.
        for unit in 0..UNITS as u8 {
            fx.zero_output(unit);
        }
        self.advance(Request::None, now, fx);
    }

    /// A counter saw noise at a unit's encoder; `flags` is its FLAG register. One event is no proof of a wrong
    /// count; five within a second are a loose plug.
    pub fn encoder_noise(&mut self, unit: u8, flags: u8, now: u32, fx: &mut impl Effects) {
        let Some(slot) = self.units.get_mut(usize::from(unit)) else {
            return;
        };
        if !slot.config.enabled() {
            return;
        }
        let (since, events) = slot.encoder_noise;
        slot.encoder_noise = if now.wrapping_sub(since) > 1_000_000 {
            (now, 1)
        } else {
            (since, events.saturating_add(1))
        };
        if slot.encoder_noise.1 >= ENCODER_NOISE_EVENTS {
            slot.encoder_noise.1 = 0;
            self.fault_unit(unit, Fault::EncoderError, flags.into(), now, fx);
        }
    }

    fn fault_unit(&mut self, unit: u8, fault: Fault, detail: u32, now: u32, fx: &mut impl Effects) {
        let Some(slot) = self.units.get_mut(usize::from(unit)) else {
            return;
        };
        if slot.latch.latch(fault, detail) {
            fx.report(FaultReport {
                t_us: now,
                unit,
                code: fault.code(),
                detail,
            });
        }
        slot.zero = None;
        fx.zero_output(unit);
        // These leave a converter whose state is not known; the others keep on measuring for telemetry.
        if matches!(
            fault,
            Fault::SensorSilent | Fault::BringUpFailed | Fault::SensorReads
        ) {
            slot.sensor_up = false;
            slot.came_up = None;
            fx.stop_sensor(unit);
        }
        self.advance(Request::None, now, fx);
    }

    fn watch_board(&mut self, now: u32, health: Health, fx: &mut impl Effects) {
        // Two milliseconds in a row: longer than a spark, shorter than a hand.
        self.estop_open_ms = if health.estop_closed {
            0
        } else {
            self.estop_open_ms.saturating_add(1)
        };
        self.estop_closed = self.estop_open_ms < 2;
        if !self.estop_closed {
            self.fault_board_once(Fault::EStop, health.estop_opened_at, now, fx);
        }
        // Not while a disarmed board ramps down: that needs no host, and ends by itself.
        if self.system == SystemState::Running && self.expiry.is_expired(Micros(now)) {
            let age = u32::from(self.expiry.age_ms(Micros(now)));
            self.fault_board_once(Fault::SetpointsExpired, age, now, fx);
        }
        // The first passes carry the start-up.
        if health.longest_pass_us > MAX_PASS_US && self.system != SystemState::Boot {
            self.fault_board_once(Fault::LoopOverrun, health.longest_pass_us, now, fx);
        }
        if health.events_lost != self.events_lost {
            self.events_lost = health.events_lost;
            self.fault_board_once(Fault::QueueOverflow, health.events_lost, now, fx);
        }
        if let Some(status) = health.dac_error {
            self.fault_board_once(Fault::DacLink, status, now, fx);
        }
        self.config_check_ms += 1;
        if self.config_check_ms >= CONFIG_CHECK_MS {
            self.config_check_ms = 0;
            let crc = self.crc();
            if crc != self.config_crc {
                self.fault_board_once(Fault::ConfigCrc, crc, now, fx);
            }
        }
    }

    /// As [`Self::fault_board`], for causes that last: acts only as long as nothing is latched.
    fn fault_board_once(&mut self, fault: Fault, detail: u32, now: u32, fx: &mut impl Effects) {
        if !self.latch.is_set() {
            self.fault_board(fault, detail, now, fx);
        }
    }

    fn watch_unit(&mut self, n: u8, now: u32, fx: &mut impl Effects) {
        let slot = &self.units[usize::from(n)];
        if slot.latch.is_set() || !slot.config.enabled() {
            return;
        }
        if let Some(since) = slot.came_up {
            if now.wrapping_sub(since) > FIRST_SAMPLE_MS * 1_000 {
                self.fault_unit(n, Fault::BringUpFailed, FIRST_SAMPLE_STAGE << 8, now, fx);
            }
            return;
        }
        if !slot.sensor_up {
            return;
        }
        match slot.rate.check(Micros(now), &RateLimits::SENSOR) {
            Verdict::Ok => {}
            Verdict::Silent => {
                let silent_us = slot.rate.last().map_or(0, |last| Micros(now).since(last));
                self.fault_unit(n, Fault::SensorSilent, silent_us, now, fx);
            }
            Verdict::TooSlow(period) => self.fault_unit(n, Fault::SensorSlow, period, now, fx),
            Verdict::TooFast(period) => self.fault_unit(n, Fault::SensorFast, period, now, fx),
        }
    }

    /// Both state machines, once. Returns why the request was denied, if it was.
    fn advance(&mut self, request: Request, _now: u32, fx: &mut impl Effects) -> Option<Denied> {
        let mut enabled = self
            .units
            .iter()
            .filter(|unit| unit.config.enabled())
            .peekable();
        let any_enabled = enabled.peek().is_some();
        let all_ready = any_enabled && enabled.all(Unit::usable);
        let transition = system::next(
            self.system,
            system::Conditions {
                booted: true,
                faulted: self.latch.is_set(),
                estop_closed: self.estop_closed,
                any_bringing_up: self
                    .units
                    .iter()
                    .any(|unit| unit.motor == MotorState::BringUp),
                all_ready,
                any_usable: self.units.iter().any(Unit::usable),
                zero_done: self.units.iter().all(|unit| unit.zero.is_none()),
                ramp_done: self
                    .units
                    .iter()
                    .all(|unit| !unit.motor.drives() || unit.at_zero),
                request,
            },
        );
        let was = core::mem::replace(&mut self.system, transition.state);
        if was.drives() && !self.system.drives() {
            self.expiry.forget();
            for unit in &mut self.units {
                unit.setpoint = Setpoint::default();
            }
        }
        for (n, unit) in (0..).zip(&mut self.units) {
            let conditions = motor::Conditions {
                enabled: unit.config.enabled(),
                faulted: unit.latch.is_set(),
                sensor_up: unit.sensor_up,
                system: self.system,
            };
            let next = motor::next(unit.motor, conditions);
            unit.motor = next.state;
            match next.action {
                motor::Action::None => {}
                motor::Action::StartBringUp => {
                    unit.sensor_up = false;
                    unit.came_up = None;
                    unit.rate.reset();
                    unit.control.reset();
                    fx.start_sensor(n);
                }
                motor::Action::ResetController => unit.control.reset(),
                motor::Action::ZeroOutput => fx.zero_output(n),
            }
            if !self.system.drives() {
                unit.at_zero = true;
            }
        }
        transition.denied
    }

    // --- configuration ---------------------------------------------------------------------------

    /// Exchanges what is staged, between two samples.
    fn exchange_configs(&mut self) {
        if !core::mem::take(&mut self.commit) || self.system.drives() {
            return;
        }
        for unit in &mut self.units {
            if let Some(config) = unit.staged.take() {
                unit.config = config;
                unit.control.config_changed();
            }
        }
        self.config_crc = self.crc();
    }

    /// CRC-32 over the six configurations in force, each as postcard encodes it, one after the other.
    fn crc(&self) -> u32 {
        let configs: [UnitConfig; UNITS] = core::array::from_fn(|n| *self.units[n].config.wire());
        config_crc(&configs)
    }

    // --- commands --------------------------------------------------------------------------------

    /// Carries out a command. `None`: nothing to answer (setpoints within their ranges).
    pub fn command(
        &mut self,
        link: usize,
        frame: &HostFrame,
        now: u32,
        figures: LoopFigures,
        counters: LinkCounters,
        fx: &mut impl Effects,
    ) -> Option<Response> {
        if let Command::Hello { abi, schema } = frame.command {
            return Some(self.hello(link, abi, schema));
        }
        if self.commander != Some(link) {
            return Some(Response::Rejected(CommandError::NotConnected));
        }
        // Commands are carried out between two samples, so here is a cycle boundary too: whoever asks after a commit
        // gets what was committed, and arming acts on it.
        self.exchange_configs();
        let result = match &frame.command {
            Command::Hello { .. } => Ok(()),
            Command::GetStatus => {
                return Some(Response::Status(self.status(now, figures, counters)))
            }
            Command::GetConfig { unit } => match self.units.get(usize::from(*unit)) {
                Some(slot) => return Some(Response::Config(*slot.config.wire())),
                None => Err(CommandError::UnknownUnit(*unit)),
            },
            Command::StageConfig { unit, config } => self.stage(*unit, config),
            Command::CommitConfig => self.commit(),
            Command::Zero { units } => self.zero(*units, now, fx),
            Command::Arm => self.arm(now, fx),
            Command::Disarm => self.request(Request::Disarm, now, fx),
            Command::Stop => {
                self.fault_board(Fault::HostStop, u32::from(frame.seq), now, fx);
                Ok(())
            }
            Command::ClearFaults => self.clear_faults(now, fx),
            Command::Setpoints { valid_ms, units } => match self.setpoints(*valid_ms, units, now) {
                Ok(()) => return None,
                refused => refused,
            },
            Command::Stream { decimation } => {
                self.decimation[link] = *decimation;
                Ok(())
            }
        };
        Some(match result {
            Ok(()) => Response::Done,
            Err(refusal) => Response::Rejected(refusal),
        })
    }

    fn hello(&mut self, link: usize, abi: u16, schema: [u8; 8]) -> Response {
        if abi != ABI_VERSION || schema != SCHEMA_HASH || link >= LINKS {
            // A host that cannot be understood does not displace one that can.
            return Response::Rejected(CommandError::Version {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
            });
        }
        self.commander = Some(link);
        Response::Hello(self.info.clone())
    }

    fn stage(&mut self, unit: u8, config: &UnitConfig) -> Result<(), CommandError> {
        if self.system.drives() {
            return Err(CommandError::State(self.system as u8));
        }
        let slot = self
            .units
            .get_mut(usize::from(unit))
            .ok_or(CommandError::UnknownUnit(unit))?;
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

    fn zero(&mut self, mask: u8, now: u32, fx: &mut impl Effects) -> Result<(), CommandError> {
        if mask == 0 || mask >> UNITS != 0 {
            return Err(CommandError::UnknownUnit(
                mask.trailing_zeros().max(UNITS as u32) as u8,
            ));
        }
        for (n, unit) in (0..).zip(&self.units) {
            if mask & (1 << n) != 0 && !unit.usable() {
                return Err(match unit.latch.get() {
                    Some((fault, _)) => CommandError::Faulted(fault.code()),
                    None => CommandError::UnitNotReady {
                        unit: n,
                        state: unit.motor as u8,
                    },
                });
            }
        }
        self.request(Request::Zero, now, fx)?;
        for (n, unit) in self.units.iter_mut().enumerate() {
            unit.zero = (mask & (1 << n) != 0).then(Averager::new);
        }
        Ok(())
    }

    fn arm(&mut self, now: u32, fx: &mut impl Effects) -> Result<(), CommandError> {
        let was = self.system;
        self.request(Request::Arm, now, fx)?;
        if was != SystemState::Running && !self.expiry.is_valid(Micros(now)) {
            for unit in &mut self.units {
                unit.setpoint = Setpoint::default();
            }
            self.expiry.renew(Micros(now), FIRST_SETPOINT_MS);
        }
        Ok(())
    }

    fn request(
        &mut self,
        request: Request,
        now: u32,
        fx: &mut impl Effects,
    ) -> Result<(), CommandError> {
        match self.advance(request, now, fx) {
            None => {
                if request == Request::Disarm {
                    for unit in &mut self.units {
                        unit.zero = None;
                    }
                }
                Ok(())
            }
            Some(Denied::Faulted) => Err(CommandError::Faulted(self.latch.code())),
            Some(Denied::EStopOpen) => Err(CommandError::Faulted(Fault::EStop.code())),
            Some(Denied::State) => Err(CommandError::State(self.system as u8)),
            Some(Denied::UnitNotReady) => Err(self.why_not_ready()),
        }
    }

    /// The first enabled unit that isn't ready, or its fault.
    fn why_not_ready(&self) -> CommandError {
        (0..)
            .zip(&self.units)
            .find(|(_, unit)| unit.config.enabled() && !unit.usable())
            .map_or(
                CommandError::State(self.system as u8),
                |(n, unit)| match unit.latch.get() {
                    Some((fault, _)) => CommandError::Faulted(fault.code()),
                    None => CommandError::UnitNotReady {
                        unit: n,
                        state: unit.motor as u8,
                    },
                },
            )
    }

    fn clear_faults(&mut self, now: u32, fx: &mut impl Effects) -> Result<(), CommandError> {
        let estop_open = !self.estop_closed;
        self.bus_stuck = false; // reported again within STUCK_PAUSE_US if it is still held
        let board = self.latch.clear(|fault| match fault {
            Fault::EStop => estop_open,
            // Set once at boot: a counter that does not answer needs a repair and a restart.
            Fault::CounterBus => true,
            _ => false,
        });
        if !board {
            return Err(CommandError::Faulted(self.latch.code()));
        }
        for unit in &mut self.units {
            let too_tight = unit.sensor_up
                && unit.control.tension().to_un() > unit.config.wire().over_tension_un;
            unit.latch
                .clear(|fault| fault == Fault::OverTension && too_tight);
        }
        self.advance(Request::None, now, fx);
        match self.units.iter().find_map(|unit| unit.latch.get()) {
            None => Ok(()),
            Some((fault, _)) => Err(CommandError::Faulted(fault.code())),
        }
    }

    fn setpoints(
        &mut self,
        valid_ms: u16,
        wire: &[UnitSetpoint; UNITS],
        now: u32,
    ) -> Result<(), CommandError> {
        if valid_ms == 0 || valid_ms > 1_000 {
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
            // Those that were on their way when the board was disarmed or stopped: no answer, as for those
            // that are accepted. What is in force is what telemetry shows.
            return Ok(());
        }
        for (unit, setpoint) in self.units.iter_mut().zip(checked) {
            unit.setpoint = setpoint;
        }
        self.expiry.renew(Micros(now), valid_ms);
        Ok(())
    }

    /// State of the whole board as a link sees it.
    #[must_use]
    pub fn status(&self, now: u32, figures: LoopFigures, counters: LinkCounters) -> Status {
        Status {
            t_us: now,
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
                    period_us: if unit.sensor_up {
                        unit.rate.period_us().min(u32::from(u16::MAX)) as u16
                    } else {
                        0
                    },
                    tension_un: unit.control.tension().to_un(),
                }
            }),
            config_crc: self.config_crc,
            setpoint_age_ms: self.expiry.age_ms(Micros(now)),
            frames_dropped: counters.dropped,
            frames_bad: counters.bad,
            bus_recoveries: self.recoveries,
            sleep_permille: figures.sleep_permille,
            queue_high_water: figures.queue_high_water,
        }
    }
}

/// CRC-32 over configurations: each as postcard encodes it, one after the other, unit 1 first.
#[must_use]
pub fn config_crc(configs: &[UnitConfig; UNITS]) -> u32 {
    // 19 numbers of at most 5 bytes each and three of one byte: 98 bytes a unit.
    let mut buffer = [0; UNITS * 104];
    postcard::to_slice(configs, &mut buffer).map_or(0, |bytes| crc32(bytes))
}

/// [`Fault::BringUpFailed`]: stage number of "first sample".
const FIRST_SAMPLE_STAGE: u32 = 7;

/// Detail of [`Fault::BringUpFailed`] from the driver's finer stages.
fn bring_up_detail(error: &SequenceError) -> u32 {
    let stage = match error.stage {
        _ if error.cause == Cause::Bus => 1,
        Stage::ResetAssert | Stage::ResetRelease => 2,
        Stage::PowerUpDigital
        | Stage::PowerUpReady
        | Stage::PowerUpAnalog
        | Stage::SupplySettle => 3,
        Stage::RevisionCheck => 4,
        Stage::CycleStart
        | Stage::CalibrationStart
        | Stage::CalibrationWait
        | Stage::CycleStop
        | Stage::CycleRestart => 6,
        Stage::Finished => FIRST_SAMPLE_STAGE,
        _ => 5,
    };
    stage << 8 | u32::from(error.register.address())
}
