//! The latency probe: follows each sample from the DRDY edge to the motor, from outside the
//! firmware.
//!
//! It sees what a logic analyser on the board would see (DRDY, the START conditions, the bytes,
//! LDAC) and two things that only an emulator can: when a data word reaches the SPI's register, and
//! how many instructions were retired meanwhile.

use crate::wiring::UNITS;
use emulator_link::Latency;

/// Most entries kept between two reports; older ones are dropped first.
const KEPT: usize = 1 << 18;

#[derive(Debug, Clone, Copy, Default)]
struct Open {
    latency: Latency,
    /// Instruction count when the data was there; `None` until the engine reports it.
    instructions: Option<u64>,
    word_seen: bool,
}

/// See the module's page.
#[derive(Debug, Clone, Default)]
pub struct Probe {
    drdy_ns: [u64; UNITS],
    mux_start: Option<u64>,
    adc_start: Option<u64>,
    open: [Option<Open>; UNITS],
    /// Word written to the SPI while no chip was selected: the select is then yet to come.
    unselected_word: Option<(u64, u64)>,
    awaiting_count: bool,
    done: Vec<Latency>,
    dropped: u64,
}

impl Probe {
    /// DRDY of `unit` (from 0) rises.
    pub fn drdy(&mut self, unit: usize, t_ns: u64) {
        self.drdy_ns[unit] = t_ns;
    }

    /// A START with the multiplexer's address leaves.
    pub fn mux_start(&mut self, t_ns: u64) {
        self.mux_start = Some(t_ns);
    }

    /// A START with a converter's address leaves.
    pub fn adc_start(&mut self, t_ns: u64) {
        self.adc_start.get_or_insert(t_ns);
    }

    /// A transaction with a converter ended and was not part of reading a result.
    pub fn other_transaction(&mut self) {
        self.adc_start = None;
        self.mux_start = None;
    }

    /// The last byte of a result of `unit` is in the receive register.
    pub fn data(&mut self, unit: usize, t_ns: u64) {
        let drdy_ns = self.drdy_ns[unit];
        let select = self.mux_start.take().filter(|start| *start >= drdy_ns);
        let read = self.adc_start.take().unwrap_or(t_ns);
        self.open[unit] = Some(Open {
            latency: Latency {
                unit: unit as u8 + 1,
                drdy_ns,
                bus_start_ns: select.unwrap_or(read),
                data_ns: t_ns,
                mux_select: select.is_some(),
                ..Latency::default()
            },
            ..Open::default()
        });
        self.awaiting_count = true;
    }

    /// The engine stopped with `instructions` retired: the count that belongs to data just seen.
    pub fn counted(&mut self, instructions: u64) {
        if std::mem::take(&mut self.awaiting_count) {
            for open in self.open.iter_mut().flatten() {
                open.instructions.get_or_insert(instructions);
            }
        }
    }

    /// A data word is written to the SPI with `instructions` retired, while the chips of `selected`
    /// units are selected.
    pub fn spi_word(&mut self, t_ns: u64, instructions: u64, selected: [bool; UNITS]) {
        if selected == [false; UNITS] {
            self.unselected_word.get_or_insert((t_ns, instructions));
            return;
        }
        for unit in (0..UNITS).filter(|unit| selected[*unit]) {
            self.word(unit, t_ns, instructions);
        }
    }

    /// The chip of `unit` is selected.
    pub fn selected(&mut self, unit: usize) {
        if let Some((t_ns, instructions)) = self.unselected_word.take() {
            self.word(unit, t_ns, instructions);
        }
    }

    fn word(&mut self, unit: usize, t_ns: u64, instructions: u64) {
        if let Some(open) = self.open[unit].as_mut().filter(|open| !open.word_seen) {
            open.word_seen = true;
            open.latency.dac_word_ns = t_ns;
            let since = open.instructions.unwrap_or(instructions);
            open.latency.instructions = instructions.saturating_sub(since);
        }
    }

    /// LDAC moved the output of `unit`.
    pub fn updated(&mut self, unit: usize, t_ns: u64) {
        if let Some(mut open) = self.open[unit].take_if(|open| open.word_seen) {
            open.latency.dac_update_ns = t_ns;
            if self.done.len() == KEPT {
                self.done.remove(0);
                self.dropped += 1;
            }
            self.done.push(open.latency);
        }
    }

    /// The controller went through a reset: nothing under way will arrive.
    pub fn reset(&mut self) {
        self.open = Default::default();
        self.other_transaction();
        self.unselected_word = None;
    }

    /// The entries since the last call.
    pub fn take(&mut self) -> Vec<Latency> {
        std::mem::take(&mut self.done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_followed_from_edge_to_update() {
        let mut probe = Probe::default();
        probe.drdy(2, 1_000);
        probe.mux_start(2_000);
        probe.adc_start(60_000);
        probe.adc_start(90_000);
        probe.data(2, 150_000);
        probe.counted(5_000);
        probe.spi_word(152_000, 5_400, [false, false, true, false, false, false]);
        probe.updated(0, 153_000);
        probe.updated(2, 155_000);
        probe.updated(2, 156_000);
        let expected = Latency {
            unit: 3,
            drdy_ns: 1_000,
            bus_start_ns: 2_000,
            data_ns: 150_000,
            dac_word_ns: 152_000,
            dac_update_ns: 155_000,
            instructions: 400,
            mux_select: true,
        };
        assert_eq!(probe.take(), [expected]);
        assert!(probe.take().is_empty());
    }

    #[test]
    fn a_channel_selected_ahead_of_the_edge_is_no_part_of_the_sample() {
        let mut probe = Probe::default();
        probe.mux_start(500);
        probe.drdy(0, 100_000);
        probe.adc_start(101_000);
        probe.data(0, 190_000);
        probe.spi_word(191_000, 7, [false; UNITS]);
        probe.selected(0);
        probe.updated(0, 192_000);
        let latency = probe.take()[0];
        assert!(!latency.mux_select);
        assert_eq!(
            (latency.bus_start_ns, latency.dac_word_ns),
            (101_000, 191_000)
        );
    }
}
