//! The few Thumb-2 instructions that matter for stack depth: those that move the stack pointer, and those that leave a
//! function. Encodings as in the ARMv7-M Architecture Reference Manual, chapter A7.7.

/// What an instruction does to the stack or to the flow of control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Neither.
    None,
    /// Lowers the stack pointer by this many bytes.
    Grow(u32),
    /// Clears this many low bits of a register: how a stack pointer is about to be aligned.
    ClearLowBits(u32),
    /// Sets the stack pointer from a register.
    SetStack,
    /// Goes to, or calls, this address.
    Go(u32),
    /// Goes to, or calls, an address in a register.
    GoIndirect,
    /// Loads the lower half of a register.
    Low {
        /// The register.
        register: u32,
        /// The half.
        value: u32,
    },
    /// Loads the upper half of a register.
    High {
        /// The register.
        register: u32,
        /// The half.
        value: u32,
    },
    /// Sets the main stack pointer anew: another program begins.
    NewStack,
    /// Changes the stack pointer in a way that this program does not follow.
    Unclear,
}

/// Number of the stack pointer among the registers.
const SP: u32 = 13;
/// Of the link register.
const LR: u32 = 14;
/// Of the program counter.
const PC: u32 = 15;

/// Length in bytes of the instruction that begins with this half-word.
pub const fn instruction_length_bytes(first: u16) -> u32 {
    if first >> 11 >= 0b11101 { 4 } else { 2 }
}

/// What the instruction at `address` does; `second` counts only if it is a long one.
pub fn decode_effect(address: u32, first: u16, second: u16) -> Effect {
    let (first, second) = (u32::from(first), u32::from(second));
    if instruction_length_bytes(first as u16) == 2 {
        decode_short_instruction(address, first)
    } else {
        decode_long_instruction(address, first, second)
    }
}

fn decode_short_instruction(address: u32, code: u32) -> Effect {
    let register = code >> 3 & 0xF;
    match code {
        // PUSH: a bit for each of r0 to r7, and one for lr.
        0xB400..=0xB5FF => Effect::Grow(4 * (code & 0x1FF).count_ones()),
        // SUB sp, sp, #imm7 * 4
        0xB080..=0xB0FF => Effect::Grow(4 * (code & 0x7F)),
        // MOV sp, Rm and ADD sp, Rm
        _ if code & 0xFF87 == 0x4685 => Effect::SetStack,
        _ if code & 0xFF87 == 0x4485 => Effect::Unclear,
        // BX and BLX; BX lr is a return.
        0x4700..=0x477F if register == LR => Effect::None,
        0x4700..=0x47FF => Effect::GoIndirect,
        // MOV pc, Rm
        _ if code & 0xFF87 == 0x4687 => Effect::GoIndirect,
        // B<c> and B; conditions 14 and 15 are other instructions.
        0xD000..=0xDDFF => Effect::Go(target_of_pc_relative_branch(address, sign_extend(code & 0xFF, 8) << 1)),
        0xE000..=0xE7FF => Effect::Go(target_of_pc_relative_branch(address, sign_extend(code & 0x7FF, 11) << 1)),
        _ => Effect::None,
    }
}

fn decode_long_instruction(address: u32, first: u32, second: u32) -> Effect {
    let (rn, rt, rd) = (first & 0xF, second >> 12, second >> 8 & 0xF);
    // The immediate of data processing: i, imm3, imm8.
    let imm12 = (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF;
    let imm16 = (first & 0xF) << 12 | imm12;
    match first {
        // PUSH.W: STMDB sp!
        0xE92D => Effect::Grow(4 * second.count_ones()),
        // STRD Rt, Rt2, [sp, #-imm8 * 4]!
        0xE96D => Effect::Grow(4 * (second & 0xFF)),
        // STR Rt, [sp, #-imm8]!
        0xF84D if second & 0x0F00 == 0x0D00 => Effect::Grow(second & 0xFF),
        // VPUSH: imm8 counts words, for single and for double registers.
        _ if first & 0xFFBF == 0xED2D => Effect::Grow(4 * (second & 0xFF)),
        // SUB.W sp, sp, #const and SUBW sp, sp, #imm12
        _ if first & 0xFBEF == 0xF1AD && rd == SP => Effect::Grow(expand_modified_immediate(imm12)),
        _ if first & 0xFBFF == 0xF2AD && rd == SP => Effect::Grow(imm12),
        // SUB.W and ADD.W sp, sp, Rm
        _ if matches!(first & 0xFFEF, 0xEBAD | 0xEB0D) && rd == SP => Effect::Unclear,
        // BFC Rd, #0, #width; with Rn = 15 it clears.
        _ if first == 0xF36F && second & 0x70C0 == 0 => Effect::ClearLowBits((second & 0x1F) + 1),
        // MOVW, MOVT
        _ if first & 0xFBF0 == 0xF240 => Effect::Low { register: rd, value: imm16 },
        _ if first & 0xFBF0 == 0xF2C0 => Effect::High { register: rd, value: imm16 },
        // LDR Rt, [Rn ...]: into sp, or a jump; from the stack it is a return.
        _ if first & 0xFF70 == 0xF850 && rt == SP => Effect::Unclear,
        _ if first & 0xFF70 == 0xF850 && rt == PC && rn != SP => Effect::GoIndirect,
        // MSR MSP, Rn
        _ if first & 0xFFF0 == 0xF380 && second & 0xFF == 8 => Effect::NewStack,
        _ if first & 0xF800 == 0xF000 && second & 0x8000 != 0 => decode_long_branch(address, first, second),
        _ => Effect::None,
    }
}

/// `B.W`, `B<c>.W` and `BL`.
fn decode_long_branch(address: u32, first: u32, second: u32) -> Effect {
    let (sign, j1, j2) = (first >> 10 & 1, second >> 13 & 1, second >> 11 & 1);
    if second & 0x1000 != 0 {
        // B.W and BL: S, I1, I2, imm10, imm11 with I = not (J xor S).
        let (i1, i2) = (!(j1 ^ sign) & 1, !(j2 ^ sign) & 1);
        let bits = sign << 23 | i1 << 22 | i2 << 21 | (first & 0x3FF) << 11 | second & 0x7FF;
        return Effect::Go(target_of_pc_relative_branch(address, sign_extend(bits, 24) << 1));
    }
    if second & 0xD000 == 0x8000 && first >> 6 & 0xF < 14 {
        let bits = sign << 19 | j2 << 18 | j1 << 17 | (first & 0x3F) << 11 | second & 0x7FF;
        return Effect::Go(target_of_pc_relative_branch(address, sign_extend(bits, 20) << 1));
    }
    // Barriers, hints and other special registers share the rest.
    Effect::None
}

/// ThumbExpandImm (A5.3.2): a byte, a byte repeated, or a byte with its top bit set rotated to the right.
const fn expand_modified_immediate(imm12: u32) -> u32 {
    let byte = imm12 & 0xFF;
    match imm12 >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | imm12 & 0x7F).rotate_right(imm12 >> 7),
    }
}

const fn sign_extend(value: u32, bits: u32) -> u32 {
    let unused = 32 - bits;
    ((value << unused) as i32 >> unused) as u32
}

/// The program counter reads as the address of the instruction plus 4.
const fn target_of_pc_relative_branch(address: u32, offset: u32) -> u32 {
    address.wrapping_add(4).wrapping_add(offset)
}

#[cfg(test)]
mod tests {
    use super::Effect::{ClearLowBits, Go, GoIndirect, Grow, High, Low, NewStack, None, SetStack, Unclear};
    use super::*;

    /// Encodings as an assembler makes them.
    #[test]
    fn instructions_have_their_effects() {
        let at = 0x0800_1000;
        for (first, second, expected, text) in [
            (0xB5F0, 0, Grow(20), "push {r4-r7, lr}"),
            (0xB082, 0, Grow(8), "sub sp, #8"),
            (0xB002, 0, None, "add sp, #8"),
            (0xE92D, 0x4FF0, Grow(36), "push.w {r4-r11, lr}"),
            (0xED2D, 0x8B04, Grow(16), "vpush {d8, d9}"),
            (0xF84D, 0xBD04, Grow(4), "str fp, [sp, #-4]!"),
            (0xF84D, 0x0B04, None, "str r0, [sp], #4"),
            (0xE96D, 0x4502, Grow(8), "strd r4, r5, [sp, #-8]!"),
            (0xF5AD, 0x6D9B, Grow(0x4D8), "sub.w sp, sp, #0x4d8"),
            (0xF6AD, 0x0DA4, Grow(0x8A4), "subw sp, sp, #0x8a4"),
            (0xF5AD, 0x7D80, Grow(256), "sub.w sp, sp, #256"),
            (0xEBAD, 0x0D0C, Unclear, "sub.w sp, sp, r12"),
            (0x46A5, 0, SetStack, "mov sp, r4"),
            (0x466C, 0, None, "mov r4, sp"),
            (0xF36F, 0x0403, ClearLowBits(4), "bfc r4, #0, #4"),
            (0x4770, 0, None, "bx lr"),
            (0x4788, 0, GoIndirect, "blx r1"),
            (0x4718, 0, GoIndirect, "bx r3"),
            (0xF85D, 0xFB04, None, "ldr pc, [sp], #4"),
            (0xF8D0, 0xF004, GoIndirect, "ldr.w pc, [r0, #4]"),
            (0xE7FE, 0, Go(at), "b ."),
            (0xD0FE, 0, Go(at), "beq ."),
            (0xF000, 0xF800, Go(at + 4), "bl .+4"),
            (0xF7FF, 0xFFFE, Go(at), "bl ."),
            (0xF7FF, 0xBFFE, Go(at), "b.w ."),
            (0xF43F, 0xAFFE, Go(at), "beq.w ."),
            (0xF241, 0x2334, Low { register: 3, value: 0x1234 }, "movw r3, #0x1234"),
            (0xF6C0, 0x0301, High { register: 3, value: 0x0801 }, "movt r3, #0x0801"),
            (0xF3BF, 0x8F4F, None, "dsb"),
            (0xF381, 0x8808, NewStack, "msr msp, r1"),
            (0xF381, 0x8810, None, "msr primask, r1"),
        ] {
            assert_eq!(decode_effect(at, first, second), expected, "{text}");
        }
    }
}
