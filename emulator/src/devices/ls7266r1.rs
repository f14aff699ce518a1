//! LS7266R1: dual 24-bit quadrature counter (LSI/CSI datasheet; registers in its "Register
//! description").
//!
//! A control write picks its register by bits 6:5 and reaches both axes with bit 7 set. CNTR is
//! loaded only through PR and read only through OL, a byte at a time by the byte pointer. Counting
//! needs IOR bit 0 (A and B enabled) and, for quadrature, a mode in CMR: both are off after
//! power-on.

use super::Complaints;

/// Counter width: 24 bits.
const MODULUS: i64 = 1 << 24;
/// WR low at least this long, in nanoseconds.
pub const WRITE_LOW_NS: u64 = 45;
/// RD low at least this long before the data may be used, in nanoseconds.
pub const READ_LOW_NS: u64 = 80;
/// RD high at least this long between two reads, in nanoseconds.
pub const READ_GAP_NS: u64 = 90;

/// FLAG bits.
pub mod flag {
    /// Borrow toggle.
    pub const BT: u8 = 0x01;
    /// Carry toggle.
    pub const CT: u8 = 0x02;
    /// Compare toggle.
    pub const CPT: u8 = 0x04;
    /// Sign: set on borrow, cleared on carry.
    pub const S: u8 = 0x08;
    /// Noise error, sticky.
    pub const E: u8 = 0x10;
    /// Last direction: up.
    pub const U_D: u8 = 0x20;
}

/// How often a counter that goes from `from` to `to` one by one comes to `place` of `modulus`.
fn passes(from: i64, to: i64, place: i64, modulus: i64) -> i64 {
    // Multiples of the modulus up to a number, from the place on.
    let up_to = |number: i64| (number - place).div_euclid(modulus);
    if to >= from {
        up_to(to) - up_to(from)
    } else {
        up_to(from - 1) - up_to(to - 1)
    }
}

#[derive(Debug, Clone, Default)]
struct Axis {
    counter: i64,
    preset: [u8; 3],
    latch: [u8; 3],
    pointer: u8,
    mode: u8,
    io: u8,
    index: u8,
    prescaler: u8,
    flags: u8,
    /// Encoder edges (x4 counts) of the shaft as last seen.
    shaft: Option<i64>,
    /// Non-recycle mode: stopped by a carry or borrow.
    stopped: bool,
}

impl Axis {
    fn preset_value(&self) -> i64 {
        i64::from(self.preset[0]) | i64::from(self.preset[1]) << 8 | i64::from(self.preset[2]) << 16
    }

    /// The shaft stands at `edges` (four per line): what the counter makes of it.
    fn turn(&mut self, edges: i64) {
        let Some(before) = self.shaft.replace(edges) else {
            return;
        };
        if before == edges || self.io & 1 == 0 {
            return;
        }
        // Edges counted per line: all four at x4, every second at x2, one otherwise. Without
        // quadrature A is the clock and B the direction, which for a quadrature encoder is one
        // count per line too.
        let shift = match self.mode >> 3 & 3 {
            3 => 0,
            2 => 1,
            _ => 2,
        };
        let step = (edges >> shift) - (before >> shift);
        if step == 0 {
            return;
        }
        self.flags = self.flags & !flag::U_D | if step > 0 { flag::U_D } else { 0 };
        let preset = self.preset_value();
        // Where the counter ends up, and the modulus: it passes `preset` once per modulus.
        let (target, modulus) = match self.mode >> 1 & 3 {
            // Range limit: stops at PR and at 0.
            1 => ((self.counter + step).clamp(0, preset), MODULUS),
            // Non-recycle: stops at the first carry or borrow until reset or load.
            2 if self.stopped => return,
            2 => ((self.counter + step).clamp(-1, MODULUS), MODULUS),
            // Modulo-N: 0 to PR.
            3 => (self.counter + step, preset + 1),
            _ => (self.counter + step, MODULUS),
        };
        self.stopped |= self.mode >> 1 & 3 == 2 && !(0..MODULUS).contains(&target);
        if passes(self.counter, target, preset, modulus) & 1 == 1 {
            self.flags ^= flag::CPT;
        }
        self.wrap(target, modulus);
    }

    fn wrap(&mut self, target: i64, modulus: i64) {
        if target >= modulus {
            self.flags = (self.flags ^ flag::CT) & !flag::S;
        } else if target < 0 {
            self.flags = (self.flags ^ flag::BT) | flag::S;
        }
        self.counter = target.rem_euclid(modulus);
    }

    fn control(&mut self, value: u8, name: &str, complaints: &mut Complaints) {
        let bits = value & 0x1F;
        match value >> 5 & 3 {
            0 => {
                if bits & 0x01 != 0 {
                    self.pointer = 0;
                }
                match bits >> 1 & 3 {
                    1 => {
                        self.counter = 0;
                        self.stopped = false;
                    }
                    2 => self.flags &= !(flag::BT | flag::CT | flag::CPT | flag::S),
                    3 => self.flags &= !flag::E,
                    _ => {}
                }
                match bits >> 3 & 3 {
                    1 => {
                        self.counter = self.preset_value();
                        self.stopped = false;
                    }
                    2 => {
                        let [low, middle, high, ..] = self.counter.to_le_bytes();
                        self.latch = [low, middle, high];
                    }
                    3 => self.prescaler = self.preset[0],
                    _ => {}
                }
            }
            1 => {
                self.mode = bits;
                if bits & 1 != 0 {
                    complaints.add(format!("{name}.CMR"), "BCD counting is not modelled");
                }
            }
            2 => self.io = bits,
            _ => self.index = bits,
        }
    }
}

/// One chip: axes X and Y.
#[derive(Debug, Clone)]
pub struct Ls7266r1 {
    name: String,
    axes: [Axis; 2],
}

impl Ls7266r1 {
    /// Chip number `number` (from 1), just powered on.
    #[must_use]
    pub fn new(number: usize) -> Self {
        Self {
            name: format!("LS7266R1[{number}]"),
            axes: Default::default(),
        }
    }

    /// The encoder of `axis` (0 = X, 1 = Y) stands at `edges`, four per line.
    pub fn turn(&mut self, axis: usize, edges: i64) {
        self.axes[axis].turn(edges);
    }

    /// WR rises with `value` on the bus.
    pub fn write(&mut self, axis: usize, control: bool, value: u8, complaints: &mut Complaints) {
        if control {
            if value & 0x80 != 0 {
                self.axes[0].control(value, &self.name, complaints);
                self.axes[1].control(value, &self.name, complaints);
            } else {
                self.axes[axis].control(value, &self.name, complaints);
            }
        } else {
            let axis = &mut self.axes[axis];
            axis.preset[usize::from(axis.pointer)] = value;
            axis.pointer = (axis.pointer + 1) % 3;
        }
    }

    /// What the chip puts on the bus while RD is low.
    #[must_use]
    pub fn read(&self, axis: usize, control: bool) -> u8 {
        let axis = &self.axes[axis];
        if control {
            axis.flags
        } else {
            axis.latch[usize::from(axis.pointer)]
        }
    }

    /// RD rises: a data read moves the byte pointer on.
    pub fn read_done(&mut self, axis: usize, control: bool) {
        if !control {
            let axis = &mut self.axes[axis];
            axis.pointer = (axis.pointer + 1) % 3;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Bus(Ls7266r1, Complaints);

    impl Bus {
        fn new() -> Self {
            Self(Ls7266r1::new(1), Complaints::default())
        }

        fn control(&mut self, axis: usize, value: u8) {
            self.0.write(axis, true, value, &mut self.1);
        }

        /// Both axes x4, A and B on.
        fn set_up(&mut self) {
            self.control(0, 0xA0 | 0x18);
            self.control(0, 0xC0 | 0x01);
            self.0.turn(0, 0);
            self.0.turn(1, 0);
        }

        fn data(&mut self, axis: usize) -> u8 {
            let byte = self.0.read(axis, false);
            self.0.read_done(axis, false);
            byte
        }

        fn count(&mut self, axis: usize) -> u32 {
            self.control(axis, 0x11);
            let bytes = [self.data(axis), self.data(axis), self.data(axis)];
            u32::from_le_bytes([bytes[0], bytes[1], bytes[2], 0])
        }
    }

    #[test]
    fn nothing_counts_after_power_on() {
        let mut bus = Bus::new();
        bus.0.turn(0, 0);
        bus.0.turn(0, 1000);
        assert_eq!(bus.count(0), 0);
    }

    #[test]
    fn modes_count_every_edge_every_second_or_one_in_four() {
        for (mode, counts) in [(0x18, 1000), (0x10, 500), (0x08, 250), (0x00, 250)] {
            let mut bus = Bus::new();
            bus.set_up();
            bus.control(0, 0x20 | mode);
            bus.0.turn(0, 1000);
            assert_eq!(bus.count(0), counts);
        }
    }

    #[test]
    fn axes_are_apart_and_wrap_at_24_bits() {
        let mut bus = Bus::new();
        bus.set_up();
        bus.0.turn(0, -3);
        bus.0.turn(1, 7);
        assert_eq!(bus.count(0), 0xFF_FFFD);
        assert_eq!(bus.count(1), 7);
        assert_eq!(bus.0.read(0, true), flag::BT | flag::S);
        assert_eq!(bus.0.read(1, true), flag::U_D);
        bus.0.turn(0, 5);
        assert_eq!(bus.count(0), 5);
        // On its way it came to 0, which is what PR holds.
        let flags = flag::BT | flag::CT | flag::CPT | flag::U_D;
        assert_eq!(bus.0.read(0, true), flags);
    }

    #[test]
    fn the_latch_holds_and_the_byte_pointer_walks() {
        let mut bus = Bus::new();
        bus.set_up();
        bus.0.turn(0, 0x12_3456);
        bus.control(0, 0x11);
        bus.0.turn(0, 0);
        assert_eq!([bus.data(0), bus.data(0), bus.data(0)], [0x56, 0x34, 0x12]);
        assert_eq!(bus.data(0), 0x56, "three bytes and round again");
        bus.control(0, 0x10);
        assert_eq!(
            bus.data(0),
            0x00,
            "latched, pointer not reset: the middle byte of 0"
        );
    }

    #[test]
    fn the_counter_is_loaded_through_pr_only() {
        let mut bus = Bus::new();
        bus.set_up();
        bus.control(0, 0x01);
        for byte in [0x01, 0x02, 0x80] {
            bus.0.write(0, false, byte, &mut bus.1);
        }
        assert_eq!(bus.count(0), 0);
        bus.control(0, 0x08);
        assert_eq!(bus.count(0), 0x80_0201);
        bus.control(0, 0x02);
        assert_eq!(bus.count(0), 0);
    }

    /// The shaft moves by many counts between two looks of the board; the counter has counted each.
    #[test]
    fn a_count_that_passes_the_preset_toggles_the_compare_flag() {
        let mut bus = Bus::new();
        bus.set_up();
        for byte in [100, 0, 0] {
            bus.0.write(0, false, byte, &mut bus.1);
        }
        let compare = |bus: &Bus| bus.0.read(0, true) & flag::CPT != 0;
        let mut toggled = false;
        for (edges, toggles) in [
            (99, false),
            (100, true),
            (101, false),
            (250, false),
            (50, true),
            (150, true),
            (100, true),
            (99, false),
            (120 + MODULUS, false),
            (120 + 2 * MODULUS, true),
        ] {
            bus.0.turn(0, edges);
            toggled ^= toggles;
            assert_eq!(compare(&bus), toggled, "at {edges}");
        }
        bus.control(0, 0x04);
        assert!(!compare(&bus));
    }

    #[test]
    fn non_recycle_stops_at_the_first_carry() {
        let mut bus = Bus::new();
        bus.set_up();
        bus.control(0, 0x20 | 0x18 | 0x04);
        bus.0.turn(0, MODULUS + 5);
        bus.0.turn(0, MODULUS + 9);
        assert_eq!(bus.count(0), 0);
        bus.control(0, 0x02);
        bus.0.turn(0, MODULUS + 12);
        assert_eq!(bus.count(0), 3);
    }

    #[test]
    fn modulo_n_and_range_limit() {
        let mut bus = Bus::new();
        bus.set_up();
        bus.0.write(0, false, 99, &mut bus.1);
        bus.control(0, 0x20 | 0x18 | 0x06);
        bus.0.turn(0, 105);
        assert_eq!(bus.count(0), 5);
        bus.control(0, 0x20 | 0x18 | 0x02);
        bus.0.turn(0, 100_000);
        assert_eq!(bus.count(0), 99);
    }
}
