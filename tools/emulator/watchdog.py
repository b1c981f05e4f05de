"""The independent watchdog: it asks for a reset when it has been started and not been fed in time (RM0440, section 42)."""

from chip import CLOCK_HZ, IWDG

PRESCALER, RELOAD = IWDG + 0x04, IWDG + 0x08
# Not of the chip: which keys have been written, see board/peripherals/iwdg.yaml.
STARTED, RELOADED = IWDG + 0x40, IWDG + 0x44


class Watchdog:
    def __init__(self, sim, defects, lsi):
        self.sim = sim
        self.defects = defects
        self.lsi = lsi
        self.started = False
        self.fed_at = 0

    def timeout_s(self):
        """Section 42.3.2: the counter goes from RL to 0 at the frequency of LSI / (4 * 2^PR)."""
        divider = 4 << min(self.sim.read_u32(PRESCALER) & 0b111, 6)
        return ((self.sim.read_u32(RELOAD) & 0xFFF) + 1) * divider / self.lsi.hz

    def step(self, clock):
        """Whether the chip is to be reset."""
        if not self.started:
            if not self.sim.read_u32(STARTED):
                return False
            self.started = True
            self.fed_at = clock
        if self.sim.read_u32(RELOADED):
            self.sim.write_u32(RELOADED, 0)
            self.fed_at = clock
        return self.defects.watchdog_works and self.lsi.hz > 0 and clock - self.fed_at > self.timeout_s() * CLOCK_HZ
