//! Code that replaces the SysTick handler until the next reset, for faults of the core that the engine has no input for.
//!
//! The vector table's entry is changed, not the handler: the core may stand within it.

use super::put;
use crate::engine::Trap;
use crate::image::{FLASH_BASE, FLASH_SIZE};
use rigless::emulator::Host;
use rigless::soc::Width;

/// The vector of SysTick: exception 15 (PM0253 table 17).
const SYSTICK: u32 = FLASH_BASE + 4 * 15;
/// The last bytes of the flash, far behind any image.
const ROOM: u32 = FLASH_BASE + FLASH_SIZE - 32;

/// NMIPENDSET of ICSR (PM0253 section 4.3.3), then a loop.
const NMI: [u16; 8] = [
    0x4802, // ldr r0, [pc, #8]
    0xF04F, 0x4100, // mov.w r1, #0x80000000
    0x6001, // str r1, [r0]
    0xE7FE, // b .
    0xBF00, // nop
    0xED04, 0xE000, // .word 0xE000ED04
];

/// The stack pointer below DTCM, then an instruction that faults. Pushes past the end of DTCM would not: the engine answers
/// where the part has nothing.
const OVERFLOW: [u16; 6] = [
    0x4801, // ldr r0, [pc, #4]
    0x4685, // mov sp, r0
    0xDE00, // udf #0
    0xBF00, // nop
    0xFF00, 0x1FFF, // .word 0x1FFFFF00
];

/// Puts the trap into the flash. What was there goes to `patched`.
pub fn set(
    trap: Trap,
    host: &mut dyn Host,
    patched: &mut Vec<(u32, u16)>,
) -> Result<Vec<u8>, String> {
    let code: &[u16] = match trap {
        Trap::Nmi => &NMI,
        Trap::Overflow => &OVERFLOW,
    };
    let vector = (ROOM | 1).to_le_bytes();
    let vector = [
        u16::from_le_bytes([vector[0], vector[1]]),
        u16::from_le_bytes([vector[2], vector[3]]),
    ];
    let words = (ROOM..).step_by(2).zip(code);
    for (at, word) in words.chain((SYSTICK..).step_by(2).zip(&vector)) {
        let before = host
            .read(at.into(), Width::W16)
            .map_err(|e| e.to_string())?;
        put(host, at, Width::W16, (*word).into())?;
        patched.push((at, before as u16));
    }
    Ok(Vec::new())
}
