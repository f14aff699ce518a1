//! TCA9548A: eight-channel I2C multiplexer (TI SCPS207; control register in section 9.6.2).
//!
//! One control byte, bit n = channel n. A new mask takes effect only at the STOP that ends the
//! transaction; of several bytes written the last counts. 0x00 after power-on and after RESET,
//! which also puts the bus state machine back and is how a master frees a segment that hangs. A
//! read after a repeated START gives the byte that is stored, before it is in force.

/// The multiplexer of one segment.
#[derive(Debug, Clone)]
pub struct Tca9548a {
    address: u8,
    mask: u8,
    written: Option<u8>,
    addressed: Option<bool>,
    reset: bool,
    mute: bool,
}

impl Tca9548a {
    /// One at `address` (0x70 to 0x77), just powered on.
    #[must_use]
    pub const fn new(address: u8) -> Self {
        Self {
            address,
            mask: 0,
            written: None,
            addressed: None,
            reset: false,
            mute: false,
        }
    }

    /// START with an address. True: acknowledged, and what follows is for the multiplexer itself.
    pub fn start(&mut self, address: u8, read: bool) -> bool {
        let own = address == self.address && !self.reset && !self.mute;
        self.addressed = own.then_some(read);
        own
    }

    /// Whether the multiplexer itself is the one addressed.
    #[must_use]
    pub const fn is_addressed(&self) -> bool {
        self.addressed.is_some()
    }

    /// A byte for the control register; takes effect at the STOP.
    pub fn write(&mut self, byte: u8) -> bool {
        self.written = Some(byte);
        true
    }

    /// Reads the control register back: the last byte written, which the STOP puts in force.
    #[must_use]
    pub fn read(&self) -> u8 {
        self.written.unwrap_or(self.mask)
    }

    /// STOP: a mask that was written takes effect.
    pub fn stop(&mut self) {
        if let Some(mask) = self.written.take() {
            self.mask = mask;
        }
        self.addressed = None;
    }

    /// The RESET pin. Low clears mask and state machine and holds them.
    pub fn set_reset(&mut self, low: bool) {
        self.reset = low;
        if low {
            self.mask = 0;
            self.written = None;
            self.addressed = None;
        }
    }

    /// The chip does not answer (`true`).
    pub fn set_mute(&mut self, mute: bool) {
        self.mute = mute;
    }

    /// Channels connected now, bit n = channel n.
    #[must_use]
    pub const fn mask(&self) -> u8 {
        self.mask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_takes_effect_at_the_stop_and_the_last_byte_wins() {
        let mut mux = Tca9548a::new(0x70);
        assert!(!mux.start(0x71, false));
        assert!(mux.start(0x70, false));
        mux.write(0x01);
        mux.write(0x04);
        assert_eq!(mux.mask(), 0);
        // A repeated START is no STOP: the old channel is still the one connected.
        assert!(mux.start(0x70, true));
        assert_eq!((mux.read(), mux.mask()), (0x04, 0));
        mux.stop();
        assert_eq!(mux.mask(), 0x04);
        assert!(mux.start(0x70, true));
        assert_eq!(mux.read(), 0x04);
    }

    #[test]
    fn reset_clears_the_mask_and_holds_the_chip_off_the_bus() {
        let mut mux = Tca9548a::new(0x70);
        mux.start(0x70, false);
        mux.write(0xFF);
        mux.stop();
        mux.set_reset(true);
        assert_eq!(mux.mask(), 0);
        assert!(!mux.start(0x70, false));
        mux.set_reset(false);
        assert!(mux.start(0x70, false));
    }
}
