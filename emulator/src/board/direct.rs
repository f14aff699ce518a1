//! Operations on the chips as a whole, for a driver that has no pins: the firmware's machine on the
//! host (`core-sim`).
//!
//! The analogue side is the same as with pins; what is left out is the bit level of SPI and the
//! counters' bus.

use super::Board;
use crate::devices::dac7731::Mode;
use crate::devices::nau7802::Defects;
use plant::{Plant, TipModel};

/// SPI mode 3, as the firmware sets it.
const MODE: Mode = Mode {
    cpol: true,
    cpha: true,
};

impl Board {
    /// Writes a code to the DAC of `unit` (from 0) and loads it to its output at `t_ns`.
    ///
    /// # Panics
    /// No such unit.
    pub fn dac_code(&mut self, t_ns: u64, unit: usize, code: u16) {
        for unit in self.selected_by(unit).into_iter().flatten() {
            let dac = &mut self.dacs[unit];
            dac.select();
            dac.clock_in(u32::from(code), 16, MODE);
            dac.deselect(true);
            dac.load();
        }
        self.now_ns = self.now_ns.max(t_ns);
        self.move_outputs(t_ns);
    }

    /// RST of all DACs; `low`: their outputs are at 0 V and stay there.
    pub fn hold_dacs(&mut self, t_ns: u64, low: bool) {
        self.dacs.iter_mut().for_each(|dac| dac.set_reset(low));
        self.move_outputs(t_ns);
    }

    /// Extended position of the encoder of `unit` (from 0) at `t_ns`, counts.
    ///
    /// # Panics
    /// No such unit.
    pub fn encoder_position(&mut self, t_ns: u64, unit: usize) -> i64 {
        self.advance_plant(t_ns);
        self.frozen_encoder[unit].unwrap_or_else(|| self.encoder_edges(unit))
    }

    /// SCL rises by hand: the ninth pulse frees a held SDA.
    pub fn scl_pulse(&mut self) {
        self.recovery_pins(crate::wiring::I2C_SCL.bit());
    }

    /// RESET of the multiplexer; `low`: the part is in reset.
    pub fn mux_reset(&mut self, low: bool) {
        self.mux.set_reset(low);
        if low {
            self.release_sda();
        }
    }

    /// The robot at the cables' ends, where a model moves it ([`Plant::with_robot`]).
    pub fn robot_mut(&mut self) -> Option<&mut dyn TipModel> {
        self.plant.robot_mut()
    }

    /// What is broken at the load cell of `unit` (from 0) and in its converter, to be changed.
    ///
    /// # Panics
    /// No such unit.
    pub fn converter_defects(&mut self, unit: usize) -> &mut Defects {
        self.converters[unit].defects()
    }

    /// The amplifier of `unit` (from 0) gives this share of its current: 1 in order, 0 off,
    /// negative where the motor's wires are exchanged.
    ///
    /// # Panics
    /// No such unit.
    pub fn set_amplifier_share(&mut self, unit: usize, share: f64) {
        self.amplifier_share[unit] = share;
        self.move_outputs(self.now_ns);
    }

    /// A defect of the amplifier of `unit` (from 0) beside those that it has: its share of the
    /// current is multiplied by this one.
    ///
    /// # Panics
    /// No such unit.
    pub fn scale_amplifier(&mut self, unit: usize, share: f64) {
        self.set_amplifier_share(unit, self.amplifier_share[unit] * share);
    }

    /// The encoder of `unit` (from 0) jumps by this many counts.
    ///
    /// # Panics
    /// No such unit.
    pub fn jump_encoder(&mut self, unit: usize, counts: i64) {
        self.advance_plant(self.now_ns);
        self.encoder_jump[unit] += counts;
    }

    /// The multiplexer connects each of two converters where the other is selected.
    pub fn exchange_channels(&mut self, units: [usize; 2]) {
        self.exchanged = Some(units);
    }

    /// The plant behind the board, at the time it was last advanced to.
    #[must_use]
    pub const fn plant(&self) -> &Plant {
        &self.plant
    }
}
