"""The independent watchdog: it asks for a reset when it has been started and not been fed in time (RM0440, section 42)."""

from chip import CLOCK_HZ, IWDG

PRESCALER, RELOAD = IWDG + 0x04, IWDG + 0x08
PRESCALER_AFTER_RESET, RELOAD_AFTER_RESET = 0, 0xFFF
# Not of the chip: which keys have been written, whether prescaler and reload value may be, and that they have been, see
# board/peripherals/iwdg.yaml.
STARTED, RELOADED, WRITABLE, TOUCHED = IWDG + 0x40, IWDG + 0x44, IWDG + 0x48, IWDG + 0x4C


class Watchdog:
    def __init__(self, sim, defects, lsi, has_reset_chip=False):
        self.sim = sim
        self.defects = defects
        self.lsi = lsi
        # Whether it has ended the chip's life before this one.
        self.has_reset_chip = has_reset_chip
        self.started = False
        self.fed_at = 0
        # Its settings as they were last accepted.
        self.accepted = {PRESCALER: PRESCALER_AFTER_RESET, RELOAD: RELOAD_AFTER_RESET}

    def timeout_s(self):
        """Section 42.3.2: the counter goes from RL to 0 at the frequency of LSI / (4 * 2^PR)."""
        divider = 4 << min(self.sim.read_u32(PRESCALER) & 0b111, 6)
        return ((self.sim.read_u32(RELOAD) & 0xFFF) + 1) * divider / self.lsi.hz

    def protect_settings(self):
        """Section 42.3.4: prescaler and reload value take what is written after the key 0x5555 alone, until another key is written. What comes
        without it stays for the rest of its slice, then the old value is back."""
        writable = self.sim.read_u32(WRITABLE)
        if writable & 2:
            self.sim.write_u32(WRITABLE, writable & 1)
        if not self.sim.read_u32(TOUCHED):
            return
        self.sim.write_u32(TOUCHED, 0)
        is_writable = writable and not (self.defects.watchdog_is_slow and self.has_reset_chip)
        for address, accepted in self.accepted.items():
            now = self.sim.read_u32(address)
            if is_writable:
                self.accepted[address] = now
            elif now != accepted:
                self.sim.write_u32(address, accepted)

    def step(self, clock):
        """Whether the chip is to be reset."""
        self.protect_settings()
        if not self.started:
            if not self.sim.read_u32(STARTED):
                return False
            self.started = True
            self.fed_at = clock
        if self.sim.read_u32(RELOADED):
            self.sim.write_u32(RELOADED, 0)
            self.fed_at = clock
        return self.defects.watchdog_works and self.lsi.hz > 0 and clock - self.fed_at > self.timeout_s() * CLOCK_HZ
