"""The pin table (firmware/src/pins.rs), the firmware's code and what the emulator connects, against data of the chip's pins that they were not
written from (data/pins.csv). Mistakes are planted into copies, and must be found.
"""

import json
import re
import unittest

from chip_data import CHIP, SIGNALS, list_differences, read_source, tell_differences
from supply import Supply


def read_pin_table(read):
    """Function -> pin, direction, and what of the chip is connected to it, by the names of the data."""
    table, rows = {}, re.findall(r"^//! \| (P[A-D]\d+) *\|(.*?)\|(.*?)\|(.*?)\|$", read("firmware/src/pins.rs"), re.MULTILINE)
    for pin, *cells in rows:
        function, direction, outside = map(str.strip, cells)
        inputs = re.findall(r"(ADC\d(?: and ADC\d)*) input (\d+)", outside)
        signals = [f"{converter}_IN{number}" for converters, number in inputs for converter in converters.split(" and ")]
        signals += [f"COMP{number}_INP0" for number in re.findall(r"comparator (\d)", outside)]
        signals += [f"DAC{number}_OUT{channel}" for number, channel in re.findall(r"DAC(\d) channel (\d)", outside)]
        signals += [f"TIM{number}_CH{channel}" for number, channel in re.findall(r"TIM(\d+) channel (\d)", outside)]
        signals += [name.replace(" ", "_").translate({45: "M", 43: "P"}) for name in re.findall(r"^(?:LPUART1 [RT]X|USB D[-+])", function)]
        table[function] = pin, direction, signals
    return table


def compare_pin_table(read=read_source):
    """The pin table against the data of the pins."""
    table, wrong = read_pin_table(read), []
    wrong += tell_differences("pins of the table", sorted(pin for pin, *_ in table.values()), sorted(SIGNALS))
    for function, (pin, _, signals) in table.items():
        wrong += [f"{pin}, {function}, has no {signal}" for signal in signals if signal not in SIGNALS[pin]]
        if not signals and not re.search("discharge|high-voltage|LED", function):
            wrong.append(f"{pin}, {function}: nothing of the chip is named")
    return wrong


def compare_pins_of_firmware(read=read_source):
    """What the firmware's code does with pins, converters and comparators, against the pin table and the data of the pins."""
    table, wrong, text = read_pin_table(read), [], read("firmware/src/pins.rs")
    of = lambda function: table[function][0]
    find_input = lambda function, converter: next(int(name.split("IN")[1]) for name in table[function][2] if name.startswith(f"{converter}_IN"))
    electrodes = [f"ERA {era} electrode {electrode}" for era in range(1, 5) for electrode in "AB"]
    seen = [(f"P{port}{number}", int(function)) for port, number, function in re.findall(r"make_timer_pin\(pac::GPIO(\w), (\d+), (\d+)\)", text)]
    expected = [(of(function), SIGNALS[of(function)].get(table[function][2][0])) for function in (*electrodes, "permit")]
    wrong += tell_differences("timer pins", seen, expected)
    seen = [f"P{port}{number}" for port, number in re.findall(r"make_pin\(pac::GPIO(\w), (\d+)\)", text)]
    functions = ("high-voltage enable", "discharge switch, rail 1", "discharge switch, rail 2", "heartbeat LED")
    wrong += tell_differences("pins", seen, list(map(of, functions)))
    seen = {(port, number) for port, bits in re.findall(r"\(pac::GPIO(\w), (1 << [^)]*)\)", text) for number in re.findall(r"1 << (\d+)", bits)}
    expected = {(pin[1], pin[2:]) for function, (pin, direction, _) in table.items() if direction == "out" and not re.search("LPUART|LED", function)}
    wrong += tell_differences("HAZARDOUS", sorted(seen), sorted(expected))
    channels = [{key: int(table[f"ERA {era} electrode {key.upper()}"][2][0][-1]) for key in "ab"} for era in range(1, 5)]
    outputs = re.search(r"const OUTPUTS: [^=]*=([^;]*)", read("firmware/src/timers.rs"))[1]
    seen = [{"a": int(a), "b": int(b)} for a, b in re.findall(r"a: (\d), b: (\d)", outputs)]
    wrong += tell_differences("outputs of the timers", seen, channels)
    sense = read("firmware/src/sense.rs")
    expected = [find_input(function, "ADC1") for function in ("voltage of rail 1", "voltage of rail 2", "earth bond")]
    wrong += tell_differences("INPUTS", json.loads(re.search(r"INPUTS: \[usize; 3\] = (.*);", sense)[1]), expected)
    seen = re.findall(r"\((ADC\d), (\d+)\)", re.search(r"LOOP_INPUTS: .* = (.*);", sense)[1])
    expected = [(name, str(find_input(f"{loop} loop", name))) for name, loop in (("ADC3", "interlock"), ("ADC4", "emergency stop"))]
    wrong += tell_differences("LOOP_INPUTS", seen, expected)
    seen = int(re.search(r"const INPUT: u8 = (\d+);", read("firmware/src/average_current.rs"))[1])
    wrong += tell_differences("input of the average current", seen, find_input("average current", "ADC2"))
    comparators = read("firmware/src/comparators.rs")
    seen = {f"COMP{number}_INP0": pin for number, pin in re.findall(r"^//! \| (\d) +\| (P\w+)", comparators, re.MULTILINE)}
    wrong += tell_differences("comparators", seen, {name: pin for pin, _, names in table.values() for name in names if name.startswith("COMP")})
    pairs = re.findall(r"make_overload_comparator\((\d), .*, COMP(\d)\)", comparators) + re.findall(r"number: (\d), .*registers: COMP(\d)", comparators)
    wrong += [f"comparator {number} is COMP{other}" for number, other in pairs if number != other]
    return wrong + ([] if len(pairs) == len(seen) else [f"{len(pairs)} comparators, not {len(seen)}"])


# Function of a pin -> what changes the voltage there.
CHANGES = {
    "voltage of rail 1": lambda supply: supply.rails.__setitem__(0, 1000.0), "voltage of rail 2": lambda supply: supply.rails.__setitem__(1, 1000.0),
    "momentary current": lambda supply: setattr(supply, "shunt_a", 5e-3), "average current": lambda supply: setattr(supply, "forced_average_a", 1e-3),
    "interlock loop": lambda supply: setattr(supply, "interlock_level_v", 1.0), "earth bond": lambda supply: setattr(supply, "bond_ohm", 100.0),
    "emergency stop loop": lambda supply: setattr(supply, "emergency_stop_level_v", 1.0),
}


def compare_pins_of_emulator(read=read_source):
    """What the emulator connects to the inputs of converters and comparators and to pins, against the pin table and the data of the pins."""
    table, wrong, names = read_pin_table(read), [], {}
    for module in ("sensing", "protection", "pins", "pulses"):
        exec(compile(read(f"tools/emulator/{module}.py"), module, "exec"), names)
    bases = {base: name for name, (base, _) in CHIP.peripherals.items()}

    def read_inputs(change):
        supply = Supply()
        change(supply)
        sensing = names["Sensing"](None, supply, None, None, None)
        inputs = {f"{bases[converter]}_IN{number}": volts() for (converter, number), volts in sensing.inputs.items()}
        inputs |= {f"COMP{number}_INP0": volts for number, volts in names["Protection"](None, sensing, supply, None, None).inputs().items()}
        return inputs

    before, reached = read_inputs(lambda supply: None), {"ADC1_IN18"}
    for function, change in CHANGES.items():
        pin, _, signals = table[function]
        seen = {name for name, volts in read_inputs(change).items() if volts != before[name]}
        if function == "average current":
            seen.add(f"ADC2_IN{names['AVERAGE_INPUT']}")
        wrong += [f"{function} is at {name}, which {pin} does not have" for name in seen - SIGNALS[pin].keys()]
        wrong += [f"{function} is not at {name}" for name in set(signals) - seen]
        reached |= seen
    wrong += [f"nothing is at {name}" for name in before.keys() - reached]
    for era, (timer, *pins) in enumerate(names["ELECTRODES"].values(), 1):
        for key, (port, number, function, channel) in zip("ab", pins):
            pin, _, signals = table[f"ERA {era} electrode {key.upper()}"]
            seen = (f"P{port}{number}", [f"{timer}_CH{channel}"], function)
            wrong += tell_differences(f"ERA {era} {key}", seen, (pin, signals, SIGNALS[pin].get(*signals)))
            wrong += tell_differences(f"output {key} of {timer}", names["OUTPUTS"][timer]["ab".index(key)], int(signals[0][-1]))
    port, number, function, channel = names["PERMIT"]
    pin, _, signals = table["permit"]
    wrong += tell_differences("permit", (f"P{port}{number}", [f"TIM16_CH{channel}"], function), (pin, signals, SIGNALS[pin].get(*signals)))
    others = {
        "high_voltage_enable": "high-voltage enable", "heartbeat": "heartbeat LED", "discharge1": "discharge switch, rail 1",
        "discharge2": "discharge switch, rail 2",
    }
    for name, function in others.items():
        wrong += tell_differences(name, "P{}{}".format(*names["PINS"][name]), table[function][0])
    return wrong


COMPARISONS = (compare_pin_table, compare_pins_of_firmware, compare_pins_of_emulator)


class PinMapTest(unittest.TestCase):
    def test_pins_are_those_of_the_chip(self):
        for compare in COMPARISONS:
            with self.subTest(compare.__name__):
                self.assertEqual(compare(), [])

    def test_planted_mistakes_are_found(self):
        """File, text, mistake in its place, and what has to be told."""
        for path, text, mistake, word in (
            ("firmware/src/pins.rs", "comparator 5 and ADC3 input 5", "comparator 5 and ADC3 input 4", "PB13, interlock loop, has no ADC3_IN4"),
            ("firmware/src/pins.rs", "| PA4  | set-point of rail 1 ", "| PA4  | set-point of rail 2 ", "pins"),
            ("firmware/src/pins.rs", "pac::GPIOB, 2, 3", "pac::GPIOB, 2, 6", "timer pins"),
            ("firmware/src/pins.rs", "1 << 2 | 1 << 6 | 1 << 9", "1 << 2 | 1 << 6 | 1 << 8", "HAZARDOUS"),
            ("firmware/src/sense.rs", "[1, 2, 6]", "[2, 1, 6]", "INPUTS"),
            ("firmware/src/timers.rs", "OutputPair { a: 1, b: 4 }]", "OutputPair { a: 1, b: 3 }]", "outputs of the timers"),
            ("tools/emulator/sensing.py", "(ADC3, 5): supply.interlock_v, (ADC4, 4): supply.emergency_stop_v",
             "(ADC3, 5): supply.emergency_stop_v, (ADC4, 4): supply.interlock_v", "interlock loop is not at ADC3_IN5"),
            ("tools/emulator/sensing.py", "(ADC1, 1): lambda: self.rail_input(0), (ADC1, 2): lambda: self.rail_input(1)",
             "(ADC1, 1): lambda: self.rail_input(1), (ADC1, 2): lambda: self.rail_input(0)", "voltage of rail 1 is not at ADC1_IN1"),
            ("tools/emulator/protection.py", "1: self.sensing.rail_input(1), 3: self.sensing.rail_input(0)",
             "1: self.sensing.rail_input(0), 3: self.sensing.rail_input(1)", "voltage of rail 1 is not at COMP3_INP0"),
            ("tools/emulator/pins.py", '("C", 6, 4, 1), ("C", 9, 4, 4)', '("C", 6, 4, 1), ("C", 8, 4, 3)', "ERA 2 b"),
        ):
            with self.subTest(mistake):
                wrong = list_differences(COMPARISONS, path, text, mistake)
                self.assertTrue(any(word in difference for difference in wrong), wrong)


if __name__ == "__main__":
    unittest.main()
