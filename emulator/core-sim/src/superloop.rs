//! The superloop of the image on the host: samples to the machine, the supervisor's millisecond, commands and telemetry.

use crate::line::{Line, USART};
use crate::sensors::{micros, Sensors};
use crate::timing::SAMPLE_TO_DAC_NS;
use board::bus::Event;
use board::clocks;
use board::machine::{Effects, Health, LoopFigures, Machine};
use board::telemetry::Outstanding;
use control::{AdcCode, DacCode, EncoderCounts, Micros};
use emulator::board::Board;
use wire::message::{BoardInfo, FaultReport};
use wire::{BoardMessage, ABI_VERSION, SCHEMA_HASH, UNITS};

/// Period of the status frames in milliseconds, as in the firmware.
const STATUS_MS: u32 = 50;

/// Effects of the machine, until the superloop executes them.
#[derive(Debug, Default)]
struct Requests {
    start: u8,
    stop: u8,
    zero: u8,
    reports: Vec<FaultReport>,
}

impl Effects for Requests {
    fn start_sensor(&mut self, unit: u8) {
        self.stop &= !(1 << unit);
        self.start |= 1 << unit;
    }

    fn stop_sensor(&mut self, unit: u8) {
        self.start &= !(1 << unit);
        self.stop |= 1 << unit;
    }

    fn zero_output(&mut self, unit: u8) {
        self.zero |= 1 << unit;
    }

    fn report(&mut self, report: FaultReport) {
        self.reports.push(report);
    }
}

/// See the module's page.
#[derive(Debug)]
pub(crate) struct Superloop {
    machine: Machine,
    requests: Requests,
    counts: [EncoderCounts; UNITS],
    outstanding: Outstanding,
    /// DAC words on their way to the outputs.
    words: [Option<(u64, DacCode)>; UNITS],
    status_ms: u32,
    alive: bool,
    estop_closed: bool,
    estop_opened_at: Micros,
    /// The serial line.
    pub line: Line,
}

impl Superloop {
    pub fn new() -> Self {
        Self {
            machine: Machine::new(BoardInfo {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
                version: env!("CARGO_PKG_VERSION").try_into().unwrap_or_default(),
                core_hz: clocks::CORE_HZ,
                reset_flags: 0,
                crash_record: None,
            }),
            requests: Requests::default(),
            counts: [EncoderCounts::default(); UNITS],
            outstanding: Outstanding::default(),
            words: [None; UNITS],
            status_ms: 0,
            alive: false,
            estop_closed: true,
            estop_opened_at: Micros(0),
            line: Line::default(),
        }
    }

    /// When the next DAC word reaches its output, or a byte of the host the board.
    pub fn due(&self) -> Option<u64> {
        (self.words.iter().flatten().map(|(at, _)| *at))
            .chain(self.line.due())
            .min()
    }

    /// Takes the events of the bus.
    pub fn events(&mut self, board: &mut Board, sensors: &mut Sensors, t_ns: u64) {
        if sensors.events.0.is_empty() {
            return;
        }
        let mut events = std::mem::take(&mut sensors.events.0);
        for event in events.drain(..) {
            match event {
                Event::Edge { unit } => {
                    let unit = usize::from(unit);
                    self.counts[unit] = EncoderCounts(board.encoder_position(t_ns, unit));
                }
                Event::Sample {
                    unit,
                    code,
                    at,
                    missed,
                } => self.sample(unit, AdcCode::new(code.counts()), at, missed, t_ns),
                other => {
                    let now = Micros(micros(t_ns));
                    self.machine.bus_event(other, now, &mut self.requests);
                }
            }
        }
        // The same memory again.
        sensors.events.0 = events;
        self.execute(board, sensors, t_ns);
    }

    fn sample(&mut self, unit: u8, code: AdcCode, at: u32, missed: u8, t_ns: u64) {
        let counts = self.counts[usize::from(unit)];
        let (word, pending) =
            self.machine
                .sample(unit, code, counts, Micros(at), missed, &mut self.requests);
        let done = t_ns + SAMPLE_TO_DAC_NS;
        self.words[usize::from(unit)] = Some((done, word));
        if let Some((at, late)) = self.outstanding.insert(at, pending.describe()) {
            self.stream(t_ns, at, late);
        }
    }

    fn stream(&mut self, t_ns: u64, at: u32, sample: wire::message::Sample) {
        let decimation = self.machine.decimation(USART);
        if let Some(batch) = self.line.batcher.push(at, sample, decimation) {
            self.line.send(t_ns, BoardMessage::Samples(batch));
        }
    }

    /// DAC words and bytes of the host that are due at `t_ns`.
    pub fn advance(&mut self, board: &mut Board, sensors: &mut Sensors, t_ns: u64) {
        for unit in 0..UNITS {
            if let Some((_, word)) = self.words[unit].filter(|(at, _)| *at <= t_ns) {
                self.words[unit] = None;
                board.dac_code(t_ns, unit, word.0);
                if let Some((edge, sample)) = self.outstanding.complete(unit, micros(t_ns)) {
                    self.stream(t_ns, edge, sample);
                }
            }
        }
        while self.line.due().is_some_and(|at| at <= t_ns) {
            if let Some(frame) = self.line.receive(t_ns) {
                let response = self.machine.command(
                    USART,
                    &frame,
                    Micros(micros(t_ns)),
                    LoopFigures::default(),
                    self.line.counters(),
                    &mut self.requests,
                );
                if let Some(response) = response {
                    self.line.reply(t_ns, frame.seq, response);
                }
                self.execute(board, sensors, t_ns);
            }
        }
    }

    /// The supervisor's millisecond.
    pub fn tick(&mut self, board: &mut Board, sensors: &mut Sensors, t_ns: u64) {
        let closed = board.estop_closed();
        if self.estop_closed && !closed {
            self.estop_opened_at = Micros(micros(t_ns));
        }
        self.estop_closed = closed;
        let health = Health {
            estop_closed: closed,
            estop_opened_at: self.estop_opened_at,
            ..Health::default()
        };
        let now = micros(t_ns);
        self.machine.tick(Micros(now), health, &mut self.requests);
        self.execute(board, sensors, t_ns);
        self.alive = !self.alive;
        board.alive_edge(t_ns);

        for report in std::mem::take(&mut self.requests.reports) {
            self.line.send(t_ns, BoardMessage::Fault(report));
        }
        self.status_ms += 1;
        if self.status_ms >= STATUS_MS {
            self.status_ms = 0;
            let figures = LoopFigures::default();
            let status = self
                .machine
                .status(Micros(now), figures, self.line.counters());
            self.line.send(t_ns, BoardMessage::Status(status));
        }
        if let Some(batch) = self.line.batcher.flush(now) {
            self.line.send(t_ns, BoardMessage::Samples(batch));
        }
    }

    /// Executes what the machine has requested; outputs to 0 V come first.
    fn execute(&mut self, board: &mut Board, sensors: &mut Sensors, t_ns: u64) {
        let (zero, start, stop) = (
            std::mem::take(&mut self.requests.zero),
            std::mem::take(&mut self.requests.start),
            std::mem::take(&mut self.requests.stop),
        );
        for unit in 0..UNITS as u8 {
            let bit = 1 << unit;
            if zero & bit != 0 {
                // A word that is on its way comes before the zero on the part, too.
                if let Some(word) = &mut self.words[usize::from(unit)] {
                    word.1 = DacCode::ZERO_VOLT;
                }
                board.dac_code(t_ns, usize::from(unit), DacCode::ZERO_VOLT.0);
            }
            if stop & bit != 0 {
                sensors.request_stop(unit);
            }
            if start & bit != 0 {
                sensors.request_start(unit);
            }
        }
    }
}
