//! The encoder counters' parallel bus: three LS7266R1 on port E (data) and port D (control).
//!
//! Owner: the superloop, at a unit's DRDY edge; no interrupt. A read of one counter is one write
//! and three read cycles, 2 us altogether. The data lines are inputs except during a write cycle,
//! and RD# is high whenever they are outputs, so board and counter never drive against each other.
//!
//! A missed deadline does not exist: the counters count by themselves; a late read is a later
//! position.

use super::gpio;
use crate::pins::{self, Pin};
use control::{EncoderCounts, UnitIndex, UNITS};
use core::convert::Infallible;
use drivers::ls7266r1::{
    Axis, Config, CounterValue, Direction, Ls7266r1, ParallelBus, Port, PositionTracker, Target,
};

// Times in core cycles at 400 MHz. The part's minima are WR# 45 ns, RD# 80 ns, 90 ns between reads:
// 18, 32 and 36 cycles. The register accesses around each come on top: 10 ns and more.
const WRITE_CYCLES: u32 = 24;
const READ_CYCLES: u32 = 38;
const RECOVERY_CYCLES: u32 = 38;
const SETUP_CYCLES: u32 = 4;

/// MODER of port E for the data lines 8 to 15: outputs (01 each), or inputs.
const DATA_OUT: u32 = 0x5555_0000;
const DATA_MODE: u32 = 0xFFFF_0000;

/// The pins as a bus.
struct Pins;

impl Pins {
    /// C/D#, X/Y# and the chip select, which share a port, in one write; returns the select.
    fn address(target: Target, port: Port) -> Pin {
        let select = pins::CNT_CS[usize::from(target.chip) % pins::CNT_CS.len()];
        let level = |pin: Pin, high: bool| if high { pin.mask() } else { pin.mask() << 16 };
        let bits = level(pins::CNT_CD, port == Port::Control)
            | level(pins::CNT_XY, target.axis == Axis::Y)
            | level(select, false);
        // SAFETY: three pins of the bus, each either set or reset (section 11.4.7).
        gpio::registers(select.port)
            .bsrr()
            .write(|w| unsafe { w.bits(bits) });
        select
    }

    fn drive(on: bool) {
        gpio::registers(pins::CNT_DATA[0].port)
            .moder()
            .modify(|r, w| {
                // SAFETY: modes of the eight data pins only.
                unsafe { w.bits(r.bits() & !DATA_MODE | if on { DATA_OUT } else { 0 }) }
            });
    }
}

impl ParallelBus for Pins {
    type Error = Infallible;

    fn write(&mut self, target: Target, port: Port, byte: u8) -> Result<(), Infallible> {
        let select = Self::address(target, port);
        let set = u32::from(byte) << 8;
        // SAFETY: data pins only; each is either set or reset (section 11.4.7).
        gpio::registers(pins::CNT_DATA[0].port)
            .bsrr()
            .write(|w| unsafe { w.bits(set | (set ^ 0xFF00) << 16) });
        Self::drive(true);
        gpio::write(pins::CNT_WR, false);
        cortex_m::asm::delay(WRITE_CYCLES);
        gpio::write(pins::CNT_WR, true);
        cortex_m::asm::delay(SETUP_CYCLES);
        Self::drive(false);
        gpio::write(select, true);
        cortex_m::asm::delay(RECOVERY_CYCLES);
        Ok(())
    }

    fn read(&mut self, target: Target, port: Port) -> Result<u8, Infallible> {
        let select = Self::address(target, port);
        cortex_m::asm::delay(SETUP_CYCLES);
        gpio::write(pins::CNT_RD, false);
        cortex_m::asm::delay(READ_CYCLES);
        let byte = (gpio::registers(pins::CNT_DATA[0].port).idr().read().bits() >> 8) as u8;
        gpio::write(pins::CNT_RD, true);
        gpio::write(select, true);
        cortex_m::asm::delay(RECOVERY_CYCLES);
        Ok(byte)
    }
}

/// What a counter is loaded with at its start. One that loses its supply begins elsewhere, most
/// likely at 0.
const BEGIN: CounterValue = match CounterValue::new(0x55_5555) {
    Some(value) => value,
    None => CounterValue::ZERO,
};

/// Counts between two calls of [`Counters::look`], 6 ms apart, that no motor makes: 0.4 m of cable.
const LOST_COUNTS: u32 = 100_000;

/// In the detail of "encoder counter fault": the chip worked, and has lost its registers.
const LOST: u32 = 1 << 8;

/// All six counters and their positions.
pub struct Counters {
    chips: Ls7266r1<Pins>,
    positions: [PositionTracker; UNITS],
    /// Each counter at the last call of [`Self::look`]; `None`: it is to be set up.
    looked: [Option<CounterValue>; UNITS],
}

const fn target(unit: UnitIndex) -> Target {
    Target {
        chip: unit as u8 / 2,
        axis: if (unit as u8).is_multiple_of(2) {
            Axis::X
        } else {
            Axis::Y
        },
    }
}

impl Counters {
    /// Sets up and tests the counters. Returns them, and the number (from 1) of the first chip that
    /// does not respond.
    pub fn start() -> (Self, Option<u32>) {
        let mut counters = Self {
            chips: Ls7266r1::new(Pins),
            positions: [PositionTracker::new(Direction::Normal); UNITS],
            looked: [None; UNITS],
        };
        let mut broken = None;
        for unit in UnitIndex::ALL {
            if !counters.set_up(unit) {
                broken = broken.or(Some(u32::from(target(unit).chip) + 1));
            }
        }
        (counters, broken)
    }

    /// Sets a counter up and tests it; whether it works. Its position goes on from where it was.
    fn set_up(&mut self, unit: UnitIndex) -> bool {
        let target = target(unit);
        let works = self.chips.init(target, Config::MOTOR_ENCODER).is_ok()
            && self.chips.load(target, BEGIN).is_ok();
        self.positions[unit as usize].forget_last();
        self.looked[unit as usize] = works.then_some(BEGIN);
        works
    }

    /// Position of a unit's motor, now, and whether its counter has lost its registers, as after a
    /// dip of its 5 V: it stands where no motor can have brought it. Both counters of the chip are
    /// set up again then, and their positions go on from where they were. Gives the detail of the
    /// fault, once.
    pub fn look(&mut self, unit: UnitIndex) -> (EncoderCounts, Option<u32>) {
        let lost = match (self.looked[unit as usize], self.chips.read(target(unit))) {
            (Some(before), Ok(now)) => {
                self.looked[unit as usize] = Some(now);
                let lost = now.counts_since(before).unsigned_abs() > LOST_COUNTS;
                if !lost {
                    self.positions[unit as usize].update(now);
                }
                lost
            }
            (Some(_), Err(_)) => false,
            // It did not answer when it was set up. The fault is latched.
            (None, _) => {
                self.set_up(unit);
                false
            }
        };
        let chip = target(unit).chip;
        if lost {
            for other in UnitIndex::ALL {
                if target(other).chip == chip {
                    self.set_up(other);
                }
            }
        }
        let position = self.positions[unit as usize].position();
        (
            EncoderCounts(position),
            lost.then(|| (u32::from(chip) + 1) | LOST),
        )
    }

    /// Position of a unit's motor, now.
    pub fn read(&mut self, unit: UnitIndex) -> EncoderCounts {
        let position = &mut self.positions[unit as usize];
        EncoderCounts(match self.chips.read(target(unit)) {
            Ok(value) => position.update(value),
            Err(_) => position.position(),
        })
    }

    /// The FLAG register of a unit's counter if its E flag reports noise at the encoder's inputs. E
    /// is sticky: it is cleared here, so that each event is reported once.
    pub fn noise(&mut self, unit: UnitIndex) -> Option<u8> {
        let target = target(unit);
        let flags = self.chips.flags(target).ok()?;
        if !flags.noise() {
            return None;
        }
        // The bus cannot fail; if the flag stays set, it is reported again.
        let _ = self.chips.clear_noise_flag(target);
        Some(flags.bits())
    }
}
