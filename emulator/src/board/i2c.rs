//! The I2C bus: address phase, bytes, STOP, a held SDA.

use super::{Board, ADDRESS_NS};
use crate::devices::nau7802::{self, Nau7802};
use crate::wiring::UNITS;

/// What a transaction with the converters has been so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Transaction {
    pub(super) adc: bool,
    pub(super) written: u8,
    pub(super) read: u8,
}

impl Board {
    /// Whether something holds SDA low: no START can leave the controller then.
    #[must_use]
    pub const fn sda_held(&self) -> bool {
        self.sda_held
    }

    /// Whether the multiplexer connects the converter of `unit` (from 0).
    fn is_connected(&self, unit: usize) -> bool {
        let channel = match self.exchanged {
            Some([a, b]) if unit == a => b,
            Some([a, b]) if unit == b => a,
            _ => unit,
        };
        self.mux.mask() >> channel & 1 == 1
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
                if self.is_connected(unit) {
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

    /// A byte as the other end sees it: with the bit inverted that an injection names.
    fn on_the_wire(&mut self, byte: u8) -> u8 {
        match self.flip_bus_bit.take() {
            Some(bit @ 0..8) => byte ^ 0x80 >> bit,
            Some(later) => {
                self.flip_bus_bit = Some(later - 8);
                byte
            }
            None => byte,
        }
    }

    /// A byte from the controller. True: acknowledged.
    pub fn i2c_write(&mut self, t_ns: u64, byte: u8) -> bool {
        let byte = self.on_the_wire(byte);
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
            let byte = self.mux.read();
            return self.on_the_wire(byte);
        }
        let mut byte = 0xFF;
        for unit in 0..UNITS {
            if self.is_connected(unit) {
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
        self.on_the_wire(byte)
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
}
