"""The board's pins by name (the table in firmware/src/pins.rs): modes, levels, the permit, and which timers reach their electrodes.

Resistors to ground hold a pin low that nothing drives, unless the board has lost them (faults.py). The windows that a timer makes are not in the
levels here; electrodes.py works them out.
"""

from chip import AFRH, AFRL, GPIO, IDR, MODER, ODR, PIN_MODES
from timers import MOE

# ERA -> timer, and port, number, alternate function and channel of its electrodes (DS12288, table 13).
ELECTRODES = {
    "era1": ("TIM1", ("A", 8, 6, 1), ("A", 10, 6, 3)),
    "era2": ("TIM8", ("C", 6, 4, 1), ("C", 9, 4, 4)),
    "era3": ("TIM20", ("B", 2, 3, 1), ("C", 8, 6, 3)),
    "era4": ("TIM4", ("B", 6, 2, 1), ("B", 9, 2, 4)),
}
HIGH_VOLTAGE_ENABLE = ("C", 3)
# High: the discharge switch of the rail is open.
DISCHARGE_OPEN = (("C", 2), ("D", 2))
# Output of TIM16: without it the supply is off, the discharge switches are closed, and the electrodes of TIM4 are low.
PERMIT = ("A", 6, 1, 1)
PINS = {
    **{f"{era}_a": a[:2] for era, (_, a, _) in ELECTRODES.items()},
    **{f"{era}_b": b[:2] for era, (_, _, b) in ELECTRODES.items()},
    "high_voltage_enable": HIGH_VOLTAGE_ENABLE, "discharge1": DISCHARGE_OPEN[0], "discharge2": DISCHARGE_OPEN[1],
    "heartbeat": ("C", 12), "permit": PERMIT[:2],
}
# Those that can energise something.
HAZARDOUS = [pin for name, pin in PINS.items() if name != "heartbeat"]

# Those that a timer can drive: port and number -> timer, channel, alternate function.
TIMER_PINS = {
    (port, number): (timer, channel, function)
    for timer, *pins in [*ELECTRODES.values(), ("TIM16", PERMIT)] for port, number, function, channel in pins
}

# TIM16 (RM0440, section 30.6): CCMR1.OC1M, of which 0101 forces the output active; CCER.CC1E and CC1P.
OC1M_MASK, OC1M_FORCED_ACTIVE = 1 << 16 | 0b111 << 4, 0b101 << 4
CC1_MASK, CC1_ENABLED = 0b11, 0b01


class Pins:
    def __init__(self, sim, defects):
        self.sim = sim
        self.defects = defects
        self.registers = None
        # Port -> what its registers drive high.
        self.driven = dict.fromkeys(GPIO, 0)
        # Pins that are connected to their timers, and pins that neither port nor timer drives: port and number.
        self.with_timer, self.without_driver = [], []
        # Port -> levels of its pads, one bit each.
        self.levels = dict.fromkeys(GPIO, 0)
        # Whether the permit's line is high.
        self.permit = False

    def named(self):
        """Mode of each pin and, for an output, whether it is told to be high. Of the permit: whether its line is high. `pad`: whether the pad
        is high, windows of the timers apart."""
        result = {name: {**self.state(*pin), "pad": self.is_high(*pin)} for name, pin in PINS.items()}
        result["permit"]["high"] = self.permit
        return result

    def state(self, port, number):
        mode = PIN_MODES[self.sim.read_u32(GPIO[port] + MODER) >> (2 * number) & 0b11]
        level = self.sim.read_u32(GPIO[port] + ODR) >> number & 1
        return {"mode": mode, "high": bool(level) if mode == "output" else None}

    def is_high(self, port, number):
        """Whether a pad is high."""
        return bool(self.levels[port] >> number & 1)

    def step(self, timers, clock):
        """Tells the timers whether their pins are connected to them, and puts the levels of the pads into the ports' IDR."""
        read = self.sim.read_u32
        registers = [[read(base + register) for register in (MODER, ODR, AFRL, AFRH)] for base in GPIO.values()]
        if registers != self.registers:
            self.registers = registers
            for name, (modes, output, *_) in zip(GPIO, registers):
                self.driven[name] = sum(output & 1 << pin for pin in range(16) if modes >> 2 * pin & 0b11 == 0b01)
            self.with_timer = [pin for pin, (*_, function) in TIMER_PINS.items() if self.follows_timer(*pin, function)]
            self.without_driver = [
                pin for pin in PINS.values() if self.state(*pin)["mode"] != "output" and pin not in self.with_timer
            ]
            for timer, *pins in ELECTRODES.values():
                timers.connected[timer] = all(pin[:2] in self.with_timer for pin in pins)
            timers.note_all(clock)
        self.step_levels(timers, clock)

    def step_levels(self, timers, clock):
        """Follows what the timers do to their pins, such as the permit, which a break withdraws at once."""
        high = dict(self.driven)
        for port, number in [pin for pin in self.with_timer if is_held_high(timers, pin)] + self.floating_high(timers):
            high[port] |= 1 << number
        for pair in self.defects.joined_pins:
            if any(high[port] >> number & 1 for port, number in pair):
                for port, number in pair:
                    high[port] |= 1 << number
        for (port, number), stuck in self.defects.stuck_pins.items():
            high[port] = high[port] & ~(1 << number) | stuck << number
        for name, level in high.items():
            if level != self.levels[name]:
                self.levels[name] = level
                self.sim.write_u32(GPIO[name] + IDR, level)
        self.permit = self.is_high(*PERMIT[:2])
        if self.permit != timers.permitted:
            timers.permitted = self.permit
            timers.note_all(clock)

    def floating_high(self, timers):
        """The pins that nothing drives, if they are high then."""
        if self.defects.pull_downs_work:
            return []
        return self.without_driver + [pin for pin in self.with_timer if not is_driven(timers, pin)]

    def follows_timer(self, port, number, function):
        if self.state(port, number)["mode"] != "timer":
            return False
        half, place = divmod(number, 8)
        return self.sim.read_u32(GPIO[port] + AFRL + 4 * half) >> (4 * place) & 0xF == function


def timer_of(timers, name):
    return timers.permit_timer if name == "TIM16" else timers.timers[name]


def is_driven(timers, pin):
    """Whether the timer that the pin is connected to drives it."""
    name, channel, _ = TIMER_PINS[pin]
    return timer_of(timers, name).drives(channel)


def is_held_high(timers, pin):
    """Whether the timer holds the pin high: the permit while it is given, and an output whose idle level is high."""
    name, channel, _ = TIMER_PINS[pin]
    if name == "TIM4":
        return False
    timer = timer_of(timers, name)
    if timer.read("bdtr") & MOE:
        return name == "TIM16" and is_held_active(timer)
    return timer.idles_high(channel) and timer.drives(channel)


def is_held_active(timer):
    """Whether the output 1 of a timer with MOE is high. Other compare modes than the forced one are not followed."""
    return timer.read("ccer") & CC1_MASK == CC1_ENABLED and timer.read("ccmr1") & OC1M_MASK == OC1M_FORCED_ACTIVE
