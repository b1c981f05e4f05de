"""The electrodes' timers: counting, preload, common start, and a history of what their outputs did.

The chip description only holds their registers. This module follows RM0440, sections 28.3 and 29.3, as far as the firmware
uses it: counting up, edge-aligned, the preloaded PSC, ARR and CCR1 to CCR4 taken over together at the update event, slaves
that start with their master's TRGO, EGR.UG. The registers read back the preload values, as on the chip.

It looks at the registers once in a slice (5 us), so a register written within 5 us after an update event may be taken over
one event early. The start of timers that TIM3 starts is known to the clock.
"""

from collections import deque

from chip import TIM3

# Sections 28.6 and 29.5.
OFFSETS = {
    "cr1": 0x00, "cr2": 0x04, "smcr": 0x08, "dier": 0x0C, "sr": 0x10, "ccmr1": 0x18, "ccmr2": 0x1C, "ccer": 0x20,
    "cnt": 0x24, "psc": 0x28, "arr": 0x2C, "ccr1": 0x34, "ccr2": 0x38, "ccr3": 0x3C, "ccr4": 0x40, "bdtr": 0x44,
    "af1": 0x60, "af2": 0x64,
}
EGR = 0x14
# Not of the chip: sets flags of SR, see board/peripherals/timer.yaml.
SR_SET = 0x3F0

CEN, ARPE = 1 << 0, 1 << 7
UG = 1 << 0
UIF = 1 << 0
# BDTR: off-state selections and main output enable; CCER: CCxE, CCxNE of the first channel; CR2: OIS1, two bits for each further channel.
OSSI, OSSR, MOE = 1 << 10, 1 << 11, 1 << 15
CCXE, CCXNE = 1 << 0, 1 << 2
OIS1_SHIFT = 8
# CCMR1: preload of the first channel.
OC1PE_SHIFT = 3
# SMCR: SMS (its fourth bit lies apart) = 0110, trigger mode, and TS = ITR2, which is TIM3 for all four; CR2 of TIM3: MMS
# (its fourth bit lies apart) = 0001, TRGO tells CEN.
SLAVE_MASK, SLAVE_OF_TIM3 = 1 << 16 | 0b11 << 20 | 0b111 << 4 | 0b111, 0b010 << 4 | 0b110
MASTER_MASK, MASTER_TELLS_ENABLE = 1 << 25 | 0b111 << 4, 0b001 << 4

# Which timer and pins make which ERA's windows, in the order of the channels.
TIMERS = {"TIM1": 0x4001_2C00, "TIM8": 0x4001_3400, "TIM20": 0x4001_5000, "TIM4": 0x4000_0800}
# It makes the permit and does not count.
TIM16 = 0x4001_4400

# Records kept for `history`; at four changes a millisecond that is half a minute.
HISTORY_LIMIT = 100_000


class Timer:
    """One timer with its shadow registers."""

    def __init__(self, sim, name, base):
        self.sim = sim
        self.name = name
        self.base = base
        self.running = False
        self.stalled = False
        # Clock at which the count was last zero.
        self.origin = 0
        self.shadow = {"psc": 0, "arr": 0xFFFF, "ccr": (0, 0, 0, 0)}
        self.recorded = None
        # When the registers that count were last taken over, and what counted before: origin and registers.
        self.changed = 0
        self.before = (0, self.shadow)

    def address(self, register):
        return self.base + OFFSETS[register]

    def read(self, register):
        return self.sim.read_u32(self.address(register))

    def write(self, register, value):
        self.sim.write_u32(self.address(register), value)

    def registers(self):
        return {name: self.read(name) for name in OFFSETS}

    def period(self):
        """Clocks from one update event to the next."""
        return (self.shadow["psc"] + 1) * (self.shadow["arr"] + 1)

    def take_over(self):
        """An update event: the preloaded registers become those that count."""
        self.shadow = {
            "psc": self.read("psc") & 0xFFFF, "arr": self.read("arr") & 0xFFFF,
            "ccr": tuple(self.read(f"ccr{channel}") & 0xFFFF for channel in (1, 2, 3, 4)),
        }

    def take_over_unbuffered(self, cr1):
        """What is not preloaded counts at once."""
        if not cr1 & ARPE:
            self.shadow["arr"] = self.read("arr") & 0xFFFF
        ccr = list(self.shadow["ccr"])
        for pair, mode in enumerate(("ccmr1", "ccmr2")):
            modes = self.read(mode)
            for place in (0, 1):
                if not modes >> (OC1PE_SHIFT + 8 * place) & 1:
                    ccr[2 * pair + place] = self.read(f"ccr{2 * pair + place + 1}") & 0xFFFF
        self.shadow["ccr"] = tuple(ccr)

    def step(self, clock, on_update):
        """Lets the timer count up to `clock`; calls `on_update(self, clock)` after each update event that changed
        something or may have to be noted."""
        cr1 = self.read("cr1")
        self.settle(clock)
        if not cr1 & CEN:
            if self.running:
                self.running = False
                on_update(self, clock)
            return
        if not self.running:
            self.start(clock)
            on_update(self, clock)
        if self.stalled:
            return
        if clock - self.origin >= self.period():
            before = (self.origin, self.shadow)
            self.origin += self.period()
            self.take_over()
            self.changed, self.before = self.origin, before
            on_update(self, self.origin)
            # The registers stay as they are within a step, so further update events change nothing.
            self.origin += (clock - self.origin) // self.period() * self.period()
        if clock >= self.origin:
            self.write("cnt", (clock - self.origin) // (self.shadow["psc"] + 1))

    def drives(self, channel):
        """Whether output `channel`, from 1, is driven, high or low, and not left floating (RM0440, section 28.6.11, output control bits)."""
        enables = self.read("ccer") >> 4 * (channel - 1)
        if self.name == "TIM4":
            return bool(enables & CCXE)
        bdtr = self.read("bdtr")
        if bdtr & MOE:
            return bool(enables & CCXE or bdtr & OSSR and enables & CCXNE)
        return bool(bdtr & OSSI and enables & (CCXE | CCXNE))

    def idles_high(self, channel):
        """Whether the output's idle level, which it has while MOE is clear, is high."""
        return bool(self.read("cr2") >> OIS1_SHIFT + 2 * (channel - 1) & 1)

    def stretches(self, since, until):
        """What has counted between these clocks: origin, registers, from when and until when."""
        if since < self.changed < until:
            origin, shadow = self.before
            yield origin, shadow, since, self.changed
        yield self.origin, self.shadow, max(since, self.changed), until

    def settle(self, clock):
        """Carries out EGR.UG."""
        if self.sim.read_u32(self.base + EGR) & UG:
            self.sim.write_u32(self.base + EGR, 0)
            self.take_over()
            self.origin = clock
            self.write("cnt", 0)

    def start(self, clock):
        """The counter goes on from the count that it holds; `clock` is when."""
        self.take_over_unbuffered(self.read("cr1"))
        self.origin = clock - (self.read("cnt") & 0xFFFF) * (self.shadow["psc"] + 1)
        self.running = True


class Timers:
    """All four, with their master, their history, and the timer that makes the permit."""

    def __init__(self, sim, history=None):
        self.sim = sim
        self.timers = {name: Timer(sim, name, base) for name, base in TIMERS.items()}
        self.permit_timer = Timer(sim, "TIM16", TIM16)
        # Whether the permit is given, without which a gate outside holds TIM4's electrodes low; set by pins.py.
        self.permitted = False
        self.master_runs = False
        # Its count when it last stood: it goes on from there.
        self.master_count = 0
        self.history = deque(maxlen=HISTORY_LIMIT) if history is None else history
        self.lost = 0
        # Name of a timer -> whether its outputs are cleared by a trip; set by protection.py.
        self.cleared = dict.fromkeys(TIMERS, False)
        # Name of a timer -> whether its pins are connected to it; set by pins.py.
        self.connected = dict.fromkeys(TIMERS, False)

    def registers(self):
        return {name: timer.registers() for name, timer in self.timers.items()}

    def with_break(self):
        return [*(timer for name, timer in self.timers.items() if name != "TIM4"), self.permit_timer]

    def step(self, clock):
        enabled = bool(self.sim.read_u32(TIM3) & CEN)
        if enabled and not self.master_runs:
            self.trigger(clock)
        elif not enabled:
            self.master_count = self.sim.read_u32(TIM3 + OFFSETS["cnt"])
        self.master_runs = enabled
        for timer in self.timers.values():
            timer.step(clock, self.updated)

    def trigger(self, clock):
        """The master has started: every slave in trigger mode starts in the same clock."""
        read = self.sim.read_u32
        if read(TIM3 + OFFSETS["cr2"]) & MASTER_MASK != MASTER_TELLS_ENABLE:
            return
        counted = (read(TIM3 + OFFSETS["cnt"]) - self.master_count) % (read(TIM3 + OFFSETS["arr"]) + 1)
        started = clock - (read(TIM3 + OFFSETS["psc"]) + 1) * counted
        for timer in self.timers.values():
            if timer.read("smcr") & SLAVE_MASK == SLAVE_OF_TIM3 and not timer.running:
                timer.settle(clock)
                timer.write("cr1", timer.read("cr1") | CEN)
                timer.start(started)
                self.note(timer, started)

    def outputs(self, timer):
        """Whether what the timer makes reaches its pins."""
        if not self.connected[timer.name] or not timer.running or self.cleared[timer.name]:
            return False
        # TIM4 has no main output enable, but a gate.
        return self.permitted if timer.name == "TIM4" else bool(timer.read("bdtr") & MOE)

    def updated(self, timer, clock):
        if timer.running:
            self.sim.write_u32(timer.base + SR_SET, UIF)
        self.note(timer, clock)

    def note_all(self, clock):
        for timer in self.timers.values():
            self.note(timer, clock)

    def note(self, timer, clock):
        """Adds to the history what the timer's outputs do from `clock` on, if that has changed."""
        state = {
            "outputs": self.outputs(timer), "psc": timer.shadow["psc"], "arr": timer.shadow["arr"], "ccr": list(timer.shadow["ccr"]),
            "cr1": timer.read("cr1"), "ccmr1": timer.read("ccmr1"), "ccmr2": timer.read("ccmr2"), "ccer": timer.read("ccer"),
        }
        if state == timer.recorded:
            return
        timer.recorded = state
        if len(self.history) == HISTORY_LIMIT:
            self.lost += 1
        self.history.append({"timer": timer.name, "clock": clock, "origin": timer.origin, **state})
