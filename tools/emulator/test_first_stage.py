"""The first stage of the image (firmware/src/first_stage.rs): what it starts, and when.

The emulator has no bootloader in ROM. Reading its vector table is a fault there, which sends the first stage back to
where it starts the bootloader: it then stays within its own few instructions, with the ROM's vectors selected.
"""

import os
import struct
import tempfile
import unittest

from labwired import Sim

from chip import AIRCR, SYSCFG
from machine import BOARD

FIRMWARE = 0x0800_1000
HEADER = FIRMWARE + 0x200
VTOR = 0xE000_ED08
RCC_CRRCR = 0x4002_1098
MEMRMP = SYSCFG
SYSTEM_FLASH = 1


def changed(elf, changes):
    """The image with words at addresses in flash replaced."""
    image = bytearray(elf)
    offset, = struct.unpack_from("<I", image, 28)
    count, = struct.unpack_from("<H", image, 44)
    for index in range(count):
        start, _, physical, size = struct.unpack_from("<4I", image, offset + 32 * index + 4)
        for address, word in changes.items():
            if physical <= address < physical + size:
                struct.pack_into("<I", image, start + address - physical, word)
    return bytes(image)


def address_of(elf, part):
    """The address of the symbol whose mangled name has `part` in it."""
    sections, = struct.unpack_from("<I", elf, 32)
    count, = struct.unpack_from("<H", elf, 48)
    headers = [struct.unpack_from("<10I", elf, sections + 40 * index) for index in range(count)]
    for _, kind, _, _, start, size, link, _, _, _ in headers:
        if kind != 2:  # SHT_SYMTAB
            continue
        names = headers[link][4]
        for offset in range(start, start + size, 16):
            name, value = struct.unpack_from("<2I", elf, offset)
            if part in elf[names + name:elf.index(b"\0", names + name)]:
                return value
    raise KeyError(part)


class FirstStageTest(unittest.TestCase):
    def run_image(self, changes, before=None, time="2us"):
        with open(os.environ["ERA_ELF"], "rb") as file:
            image = changed(file.read(), changes)
        with tempfile.NamedTemporaryFile(suffix=".elf") as file:
            file.write(image)
            file.flush()
            sim = Sim(file.name, system=BOARD, uart="lpuart1")
        self.addCleanup(sim.close)
        if before:
            before(sim)
        sim.run_for(time)
        return sim

    def assert_bootloader(self, sim):
        self.assertEqual(sim.read_u32(VTOR), 0)
        self.assertEqual(sim.read_u32(MEMRMP) & 7, SYSTEM_FLASH)

    def test_firmware_starts(self):
        self.assertEqual(self.run_image({}).read_u32(VTOR), FIRMWARE)

    def test_erased_first_word_starts_the_bootloader(self):
        self.assert_bootloader(self.run_image({FIRMWARE: 0xFFFF_FFFF, FIRMWARE + 4: 0xFFFF_FFFF}))

    def test_stack_outside_ram_starts_the_bootloader(self):
        for word in (0x0000_0000, 0x2000_0000, 0x2002_0008):
            self.assert_bootloader(self.run_image({FIRMWARE: word}))

    def test_missing_header_starts_the_bootloader(self):
        for address in (HEADER, HEADER + 4):
            self.assert_bootloader(self.run_image({address: 0xFFFF_FFFF}))

    def test_firmware_goes_to_the_bootloader_when_asked_before_the_reset(self):
        asked = 0x4446_5521
        with open(os.environ["ERA_ELF"], "rb") as file:
            note = address_of(file.read(), b"bootloader4NOTE")

        def ask(sim):
            sim.write_u32(note, asked)
            sim.write_u32(note + 4, asked ^ 0xFFFF_FFFF)

        self.assert_bootloader(self.run_image({}, before=ask, time="150us"))

    def test_start_by_the_bootloader_resets_first(self):
        sim = self.run_image({}, before=lambda sim: sim.write_u32(RCC_CRRCR, 1))
        self.assertEqual(sim.read_u32(AIRCR) & 0xFFFF, 4)
        self.assertEqual(sim.read_u32(VTOR), 0)


if __name__ == "__main__":
    unittest.main()
