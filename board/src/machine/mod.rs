//! The command-level machine: six controllers, their state machines, faults, setpoints,
//! configuration and commands. Pure: samples, time and commands go in; DAC codes, responses and
//! [`Effects`] come out. The superloop owns the only instance.
//!
//! | file | concern |
//! | --- | --- |
//! | `mod.rs` | state of the units and of the board, both state machines, staged configurations |
//! | `sampling.rs` | one sample of one unit: ADC code in, DAC code and telemetry out |
//! | `supervision.rs` | the supervisor's millisecond, events of the bus, faults of the board and of a unit |
//! | `commands.rs` | commands of the host, and the status that answers them |
//!
//! The board has two links. Stop, GetStatus, GetConfig and GetBoard are accepted on both, at any
//! time. Every other command needs a Hello on its link, and makes that link the commander. While
//! the motors are driven, another link becomes the commander only once the present one has been
//! silent for [`COMMANDER_SILENT_US`]. So two programs cannot drive the motors in turn, and a look
//! at the status does not stop a run.

mod commands;
mod sampling;
mod supervision;

pub use sampling::PendingSample;

use control::faults::Latch;
use control::let_go::LetGo;
use control::motor;
use control::plausible::{milli, Watch, NEGATIVE};
use control::supervisor::{EncoderWatch, Expiry, Rate};
use control::system::{self, Denied, Request};
use control::tip::TipGuard;
use control::unit::{self, Setpoint};
use control::zero::{Averager, Refused};
use control::{
    AdcCode, Config, EncoderCounts, Fault, Micros, MotorState, SystemState, UnitIndex, UNITS,
};
use wire::frame::crc32;
use wire::message::{BoardConfig, BoardInfo, FaultReport, UnitConfig};

/// Links that the board has.
pub const LINKS: usize = 2;

/// Time after arming in which the first setpoints must have come, in milliseconds.
pub const FIRST_SETPOINT_MS: u16 = 1_000;

/// Time from the end of a bring-up to its first sample, in milliseconds: six conversions that
/// settle, six results that are discarded and the first sample are 42 ms with the slowest clock.
pub const FIRST_SAMPLE_MS: u32 = 100;

/// Failed reads of a converter in a row that make a fault.
pub const MAX_FAILED_READS: u8 = 4;

/// Time for which each enabled unit must be at rest before the amplifiers get their power, in
/// milliseconds: three samples.
pub const AT_REST_MS: u8 = 10;

/// Time after which a unit that is not at rest faults, in milliseconds: a cable that was tight when
/// the power went has let go by then, and its load cell has stopped ringing.
pub const UNREST_MS: u16 = 500;

/// Longest pass of the superloop in microseconds. A pass takes some tens of them; a sample may wait
/// for half a sample period at most.
pub const MAX_PASS_US: u32 = 1_500;

/// Silence of the commanding link after which another link may command while the motors are driven,
/// in microseconds: twenty periods of a host that sends setpoints.
pub const COMMANDER_SILENT_US: u32 = 200_000;

/// Actions of the machine on the board, apart from the DAC code that a sample returns.
pub trait Effects {
    /// Start the bring-up of this unit's converter.
    fn start_sensor(&mut self, unit: UnitIndex);
    /// Stop servicing this unit's converter.
    fn stop_sensor(&mut self, unit: UnitIndex);
    /// 0 V on this unit's motor now.
    fn zero_output(&mut self, unit: UnitIndex);
    /// Send a fault report on both links.
    fn report(&mut self, report: FaultReport);
}

/// Conditions that the supervisor checks every millisecond.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Health {
    /// The E-stop loop is closed.
    pub estop_closed: bool,
    /// Board time of the last opening of the loop.
    pub estop_opened_at: Micros,
    /// Longest pass of the superloop since the last millisecond, in microseconds.
    pub longest_pass_us: u32,
    /// Events dropped because the queue was full, since boot.
    pub events_lost: u32,
    /// SPI1_SR if a DAC word did not complete.
    pub dac_error: Option<u32>,
    /// Address of a register of the controller that does not have its value.
    pub register_changed: Option<u32>,
}

/// Counters of one link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkCounters {
    /// Frames dropped because its queue was full.
    pub dropped: u32,
    /// Frames from the host that were damaged or unknown.
    pub bad: u32,
}

/// Superloop figures for the status frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LoopFigures {
    /// Share of the last second that the core slept, in thousandths.
    pub sleep_permille: u16,
    /// Largest number of queued samples since the last status.
    pub queue_high_water: u8,
}

/// One force unit.
#[derive(Debug, Clone, Copy)]
struct Unit {
    config: Config,
    /// Start of the current window of encoder noise events, and their number.
    encoder_noise: (Micros, u8),
    encoder: EncoderWatch,
    plausible: Watch,
    let_go: LetGo,
    staged: Option<Config>,
    control: unit::State,
    motor: MotorState,
    latch: Latch,
    /// The unit was driven when it tripped by over-tension.
    tripped_driven: bool,
    rate: Rate,
    setpoint: Setpoint,
    /// The host has sent the configuration.
    configured: bool,
    /// The zero was measured, and the configuration has kept it.
    zeroed: bool,
    /// The converter has been brought up and its first sample is in.
    sensor_up: bool,
    /// End of the bring-up, until the first sample arrives.
    came_up: Option<Micros>,
    zero: Option<Averager>,
    /// The force last commanded is zero.
    at_zero: bool,
    samples: u32,
    missed: u32,
    spikes: u32,
    failed_reads: u16,
    /// The newest code.
    adc_code: AdcCode,
    /// The newest position.
    counts: EncoderCounts,
}

impl Unit {
    fn new() -> Self {
        Self {
            config: Config::default(),
            encoder_noise: (Micros(0), 0),
            encoder: EncoderWatch::default(),
            plausible: Watch::default(),
            let_go: LetGo::default(),
            staged: None,
            control: unit::State::default(),
            motor: MotorState::default(),
            latch: Latch::new(),
            tripped_driven: false,
            rate: Rate::default(),
            setpoint: Setpoint::default(),
            configured: false,
            zeroed: false,
            sensor_up: false,
            came_up: None,
            zero: None,
            at_zero: true,
            samples: 0,
            missed: 0,
            spikes: 0,
            failed_reads: 0,
            adc_code: AdcCode::default(),
            counts: EncoderCounts::default(),
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

    /// Whether the cable has not let go since its motor is at 0 V.
    fn holds_on(&self) -> bool {
        let tension = self.control.tension();
        self.sensor_up && self.let_go.holds(tension, self.config.let_go())
    }

    /// Whether the load cell reads what it may with the motor at 0 V: a slack cable, or one that
    /// friction of the reel holds. Before a zero is measured, what a zero may be. Otherwise the
    /// fault that it is.
    fn at_rest(&self) -> Result<(), (Fault, u32)> {
        let tension = self.control.tension();
        if self.zeroed {
            let let_go = self.config.let_go();
            let above = u32::from(tension >= let_go) << 31;
            return if (NEGATIVE..let_go).contains(&tension) {
                Ok(())
            } else {
                Err((Fault::Implausible, milli(tension) | above))
            };
        }
        let counts = self.config.from_stored_zero(tension);
        if counts.unsigned_abs() <= self.config.zero_deviation() {
            Ok(())
        } else {
            Err((Fault::ZeroRefused, Refused::FarOff(counts).detail()))
        }
    }
}

/// See the [module](self).
#[derive(Debug, Clone)]
pub struct Machine {
    units: [Unit; UNITS],
    system: SystemState,
    latch: Latch,
    expiry: Expiry,
    estop_closed: bool,
    estop_open_ms: u8,
    commit: bool,
    config_crc: u32,
    board_crc: u32,
    config_check_ms: u32,
    events_lost: u32,
    register_changed: bool,
    recoveries: u16,
    /// Links with an accepted Hello.
    open: [bool; LINKS],
    /// The link that commands, and when it did last.
    commander: Option<(usize, Micros)>,
    tip: TipGuard,
    /// The alive line may run. It may not after a start, nor once a converter is started anew or a
    /// fault has taken the power, until each enabled unit measures again and is at rest.
    released: bool,
    /// Milliseconds for which that has been so.
    at_rest_ms: u8,
    /// Milliseconds for which each enabled unit has measured, and one was not at rest.
    unrest_ms: u16,
    board: BoardConfig,
    staged_board: Option<BoardConfig>,
    decimation: [u8; LINKS],
    info: BoardInfo,
}

impl Machine {
    /// A machine with every unit off until it is configured. The crash record of the previous run
    /// is latched as a fault, so arming requires an explicit clear.
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
            board_crc: board_crc(&BoardConfig::default()),
            config_check_ms: 0,
            events_lost: 0,
            register_changed: false,
            recoveries: 0,
            open: [false; LINKS],
            commander: None,
            tip: TipGuard::new(BoardConfig::default().tip_force_limit_un),
            released: false,
            at_rest_ms: 0,
            unrest_ms: 0,
            board: BoardConfig::default(),
            staged_board: None,
            decimation: [0; LINKS],
            info,
        };
        machine.config_crc = machine.crc();
        machine
    }

    /// Flips a bit of what was computed from a unit's configuration, see
    /// [`control::config::Config::flip`]: a fault of the memory.
    #[cfg(feature = "injection")]
    pub fn flip_config(&mut self, unit: UnitIndex, bit: u32) {
        self.units[unit as usize].config.flip(bit);
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

    /// Whether the alive line is to stand still, so that the PLC removes the amplifiers' power: the
    /// DACs cannot be trusted to be at 0 V, or an enabled unit has not been seen at rest since the
    /// start or since its converter was started anew. A DAC that is stuck would pull, and no load
    /// cell would show it.
    #[must_use]
    pub fn withholds_alive(&self) -> bool {
        !self.released || self.has_lost_power()
    }

    /// Whether a fault is latched that takes the amplifiers' power, first or behind another.
    fn has_lost_power(&self) -> bool {
        let mut faults = Fault::ALL.iter();
        faults.any(|fault| fault.takes_power() && self.latch.has(*fault))
    }

    /// Whether the DACs' RST is to be low: a DAC that gets no words, as its select wire is broken,
    /// is at 0 V then all the same.
    #[must_use]
    pub const fn holds_dacs(&self) -> bool {
        self.latch.has(Fault::OutputStuck) || self.latch.has(Fault::DacLink)
    }

    /// Whether the bus may write register pointers ahead of the samples
    /// ([`BoardConfig::pointer_ahead`]).
    #[must_use]
    pub const fn pointer_ahead(&self) -> bool {
        self.board.pointer_ahead
    }

    /// Decimation of this link's telemetry: one sample of each unit in this many is sent; 0: none.
    #[must_use]
    pub fn decimation(&self, link: usize) -> u8 {
        self.decimation.get(link).copied().unwrap_or(0)
    }

    /// Runs both state machines once. Returns why the request was denied, if it was.
    fn advance(&mut self, request: Request, fx: &mut impl Effects) -> Option<Denied> {
        let mut enabled = self
            .units
            .iter()
            .filter(|unit| unit.config.enabled())
            .peekable();
        let any_enabled = enabled.peek().is_some();
        // Without power no unit can act.
        let all_ready = any_enabled && enabled.all(Unit::usable) && self.released;
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
        for (n, unit) in UnitIndex::zip(&mut self.units) {
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
                    // For half a second nothing is measured.
                    self.released = false;
                    unit.sensor_up = false;
                    unit.came_up = None;
                    unit.rate.reset();
                    unit.control.reset();
                    fx.start_sensor(n);
                }
                motor::Action::ResetController => {
                    unit.control.reset();
                    unit.plausible.reset();
                }
                motor::Action::ZeroOutput => fx.zero_output(n),
            }
            if !self.system.drives() {
                unit.at_zero = true;
            }
        }
        transition.denied
    }

    /// Puts the staged configurations in force, between two samples.
    fn exchange_configs(&mut self) {
        if !core::mem::take(&mut self.commit) || self.system.drives() {
            return;
        }
        if let Some(board) = self.staged_board.take() {
            self.board = board;
            self.board_crc = board_crc(&board);
            self.tip.set_limit(board.tip_force_limit_un);
        }
        for unit in &mut self.units {
            if let Some(config) = unit.staged.take() {
                unit.zeroed &= config.wire().zero_code == unit.config.wire().zero_code;
                unit.configured = true;
                unit.config = config;
                unit.control.config_changed();
            }
            unit.let_go.configured();
        }
        self.config_crc = self.crc();
    }

    /// [`config_crc`] of the configurations in force.
    fn crc(&self) -> u32 {
        let configs: [UnitConfig; UNITS] = core::array::from_fn(|n| *self.units[n].config.wire());
        config_crc(&configs)
    }
}

/// Longest encoding of a [`UnitConfig`]: 24 numbers, two ripples of four numbers and a cell's three
/// with at most 5 bytes each, two flags of one byte, a filter of at most 4 bytes.
const MAX_CONFIG_BYTES: usize = (24 + 8 + 3) * 5 + 2 + 4;

/// CRC-32 over configurations: each as postcard encodes it, one after the other, unit 1 first.
#[must_use]
pub fn config_crc(configs: &[UnitConfig; UNITS]) -> u32 {
    let mut buffer = [0; UNITS * MAX_CONFIG_BYTES];
    postcard::to_slice(configs, &mut buffer).map_or(0, |bytes| crc32(bytes))
}

/// CRC-32 over the configuration of the whole board, as postcard encodes it.
fn board_crc(config: &BoardConfig) -> u32 {
    let mut buffer = [0; 8];
    postcard::to_slice(config, &mut buffer).map_or(0, |bytes| crc32(bytes))
}
