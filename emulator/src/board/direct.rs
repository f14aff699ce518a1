//! Operations on the chips as a whole, for a driver that has no pins: the firmware's machine on the host (`core-sim`).
//!
//! The analogue side is the same as with pins; what is left out is the bit level of SPI and the counters' bus.

use super::Board;
use crate::devices::dac7731::Mode;
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
        let dac = &mut self.dacs[unit];
        dac.select();
        dac.clock_in(u32::from(code), 16, MODE);
        dac.deselect(true);
        dac.load();
        self.now_ns = self.now_ns.max(t_ns);
        self.move_outputs(t_ns);
    }

    /// Extended position of the encoder of `unit` (from 0) at `t_ns`, counts.
    ///
    /// # Panics
    /// No such unit.
    pub fn encoder_position(&mut self, t_ns: u64, unit: usize) -> i64 {
        self.advance_plant(t_ns);
        self.frozen_encoder[unit].unwrap_or_else(|| self.plant.encoder_counts(unit))
    }

    /// The alive line changes its level at `t_ns`.
    pub fn alive_edge(&mut self, t_ns: u64) {
        self.plc.edge(t_ns);
        self.reschedule();
        self.switch_power(t_ns);
    }

    /// Whether the E-stop loop is closed.
    #[must_use]
    pub const fn estop_closed(&self) -> bool {
        self.plc.estop_closed()
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

    /// The plant behind the board, at the time it was last advanced to.
    #[must_use]
    pub const fn plant(&self) -> &Plant {
        &self.plant
    }
}
