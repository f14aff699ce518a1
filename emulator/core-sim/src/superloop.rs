//! The superloop of the image on the host: samples to the machine, the supervisor's millisecond,
//! commands and telemetry.

use crate::defects::Defects;
use crate::line::{Line, USART};
use crate::sensors::{micros, Sensors};
use crate::timing::{SAMPLE_TO_DAC_NS, TICK_NS, WATCHDOG_NS};
use board::bus::Event;
use board::clocks;
use board::machine::{Effects, Health, LoopFigures, Machine};
use board::telemetry::Outstanding;
use control::{AdcCode, DacCode, EncoderCounts, Fault, Micros, UnitIndex, UnitSet, UNITS};
use emulator::board::Board;
use emulator_link::DacResetPull;
use wire::message::{BoardInfo, CrashRecord, FaultReport, Pull, Response, Status};
use wire::{BoardMessage, HostFrame, ABI_VERSION, SCHEMA_HASH};

/// Period of the status frames in milliseconds, as in the firmware.
const STATUS_MS: u32 = 50;
/// FLAG of a counter that reports noise at its encoder.
const NOISE_FLAG: u8 = 0x10;

/// Effects of the machine, until the superloop executes them.
#[derive(Debug, Clone, Default)]
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
#[derive(Debug, Clone)]
pub(crate) struct Superloop {
    machine: Machine,
    requests: Requests,
    counts: [EncoderCounts; UNITS],
    outstanding: Outstanding,
    /// DAC words on their way to the outputs.
    words: [Option<(u64, DacCode)>; UNITS],
    /// Words that the DACs got last; each is sent again with every millisecond.
    sent: [DacCode; UNITS],
    dacs_held: bool,
    /// How long the superloop has been hanging.
    hung_ns: u64,
    status_ms: u32,
    alive: bool,
    estop_closed: bool,
    estop_opened_at: Micros,
    /// The serial line.
    pub line: Line,
    /// What is broken.
    pub defects: Defects,
}

impl Superloop {
    /// A controller that comes out of a reset on this board, with what the one before left behind.
    pub fn new(board: &Board, crash_record: Option<CrashRecord>) -> Self {
        Self {
            machine: Machine::new(BoardInfo {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
                version: env!("CARGO_PKG_VERSION").try_into().unwrap_or_default(),
                core_hz: clocks::CORE_HZ,
                silicon: 0x2003,
                hse: !board.is_clock_lost(),
                reset_flags: 0,
                // BOR_LEV is bits 2 and 3.
                option_bytes: u32::from(board.brown_out_level()) << 2,
                unique_id: board.unique_id(),
                dac_reset_pull: match board.dac_reset_pull() {
                    DacResetPull::Down => Pull::Down,
                    DacResetPull::None => Pull::None,
                    DacResetPull::Up => Pull::Up,
                },
                crash_record,
            }),
            requests: Requests::default(),
            counts: [EncoderCounts::default(); UNITS],
            outstanding: Outstanding::default(),
            words: [None; UNITS],
            sent: [DacCode::ZERO_VOLT; UNITS],
            dacs_held: false,
            hung_ns: 0,
            status_ms: 0,
            alive: false,
            estop_closed: true,
            estop_opened_at: Micros(0),
            line: Line::default(),
            defects: Defects::default(),
        }
    }

    /// When the next DAC word reaches its output, or a byte of the host the board.
    pub fn due(&self) -> Option<u64> {
        (self.words.iter().flatten().map(|(at, _)| *at))
            .chain(self.line.due().filter(|_| !self.defects.hung))
            .min()
    }

    /// The board's status.
    pub fn status(&self, t_ns: u64) -> Status {
        self.machine
            .status(micros(t_ns), LoopFigures::default(), self.line.counters())
    }

    /// Flips a bit of a unit's configuration in memory.
    #[cfg(feature = "injection")]
    pub fn flip_config(&mut self, unit: usize, bit: u32) {
        self.machine.flip_config(UnitIndex::ALL[unit], bit);
    }

    /// Executes a command that came over a link.
    pub fn command(
        &mut self,
        board: &mut Board,
        sensors: &mut Sensors,
        t_ns: u64,
        link: usize,
        frame: &HostFrame,
    ) -> Option<Response> {
        let response = self.machine.command(
            link,
            frame,
            micros(t_ns),
            LoopFigures::default(),
            self.line.counters(),
            &mut self.requests,
        );
        self.execute(board, sensors, t_ns);
        response
    }

    /// Takes the events of the bus.
    pub fn events(&mut self, board: &mut Board, sensors: &mut Sensors, t_ns: u64) {
        if sensors.events.0.is_empty() || self.defects.hung {
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
                } => {
                    let slot = unit as usize;
                    let bits = self.defects.codes[slot].pass(code.counts() as u32);
                    // 24 bits, sign extended.
                    let code = AdcCode::new(((bits << 8) as i32) >> 8);
                    for missed in [missed, 0]
                        .into_iter()
                        .take(1 + usize::from(self.defects.twice[slot]))
                    {
                        self.sample(unit, code, at, missed, t_ns);
                    }
                }
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
                self.output(board, t_ns, unit as usize, word);
                if let Some((edge, sample)) = self.outstanding.complete(unit, micros(t_ns)) {
                    self.stream(t_ns, edge, sample);
                }
            }
        }
        while !self.defects.hung && self.line.due().is_some_and(|at| at <= t_ns) {
            if let Some(frame) = self.line.receive(t_ns) {
                if let Some(response) = self.command(board, sensors, t_ns, USART, &frame) {
                    self.line.reply(t_ns, frame.seq, response);
                }
            }
        }
    }

    /// A word reaches the DAC of a unit, or what a defect makes of both.
    fn output(&mut self, board: &mut Board, t_ns: u64, unit: usize, word: DacCode) {
        self.sent[unit] = word;
        let word = self.defects.words[unit].pass(word.0.into()) as u16;
        board.dac_code(t_ns, self.defects.dac_of[unit].unwrap_or(unit), word);
    }

    /// The DACs' millisecond: words that wait behind no new one are sent again, whatever the
    /// superloop does.
    fn outputs_again(&mut self, board: &mut Board, t_ns: u64) {
        for unit in 0..UNITS {
            if self.words[unit].is_none() {
                self.output(board, t_ns, unit, self.sent[unit]);
            }
        }
    }

    /// A superloop that hangs sees nothing of its millisecond. `Some`: the watchdog resets the
    /// controller now.
    fn hangs(&mut self) -> Option<CrashRecord> {
        self.hung_ns += TICK_NS;
        (self.hung_ns > WATCHDOG_NS).then(|| CrashRecord {
            code: Fault::WatchdogReset.code(),
            detail: 0,
            pc: 0,
            text: Default::default(),
        })
    }

    /// The supervisor's millisecond. `Some`: the watchdog resets the controller, with this record.
    pub fn tick(
        &mut self,
        board: &mut Board,
        sensors: &mut Sensors,
        t_ns: u64,
    ) -> Option<CrashRecord> {
        self.outputs_again(board, t_ns);
        if self.defects.hung {
            return self.hangs();
        }
        let closed = board.estop_closed();
        if self.estop_closed && !closed {
            self.estop_opened_at = micros(t_ns);
        }
        self.estop_closed = closed;
        let health = Health {
            estop_closed: closed,
            estop_opened_at: self.estop_opened_at,
            ..self.defects.health
        };
        let now = micros(t_ns);
        for unit in self.machine.wants_encoders().iter() {
            let counts = EncoderCounts(board.encoder_position(t_ns, unit as usize));
            self.machine.encoder(unit, counts);
        }
        self.machine.tick(now, health, &mut self.requests);
        let unit = UnitIndex::ALL[(t_ns / TICK_NS) as usize % UNITS];
        let counts = EncoderCounts(board.encoder_position(t_ns, unit as usize));
        self.machine.position(unit, counts);
        self.encoder_noise(t_ns);
        self.execute(board, sensors, t_ns);
        if self.machine.holds_dacs() != self.dacs_held {
            self.dacs_held = !self.dacs_held;
            board.hold_dacs(t_ns, self.dacs_held);
        }
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
            let status = self.status(t_ns);
            self.line.send(t_ns, BoardMessage::Status(status));
        }
        if let Some(batch) = self.line.batcher.flush(now) {
            self.line.send(t_ns, BoardMessage::Samples(batch));
        }
        None
    }

    /// Noise that the counters report of their encoders.
    fn encoder_noise(&mut self, t_ns: u64) {
        for (unit, hz) in UnitIndex::zip(self.defects.encoder_noise_hz) {
            if hz > 0 && (t_ns / TICK_NS).is_multiple_of(1_000 / u64::from(hz)) {
                (self.machine).encoder_noise(unit, NOISE_FLAG, micros(t_ns), &mut self.requests);
            }
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
            self.output(board, t_ns, unit, DacCode::ZERO_VOLT);
        }
        stop.iter().for_each(|unit| sensors.request_stop(unit));
        start.iter().for_each(|unit| sensors.request_start(unit));
    }
}
