"""Faults on demand: what the bridge's op `inject` takes. Each key is one fault; several can come in one command.

key             value                                            what happens
interlock       "open" | "closed" | "shorted" | V                the interlock loop: contacts, wires that touch, or its level
estop           "pressed" | "released" | "shorted" | V           the emergency stop loop, likewise
earth           "open" | "closed" | "unfed" | ohm                the earth bond, its feeding resistor open, or its resistance
rail_fault      {"rail": 1 | 2, and any of:
                 "volts": V | null                               the rail is held there whatever is asked (null: no more)
                 "factor": x                                     the rail settles at x times its set-point
                 "measured_factor": x}                           the divider shows x times the rail
reference       x                                                the board's own 3.3 V is x times that
enable          "stuck" | "works"                                the supply delivers though it is disabled
permit          "ignored" | "ignored_by_enable"                  the gates outside the chip do not follow the permit: none, or not that
                | "works"                                        of the supply's enable
pin             {"name": key of the op `pins`,                   its pad has this level, whatever drives it (null: no more)
                 "stuck": true | false | null}
joined          [key, key] of the op `pins`                      the pads of two pins touch
pull_downs      "missing" | "there"                              what no output of the chip drives is high
break           {"timer": "TIM8", "works": true | false}         breaks do not reach the timer (TIM16: the permit's)
average         "stops" | "converts"                             ADC2 gives no result any more
register        {"address": n, "value": n}                       the register changes by itself, also if it is locked
measurements    "crossed" | "straight"                           each rail's divider is on the other one's input
discharge       "fails" | "line_open" | "works"                  the discharge switches do not close, or by the permit alone: their own
                                                                 lines say "open" for ever
electrode       {"era": 1 to 4, "electrode": "a" | "b",          it is not there ("open"), has a short to earth ("shorted"), its
                 "is": "open" | "shorted" | "lower_open"         lower switch does not close ("lower_open") or is always closed
                 | "lower_stuck" | "works"}                      ("lower_stuck")
tolerances      {"rail_farads": x, "electrode_ohms": y}          the rails have x times their capacitance, the resistors behind the
                                                                 electrodes y times their resistance
overcurrent_ma  mA                                               through the fast shunt, until set to 0
average_ma      mA | null                                        the measured average current (null: the true one)
pvd             "low" | "ok"                                     the board's 3.3 V against the voltage detector
comparator      {"number": n, "stuck": true | false | null}      its output stays there (null: no more)
comparator_in   {"number": n, "volts": v | null}                 it sees this voltage in place of its input, which is not
                                                                 connected (null: no more)
stall           {"timer": "TIM8", "on": true | false}            the timer's counter stands still
handler         {"runs": "loop" | "undefined" | name of a        an interrupt that nobody asked for: its handler loops for
                 function, "priority": 0 to 15}                  ever (15: thread mode hangs; 5: the device's task too; 0:
                                                                 everything), is undefined (HardFault), or is the
                                                                 function (for example one that panics)
watchdog        "broken" | "slow" | "works"                      the independent watchdog does not reset the chip, or takes no settings
                                                                 after it has done so once
lsi             x                                                the watchdog's oscillator has x times 32 kHz (0: it stands still)
option_bytes    n                                                FLASH_OPTR; a reset loads it too
time_base       "stops"                                          TIM2's interrupt is not served any more
reset           "watchdog" | "brown_out" | "option_bytes" | "pin" | "software"    the chip restarts for this reason; RAM is kept
heal            true                                             all but the last three are over

`handler` and `time_base` last until the chip restarts.
"""

from chip import EXCEPTIONS, FLASH, FLASH_BYTES, FLASH_OPTR, IRQ_TIM2, IRQ_UNUSED, NVIC_ICER, NVIC_IPR, NVIC_ISER, VTOR, pend
from pins import PINS
from supply import LOOP_CLOSED_V, LOOP_OPEN_V, LOOP_SHORTED_V, RAIL_FARADS

# Code of two handlers, put into the last words of the flash, which no image reaches: Thumb `b .` and `udf #0`, twice each.
HANDLERS = {"loop": (FLASH + FLASH_BYTES - 8, 0xE7FE_E7FE), "undefined": (FLASH + FLASH_BYTES - 4, 0xDE00_DE00)}


class Faults:
    def __init__(self, machine):
        self.machine = machine

    def inject(self, wanted):
        unknown = [key for key in wanted if not hasattr(self, f"do_{key}")]
        if unknown:
            raise ValueError(f"unknown fault {unknown[0]!r}")
        for key, value in wanted.items():
            getattr(self, f"do_{key}")(value)

    def do_interlock(self, value):
        self.machine.supply.interlock_level_v = loop_level_v(value, "open", "closed")

    def do_estop(self, value):
        self.machine.supply.emergency_stop_level_v = loop_level_v(value, "pressed", "released")

    def do_earth(self, value):
        self.machine.supply.bond_fed = value != "unfed"
        known = {"open": None, "closed": 5.0, "unfed": 5.0}
        self.machine.supply.bond_ohm = known[one_of(value, *known)] if isinstance(value, str) else float(value)

    def do_rail_fault(self, value):
        rail = one_of(value["rail"], 1, 2) - 1
        supply = self.machine.supply
        if "volts" in value:
            supply.held[rail] = None if value["volts"] is None else float(value["volts"])
        supply.gain[rail] = float(value.get("factor", supply.gain[rail]))
        supply.measurement[rail] = float(value.get("measured_factor", supply.measurement[rail]))

    def do_reference(self, value):
        self.machine.supply.reference = float(value)

    def do_enable(self, value):
        self.machine.supply.enable_stuck = one_of(value, "stuck", "works") == "stuck"

    def do_permit(self, value):
        gates = {"ignored": ("enable", "discharge"), "ignored_by_enable": ("enable",), "works": ()}
        self.machine.supply.permit_ignored = gates[one_of(value, *gates)]

    def do_pin(self, value):
        pin, stuck = PINS[one_of(value["name"], *PINS)], one_of(value["stuck"], True, False, None)
        if stuck is None:
            self.machine.defects.stuck_pins.pop(pin, None)
        else:
            self.machine.defects.stuck_pins[pin] = stuck

    def do_joined(self, value):
        self.machine.defects.joined_pins.append([PINS[one_of(name, *PINS)] for name in value])

    def do_pull_downs(self, value):
        self.machine.defects.pull_downs_work = one_of(value, "missing", "there") == "there"

    def do_break(self, value):
        dead, name = self.machine.defects.dead_breaks, value["timer"]
        one_of(name, *(timer.name for timer in self.machine.timers.with_break()))
        (dead.discard if one_of(value["works"], True, False) else dead.add)(name)

    def do_average(self, value):
        self.machine.defects.average_is_converted = one_of(value, "stops", "converts") == "converts"

    def do_register(self, value):
        address, word = int(value["address"]), int(value["value"])
        self.machine.sim.write_u32(address, word)
        self.machine.locks.adopt(address, word)

    def do_measurements(self, value):
        self.machine.supply.crossed = one_of(value, "crossed", "straight") == "crossed"

    def do_discharge(self, value):
        is_now = one_of(value, "fails", "line_open", "works")
        self.machine.supply.discharge_works = is_now != "fails"
        self.machine.supply.discharge_lines_work = is_now != "line_open"

    def do_electrode(self, value):
        place = one_of(value["era"], 1, 2, 3, 4) - 1, one_of(value["electrode"], "a", "b")
        self.machine.supply.broken.pop(place, None)
        if one_of(value["is"], "open", "shorted", "lower_open", "lower_stuck", "works") != "works":
            self.machine.supply.broken[place] = value["is"]

    def do_tolerances(self, value):
        self.machine.supply.rail_farads = RAIL_FARADS * float(value["rail_farads"])
        self.machine.supply.electrode_ohms = float(value["electrode_ohms"])

    def do_overcurrent_ma(self, value):
        self.machine.supply.shunt_a = float(value) * 1e-3

    def do_average_ma(self, value):
        self.machine.supply.forced_average_a = None if value is None else float(value) * 1e-3

    def do_pvd(self, value):
        self.machine.protection.supply_low = one_of(value, "low", "ok") == "low"

    def do_comparator_in(self, value):
        number, volts = one_of(value["number"], *self.machine.protection.outputs), value["volts"]
        if volts is None:
            self.machine.protection.disconnected.pop(number, None)
        else:
            self.machine.protection.disconnected[number] = float(volts)

    def do_comparator(self, value):
        number, stuck = one_of(value["number"], *self.machine.protection.outputs), one_of(value["stuck"], True, False, None)
        if stuck is None:
            self.machine.protection.stuck.pop(number, None)
        else:
            self.machine.protection.stuck[number] = stuck

    def do_stall(self, value):
        self.machine.timers.timers[value["timer"]].stalled = bool(value.get("on", True))

    def do_handler(self, value):
        sim, runs = self.machine.sim, value["runs"]
        self.machine.looping = runs == "loop"
        if runs in HANDLERS:
            address, code = HANDLERS[runs]
            sim.write_u32(address, code)
        else:
            address = sim.symbol(runs)
        sim.write_u32(sim.read_u32(VTOR) + 4 * (EXCEPTIONS + IRQ_UNUSED), address | 1)
        word, byte = divmod(IRQ_UNUSED, 4)
        priorities = sim.read_u32(NVIC_IPR + 4 * word) & ~(0xFF << 8 * byte)
        sim.write_u32(NVIC_IPR + 4 * word, priorities | int(value["priority"]) << 4 + 8 * byte)
        sim.write_u32(NVIC_ISER + 4 * (IRQ_UNUSED // 32), 1 << IRQ_UNUSED % 32)
        pend(sim, IRQ_UNUSED)

    def do_watchdog(self, value):
        is_now = one_of(value, "broken", "slow", "works")
        self.machine.defects.watchdog_works = is_now != "broken"
        self.machine.defects.watchdog_is_slow = is_now == "slow"

    def do_lsi(self, value):
        self.machine.defects.lsi = float(value)

    def do_option_bytes(self, value):
        self.machine.defects.option_bytes = int(value)
        self.machine.sim.write_u32(FLASH_OPTR, int(value))

    def do_time_base(self, value):
        one_of(value, "stops")
        self.machine.sim.write_u32(NVIC_ICER + 4 * (IRQ_TIM2 // 32), 1 << IRQ_TIM2 % 32)

    def do_reset(self, value):
        self.machine.reset(one_of(value, "watchdog", "brown_out", "option_bytes", "pin", "software"))

    def do_heal(self, _):
        self.machine.supply.heal()
        self.machine.defects.heal()
        self.machine.protection.supply_low = False
        self.machine.protection.stuck.clear()
        self.machine.protection.disconnected.clear()
        for timer in self.machine.timers.timers.values():
            timer.stalled = False


def loop_level_v(value, opened, closed):
    levels = {opened: LOOP_OPEN_V, closed: LOOP_CLOSED_V, "shorted": LOOP_SHORTED_V}
    return levels[one_of(value, *levels)] if isinstance(value, str) else float(value)


def one_of(value, *allowed):
    if value not in allowed:
        raise ValueError(f"{value!r} is none of {', '.join(map(repr, allowed))}")
    return value
