"""Exceptions enter with the stack aligned to 8 bytes.

A Cortex-M4 aligns its stack when it takes an exception (ARMv7-M, B1.5.7, CCR.STKALIGN) and compilers rely on it: they form
the address of the second word of a pair by OR. labwired stacks the frame where the stack pointer is. So before the firmware
starts, its interrupt vectors are led through a few instructions at the end of the flash that align the stack and then call
the handler. They take up to 12 bytes of stack and 9 instructions, where the processor takes up to 4 bytes and nothing.
"""

from chip import FLASH, FLASH_BYTES, INTERRUPTS

# mov r0, sp; bic r1, r0, #7; mov sp, r1; push {r0, lr}; ldr r2, handler; blx r2; pop {r0, lr}; mov sp, r0; bx lr; nop
CODE = (0xF020_4668, 0x468D_0107, 0x4A03_B501, 0xE8BD_4790, 0x4685_4001, 0xBF00_4770)
BYTES = 4 * (len(CODE) + 1)
# No image reaches that far, and faults.py has the last words.
PLACE = FLASH + FLASH_BYTES - 4096


def align_stack(sim):
    """To be called before the first instruction. The processor's own exceptions keep their vectors: the handler of a
    HardFault looks for its frame itself, and it does not return."""
    vectors = sim.symbol("__INTERRUPTS") & ~3
    for number in range(INTERRUPTS):
        place = PLACE + BYTES * number
        for offset, word in enumerate((*CODE, sim.read_u32(vectors + 4 * number))):
            sim.write_u32(place + 4 * offset, word)
        sim.write_u32(vectors + 4 * number, place | 1)
