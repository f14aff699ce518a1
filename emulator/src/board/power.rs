//! The amplifiers' power: alive line, E-stop, PLC and its relay, with the mistakes of their wiring.

use super::Board;
use crate::wiring::{self, UNITS};

/// What is wrong between controller, E-stop, PLC and amplifiers, and where the E-stop stands.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Power {
    pub estop_pressed: bool,
    pub alive_unplugged: bool,
    pub alive_open: bool,
    pub relay_bridged: bool,
    pub relay_inverted: bool,
    /// Amplifiers that are fed past the relay.
    pub bypassed: [bool; UNITS],
    pub estop_bridged_at_plc: bool,
    pub estop_bridged: bool,
    pub estop_inverted: bool,
}

impl Board {
    /// The alive line changes its level at `t_ns`.
    pub fn alive_edge(&mut self, t_ns: u64) {
        if self.power.alive_open || self.power.alive_unplugged {
            return;
        }
        self.plc.edge(t_ns);
        self.reschedule();
        self.switch_power(t_ns);
    }

    /// Whether the board sees a closed E-stop loop.
    #[must_use]
    pub const fn estop_closed(&self) -> bool {
        self.power.estop_bridged || self.power.estop_pressed == self.power.estop_inverted
    }

    /// Whether the amplifiers have power: the relay's side, without those that are fed past it.
    #[must_use]
    pub const fn powered(&self) -> bool {
        self.power.relay_bridged || self.plc.powered() != self.power.relay_inverted
    }

    /// The E-stop, as PLC and controller see it.
    pub(super) fn show_estop(&mut self) {
        let closed = !self.power.estop_pressed;
        (self.plc).set_estop_closed(closed || self.power.estop_bridged_at_plc);
        self.pending
            .push((wiring::E_STOP, Some(self.estop_closed())));
    }

    pub(super) fn switch_power(&mut self, t_ns: u64) {
        self.advance_plant(t_ns);
        let past = self.power.bypassed.contains(&true);
        self.plant.set_amplifier_power(self.powered() || past);
        if past {
            self.move_outputs(t_ns);
        }
    }

    /// Whether the amplifier of a unit has power, where some are fed past the relay; without any
    /// the plant's own switch decides.
    pub(super) fn feeds(&self, unit: usize) -> bool {
        let past = &self.power.bypassed;
        !past.contains(&true) || self.powered() || past[unit]
    }
}
