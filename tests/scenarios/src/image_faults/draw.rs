//! Which bit of the running controller changes, and when: drawn from a seed, case by case.

use emulator::image::Image;
use emulator_link::Injection;
use faults::random::Random;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Where a bit changes: the rows of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Place {
    /// Registers of the core, of the code that an exception interrupts.
    Core,
    /// Variables: `.data` and `.bss`.
    Variables,
    /// The part of the stack that is in use; the superloop's state lies there.
    Stack,
    /// Registers of the peripherals that the firmware sets up.
    Register,
}

impl Place {
    /// All of them, in the order in which the cases take them.
    pub const ALL: [Self; 4] = [Self::Core, Self::Variables, Self::Stack, Self::Register];

    /// Name in the table.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Core => "core registers",
            Self::Variables => "variables",
            Self::Stack => "stack",
            Self::Register => "peripheral registers",
        }
    }
}

/// Memory of the image from which addresses are drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Memory {
    /// Variables.
    pub variables: Range<u32>,
    /// The part of the stack that is in use.
    pub stack: Range<u32>,
}

impl Memory {
    /// The variables and the stack of an image, of which the uppermost `used` bytes are in use.
    ///
    /// # Errors
    /// The image does not name them.
    pub fn of(image: &Image, used: u32) -> Result<Self, String> {
        let missing = |what: &str| format!("{} does not name its {what}", image.path.display());
        let stack = image.stack.clone().ok_or_else(|| missing("stack"))?;
        Ok(Self {
            variables: (image.variables.clone()).ok_or_else(|| missing("variables"))?,
            stack: stack.end.saturating_sub(used).max(stack.start)..stack.end,
        })
    }
}

/// A peripheral's registers: name, address of the first, offsets.
struct Peripheral(&'static str, u32, &'static [u32]);

/// Registers that configure what the firmware uses (RM0433 sections 4.9, 6.8, 8.7, 11.4, 12.3,
/// 15.5, 17.6, 20.6, 38.4, 47.7, 48.7, 50.11).
const PERIPHERALS: &[Peripheral] = &[
    Peripheral("SPI1", 0x4001_3000, &[0x00, 0x04, 0x08, 0x0C, 0x10, 0x50]),
    Peripheral("I2C1", 0x4000_5400, &[0x00, 0x04, 0x08, 0x10]),
    Peripheral("USART3", 0x4000_4800, &[0x00, 0x04, 0x08, 0x0C, 0x2C]),
    Peripheral(
        "DMA1",
        0x4002_0000,
        &[0x10, 0x14, 0x18, 0x1C, 0x24, 0x28, 0x2C, 0x30, 0x34, 0x3C],
    ),
    Peripheral("DMAMUX1", 0x4002_0800, &[0x00, 0x04]),
    Peripheral("TIM2", 0x4000_0000, &[0x00, 0x0C, 0x28, 0x2C, 0x34]),
    Peripheral("EXTI", 0x5800_0000, &[0x00, 0x04, 0x80]),
    Peripheral("SYSCFG", 0x5800_0400, &[0x08, 0x0C, 0x10]),
    Peripheral("FLASH", 0x5200_2000, &[0x00]),
    Peripheral("PWR", 0x5802_4800, &[0x0C, 0x18]),
    Peripheral(
        "RCC",
        0x5802_4400,
        &[
            0x00, 0x10, 0x18, 0x1C, 0x20, 0x28, 0x2C, 0x30, 0x50, 0x54, 0xD8, 0xE0, 0xE8, 0xF0,
            0xF4,
        ],
    ),
    Peripheral("GPIOA", 0x5802_0000, PORT),
    Peripheral("GPIOB", 0x5802_0400, PORT),
    Peripheral("GPIOC", 0x5802_0800, PORT),
    Peripheral("GPIOD", 0x5802_0C00, PORT),
    Peripheral("GPIOE", 0x5802_1000, PORT),
    Peripheral("GPIOF", 0x5802_1400, PORT),
    Peripheral("GPIOG", 0x5802_1800, PORT),
];

/// MODER, OTYPER, OSPEEDR, PUPDR, ODR, AFRL, AFRH.
const PORT: &[u32] = &[0x00, 0x04, 0x08, 0x0C, 0x14, 0x20, 0x24];

/// Exceptions whose interrupted code is hit: SysTick and SPI1 (interrupt 35), which come while
/// every stage of the superloop runs.
const EXCEPTIONS: [u8; 2] = [15, 16 + 35];

/// A bit that changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Flip {
    /// Where.
    pub place: Place,
    /// How the rig does it.
    pub injection: Injection,
    /// In words.
    pub what: String,
}

impl Flip {
    /// A bit of a peripheral's register.
    #[must_use]
    pub fn register(name: &str, address: u32, bit: u8) -> Self {
        Self {
            place: Place::Register,
            injection: Injection::FlipRegister(address, bit),
            what: format!("{name} at {address:#010x}, bit {bit}"),
        }
    }

    fn memory(place: Place, within: &Range<u32>, r: &mut Random) -> Self {
        let address = within.start + r.below(within.len() as u64) as u32;
        let bit = r.below(8) as u8;
        Self {
            place,
            injection: Injection::FlipBit(address, bit),
            what: format!("byte at {address:#010x}, bit {bit}"),
        }
    }

    fn draw(place: Place, memory: &Memory, r: &mut Random) -> Self {
        match place {
            Place::Core => {
                let exception = EXCEPTIONS[r.below(EXCEPTIONS.len() as u64) as usize];
                let register = r.below(17) as u8;
                let bit = r.below(32) as u8;
                let name = match register {
                    13 => "SP".to_owned(),
                    14 => "LR".to_owned(),
                    15 => "PC".to_owned(),
                    16 => "xPSR".to_owned(),
                    number => format!("R{number}"),
                };
                Self {
                    place,
                    injection: Injection::FlipCore(exception, register, bit),
                    what: format!("{name} at exception {exception}, bit {bit}"),
                }
            }
            Place::Variables => Self::memory(place, &memory.variables, r),
            Place::Stack => Self::memory(place, &memory.stack, r),
            Place::Register => {
                let Peripheral(name, first, offsets) =
                    &PERIPHERALS[r.below(PERIPHERALS.len() as u64) as usize];
                let offset = offsets[r.below(offsets.len() as u64) as usize];
                Self::register(name, first + offset, r.below(32) as u8)
            }
        }
    }
}

/// What a case does.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Number of the case.
    pub number: u64,
    /// Seed of the plant.
    pub seed: u64,
    /// Tension of each cable, N.
    pub hold_n: f64,
    /// Time after arming at which the bit changes, in microseconds.
    pub at_us: u64,
    /// The bits, in the order in which they are tried: the rig refuses those that do not exist.
    pub flips: Vec<Flip>,
}

impl Plan {
    /// Bits that are drawn for a case.
    const TRIES: usize = 20;

    /// The plan of a case: the places in turn.
    #[must_use]
    pub fn draw(seed: u64, number: u64, memory: &Memory) -> Self {
        let mut r = Random::stream(seed, number);
        let place = Place::ALL[(number % Place::ALL.len() as u64) as usize];
        Self::of(seed, number, &mut r, |r| {
            (0..Self::TRIES)
                .map(|_| Flip::draw(place, memory, r))
                .collect()
        })
    }

    /// A case whose bit is known.
    #[must_use]
    pub fn known(seed: u64, number: u64, flip: Flip) -> Self {
        let mut r = Random::stream(seed, number);
        Self::of(seed, number, &mut r, |_| vec![flip])
    }

    fn of(
        seed: u64,
        number: u64,
        r: &mut Random,
        flips: impl FnOnce(&mut Random) -> Vec<Flip>,
    ) -> Self {
        Self {
            number,
            seed: seed.wrapping_mul(1_000).wrapping_add(number % 8 + 1),
            hold_n: r.between(3.0, 8.0),
            at_us: 50_000 + r.below(60_000),
            flips: flips(r),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory() -> Memory {
        Memory {
            variables: 0x2400_0000..0x2400_1000,
            stack: 0x2001_0000..0x2002_0000,
        }
    }

    #[test]
    fn a_plan_is_the_same_in_every_run_and_stays_within_its_place() {
        for number in 0..200 {
            let plan = Plan::draw(3, number, &memory());
            assert_eq!(plan, Plan::draw(3, number, &memory()));
            for flip in &plan.flips {
                assert_eq!(flip.place, Place::ALL[(number % 4) as usize]);
                match flip.injection {
                    Injection::FlipBit(at, bit) => {
                        let memory = memory();
                        assert!(memory.variables.contains(&at) || memory.stack.contains(&at));
                        assert!(bit < 8);
                    }
                    Injection::FlipRegister(at, bit) => assert!(at.is_multiple_of(4) && bit < 32),
                    Injection::FlipCore(_, register, bit) => assert!(register <= 16 && bit < 32),
                    other => panic!("{other:?}"),
                }
            }
        }
        assert_ne!(Plan::draw(3, 1, &memory()), Plan::draw(4, 1, &memory()));
    }
}
