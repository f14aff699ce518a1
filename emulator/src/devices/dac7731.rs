//! DAC7731: 16-bit bipolar DAC (TI SBAS249; serial timing in its figure 1, codes in table 2).
//!
//! The shift register takes SDI on the rising SCLK edge while CS is low. Rising CS ends the word;
//! while SCLK is low at that instant one more bit is shifted. Rising LDAC moves the shift register
//! to the output, whatever it holds and wherever CS stands: a load within a word gives a voltage of
//! two words. Drivers that never raise CS rely on it. RST low puts both to mid-scale (RSTSEL high).
//! Straight binary: 0x0000 = -full scale, 0x8000 = 0 V.

/// SPI clock polarity and phase as the controller is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mode {
    /// Clock idles high.
    pub cpol: bool,
    /// Data is captured on the second edge of a clock period.
    pub cpha: bool,
}

impl Mode {
    /// Whether the controller holds its data steady around the rising clock edge, which is where
    /// this chip samples: modes 0 and 3.
    #[must_use]
    pub const fn steady_on_rising(self) -> bool {
        self.cpol == self.cpha
    }
}

/// Code for 0 V.
pub const MID_SCALE: u16 = 0x8000;
/// Full scale with the +-10 V strap.
pub const FULL_SCALE_V: f64 = 10.0;

/// One converter.
#[derive(Debug, Clone)]
pub struct Dac7731 {
    shift: u16,
    output: u16,
    selected: bool,
    last_bit: bool,
    reset: bool,
    stuck: bool,
    ldac_open: bool,
}

impl Default for Dac7731 {
    fn default() -> Self {
        Self {
            shift: MID_SCALE,
            output: MID_SCALE,
            selected: false,
            last_bit: false,
            reset: false,
            stuck: false,
            ldac_open: false,
        }
    }
}

impl Dac7731 {
    /// CS falls.
    pub fn select(&mut self) {
        self.selected = true;
    }

    /// Whether CS is low.
    #[must_use]
    pub const fn is_selected(&self) -> bool {
        self.selected
    }

    /// `bits` bits cross, first bit on the wire in the most significant place of `word`.
    pub fn clock_in(&mut self, word: u32, bits: u8, mode: Mode) {
        if !self.selected || self.reset {
            return;
        }
        for n in (0..bits).rev() {
            let bit = (word >> n) & 1 == 1;
            // In modes 1 and 2 the controller changes its data at the very edge this chip samples
            // on; the chip then sees what was there before the edge.
            let seen = if mode.steady_on_rising() {
                bit
            } else {
                self.last_bit
            };
            self.shift = self.shift << 1 | u16::from(seen);
            self.last_bit = bit;
        }
    }

    /// CS rises with SCLK at the given level. Returns whether an extra bit was shifted in.
    pub fn deselect(&mut self, sclk_high: bool) -> bool {
        if !self.selected {
            return false;
        }
        self.selected = false;
        if self.reset {
            return false;
        }
        if !sclk_high {
            self.shift = self.shift << 1 | u16::from(self.last_bit);
        }
        !sclk_high
    }

    /// LDAC rises.
    pub fn load(&mut self) {
        if !self.reset && !self.stuck && !self.ldac_open {
            self.output = self.shift;
        }
    }

    /// The RST pin. Low: mid-scale, held.
    pub fn set_reset(&mut self, low: bool) {
        self.reset = low;
        if low {
            self.shift = MID_SCALE;
            if !self.stuck {
                self.output = MID_SCALE;
            }
        }
    }

    /// The output keeps its voltage (`true`), as a broken part does.
    pub fn set_stuck(&mut self, stuck: bool) {
        self.stuck = stuck;
    }

    /// LDAC has no wire (`true`): it never rises.
    pub fn set_ldac_open(&mut self, open: bool) {
        self.ldac_open = open;
    }

    /// The code at the output.
    #[must_use]
    pub const fn code(&self) -> u16 {
        self.output
    }

    /// Output in volts.
    #[must_use]
    pub fn volts(&self) -> f64 {
        (f64::from(self.output) - f64::from(MID_SCALE)) / f64::from(MID_SCALE) * FULL_SCALE_V
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODE3: Mode = Mode {
        cpol: true,
        cpha: true,
    };
    const MODE0: Mode = Mode {
        cpol: false,
        cpha: false,
    };
    const MODE1: Mode = Mode {
        cpol: false,
        cpha: true,
    };

    fn send(dac: &mut Dac7731, word: u16, mode: Mode) -> bool {
        dac.select();
        dac.clock_in(u32::from(word), 16, mode);
        let extra = dac.deselect(mode.cpol);
        dac.load();
        extra
    }

    #[test]
    fn codes_are_straight_binary() {
        let mut dac = Dac7731::default();
        assert_eq!(dac.volts(), 0.0);
        for (code, volts) in [
            (0x0000, -10.0),
            (0x4000, -5.0),
            (0x8000, 0.0),
            (0xC000, 5.0),
        ] {
            assert!(!send(&mut dac, code, MODE3));
            assert_eq!(dac.volts(), volts);
        }
    }

    #[test]
    fn cs_rising_with_the_clock_low_shifts_one_bit_more() {
        let mut dac = Dac7731::default();
        assert!(send(&mut dac, 0x8001, MODE0));
        assert_eq!(dac.code(), 0x0003);
    }

    #[test]
    fn a_mode_that_moves_data_on_the_rising_edge_is_a_bit_late() {
        let mut dac = Dac7731::default();
        dac.select();
        dac.clock_in(0x8001, 16, MODE1);
        dac.deselect(true);
        dac.load();
        assert_eq!(dac.code(), 0x4000);
    }

    #[test]
    fn two_bytes_are_one_word_and_nothing_moves_before_ldac() {
        let mut dac = Dac7731::default();
        dac.select();
        dac.clock_in(0xC0, 8, MODE3);
        dac.clock_in(0x00, 8, MODE3);
        dac.deselect(true);
        assert_eq!(dac.volts(), 0.0);
        dac.load();
        assert_eq!(dac.volts(), 5.0);
    }

    #[test]
    fn a_load_within_a_word_takes_the_bits_of_two() {
        let mut dac = Dac7731::default();
        send(&mut dac, 0x8123, MODE3);
        dac.select();
        dac.clock_in(0x7F, 8, MODE3);
        dac.load();
        assert_eq!(dac.code(), 0x237F);
        dac.clock_in(0xFF, 8, MODE3);
        dac.deselect(true);
        assert_eq!(dac.code(), 0x237F);
        dac.load();
        assert_eq!(dac.code(), 0x7FFF);
    }

    #[test]
    fn a_select_that_stays_low_works_word_by_word() {
        let mut dac = Dac7731::default();
        dac.select();
        for word in [0xC000, 0x4000] {
            dac.clock_in(word, 16, MODE3);
            dac.load();
            assert_eq!(u32::from(dac.code()), word);
        }
    }

    #[test]
    fn an_unselected_chip_hears_nothing() {
        let mut dac = Dac7731::default();
        dac.clock_in(0x1234, 16, MODE3);
        dac.deselect(true);
        dac.load();
        assert_eq!(dac.code(), MID_SCALE);
    }

    #[test]
    fn reset_is_zero_volts_and_holds() {
        let mut dac = Dac7731::default();
        send(&mut dac, 0xFFFF, MODE3);
        dac.set_reset(true);
        assert_eq!(dac.volts(), 0.0);
        send(&mut dac, 0xFFFF, MODE3);
        assert_eq!(dac.volts(), 0.0);
        dac.set_reset(false);
        dac.load();
        assert_eq!(dac.volts(), 0.0);
    }
}
