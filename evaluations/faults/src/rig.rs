//! The machine and what it is connected to: plant, converters, DACs, encoders, PLC and host, each with what is broken in it.
//!
//! Time goes in steps of 50 us. A conversion passes the converter's sinc4 filter; its DAC word acts 0.2 ms after it, which
//! is what bus, queue and superloop take. The superloop's tick is a millisecond.

use crate::injection::Injection;
use crate::random::Random;
use board::bus;
use board::machine::{Effects, Health, LinkCounters, LoopFigures, Machine};
use control::geometry::{cable_direction, cos_cell_angle, direction_q14, inv_cos_q16};
use control::{AdcCode, Config, DacCode, EncoderCounts, Fault, Micros, SystemState, UnitIndex};
use plant::{Plant, PlantConfig};
use std::collections::VecDeque;
use wire::message::{
    BoardInfo, Command, CrashRecord, FaultReport, HostFrame, Response, Status, UnitConfig,
    UnitSetpoint,
};
use wire::{encode, Decoder, ABI_VERSION, MAX_FRAME, SCHEMA_HASH, UNITS};

/// Step of the plant, in microseconds.
const STEP_US: u64 = 50;
/// Steps from a conversion to the DAC.
const LATENCY_STEPS: u64 = 4;
/// NAU7802 at gain 128: codes per bridge output in V/V.
const CODES_PER_BRIDGE: f64 = 128.0 * 16_777_216.0;
/// Noise of a conversion, in codes SD.
const NOISE_CODES: f64 = 215.0;
/// Time from the start of a bring-up to its end here, in steps: 20 ms; the calibration's 344 ms change nothing.
const BRING_UP_STEPS: u64 = 400;
/// Time after the last edge of the alive line after which the PLC removes the power, in steps.
const PLC_STEPS: u64 = 200;
/// Time after which the watchdog resets a hung loop, in steps.
const WATCHDOG_STEPS: u64 = 1_000;
/// Period of the host, in steps.
const HOST_STEPS: u64 = 200;
/// Validity of the host's setpoints, in milliseconds.
const VALID_MS: u16 = 100;
/// Volts at a DAC output per code.
const VOLTS_PER_CODE: f64 = 10.0 / 32_768.0;

/// A converter with its load cell.
#[derive(Debug, Clone)]
struct Converter {
    period: usize,
    kernel: Vec<f64>,
    ring: Vec<f64>,
    next: u64,
    /// Bring-up ends at this step.
    up_at: Option<u64>,
    streams: bool,
    last_code: i32,
    failed_reads: u8,
    conversions: u32,
    missed: u8,
}

fn sinc4(period: usize) -> Vec<f64> {
    let mut kernel = vec![1.0];
    for _ in 0..4 {
        let mut next = vec![0.0; kernel.len() + period - 1];
        for (i, k) in kernel.iter().enumerate() {
            for value in &mut next[i..i + period] {
                *value += k / period as f64;
            }
        }
        kernel = next;
    }
    kernel
}

/// A DAC with its amplifier: words under way, the code at its output.
#[derive(Debug, Clone, Default)]
struct Output {
    words: VecDeque<(u64, u16)>,
    /// Last word that the firmware has for this unit.
    last: u16,
    code: u16,
}

/// What the machine asks for, until the rig carries it out.
#[derive(Debug, Clone, Default)]
struct Asked {
    start: Vec<UnitIndex>,
    stop: Vec<UnitIndex>,
    zero: Vec<UnitIndex>,
    reports: Vec<FaultReport>,
}

impl Effects for Asked {
    fn start_sensor(&mut self, unit: UnitIndex) {
        self.start.push(unit);
    }
    fn stop_sensor(&mut self, unit: UnitIndex) {
        self.stop.push(unit);
    }
    fn zero_output(&mut self, unit: UnitIndex) {
        self.zero.push(unit);
    }
    fn report(&mut self, report: FaultReport) {
        self.reports.push(report);
    }
}

/// An injection in force.
#[derive(Debug, Clone, Copy)]
struct Active {
    what: Injection,
    since: u64,
    /// How often it may still act.
    left: u32,
}

/// See the module's page.
#[derive(Clone)]
pub struct Rig {
    plant: Plant,
    machine: Machine,
    asked: Asked,
    converters: Vec<Converter>,
    outputs: Vec<Output>,
    encoder_offset: [i64; UNITS],
    encoder_frozen: [Option<i64>; UNITS],
    encoder_turned: [Option<i64>; UNITS],
    decoder: Decoder,
    old_frames: VecDeque<Vec<u8>>,
    seq: u16,
    /// Tensions that the host holds, N; `None`: it sends nothing.
    hold_n: Option<[f64; UNITS]>,
    next_host: u64,
    events_lost: u32,
    hung_since: Option<u64>,
    estop_closed: bool,
    last_alive: u64,
    power: bool,
    step: u64,
    random: Random,
    active: Vec<Active>,
}

fn info(crash_record: Option<CrashRecord>) -> BoardInfo {
    BoardInfo {
        abi: ABI_VERSION,
        schema: SCHEMA_HASH,
        version: "0".try_into().unwrap_or_default(),
        core_hz: 400_000_000,
        silicon: 0x2003,
        hse: true,
        reset_flags: 0,
        crash_record,
    }
}

impl Rig {
    /// A rig that is configured, zeroed, armed and has held `hold_n` on each cable for a second and a half.
    ///
    /// # Panics
    /// Where it does not get there: without it no case means anything.
    #[must_use]
    pub fn armed(seed: u64, hold_n: [f64; UNITS], current_limit_a: f64) -> Self {
        let mut config = PlantConfig::default();
        config.amplifier.current_limit_a = current_limit_a;
        let plant = Plant::new(config, seed).expect("the default is valid");
        let mut random = Random::stream(seed, 0xFA);
        let converters = (0..UNITS)
            .map(|_| {
                let period = 61 + random.below(4) as usize;
                Converter {
                    period,
                    kernel: sinc4(period),
                    ring: vec![0.0; 4 * 64],
                    next: 100 + random.below(60),
                    up_at: None,
                    streams: false,
                    last_code: 0,
                    failed_reads: 0,
                    conversions: 0,
                    missed: 0,
                }
            })
            .collect();
        let mut rig = Self {
            plant,
            machine: Machine::new(info(None)),
            asked: Asked::default(),
            converters,
            outputs: vec![
                Output {
                    code: DacCode::ZERO_VOLT.0,
                    last: DacCode::ZERO_VOLT.0,
                    ..Output::default()
                };
                UNITS
            ],
            encoder_offset: [0; UNITS],
            encoder_frozen: [None; UNITS],
            encoder_turned: [None; UNITS],
            decoder: Decoder::new(),
            old_frames: VecDeque::new(),
            seq: 0,
            hold_n: None,
            next_host: 0,
            events_lost: 0,
            hung_since: None,
            estop_closed: true,
            last_alive: 0,
            power: false,
            step: 0,
            random,
            active: Vec::new(),
        };
        rig.prepare(hold_n);
        rig
    }

    fn prepare(&mut self, hold_n: [f64; UNITS]) {
        self.run_ms(20);
        self.command(&Command::Hello {
            abi: ABI_VERSION,
            schema: SCHEMA_HASH,
        });
        for unit in 0..UNITS {
            let config = self.config(unit);
            self.must(&Command::StageConfig {
                unit: unit as u8,
                config,
            });
        }
        self.must(&Command::CommitConfig);
        self.run_ms(100);
        self.must(&Command::Zero { units: 0b11_1111 });
        self.run_ms(1_000);
        self.must(&Command::Arm);
        self.hold_n = Some(hold_n);
        self.run_ms(1_500);
        let status = self.status();
        assert_eq!(status.state, SystemState::Running as u8, "{status:?}");
        assert!(!self.machine.is_faulted(), "{status:?}");
    }

    /// The configuration of a unit that was calibrated to 1 %.
    fn config(&mut self, unit: usize) -> UnitConfig {
        let parameters = self.plant.parameters(unit);
        let per_n = parameters.bridge_per_n * (1.0 + 0.005 * self.random.normal());
        let zero = parameters.bridge_zero_v_per_v + parameters.assembly_weight_n * per_n;
        let zero_code = (zero * CODES_PER_BRIDGE) as i32;
        UnitConfig {
            scale_pn_per_count: (1e12 / (per_n * CODES_PER_BRIDGE)).round() as i32,
            travel_nm_per_count: -4_229,
            zero_code,
            stored_zero_code: zero_code,
            zero_deviation_un: 2_000_000,
            ..Config::nominal()
        }
    }

    /// Sends a command that must be accepted.
    fn must(&mut self, command: &Command) {
        let response = self.command(command);
        assert_eq!(response, Some(Response::Done), "{command:?}");
    }

    /// Hands a command to the machine, past the link.
    pub fn command(&mut self, command: &Command) -> Option<Response> {
        self.seq = self.seq.wrapping_add(1);
        let frame = HostFrame {
            seq: self.seq,
            command: command.clone(),
        };
        self.execute(0, &frame)
    }

    fn execute(&mut self, link: usize, frame: &HostFrame) -> Option<Response> {
        let now = self.now();
        let response = self.machine.command(
            link,
            frame,
            now,
            LoopFigures::default(),
            LinkCounters::default(),
            &mut self.asked,
        );
        self.carry_out();
        response
    }

    /// The board's status.
    #[must_use]
    pub fn status(&self) -> Status {
        self.machine
            .status(self.now(), LoopFigures::default(), LinkCounters::default())
    }

    /// Whether a fault is latched.
    #[must_use]
    pub fn is_faulted(&self) -> bool {
        self.machine.is_faulted()
    }

    /// Whether the amplifiers have power.
    #[must_use]
    pub const fn power(&self) -> bool {
        self.power
    }

    /// True tension of a cable, N.
    #[must_use]
    pub fn tension_n(&self, unit: usize) -> f64 {
        self.plant.tension_n(unit)
    }

    /// Cable that a reel has wound in since the start, m.
    #[must_use]
    pub fn wound_m(&self, unit: usize) -> f64 {
        self.plant.reel_rad(unit) * self.plant.config().drive.reel_radius_m
    }

    /// Pull that a motor exerts, N, from the current in it.
    #[must_use]
    pub fn pull_n(&self, unit: usize) -> f64 {
        self.plant.current_a(unit) * self.plant.config().drive.tension_per_current_n_per_a()
    }

    fn now(&self) -> Micros {
        Micros((self.step * STEP_US) as u32)
    }

    /// Puts an injection in force.
    pub fn inject(&mut self, what: Injection) {
        let left = match what {
            Injection::CodeBit(_, _, n)
            | Injection::DacBit(_, _, n)
            | Injection::FrameBit(_, n)
            | Injection::FrameCut(n)
            | Injection::Replay(n)
            | Injection::Garbage(n) => n,
            _ => u32::MAX,
        };
        match what {
            Injection::EncoderFrozen(unit) => self.encoder_frozen[unit] = Some(self.counts(unit)),
            Injection::EncoderReversed(unit) => {
                self.encoder_turned[unit] = Some(2 * self.plant.encoder_counts(unit));
            }
            Injection::EncoderJump(unit, counts) => self.encoder_offset[unit] += counts,
            Injection::HostStops => self.hold_n = None,
            Injection::HostPauses(ms) => self.next_host = self.step + u64::from(ms) * 20,
            Injection::EventsLost => self.events_lost += 1,
            Injection::Hang => self.hung_since = Some(self.step),
            Injection::Reset => self.reset(None),
            Injection::ConfigBit(unit, bit) => self.machine.flip_config(UnitIndex::ALL[unit], bit),
            Injection::RobotMoves => self.plant.set_robot_moving(true),
            Injection::EStop => self.estop_closed = false,
            Injection::StopElsewhere => {
                self.execute(
                    1,
                    &HostFrame {
                        seq: 1,
                        command: Command::Stop,
                    },
                );
            }
            _ => {}
        }
        self.active.push(Active {
            what,
            since: self.step,
            left,
        });
    }

    /// A reset of the controller: DACs at 0 V, a new machine.
    fn reset(&mut self, cause: Option<Fault>) {
        let record = cause.map(|fault| CrashRecord {
            code: fault.code(),
            detail: 0,
            pc: 0,
            text: Default::default(),
        });
        self.machine = Machine::new(info(record));
        self.hung_since = None;
        self.last_alive = self.step;
        for unit in 0..UNITS {
            self.converters[unit].streams = false;
            self.outputs[unit].words.clear();
            self.outputs[unit].last = DacCode::ZERO_VOLT.0;
            // RST of the DACs, which a stuck output ignores.
            if !self.dac_is_stuck(unit) {
                self.outputs[unit].code = DacCode::ZERO_VOLT.0;
            }
        }
    }

    /// Lets milliseconds pass.
    pub fn run_ms(&mut self, ms: u64) {
        for _ in 0..ms {
            for _ in 0..1_000 / STEP_US {
                self.pass();
            }
            self.tick();
        }
    }

    /// One step of the plant.
    fn pass(&mut self) {
        self.step += 1;
        self.move_outputs();
        self.plant.advance_to(self.step * STEP_US * 1_000);
        for unit in 0..UNITS {
            let bridge = self.plant.bridge_v_per_v(unit);
            let converter = &mut self.converters[unit];
            let size = converter.ring.len();
            converter.ring[self.step as usize % size] = bridge;
            if self.step >= converter.next {
                let period = converter.period as u64;
                self.converters[unit].next += self.stretched(unit, period);
                self.convert(unit);
            }
        }
        if self.step >= self.next_host {
            let slow = self.find(|what| match what {
                Injection::HostSlow(ms) => Some(u64::from(*ms) * 20),
                _ => None,
            });
            self.next_host = self.step + slow.unwrap_or(HOST_STEPS);
            self.host();
        }
    }

    fn find<T>(&self, pick: impl Fn(&Injection) -> Option<T>) -> Option<T> {
        self.active.iter().find_map(|active| pick(&active.what))
    }

    fn is(&self, what: Injection) -> bool {
        self.active.iter().any(|active| active.what == what)
    }

    /// As [`Self::find`], for what acts a limited number of times; a find uses one of them up.
    fn take<T>(&mut self, pick: impl Fn(&Injection) -> Option<T>) -> Option<T> {
        let active = self
            .active
            .iter_mut()
            .find(|active| active.left > 0 && pick(&active.what).is_some())?;
        active.left = active
            .left
            .saturating_sub(u32::from(active.left != u32::MAX));
        pick(&active.what)
    }

    /// Steps of a conversion whose period is changed.
    fn stretched(&self, unit: usize, period: u64) -> u64 {
        let factor = self.find(|what| match what {
            Injection::Period(u, factor) if *u == unit => Some(*factor),
            _ => None,
        });
        (period as f64 * factor.unwrap_or(1.0)).round() as u64
    }

    // --- Sensors -------------------------------------------------------------------------------

    fn convert(&mut self, unit: usize) {
        let bus_dead = self.is(Injection::BusHeld) || self.is(Injection::MuxSilent);
        if !self.converters[unit].streams
            || self.hung_since.is_some()
            || bus_dead
            || self.is(Injection::Silent(unit))
        {
            return;
        }
        let code = self.code(unit);
        self.converters[unit].conversions += 1;
        let missing = self.find(|what| match what {
            Injection::Missing(u, n) if *u == unit => Some(*n),
            _ => None,
        });
        if missing.is_some_and(|n| !self.converters[unit].conversions.is_multiple_of(n)) {
            self.converters[unit].missed += 1;
            return;
        }
        if self.is(Injection::ReadsFail(unit)) {
            self.converters[unit].failed_reads =
                self.converters[unit].failed_reads.saturating_add(2);
            let event = bus::Event::ReadFailed {
                unit: UnitIndex::ALL[unit],
                in_a_row: self.converters[unit].failed_reads,
            };
            let now = self.now();
            self.machine.bus_event(event, now, &mut self.asked);
            return self.carry_out();
        }
        self.sample(unit, code);
        if self.is(Injection::Extra(unit)) {
            self.sample(unit, code);
        }
    }

    /// Result of a conversion that ends now.
    fn code(&mut self, unit: usize) -> i32 {
        let swapped = self.find(|what| match what {
            Injection::Exchanged(a, b) if *a == unit => Some(*b),
            Injection::Exchanged(a, b) if *b == unit => Some(*a),
            _ => None,
        });
        let cell = swapped.unwrap_or(unit);
        let converter = &self.converters[cell];
        let size = converter.ring.len();
        let mean: f64 = (converter.kernel.iter().enumerate())
            .map(|(k, w)| w * converter.ring[(self.step as usize + size - k) % size])
            .sum();
        let parameters = self.plant.parameters(cell);
        let per_n = parameters.bridge_per_n;
        let zero = parameters.bridge_zero_v_per_v + parameters.assembly_weight_n * per_n;
        let mut bridge = mean;
        let mut newtons = 0.0;
        let mut noise = NOISE_CODES;
        let mut frozen = false;
        for active in &self.active {
            let seconds = (self.step - active.since) as f64 * STEP_US as f64 * 1e-6;
            match active.what {
                Injection::OpenBridge(u) if u == cell => bridge = 0.0,
                Injection::WrongSign(u) if u == cell => bridge = -bridge,
                Injection::Sensitivity(u, share) if u == cell => {
                    bridge = zero + (bridge - zero) * share;
                }
                Injection::Offset(u, n) if u == cell => newtons += n,
                Injection::Drift(u, n) if u == cell => newtons += n * seconds,
                Injection::Saturated(u, high) if u == cell => {
                    bridge = if high { 1.0 } else { -1.0 };
                }
                Injection::Spikes(u, n)
                    if u == cell && self.converters[cell].conversions.is_multiple_of(10) =>
                {
                    newtons += n;
                }
                Injection::Noise(u, n) if u == cell => noise += n * per_n * CODES_PER_BRIDGE,
                Injection::Frozen(u) if u == cell => frozen = true,
                _ => {}
            }
        }
        if frozen {
            return self.converters[unit].last_code;
        }
        let mut code = (bridge + newtons * per_n) * CODES_PER_BRIDGE + noise * self.random.normal();
        code = code.round().clamp(-8_388_608.0, 8_388_607.0);
        let code = self.code_bits(unit, code as i32);
        self.converters[unit].last_code = code;
        code
    }

    /// What bits on the bus make of a code.
    fn code_bits(&mut self, unit: usize, code: i32) -> i32 {
        let mut bits = code as u32;
        if let Some(bit) = self.take(|what| match what {
            Injection::CodeBit(u, bit, _) if *u == unit => Some(*bit),
            _ => None,
        }) {
            bits ^= 1 << bit;
        }
        if let Some((bit, set)) = self.find(|what| match what {
            Injection::CodeBitStuck(u, bit, set) if *u == unit => Some((*bit, *set)),
            _ => None,
        }) {
            bits = if set {
                bits | 1 << bit
            } else {
                bits & !(1 << bit)
            };
        }
        // 24 bits, sign extended.
        ((bits << 8) as i32) >> 8
    }

    fn counts(&self, unit: usize) -> i64 {
        if let Some(frozen) = self.encoder_frozen[unit] {
            return frozen;
        }
        let counts = self.plant.encoder_counts(unit);
        self.encoder_turned[unit].map_or(counts, |turned| turned - counts)
            + self.encoder_offset[unit]
    }

    fn sample(&mut self, unit: usize, code: i32) {
        let missed = std::mem::take(&mut self.converters[unit].missed);
        let counts = EncoderCounts(self.counts(unit));
        let now = self.now();
        let (word, mut pending) = self.machine.sample(
            UnitIndex::ALL[unit],
            AdcCode::new(code),
            counts,
            now,
            missed,
            &mut self.asked,
        );
        self.write(unit, word.0);
        self.machine.check(&mut pending, &mut self.asked);
        self.carry_out();
    }

    // --- Outputs -------------------------------------------------------------------------------

    fn dac_is_stuck(&self, unit: usize) -> bool {
        self.is(Injection::DacStuck(unit)) || self.is(Injection::DacLink)
    }

    /// Queues a word for a unit's DAC.
    fn write(&mut self, unit: usize, word: u16) {
        self.outputs[unit].last = word;
        self.send(unit, word);
    }

    /// A word on its way to a unit's DAC.
    fn send(&mut self, unit: usize, word: u16) {
        let mut word = word;
        if let Some(bit) = self.take(|what| match what {
            Injection::DacBit(u, bit, _) if *u == unit => Some(*bit),
            _ => None,
        }) {
            word ^= 1 << bit;
        }
        let selected = self.find(|what| match what {
            Injection::DacSelect(a, b) if *a == unit => Some(*b),
            _ => None,
        });
        let due = self.step + LATENCY_STEPS;
        self.outputs[selected.unwrap_or(unit)]
            .words
            .push_back((due, word));
    }

    fn move_outputs(&mut self) {
        for unit in 0..UNITS {
            let stuck = self.dac_is_stuck(unit);
            let output = &mut self.outputs[unit];
            while let Some((_, word)) = output.words.pop_front_if(|(due, _)| *due <= self.step) {
                if !stuck {
                    output.code = word;
                }
            }
            let mut volts = (f64::from(output.code) - 32_768.0) * VOLTS_PER_CODE;
            for active in &self.active {
                match active.what {
                    Injection::AmplifierOff(u) if u == unit => volts = 0.0,
                    Injection::AmplifierGain(u, share) if u == unit => volts *= share,
                    Injection::Reversed(u) if u == unit => volts = -volts,
                    _ => {}
                }
            }
            self.plant
                .set_amplifier_volts(unit, volts)
                .expect("six units, finite volts");
        }
    }

    /// Carries out what the machine asked for.
    fn carry_out(&mut self) {
        for unit in std::mem::take(&mut self.asked.zero) {
            self.write(unit as usize, DacCode::ZERO_VOLT.0);
        }
        for unit in std::mem::take(&mut self.asked.stop) {
            self.converters[unit as usize].streams = false;
            self.converters[unit as usize].up_at = None;
        }
        for unit in std::mem::take(&mut self.asked.start) {
            self.converters[unit as usize].up_at = Some(self.step + BRING_UP_STEPS);
        }
        self.asked.reports.clear();
    }

    // --- The superloop's millisecond, and the PLC -----------------------------------------------

    fn tick(&mut self) {
        if let Some(since) = self.hung_since {
            if self.step - since > WATCHDOG_STEPS {
                self.reset(Some(Fault::WatchdogReset));
            }
        } else {
            self.supervise();
        }
        if self.hung_since.is_none() && !self.machine.withholds_alive() {
            self.last_alive = self.step;
        }
        self.power = self.estop_closed && self.step - self.last_alive <= PLC_STEPS;
        self.plant.set_amplifier_power(self.power);
    }

    fn supervise(&mut self) {
        let now = self.now();
        // Every word is sent again each millisecond, behind new ones.
        for unit in 0..UNITS {
            if self.outputs[unit].words.is_empty() {
                let word = self.outputs[unit].last;
                self.send(unit, word);
            }
        }
        for unit in 0..UNITS {
            if self.converters[unit]
                .up_at
                .is_some_and(|at| at <= self.step)
            {
                self.converters[unit].up_at = None;
                self.converters[unit].streams = true;
                let event = bus::Event::Up {
                    unit: UnitIndex::ALL[unit],
                };
                self.machine.bus_event(event, now, &mut self.asked);
            }
            let noise = self.find(|what| match what {
                Injection::EncoderNoise(u, n) if *u == unit => Some(u64::from(*n)),
                _ => None,
            });
            if noise.is_some_and(|n| (self.step / 20).is_multiple_of(1_000 / n)) {
                self.machine
                    .encoder_noise(UnitIndex::ALL[unit], 0x10, now, &mut self.asked);
            }
        }
        self.bus_reports(now);
        for unit in self.machine.wants_encoders().iter() {
            let counts = EncoderCounts(self.counts(unit as usize));
            self.machine.encoder(unit, counts);
        }
        let overrun = self.find(|what| match what {
            Injection::Overrun(us) => Some(*us),
            _ => None,
        });
        let health = Health {
            estop_closed: self.estop_closed,
            estop_opened_at: now,
            longest_pass_us: overrun.unwrap_or(30),
            events_lost: self.events_lost,
            dac_error: self.is(Injection::DacLink).then_some(0x1002),
            register_changed: self.is(Injection::RegisterChanged).then_some(0x4001_300C),
        };
        self.machine.tick(now, health, &mut self.asked);
        self.carry_out();
    }

    /// What the bus scheduler reports of a bus that is held, or of a silent multiplexer, 5 ms later.
    fn bus_reports(&mut self, now: Micros) {
        let due = |active: &Active| (100..120).contains(&(self.step - active.since));
        let event = self
            .active
            .iter()
            .filter(|active| due(active))
            .find_map(|active| match active.what {
                Injection::BusHeld => Some(bus::Event::Stuck {
                    rounds: bus::STUCK_AFTER,
                    sda_low: true,
                }),
                Injection::MuxSilent => Some(bus::Event::MuxSilent { mask: 1 }),
                _ => None,
            });
        if let Some(event) = event {
            self.machine.bus_event(event, now, &mut self.asked);
        }
    }

    // --- The host ------------------------------------------------------------------------------

    fn host(&mut self) {
        if self.is(Injection::StatusElsewhere) {
            for command in [
                Command::Hello {
                    abi: ABI_VERSION,
                    schema: SCHEMA_HASH,
                },
                Command::GetStatus,
                Command::Disarm,
            ] {
                self.execute(1, &HostFrame { seq: 1, command });
            }
        }
        let Some(hold_n) = self.hold_n else {
            return;
        };
        let command = self.setpoints(hold_n);
        self.seq = self.seq.wrapping_add(1);
        let frame = HostFrame {
            seq: self.seq,
            command,
        };
        let mut room = [0; MAX_FRAME];
        let length = encode(&frame, &mut room).expect("fits");
        let bytes = self.on_the_line(room[..length].to_vec());
        for byte in bytes {
            if let Ok(Some(frame)) = self.decoder.push::<HostFrame>(byte) {
                if self.hung_since.is_none() {
                    self.execute(0, &frame);
                }
            }
        }
    }

    fn setpoints(&self, hold_n: [f64; UNITS]) -> Command {
        let t_s = self.step as f64 * STEP_US as f64 * 1e-6;
        let offset = self.find(|what| match what {
            Injection::SetpointOffset(n) => Some(*n),
            _ => None,
        });
        let tip = self.plant.tip_position_m().into();
        let units = std::array::from_fn(|unit| {
            let parameters = self.plant.parameters(unit);
            let direction = cable_direction(parameters.position_m.into(), tip);
            let axis: nalgebra::Vector3<f64> = parameters.axis.into();
            let cos = direction.and_then(|direction| cos_cell_angle(direction, -axis));
            let factor = self.find(|what| match what {
                Injection::WrongCosine(u, factor) if *u == unit => Some(*factor),
                _ => None,
            });
            let inv_cos = cos.and_then(inv_cos_q16).unwrap_or(65_536);
            let out_of_range = self.find(|what| match what {
                Injection::SetpointRange(u, value) if *u == unit => Some(*value),
                _ => None,
            });
            let wave = 0.6 * (6.0 * t_s + unit as f64).sin();
            let tension_n = hold_n[unit] + wave + offset.unwrap_or(0.0);
            UnitSetpoint {
                tension_un: out_of_range.unwrap_or((tension_n.max(0.0) * 1e6) as i32),
                inv_cos_q16: (f64::from(inv_cos) * factor.unwrap_or(1.0)) as i32,
                direction_q14: if self.is(Injection::WrongDirections) {
                    [0, 0, wire::message::DIRECTION_ONE]
                } else {
                    direction.map_or([0; 3], |d| direction_q14(&d))
                },
            }
        });
        Command::Setpoints {
            valid_ms: VALID_MS,
            units,
        }
    }

    /// What arrives of a frame.
    fn on_the_line(&mut self, mut frame: Vec<u8>) -> Vec<u8> {
        self.old_frames.push_back(frame.clone());
        if self.old_frames.len() > 50 {
            self.old_frames.pop_front();
        }
        if let Some(bit) = self.take(|what| match what {
            Injection::FrameBit(bit, _) => Some(*bit as usize),
            _ => None,
        }) {
            let bit = bit % (8 * frame.len());
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        if self
            .take(|what| matches!(what, Injection::FrameCut(_)).then_some(()))
            .is_some()
        {
            frame.truncate(frame.len() / 2);
        }
        if self
            .take(|what| matches!(what, Injection::Replay(_)).then_some(()))
            .is_some()
        {
            frame = self.old_frames.front().cloned().unwrap_or(frame);
        }
        if self
            .take(|what| matches!(what, Injection::Garbage(_)).then_some(()))
            .is_some()
        {
            let noise = (0..20).map(|_| self.random.bits() as u8).collect();
            frame = [noise, frame].concat();
        }
        frame
    }
}
