"""The board's pins by name (the table in firmware/src/pins.rs): modes, levels, and which timers reach their electrodes."""

from chip import AFRL, GPIO, MODER, ODR, PIN_MODES

# ERA -> timer, and port, number and alternate function of its electrodes (DS12288, table 13).
ELECTRODES = {
    "era1": ("TIM1", ("A", 8, 6), ("A", 10, 6)),
    "era2": ("TIM8", ("C", 6, 4), ("C", 9, 4)),
    "era3": ("TIM20", ("B", 2, 3), ("C", 8, 6)),
    "era4": ("TIM4", ("B", 6, 2), ("B", 9, 2)),
}
HIGH_VOLTAGE_ENABLE = ("C", 3)
# High: the discharge switch of the rail is open.
DISCHARGE_OPEN = (("C", 2), ("D", 2))
OTHERS = {
    "high_voltage_enable": HIGH_VOLTAGE_ENABLE, "discharge1": DISCHARGE_OPEN[0], "discharge2": DISCHARGE_OPEN[1],
    "heartbeat": ("C", 12),
}


class Pins:
    def __init__(self, sim):
        self.sim = sim
        self.mode_words = None

    def named(self):
        """Mode of each pin and, for an output, whether it is told to be high."""
        result = {}
        for era, (_, a, b) in ELECTRODES.items():
            result[f"{era}_a"] = self.state(*a[:2])
            result[f"{era}_b"] = self.state(*b[:2])
        result.update((name, self.state(*pin)) for name, pin in OTHERS.items())
        return result

    def state(self, port, number):
        mode = PIN_MODES[self.sim.read_u32(GPIO[port] + MODER) >> (2 * number) & 0b11]
        level = self.sim.read_u32(GPIO[port] + ODR) >> number & 1
        return {"mode": mode, "high": bool(level) if mode == "output" else None}

    def step(self, timers, clock):
        """Tells the timers whether their pins are connected to them."""
        words = [self.sim.read_u32(GPIO[port] + MODER) for port in "ABC"]
        if words == self.mode_words:
            return
        self.mode_words = words
        for timer, a, b in ELECTRODES.values():
            timers.connected[timer] = self.follows_timer(*a) and self.follows_timer(*b)
        timers.note_all(clock)

    def follows_timer(self, port, number, function):
        if self.state(port, number)["mode"] != "timer":
            return False
        half, place = divmod(number, 8)
        return self.sim.read_u32(GPIO[port] + AFRL + 4 * half) >> (4 * place) & 0xF == function
