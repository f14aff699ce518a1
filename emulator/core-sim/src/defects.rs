//! What is broken in the controller and between it and the chips, for the fault campaign. Defects
//! of the chips are those of `emulator::board`.

use board::machine::Health;
use wire::UNITS;

/// Bits of the words on a bus.
#[derive(Debug, Clone, Copy, Default)]
pub struct Bits {
    invert: u32,
    words: u32,
    /// Bits that are always set.
    pub set: u32,
    /// Bits that are never set.
    pub clear: u32,
}

impl Bits {
    /// Inverts a bit of the next words, so many of them; `u32::MAX`: of all.
    pub fn flip(&mut self, bit: u8, words: u32) {
        (self.invert, self.words) = (1 << bit, words);
    }

    /// What arrives of a word.
    pub(crate) fn pass(&mut self, word: u32) -> u32 {
        let mut out = word;
        if self.words > 0 {
            self.words -= u32::from(self.words != u32::MAX);
            out ^= self.invert;
        }
        (out | self.set) & !self.clear
    }
}

/// See the module's page. Nothing is broken by default; units count from 0.
#[derive(Debug, Clone, Default)]
pub struct Defects {
    /// The superloop hangs; the watchdog resets the controller.
    pub hung: bool,
    /// What the superloop finds of itself, of the DACs' link and of its registers. The E-stop is
    /// the board's.
    pub health: Health,
    /// Codes of the converters.
    pub codes: [Bits; UNITS],
    /// Units whose conversions are seen twice.
    pub twice: [bool; UNITS],
    /// How often a second the counter of a unit's encoder reports noise; 0: never.
    pub encoder_noise_hz: [u32; UNITS],
    /// Words to the DACs.
    pub words: [Bits; UNITS],
    /// Units whose words reach another unit's DAC.
    pub dac_of: [Option<usize>; UNITS],
}
