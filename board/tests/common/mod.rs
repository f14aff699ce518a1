//! A machine with a board and load cells around it, for the tests of the machine.
#![allow(dead_code)] // each user takes a part

use board::bus;
use board::machine::{Effects, Health, LinkCounters, LoopFigures, Machine};
use control::{AdcCode, Config, DacCode, EncoderCounts, Micros, SystemState, UnitIndex};
use wire::message::{
    BoardInfo, CrashRecord, FaultReport, Response, Sample, Status, UnitSetpoint, DIRECTION_ONE,
};
use wire::{Command, HostFrame, ABI_VERSION, SCHEMA_HASH, UNITS};

/// Three pairs of opposite cables.
pub const BALANCED: [[i16; 3]; UNITS] = [
    [DIRECTION_ONE, 0, 0],
    [-DIRECTION_ONE, 0, 0],
    [0, DIRECTION_ONE, 0],
    [0, -DIRECTION_ONE, 0],
    [0, 0, DIRECTION_ONE],
    [0, 0, -DIRECTION_ONE],
];

#[derive(Default)]
pub struct Board {
    pub started: Vec<UnitIndex>,
    pub stopped: Vec<UnitIndex>,
    pub zeroed: Vec<UnitIndex>,
    pub reports: Vec<FaultReport>,
}

impl Effects for Board {
    fn start_sensor(&mut self, unit: UnitIndex) {
        self.started.push(unit);
    }
    fn stop_sensor(&mut self, unit: UnitIndex) {
        self.stopped.push(unit);
    }
    fn zero_output(&mut self, unit: UnitIndex) {
        self.zeroed.push(unit);
    }
    fn report(&mut self, report: FaultReport) {
        self.reports.push(report);
    }
}

pub fn info(crash_record: Option<CrashRecord>) -> BoardInfo {
    BoardInfo {
        abi: ABI_VERSION,
        schema: SCHEMA_HASH,
        version: "0".try_into().unwrap(),
        core_hz: 400_000_000,
        silicon: 0x2003,
        hse: true,
        reset_flags: 0,
        option_bytes: 0,
        unique_id: [0; 3],
        dac_reset_pull: wire::message::Pull::Down,
        crash_record,
    }
}

/// A machine, a board around it, and a clock.
pub struct Bench {
    pub machine: Machine,
    pub board: Board,
    pub now: Micros,
    pub estop_closed: bool,
    /// SPI1_SR of a DAC word that did not complete.
    pub dac_error: Option<u32>,
    pub streaming: [bool; UNITS],
    /// Converters whose bring-up does not end.
    pub held_back: [bool; UNITS],
    /// Newton on each load cell; `None`: what the command makes of a drive without friction.
    pub load_n: Option<f64>,
    /// Newton on single cells, in place of that.
    pub cell_n: [Option<f64>; UNITS],
    /// Codes have noise.
    pub noise: bool,
    /// Directions of the cables at the tip.
    pub directions: [[i16; 3]; UNITS],
    pub last: [DacCode; UNITS],
    /// Encoder position of each unit's last sample.
    pub encoder: [i64; UNITS],
    /// Encoder counts that a reel has wound in besides what its command makes of the cable.
    pub wound: [i64; UNITS],
    /// Outputs that keep what they have.
    pub stuck: [bool; UNITS],
}

impl Bench {
    pub fn new(crash_record: Option<CrashRecord>) -> Self {
        Self {
            machine: Machine::new(info(crash_record)),
            board: Board::default(),
            now: Micros(0xFFF0_0000),
            estop_closed: true,
            dac_error: None,
            streaming: [false; UNITS],
            held_back: [false; UNITS],
            load_n: None,
            cell_n: [None; UNITS],
            noise: true,
            directions: BALANCED,
            last: [DacCode::ZERO_VOLT; UNITS],
            encoder: [0; UNITS],
            wound: [0; UNITS],
            stuck: [false; UNITS],
        }
    }

    pub fn ask(&mut self, link: usize, command: Command) -> Option<Response> {
        let frame = HostFrame { seq: 7, command };
        let (figures, counters) = (LoopFigures::default(), LinkCounters::default());
        self.machine
            .command(link, &frame, self.now, figures, counters, &mut self.board)
    }

    pub fn done(&mut self, command: Command) {
        assert_eq!(
            self.ask(0, command.clone()),
            Some(Response::Done),
            "{command:?}"
        );
    }

    pub fn hello(&mut self, link: usize) -> Option<Response> {
        self.ask(
            link,
            Command::Hello {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
            },
        )
    }

    /// Milliseconds with a tick each; a sample of each streaming unit every third, and what was to
    /// be brought up comes up.
    pub fn run(&mut self, ms: u32) {
        for _ in 0..ms {
            self.now.0 = self.now.0.wrapping_add(1_000);
            let health = Health {
                estop_closed: self.estop_closed,
                dac_error: self.dac_error,
                ..Health::default()
            };
            // Encoders of units that do not stream are the test's.
            let wanted = self.machine.wants_encoders().iter();
            for unit in wanted.filter(|unit| self.streaming[*unit as usize]) {
                let counts = EncoderCounts(self.counts(unit as usize));
                self.machine.encoder(unit, counts);
            }
            self.machine.tick(self.now, health, &mut self.board);
            for unit in core::mem::take(&mut self.board.started) {
                self.streaming[unit as usize] = false;
                if self.held_back[unit as usize] {
                    self.board.started.push(unit);
                    continue;
                }
                self.streaming[unit as usize] = true;
                self.machine
                    .bus_event(bus::Event::Up { unit }, self.now, &mut self.board);
            }
            for unit in 0..UNITS {
                if self.streaming[unit] && (self.now.0 / 1_000).is_multiple_of(3) {
                    self.sample(unit);
                }
            }
        }
    }

    /// Encoder position of a unit: a cable of 24 N/mm and 4,229 nm a count.
    fn counts(&self, unit: usize) -> i64 {
        (f64::from(self.last[unit].steps()) / 282.22 * 1.018 * 9.85) as i64 + self.wound[unit]
    }

    pub fn sample(&mut self, unit: usize) -> Sample {
        let driven_n = f64::from(self.last[unit].steps()) / 282.22 * 1.018;
        let load_n = self.cell_n[unit].or(self.load_n).unwrap_or(driven_n);
        let noise = if self.noise {
            (self.now.0 / 1_000 % 5) as i32 * 20
        } else {
            0
        };
        let code = AdcCode::new((load_n / 6.85e-6) as i32 + noise);
        self.encoder[unit] = self.counts(unit);
        let (dac, mut pending) = self.machine.sample(
            UnitIndex::ALL[unit],
            code,
            EncoderCounts(self.encoder[unit]),
            self.now,
            0,
            &mut self.board,
        );
        let before = self.last[unit];
        self.last[unit] = dac;
        let zeroed = self.board.zeroed.len();
        self.machine.check(&mut pending, &mut self.board);
        if self.board.zeroed[zeroed..].contains(&UnitIndex::ALL[unit]) {
            self.last[unit] = DacCode::ZERO_VOLT;
        }
        if self.stuck[unit] {
            self.last[unit] = before;
        }
        pending.describe()
    }

    pub fn status(&self) -> Status {
        self.machine
            .status(self.now, LoopFigures::default(), LinkCounters::default())
    }

    /// Configured, up, armed.
    pub fn armed() -> Self {
        let mut bench = Self::ready();
        bench.done(Command::Arm);
        bench.run(3);
        assert_eq!(bench.machine.system(), SystemState::Running);
        bench
    }

    pub fn ready() -> Self {
        Self::ready_with(Config::nominal())
    }

    /// With this configuration of each unit.
    pub fn ready_with(config: wire::message::UnitConfig) -> Self {
        let mut bench = Self::new(None);
        bench.run(5);
        bench.hello(0);
        for unit in 0..UNITS as u8 {
            bench.done(Command::StageConfig { unit, config });
        }
        bench.done(Command::CommitConfig);
        bench.run(50);
        assert_eq!(bench.machine.system(), SystemState::Ready);
        bench
    }

    pub fn setpoints(&mut self, tension_un: i32) -> Option<Response> {
        let units = core::array::from_fn(|unit| UnitSetpoint {
            tension_un,
            inv_cos_q16: 65_536,
            direction_q14: self.directions[unit],
            reel_um_per_s: None,
        });
        self.ask(
            0,
            Command::Setpoints {
                valid_ms: 100,
                units,
            },
        )
    }

    pub fn all_at_zero(&self) -> bool {
        self.last.iter().all(|dac| *dac == DacCode::ZERO_VOLT)
    }
}
