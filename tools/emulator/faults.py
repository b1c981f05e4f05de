"""Faults on demand: what the bridge's op `inject` takes. Each key is one fault; several can come in one command.

key             value                                            what happens
interlock       "open" | "closed"                                the interlock loop
estop           "pressed" | "released"                           the emergency stop loop
earth           "open" | "closed"                                the earth bond
rail_fault      {"rail": 1 | 2, and any of:
                 "volts": V | null                               the rail is held there whatever is asked (null: no more)
                 "factor": x                                     the rail settles at x times its set-point
                 "measured_factor": x}                           the divider shows x times the rail
discharge       "fails" | "works"                                the discharge switch does not close
overcurrent_ma  mA                                               through the fast shunt, until set to 0
average_ma      mA | null                                        the measured average current (null: the true one)
pvd             "low" | "ok"                                     the board's 3.3 V against the voltage detector
comparator      {"number": n, "stuck": true | false | null}      its output stays there (null: no more)
stall           {"timer": "TIM8", "on": true | false}            the timer's counter stands still
handler         {"runs": "loop" | "undefined" | name of a        an interrupt that nobody asked for: its handler loops for
                 function, "priority": 0 to 15}                  ever (15: thread mode hangs; 5: the device's task too; 0:
                                                                 everything), is undefined (HardFault), or is the
                                                                 function (for example one that panics)
time_base       "stops"                                          TIM2's interrupt is not served any more
reset           "watchdog" | "brown_out" | "pin" | "software"    the chip restarts for this reason; RAM is kept
heal            true                                             all but the last three are over

`handler` and `time_base` last until the chip restarts.
"""

from chip import EXCEPTIONS, FLASH, FLASH_BYTES, IRQ_TIM2, IRQ_UNUSED, NVIC_ICER, NVIC_IPR, NVIC_ISER, VTOR, pend

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
        self.machine.supply.interlock_closed = one_of(value, "open", "closed") == "closed"

    def do_estop(self, value):
        self.machine.supply.emergency_stop_pressed = one_of(value, "pressed", "released") == "pressed"

    def do_earth(self, value):
        self.machine.supply.bond_closed = one_of(value, "open", "closed") == "closed"

    def do_rail_fault(self, value):
        rail = one_of(value["rail"], 1, 2) - 1
        supply = self.machine.supply
        if "volts" in value:
            supply.held[rail] = None if value["volts"] is None else float(value["volts"])
        supply.gain[rail] = float(value.get("factor", supply.gain[rail]))
        supply.measurement[rail] = float(value.get("measured_factor", supply.measurement[rail]))

    def do_discharge(self, value):
        self.machine.supply.discharge_works = one_of(value, "fails", "works") == "works"

    def do_overcurrent_ma(self, value):
        self.machine.supply.shunt_a = float(value) * 1e-3

    def do_average_ma(self, value):
        self.machine.supply.forced_average_a = None if value is None else float(value) * 1e-3

    def do_pvd(self, value):
        self.machine.protection.supply_low = one_of(value, "low", "ok") == "low"

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

    def do_time_base(self, value):
        one_of(value, "stops")
        self.machine.sim.write_u32(NVIC_ICER + 4 * (IRQ_TIM2 // 32), 1 << IRQ_TIM2 % 32)

    def do_reset(self, value):
        self.machine.reset(one_of(value, "watchdog", "brown_out", "pin", "software"))

    def do_heal(self, _):
        self.machine.supply.heal()
        self.machine.protection.supply_low = False
        self.machine.protection.stuck.clear()
        for timer in self.machine.timers.timers.values():
            timer.stalled = False


def one_of(value, *allowed):
    if value not in allowed:
        raise ValueError(f"{value!r} is none of {', '.join(map(repr, allowed))}")
    return value
