//! The superloop of the image on the host: samples to the machine, the supervisor's millisecond, commands and telemetry.

use crate::line::{Line, USART};
use crate::sensors::{micros, Sensors};
use crate::timing::SAMPLE_TO_DAC_NS;
use board::bus::Event;
use board::clocks;
use board::machine::{Effects, Health, LoopFigures, Machine};
use board::telemetry::Outstanding;
use control::{AdcCode, DacCode, EncoderCounts, Micros, UnitIndex, UnitSet, UNITS};
use emulator::board::Board;
use wire::message::{BoardInfo, FaultReport};
use wire::{BoardMessage, ABI_VERSION, SCHEMA_HASH};

/// Period of the status frames in milliseconds, as in the firmware.
const STATUS_MS: u32 = 50;

/// Effects of the machine, until the superloop executes them.
#[derive(Debug, Default)]
struct Requests {
    start: UnitSet,
    stop: UnitSet,
    zero: UnitSet,
    reports: Vec<FaultReport>,
}

impl Effects for Requests {
    fn start_sensor(&mut self, unit: UnitIndex) {
        self.stop.remove(unit);
        self.start.insert(unit);
    }

    fn stop_sensor(&mut self, unit: UnitIndex) {
        self.start.remove(unit);
        self.stop.insert(unit);
    }

    fn zero_output(&mut self, unit: UnitIndex) {
        self.zero.insert(unit);
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
                silicon: 0x2003,
                hse: true,
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
                    let unit = unit as usize;
                    self.counts[unit] = EncoderCounts(board.encoder_position(t_ns, unit));
                }
                Event::Sample {
                    unit,
                    code,
                    at,
                    missed,
                } => self.sample(unit, AdcCode::new(code.counts()), at, missed, t_ns),
                other => {
                    (self.machine).bus_event(other, micros(t_ns), &mut self.requests);
                }
            }
        }
        // The same memory again.
        sensors.events.0 = events;
        self.execute(board, sensors, t_ns);
    }

    fn sample(&mut self, unit: UnitIndex, code: AdcCode, at: Micros, missed: u8, t_ns: u64) {
        let counts = self.counts[unit as usize];
        let (word, mut pending) =
            (self.machine).sample(unit, code, counts, at, missed, &mut self.requests);
        let done = t_ns + SAMPLE_TO_DAC_NS;
        self.words[unit as usize] = Some((done, word));
        self.machine.check(&mut pending, &mut self.requests);
        if let Some((at, late)) = self.outstanding.insert(unit, at, pending.describe()) {
            self.stream(t_ns, at, late);
        }
    }

    fn stream(&mut self, t_ns: u64, at: Micros, sample: wire::message::Sample) {
        let decimation = self.machine.decimation(USART);
        if let Some(batch) = self.line.batcher.push(at, sample, decimation) {
            self.line.send(t_ns, BoardMessage::Samples(batch));
        }
    }

    /// DAC words and bytes of the host that are due at `t_ns`.
    pub fn advance(&mut self, board: &mut Board, sensors: &mut Sensors, t_ns: u64) {
        for unit in UnitIndex::ALL {
            let waiting = &mut self.words[unit as usize];
            if let Some((_, word)) = waiting.take_if(|(at, _)| *at <= t_ns) {
                board.dac_code(t_ns, unit as usize, word.0);
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
                    micros(t_ns),
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
            self.estop_opened_at = micros(t_ns);
        }
        self.estop_closed = closed;
        let health = Health {
            estop_closed: closed,
            estop_opened_at: self.estop_opened_at,
            ..Health::default()
        };
        let now = micros(t_ns);
        for unit in self.machine.wants_encoders().iter() {
            let counts = EncoderCounts(board.encoder_position(t_ns, unit as usize));
            self.machine.encoder(unit, counts);
        }
        self.machine.tick(now, health, &mut self.requests);
        self.execute(board, sensors, t_ns);
        if !self.machine.withholds_alive() {
            self.alive = !self.alive;
            board.alive_edge(t_ns);
        }

        for report in std::mem::take(&mut self.requests.reports) {
            self.line.send(t_ns, BoardMessage::Fault(report));
        }
        self.status_ms += 1;
        if self.status_ms >= STATUS_MS {
            self.status_ms = 0;
            let figures = LoopFigures::default();
            let status = self.machine.status(now, figures, self.line.counters());
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
        for unit in zero.iter().map(|unit| unit as usize) {
            // A word that is on its way comes before the zero on the part, too.
            if let Some(word) = &mut self.words[unit] {
                word.1 = DacCode::ZERO_VOLT;
            }
            board.dac_code(t_ns, unit, DacCode::ZERO_VOLT.0);
        }
        stop.iter().for_each(|unit| sensors.request_stop(unit));
        start.iter().for_each(|unit| sensors.request_start(unit));
    }
}
