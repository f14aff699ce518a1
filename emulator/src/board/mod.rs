//! The motor control board around the controller: every chip, the wires between them, and the
//! plant.
//!
//! The engine (see [`crate::engine`]) reports what the controller does at its pins and buses, with
//! the virtual time; the board reports the levels that it drives back and the time of its next
//! event. It depends on no engine and on no register of the controller.
//!
//! The plant is advanced on demand: a conversion ends, a counter is latched, a DAC changes, a row
//! of truth is requested. On the way it records its bridges and encoders on a fixed grid, from
//! which the converters' filters and the counters take what they need.

mod counter_bus;
mod direct;
mod i2c;
mod injection;
mod pins;
mod power;
mod serial;

use i2c::Transaction;
use power::Power;
use serial::Line;

use crate::devices::dac7731::{Dac7731, Mode};
use crate::devices::ls7266r1::Ls7266r1;
use crate::devices::nau7802::Nau7802;
use crate::devices::plc::Plc;
use crate::devices::sinc::History;
use crate::devices::tca9548a::Tca9548a;
use crate::devices::Complaints;
use crate::probe::Probe;
use crate::wiring::{Pin, PORTS, UNITS};
use emulator_link::{DacResetPull, Pose, Truth};
use plant::Plant;
use std::collections::VecDeque;

/// How far back the slowest filter looks: four periods at 10 SPS with the slowest clock.
const FILTER_REACH_NS: u64 = 415_000_000;

/// Nine clocks of a START's address at 400 kHz, less half a percent for rounding, in nanoseconds.
const ADDRESS_NS: u64 = 22_390;

/// SCL pulses after which a held SDA is let go.
const RECOVERY_PULSES: u8 = 9;

/// A level that the board puts on a pin of the controller; `None` lets go of it.
pub type Drive = (Pin, Option<bool>);

#[derive(Debug, Clone, Copy, Default)]
struct Port {
    driven: u16,
    level: u16,
}

impl Port {
    /// Levels of a port's lines whose resistors hold them at `idle`.
    fn seen(self, idle: u16) -> u16 {
        self.driven & self.level | !self.driven & idle
    }
}

/// Lines of the plant's encoders.
const NOMINAL_LINES: u16 = 1_000;

/// Which unit's part is plugged in at each unit's place.
#[derive(Debug, Clone, Copy)]
struct Wired {
    encoder: [usize; UNITS],
    motor: [usize; UNITS],
    cell: [usize; UNITS],
    drdy: [usize; UNITS],
}

/// Every part at its own place.
const IN_ORDER: [usize; UNITS] = [0, 1, 2, 3, 4, 5];

impl Default for Wired {
    fn default() -> Self {
        Self {
            encoder: IN_ORDER,
            motor: IN_ORDER,
            cell: IN_ORDER,
            drdy: IN_ORDER,
        }
    }
}

/// A controller's own number; no two seeds have the same one, and none is zero.
const fn unique_id(seed: u64) -> [u32; 3] {
    /// The last word of a real one is of the lot: letters.
    const LOT: u32 = u32::from_be_bytes(*b"EMUL");
    [seed as u32, (seed >> 32) as u32, LOT]
}

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Board {
    now_ns: u64,
    /// When the converters or the PLC next do something on their own.
    due_ns: Option<u64>,
    plant: Plant,
    history: History<UNITS>,
    pull_n: [f64; UNITS],
    frozen_encoder: [Option<i64>; UNITS],
    /// Encoders that count the other way: the count at which they turned round, times two.
    reversed_encoder: [Option<i64>; UNITS],
    /// Counts by which encoders have jumped.
    encoder_jump: [i64; UNITS],
    /// Share of the current that is asked for; 1: in order, 0: off, negative: the motor turns the
    /// other way.
    amplifier_share: [f64; UNITS],
    /// Unit whose encoder is plugged in at each unit's counter, whose motor at its amplifier, whose
    /// load cell at its converter, whose DRDY line at its pin.
    wired: Wired,
    /// Lines of each encoder.
    encoder_lines: [u16; UNITS],
    /// Two channels of the multiplexer that are exchanged.
    exchanged: Option<[usize; 2]>,
    /// Amplifier inputs that another controller drives in place of the DACs, V.
    outside_v: Option<[f64; UNITS]>,
    /// Wires of power, alive line and E-stop.
    power: Power,
    /// DACs whose select wires touch.
    tied: Option<[usize; 2]>,
    /// Share of its signal that each load cell gives.
    cell_share: [f64; UNITS],
    /// DRDY wires that are open.
    drdy_cut: [bool; UNITS],
    /// The controller's own number, drawn from the chips' seed.
    unique_id: [u32; 3],
    /// What holds DAC_RST while the controller does not drive it.
    dac_reset_pull: DacResetPull,
    /// Brown-out level in the option bytes.
    brown_out_level: u8,
    /// Rising edges of a DRDY line that are still to be lost.
    lose_drdy: [u8; UNITS],
    converters: [Nau7802; UNITS],
    mux: Tca9548a,
    dacs: [Dac7731; UNITS],
    counters: [Ls7266r1; 3],
    plc: Plc,
    ports: [Port; PORTS],
    pending: Vec<Drive>,
    drdy: [Option<bool>; UNITS],
    sclk_idle: Option<bool>,
    spi_mode: Mode,
    write_low_ns: u64,
    read_low_ns: Option<u64>,
    read_high_ns: Option<u64>,
    transaction: Transaction,
    start_ns: u64,
    sda_held: bool,
    /// SDA stays low whatever is done.
    sda_jammed: bool,
    scl_pulses: u8,
    /// Data bits on the I2C bus until the one that is inverted.
    flip_bus_bit: Option<u32>,
    flip_dac_bit: Option<u8>,
    /// The engine is to set the bus-error flag in the next transfer, or to lock the serial line's
    /// stream.
    bus_error: bool,
    /// The ST-Link's clock stands still.
    clock_lost: bool,
    stall: bool,
    /// The SPI controller of the DACs has stopped.
    spi_stopped: bool,
    to_board: VecDeque<u8>,
    from_board: Vec<u8>,
    line: Line,
    /// The latency probe.
    pub probe: Probe,
    complaints: Complaints,
}

impl Board {
    /// A board at power-on with `plant` behind it. `seed` draws what differs from chip to chip.
    ///
    /// # Errors
    /// The plant must have six units.
    pub fn new(plant: Plant, seed: u64) -> Result<Self, String> {
        if plant.units() != UNITS {
            return Err(format!(
                "the board carries {UNITS} force units and the plant has {}; give it {UNITS} [[units]]",
                plant.units()
            ));
        }
        let mut board = Self {
            now_ns: 0,
            due_ns: None,
            plant,
            history: History::new(FILTER_REACH_NS),
            pull_n: [0.0; UNITS],
            frozen_encoder: [None; UNITS],
            reversed_encoder: [None; UNITS],
            encoder_jump: [0; UNITS],
            amplifier_share: [1.0; UNITS],
            wired: Wired::default(),
            encoder_lines: [NOMINAL_LINES; UNITS],
            exchanged: None,
            outside_v: None,
            power: Power::default(),
            tied: None,
            cell_share: [1.0; UNITS],
            drdy_cut: [false; UNITS],
            unique_id: unique_id(seed),
            dac_reset_pull: DacResetPull::Down,
            brown_out_level: 3,
            lose_drdy: [0; UNITS],
            converters: std::array::from_fn(|unit| Nau7802::new(unit as u8 + 1, seed)),
            mux: Tca9548a::new(0x70),
            dacs: Default::default(),
            counters: std::array::from_fn(|chip| Ls7266r1::new(chip + 1)),
            plc: Plc::default(),
            ports: [Port::default(); PORTS],
            pending: Vec::new(),
            drdy: [None; UNITS],
            sclk_idle: None,
            spi_mode: Mode {
                cpol: false,
                cpha: false,
            },
            write_low_ns: 0,
            read_low_ns: None,
            read_high_ns: None,
            transaction: Transaction::default(),
            start_ns: 0,
            sda_held: false,
            sda_jammed: false,
            scl_pulses: 0,
            flip_bus_bit: None,
            flip_dac_bit: None,
            bus_error: false,
            clock_lost: false,
            stall: false,
            spi_stopped: false,
            to_board: VecDeque::new(),
            from_board: Vec::new(),
            line: Line::default(),
            probe: Probe::default(),
            complaints: Complaints::default(),
        };
        board.show_estop();
        board.show_dac_reset();
        board.show_drdy(0);
        board.advance_plant(0);
        board.reschedule();
        Ok(board)
    }

    /// Gives the controller the number of another seed than that of the chips: one rig has one
    /// number in all its runs.
    pub const fn set_unique_id(&mut self, seed: u64) {
        self.unique_id = unique_id(seed);
    }

    /// The controller's own number.
    #[must_use]
    pub const fn unique_id(&self) -> [u32; 3] {
        self.unique_id
    }

    /// When the board next does something on its own.
    #[must_use]
    pub const fn next_event(&self) -> Option<u64> {
        self.due_ns
    }

    /// Updates the time of the next event of the converters and the PLC. Call it after each access
    /// to one of them. The engine reads it at every stop, so it is stored.
    fn reschedule(&mut self) {
        self.due_ns = (self.converters.iter().filter_map(Nau7802::next_event))
            .chain(self.plc.deadline())
            .min();
    }

    /// Everything that is due by `t_ns` happens, in order.
    pub fn advance(&mut self, t_ns: u64) {
        while let Some(at) = self.next_event().filter(|at| *at <= t_ns) {
            self.advance_plant(at);
            for unit in 0..UNITS {
                if self.converters[unit]
                    .next_event()
                    .is_some_and(|due| due <= at)
                {
                    let history = &self.history;
                    let edge = self.converters[unit]
                        .advance(at, |end, period| history.sinc4(unit, end, period));
                    if edge {
                        self.probe.drdy(unit, at);
                    }
                }
            }
            if self.plc.deadline().is_some_and(|due| due <= at) {
                self.plc.advance(at);
                self.switch_power(at);
            }
            self.show_drdy(at);
            self.reschedule();
        }
        self.now_ns = self.now_ns.max(t_ns);
    }

    fn advance_plant(&mut self, t_ns: u64) {
        while self.history.next_ns() <= t_ns {
            self.plant.advance_to(self.history.next_ns());
            // A known pull is a weight to calibrate with: it hangs on the plant's cell.
            let cell = self.wired.cell;
            let row = std::array::from_fn(|unit| {
                self.cell_share[cell[unit]] * self.plant.bridge_v_per_v(cell[unit])
            });
            self.history.push(row);
            self.turn_counters();
        }
        self.plant.advance_to(t_ns);
    }

    fn turn_counters(&mut self) {
        for unit in 0..UNITS {
            let edges = self.frozen_encoder[unit].unwrap_or_else(|| self.encoder_edges(unit));
            self.counters[unit / 2].turn(unit % 2, edges);
        }
    }

    /// Edges that a unit's encoder has given so far, with its defects.
    fn encoder_edges(&self, unit: usize) -> i64 {
        let edges = self.disc_edges(unit);
        self.reversed_encoder[unit].map_or(edges, |turned| turned - edges) + self.encoder_jump[unit]
    }

    /// Edges of the disc that is plugged in at a unit's counter.
    fn disc_edges(&self, unit: usize) -> i64 {
        let source = self.wired.encoder[unit];
        let edges = self.plant.encoder_counts(source);
        match self.encoder_lines[source] {
            NOMINAL_LINES => edges,
            lines => (edges * i64::from(lines)).div_euclid(i64::from(NOMINAL_LINES)),
        }
    }

    /// A unit's encoder counts the other way from its present count on, or the right way again.
    fn reverse_encoder(&mut self, unit: usize, reversed: bool) {
        self.reversed_encoder[unit] = reversed.then(|| 2 * self.disc_edges(unit));
    }

    /// The controller came out of a reset: its pins let go.
    pub fn controller_reset(&mut self, t_ns: u64) {
        for port in 0..PORTS {
            self.port_changed(t_ns, port, 0, 0);
        }
        self.i2c_stop();
        self.probe.reset();
        self.sclk_idle = None;
    }

    /// Starts or stops the robot's path.
    pub fn set_robot_moving(&mut self, moving: bool) {
        self.advance_plant(self.now_ns);
        self.plant.set_robot_moving(moving);
    }

    /// Lets another controller drive the amplifiers, V at their inputs, from now on: the board is a
    /// sensor board then. `None`: the board's own DACs again. What is not finite counts as 0 V.
    pub fn drive_outside(&mut self, volts: Option<[f64; UNITS]>) {
        self.outside_v = volts.map(|volts| volts.map(|v| if v.is_finite() { v } else { 0.0 }));
        self.move_outputs(self.now_ns);
    }

    /// The robot's pose as its own controller reports it.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let (position_m, velocity_m_s) = self.plant.robot_says();
        Pose {
            position_m,
            velocity_m_s,
        }
    }

    /// The plant's true state at `t_ns`, which must not lie in the past.
    pub fn truth(&mut self, t_ns: u64) -> Truth {
        self.advance_plant(t_ns);
        Truth {
            t_ns,
            tip_m: self.plant.tip_position_m(),
            tip_force_n: self.plant.tip_force_n(),
            tension_n: std::array::from_fn(|unit| self.plant.tension_n(unit) + self.pull_n[unit]),
            reel_rad_s: std::array::from_fn(|unit| self.plant.reel_rad_per_s(unit)),
            dac_v: std::array::from_fn(|unit| self.dacs[unit].volts()),
            amplifier_on: self.powered(),
        }
    }

    /// Conversions that became ready, and those read out in time, per unit.
    #[must_use]
    pub fn conversions(&self) -> ([u64; UNITS], [u64; UNITS]) {
        (
            std::array::from_fn(|unit| self.converters[unit].conversions),
            std::array::from_fn(|unit| self.converters[unit].conversions_read),
        )
    }

    /// Frequency of the alive line in hertz.
    #[must_use]
    pub fn alive_hz(&self) -> f64 {
        self.plc.alive_hz()
    }

    /// Notes a misuse that the engine saw at the pins.
    pub fn complain(&mut self, place: &str, what: String) {
        self.complaints.add(place, what);
    }
}

#[cfg(test)]
mod tests;
