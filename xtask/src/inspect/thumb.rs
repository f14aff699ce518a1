//! What a Thumb-2 instruction does to control flow and to the stack, as far as [`super::calls`]
//! needs it.
//!
//! Encodings are those of the ARMv7-M Architecture Reference Manual, chapter A5 (which instruction)
//! and A7.7 (its fields).

/// Effect of an instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// None that counts here.
    None,
    /// Goes to this address, as a call or as a branch.
    Goes(u32),
    /// Goes to an address in a register or in memory.
    GoesAnywhere,
    /// Takes this many bytes of stack.
    Takes(u32),
    /// Takes an amount of stack that is not in the instruction.
    TakesAnyAmount,
    /// Writes a register's lower half and clears the upper one.
    Low {
        /// Number of the register.
        register: u8,
        /// The half.
        value: u16,
    },
    /// Writes a register's upper half.
    High {
        /// Number of the register.
        register: u8,
        /// The half.
        value: u16,
    },
}

/// Length in bytes of the instruction that begins with this halfword (A5.1).
pub const fn length(first: u16) -> u32 {
    if first >> 11 >= 0b11101 {
        4
    } else {
        2
    }
}

/// Decodes the instruction at `address`; `second` is the halfword behind its first.
pub fn decode(address: u32, first: u16, second: u16) -> Effect {
    if length(first) == 2 {
        narrow(address, first)
    } else {
        wide(address, first, second)
    }
}

/// `bits` of a value as a signed number.
const fn signed(value: u32, bits: u32) -> u32 {
    (((value << (32 - bits)) as i32) >> (32 - bits)) as u32
}

const fn target(address: u32, offset: u32) -> Effect {
    Effect::Goes(address.wrapping_add(4).wrapping_add(offset))
}

fn narrow(address: u32, first: u16) -> Effect {
    let word = u32::from(first);
    match first {
        // B<c> (T1). Conditions 14 and 15 are UDF and SVC.
        _ if first >> 12 == 0b1101 && (first >> 8) & 0xF < 14 => {
            target(address, signed((word & 0xFF) << 1, 9))
        }
        // B (T2)
        _ if first >> 11 == 0b11100 => target(address, signed((word & 0x7FF) << 1, 12)),
        // PUSH (T1)
        _ if first >> 9 == 0b101_1010 => Effect::Takes(4 * (word & 0x1FF).count_ones()),
        // SUB SP, SP, #imm7 (T1)
        _ if first >> 7 == 0b1_0110_0001 => Effect::Takes(4 * (word & 0x7F)),
        // BLX
        _ if first >> 7 == 0b0_1000_1111 => Effect::GoesAnywhere,
        // BX; of LR it is the return
        _ if first >> 7 == 0b0_1000_1110 && first != 0x4770 => Effect::GoesAnywhere,
        // MOV PC, Rm
        _ if first & 0xFF87 == 0x4687 => Effect::GoesAnywhere,
        _ => Effect::None,
    }
}

fn wide(address: u32, first: u16, second: u16) -> Effect {
    let (a, b) = (u32::from(first), u32::from(second));
    let register = (second >> 8 & 0xF) as u8;
    // imm12 of the data processing group: i, imm3, imm8
    let imm12 = (a >> 10 & 1) << 11 | (b >> 12 & 7) << 8 | b & 0xFF;
    let half = ((a & 0xF) << 12 | imm12) as u16;
    match first {
        // Branches: 11110 and 1 in bit 15 of the second halfword
        _ if first >> 11 == 0b11110 && second >> 15 == 1 => branch(address, a, b),
        // STMDB SP! (PUSH, T2)
        0xE92D => Effect::Takes(4 * b.count_ones()),
        // STR Rt, [SP, #-4]! (PUSH, T3)
        0xF84D if second & 0xFFF == 0xD04 => Effect::Takes(4),
        // STRD Rt, Rt2, [SP, #-imm8]!
        0xE96D => Effect::Takes(4 * (b & 0xFF)),
        // VPUSH
        _ if first & 0xFFBF == 0xED2D && b >> 9 & 7 == 0b101 => Effect::Takes(4 * (b & 0xFF)),
        // SUB.W SP, SP, #const (T2)
        _ if first & 0xFBEF == 0xF1AD && register == 13 => Effect::Takes(expand(imm12)),
        // SUBW SP, SP, #imm12 (T3)
        _ if first & 0xFBFF == 0xF2AD && register == 13 => Effect::Takes(imm12),
        // SUB SP, SP, Rm
        _ if first & 0xFFEF == 0xEBAD && register == 13 => Effect::TakesAnyAmount,
        // MOVW, MOVT
        _ if first & 0xFBF0 == 0xF240 => Effect::Low {
            register,
            value: half,
        },
        _ if first & 0xFBF0 == 0xF2C0 => Effect::High {
            register,
            value: half,
        },
        // LDR PC; from the stack it is a return
        _ if first & 0xFF70 == 0xF850 && second >> 12 == 15 && first & 0xF != 13 => {
            Effect::GoesAnywhere
        }
        _ => Effect::None,
    }
}

fn branch(address: u32, a: u32, b: u32) -> Effect {
    let (s, j1, j2) = (a >> 10 & 1, b >> 13 & 1, b >> 11 & 1);
    if b >> 12 & 1 == 1 {
        // BL (T1) and B (T4): the same offset
        let (i1, i2) = (1 ^ j1 ^ s, 1 ^ j2 ^ s);
        let offset = s << 24 | i1 << 23 | i2 << 22 | (a & 0x3FF) << 12 | (b & 0x7FF) << 1;
        return target(address, signed(offset, 25));
    }
    // B<c> (T3). Conditions 14 and 15 are MSR, MRS, barriers and the like.
    if b >> 14 & 1 == 0 && a >> 6 & 0xF < 14 {
        let offset = s << 20 | j2 << 19 | j1 << 18 | (a & 0x3F) << 12 | (b & 0x7FF) << 1;
        return target(address, signed(offset, 21));
    }
    Effect::None
}

/// ThumbExpandImm (A5.3.2).
const fn expand(imm12: u32) -> u32 {
    let byte = imm12 & 0xFF;
    match imm12 >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | byte & 0x7F).rotate_right(imm12 >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Instructions as GNU objdump shows them.
    #[test]
    fn instructions_of_an_image() {
        let at = 0x0800_1000;
        let cases = [
            // push {r4, r5, r6, r7, lr}
            (0xB5F0, 0x0000, Effect::Takes(20)),
            // sub sp, #24
            (0xB086, 0x0000, Effect::Takes(24)),
            // stmdb sp!, {r8, r9, sl, fp}
            (0xE92D, 0x0F00, Effect::Takes(16)),
            // str.w fp, [sp, #-4]!
            (0xF84D, 0xBD04, Effect::Takes(4)),
            // vpush {d8-d15}
            (0xED2D, 0x8B10, Effect::Takes(64)),
            // sub.w sp, sp, #1024
            (0xF5AD, 0x6D80, Effect::Takes(1024)),
            // subw sp, sp, #1028
            (0xF2AD, 0x4D04, Effect::Takes(1028)),
            // sub.w sp, sp, r4
            (0xEBAD, 0x0D04, Effect::TakesAnyAmount),
            // b.n to itself
            (0xE7FE, 0x0000, Effect::Goes(at)),
            // beq.n +4
            (0xD000, 0x0000, Effect::Goes(at + 4)),
            // svc 0, udf 0: no branches
            (0xDF00, 0x0000, Effect::None),
            (0xDE00, 0x0000, Effect::None),
            // bl +0x100, bl -4
            (0xF000, 0xF880, Effect::Goes(at + 0x104)),
            (0xF7FF, 0xFFFE, Effect::Goes(at)),
            // b.w -4
            (0xF7FF, 0xBFFE, Effect::Goes(at)),
            // beq.w +0x100
            (0xF000, 0x8080, Effect::Goes(at + 0x104)),
            // dsb sy, mrs r0, PRIMASK: in the same group, no branches
            (0xF3BF, 0x8F4F, Effect::None),
            (0xF3EF, 0x8010, Effect::None),
            // bx lr, blx r3, bx r3
            (0x4770, 0x0000, Effect::None),
            (0x4798, 0x0000, Effect::GoesAnywhere),
            (0x4718, 0x0000, Effect::GoesAnywhere),
            // ldr.w pc, [sp], #4 and ldr.w pc, [r3]
            (0xF85D, 0xFB04, Effect::None),
            (0xF8D3, 0xF000, Effect::GoesAnywhere),
        ];
        for (first, second, effect) in cases {
            assert_eq!(
                decode(at, first, second),
                effect,
                "{first:04x} {second:04x}"
            );
        }
    }

    /// movw r0, #0x1234; movt r0, #0x0801
    #[test]
    fn halves_of_a_constant() {
        let (register, value) = (0, 0x1234);
        assert_eq!(decode(0, 0xF241, 0x2034), Effect::Low { register, value });
        let value = 0x0801;
        assert_eq!(decode(0, 0xF6C0, 0x0001), Effect::High { register, value });
    }
}
