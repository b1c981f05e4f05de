"""The lock of the timers with a break (BDTR.LOCK; RM0440, sections 28.6.20 and 28.6.29): what it protects keeps its value, whatever is written.

The first write to BDTR decides on the lock until the next reset, also one with LOCK = 0. A write to what is locked stays for the rest of its slice
(5 us), then the old value is back. In the slice in which BDTR is locked, a register that is written after the lock gets the value back that it had
before the slice.
"""

from chip import PWR, SYSCFG

# Not of the chip: which registers have been written, see board/peripherals/timer.yaml.
TOUCHED = 0x3F4
TOUCHED_BITS = {"bdtr": 1 << 0, "af1": 1 << 1, "af2": 1 << 2, "cr2": 1 << 3, "ccer": 1 << 4, "ccmr1": 1 << 5, "ccmr2": 1 << 6}
TOUCHED_WITH_LOCK = 1 << 8

LOCK_SHIFT, LOCK_MASK = 8, 0b11 << 8
# Level 1: of BDTR DTG, BKE, BKP, AOE, both filters, BK2E, BK2P, BKBID and BK2BID; of AF1 and AF2 sources and polarities; of CR2 the idle levels.
BDTR_1 = 0xFF | 0b111 << 12 | 0xFF << 16 | 0b11 << 24 | 0b11 << 28
AF_1, CR2_1 = 0x3EFF, 0x5_FF00
# Level 2: OSSI and OSSR.
BDTR_2 = 0b11 << 10
# Of CCER, CCxP and CCxNP of the first channel (level 2); of CCMR1 and CCMR2, CCxS, OCxM and OCxPE of the first channel (level 3).
CCER_2 = 0b1010
CCXS, CCMR_3 = 0b11, 1 << 16 | 0b111 << 4 | 1 << 3
# SYSCFG_CFGR2, PWR_CR2 and its PVDE and PLS.
CFGR2, PVDL, PWR_CR2, DETECTOR = SYSCFG + 0x1C, 1 << 2, PWR + 0x04, 0b1111
# What these registers hold after a reset.
AF1_RESET = 1


class Lock:
    """Of one timer."""

    def __init__(self, timer):
        self.timer = timer
        # None until BDTR has been written.
        self.level = None
        # The registers as they were last accepted.
        self.kept = {**dict.fromkeys(TOUCHED_BITS, 0), "af1": AF1_RESET}

    def step(self):
        sim, address = self.timer.sim, self.timer.base + TOUCHED
        touched = sim.read_u32(address)
        if not touched:
            return
        sim.write_u32(address, 0)
        now = {name: self.timer.read(name) for name in TOUCHED_BITS}
        if self.level is None:
            if touched & TOUCHED_BITS["bdtr"]:
                self.level = now["bdtr"] >> LOCK_SHIFT & 0b11
            for name, bit in TOUCHED_BITS.items():
                if name == "bdtr" or not (touched & TOUCHED_WITH_LOCK and touched & bit):
                    self.kept[name] = now[name]
        if self.level is None:
            return
        for name, mask in self.masks().items():
            accepted = now[name] & ~mask | self.kept[name] & mask
            self.kept[name] = accepted
            if accepted != now[name]:
                self.timer.write(name, accepted)

    def adopt(self, address, value):
        """A register that has changed without a write."""
        for name in TOUCHED_BITS:
            if self.timer.address(name) == address:
                self.kept[name] = value

    def masks(self):
        """The bits of each register that cannot be changed."""
        bdtr = LOCK_MASK
        masks = {}
        if self.level >= 1:
            bdtr |= BDTR_1
            masks |= {"af1": AF_1, "af2": AF_1, "cr2": CR2_1}
        if self.level >= 2:
            bdtr |= BDTR_2
            masks["ccer"] = sum(CCER_2 << 4 * channel for channel in range(4) if self.is_output(channel))
        if self.level >= 3:
            for pair, name in enumerate(("ccmr1", "ccmr2")):
                masks[name] = sum(CCMR_3 << 8 * place for place in (0, 1) if self.is_output(2 * pair + place))
        return {"bdtr": bdtr, **masks}

    def is_output(self, channel):
        """Whether a channel, from 0, is an output: only what belongs to outputs is locked."""
        return not self.kept["ccmr1" if channel < 2 else "ccmr2"] >> 8 * (channel % 2) & CCXS


class DetectorLock:
    """PWR_CR2 while SYSCFG_CFGR2.PVDL is set (RM0440, section 10.2.8): PVDE and PLS are read only. What is written in the slice in which it is set, or
    before, is accepted."""

    def __init__(self, sim):
        self.sim = sim
        self.kept = None

    def step(self):
        if not self.sim.read_u32(CFGR2) & PVDL:
            self.kept = None
            return
        now = self.sim.read_u32(PWR_CR2)
        if self.kept is None:
            self.kept = now & DETECTOR
        elif now & DETECTOR != self.kept:
            self.sim.write_u32(PWR_CR2, now & ~DETECTOR | self.kept)

    def adopt(self, address, value):
        """A register that has changed without a write."""
        if address == PWR_CR2:
            self.kept = value & DETECTOR


class Locks:
    """Those of all timers with a break, and of the voltage detector."""

    def __init__(self, timers):
        self.locks = [Lock(timer) for timer in timers.with_break()]
        self.detector = DetectorLock(timers.sim)

    def step(self):
        self.detector.step()
        for lock in self.locks:
            lock.step()

    def adopt(self, address, value):
        self.detector.adopt(address, value)
        for lock in self.locks:
            lock.adopt(address, value)
