"""Addresses, offsets and bits against data of the chip that they were not written from (data/registers.csv): the constants of the emulator's modules,
its description of the chip (board/), the settings that the report expects, and raw register code of the firmware. Mistakes are planted into
copies, and must be found.
"""

import ast
import re
import unittest

from chip_data import CHIP, HERE, ROOT, list_differences, read_source, tell_differences
from register_map import (
    BLOCKS, CONSTANTS, ENABLES, EVENTS, MODEL_FOLDER, MODELS, OTHERS, RUST_CONSTANTS, RUST_OTHERS, SETTINGS, SNIPPETS, UNLIKE_AFTER_RESET,
)


def has_number(value):
    if isinstance(value, (tuple, dict)):
        return any(map(has_number, value.values() if isinstance(value, dict) else value))
    return isinstance(value, int) and not isinstance(value, bool)


def compare_modules(read=read_source):
    """The constants of the emulator's modules."""
    wrong = []
    for module, constants in CONSTANTS.items():
        text, names = read(f"tools/emulator/{module}.py"), {"__name__": module, "__file__": str(HERE / f"{module}.py")}
        exec(compile(text, module, "exec"), names)
        targets = [name for node in ast.parse(text).body if isinstance(node, ast.Assign) for name in ast.walk(ast.Tuple(node.targets))]
        own = {name.id for name in targets if isinstance(name, ast.Name) and has_number(names[name.id])}
        wrong += [f"{module}.{name} is compared with nothing" for name in own - constants.keys() - OTHERS]
        for name, notation in constants.items():
            wrong += tell_differences(f"{module}.{name}", names.get(name), CHIP.evaluate(notation))
    return wrong


def compare_description(read=read_source):
    """What board/chip.yaml says of base addresses, clocks and interrupts."""
    wrong = []
    for block in read("tools/emulator/board/chip.yaml").split("  - { id: ")[1:]:
        name = block.split('"')[1]
        address, *clock = (re.search(pattern, block) for pattern in (r"base_address: (\w+)", r"reg: \"(\w+)\", bit: (\d+)", r"irq: (\d+)"))
        wrong += tell_differences(name, int(address[1], 0), CHIP.evaluate(BLOCKS.get(name, name.upper())))
        if clock[0]:
            register = f"RCC_{clock[0][1].upper()}".replace("APB1ENR", "APB1ENR1")
            wrong += tell_differences(f"clock of {name}", int(clock[0][2]), CHIP.evaluate(f"{register} first {ENABLES.get(name, name.upper())}EN"))
        if clock[1]:
            wrong += tell_differences(f"interrupt of {name}", int(clock[1][1]), CHIP.interrupts[name.upper().rstrip("1")])
    return wrong


def compare_models(read=read_source):
    """Offsets and values after a reset of the registers in board/peripherals, and the bits of their events."""
    wrong = []
    for name, (peripheral, foreign) in MODELS.items():
        text = read(f"{MODEL_FOLDER}/{name}.yaml")
        for register, offset, reset in re.findall(r"id: (\w+), address_offset: (\w+),.*reset_value: (\w+)", text):
            if register in foreign.split():
                continue
            full = name_register(peripheral, register)
            base, seen, after_reset, _ = CHIP.find_register(full)
            # The VREFBUF is a part of the SYSCFG's block.
            seen += base - CHIP.evaluate(peripheral)
            wrong += tell_differences(f"{name}.yaml: {register}", int(offset, 0), seen)
            if register not in UNLIKE_AFTER_RESET:
                wrong += tell_differences(f"{name}.yaml: {register} after a reset", int(reset, 0), after_reset)
    for name, events in EVENTS.items():
        peripheral = MODELS[name][0] if name in MODELS else "RCC"
        found = {event: rest for event, rest in re.findall(r"id: (\w+), (trigger:[^\n]*\n[^\n]*)", read(f"{MODEL_FOLDER}/{name}.yaml"))}
        wrong += [f"{name}.yaml: {event} is compared with nothing" for event in found.keys() - events.keys() if not event.startswith("touched")]
        for event, notations in events.items():
            places = re.findall(r"register: (\w+), (?:bits|value): (\w+)", found[event])
            for notation, (register, value) in zip(notations, places, strict=True):
                if notation:
                    expected, fields = notation.split(": ")
                    bits = CHIP.evaluate(f"{name_register(peripheral, expected.removesuffix('_SET'))}: {fields}")
                    wrong += tell_differences(f"{name}.yaml: {event}", (register, int(value, 0)), (expected, bits))
    return wrong


def name_register(peripheral, register):
    """Its name in the data: modes of channels have two views, and VREFBUF is a peripheral of its own."""
    return register if register.startswith("VREFBUF") else f"{peripheral}_{register}{'_OUTPUT' if register.startswith('CCMR') else ''}"


def compare_settings(read=read_source):
    """Addresses, masks and values that the report expects."""
    wrong, text = [], read("tools/xtask/src/emulate/report/settings.rs")
    constants = {name: int(value, 16) for name, value in re.findall(r"^const (\w+): u32 = (\w+);", text, re.MULTILINE)}
    rows = {name: rest for name, rest in re.findall(r"new_register_setting\(\"([^\"]+)\", ([^)]+)\)", text)}
    for name, row in rows.items():
        if name.startswith("NVIC IPR"):
            word, byte = divmod(CHIP.interrupts[name.split()[-1]], 4)
            expected = (CHIP.evaluate("NVIC_IPR0") + 4 * word, 0xFF << 8 * byte, 0)
        elif name == "NVIC ISER0":
            bits = CHIP.evaluate("interrupts PVD_PVM TIM1_BRK_TIM15")
            expected = (CHIP.evaluate("NVIC_ISER0"), bits, bits)
        elif name in SETTINGS:
            register, fields = SETTINGS[name].split(": ")
            expected = (CHIP.evaluate(register), *CHIP.combine_fields(register, fields))
        else:
            wrong.append(f"setting {name} is compared with nothing")
            continue
        seen = (eval(value, {}, constants) for value in row.split(","))
        for what, one, other in zip(("address", "mask", "value"), seen, expected):
            wrong += tell_differences(f"setting {name}: {what}", one, other)
    return wrong + [f"setting {name} is missing" for name in SETTINGS.keys() - rows.keys()]


def compare_rust(read=read_source):
    """Constants in Rust, and addresses and bits in the firmware's assembler code, by the comments there."""
    wrong = []
    for path, constants in RUST_CONSTANTS.items():
        seen = dict(re.findall(r"const (\w+): (?:\*const )?u32 = (.+?)(?: as \*const u32)?;", read(path)))
        for name, notation in constants.items():
            wrong += tell_differences(f"{path}: {name}", eval(seen[name]), CHIP.evaluate(notation))
    for path in sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "firmware/src").rglob("*.rs")):
        shifted = set(re.findall(r"const (\w+): u\w+ = [^;]*<<", read(path)))
        wrong += [f"{path}: {name} is compared with nothing" for name in shifted - RUST_CONSTANTS.get(path, {}).keys() - RUST_OTHERS]
    for path in ("firmware/src/first_stage.rs", "firmware/src/pre_init.rs"):
        register = None
        for line in read(path).splitlines():
            if load := re.search(r"=(0x\w{8})\", // ((?:RCC|FLASH|SYSCFG|SCB|ICB)_\w+)$", line):
                register = load[2]
                wrong += tell_differences(f"{path}: {register}", int(load[1], 16), CHIP.evaluate(register))
            elif shift := re.search(r"lsls r1, r1, #(\d+)\", // (\w+)", line):
                # The bit goes to the sign.
                first = CHIP.evaluate(f"{register} first {shift[2].replace('SRAM_PE', 'SRAM2_PE')}")
                wrong += tell_differences(f"{path}: {shift[2]}", 31 - int(shift[1]), first)
    return wrong


def compare_snippets(read=read_source):
    """Numbers in the middle of code."""
    wrong = []
    for path, snippets in SNIPPETS.items():
        for snippet in snippets:
            code, notations = re.split(r"\{.*?\}", snippet), re.findall(r"\{(.*?)\}", snippet)
            found = re.search(r"(\w+)".join(map(re.escape, code)), read(path))
            seen = [int(number, 0) for number in found.groups()] if found else None
            wrong += tell_differences(f"{path}: {snippet}", seen, [CHIP.evaluate(notation) for notation in notations])
    return wrong


COMPARISONS = (compare_modules, compare_description, compare_models, compare_settings, compare_rust, compare_snippets)


class RegistersTest(unittest.TestCase):
    def test_registers_are_those_of_the_chip(self):
        for compare in COMPARISONS:
            with self.subTest(compare.__name__):
                self.assertEqual(compare(), [])

    def test_planted_mistakes_are_found(self):
        """File, text, mistake in its place, and what has to be told."""
        for path, text, mistake, word in (
            ("tools/emulator/protection.py", "BKE, BKP = 1 << 12, 1 << 13", "BKE, BKP = 1 << 12, 1 << 14", "protection.BKP"),
            ("tools/emulator/chip.py", "COMP = 0x4001_0200", "COMP = 0x4001_0300", "chip.COMP"),
            ("tools/emulator/chip.py", "SMPR1,", "SMPR3 = 0x18\nSMPR1,", "chip.SMPR3 is compared with nothing"),
            ("tools/emulator/timers.py", '"bdtr": 0x44', '"bdtr": 0x54', "timers.OFFSETS[bdtr]"),
            ("tools/emulator/timers.py", '>> 4 * (channel - 1)', '>> 2 * (channel - 1)', "timers.py"),
            ("tools/emulator/board/chip.yaml", 'reg: "apb2enr", bit: 17', 'reg: "apb2enr", bit: 18', "clock of tim16"),
            (f"{MODEL_FOLDER}/adc.yaml", "id: JSQR, address_offset: 0x4c", "id: JSQR, address_offset: 0x48", "JSQR"),
            (f"{MODEL_FOLDER}/timer.yaml", "register: BDTR, bits: 0x8000", "register: BDTR, bits: 0x4000", "moe"),
            ("tools/xtask/src/emulate/report/settings.rs", "0xFBEF_BE03, 0x00C1_0202", "0xFBEF_BE03, 0x00C0_8402", "ADC1 JSQR: value"),
            ("tools/xtask/src/emulate/report/settings.rs", "AF1_MASK: u32 = 0x3EFF", "AF1_MASK: u32 = 0x3CFF", "TIM1 AF1: mask"),
            ("tools/xtask/src/emulate/report/failures.rs", "1 << 17", "1 << 16", "IWDG_STOP"),
            ("tools/xtask/src/emulate/report/trips.rs", "0x4001_3460", "0x4001_3464", "(AF1)"),
            ("firmware/src/timers.rs", "BDTR_MOE: u32 = 1 << 15", "BDTR_MOE: u32 = 1 << 14", "BDTR_MOE"),
            ("firmware/src/permit.rs", "const CCER", "const NEW: u32 = 1 << 2;\nconst CCER", "NEW is compared with nothing"),
            ("firmware/src/first_stage.rs", "0x40021060", "0x40021058", "RCC_APB2ENR"),
            ("firmware/src/pre_init.rs", "r1, #7", "r1, #6", "SRAM_PE"),
        ):
            with self.subTest(mistake):
                wrong = list_differences(COMPARISONS, path, text, mistake)
                self.assertTrue(any(word in difference for difference in wrong), wrong)


if __name__ == "__main__":
    unittest.main()
