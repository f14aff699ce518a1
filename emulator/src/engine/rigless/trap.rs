//! Code that replaces an exception's handler until the next reset, for faults of the core that the
//! engine has no input for.
//!
//! The vector table's entry is changed, not the handler: the core may stand within it.

use super::put;
use crate::engine::{CoreBit, Trap};
use crate::image::{FLASH_BASE, FLASH_SIZE};
use emulator_link::Forbidden;
use rigless::emulator::Host;
use rigless::soc::Width;

/// SysTick is exception 15 (PM0253 table 17).
const SYSTICK: u8 = 15;
/// The last exception: interrupt 149 (RM0433 rev 9 table 147).
const LAST_EXCEPTION: u8 = 16 + 149;
/// The last bytes of the flash, far behind any image.
const ROOM: u32 = FLASH_BASE + FLASH_SIZE - 64;
/// A word of ITCM RAM, which the image does not use: not zero once a flip is done.
const DONE: u32 = 0x0000_FFF8;

/// NMIPENDSET of ICSR (PM0253 section 4.3.3), then a loop.
const NMI: [u16; 8] = [
    0x4802, // ldr r0, [pc, #8]
    0xF04F, 0x4100, // mov.w r1, #0x80000000
    0x6001, // str r1, [r0]
    0xE7FE, // b .
    0xBF00, // nop
    0xED04, 0xE000, // .word 0xE000ED04
];

/// The access, with the address that it needs in R0. The undefined instruction ends it where the
/// MPU does not.
fn forbidden(access: Forbidden) -> Vec<u16> {
    let (code, address) = match access {
        // mov sp, r0; push {r0}: in the guard at the bottom of the stack
        Forbidden::Push => ([0x4685, 0xB401], 0x2000_0200_u32),
        // ldr r1, [r0]; nop
        Forbidden::NullRead => ([0x6801, 0xBF00], 0),
        // str r0, [r0]; nop
        Forbidden::FlashWrite => ([0x6000, 0xBF00], FLASH_BASE),
        // bx r0; nop
        Forbidden::RunRam => ([0x4700, 0xBF00], 0x2400_0000 | 1),
    };
    let load = 0x4801; // ldr r0, [pc, #4]
    let undefined = 0xDE00; // udf #0
    let [low, high] = [address as u16, (address >> 16) as u16];
    vec![load, code[0], code[1], undefined, low, high]
}

/// The registers of the interrupted code that the processor has put on the stack, in that order
/// (PM0253 figure 12).
const STACKED: [u8; 8] = [0, 1, 2, 3, 12, 14, 15, 16];

/// Flips the bit of the interrupted code's register unless that is done, then goes to `handler`. R0
/// to R3 and R12 are free here; LR is left as it is.
fn flip(what: CoreBit, handler: u32) -> Result<Vec<u16>, String> {
    let CoreBit { register, bit, .. } = what;
    let flip: [u16; 3] = match STACKED.iter().position(|stacked| *stacked == register) {
        Some(word) => {
            let word = word as u16;
            // ldr r2, [sp, #4 * word]; eors r2, r1; str r2, [sp, #4 * word]
            [0x9A00 | word, 0x404A, 0x9200 | word]
        }
        // mov r2, sp; eors r2, r1; mov sp, r2
        None if register == 13 => [0x466A, 0x404A, 0x4695],
        None if register < 12 => {
            let number = u16::from(register);
            // eor.w rN, rN, r1; nop
            [0xEA80 | number, number << 8 | 1, 0xBF00]
        }
        None => {
            return Err(format!(
                "core register {register}: 0 to 12, 13 SP, 14 LR, 15 PC, 16 xPSR"
            ))
        }
    };
    let mut code = vec![
        0x4805, // ldr r0, [pc, #20]: DONE
        0x6801, // ldr r1, [r0]
        0xB929, // cbnz r1, skip
        0x2101, // movs r1, #1
        0x6001, // str r1, [r0]
        0x4904, // ldr r1, [pc, #16]: the bit
    ];
    code.extend(flip);
    code.extend([
        0x4803, // skip: ldr r0, [pc, #12]: the handler
        0x4700, // bx r0
        0xBF00, // nop
    ]);
    for literal in [DONE, 1 << bit, handler] {
        code.extend([literal as u16, (literal >> 16) as u16]);
    }
    Ok(code)
}

/// Puts back what an earlier trap has replaced.
fn remove(host: &mut dyn Host, patched: &mut Vec<(u32, u16)>) -> Result<(), String> {
    let vectors = FLASH_BASE..FLASH_BASE + 4 * (u32::from(LAST_EXCEPTION) + 1);
    let (of_traps, others): (Vec<_>, Vec<_>) = patched
        .drain(..)
        .partition(|(at, _)| *at >= ROOM || vectors.contains(at));
    *patched = others;
    for (at, before) in of_traps.into_iter().rev() {
        put(host, at, Width::W16, before.into())?;
    }
    Ok(())
}

/// Puts the trap into the flash. What was there goes to `patched`.
pub fn set(
    trap: Trap,
    host: &mut dyn Host,
    patched: &mut Vec<(u32, u16)>,
) -> Result<Vec<u8>, String> {
    let exception = match trap {
        Trap::Nmi | Trap::Forbidden(_) => SYSTICK,
        Trap::Flip(what) => what.exception,
    };
    if !(2..=LAST_EXCEPTION).contains(&exception) {
        return Err(format!(
            "exception {exception}: 2 to {LAST_EXCEPTION}, 15 is SysTick"
        ));
    }
    let vector_at = FLASH_BASE + 4 * u32::from(exception);
    let code = match trap {
        Trap::Nmi => NMI.to_vec(),
        Trap::Forbidden(access) => forbidden(access),
        Trap::Flip(what) if what.bit > 31 => {
            return Err(format!("bit {} of a word: bits are 0 to 31", what.bit));
        }
        Trap::Flip(what) => {
            remove(host, patched)?;
            put(host, DONE, Width::W32, 0)?;
            let handler = host
                .read(vector_at.into(), Width::W32)
                .map_err(|e| e.to_string())?;
            flip(what, handler as u32)?
        }
    };
    let vector = (ROOM | 1).to_le_bytes();
    let vector = [
        u16::from_le_bytes([vector[0], vector[1]]),
        u16::from_le_bytes([vector[2], vector[3]]),
    ];
    let words = (ROOM..).step_by(2).zip(&code);
    for (at, word) in words.chain((vector_at..).step_by(2).zip(&vector)) {
        let before = host
            .read(at.into(), Width::W16)
            .map_err(|e| e.to_string())?;
        put(host, at, Width::W16, (*word).into())?;
        patched.push((at, before as u16));
    }
    Ok(Vec::new())
}
