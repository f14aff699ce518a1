//! The board in the form that the engine requires: one target with its Cortex-M7.

use super::mcu::RigMcu;
use super::peers::Shared;
use super::usb::SharedUsb;
use rigless::cpu::armv7m::windows;
use rigless::machine::{armv7m, Board, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::Error;
use std::num::{NonZeroU32, NonZeroU64};

/// Name of the machine.
pub const NAME: &str = "NUCLEO-H753ZI force board";

/// Instructions retired in a second of virtual time: one every 4 ns. A Cortex-M7 at 400 MHz retires
/// 0.5 to 1.2 a cycle; with 0.63 the figures lean to the slow side.
pub const INSTRUCTIONS_PER_SECOND: NonZeroU64 = armv7m::INSTRUCTIONS_PER_SECOND;

/// Nanoseconds an instruction takes.
pub const INSTRUCTION_NS: u64 = 1_000_000_000 / INSTRUCTIONS_PER_SECOND.get();

/// Cortex-M7 r1p1 (ES0392 section 2.1; PM0253 table 52).
const CPUID: u32 = 0x411F_C271;

/// 16 KiB caches, as their identification registers say (PM0253 tables 77 and 81).
const CACHES: armv7m::Caches = armv7m::Caches {
    clidr: 0x0900_0003,
    ctr: 0x8303_C003,
    ccsidr: &[0xF00F_E019, 0xF01F_E009],
};

const fn register(offset: u64, reset: u32, writable: u32) -> armv7m::ImplementationRegister {
    armv7m::ImplementationRegister {
        offset,
        reset,
        writable,
    }
}

/// Access control registers of PM0253 tables 104 to 109: ITCMCR (64 KiB), DTCMCR (128 KiB), AHBPCR,
/// CACR, AHBSCR, ABFSR.
const ACCESS_CONTROL: [armv7m::ImplementationRegister; 6] = [
    register(0xF90, 0b0111 << 3, 0b0111),
    register(0xF94, 0b1000 << 3, 0b0111),
    register(0xF98, 0, 1),
    register(0xF9C, 0, 0b0111),
    register(0xFA0, 1 << 11, 0xFFFF),
    register(0xFA8, 0, 0),
];

/// See the module's page.
#[derive(Debug)]
pub struct RigMachine {
    /// The controller with everything around it.
    pub mcu: RigMcu,
}

impl RigMachine {
    /// The machine with `board` around the controller.
    ///
    /// # Errors
    /// As [`RigMcu::new`].
    pub fn new(board: Shared, usb: SharedUsb) -> Result<Self, Error> {
        Ok(Self {
            mcu: RigMcu::new(board, usb)?,
        })
    }

    fn config(&self) -> armv7m::Config {
        let lines = u32::from(self.mcu.cpu().interrupt_lines);
        let core = armv7m::Core {
            variant: armv7m::Variant::M7,
            clock_hz: NonZeroU64::new(400_000_000).expect("not zero"),
            interrupt_lines: NonZeroU32::new(lines).expect("a part with interrupts"),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).expect("not zero"),
            instructions_per_second: INSTRUCTIONS_PER_SECOND,
            boot: "flash",
        };
        let mut config = armv7m::Config::new(core, &windows(self.mcu.bus()));
        config.fpu = armv7m::Fpu::FpV5Dp;
        config.mpu_regions = armv7m::MpuRegions::Sixteen;
        config.cpuid = CPUID;
        config.caches = Some(CACHES);
        config.branch_prediction = armv7m::BranchPrediction::Always;
        config.implementation_registers = ACCESS_CONTROL.to_vec();
        config.vector_table = Some(crate::image::FLASH_BASE);
        config
    }
}

impl Store for RigMachine {}

impl Board for RigMachine {
    fn name(&self) -> &'static str {
        NAME
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = self.config().spec();
        vec![Target::new("stm32h753", &mut self.mcu, core)]
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32h753"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.mcu)
    }
}
