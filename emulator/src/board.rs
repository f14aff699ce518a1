//! The motor control board around the controller: every chip, the wires between them, and the plant.
//!
//! The engine (see [`crate::engine`]) tells it what the controller does at its pins and buses, with the
//! virtual time; the board tells the engine what it drives back and when it next wants to be woken. It knows
//! no engine and no register of the controller.
//!
//! The plant is advanced only when somebody looks: a conversion ends, a counter is latched, a DAC moves, a
//! row of truth is asked for. On the way it leaves its bridges and encoders on a fixed grid, from which the
//! converters' filters and the counters take what they need.

use crate::devices::dac7731::{Dac7731, Mode};
use crate::devices::ls7266r1::{self, Ls7266r1};
use crate::devices::nau7802::{self, Nau7802};
use crate::devices::plc::Plc;
use crate::devices::sinc::History;
use crate::devices::tca9548a::Tca9548a;
use crate::devices::Complaints;
use crate::probe::Probe;
use crate::wiring::{self, Pin, PORTS, UNITS};
use emulator_link::{Injection, Pose, Truth};
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
    fn seen(self, port: usize) -> u16 {
        self.driven & self.level | !self.driven & wiring::IDLE[port]
    }
}

/// What a transaction with the converters has been so far.
#[derive(Debug, Clone, Copy, Default)]
struct Transaction {
    adc: bool,
    written: u8,
    read: u8,
}

/// The spacing of the bytes that the board's USART3 sends, from which its baud rate shows.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    last_ns: u64,
    closest_ns: Option<u64>,
    bytes: u64,
}

/// See the module's page.
#[derive(Debug)]
pub struct Board {
    now_ns: u64,
    /// When the converters or the PLC next do something on their own.
    due_ns: Option<u64>,
    plant: Plant,
    history: History<UNITS>,
    pull_n: [f64; UNITS],
    frozen_encoder: [Option<i64>; UNITS],
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
    scl_pulses: u8,
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
            scl_pulses: 0,
            to_board: VecDeque::new(),
            from_board: Vec::new(),
            line: Line::default(),
            probe: Probe::default(),
            complaints: Complaints::default(),
        };
        board.plc.set_estop_closed(true);
        board.pending.push((wiring::E_STOP, Some(true)));
        board.show_drdy(0);
        board.advance_plant(0);
        board.reschedule();
        Ok(board)
    }

    // Time.

    /// When the board next does something on its own.
    #[must_use]
    pub const fn next_event(&self) -> Option<u64> {
        self.due_ns
    }

    /// Asks the converters and the PLC anew: whoever touches one of them calls this. The engine wants the
    /// answer at every stop, so it is kept.
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
            let row = std::array::from_fn(|unit| {
                // By the cell's own sensitivity: a known pull is a weight to calibrate with.
                let per_n = self.plant.parameters(unit).bridge_per_n;
                self.plant.bridge_v_per_v(unit) + self.pull_n[unit] * per_n
            });
            self.history.push(row);
            self.turn_counters();
        }
        self.plant.advance_to(t_ns);
    }

    fn turn_counters(&mut self) {
        for unit in 0..UNITS {
            let edges =
                self.frozen_encoder[unit].unwrap_or_else(|| self.plant.encoder_counts(unit));
            self.counters[unit / 2].turn(unit % 2, edges);
        }
    }

    fn switch_power(&mut self, t_ns: u64) {
        self.advance_plant(t_ns);
        self.plant.set_amplifier_power(self.plc.powered());
    }

    // Pins.

    /// What the board changed on the controller's pins since the last call.
    pub fn take_drives(&mut self) -> Vec<Drive> {
        std::mem::take(&mut self.pending)
    }

    /// Whether there is something for [`Board::take_drives`].
    #[must_use]
    pub fn has_drives(&self) -> bool {
        !self.pending.is_empty()
    }

    fn show_drdy(&mut self, _t_ns: u64) {
        for unit in 0..UNITS {
            let level = self.converters[unit].drdy();
            if level != self.drdy[unit] {
                self.drdy[unit] = level;
                self.pending.push((wiring::DRDY[unit], level));
            }
        }
    }

    /// The controller's output stages of `port` are now on for the bits of `driven` with the levels of
    /// `level`. Open-drain outputs that are high count as not driven.
    pub fn port_changed(&mut self, t_ns: u64, port: usize, driven: u16, level: u16) {
        let before = self.ports[port].seen(port);
        let drove = self.ports[port].driven;
        self.ports[port] = Port { driven, level };
        let after = self.ports[port].seen(port);
        let rose = after & !before;
        let fell = before & !after;
        if rose | fell == 0 && drove == driven {
            return;
        }
        self.now_ns = self.now_ns.max(t_ns);
        const B: usize = wiring::I2C_SCL.port;
        const C: usize = wiring::ALIVE.port;
        const D: usize = wiring::CNT_CD.port;
        const E: usize = wiring::CNT_D0.port;
        const F: usize = wiring::MUX_RST.port;
        const G: usize = 6;
        match port {
            B => self.recovery_pins(rose),
            C if (rose | fell) & wiring::ALIVE.bit() != 0 => {
                self.plc.edge(t_ns);
                self.reschedule();
                self.switch_power(t_ns);
            }
            D => self.counter_pins(t_ns, before, after),
            E => self.check_contention(),
            F => self.control_pins(t_ns, rose, fell),
            G => self.dac_selects(rose, fell),
            _ => {}
        }
    }

    /// SCL pulses by hand: the ninth frees a held SDA.
    fn recovery_pins(&mut self, rose: u16) {
        if self.sda_held && rose & wiring::I2C_SCL.bit() != 0 {
            self.scl_pulses += 1;
            if self.scl_pulses >= RECOVERY_PULSES {
                self.release_sda();
            }
        }
    }

    fn release_sda(&mut self) {
        if self.sda_held {
            self.sda_held = false;
            self.pending.push((wiring::I2C_SDA, None));
        }
    }

    fn control_pins(&mut self, t_ns: u64, rose: u16, fell: u16) {
        if fell & wiring::MUX_RST.bit() != 0 {
            self.mux.set_reset(true);
            self.release_sda();
        } else if rose & wiring::MUX_RST.bit() != 0 {
            self.mux.set_reset(false);
        }
        if fell & wiring::DAC_RST.bit() != 0 {
            self.dacs.iter_mut().for_each(|dac| dac.set_reset(true));
            self.move_outputs(t_ns);
        } else if rose & wiring::DAC_RST.bit() != 0 {
            self.dacs.iter_mut().for_each(|dac| dac.set_reset(false));
        }
        if rose & wiring::DAC_LDAC.bit() != 0 {
            for (unit, dac) in self.dacs.iter_mut().enumerate() {
                if dac.is_selected() {
                    self.complaints.add(
                        format!("DAC7731[{}]", unit + 1),
                        "LDAC rose while CS was low: the word is not in the input register yet",
                    );
                }
                dac.load();
            }
            self.move_outputs(t_ns);
            for unit in 0..UNITS {
                self.probe.updated(unit, t_ns);
            }
        }
    }

    fn move_outputs(&mut self, t_ns: u64) {
        self.advance_plant(t_ns);
        for (unit, dac) in self.dacs.iter().enumerate() {
            self.plant
                .set_amplifier_volts(unit, dac.volts())
                .expect("six units, finite volts");
        }
    }

    fn dac_selects(&mut self, rose: u16, fell: u16) {
        for (unit, cs) in wiring::DAC_CS.iter().enumerate() {
            if fell & cs.bit() != 0 {
                self.dacs[unit].select();
                self.probe.selected(unit);
            } else if rose & cs.bit() != 0 {
                let name = format!("DAC7731[{}]", unit + 1);
                if self.sclk_idle.is_none() {
                    self.complaints.add(
                        name.as_str(),
                        "CS rose while nothing drove SCLK (SPE = 0 and AFCNTR = 0)",
                    );
                }
                if self.dacs[unit].deselect(self.sclk_idle.unwrap_or(false)) {
                    self.complaints
                        .add(name, "CS rose while SCLK was low: one more bit shifted in");
                }
            }
        }
    }

    // SPI to the DACs.

    /// How the SPI is set: its mode, and the level at which SCLK rests (`None`: nothing drives it).
    pub fn spi_set(&mut self, mode: Mode, sclk_idle: Option<bool>) {
        self.spi_mode = mode;
        self.sclk_idle = sclk_idle;
    }

    /// A data word reaches the SPI's register.
    pub fn spi_written(&mut self, t_ns: u64, instructions: u64) {
        let selected = std::array::from_fn(|unit| self.dacs[unit].is_selected());
        self.probe.spi_word(t_ns, instructions, selected);
    }

    /// A frame of `bits` bits has crossed, first bit on the wire in the most significant place.
    pub fn spi_frame(&mut self, word: u32, bits: u8) {
        if !self.dacs.iter().any(Dac7731::is_selected) {
            self.complaints
                .add("SPI1", "a frame ended while no DAC7731 was selected");
        }
        if !self.spi_mode.steady_on_rising() {
            self.complaints.add(
                "SPI1.CFG2",
                "this clock mode moves data on the rising edge, where the DAC7731 samples",
            );
        }
        for dac in &mut self.dacs {
            dac.clock_in(word, bits, self.spi_mode);
        }
    }

    // The counters' bus.

    fn counter_pins(&mut self, t_ns: u64, before: u16, after: u16) {
        let high = |levels: u16, pin: Pin| levels & pin.bit() != 0;
        let (wr, rd) = (wiring::CNT_WR, wiring::CNT_RD);
        if high(before, wr) && !high(after, wr) {
            self.write_low_ns = t_ns;
        }
        if !high(before, wr) && high(after, wr) {
            let low = t_ns.saturating_sub(self.write_low_ns);
            if low < ls7266r1::WRITE_LOW_NS {
                self.complaints.add(
                    "LS7266R1 bus",
                    format!("WR low for less than {} ns", ls7266r1::WRITE_LOW_NS),
                );
            }
            self.counter_write(t_ns, before);
        }
        if high(before, rd) && !high(after, rd) {
            if (self.read_high_ns).is_some_and(|last| t_ns - last < ls7266r1::READ_GAP_NS) {
                self.complaints.add(
                    "LS7266R1 bus",
                    format!("less than {} ns between two reads", ls7266r1::READ_GAP_NS),
                );
            }
            self.read_low_ns = Some(t_ns);
            self.counter_read(after);
        }
        if !high(before, rd) && high(after, rd) {
            if let Some(since) = self.read_low_ns.take() {
                if t_ns - since < ls7266r1::READ_LOW_NS {
                    self.complaints.add(
                        "LS7266R1 bus",
                        format!("RD low for less than {} ns", ls7266r1::READ_LOW_NS),
                    );
                }
            }
            self.read_high_ns = Some(t_ns);
            let (axis, control) = (
                usize::from(high(before, wiring::CNT_XY)),
                high(before, wiring::CNT_CD),
            );
            for (chip, cs) in wiring::CNT_CS.into_iter().enumerate() {
                if !high(before, cs) {
                    self.counters[chip].read_done(axis, control);
                }
            }
            for bit in 0..8 {
                self.pending.push((data_pin(bit), None));
            }
        }
    }

    fn counter_write(&mut self, t_ns: u64, pins: u16) {
        let axis = usize::from(pins & wiring::CNT_XY.bit() != 0);
        let control = pins & wiring::CNT_CD.bit() != 0;
        let data = self.ports[wiring::CNT_D0.port];
        if data.driven & wiring::CNT_DATA != wiring::CNT_DATA {
            self.complaints.add(
                "LS7266R1 bus",
                "WR rose while the controller did not drive D0 to D7",
            );
        }
        let value = (data.seen(wiring::CNT_D0.port) >> 8) as u8;
        if control {
            // The latch takes the count of this instant.
            self.advance_plant(t_ns);
            self.turn_counters();
        }
        for (chip, cs) in wiring::CNT_CS.into_iter().enumerate() {
            if pins & cs.bit() == 0 {
                self.counters[chip].write(axis, control, value, &mut self.complaints);
            }
        }
    }

    fn counter_read(&mut self, pins: u16) {
        let axis = usize::from(pins & wiring::CNT_XY.bit() != 0);
        let control = pins & wiring::CNT_CD.bit() != 0;
        let selected: Vec<usize> = (0..3)
            .filter(|chip| pins & wiring::CNT_CS[*chip].bit() == 0)
            .collect();
        if selected.len() > 1 {
            self.complaints.add(
                "LS7266R1 bus",
                "two chips selected during a read drive against each other",
            );
        }
        self.check_contention();
        let Some(&chip) = selected.first() else {
            self.complaints
                .add("LS7266R1 bus", "RD fell while no chip was selected");
            return;
        };
        let value = self.counters[chip].read(axis, control);
        for bit in 0..8 {
            self.pending
                .push((data_pin(bit), Some(value >> bit & 1 == 1)));
        }
    }

    fn check_contention(&mut self) {
        let driven = self.ports[wiring::CNT_D0.port].driven & wiring::CNT_DATA;
        let reading =
            self.ports[wiring::CNT_RD.port].seen(wiring::CNT_RD.port) & wiring::CNT_RD.bit() == 0;
        if driven != 0 && reading {
            self.complaints.add(
                "LS7266R1 bus",
                "contention: the controller drives D0 to D7 while RD is low",
            );
        }
    }

    /// The controller samples the counters' data pins.
    pub fn data_sampled(&mut self, t_ns: u64) {
        if (self.read_low_ns).is_some_and(|since| t_ns - since < ls7266r1::READ_LOW_NS) {
            self.complaints.add(
                "LS7266R1 bus",
                format!(
                    "data sampled less than {} ns after RD fell",
                    ls7266r1::READ_LOW_NS
                ),
            );
        }
    }

    // I2C.

    /// Whether something holds SDA low: no START can leave the controller then.
    #[must_use]
    pub const fn sda_held(&self) -> bool {
        self.sda_held
    }

    /// The controller begins a START for `address`.
    pub fn i2c_begins(&mut self, t_ns: u64, address: u8) {
        self.start_ns = t_ns;
        if address == nau7802::ADDRESS {
            self.probe.adc_start(t_ns);
        } else {
            self.probe.mux_start(t_ns);
        }
    }

    /// A START with its address has crossed. True: acknowledged.
    pub fn i2c_start(&mut self, t_ns: u64, address: u8, read: bool) -> bool {
        self.now_ns = self.now_ns.max(t_ns);
        if t_ns.saturating_sub(self.start_ns) < ADDRESS_NS {
            self.complaints.add(
                "I2C1.TIMINGR",
                "SCL runs faster than the 400 kHz that the NAU7802 and the TCA9548A take",
            );
        }
        if self.mux.start(address, read) {
            return true;
        }
        let mut acknowledged = false;
        if address == nau7802::ADDRESS {
            self.transaction.adc = true;
            for unit in 0..UNITS {
                if self.mux.mask() >> unit & 1 == 1 {
                    acknowledged |= self.converters[unit].start(read, t_ns, &mut self.complaints);
                }
            }
        }
        if !acknowledged {
            self.i2c_stop();
        }
        self.reschedule();
        acknowledged
    }

    /// A byte from the controller. True: acknowledged.
    pub fn i2c_write(&mut self, t_ns: u64, byte: u8) -> bool {
        if self.mux.is_addressed() {
            return self.mux.write(byte);
        }
        self.transaction.written = self.transaction.written.saturating_add(1);
        let mut acknowledged = false;
        for chip in &mut self.converters {
            acknowledged |= chip.write(byte, t_ns, &mut self.complaints);
        }
        self.show_drdy(t_ns);
        self.reschedule();
        acknowledged
    }

    /// A byte to the controller: what all chips that answer leave of it on the open-drain wire.
    pub fn i2c_read(&mut self, t_ns: u64) -> u8 {
        if self.mux.is_addressed() {
            return self.mux.read();
        }
        let mut byte = 0xFF;
        for unit in 0..UNITS {
            if self.mux.mask() >> unit & 1 == 1 {
                let result_done = self.converters[unit].pointer() == 0x14;
                byte &= self.converters[unit].read(t_ns);
                if result_done {
                    self.probe.data(unit, t_ns);
                    self.transaction.adc = false;
                }
            }
        }
        self.transaction.read = self.transaction.read.saturating_add(1);
        self.show_drdy(t_ns);
        self.reschedule();
        byte
    }

    /// STOP.
    pub fn i2c_stop(&mut self) {
        let transaction = std::mem::take(&mut self.transaction);
        // A pointer written in a transaction of its own belongs to the read that follows.
        if transaction.adc && (transaction.written > 1 || transaction.read > 0) {
            self.probe.other_transaction();
        }
        self.mux.stop();
        self.converters.iter_mut().for_each(Nau7802::stop);
        self.reschedule();
    }

    // The serial line.

    /// Puts bytes on the board's receive line; they cross at line rate.
    pub fn queue_to_board(&mut self, bytes: &[u8]) {
        self.to_board.extend(bytes);
    }

    /// The next byte on the board's receive line.
    pub fn next_to_board(&mut self) -> Option<u8> {
        self.to_board.pop_front()
    }

    /// Whether bytes wait for the board.
    #[must_use]
    pub fn to_board_waiting(&self) -> usize {
        self.to_board.len()
    }

    /// The stop bit of a byte from the board has ended.
    pub fn sent_by_board(&mut self, t_ns: u64, byte: u8) {
        if self.line.bytes > 0 {
            let gap = t_ns - self.line.last_ns;
            self.line.closest_ns =
                Some(self.line.closest_ns.map_or(gap, |closest| closest.min(gap)));
        }
        self.line.last_ns = t_ns;
        self.line.bytes += 1;
        self.from_board.push(byte);
    }

    /// The bytes that the board has sent since the last call.
    pub fn take_from_board(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.from_board)
    }

    // The rest of the lab.

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

    /// Breaks or mends something.
    ///
    /// # Errors
    /// A unit that does not exist, a figure that is not finite, or an injection that is the engine's.
    pub fn inject(&mut self, injection: Injection) -> Result<(), String> {
        let unit = |number: u8| {
            let index = usize::from(number).wrapping_sub(1);
            (index < UNITS)
                .then_some(index)
                .ok_or_else(|| format!("unit {number} does not exist: units are 1 to {UNITS}"))
        };
        let now = self.now_ns;
        match injection {
            Injection::UnplugSensor(number) => self.converters[unit(number)?].unplug(),
            Injection::PlugSensor(number) => self.converters[unit(number)?].plug(),
            Injection::Nack(number) => self.converters[unit(number)?].nack(),
            Injection::Spike(number, codes) => self.converters[unit(number)?].spike(codes),
            Injection::StuckSda => {
                self.sda_held = true;
                self.scl_pulses = 0;
                self.pending.push((wiring::I2C_SDA, Some(false)));
            }
            Injection::EStop(pressed) => {
                self.plc.set_estop_closed(!pressed);
                self.pending.push((wiring::E_STOP, Some(!pressed)));
                self.switch_power(now);
            }
            Injection::PullCable(number, newtons) => {
                let unit = unit(number)?;
                if !newtons.is_finite() {
                    return Err(format!("a pull of {newtons} N is not a number"));
                }
                self.advance_plant(now);
                self.pull_n[unit] = newtons;
            }
            Injection::FreezeEncoder(number, frozen) => {
                let unit = unit(number)?;
                self.advance_plant(now);
                self.frozen_encoder[unit] = frozen.then(|| self.plant.encoder_counts(unit));
            }
            Injection::HangLoop | Injection::FlipBit(..) => {
                return Err("this injection belongs to the engine".to_owned());
            }
        }
        self.show_drdy(now);
        self.reschedule();
        Ok(())
    }

    /// The robot's pose as its own controller reports it.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            position_m: self.plant.tip_position_m(),
            velocity_m_s: self.plant.tip_velocity_m_per_s(),
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
            amplifier_on: self.plc.powered(),
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

    /// What the chips would complain about if they could.
    #[must_use]
    pub fn complaints(&self) -> Complaints {
        let mut all = self.complaints.clone();
        // A frame of ten bits every 5 us at most; a board that sends at another rate shows either by
        // bytes that come closer, or, over many, by none that come this close.
        let frame_ns = 10_000_000_000 / wiring::BAUD;
        if let Some(closest) = self.line.closest_ns {
            let fast = closest * 100 < frame_ns * 98;
            let slow = self.line.bytes > 1_000 && closest * 100 > frame_ns * 102;
            if fast || slow {
                all.add(
                    "USART3",
                    format!(
                        "sends a byte every {closest} ns; {} baud 8N1 would be {frame_ns} ns",
                        wiring::BAUD
                    ),
                );
            }
        }
        all
    }
}

fn data_pin(bit: u8) -> Pin {
    Pin {
        port: wiring::CNT_D0.port,
        pin: wiring::CNT_D0.pin + bit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::PlantConfig;

    fn board() -> Board {
        Board::new(Plant::new(PlantConfig::default(), 1).unwrap(), 1).unwrap()
    }

    #[test]
    fn a_bus_faster_than_400_khz_is_seen() {
        let mut board = board();
        board.i2c_begins(1_000_000, 0x70);
        board.i2c_start(1_022_500, 0x70, false);
        assert!(board.complaints().is_empty());
        board.i2c_begins(2_000_000, 0x70);
        board.i2c_start(2_020_000, 0x70, false);
        assert!(!board.complaints().is_empty());
    }

    fn select(board: &mut Board, mask: u8) {
        assert!(board.i2c_start(ADDRESS_NS, 0x70, false));
        assert!(board.i2c_write(0, mask));
        board.i2c_stop();
    }

    fn write(board: &mut Board, register: u8, value: u8) -> bool {
        let done = board.i2c_start(ADDRESS_NS, 0x2A, false)
            && board.i2c_write(0, register)
            && board.i2c_write(0, value);
        board.i2c_stop();
        done
    }

    fn read(board: &mut Board, register: u8) -> u8 {
        board.i2c_start(ADDRESS_NS, 0x2A, false);
        board.i2c_write(0, register);
        board.i2c_start(ADDRESS_NS, 0x2A, true);
        let byte = board.i2c_read(0);
        board.i2c_stop();
        byte
    }

    #[test]
    fn the_multiplexer_routes() {
        let mut board = board();
        assert!(
            !board.i2c_start(ADDRESS_NS, 0x2A, false),
            "no channel, no converter"
        );
        select(&mut board, 0x02);
        assert!(write(&mut board, 0x01, 0x2F));
        select(&mut board, 0x01);
        assert_eq!(read(&mut board, 0x01), 0x00);
        select(&mut board, 0x02);
        assert_eq!(read(&mut board, 0x01), 0x2F);
        select(&mut board, 0xC0);
        assert!(
            !board.i2c_start(ADDRESS_NS, 0x2A, false),
            "channels 7 and 8 are empty"
        );
    }

    #[test]
    fn several_channels_at_once_are_a_wired_and() {
        let mut board = board();
        select(&mut board, 0x01);
        write(&mut board, 0x01, 0x2F);
        select(&mut board, 0x02);
        write(&mut board, 0x01, 0x37);
        select(&mut board, 0x03);
        assert_eq!(read(&mut board, 0x01), 0x27);
        write(&mut board, 0x01, 0x07);
        select(&mut board, 0x01);
        assert_eq!(read(&mut board, 0x01), 0x07);
    }

    #[test]
    fn a_held_sda_lets_go_after_nine_clocks_or_a_multiplexer_reset() {
        let mut board = board();
        board.take_drives();
        let scl = wiring::I2C_SCL.bit();
        board.inject(Injection::StuckSda).unwrap();
        assert_eq!(board.take_drives(), [(wiring::I2C_SDA, Some(false))]);
        for pulse in 0..9 {
            assert!(board.sda_held(), "pulse {pulse}");
            board.port_changed(0, 1, scl, 0);
            board.port_changed(0, 1, 0, scl);
        }
        assert!(!board.sda_held());
        board.inject(Injection::StuckSda).unwrap();
        board.port_changed(0, 5, wiring::MUX_RST.bit(), 0);
        assert!(!board.sda_held());
    }

    #[test]
    fn a_pressed_emergency_stop_opens_the_loop_and_takes_the_power() {
        let mut board = board();
        let alive = wiring::ALIVE.bit();
        for k in 0..20 {
            board.port_changed(k * 1_000_000, 2, alive, if k % 2 == 0 { alive } else { 0 });
        }
        assert!(board.truth(20_000_000).amplifier_on);
        board.take_drives();
        board.inject(Injection::EStop(true)).unwrap();
        assert_eq!(board.take_drives(), [(wiring::E_STOP, Some(false))]);
        assert!(!board.truth(20_000_000).amplifier_on);
        board.inject(Injection::EStop(false)).unwrap();
        assert!(board.truth(20_000_000).amplifier_on);
        board.advance(40_000_000);
        assert!(
            !board.truth(40_000_000).amplifier_on,
            "the alive line stopped"
        );
    }

    #[test]
    fn bad_injections_are_refused_with_a_reason() {
        let mut board = board();
        let error = board.inject(Injection::UnplugSensor(7)).unwrap_err();
        assert!(error.contains("units are 1 to 6"), "{error}");
        assert!(board.inject(Injection::UnplugSensor(0)).is_err());
        assert!(board.inject(Injection::PullCable(1, f64::NAN)).is_err());
    }

    #[test]
    fn short_strobes_and_contention_on_the_counters_bus_are_seen() {
        let mut board = board();
        let idle = wiring::IDLE[3];
        let all = 0x00FF;
        let data = wiring::CNT_DATA;
        let cs = wiring::CNT_CS[0].bit();
        let selected = (idle & !cs) | wiring::CNT_CD.bit();
        board.port_changed(0, 4, data, 0x1100);
        board.port_changed(0, 3, all, idle);
        board.port_changed(100, 3, all, selected);
        board.port_changed(200, 3, all, selected & !wiring::CNT_WR.bit());
        board.port_changed(240, 3, all, selected);
        board.port_changed(400, 3, all, selected & !wiring::CNT_RD.bit());
        board.data_sampled(440);
        let complaints = board.complaints();
        let seen: Vec<&str> = complaints.iter().map(|(_, what, _)| what).collect();
        assert!(
            seen.iter().any(|what| what.starts_with("WR low")),
            "{seen:?}"
        );
        assert!(
            seen.iter().any(|what| what.starts_with("contention")),
            "{seen:?}"
        );
        assert!(
            seen.iter().any(|what| what.starts_with("data sampled")),
            "{seen:?}"
        );
    }

    #[test]
    fn the_alive_line_and_ldac_reach_the_plant() {
        let mut board = board();
        let alive = wiring::ALIVE.bit();
        let mut t = 0;
        board.spi_set(
            Mode {
                cpol: true,
                cpha: true,
            },
            Some(true),
        );
        let f = wiring::IDLE[5];
        for k in 0..300u64 {
            t = k * 1_000_000;
            board.port_changed(t, 2, alive, if k % 2 == 0 { alive } else { 0 });
            if k == 20 {
                board.port_changed(t, 6, 0x3F, 0x3E);
                board.spi_frame(0x8D00, 16);
                board.port_changed(t, 6, 0x3F, 0x3F);
                board.port_changed(t, 5, 0xF000, f & !wiring::DAC_LDAC.bit());
                board.port_changed(t, 5, 0xF000, f);
            }
        }
        let truth = board.truth(t);
        assert!(
            (truth.dac_v[0] - 1.015_625).abs() < 1e-9,
            "{:?}",
            truth.dac_v
        );
        assert!(truth.tension_n[0] > 5.0, "{:?}", truth.tension_n);
        assert!(truth.tension_n[1] < 1.0);
        assert!(board.complaints().is_empty());
    }
}
