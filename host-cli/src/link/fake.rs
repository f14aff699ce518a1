//! A board for tests: speaks wire over memory, runs the real control core against the plant, and
//! can misbehave. It stands in for the firmware's *manners*; what the firmware really does is tested with the
//! firmware.

use super::{Exchange, LinkError, RigControls, RigLink};
use control::unit::{Drive, Setpoint};
use control::zero::{Averager, Progress};
use control::{
    AdcCode, Config, Controller, EncoderCounts, Fault, Input, Micros, MotorState, State,
    SystemState,
};
use emulator_link::{Injection, Pose, Report, Truth};
use plant::{Plant, PlantConfig};
use std::collections::VecDeque;
use std::time::Duration;
use wire::message::{
    Batch, BoardInfo, CommandError, FaultReport, Reply, Response, Sample, Status, UnitConfig,
    UnitStatus, BATCH,
};
use wire::{BoardFrame, BoardMessage, Command, Decoder, HostFrame, UNITS};

/// How the board misbehaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mood {
    /// Not at all.
    Good,
    /// Answers hello with another ABI version.
    OtherAbi(u16),
    /// Sends bytes that are no frames, and nothing else.
    Garbage,
    /// Sends nothing.
    Silent,
    /// Garbles one byte in this many.
    Noisy(u32),
    /// Refuses everything but hello.
    Refusing,
    /// The link breaks at this time, ns.
    BreaksAt(u64),
    /// The board falls silent at this time, ns.
    MuteAt(u64),
    /// The board restarts at this time, ns.
    ResetsAt(u64),
    /// Every n-th frame of the board is dropped, though counted.
    Drops(u16),
}

pub(crate) struct FakeBoard {
    pub(crate) mood: Mood,
    pub(crate) plant: Plant,
    pub(crate) system: SystemState,
    pub(crate) commands: Vec<Command>,
    /// Board fault that is latched.
    pub(crate) fault: Option<(Fault, u32)>,
    pub(crate) unit_faults: [Option<(Fault, u32)>; UNITS],
    now_ns: u64,
    epoch_ns: u64,
    resets: u32,
    decoder: Decoder,
    connected: bool,
    seq: u16,
    out: Vec<u8>,
    batch: Option<Batch>,
    configs: [Config; UNITS],
    staged: [Option<Config>; UNITS],
    states: [State; UNITS],
    samples: [u32; UNITS],
    zeroing: [Option<Averager>; UNITS],
    setpoints: [Setpoint; UNITS],
    expires_ns: Option<u64>,
    unplugged: [bool; UNITS],
    weight_n: [f64; UNITS],
    next_sample_ns: [u64; UNITS],
    bridge: [VecDeque<f64>; UNITS],
    random: u64,
}

/// Power-on to ready.
const BRING_UP_NS: u64 = 1_000_000_000;
/// The converter's sinc4 filter on a grid of 1 ms: four boxes of 4 ms, convolved; 6 ms of delay.
const SINC: [f64; 13] = [
    1.0, 4.0, 10.0, 20.0, 31.0, 40.0, 44.0, 40.0, 31.0, 20.0, 10.0, 4.0, 1.0,
];
const STATUS_NS: u64 = 50_000_000;
const MS: u64 = 1_000_000;

impl FakeBoard {
    pub(crate) fn new(mood: Mood) -> Self {
        Self::seeded(mood, 1)
    }

    /// A rig of its own for each seed.
    pub(crate) fn seeded(mood: Mood, seed: u64) -> Self {
        Self::with(mood, seed, PlantConfig::default())
    }

    /// A rig that does what no model of it says.
    pub(crate) fn with(mood: Mood, seed: u64, plant: PlantConfig) -> Self {
        let mut plant = Plant::new(plant, seed).expect("a good plant");
        plant.set_amplifier_power(true);
        Self {
            mood,
            plant,
            system: SystemState::BringUp,
            commands: Vec::new(),
            fault: None,
            unit_faults: [None; UNITS],
            now_ns: 0,
            epoch_ns: 0,
            resets: 0,
            decoder: Decoder::new(),
            connected: false,
            seq: 0,
            out: Vec::new(),
            batch: None,
            configs: [Config::default(); UNITS],
            staged: [None; UNITS],
            states: [State::default(); UNITS],
            samples: [0; UNITS],
            zeroing: [None; UNITS],
            setpoints: [Setpoint::default(); UNITS],
            expires_ns: None,
            unplugged: [false; UNITS],
            weight_n: [0.0; UNITS],
            next_sample_ns: core::array::from_fn(|i| 700_000 * i as u64 + MS),
            bridge: core::array::from_fn(|_| VecDeque::from([0.0; SINC.len()])),
            random: 1,
        }
    }

    fn noise(&mut self) -> f64 {
        // Sum of uniforms: near enough to a bell, SD about 0.58.
        (0..4)
            .map(|_| {
                self.random = self
                    .random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (self.random >> 33) as f64 / (1u64 << 30) as f64 - 1.0
            })
            .sum::<f64>()
            * 0.5
    }

    fn t_us(&self) -> u32 {
        ((self.now_ns - self.epoch_ns) / 1000) as u32
    }

    fn send(&mut self, message: BoardMessage) {
        self.seq = self.seq.wrapping_add(1);
        if let Mood::Drops(n) = self.mood {
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

    fn latch(&mut self, unit: Option<usize>, fault: Fault, detail: u32) {
        match unit {
            Some(unit) => self.unit_faults[unit] = Some((fault, detail)),
            None => {
                self.fault = Some((fault, detail));
                self.system = SystemState::Fault;
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

    fn unit_state(&self, i: usize) -> MotorState {
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

    fn status(&self) -> Status {
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
                period_us: 3125,
                tension_un: self.states[i].tension().to_un(),
            }),
            config_crc: crate::rigfile::board_crc(&self.wire_configs()),
            setpoint_age_ms: 0,
            frames_dropped: 0,
            frames_bad: self.decoder.bad_frames(),
            bus_recoveries: 0,
            sleep_permille: 900,
            queue_high_water: 1,
        }
    }

    fn respond(&mut self, command: &Command) -> Option<Response> {
        let armed = self.system.drives();
        let rejected = |error| Some(Response::Rejected(error));
        if let Command::Hello { .. } = command {
            let abi = match self.mood {
                Mood::OtherAbi(abi) => abi,
                _ => wire::ABI_VERSION,
            };
            self.connected = true;
            if abi != wire::ABI_VERSION {
                return rejected(CommandError::Version {
                    abi,
                    schema: [7; 8],
                });
            }
            return Some(Response::Hello(BoardInfo {
                abi,
                schema: wire::SCHEMA_HASH,
                version: "fake".try_into().expect("short"),
                core_hz: 400_000_000,
                reset_flags: 0,
                crash_record: (self.resets > 0).then(|| wire::message::CrashRecord {
                    code: Fault::WatchdogReset.code(),
                    detail: 0,
                    pc: 0,
                    text: "superloop".try_into().expect("short"),
                }),
            }));
        }
        if !self.connected {
            return rejected(CommandError::NotConnected);
        }
        if self.mood == Mood::Refusing {
            return rejected(CommandError::State(self.system as u8));
        }
        match command {
            Command::GetStatus => return Some(Response::Status(self.status())),
            Command::GetConfig { unit } => {
                return match self.configs.get(usize::from(*unit)) {
                    Some(config) => Some(Response::Config(*config.wire())),
                    None => rejected(CommandError::UnknownUnit(*unit)),
                }
            }
            Command::StageConfig { unit, config } => match Config::from_wire(config) {
                Ok(checked) => self.staged[usize::from(*unit)] = Some(checked),
                Err(error) => {
                    return rejected(CommandError::Range {
                        unit: *unit,
                        field: error.field.number,
                    })
                }
            },
            Command::CommitConfig | Command::Zero { .. } if armed => {
                return rejected(CommandError::State(self.system as u8))
            }
            Command::CommitConfig => {
                for (config, staged) in self.configs.iter_mut().zip(&mut self.staged) {
                    *config = staged.take().unwrap_or(*config);
                }
            }
            Command::Zero { units } => {
                for i in 0..UNITS {
                    self.zeroing[i] =
                        (units >> i & 1 == 1 && self.configs[i].enabled()).then(Averager::new);
                }
                self.system = SystemState::Zeroing;
            }
            Command::Arm => {
                if let Some((fault, _)) = self.fault {
                    return rejected(CommandError::Faulted(fault.code()));
                }
                let ready = (0..UNITS)
                    .all(|i| matches!(self.unit_state(i), MotorState::Ready | MotorState::Offline));
                if self.system != SystemState::Ready || !ready {
                    return rejected(CommandError::State(self.system as u8));
                }
                self.states = [State::default(); UNITS];
                self.system = SystemState::Running;
            }
            Command::Disarm if armed => {
                self.system = SystemState::Stopping;
                self.expires_ns = None;
            }
            Command::Disarm => {}
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
            Command::Setpoints { valid_ms, units } => {
                if self.system == SystemState::Running {
                    for i in 0..UNITS {
                        match Setpoint::from_wire(&self.configs[i], &units[i]) {
                            Ok(setpoint) => self.setpoints[i] = setpoint,
                            Err(field) => panic!("unit {i}: field {field} out of range: {units:?}"),
                        }
                    }
                    self.expires_ns = Some(self.now_ns + u64::from(*valid_ms) * MS);
                }
                return None;
            }
            Command::Stream { .. } | Command::Hello { .. } => {}
        }
        Some(Response::Done)
    }

    fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Ok(Some(frame)) = self.decoder.push::<HostFrame>(*byte) {
                self.commands.push(frame.command.clone());
                if let Some(response) = self.respond(&frame.command) {
                    self.send(BoardMessage::Reply(Reply {
                        seq: frame.seq,
                        response,
                    }));
                }
            }
        }
    }

    fn sample(&mut self, i: usize) {
        self.samples[i] += 1;
        let bridge: f64 = self.bridge[i]
            .iter()
            .zip(SINC)
            .map(|(b, w)| b * w / 256.0)
            .sum();
        // 24 bits over +-0.5 VREF/128; noise of 3 mN is 440 counts.
        let code = bridge * 128.0 * f64::from(1 << 24) + 440.0 * self.noise();
        let code = AdcCode::new(code.round() as i32);
        let counts = self.plant.encoder_counts(i);
        let drive = match self.unit_state(i) {
            MotorState::Running if self.setpoints[i].tension.to_bits() > 0 => Drive::Follow,
            MotorState::Running | MotorState::Stopping => Drive::Ramp,
            _ => Drive::Off,
        };
        let input = Input {
            adc_code: code,
            encoder_counts: EncoderCounts(counts),
            at: Micros(self.t_us()),
            setpoint: self.setpoints[i],
            drive,
        };
        let output = Controller::step(&self.configs[i], &mut self.states[i], input);
        if let Some((fault, detail)) = output.fault {
            self.latch(Some(i), fault, detail);
        }
        let volts = f64::from(output.dac.steps()) * 20.0 / 65_536.0;
        self.plant.set_amplifier_volts(i, volts).expect("a unit");
        if let Some(averager) = &mut self.zeroing[i] {
            match averager.push(code) {
                Progress::Collecting(_) => {}
                Progress::Done(zero) => {
                    self.configs[i] = self.configs[i].with_zero(zero);
                    self.zeroing[i] = None;
                }
                Progress::Refused(refused) => {
                    self.zeroing[i] = None;
                    self.latch(Some(i), Fault::ZeroRefused, refused.detail());
                }
            }
        }
        let mut sample = Sample {
            unit: i as u8,
            adc_code: code.get(),
            encoder_counts: counts as i32,
            latency_us: 200,
            ..Sample::default()
        };
        output.describe(&mut sample);
        let t_us = self.t_us();
        let batch = self.batch.get_or_insert(Batch {
            t_us,
            samples: Default::default(),
        });
        sample.dt_us = (t_us - batch.t_us) as u16;
        batch.samples.push(sample).expect("sent when full");
        if batch.samples.len() == BATCH {
            let batch = self.batch.take().expect("just filled");
            self.send(BoardMessage::Samples(batch));
        }
    }

    /// One millisecond, for what is looked at in that grid.
    fn tick(&mut self) {
        for i in 0..UNITS {
            self.bridge[i].pop_front();
            let weight = self.weight_n[i] * self.plant.parameters(i).bridge_per_n;
            self.bridge[i].push_back(self.plant.bridge_v_per_v(i) + weight);
        }
        let age = self.now_ns - self.epoch_ns;
        match self.system {
            SystemState::Boot | SystemState::BringUp if age >= BRING_UP_NS => {
                self.system = SystemState::Ready;
                for i in 0..UNITS {
                    if self.unplugged[i] {
                        self.latch(Some(i), Fault::BringUpFailed, 0x0100);
                    }
                }
            }
            SystemState::Zeroing if self.zeroing.iter().all(Option::is_none) => {
                self.system = SystemState::Ready;
            }
            SystemState::Stopping
                if (0..UNITS).all(|i| {
                    self.unit_faults[i].is_some() || self.states[i].command().to_bits() == 0
                }) =>
            {
                self.system = SystemState::Ready;
            }
            _ => {}
        }
        if self.expires_ns.is_some_and(|at| self.now_ns > at) {
            self.expires_ns = None;
            self.latch(None, Fault::SetpointsExpired, 101);
        }
        if age.is_multiple_of(STATUS_NS) {
            let status = self.status();
            self.send(BoardMessage::Status(status));
        }
        if self.mood == Mood::ResetsAt(self.now_ns) {
            let (plant, resets) = (self.plant.clone(), self.resets + 1);
            let commands = std::mem::take(&mut self.commands);
            *self = Self {
                plant,
                resets,
                commands,
                now_ns: self.now_ns,
                epoch_ns: self.now_ns,
                next_sample_ns: [self.now_ns + 500 * MS; UNITS],
                ..Self::new(Mood::Good)
            };
            for i in 0..UNITS {
                self.plant.set_amplifier_volts(i, 0.0).expect("a unit");
            }
        }
    }

    fn truth(&self) -> Truth {
        let truth = self.plant.truth();
        Truth {
            t_ns: self.now_ns,
            amplifier_on: truth.amplifier_power,
            tip_m: truth.tip_position_m,
            tip_force_n: truth.tip_force_n,
            tension_n: core::array::from_fn(|i| truth.units[i].tension_n),
            reel_rad_s: core::array::from_fn(|i| truth.units[i].reel_rad_per_s),
            dac_v: core::array::from_fn(|i| truth.units[i].amplifier_volts),
        }
    }
}

impl RigLink for FakeBoard {
    fn name(&self) -> String {
        "fake board".to_owned()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let end = self.now_ns + duration.as_nanos() as u64;
        let muted = |this: &Self| match this.mood {
            Mood::Silent => true,
            Mood::MuteAt(at) => this.now_ns >= at,
            _ => false,
        };
        if let Mood::BreaksAt(at) = self.mood {
            if end >= at {
                self.now_ns = self.now_ns.max(at);
                return Err(LinkError::Lost {
                    name: "fake board".to_owned(),
                    cause: "unplugged".to_owned(),
                });
            }
        }
        if !muted(self) {
            self.receive(to_board);
        }
        let mut truth = Vec::new();
        while self.now_ns < end {
            let next_ms = (self.now_ns / MS + 1) * MS;
            let unit = (0..UNITS)
                .filter(|i| !self.unplugged[*i])
                .min_by_key(|i| self.next_sample_ns[*i]);
            let sample_at = unit.map_or(u64::MAX, |i| self.next_sample_ns[i]);
            self.now_ns = next_ms.min(sample_at).min(end).max(self.now_ns);
            self.plant.advance_to(self.now_ns);
            if let Some(i) = unit.filter(|_| sample_at <= self.now_ns) {
                // The converters' own clocks: 310 to 330 SPS.
                self.next_sample_ns[i] = self.now_ns + 3_125_000 - 20_000 * i as u64 + 50_000;
                self.sample(i);
            }
            if self.now_ns == next_ms {
                self.tick();
                truth.push(self.truth());
            }
        }
        let mut from_board = std::mem::take(&mut self.out);
        match self.mood {
            Mood::Garbage => {
                from_board = (0..duration.as_micros() / 5)
                    .map(|n| (n as u8).wrapping_mul(37) ^ (n >> 3) as u8)
                    .collect();
            }
            Mood::Noisy(n) => {
                for byte in &mut from_board {
                    self.random = self
                        .random
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(99);
                    if ((self.random >> 33) as u32).is_multiple_of(n) {
                        *byte ^= 0x55;
                    }
                }
            }
            _ if muted(self) => from_board.clear(),
            _ => {}
        }
        Ok(Exchange {
            now_ns: self.now_ns,
            from_board,
            pose: Some(Pose {
                position_m: self.plant.tip_position_m(),
                velocity_m_s: self.plant.tip_velocity_m_per_s(),
            }),
            truth,
            resets: self.resets,
        })
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        Some(self)
    }
}

impl RigControls for FakeBoard {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.plant.set_robot_moving(moving);
        Ok(())
    }

    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        match injection {
            Injection::UnplugSensor(unit @ 1..=6) => {
                let i = usize::from(unit) - 1;
                self.unplugged[i] = true;
                self.plant.set_amplifier_volts(i, 0.0).expect("a unit");
                if self.system != SystemState::BringUp {
                    self.latch(Some(i), Fault::SensorSilent, 12_500);
                }
                Ok(())
            }
            Injection::PullCable(unit @ 1..=6, weight_n) => {
                self.weight_n[usize::from(unit) - 1] = weight_n;
                Ok(())
            }
            Injection::EStop(true) => {
                for i in 0..UNITS {
                    self.plant.set_amplifier_volts(i, 0.0).expect("a unit");
                }
                self.latch(None, Fault::EStop, 0);
                Ok(())
            }
            other => Err(LinkError::Refused(format!("{other:?}"))),
        }
    }

    fn report(&mut self) -> Result<Report, LinkError> {
        Ok(Report {
            now_ns: self.now_ns,
            ..Report::default()
        })
    }

    fn seed(&self) -> u64 {
        1
    }
}
