"""Registers and pins of the chip by name, from data/registers.csv and data/pins.csv, whose heads name their sources; and what the tests that compare
with them have in common. Nothing here is shared with chip.py, which is compared with it.
"""

import csv
import pathlib

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]


class Chip:
    """The chip's registers by name."""

    def __init__(self):
        kinds = {"peripheral": {}, "register": {}, "interrupt": {}}
        for kind, name, number, *rest in read_rows("registers.csv"):
            kinds[kind][name] = (int(number, 0), *rest)
        self.peripherals = kinds["peripheral"]
        self.interrupts = {name: number for name, (number,) in kinds["interrupt"].items()}
        self.registers = {
            name: (offset, int(reset, 16), {field: (int(first), int(*width or "1")) for field, first, *width in split_words(fields)})
            for name, (offset, reset, *fields) in kinds["register"].items()
        }

    def find_register(self, name):
        """Base of its peripheral, its offset, its value after a reset, and its fields."""
        peripheral = max((some for some in self.peripherals if name.startswith(some + "_")), key=len)
        base, layout = self.peripherals[peripheral]
        return base, *self.registers[layout + name.removeprefix(peripheral)]

    def evaluate(self, text):
        """TIM1: base address. TIM1_CR1: address. TIM1_CR1 offset. TIM1_CR1 reset. TIM1_BDTR first LOCK: lowest bit of a field. TIM1_BDTR: LOCK=2 MOE:
        these fields with these values, or with all of their bits. interrupt TIM2: number. interrupts TIM2 RNG: their bits in the NVIC's first
        registers. word UID: address of the word that it begins in. Of tuples and dictionaries each value."""
        if isinstance(text, dict):
            return {key: self.evaluate(value) for key, value in text.items()}
        if isinstance(text, tuple):
            return tuple(self.evaluate(value) for value in text)
        if text in self.peripherals:
            return self.peripherals[text][0]
        name, _, rest = text.partition(" ")
        if name == "word":
            return self.peripherals[rest][0] & ~3
        if name == "interrupt":
            return self.interrupts[rest]
        if name == "interrupts":
            return sum(1 << self.interrupts[some] for some in rest.split())
        if name.endswith(":"):
            return self.combine_fields(name[:-1], rest)[1]
        base, offset, reset, fields = self.find_register(name)
        if rest.startswith("first "):
            return fields[rest.removeprefix("first ")][0]
        return {"": base + offset, "offset": offset, "reset": reset}[rest]

    def combine_fields(self, name, text):
        """Mask and value of fields as in `evaluate`."""
        fields, mask, result = self.find_register(name)[3], 0, 0
        for field, _, value in (word.partition("=") for word in text.split()):
            first, width = fields[field]
            most = (1 << width) - 1
            if value and int(value, 0) > most:
                raise ValueError(f"{name}.{field} = {value}")
            mask, result = mask | most << first, result | (int(value, 0) if value else most) << first
        return mask, result


def read_rows(name):
    with open(HERE / "data" / name, newline="") as file:
        return [row for row in csv.reader(file) if row and not row[0].startswith("#")]


def split_words(texts):
    return [word.split(":") for word in " ".join(texts).split()]


CHIP = Chip()
# Pin -> what of the chip it can be connected to -> number of the alternate function, or None.
SIGNALS = {pin: {name: int(*number) if number else None for name, *number in split_words([signals])} for pin, signals in read_rows("pins.csv")}


def read_source(path):
    return (ROOT / path).read_text()


def tell_differences(what, seen, expected):
    """A text for each value that differs."""
    if isinstance(expected, dict) and isinstance(seen, dict) and expected.keys() == seen.keys():
        return [text for key in expected for text in tell_differences(f"{what}[{key}]", seen[key], expected[key])]
    show = lambda value: hex(value) if isinstance(value, int) else value
    return [] if seen == expected else [f"{what} is {show(seen)}, not {show(expected)}"]


def list_differences(comparisons, path, text, mistake):
    """What comparisons tell when a mistake is in the place of some text of a file."""
    if text not in read_source(path):
        raise ValueError(f"{path} has no {text}")
    return [
        difference for compare in comparisons
        for difference in compare(lambda some: read_source(some).replace(text, mistake) if some == path else read_source(some))
    ]
