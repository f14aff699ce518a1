//! Pins of the controller: levels, E-stop, alive line, DAC selects and LDAC, and SPI frames to the
//! DACs.

use super::{Board, Drive, Port, RECOVERY_PULSES};
use crate::devices::dac7731::{Dac7731, Mode};
use crate::wiring::{self, UNITS};
use emulator_link::DacResetPull;

impl Board {
    /// What the board changed on the controller's pins since the last call.
    pub fn take_drives(&mut self) -> Vec<Drive> {
        std::mem::take(&mut self.pending)
    }

    /// Whether there is something for [`Board::take_drives`].
    #[must_use]
    pub fn has_drives(&self) -> bool {
        !self.pending.is_empty()
    }

    pub(super) fn show_drdy(&mut self, _t_ns: u64) {
        for unit in 0..UNITS {
            let source = self.wired.drdy[unit];
            let level = if self.drdy_cut[unit] {
                // The pull-down holds what nothing drives.
                Some(false)
            } else {
                self.converters[source].drdy()
            };
            if level != self.drdy[unit] {
                if level == Some(true) && self.lose_drdy[unit] > 0 {
                    // The wire stays low until the next conversion.
                    self.lose_drdy[unit] -= 1;
                    self.converters[source].miss();
                    continue;
                }
                self.drdy[unit] = level;
                self.pending.push((wiring::DRDY[unit], level));
            }
        }
    }

    /// Levels of a port's lines that nothing drives.
    pub(super) fn idle(&self, port: usize) -> u16 {
        let high = port == wiring::DAC_RST.port && self.dac_reset_pull != DacResetPull::Down;
        wiring::IDLE[port] | if high { wiring::DAC_RST.bit() } else { 0 }
    }

    /// Puts the level of its resistor on DAC_RST. The DACs see it with the next reset of the
    /// controller.
    pub(super) fn show_dac_reset(&mut self) {
        let level = match self.dac_reset_pull {
            DacResetPull::Down => Some(false),
            DacResetPull::None => None,
            DacResetPull::Up => Some(true),
        };
        self.pending.push((wiring::DAC_RST, level));
    }

    /// The controller's output stages of `port` are now on for the bits of `driven` with the levels
    /// of `level`. Open-drain outputs that are high count as not driven.
    pub fn port_changed(&mut self, t_ns: u64, port: usize, driven: u16, level: u16) {
        let idle = self.idle(port);
        let before = self.ports[port].seen(idle);
        let drove = self.ports[port].driven;
        self.ports[port] = Port { driven, level };
        let after = self.ports[port].seen(idle);
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
            C if (rose | fell) & wiring::ALIVE.bit() != 0 => self.alive_edge(t_ns),
            D => self.counter_pins(t_ns, before, after),
            E => self.check_contention(),
            F => self.control_pins(t_ns, rose, fell),
            G => self.dac_selects(rose, fell),
            _ => {}
        }
    }

    /// SCL pulses by hand: the ninth frees a held SDA.
    pub(super) fn recovery_pins(&mut self, rose: u16) {
        if self.sda_held && rose & wiring::I2C_SCL.bit() != 0 {
            self.scl_pulses = self.scl_pulses.saturating_add(1);
            if self.scl_pulses >= RECOVERY_PULSES {
                self.release_sda();
            }
        }
    }

    pub(super) fn release_sda(&mut self) {
        if self.sda_held && !self.sda_jammed {
            self.sda_held = false;
            self.pending.push((wiring::I2C_SDA, None));
        }
    }

    pub(super) fn control_pins(&mut self, t_ns: u64, rose: u16, fell: u16) {
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
                        "LDAC rose while CS was low: the output takes what the shift register holds within the word",
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

    pub(super) fn move_outputs(&mut self, t_ns: u64) {
        self.advance_plant(t_ns);
        for (unit, dac) in self.dacs.iter().enumerate() {
            let volts = self
                .outside_v
                .map_or_else(|| dac.volts(), |outside_v| outside_v[unit]);
            // An amplifier that is off gives 0, not the -0 of a product.
            let volts = match self.amplifier_share[unit] {
                0.0 => 0.0,
                _ if !self.feeds(unit) => 0.0,
                share => share * volts,
            };
            self.plant
                .set_amplifier_volts(self.wired.motor[unit], volts)
                .expect("six units, finite volts");
        }
    }

    /// DACs that the select wire of a unit reaches: a wire that touches it is pulled low with it.
    pub(super) fn selected_by(&self, unit: usize) -> [Option<usize>; 2] {
        match self.tied {
            Some([a, b]) if unit == a => [Some(a), Some(b)],
            Some([a, b]) if unit == b => [Some(b), Some(a)],
            _ => [Some(unit), None],
        }
    }

    pub(super) fn dac_selects(&mut self, rose: u16, fell: u16) {
        for (line, cs) in wiring::DAC_CS.iter().enumerate() {
            for unit in self.selected_by(line).into_iter().flatten() {
                self.dac_select(unit, fell & cs.bit() != 0, rose & cs.bit() != 0);
            }
        }
    }

    fn dac_select(&mut self, unit: usize, fell: bool, rose: bool) {
        if fell {
            self.dacs[unit].select();
            self.probe.selected(unit);
        } else if rose {
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
        let word = match self.flip_dac_bit.take() {
            Some(bit) => word ^ 1 << bit,
            None => word,
        };
        for dac in &mut self.dacs {
            dac.clock_in(word, bits, self.spi_mode);
        }
    }
}
